# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What recordings with other measurements can determine: the table of docs/fit.md.

    ./run python benchmarks/snake_sim_benchmarks/known_values.py

simulates robots with values that no fit knows, and prints the standard deviations of both
coefficients of friction and of the stiffness of the yaw joints that the curvature gives at the
truth, in percent. Poses and angles are weighted as a fit does it. Torques are not read by a fit;
their derivatives come from runs with values that are one percent larger and smaller.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
import sys
from tempfile import TemporaryDirectory

import numpy as np

from snake_sim_ros import load_scene, run, Scene
from snake_sim_ros.commands.main import main as snake_sim
from snake_sim_ros.scene.parameters import Array, with_settings
from snake_sim_ros.studies.fit import Evaluations, unknowns_of
from snake_sim_ros.studies.recorded_motion import read_recording, Recording
from snake_sim_ros.studies.replay import Replay, ReplaySettings, Residual, with_fit_steps

TRUTH = {
    'friction.longitudinal': 0.137, 'friction.transversal': 0.412, 'robot.yaw_stiffness': 47.3
}  # fmt: skip
DURATION, RATE = 60.0, 50.0  # [s], [1/s]
BEGIN = 150  # samples of a run that depend on its start
TORQUE_NOISE = 0.05  # [N m]
SHARE = 0.01  # of a value, by which it is changed for derivatives of torques


def derivatives(recording: Recording, links: Sequence[int]) -> tuple[Array, Array]:
    """Return those of the residuals of poses of some links, and of joint angles, (m, 3) each."""
    part = replace(
        recording,
        links=recording.links[links],
        position=recording.position[:, links],
        orientation=recording.orientation[:, links],
    )
    replay = Replay(part, with_fit_steps(recording.scene), ReplaySettings(), 'interpolated')
    unknowns = unknowns_of(replay.scene, list(TRUTH), replay.setup)
    x = np.array([unknown.coordinate(unknown.start) for unknown in unknowns])
    poses, joints = [], []
    with ThreadPoolExecutor(2) as pool:
        evaluate = Evaluations(replay, unknowns, pool, 2)
        for k, unknown in enumerate(unknowns):
            step = unknown.step * (np.arange(len(x)) == k)
            ends: list[list[Residual]] = evaluate.all([x - step, x + step])
            low, high = (np.concatenate([each.poses.ravel() for each in end]) for end in ends)
            poses.append((high - low) / (2 * unknown.step))
            low, high = (np.concatenate([each.joints.ravel() for each in end]) for end in ends)
            joints.append((high - low) / (2 * unknown.step))
    return np.column_stack(poses), np.column_stack(joints)


def torque_derivatives(scene: Scene) -> Array:
    """Return the derivatives of the joint torques of a run over their noise, shape (m, 3)."""
    columns = []
    for name, value in TRUTH.items():
        low, high = (
            run(
                with_settings(scene, {name: factor * value, 'accuracy': 1e-5}),
                duration=DURATION, rate=RATE,
            ).joint_torque[BEGIN:]
            for factor in (1.0 - SHARE, 1.0 + SHARE)
        )  # fmt: skip
        columns.append((high - low).ravel() / (2 * SHARE * TORQUE_NOISE))
    return np.column_stack(columns)


def deviations(*parts: Array) -> Array:
    """Return the relative standard deviations of the values from some derivatives, shape (3,)."""
    A = np.concatenate(parts)
    A = A[~np.isnan(A).any(axis=1)]
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(A.T @ A))))


def table(name: str) -> dict[str, Array]:
    """Return the deviations in a scene, for each kind of measurement."""
    scene = with_settings(load_scene(name), TRUTH)
    with TemporaryDirectory() as folder:
        bag = Path(folder) / 'run.mcap'
        values = [text for key, value in TRUTH.items() for text in ('--set', f'{key}={value}')]
        times = ['--duration', f'{DURATION:g}', '--rate', f'{RATE:g}']
        snake_sim(['run', name, *times, '--bag', str(bag), *values])
        recording = read_recording(bag)
    n = scene.robot.link_count
    poses, joints = derivatives(recording, range(n))
    middle, torque = derivatives(recording, [n // 2])[0], torque_derivatives(scene)
    return {
        'poses of all links, with joint angles or without': deviations(poses, joints),
        'poses of head and tail, angles': deviations(
            derivatives(recording, [0, n - 1])[0], joints
        ),
        'pose of the head, angles': deviations(derivatives(recording, [0])[0], joints),
        'pose of the middle link, angles': deviations(middle, joints),
        'angles alone': deviations(joints),
        'angles and torques': deviations(joints, torque),
        'pose of the middle link, angles and torques': deviations(middle, joints, torque),
    }


if __name__ == '__main__':
    for scene_name in sys.argv[1:] or ['lateral_undulation', 'sinus_lifting']:
        for measured, found in table(scene_name).items():
            print(f'{scene_name}: {measured}:', ', '.join(f'{100 * x:.2g} %' for x in found))

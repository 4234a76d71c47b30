# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recordings that are made: the motion of a scene as another recording would have measured it."""

from dataclasses import replace

import numpy as np

from snake_sim_ros.fitting.recording import Recording
from snake_sim_ros.fitting.references import references
from snake_sim_ros.fitting.replay import between, PERIOD
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.posture import joint_angles
from snake_sim_ros.scene.rotations import product
from snake_sim_ros.stepping.samples import make_samples
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.stepping.state import State


def without_noise(
    recording: Recording, scene: Scene, state: State, law: str, horizon: float
) -> Recording:
    """
    Return the recording of a scene that follows the commands of a recording.

    Parameters
    ----------
    recording : Recording
        Its commands, its times and what was measured are kept, its measured numbers are not.
    scene : Scene
    state : State
        At the begin of the recording.
    law, horizon
        As of `references.references`.

    Raises
    ------
    ParameterError
        If the simulation diverges.

    """
    begin, dt = recording.begin, scene.dt
    every = max(1, round(PERIOD / dt))
    rows = int(np.ceil((recording.end - begin) / (every * dt) - 1e-6))
    steps = every * rows
    middles = begin + (np.arange(steps) + 0.5) * dt
    told = references(recording, scene.robot, middles, law, horizon)
    simulation, samples = Simulation(scene), make_samples(scene, every, rows)
    simulation.state = state
    report = simulation.advance(*told, samples)
    if report.failure:
        raise ParameterError(report.failure)
    q = np.concatenate([state.q[None], samples.q])
    u = np.concatenate([state.u[None], samples.u])
    joints, poses = (
        times[(times >= begin) & (times <= recording.end)]
        for times in (recording.joint_time, recording.pose_time)
    )
    kept = np.isin(recording.joint_time, joints)
    missing = np.isnan(recording.joint_angle[kept])
    angle = joint_angles(between(q, u, every * dt, joints - begin))
    links = between(q, u, every * dt, poses - begin)[:, recording.links]
    return replace(
        recording,
        joint_time=joints,
        joint_angle=np.where(missing, np.nan, angle),
        pose_time=poses,
        position=links[..., :3],
        orientation=links[..., 3:],
    )


def with_noise(
    recording: Recording, noise_position: float, noise_angle: float, seed: int
) -> Recording:
    """
    Return a recording with normally distributed noise.

    Parameters
    ----------
    recording : Recording
    noise_position, noise_angle : float
        Standard deviations [m], [rad].
    seed : int

    """
    random = np.random.default_rng(seed)

    def drawn(like: Array, deviation: float) -> Array:
        return deviation * random.standard_normal(like.shape)

    turn = np.ones(recording.orientation.shape)
    turn[..., 1:] = drawn(turn[..., 1:], noise_angle / 2)
    orientation = product(turn, recording.orientation)
    return replace(
        recording,
        joint_angle=recording.joint_angle + drawn(recording.joint_angle, noise_angle),
        position=recording.position + drawn(recording.position, noise_position),
        orientation=orientation / np.linalg.norm(orientation, axis=-1, keepdims=True),
    )

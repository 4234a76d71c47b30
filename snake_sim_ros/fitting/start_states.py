# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
States from which parts of a recording are simulated again, from what was measured around a time.

A parabola through the samples near the time gives each value and its rate. Where the robot lies
flat on a floor, it does so exactly: heading and yaw angles are measured, the rest is zero.
"""

from dataclasses import dataclass
import math

import numpy as np

from snake_sim_ros.fitting.recording import Recording
from snake_sim_ros.scene import obstacles
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.posture import chain_coordinates, gaps
from snake_sim_ros.scene.rotations import about, product, rotation_matrices
from snake_sim_ros.stepping.state import State

WINDOW = 0.12  # s before and after the time within which samples are used
LEAST_SAMPLES = 2  # on each side: a parabola at its end says little
ROUNDING = 1e-6  # s
MOMENT = 1e-3  # s before and after the time between which velocities are differences
CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])


@dataclass(frozen=True)
class Measured:
    """
    What was measured at a time: values, and their rates in a second entry.

    Attributes
    ----------
    angle : ndarray, shape (2, n-1, 2)
        [rad], [rad/s]
    links : ndarray of int, shape (l,)
        Indices of the links whose poses they are.
    position : ndarray, shape (2, l, 3)
        [m], [m/s]
    orientation : ndarray, shape (2, l, 4)
        Euler parameters, scalar first, and their rates [1/s].

    """

    angle: Array
    links: Array
    position: Array
    orientation: Array


def measured_at(recording: Recording, time: float, told: Array) -> Measured | None:
    """
    Return what was measured at a time, or None if there are not enough samples around it.

    Parameters
    ----------
    recording : Recording
    time : float
        [s]
    told : ndarray, shape (2, n-1, 2)
        References, for the joints that were not measured [rad], [rad/s].

    """
    joints = _near(recording.joint_time, time)
    poses = _near(recording.pose_time, time)
    if joints is None or poses is None:
        return None
    angle = told.copy()
    values = recording.joint_angle[joints]
    known = np.isfinite(values).all(axis=0)
    angle[:, known] = _parabola(recording.joint_time[joints] - time, values[:, known])
    since = recording.pose_time[poses] - time
    p = recording.orientation[poses]
    p = p * np.where((p * p[0]).sum(axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    position = _parabola(since, recording.position[poses])
    return Measured(angle, recording.links, position, _parabola(since, p))


def _near(times: Array, time: float) -> Array | None:
    """Return the rows of samples around a time; None if there are not enough on both sides."""
    ends = [time - WINDOW, time + ROUNDING, time + WINDOW]
    begin, middle, end = np.searchsorted(times, ends)
    if min(middle - begin, end - middle) < LEAST_SAMPLES:
        return None
    return np.arange(begin, end)


def _parabola(since: Array, values: Array) -> Array:
    """Return value and rate at time 0 of the parabola through samples, shape (2, ...)."""
    powers = (since[:, None] / WINDOW) ** np.arange(3)
    found = np.linalg.lstsq(powers, values.reshape(len(since), -1), rcond=None)[0][:2]
    found[1] /= WINDOW
    return np.asarray(found.reshape(2, *values.shape[1:]))


def start_state(scene: Scene, measured: Measured, *, is_flat: bool) -> State:
    """
    Return the state of a robot that was measured.

    Parameters
    ----------
    scene : Scene
    measured : Measured
    is_flat : bool
        Whether the robot lies flat on the floor.

    """
    before, now, after = (
        _coordinates(scene, measured, moment, is_flat) for moment in (-MOMENT, 0.0, MOMENT)
    )
    n = len(now)
    u = np.empty((n, 6))
    u[:, :3] = (after[:, :3] - before[:, :3]) / (2 * MOMENT)
    ends = [p * np.where((p * now[:, 3:]).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
            for p in (before[:, 3:], after[:, 3:])]  # fmt: skip
    turn = product(now[:, 3:] * CONJUGATE, (ends[1] - ends[0]) / (2 * MOMENT))
    u[:, 3:] = 2.0 * turn[:, 1:]
    if is_flat:
        u[:, [2, 3, 5]] = 0.0
    lift = obstacles.lift_onto_ground(scene, now) if scene.ground.heights else None
    now[:, 2] += -gaps(scene.robot, now).min() if lift is None else lift
    return State(now, u)


def _coordinates(scene: Scene, measured: Measured, moment: float, is_flat: bool) -> Array:
    """Return coordinates some moment [s] after the time, shape (n, 7)."""
    angle, position, p = (
        part[0] + moment * part[1]
        for part in (measured.angle, measured.position, measured.orientation)
    )
    if is_flat:
        angle[:, 1] = 0.0
    q, i = chain_coordinates(scene.robot, angle), measured.links
    turns = product(p / np.linalg.norm(p, axis=-1, keepdims=True), q[i, 3:] * CONJUGATE)
    turn = (turns * np.where(turns @ turns[0] < 0.0, -1.0, 1.0)[:, None]).mean(axis=0)
    turn /= np.linalg.norm(turn)
    if is_flat:
        turn = about(2, 2.0 * math.atan2(turn[3], turn[0]))
    q[:, :3] = q[:, :3] @ rotation_matrices(turn).T
    q[:, :3] += (position - q[i, :3]).mean(axis=0)
    if is_flat:
        q[:, 2] = 0.0
    q[:, 3:] = product(np.broadcast_to(turn, (len(q), 4)), q[:, 3:])
    return q

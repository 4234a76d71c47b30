# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Differences of two runs in their paths, headings and joint angles."""

import math
from typing import NamedTuple

import numpy as np

from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.posture import joint_angles
from snake_sim_ros.stepping.trajectory import Trajectory


class Motion(NamedTuple):
    """
    The part of a run that is compared with other runs.

    Attributes
    ----------
    path : ndarray, shape (m, 3)
        Center of the middle link [m, frame I].
    heading : ndarray, shape (m,)
        Direction of the mean link axis in the plane, without jumps [rad].
    joint_angle : ndarray, shape (m, n-1, 2)
        (yaw, pitch) [rad].

    """

    path: Array
    heading: Array
    joint_angle: Array


def heading(axis: Array) -> Array:
    """Return the direction (m,) of the mean of link axes (m, n, 3) in the plane [rad]."""
    x, y, _ = axis.sum(axis=1).T
    return np.unwrap(np.arctan2(y, x))


def motion(trajectory: Trajectory) -> Motion:
    """Return path, heading and joint angles of a trajectory."""
    angle = joint_angles(trajectory.coordinates)
    return Motion(trajectory.path, heading(trajectory.axis), angle)


def extrapolated(coarse: Trajectory, fine: Trajectory) -> Motion:
    """Return the motion extrapolated to a time step of zero, for first order and steps 2 to 1."""
    angles = [joint_angles(run.coordinates) for run in (fine, coarse)]
    return Motion(
        path=2 * fine.path - coarse.path,
        heading=heading(2 * fine.axis - coarse.axis),
        joint_angle=2 * angles[0] - angles[1],
    )


def path_error(path: Array, expected: Array) -> float:
    """
    Return the largest distance of two paths at any time, over the length of the way gone.

    The way is the distance from the first point of the expected path to the last. The error is
    infinite for paths of different lengths, of which one belongs to a run that ended early.
    """
    if path.shape != expected.shape:
        return math.inf
    way = np.linalg.norm(expected[-1] - expected[0])
    return float(np.linalg.norm(path - expected, axis=-1).max() / way)


def largest_difference(values: Array, expected: Array) -> float:
    """Return the largest absolute difference; infinity for runs of different lengths."""
    if values.shape != expected.shape:
        return math.inf
    return float(np.abs(values - expected).max(initial=0.0))

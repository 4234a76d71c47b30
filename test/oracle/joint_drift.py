# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The drift of joints removed as in `joint_drift`, section VII-C, in NumPy for dense steps."""

import math

import numpy as np

from snake_sim_ros import Robot
from snake_sim_ros.dynamics.force_directions import E_X, E_Y, E_Z
from snake_sim_ros.scene import posture
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.rotations import cross, product, rotation_matrices


def without_drift(robot: Robot, q: Array, rule: str, furthest: Array) -> Array:
    """
    Return the coordinates with closed joints, section VII-C: link 1 and all velocities are kept.

    Deviation: the paper turns link i+1 about its own e_z until its e_x is at right angles to e_y
    of link i. At a pitch of 90 degrees no such turn exists, and beyond it the turn flips the link.
    Here it is turned about the common normal of both, which is the smallest turn there is.

    Deviation, for the rule ``center_of_mass``: the robot is then moved back so that its center of
    mass is where it was, which section VII-C does not keep.

    Parameters
    ----------
    robot : Robot
    q : ndarray, shape (n, 7)
        Coordinates, with Euler parameters of any length.
    rule : str
        One of `parameters.DRIFT_CORRECTIONS`.
    furthest : ndarray, shape (n-1, 2)
        Largest joint angles to either side [rad]; see `furthest_angles`.

    Returns
    -------
    ndarray, shape (n, 7)

    """
    q = q.copy()
    q[:, 3:] /= np.linalg.norm(q[:, 3:], axis=1)[:, None]
    if rule == 'none':
        return q
    center = posture.center_of_mass(robot, q)
    half = robot.per_link('link_length') / 2
    for i in range(robot.link_count - 1):
        R_i, R_next = rotation_matrices(q[i : i + 2, 3:])
        normal = cross(R_i @ E_Y, R_next @ E_X)
        cosine = float(np.linalg.norm(normal))
        theta = math.atan2((R_i @ E_Y) @ (R_next @ E_X), cosine)
        turn = np.array([math.cos(theta / 2), *(math.sin(theta / 2) / cosine * normal)])
        q[i + 1, 3:] = product(turn, q[i + 1, 3:])
        turn_back(q, i, furthest)
        R_next = rotation_matrices(q[i + 1 : i + 2, 3:])[0]
        q[i + 1, :3] = q[i, :3] + half[i] * R_i @ E_Z + half[i + 1] * R_next @ E_Z
    if rule == 'center_of_mass':
        q[:, :3] += center - posture.center_of_mass(robot, q)
    return q


def turn_back(q: Array, i: int, furthest: Array) -> None:
    """Turn link i+1 about e_y of link i and its own e_x until both angles are in bounds."""
    for k in range(2):
        R_i, R_next = rotation_matrices(q[i : i + 2, 3:])
        angle = float(posture.joint_angles(q[i : i + 2])[0, k])
        if abs(angle) > furthest[i, k]:
            half = (math.copysign(furthest[i, k], angle) - angle) / 2
            turn = np.array([math.cos(half), *(math.sin(half) * (R_i @ E_Y, R_next @ E_X)[k])])
            q[i + 1, 3:] = product(turn, q[i + 1, 3:])


def furthest_angles(stop: float, start: Array, middle: Array) -> Array:
    """
    Return the largest joint angles to either side after a step, infinite where no stop acts.

    An angle at its stop does not grow. A stop that is met between the start and the middle of a
    step acts at the middle. All angles have the shape (n-1, 2) [rad].
    """
    at_stop = np.where(np.abs(start) >= stop, np.abs(start), np.abs(middle))
    return np.where(np.abs(middle) >= stop, at_stop, np.inf)

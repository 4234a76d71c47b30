# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The drift of joints removed as in `joint_drift`, section VII-C, in NumPy for dense steps."""

import math

import numpy as np

from snake_sim_ros import Robot
from snake_sim_ros.dynamics.force_directions import E_X, E_Y, joint_normals
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
    furthest : ndarray, shape (n-1, 2, 2)
        Least and largest angles of the axes [rad]; see `furthest_angles`.

    Returns
    -------
    ndarray, shape (n, 7)

    """
    q = q.copy()
    q[:, 3:] /= np.linalg.norm(q[:, 3:], axis=1)[:, None]
    if rule == 'none':
        return q
    center = posture.center_of_mass(robot, q)
    places = robot.chain.places
    for i in range(robot.link_count - 1):
        for k in range(len(joint_normals(robot, rotation_matrices(q[:, 3:]), i))):
            a, b = joint_normals(robot, rotation_matrices(q[:, 3:]), i)[k]
            normal = cross(a, b)
            cosine = float(np.linalg.norm(normal))
            theta = math.atan2(a @ b, cosine)
            turn = np.array([math.cos(theta / 2), *(math.sin(theta / 2) / cosine * normal)])
            q[i + 1, 3:] = product(turn, q[i + 1, 3:])
        turn_back(robot, q, i, furthest)
        R_i, R_next = rotation_matrices(q[i : i + 2, 3:])
        q[i + 1, :3] = q[i, :3] + R_i @ places.distal[i] - R_next @ places.proximal[i + 1]
    if rule == 'center_of_mass':
        q[:, :3] += center - posture.center_of_mass(robot, q)
    return q


def turn_back(robot: Robot, q: Array, i: int, furthest: Array) -> None:
    """Turn link i+1 about the axes of the joint before it until both angles are in bounds."""
    for k in range(2):
        inner, outer = posture.joint_frames(rotation_matrices(q[:, 3:]), robot)
        angle = float(posture.joint_angles(q, robot)[i, k])
        if not furthest[i, k, 0] <= angle <= furthest[i, k, 1]:
            half = (float(np.clip(angle, *furthest[i, k])) - angle) / 2
            turn = np.array(
                [math.cos(half), *(math.sin(half) * (inner[i] @ E_Y, outer[i] @ E_X)[k])]
            )
            q[i + 1, 3:] = product(turn, q[i + 1, 3:])


def furthest_angles(stop: Array, start: Array, middle: Array) -> Array:
    """
    Return least and largest joint angles after a step, infinite where no stop acts (n-1, 2, 2).

    An angle at its stop goes no further. A stop that is met between the start and the middle of a
    step acts at the middle. Angles have the shape (n-1, 2), stops (n-1, 2, 2) [rad].
    """
    low, high = stop[..., 0], stop[..., 1]
    least = np.where(middle <= low, np.where(start <= low, start, middle), -np.inf)
    most = np.where(middle >= high, np.where(start >= high, start, middle), np.inf)
    return np.stack([least, most], axis=-1)

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How far the joints are open, eqs. (11)-(13), and how they are closed, section VII-C.

Arrays are those of `kinematics`: half of the link lengths, coordinates q with unit Euler
parameters, velocities u, link frames R and angular velocities omega in I.

A stop of a joint bounds the rate of an axis as it is at the middle of the step. While the robot
turns, the angle at the end of the step differs from that of this rate by terms of the order
dt^2, and over many steps a joint creeps beyond its stop. This drift is removed with that of the
joints: an angle at its stop does not grow in a step.
"""

import math

from snake_sim_ros.dynamics.compilation import compiled, inlined, merged
from snake_sim_ros.dynamics.kinematics import axis_x, axis_y, axis_z
from snake_sim_ros.dynamics.spatial_vectors import Three
from snake_sim_ros.scene.parameters import Array, DRIFT_CORRECTIONS

SMALL_SQUARE = 1e-6  # of a sine; its third power is below rounding
PAPER, CENTER_OF_MASS, NONE = range(len(DRIFT_CORRECTIONS))


@inlined
def joint_violation(half_length: Array, q: Array) -> tuple[float, float]:
    """Return the largest violation of a joint in position [m] and angle [1], eqs. (11)-(13)."""
    gap = twist = 0.0
    for j in range(len(q) - 1):
        a, b = axis_z(q, j), axis_z(q, j + 1)
        for k in range(3):
            chained = q[j, k] + half_length[j] * a[k] + half_length[j + 1] * b[k]
            gap = max(gap, abs(chained - q[j + 1, k]))
        twist = max(twist, abs(joint_twist(q, j)))
    return gap, twist


@inlined
def joint_violation_rate(half_length: Array, R: Array, u: Array, omega: Array) -> float:
    """
    Return the fastest rate of joint violations at given velocities [m/s], eqs. (38)-(41).

    The rate of the angle counts as the speed of a point half a link away. Of `u`, only the
    velocities of the link centers count.
    """
    fastest = 0.0
    for j in range(len(R) - 1):
        for k, r, s in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            inner = omega[j, r] * R[j, s, 2] - omega[j, s] * R[j, r, 2]
            outer = omega[j + 1, r] * R[j + 1, s, 2] - omega[j + 1, s] * R[j + 1, r, 2]
            chained = u[j, k] + half_length[j] * inner + half_length[j + 1] * outer
            fastest = max(fastest, abs(u[j + 1, k] - chained))
        twist = 0.0
        for k, r, s in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            normal = R[j, r, 1] * R[j + 1, s, 0] - R[j, s, 1] * R[j + 1, r, 0]
            twist += normal * (omega[j + 1, k] - omega[j, k])
        fastest = max(fastest, half_length[j] * abs(twist))
    return fastest


@inlined
def close_joints(rule: int, half_length: Array, mass: Array, furthest: Array, q: Array) -> None:
    """
    Remove the joint drift, section VII-C: link by link from the first one, which stays in place.

    Deviation: the paper turns a link about its own e_z until the axes of the joint are at right
    angles again. No such turn does this at a pitch of 90 degrees, and beyond it only a flip of the
    link does. Here the link is turned about the common normal of both axes, by the smallest angle
    that exists.

    Deviation, for CENTER_OF_MASS: afterwards the robot is moved back to its center of mass. The
    correction is internal to the robot, so it must not move it.

    Parameters
    ----------
    rule : int
        PAPER, CENTER_OF_MASS or NONE.
    half_length, mass : ndarray, shape (n,)
        Half of the link lengths [m], and masses of the links [kg].
    furthest : ndarray, shape (n-1, 2)
        Largest joint angles to either side, see `furthest_angle`.
    q : ndarray, shape (n, 7)
        Coordinates; corrected.

    """
    if rule == NONE:
        return
    moment_x = moment_y = moment_z = mass_sum = 0.0
    for i in range(len(q)):
        x, y, z = q[i, 0], q[i, 1], q[i, 2]
        if i > 0:
            square_axes(q, i - 1)
            if furthest[i - 1, 0] < math.inf or furthest[i - 1, 1] < math.inf:
                turn_back(q, i - 1, furthest)
            a, b = axis_z(q, i - 1), axis_z(q, i)
            for k in range(3):
                q[i, k] = q[i - 1, k] + half_length[i - 1] * a[k] + half_length[i] * b[k]
        moment_x += mass[i] * (q[i, 0] - x)
        moment_y += mass[i] * (q[i, 1] - y)
        moment_z += mass[i] * (q[i, 2] - z)
        mass_sum += mass[i]
    if rule == CENTER_OF_MASS:
        for i in range(len(q)):
            q[i, 0] -= moment_x / mass_sum
            q[i, 1] -= moment_y / mass_sum
            q[i, 2] -= moment_z / mass_sum


@merged
def square_axes(q: Array, j: int) -> None:
    """
    Turn link j+1 until its e_x is at right angles to e_y of link j.

    About their common normal n = e_y x e_x this is the angle with the sine g_Jphi and the cosine
    abs(n). Half of the angle is found without computing it: its cosine c, and its sine over
    abs(n). For the small angles of a step these are the first terms of their series, since each
    joint has to wait for the one before.
    """
    a, b = axis_y(q, j), axis_x(q, j + 1)
    x, y, z = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    sine = along(a, b)
    square = sine * sine
    if square < SMALL_SQUARE:
        c = 1.0 - square * (1.0 / 8.0 + square * (5.0 / 128.0))
        s = sine * (0.5 + square * (5.0 / 16.0 + square * (63.0 / 256.0)))
    else:
        cosine = math.sqrt(x * x + y * y + z * z)
        c = math.sqrt(0.5 * (1.0 + cosine))
        s = sine / (2.0 * c * cosine)
    turn_link(q, j + 1, c, s * x, s * y, s * z)


@inlined
def turn_link(q: Array, i: int, c: float, x: float, y: float, z: float) -> None:
    """Turn link i by the rotation in I with the Euler parameters (c, x, y, z)."""
    e0, e1, e2, e3 = q[i, 3], q[i, 4], q[i, 5], q[i, 6]
    q[i, 3], q[i, 4], q[i, 5], q[i, 6] = (
        c * e0 - x * e1 - y * e2 - z * e3,
        c * e1 + x * e0 + y * e3 - z * e2,
        c * e2 + y * e0 + z * e1 - x * e3,
        c * e3 + z * e0 + x * e2 - y * e1,
    )


@inlined
def joint_twist(q: Array, j: int) -> float:
    """Return e_y of link j times e_x of link j+1: g_Jphi, eq. (13)."""
    return along(axis_y(q, j), axis_x(q, j + 1))


@inlined
def along(a: Three, b: Three) -> float:
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def furthest_angle(stop: float, q: Array, j: int, k: int, middle: float) -> float:
    """
    Return the largest angle of axis k of joint j, to either side, after a step of the paper [rad].

    Parameters
    ----------
    stop : float
        Where the stop is [rad].
    q : ndarray, shape (n, 7)
        Coordinates at the start of the step.
    j, k : int
    middle : float
        Angle at the middle of the step [rad].

    Returns
    -------
    float
        Infinite where no stop acts. A stop that is met between start and middle of the step acts
        at the middle.

    """
    if not abs(middle) >= stop:
        return math.inf
    start = abs(joint_angle(q, j, k))
    return start if start >= stop else abs(middle)


@compiled
def joint_angle(q: Array, j: int, k: int) -> float:
    """Return the angle of axis k of joint j, eq. (66) [rad]."""
    if k == 0:
        a, b, c = axis_z(q, j), axis_x(q, j), axis_x(q, j + 1)
        return math.atan2(-along(a, c), along(b, c))
    a, b, c = axis_y(q, j), axis_y(q, j + 1), axis_z(q, j + 1)
    return math.atan2(-along(a, c), along(a, b))


@compiled
def turn_back(q: Array, j: int, furthest: Array) -> None:
    """Turn link j+1 about the axes of joint j until its angles are at most `furthest`."""
    for k in range(2):
        angle = joint_angle(q, j, k)
        if abs(angle) > furthest[j, k]:
            half = 0.5 * (math.copysign(furthest[j, k], angle) - angle)
            x, y, z = axis_y(q, j) if k == 0 else axis_x(q, j + 1)
            s = math.sin(half)
            turn_link(q, j + 1, math.cos(half), s * x, s * y, s * z)

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How far the joints are open, eqs. (11)-(13), and how they are closed, section VII-C.

Arrays are those of `kinematics`: coordinates q with unit Euler parameters, velocities u, link
frames R and angular velocities omega in I. A joint with one axis has a constraint more, by which
the axis that it does not have is held.

A stop of a joint bounds the rate of an axis as it is at the middle of the step. While the robot
turns, the angle at the end of the step differs from that of this rate by terms of the order
dt^2, and over many steps a joint creeps beyond its stop. This drift is removed with that of the
joints: an angle at its stop does not grow in a step.
"""

import math

from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.dynamics.kinematics import (
    axis_x,
    axis_y,
    axis_z,
    carried,
    carried_part,
    carried_place,
    JointFrames,
)
from snake_sim_ros.dynamics.spatial_vectors import Three
from snake_sim_ros.scene.chain import JointPlaces
from snake_sim_ros.scene.parameters import Array, DRIFT_CORRECTIONS

SMALL_SQUARE = 1e-6  # of a sine; its third power is below rounding
PAPER, CENTER_OF_MASS, NONE = range(len(DRIFT_CORRECTIONS))


# ---- frames of the joints -----------------------------------------------------------------------


@inlined
def inner_axis(places: JointPlaces, q: Array, j: int, k: int) -> Three:
    """Return e_y, k = 1, or e_z, k = 2, of the frame of joint j in the link before it, in I."""
    if places.aligned:
        return axis_y(q, j) if k == 1 else axis_z(q, j)
    D = places.inner
    return carried(q, j, D[j, 0, k], D[j, 1, k], D[j, 2, k])


@inlined
def outer_axis(places: JointPlaces, q: Array, j: int, k: int) -> Three:
    """Return e_x, k = 0, or e_z, k = 2, of the frame of joint j in the link after it, in I."""
    if places.aligned:
        return axis_x(q, j + 1) if k == 0 else axis_z(q, j + 1)
    D = places.outer
    return carried(q, j + 1, D[j, 0, k], D[j, 1, k], D[j, 2, k])


# ---- violations ---------------------------------------------------------------------------------


@inlined
def joint_violation(places: JointPlaces, q: Array) -> tuple[float, float]:
    """Return the largest violation of a joint in position [m] and angle [1], eqs. (11)-(13)."""
    gap = twist = 0.0
    for j in range(len(q) - 1):
        a = carried_place(places.straight, q, j, places.distal, j)
        b = carried_place(places.straight, q, j + 1, places.proximal, j + 1)
        for k in range(3):
            gap = max(gap, abs(q[j, k] + a[k] - b[k] - q[j + 1, k]))
        twist = max(twist, abs(along(inner_axis(places, q, j, 1), outer_axis(places, q, j, 0))))
        if not places.complete:
            k, m = held_columns(places, j)
            a, b = inner_axis(places, q, j, k), outer_axis(places, q, j, m)
            twist = max(twist, abs(along(a, b)))
    return gap, twist


@inlined
def held_columns(places: JointPlaces, j: int) -> tuple[int, int]:
    """
    Return the columns of the inner and the outer frame of joint j that its axes keep square.

    By these a joint with one axis does not turn about the other one. Of a joint with two axes they
    are those of eq. (13).
    """
    if places.present[j, 0] == 0.0:
        return 2, 0
    return (1, 2) if places.present[j, 1] == 0.0 else (1, 0)


@inlined
def joint_violation_rate(
    places: JointPlaces, R: Array, frames: JointFrames, u: Array, omega: Array
) -> float:
    """
    Return the fastest rate of joint violations at given velocities [m/s], eqs. (38)-(41).

    The rate of an angle counts as the speed of a point that is as far from the joint as the center
    of the link before it. Of `u`, only the velocities of the link centers count.
    """
    fastest, inner, outer = 0.0, frames.inner, frames.outer
    for j in range(len(R) - 1):
        square = 0.0
        for k, r, s in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            before_r = carried_part(places.straight, R, j, places.distal, j, r)
            before_s = carried_part(places.straight, R, j, places.distal, j, s)
            after_r = carried_part(places.straight, R, j + 1, places.proximal, j + 1, r)
            after_s = carried_part(places.straight, R, j + 1, places.proximal, j + 1, s)
            before = omega[j, r] * before_s - omega[j, s] * before_r
            after = omega[j + 1, r] * after_s - omega[j + 1, s] * after_r
            fastest = max(fastest, abs(u[j + 1, k] - (u[j, k] + before - after)))
            square += before_r * before_r
        k, m = held_columns(places, j)
        twist = max(
            relative_rate(inner, outer, omega, j, 1, 0),
            relative_rate(inner, outer, omega, j, k, m),
        )
        fastest = max(fastest, math.sqrt(square) * twist)
    return fastest


@inlined
def relative_rate(inner: Array, outer: Array, omega: Array, j: int, a: int, b: int) -> float:
    """Return how fast column a of an inner frame leaves the plane normal to b of an outer one."""
    rate = 0.0
    for k, r, s in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        normal = inner[j, r, a] * outer[j, s, b] - inner[j, s, a] * outer[j, r, b]
        rate += normal * (omega[j + 1, k] - omega[j, k])
    return abs(rate)


# ---- correction ---------------------------------------------------------------------------------


@inlined
def close_joints(rule: int, places: JointPlaces, mass: Array, furthest: Array, q: Array) -> None:
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
    places : JointPlaces
    mass : ndarray, shape (n,)
        Masses of the links [kg].
    furthest : ndarray, shape (n-1, 2, 2)
        Least and largest angles of the axes, see `furthest_angles`; empty without stops.
    q : ndarray, shape (n, 7)
        Coordinates; corrected.

    """
    if rule == NONE:
        return
    moment_x = moment_y = moment_z = mass_sum = 0.0
    for i in range(len(q)):
        x, y, z = q[i, 0], q[i, 1], q[i, 2]
        if i > 0:
            j = i - 1
            if places.aligned:
                square_axes(q, i, axis_y(q, j), axis_x(q, i))
            else:
                square_axes(q, i, inner_axis(places, q, j, 1), outer_axis(places, q, j, 0))
            if not places.complete:
                hold_absent_axis(places, q, j)
            if len(furthest) > 0:
                turn_back(places, q, j, furthest)
            a, b = (
                carried_place(places.straight, q, j, places.distal, j),
                carried_place(places.straight, q, i, places.proximal, i),
            )
            for k in range(3):
                q[i, k] = q[j, k] + a[k] - b[k]
        moment_x += mass[i] * (q[i, 0] - x)
        moment_y += mass[i] * (q[i, 1] - y)
        moment_z += mass[i] * (q[i, 2] - z)
        mass_sum += mass[i]
    if rule == CENTER_OF_MASS:
        for i in range(len(q)):
            q[i, 0] -= moment_x / mass_sum
            q[i, 1] -= moment_y / mass_sum
            q[i, 2] -= moment_z / mass_sum


@inlined
def square_axes(q: Array, i: int, a: Three, b: Three) -> None:
    """
    Turn link i until its unit vector b is at right angles to the unit vector a; both are in I.

    About their common normal n = a x b this is the angle with the sine a b, eq. (13), and the
    cosine abs(n). Half of the angle is found without computing it: its cosine c, and its sine over
    abs(n). For the small angles of a step these are the first terms of their series, since each
    joint has to wait for the one before.
    """
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
    turn_link(q, i, c, s * x, s * y, s * z)


@inlined
def hold_absent_axis(places: JointPlaces, q: Array, j: int) -> None:
    """Turn link j+1 back about the axis that joint j does not have, if there is one."""
    k, m = held_columns(places, j)
    if (k, m) != (1, 0):
        square_axes(q, j + 1, inner_axis(places, q, j, k), outer_axis(places, q, j, m))


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
def along(a: Three, b: Three) -> float:
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def furthest_angles(
    places: JointPlaces, stop: Array, q: Array, mid: Array, furthest: Array
) -> None:
    """
    Fill the least and the largest angle of every axis after a step of the paper [rad].

    They are infinite where no stop acts. A stop that is met between the start and the middle of
    the step acts at the middle. `stop` and `furthest`, shape (n-1, 2, 2), have the least and the
    largest angles of (yaw, pitch). q, shape (n, 7), is that at the start of the step, and `mid`,
    shape (n-1, 2, 2), is joint x (yaw, pitch) x (angle [rad], rate) at its middle.
    """
    for j in range(len(furthest)):
        for k in range(2):
            middle = mid[j, k, 0]
            furthest[j, k, 0], furthest[j, k, 1] = -math.inf, math.inf
            for side in range(2):
                sign = 2.0 * side - 1.0
                bound = sign * stop[j, k, side]
                if sign * middle >= bound:
                    start = joint_angle(places, q, j, k)
                    furthest[j, k, side] = start if sign * start >= bound else middle


@compiled
def joint_angle(places: JointPlaces, q: Array, j: int, k: int) -> float:
    """Return the angle of axis k of joint j, eq. (66) [rad]."""
    if k == 0:
        a, b, c = (
            axis_of(places.inner, q, j, j, 2),
            axis_of(places.inner, q, j, j, 0),
            (axis_of(places.outer, q, j, j + 1, 0)),
        )
        return math.atan2(-along(a, c), along(b, c))
    a = axis_of(places.inner, q, j, j, 1)
    b, c = axis_of(places.outer, q, j, j + 1, 1), axis_of(places.outer, q, j, j + 1, 2)
    return math.atan2(-along(a, c), along(a, b))


@inlined
def axis_of(frame: Array, q: Array, j: int, i: int, k: int) -> Three:
    """Return axis k in I of the frame of joint j in link i."""
    return carried(q, i, frame[j, 0, k], frame[j, 1, k], frame[j, 2, k])


@compiled
def turn_back(places: JointPlaces, q: Array, j: int, furthest: Array) -> None:
    """Turn link j+1 about the axes of joint j until its angles are within `furthest`."""
    for k in range(2):
        low, high = furthest[j, k, 0], furthest[j, k, 1]
        if not (low > -math.inf or high < math.inf):
            continue
        angle = joint_angle(places, q, j, k)
        if angle < low or angle > high:
            half = 0.5 * ((low if angle < low else high) - angle)
            x, y, z = inner_axis(places, q, j, 1) if k == 0 else outer_axis(places, q, j, 0)
            s = math.sin(half)
            turn_link(q, j + 1, math.cos(half), s * x, s * y, s * z)

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Compiled kinematics of the chain of links: eqs. (6), (66), (72), (83).

The relations hold for whole arrays of links and are computed without temporary arrays. Coordinates
q of a link are its center [m, frame I] and Euler parameters, scalar first. Velocities u are that
of the center [m/s, frame I] and the angular velocity [rad/s, frame B].

The arrays of n links are:

- `q`, shape (n, 7), and `u`, shape (n, 6): coordinates and velocities.
- `R`, shape (n, 3, 3): link frames in I.
- `omega`, shape (n, 3): angular velocities in I [rad/s].
- `center`, shape (n, 3): link centers from O, the center of the middle link, in axes of I [m].
- `twist`, shape (n, 6): angular velocities [rad/s] and velocities at O [m/s], in axes of I.
"""

import math
from typing import NamedTuple

import numpy as np

from snake_sim_ros.dynamics.compilation import choose, compiled, inlined, Pack, pair
from snake_sim_ros.dynamics.records import entry
from snake_sim_ros.dynamics.spatial_vectors import Three
from snake_sim_ros.scene.chain import JointPlaces, Spheres
from snake_sim_ros.scene.parameters import Array

FLAT_GAP = 1e-4  # largest gap, and depth, of a robot that lies flat [m]
FLAT_TILT = 1e-3  # its largest roll [rad]
STILL_SPEED = 1e-3  # largest vertical and rolling speed of a robot that lies still [m/s]


class JointFrames(NamedTuple):
    """The frames of the joints in I, those in the link before and those in the link after."""

    inner: Array  # (n-1, 3, 3) columns e_x, e_y, e_z in axes of I; yaw is about this e_y
    outer: Array  # (n-1, 3, 3) the same; pitch is about this e_x


def make_joint_frames(places: JointPlaces, R: Array) -> JointFrames:
    """Return the frames of joints in links with the frames R (n, 3, 3), to be filled."""
    if places.aligned:
        return JointFrames(R[:-1], R[1:])
    return JointFrames(np.zeros((len(R) - 1, 3, 3)), np.zeros((len(R) - 1, 3, 3)))


@inlined
def joint_frames(places: JointPlaces, R: Array, frames: JointFrames) -> None:
    """Fill the frames of the joints; where they are those of links they are views of R."""
    if places.aligned:
        return
    for j in range(len(R) - 1):
        for k in range(3):
            for m in range(3):
                inner = outer = 0.0
                for s in range(3):
                    inner += R[j, k, s] * places.inner[j, s, m]
                    outer += R[j + 1, k, s] * places.outer[j, s, m]
                frames.inner[j, k, m], frames.outer[j, k, m] = inner, outer


@compiled
def link_frames(p: Array, R: Array) -> None:
    """
    Fill the rotation matrices of links, eq. (6).

    Parameters
    ----------
    p : ndarray, shape (n, 4)
        Euler parameters of any length, scalar first.
    R : ndarray, shape (n, 3, 3)
        Filled with R^I_B.

    """
    for i in range(len(p)):
        e0, e1, e2, e3 = p[i, 0], p[i, 1], p[i, 2], p[i, 3]
        s = 1.0 / (e0 * e0 + e1 * e1 + e2 * e2 + e3 * e3)
        R[i, 0, 0] = s * (e0 * e0 + e1 * e1 - e2 * e2 - e3 * e3)
        R[i, 1, 1] = s * (e0 * e0 - e1 * e1 + e2 * e2 - e3 * e3)
        R[i, 2, 2] = s * (e0 * e0 - e1 * e1 - e2 * e2 + e3 * e3)
        R[i, 0, 1] = 2.0 * s * (e1 * e2 - e0 * e3)
        R[i, 1, 0] = 2.0 * s * (e1 * e2 + e0 * e3)
        R[i, 0, 2] = 2.0 * s * (e1 * e3 + e0 * e2)
        R[i, 2, 0] = 2.0 * s * (e1 * e3 - e0 * e2)
        R[i, 1, 2] = 2.0 * s * (e2 * e3 - e0 * e1)
        R[i, 2, 1] = 2.0 * s * (e2 * e3 + e0 * e1)


@inlined
def rates_in_inertial_frame(R: Array, u: Array, omega: Array) -> None:
    """Fill the angular velocities of links in I, `omega`."""
    for i in range(len(u)):
        for k in range(3):
            omega[i, k] = R[i, k, 0] * u[i, 3] + R[i, k, 1] * u[i, 4] + R[i, k, 2] * u[i, 5]


@inlined
def half_rotation(
    p: tuple[float, float, float, float], omega: Three, step: float
) -> tuple[float, float, float, float]:
    """
    Return ``p + step H_bar(p)^T omega``: half of a step of the kinematic map (74).

    Parameters
    ----------
    p : tuple of 4 float
        Euler parameters, scalar first.
    omega : tuple of 3 float
        Angular velocity in B [rad/s].
    step : float
        Half of the time of the rotation [s].

    Returns
    -------
    tuple of 4 float
        Euler parameters, not normalized.

    """
    e0, e1, e2, e3 = p
    x, y, z = omega
    return (
        e0 - step * (e1 * x + e2 * y + e3 * z),
        e1 + step * (e0 * x + e2 * z - e3 * y),
        e2 + step * (e0 * y + e3 * x - e1 * z),
        e3 + step * (e0 * z + e1 * y - e2 * x),
    )


@compiled
def middle_coordinates(dt: float, q: Array, u: Array, q_mid: Array) -> None:
    """
    Fill the coordinates at the middle of a step, eq. (72), solved in closed form for p_M.

    The equation is ``q_M = q_A + dt/2 F(q_M) u_A`` with the time step dt [s] and with q and u at
    the start. The Euler parameters in `q_mid` are not normalized.
    """
    for i in range(len(q)):
        for k in range(3):
            q_mid[i, k] = q[i, k] + dt / 2 * u[i, k]
        x, y, z = u[i, 3], u[i, 4], u[i, 5]
        s = 1.0 / (1.0 + dt * dt / 16 * (x * x + y * y + z * z))
        e0, e1, e2, e3 = half_rotation((q[i, 3], q[i, 4], q[i, 5], q[i, 6]), (x, y, z), dt / 4)
        q_mid[i, 3], q_mid[i, 4], q_mid[i, 5], q_mid[i, 6] = s * e0, s * e1, s * e2, s * e3


@inlined
def copy_rows(array: Array, to: Array, columns: int) -> None:
    """Copy a matrix of a number of columns, which the compiler knows, such as coordinates."""
    for i in range(len(array)):
        for k in range(columns):
            to[i, k] = array[i, k]


@inlined
def end_coordinates(dt: float, q_mid: Array, u: Array, q: Array) -> None:
    """
    Fill the coordinates at the end of a step, eq. (83), with Euler parameters of length 1 (VII-C).

    The equation is ``q_E = q_M + dt/2 F(q_M) u_E`` with the time step dt [s] and with `q_mid` from
    `middle_coordinates`. The velocities are those at the end.
    """
    for i in range(len(q)):
        for k in range(3):
            q[i, k] = q_mid[i, k] + dt / 2 * u[i, k]
        p = q_mid[i, 3], q_mid[i, 4], q_mid[i, 5], q_mid[i, 6]
        e0, e1, e2, e3 = half_rotation(p, (u[i, 3], u[i, 4], u[i, 5]), dt / 4)
        s = 1.0 / math.sqrt(e0 * e0 + e1 * e1 + e2 * e2 + e3 * e3)
        q[i, 3], q[i, 4], q[i, 5], q[i, 6] = s * e0, s * e1, s * e2, s * e3


@inlined
def joint_coordinates(frames: JointFrames, omega: Array, coordinate: Array) -> None:
    """
    Fill the angles and rates of all joints, eq. (66).

    `coordinate`, shape (n-1, 2, 2), is (yaw, pitch) x (angle [rad], rate [rad/s]).
    """
    inner, outer = frames.inner, frames.outer
    for j in range(len(inner)):
        xx = xz = yy = yz = yaw_rate = pitch_rate = 0.0
        for k in range(3):
            xx += inner[j, k, 0] * outer[j, k, 0]
            xz += inner[j, k, 2] * outer[j, k, 0]
            yy += inner[j, k, 1] * outer[j, k, 1]
            yz += inner[j, k, 1] * outer[j, k, 2]
            relative = omega[j + 1, k] - omega[j, k]
            yaw_rate += inner[j, k, 1] * relative
            pitch_rate += outer[j, k, 0] * relative
        angle = angles(pair(-xz, -yz), pair(xx, yy))
        coordinate[j, 0, 0], coordinate[j, 0, 1] = angle[0], yaw_rate
        coordinate[j, 1, 0], coordinate[j, 1, 1] = angle[1], pitch_rate


@inlined
def angles(y: Pack, x: Pack) -> Pack:
    """
    Return ``atan2(y, x)`` of two pairs of numbers to two units in the last place.

    The quotient is first turned by 0, 45 or 90 degrees, until it is at most 0.66. The rational
    approximation is that of the Cephes library [1]_. For both angles at once it takes a fourth of
    the time of two calls of the C library.

    .. [1] S. L. Moshier, "Methods and Programs for Mathematical Functions", 1989.
    """
    o = pair(0.0, 0.0)
    a, b = choose(o, y, o - y, y), choose(o, x, o - x, x)
    diagonal, steep = 0.66 * b, (1.0 + math.sqrt(2.0)) * b
    over = choose(a, steep, o - b, choose(a, diagonal, a - b, a))
    under = choose(a, steep, a, choose(a, diagonal, a + b, b))
    turn = choose(a, steep, o + math.pi / 2, choose(a, diagonal, o + math.pi / 4, o))
    t = over / choose(under, o, under, o + 1.0)
    z = t * t
    p = (-8.750608600031904122785e-1 * z - 1.615753718733365076637e1) * z
    p = ((p - 7.500855792314704667340e1) * z - 1.228866684490136173410e2) * z
    p = p - 6.485021904942025371773e1
    q = ((z + 2.485846490142306297962e1) * z + 1.650270098316988542046e2) * z
    q = ((q + 4.328810604912902668951e2) * z + 4.853903996359136964868e2) * z
    angle = turn + (t + t * (z * p / (q + 1.945506571482613964425e2)))
    angle = choose(o, x, math.pi - angle, angle)
    return choose(o, y, o - angle, angle)


@entry
def joint_motions(
    places: JointPlaces,
    motion: tuple[Array, Array],
    R: Array,
    omega: Array,
    frames: JointFrames,
    coordinate: Array,
) -> None:
    """
    Fill the angles and rates of all joints in m states, as `joint_coordinates` does for one.

    `motion` is q and u of the states. `coordinate` has a first axis of length m, too. R, `omega`
    and `frames` are work arrays for one state.
    """
    q, u = motion
    for k in range(len(q)):
        link_frames(q[k, :, 3:], R)
        joint_frames(places, R, frames)
        rates_in_inertial_frame(R, u[k], omega)
        joint_coordinates(frames, omega, coordinate[k])


@compiled
def chain_geometry(
    places: JointPlaces, R: Array, frames: JointFrames, center: Array, axis: Array
) -> None:
    """
    Fill the link centers and the twists of the joint axes, from O in axes of I.

    A joint twist is that of the outer link against the inner one, as seen from the middle link.
    `axis`, shape (n-1, 2, 6), is filled with the (angular, linear) twists of both axes at a rate
    of 1, which are 0 for an axis that a joint does not have, and `center` with the link centers.
    """
    n, present = len(R), places.present
    straight = places.straight
    for k in range(3):
        center[0, k] = 0.0
        for i in range(1, n):
            before = carried_part(straight, R, i - 1, places.distal, i - 1, k)
            step = before - carried_part(straight, R, i, places.proximal, i, k)
            center[i, k] = center[i - 1, k] + step
        origin = center[n // 2, k]
        for i in range(n):
            center[i, k] -= origin
    inner, outer = frames.inner, frames.outer
    for j in range(n - 1):
        x = center[j, 0] + carried_part(straight, R, j, places.distal, j, 0)
        y = center[j, 1] + carried_part(straight, R, j, places.distal, j, 1)
        z = center[j, 2] + carried_part(straight, R, j, places.distal, j, 2)
        side = 1.0 if j >= n // 2 else -1.0
        yaw, pitch = side * present[j, 0], side * present[j, 1]
        # Yaw is about e_y of the inner frame, pitch about e_x of the outer one.
        ax, ay, az = yaw * inner[j, 0, 1], yaw * inner[j, 1, 1], yaw * inner[j, 2, 1]
        set_axis_twist(axis[j], 0, (ax, ay, az), (x, y, z))
        ax, ay, az = pitch * outer[j, 0, 0], pitch * outer[j, 1, 0], pitch * outer[j, 2, 0]
        set_axis_twist(axis[j], 1, (ax, ay, az), (x, y, z))


@inlined
def set_axis_twist(axis: Array, k: int, a: Three, point: Three) -> None:
    """Write the twist of a turn at the rate a about a point to axis[k]."""
    (ax, ay, az), (x, y, z) = a, point
    axis[k, 0], axis[k, 1], axis[k, 2] = ax, ay, az
    axis[k, 3] = y * az - z * ay
    axis[k, 4] = z * ax - x * az
    axis[k, 5] = x * ay - y * ax


@inlined
def carried_part(straight: bool, R: Array, i: int, place: Array, row: int, k: int) -> float:
    """
    Return component k in I of a vector of link i, which is a row of place (m, 3).

    If all rows are `straight` they are along the links, as all places of Aiko.
    """
    if straight:
        return R[i, k, 2] * place[row, 2]
    return R[i, k, 0] * place[row, 0] + R[i, k, 1] * place[row, 1] + R[i, k, 2] * place[row, 2]


@inlined
def carried_in(R: Array, i: int, place: Array, row: int) -> Three:
    """Return in I a vector of link i, which is a row of place (m, 3)."""
    return (
        carried_part(False, R, i, place, row, 0),
        carried_part(False, R, i, place, row, 1),
        carried_part(False, R, i, place, row, 2),
    )


@inlined
def twists(u: Array, omega: Array, center: Array, twist: Array) -> None:
    """Fill the twists of links about O, in axes of I."""
    for i in range(len(u)):
        wx, wy, wz = omega[i, 0], omega[i, 1], omega[i, 2]
        x, y, z = center[i, 0], center[i, 1], center[i, 2]
        twist[i, 0], twist[i, 1], twist[i, 2] = wx, wy, wz
        twist[i, 3] = u[i, 0] - (wy * z - wz * y)
        twist[i, 4] = u[i, 1] - (wz * x - wx * z)
        twist[i, 5] = u[i, 2] - (wx * y - wy * x)


@inlined
def end_velocities(twist: Array, R: Array, center: Array, u: Array) -> None:
    """Fill the velocities of links, `u`, from their twists about O."""
    for i in range(len(u)):
        wx, wy, wz = twist[i, 0], twist[i, 1], twist[i, 2]
        x, y, z = center[i, 0], center[i, 1], center[i, 2]
        u[i, 0] = twist[i, 3] + wy * z - wz * y
        u[i, 1] = twist[i, 4] + wz * x - wx * z
        u[i, 2] = twist[i, 5] + wx * y - wy * x
        for k in range(3):
            u[i, 3 + k] = R[i, 0, k] * wx + R[i, 1, k] * wy + R[i, 2, k] * wz


@inlined
def axis_x(q: Array, i: int) -> Three:
    """Return e_x of link i in I, from coordinates q (n, 7) with unit Euler parameters."""
    e0, e1, e2, e3 = q[i, 3], q[i, 4], q[i, 5], q[i, 6]
    return (
        e0 * e0 + e1 * e1 - e2 * e2 - e3 * e3,
        2.0 * (e1 * e2 + e0 * e3),
        2.0 * (e1 * e3 - e0 * e2),
    )


@inlined
def axis_y(q: Array, i: int) -> Three:
    """Return e_y of link i in I, from coordinates q (n, 7) with unit Euler parameters."""
    e0, e1, e2, e3 = q[i, 3], q[i, 4], q[i, 5], q[i, 6]
    return (
        2.0 * (e1 * e2 - e0 * e3),
        e0 * e0 - e1 * e1 + e2 * e2 - e3 * e3,
        2.0 * (e2 * e3 + e0 * e1),
    )


@inlined
def axis_z(q: Array, i: int) -> Three:
    """Return e_z of link i in I, from coordinates q (n, 7) with unit Euler parameters."""
    e0, e1, e2, e3 = q[i, 3], q[i, 4], q[i, 5], q[i, 6]
    return (
        2.0 * (e1 * e3 + e0 * e2),
        2.0 * (e2 * e3 - e0 * e1),
        e0 * e0 - e1 * e1 - e2 * e2 + e3 * e3,
    )


@inlined
def carried(q: Array, i: int, x: float, y: float, z: float) -> Three:
    """Return the vector (x, y, z) of link i in I, from coordinates q with unit parameters."""
    a, b, c = axis_x(q, i), axis_y(q, i), axis_z(q, i)
    return (
        x * a[0] + y * b[0] + z * c[0],
        x * a[1] + y * b[1] + z * c[1],
        x * a[2] + y * b[2] + z * c[2],
    )


@inlined
def carried_place(straight: bool, q: Array, i: int, place: Array, row: int) -> Three:
    """Return in I a vector of link i, which is a row of place (m, 3); see `carried_part`."""
    if straight:
        z, c = place[row, 2], axis_z(q, i)
        return z * c[0], z * c[1], z * c[2]
    return carried(q, i, place[row, 0], place[row, 1], place[row, 2])


@compiled
def chain_coordinates(
    places: JointPlaces, mass: Array, pose: Array, angle: Array, q: Array
) -> None:
    """
    Fill the coordinates of all links from center of mass, middle link and joint angles.

    The rotation from the inner to the outer frame of a joint is ``R_y(yaw) R_x(pitch)``, eq. (66),
    so that joints are closed and their axes at right angles, whatever the angles are.

    Parameters
    ----------
    places : JointPlaces
    mass : ndarray, shape (n,)
        Masses of the links [kg].
    pose : ndarray, shape (7,)
        Center of mass of the robot [m, frame I], and unit Euler parameters of the middle link.
    angle : ndarray, shape (n-1, 2)
        Joint angles (yaw, pitch) [rad].
    q : ndarray, shape (n, 7)
        Filled.

    """
    n = len(q)
    root = n // 2
    for k in range(7):
        q[root, k] = pose[k]
    for i in range(root + 1, n):
        yaw, pitch = 0.5 * angle[i - 1, 0], 0.5 * angle[i - 1, 1]
        p = q[i - 1, 3], q[i - 1, 4], q[i - 1, 5], q[i - 1, 6]
        if not places.aligned:
            p = turned_by(p, places.inner_turn, i - 1, 1.0)
        p = turned_about_x(turned_about_y(p, yaw), pitch)
        if not places.aligned:
            p = turned_by(p, places.outer_turn, i - 1, -1.0)
        set_turn(q, i, p)
        place_link(places.straight, places.distal, places.proximal, q, i, i - 1)
    for i in range(root - 1, -1, -1):
        yaw, pitch = -0.5 * angle[i, 0], -0.5 * angle[i, 1]
        p = q[i + 1, 3], q[i + 1, 4], q[i + 1, 5], q[i + 1, 6]
        if not places.aligned:
            p = turned_by(p, places.outer_turn, i, 1.0)
        p = turned_about_y(turned_about_x(p, pitch), yaw)
        if not places.aligned:
            p = turned_by(p, places.inner_turn, i, -1.0)
        set_turn(q, i, p)
        place_link(places.straight, places.proximal, places.distal, q, i, i + 1)
    x, y, z = mean_of_links(mass, q)
    for i in range(n):
        q[i, 0] += pose[0] - x
        q[i, 1] += pose[1] - y
        q[i, 2] += pose[2] - z


@inlined
def mean_of_links(mass: Array, x: Array) -> Three:
    """Return the mean of the first three columns of x, weighted with the masses of the links."""
    x0 = x1 = x2 = mass_sum = 0.0
    for i in range(len(mass)):
        x0 += mass[i] * x[i, 0]
        x1 += mass[i] * x[i, 1]
        x2 += mass[i] * x[i, 2]
        mass_sum += mass[i]
    return x0 / mass_sum, x1 / mass_sum, x2 / mass_sum


Four = tuple[float, float, float, float]


@inlined
def turned_about_x(p: Four, half_angle: float) -> Four:
    """Return Euler parameters turned about their own e_x by twice an angle [rad]."""
    (e0, e1, e2, e3), c, s = p, math.cos(half_angle), math.sin(half_angle)
    return c * e0 - s * e1, c * e1 + s * e0, c * e2 + s * e3, c * e3 - s * e2


@inlined
def turned_about_y(p: Four, half_angle: float) -> Four:
    """Return Euler parameters turned about their own e_y by twice an angle [rad]."""
    (e0, e1, e2, e3), c, s = p, math.cos(half_angle), math.sin(half_angle)
    return c * e0 - s * e2, c * e1 - s * e3, c * e2 + s * e0, c * e3 + s * e1


@inlined
def turned_by(p: Four, turn: Array, j: int, sign: float) -> Four:
    """Return Euler parameters turned by those in row j of turn (n-1, 4), or back for sign -1."""
    (a0, a1, a2, a3), b0 = p, turn[j, 0]
    b1, b2, b3 = sign * turn[j, 1], sign * turn[j, 2], sign * turn[j, 3]
    return (
        a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
        a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
        a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
        a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0,
    )


@inlined
def set_turn(q: Array, i: int, p: Four) -> None:
    """Write Euler parameters to link i."""
    q[i, 3], q[i, 4], q[i, 5], q[i, 6] = p


@inlined
def place_link(straight: bool, beyond: Array, near: Array, q: Array, i: int, beside: int) -> None:
    """Place link i at its neighbor `beside`; their joint is at `beyond` in that, `near` in it."""
    a = carried_place(straight, q, beside, beyond, beside)
    b = carried_place(straight, q, i, near, i)
    for k in range(3):
        q[i, k] = q[beside, k] + (a[k] - b[k])


@inlined
def sphere_height(spheres: Spheres, q: Array, a: int) -> float:
    """Return the height of the lowest point of sphere a over z = 0 [m]."""
    i = spheres.link[a]
    arm = carried_place(spheres.straight, q, i, spheres.place, a)
    return q[i, 2] + arm[2] - spheres.radius[a]


@inlined
def floor_penetration(spheres: Spheres, q: Array) -> float:
    """Return how deep the lowest contact sphere is below the floor [m], 0 if it is not."""
    lowest = 0.0
    for a in range(len(spheres.link)):
        lowest = min(lowest, sphere_height(spheres, q, a))
    return -lowest


@inlined
def lies_flat_and_still(spheres: Spheres, q: Array, u: Array, omega: Array) -> bool:
    """Return whether every link is on the floor, is not rolled, and moves in the plane only."""
    for a in range(len(spheres.link)):
        i = spheres.link[a]
        e0, e1, e2, e3 = q[i, 3], q[i, 4], q[i, 5], q[i, 6]
        gap = abs(sphere_height(spheres, q, a))
        speed = spheres.radius[a] * max(abs(omega[i, 0]), abs(omega[i, 1]))
        if not (gap <= FLAT_GAP and max(speed, abs(u[i, 2])) <= STILL_SPEED):
            return False
        if not abs(2.0 * (e1 * e3 - e0 * e2)) <= FLAT_TILT:
            return False
    return True

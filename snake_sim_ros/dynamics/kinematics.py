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
- `half_length`, shape (n,): half of the link lengths [m].
- `center`, shape (n, 3): link centers from O, the center of the middle link, in axes of I [m].
- `twist`, shape (n, 6): angular velocities [rad/s] and velocities at O [m/s], in axes of I.
"""

import math

from snake_sim_ros.dynamics.compilation import choose, compiled, inlined, merged, Pack, pair
from snake_sim_ros.dynamics.spatial_vectors import Three
from snake_sim_ros.scene.parameters import Array

FLAT_GAP = 1e-4  # largest gap, and depth, of a robot that lies flat [m]
FLAT_TILT = 1e-3  # its largest roll [rad]
STILL_SPEED = 1e-3  # largest vertical and rolling speed of a robot that lies still [m/s]


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


@compiled
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
def keep_coordinates(q: Array, to: Array) -> None:
    """Copy coordinates (n, 7)."""
    for i in range(len(q)):
        for k in range(7):
            to[i, k] = q[i, k]


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
def joint_coordinates(R: Array, omega: Array, coordinate: Array) -> None:
    """
    Fill the angles and rates of all joints, eq. (66).

    `coordinate`, shape (n-1, 2, 2), is (yaw, pitch) x (angle [rad], rate [rad/s]).
    """
    for j in range(len(R) - 1):
        xx = xz = yy = yz = yaw_rate = pitch_rate = 0.0
        for k in range(3):
            xx += R[j, k, 0] * R[j + 1, k, 0]
            xz += R[j, k, 2] * R[j + 1, k, 0]
            yy += R[j, k, 1] * R[j + 1, k, 1]
            yz += R[j, k, 1] * R[j + 1, k, 2]
            relative = omega[j + 1, k] - omega[j, k]
            yaw_rate += R[j, k, 1] * relative
            pitch_rate += R[j + 1, k, 0] * relative
        angle = angles(pair(-xz, -yz), pair(xx, yy))
        coordinate[j, 0, 0], coordinate[j, 0, 1] = angle[0], yaw_rate
        coordinate[j, 1, 0], coordinate[j, 1, 1] = angle[1], pitch_rate


@merged
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


@compiled
def joint_motions(q: Array, u: Array, R: Array, omega: Array, coordinate: Array) -> None:
    """
    Fill the angles and rates of all joints in m states, as `joint_coordinates` does for one.

    q, u and `coordinate` have a first axis of length m. `R` and `omega` are work arrays for one
    state.
    """
    for k in range(len(q)):
        link_frames(q[k, :, 3:], R)
        rates_in_inertial_frame(R, u[k], omega)
        joint_coordinates(R, omega, coordinate[k])


@compiled
def chain_geometry(half_length: Array, R: Array, center: Array, axis: Array) -> None:
    """
    Fill the link centers and the twists of the joint axes, from O in axes of I.

    A joint twist is that of the outer link against the inner one, as seen from the middle link.
    `axis`, shape (n-1, 2, 6), is filled with the (angular, linear) twists of yaw and pitch at a
    rate of 1, and `center` with the link centers.
    """
    n = len(R)
    for k in range(3):
        center[0, k] = 0.0
        for i in range(1, n):
            step = half_length[i - 1] * R[i - 1, k, 2] + half_length[i] * R[i, k, 2]
            center[i, k] = center[i - 1, k] + step
        origin = center[n // 2, k]
        for i in range(n):
            center[i, k] -= origin
    for j in range(n - 1):
        x = center[j, 0] + half_length[j] * R[j, 0, 2]
        y = center[j, 1] + half_length[j] * R[j, 1, 2]
        z = center[j, 2] + half_length[j] * R[j, 2, 2]
        for k, i, column in ((0, j, 1), (1, j + 1, 0)):  # yaw about e_y^i, pitch about e_x^i+1
            sign = 1.0 if j >= n // 2 else -1.0
            ax, ay, az = sign * R[i, 0, column], sign * R[i, 1, column], sign * R[i, 2, column]
            axis[j, k, 0], axis[j, k, 1], axis[j, k, 2] = ax, ay, az
            axis[j, k, 3] = y * az - z * ay
            axis[j, k, 4] = z * ax - x * az
            axis[j, k, 5] = x * ay - y * ax


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


@compiled
def chain_coordinates(
    half_length: Array, mass: Array, pose: Array, angle: Array, q: Array
) -> None:
    """
    Fill the coordinates of all links from center of mass, middle link and joint angles.

    The rotation from link j to link j+1 is ``R_y(yaw) R_x(pitch)``, eq. (66), so that joints are
    closed and their axes at right angles, whatever the angles are.

    Parameters
    ----------
    half_length, mass : ndarray, shape (n,)
        Half of the link lengths [m], and masses of the links [kg].
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
        p = turned_about_y(q[i - 1, 3], q[i - 1, 4], q[i - 1, 5], q[i - 1, 6], yaw)
        place_link(half_length, q, i, i - 1, 1.0, turned_about_x(p[0], p[1], p[2], p[3], pitch))
    for i in range(root - 1, -1, -1):
        yaw, pitch = -0.5 * angle[i, 0], -0.5 * angle[i, 1]
        p = turned_about_x(q[i + 1, 3], q[i + 1, 4], q[i + 1, 5], q[i + 1, 6], pitch)
        place_link(half_length, q, i, i + 1, -1.0, turned_about_y(p[0], p[1], p[2], p[3], yaw))
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


@inlined
def turned_about_x(
    e0: float, e1: float, e2: float, e3: float, half_angle: float
) -> tuple[float, float, float, float]:
    """Return Euler parameters turned about their own e_x by twice an angle [rad]."""
    c, s = math.cos(half_angle), math.sin(half_angle)
    return c * e0 - s * e1, c * e1 + s * e0, c * e2 + s * e3, c * e3 - s * e2


@inlined
def turned_about_y(
    e0: float, e1: float, e2: float, e3: float, half_angle: float
) -> tuple[float, float, float, float]:
    """Return Euler parameters turned about their own e_y by twice an angle [rad]."""
    c, s = math.cos(half_angle), math.sin(half_angle)
    return c * e0 - s * e2, c * e1 - s * e3, c * e2 + s * e0, c * e3 + s * e1


@inlined
def place_link(
    half_length: Array,
    q: Array,
    i: int,
    beside: int,
    side: float,
    p: tuple[float, float, float, float],
) -> None:
    """Fill q of link i with Euler parameters p, joined to a link on the given side of it."""
    q[i, 3], q[i, 4], q[i, 5], q[i, 6] = p
    a, b = axis_z(q, beside), axis_z(q, i)
    for k in range(3):
        q[i, k] = q[beside, k] + side * (half_length[beside] * a[k] + half_length[i] * b[k])


@merged
def floor_penetration(offset: Array, radius: Array, q: Array) -> float:
    """
    Return how deep the lowest contact sphere is below the floor [m], 0 if it is not.

    `offset` and `radius`, shape (n,), are the distances of the contact spheres from the link
    centers and the radii of the spheres [m].
    """
    lowest = 0.0
    for i in range(len(q)):
        lowest = min(lowest, q[i, 2] - offset[i] * abs(axis_z(q, i)[2]) - radius[i])
    return -lowest


@merged
def lies_flat_and_still(offset: Array, radius: Array, q: Array, u: Array, omega: Array) -> bool:
    """
    Return whether every link is on the floor, is not rolled, and moves in the plane only.

    `offset` and `radius` are those of `floor_penetration`; `omega` may have more columns.
    """
    for i in range(len(q)):
        e0, e1, e2, e3 = q[i, 3], q[i, 4], q[i, 5], q[i, 6]
        height, lift = q[i, 2] - radius[i], offset[i] * axis_z(q, i)[2]
        gap = max(abs(height + lift), abs(height - lift))
        speed = radius[i] * max(abs(omega[i, 0]), abs(omega[i, 1]))
        if not (gap <= FLAT_GAP and max(speed, abs(u[i, 2])) <= STILL_SPEED):
            return False
        if not abs(2.0 * (e1 * e3 - e0 * e2)) <= FLAT_TILT:
            return False
    return True

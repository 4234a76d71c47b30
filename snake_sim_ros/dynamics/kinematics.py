"""
Compiled kinematics of the chain of links: eqs. (6), (66), (72), (83) and section VII-C.

The same relations as in `reference.py`, for whole arrays of links and without temporary arrays.
Every function fills the arrays named in its first line.
"""

import math

from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.compilation import merged
from snake_sim_ros.scene.parameters import DRIFT_CORRECTIONS

PAPER, CENTER_OF_MASS, NONE = range(len(DRIFT_CORRECTIONS))

FLAT_GAP = 1e-4  # gap of a robot that lies flat, and depth [m]
FLAT_TILT = 1e-3  # its roll [rad]
STILL_SPEED = 1e-3  # vertical speed of a robot that lies still, and of contacts that roll [m/s]


@compiled
def link_frames(p, R):
    """Fill R with the rotation matrices of Euler parameters p (n, 4) of any length, eq. (6)."""
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
def rates_in_inertial_frame(R, u, omega):
    """Fill omega (n, 3) with the angular velocities in I."""
    for i in range(len(u)):
        for k in range(3):
            omega[i, k] = R[i, k, 0] * u[i, 3] + R[i, k, 1] * u[i, 4] + R[i, k, 2] * u[i, 5]


@compiled
def half_rotation(p, omega, step):
    """Return p + step H_bar(p)^T omega, omega in B: half of a step of the kinematic map (74)."""
    e0, e1, e2, e3 = p
    x, y, z = omega
    return (
        e0 - step * (e1 * x + e2 * y + e3 * z),
        e1 + step * (e0 * x + e2 * z - e3 * y),
        e2 + step * (e0 * y + e3 * x - e1 * z),
        e3 + step * (e0 * z + e1 * y - e2 * x),
    )


@compiled
def middle_coordinates(dt, q, u, q_mid):
    """Fill q_mid with q_M = q_A + dt/2 F(q_M) u_A, eq. (72), solved in closed form for p_M."""
    for i in range(len(q)):
        for k in range(3):
            q_mid[i, k] = q[i, k] + dt / 2 * u[i, k]
        x, y, z = u[i, 3], u[i, 4], u[i, 5]
        s = 1.0 / (1.0 + dt * dt / 16 * (x * x + y * y + z * z))
        e0, e1, e2, e3 = half_rotation((q[i, 3], q[i, 4], q[i, 5], q[i, 6]), (x, y, z), dt / 4)
        q_mid[i, 3], q_mid[i, 4], q_mid[i, 5], q_mid[i, 6] = s * e0, s * e1, s * e2, s * e3


@inlined
def end_coordinates(dt, q_mid, u, q):
    """Fill q with q_E = q_M + dt/2 F(q_M) u_E, eq. (83), Euler parameters of length 1 (VII-C)."""
    for i in range(len(q)):
        for k in range(3):
            q[i, k] = q_mid[i, k] + dt / 2 * u[i, k]
        p = q_mid[i, 3], q_mid[i, 4], q_mid[i, 5], q_mid[i, 6]
        e0, e1, e2, e3 = half_rotation(p, (u[i, 3], u[i, 4], u[i, 5]), dt / 4)
        s = 1.0 / math.sqrt(e0 * e0 + e1 * e1 + e2 * e2 + e3 * e3)
        q[i, 3], q[i, 4], q[i, 5], q[i, 6] = s * e0, s * e1, s * e2, s * e3


@inlined
def joint_coordinates(R, omega, coordinate):
    """Fill coordinate (n-1, 2, 2) with the (angle, rate) of yaw and pitch, eq. (66)."""
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
        coordinate[j, 0, 0], coordinate[j, 0, 1] = math.atan2(-xz, xx), yaw_rate
        coordinate[j, 1, 0], coordinate[j, 1, 1] = math.atan2(-yz, yy), pitch_rate


@compiled
def joint_motions(q, u, R, omega, coordinate):
    """Fill coordinate (m, n-1, 2, 2) as `joint_coordinates` for m states; R, omega are of one."""
    for k in range(len(q)):
        link_frames(q[k, :, 3:], R)
        rates_in_inertial_frame(R, u[k], omega)
        joint_coordinates(R, omega, coordinate[k])


@compiled
def chain_geometry(half_length, R, center, axis):
    """
    Fill the link centers from O, the center of the middle link, and the twists of the joint axes.

    A joint twist is that of the outer link against the inner one, as seen from the middle link.
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
def twists(u, omega, center, twist):
    """Fill the twists about O of links with velocities u and angular velocities omega in I."""
    for i in range(len(u)):
        wx, wy, wz = omega[i, 0], omega[i, 1], omega[i, 2]
        x, y, z = center[i, 0], center[i, 1], center[i, 2]
        twist[i, 0], twist[i, 1], twist[i, 2] = wx, wy, wz
        twist[i, 3] = u[i, 0] - (wy * z - wz * y)
        twist[i, 4] = u[i, 1] - (wz * x - wx * z)
        twist[i, 5] = u[i, 2] - (wx * y - wy * x)


@inlined
def end_velocities(twist, R, center, u):
    """Fill u_E (n, 6) from the twists about O."""
    for i in range(len(u)):
        wx, wy, wz = twist[i, 0], twist[i, 1], twist[i, 2]
        x, y, z = center[i, 0], center[i, 1], center[i, 2]
        u[i, 0] = twist[i, 3] + wy * z - wz * y
        u[i, 1] = twist[i, 4] + wz * x - wx * z
        u[i, 2] = twist[i, 5] + wx * y - wy * x
        for k in range(3):
            u[i, 3 + k] = R[i, 0, k] * wx + R[i, 1, k] * wy + R[i, 2, k] * wz


@inlined
def axis_z(q, i):
    """Return e_z of link i in I."""
    e0, e1, e2, e3 = q[i, 3], q[i, 4], q[i, 5], q[i, 6]
    return (
        2.0 * (e1 * e3 + e0 * e2),
        2.0 * (e2 * e3 - e0 * e1),
        e0 * e0 - e1 * e1 - e2 * e2 + e3 * e3,
    )


@inlined
def joint_violation_rate(half_length, R, u, omega):
    """
    Return the fastest rate of joint violations at given velocities [m/s], eqs. (38)-(41).

    Of the twist of a joint, as the speed of a point half a link away.
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
def joint_violation(half_length, q):
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
def close_joints(rule, half_length, mass, q):
    """
    Remove the joint drift from q, section VII-C: link by link from the first one, which is held.

    Deviation: the paper turns a link about its own e_z until the axes of the joint are at right
    angles again, which no such turn does at a pitch of 90 degrees, and a flip of the link does
    beyond. Here it is turned about the common normal of both axes: the smallest turn there is.

    Deviation, for CENTER_OF_MASS: afterwards the robot is moved back to its center of mass. The
    correction is inside the robot, and so moves it nowhere.
    """
    if rule == NONE:
        return
    moment_x = moment_y = moment_z = mass_sum = 0.0
    for i in range(len(q)):
        x, y, z = q[i, 0], q[i, 1], q[i, 2]
        if i > 0:
            square_axes(q, i - 1)
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


@inlined
def axis_x(q, i):
    """Return e_x of link i in I."""
    e0, e1, e2, e3 = q[i, 3], q[i, 4], q[i, 5], q[i, 6]
    return (
        e0 * e0 + e1 * e1 - e2 * e2 - e3 * e3,
        2.0 * (e1 * e2 + e0 * e3),
        2.0 * (e1 * e3 - e0 * e2),
    )


@inlined
def axis_y(q, i):
    """Return e_y of link i in I."""
    e0, e1, e2, e3 = q[i, 3], q[i, 4], q[i, 5], q[i, 6]
    return (
        2.0 * (e1 * e2 - e0 * e3),
        e0 * e0 - e1 * e1 + e2 * e2 - e3 * e3,
        2.0 * (e2 * e3 + e0 * e1),
    )


@inlined
def joint_twist(q, j):
    """Return e_y of link j times e_x of link j+1: g_Jphi, eq. (13)."""
    a, b = axis_y(q, j), axis_x(q, j + 1)
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@merged
def square_axes(q, j):
    """
    Turn link j+1 until its e_x is at right angles to e_y of link j.

    About their common normal n = e_y x e_x that is the angle with the sine g_Jphi and the cosine
    abs(n): half of it is found without angles.
    """
    a, b = axis_y(q, j), axis_x(q, j + 1)
    x, y, z = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    sine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    cosine = math.sqrt(x * x + y * y + z * z)
    c = math.sqrt(0.5 * (1.0 + cosine))
    s = sine / (2.0 * c * cosine)
    x, y, z = s * x, s * y, s * z
    i = j + 1
    e0, e1, e2, e3 = q[i, 3], q[i, 4], q[i, 5], q[i, 6]
    q[i, 3], q[i, 4], q[i, 5], q[i, 6] = (
        c * e0 - x * e1 - y * e2 - z * e3,
        c * e1 + x * e0 + y * e3 - z * e2,
        c * e2 + y * e0 + z * e1 - x * e3,
        c * e3 + z * e0 + x * e2 - y * e1,
    )


@merged
def floor_penetration(offset, radius, q):
    """Return how deep the lowest contact sphere is below the floor [m], 0 if it is not."""
    lowest = 0.0
    for i in range(len(q)):
        lowest = min(lowest, q[i, 2] - offset[i] * abs(axis_z(q, i)[2]) - radius[i])
    return -lowest


@merged
def lies_flat_and_still(offset, radius, q, u, omega):
    """Return whether every link is on the floor, not rolled, and moves in the plane only."""
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

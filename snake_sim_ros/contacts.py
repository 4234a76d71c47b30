"""
Compiled contact mechanics of the paper's iteration: eqs. (9)-(37), (76) and (87)-(93).

Contacts a are numbered as in eq. (10), fronts first; `contact` lists the closed ones. The impulse
of a contact is (normal, sliding along and across the link, rolling along x and y of I). Every
function fills the arrays named in its first line.
"""

import math

from snake_sim_ros.articulated_body import articulated_velocity
from snake_sim_ros.compilation import compiled
from snake_sim_ros.contact_laws import prox_disc
from snake_sim_ros.contact_laws import prox_ellipse
from snake_sim_ros.contact_laws import prox_half_line


@compiled
def closed_contacts(offset, radius, height, R, center, contact, point, heading):
    """
    Fill closed contacts, contact points from O and contact frames; return how many are closed.

    Deviation: a vertical link has no heading; e_x^I stands in for it, as in `reference.py`.
    """
    n = len(R)
    count = 0
    for i in range(n):
        x, y, z = R[i, 0, 2], R[i, 1, 2], R[i, 2, 2]
        c = math.sqrt(x * x + y * y)
        if c > 1e-6:
            heading[i, 0], heading[i, 1] = x / c, y / c
        else:
            heading[i, 0], heading[i, 1] = 1.0, 0.0
        for a, signed in ((i, offset[i]), (n + i, -offset[i])):
            if height[i] + signed * z - radius[i] <= 0.0:
                contact[count] = a
                point[a, 0] = center[i, 0] + signed * x
                point[a, 1] = center[i, 1] + signed * y
                point[a, 2] = center[i, 2] + signed * z - radius[i]
                count += 1
    return count


@compiled
def contact_wrench(contact, point, heading, radius, impulse, wrench):
    """Fill the impulse wrench S of the contacts on every link, eq. (76)."""
    n = len(heading)
    wrench[:] = 0.0
    for a in contact:
        i = a if a < n else a - n
        cx, cy = heading[i, 0], heading[i, 1]
        x, y, z = point[a, 0], point[a, 1], point[a, 2]
        px = cx * impulse[a, 1] - cy * impulse[a, 2]
        py = cy * impulse[a, 1] + cx * impulse[a, 2]
        pz = impulse[a, 0]
        wrench[i, 0] += y * pz - z * py + radius[i] * impulse[a, 4]
        wrench[i, 1] += z * px - x * pz - radius[i] * impulse[a, 3]
        wrench[i, 2] += x * py - y * px
        wrench[i, 3] += px
        wrench[i, 4] += py
        wrench[i, 5] += pz


@compiled
def contact_velocities(contact, point, heading, radius, twist, gamma):
    """Fill gamma (m, 5): relative velocities of the closed contacts, eqs. (90)-(92) [m/s]."""
    n = len(heading)
    for k, a in enumerate(contact):
        i = a if a < n else a - n
        cx, cy = heading[i, 0], heading[i, 1]
        x, y, z = point[a, 0], point[a, 1], point[a, 2]
        wx, wy, wz = twist[i, 0], twist[i, 1], twist[i, 2]
        vx = twist[i, 3] + wy * z - wz * y
        vy = twist[i, 4] + wz * x - wx * z
        gamma[k, 0] = twist[i, 5] + wx * y - wy * x
        gamma[k, 1] = cx * vx + cy * vy
        gamma[k, 2] = cx * vy - cy * vx
        gamma[k, 3] = -radius[i] * wy
        gamma[k, 4] = radius[i] * wx


@compiled
def prox_sweep(contact, gamma, friction, prox_parameter, impulse, previous):
    """
    Project the impulse of every closed contact once, eqs. (87)-(89).

    The one before is kept in previous. The sliding and rolling sets take the new normal impulse.

    Returns
    -------
    change : float
        Left side of the stopping rule (93) [N s].
    residual : float
        Largest change of one impulse over its prox parameter [m/s].

    """
    r_N, r_T, r_V = prox_parameter[0], prox_parameter[1], prox_parameter[2]
    mu_x, mu_y, mu_V = friction[0], friction[1], friction[2]
    normal = sliding = rolling = residual = 0.0
    for k, a in enumerate(contact):
        for j in range(5):
            previous[a, j] = impulse[a, j]
        P_N = prox_half_line(impulse[a, 0] - r_N * gamma[k, 0])
        P_x, P_y = prox_ellipse(
            impulse[a, 1] - r_T * gamma[k, 1],
            impulse[a, 2] - r_T * gamma[k, 2],
            mu_x * P_N,
            mu_y * P_N,
        )
        d_N, d_x, d_y = P_N - impulse[a, 0], P_x - impulse[a, 1], P_y - impulse[a, 2]
        normal += d_N * d_N
        sliding += d_x * d_x + d_y * d_y
        residual = max(residual, abs(d_N) / r_N, abs(d_x) / r_T, abs(d_y) / r_T)
        impulse[a, 0], impulse[a, 1], impulse[a, 2] = P_N, P_x, P_y
        if mu_V > 0.0:
            P_x, P_y = prox_disc(
                impulse[a, 3] - r_V * gamma[k, 3], impulse[a, 4] - r_V * gamma[k, 4], mu_V * P_N
            )
            d_x, d_y = P_x - impulse[a, 3], P_y - impulse[a, 4]
            rolling += d_x * d_x + d_y * d_y
            residual = max(residual, abs(d_x) / r_V, abs(d_y) / r_V)
            impulse[a, 3], impulse[a, 4] = P_x, P_y
        else:
            rolling += impulse[a, 3] * impulse[a, 3] + impulse[a, 4] * impulse[a, 4]
            impulse[a, 3] = impulse[a, 4] = 0.0
    return math.sqrt(normal) + math.sqrt(sliding) + math.sqrt(rolling), residual


@compiled
def condense(contact, width, chain, geometry, scratch, unit, gamma, delassus):
    """
    Fill the Delassus operator of the closed contacts with the joints eliminated, G of section 7.3.

    Row and column ``width k + j`` belong to component j of the k-th closed contact. One solve of
    the chain without momentum gives one row.

    Parameters
    ----------
    contact : ndarray, shape (m,)
    width : int
        Components of a contact in use: 3, or 5 with rolling friction.
    chain, geometry, scratch : tuple
        Arguments of `articulated_velocity` and of `contact_wrench`, and what they fill.
    unit : ndarray, shape (2n, 5)
        Zero on entry and on return.
    delassus : ndarray, shape (>= width m, >= width m)

    """
    axis, gain, compliance, root_inverse = chain
    point, heading, radius = geometry
    no_torque, no_momentum, wrench, load, twist = scratch
    for k, a in enumerate(contact):
        for j in range(width):
            unit[a, j] = 1.0
            contact_wrench(contact, point, heading, radius, unit, wrench)
            unit[a, j] = 0.0
            articulated_velocity(
                axis, gain, compliance, root_inverse, no_torque, no_momentum, wrench, load, twist
            )
            contact_velocities(contact, point, heading, radius, twist, gamma)
            for other in range(len(contact)):
                for i in range(width):
                    delassus[width * k + j, width * other + i] = gamma[other, i]


@compiled
def condensed_velocities(contact, width, delassus, free, impulse, packed, gamma):
    """Fill gamma with ``G P + gamma_free``: eqs. (84)-(92) without the links between."""
    rows = width * len(contact)
    for k in range(len(contact)):
        for j in range(width):
            packed[width * k + j] = free[k, j]
    for k, a in enumerate(contact):
        for j in range(width):
            P = impulse[a, j]
            column = delassus[width * k + j]  # G is symmetric
            for row in range(rows):
                packed[row] += column[row] * P
    for k in range(len(contact)):
        for j in range(width):
            gamma[k, j] = packed[width * k + j]

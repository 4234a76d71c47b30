# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""How linear contact laws join the inertia of the links that they act on."""

from snake_sim_ros.contact.directions import direction
from snake_sim_ros.contact.table import ROLLING, SLIDING
from snake_sim_ros.dynamics.compilation import compiled, inlined, merged


@inlined
def add_laws(closed, contacts, frame, rolling, wrench, inertia):
    """
    Add the linear laws to the wrenches and to the inertias of the links.

    Parameters
    ----------
    closed : ndarray of int, shape (k,)
        Numbers of the contacts, none of two links.
    contacts : record array, shape (contacts,)
        Table of contacts with linear laws.
    frame : ndarray, shape (contacts, 3, 3), or None
        Contact frames in I; None on a flat floor.
    rolling : bool
        Whether there is rolling friction.
    wrench : ndarray, shape (n, 6)
        Moment about O [N m s] and impulse [N s] of every link, in axes of I; added to.
    inertia : ndarray, shape (n, 6, 6)
        Inertia of every link about O, in axes of I; added to.

    """
    if frame is not None:
        add_laws_in_frames(closed, contacts, frame, rolling, wrench, inertia)
        return
    n = len(wrench)
    for a in closed:
        i = a if a < n else a - n
        add_point_law(contacts, a, wrench, inertia, i)
        if rolling:
            add_rolling_law(contacts, a, wrench, inertia, i)


@merged
def add_point_law(contacts, a, wrench, inertia, i):
    """
    Add the impulse ``P_0 - S gamma`` of contact a, normal and sliding, to link i.

    In axes of I it is ``force - K v``, where ``v = v_O + omega x p`` is the velocity of the
    contact point and K = [[xx, xy, xz], [xy, yy, yz], [0, 0, zz]]. About O this is A += J^T K J
    with J = [-p~, 1].
    """
    cx, cy = contacts.heading[a, 0], contacts.heading[a, 1]
    x, y, z = contacts.point[a, 0], contacts.point[a, 1], contacts.point[a, 2]
    S_xN, S_yN, shift = contacts.S_xN[a, SLIDING], contacts.S_yN[a, SLIDING], contacts.shift[a]
    P_x, P_y = contacts.P_0[a, 1] - S_xN * shift, contacts.P_0[a, 2] - S_yN * shift
    fz = contacts.P_0[a, 0] - contacts.S_N[a] * shift
    fx, fy = cx * P_x - cy * P_y, cy * P_x + cx * P_y
    wrench[i, 0] += y * fz - z * fy
    wrench[i, 1] += z * fx - x * fz
    wrench[i, 2] += x * fy - y * fx
    wrench[i, 3] += fx
    wrench[i, 4] += fy
    wrench[i, 5] += fz
    S_xx, S_xy, S_yy = (
        contacts.S_xx[a, SLIDING],
        contacts.S_xy[a, SLIDING],
        contacts.S_yy[a, SLIDING],
    )
    xx = cx * cx * S_xx - 2.0 * cx * cy * S_xy + cy * cy * S_yy
    xy = cx * cy * (S_xx - S_yy) + (cx * cx - cy * cy) * S_xy
    yy = cy * cy * S_xx + 2.0 * cx * cy * S_xy + cx * cx * S_yy
    xz, yz, zz = cx * S_xN - cy * S_yN, cy * S_xN + cx * S_yN, contacts.S_N[a]
    rows = (
        (-z * xy, -z * yy, y * zz - z * yz),  # p~ K
        (z * xx, z * xy, z * xz - x * zz),
        (x * xy - y * xx, x * yy - y * xy, x * yz - y * xz),
        (xx, xy, xz),  # K
        (xy, yy, yz),
        (0.0, 0.0, zz),
    )
    for k in range(6):  # (p x r, r) is a row of J^T K J
        a_x, a_y, a_z = rows[k]
        inertia[i, k, 0] += y * a_z - z * a_y
        inertia[i, k, 1] += z * a_x - x * a_z
        inertia[i, k, 2] += x * a_y - y * a_x
        inertia[i, k, 3] += a_x
        inertia[i, k, 4] += a_y
        inertia[i, k, 5] += a_z


@merged
def add_rolling_law(contacts, a, wrench, inertia, i):
    """Add the rolling torque r (P_v, -P_u) of contact a to link i, eqs. (36), (37)."""
    x, y, r = contacts.point[a, 0], contacts.point[a, 1], contacts.radius[a]
    wrench[i, 0] += r * (contacts.P_0[a, 4] - contacts.S_yN[a, ROLLING] * contacts.shift[a])
    wrench[i, 1] -= r * (contacts.P_0[a, 3] - contacts.S_xN[a, ROLLING] * contacts.shift[a])
    S_xx, S_xy, S_yy = (
        contacts.S_xx[a, ROLLING],
        contacts.S_xy[a, ROLLING],
        contacts.S_yy[a, ROLLING],
    )
    S_xN, S_yN = contacts.S_xN[a, ROLLING], contacts.S_yN[a, ROLLING]
    inertia[i, 0, 0] += r * r * S_yy + r * S_yN * y
    inertia[i, 0, 1] -= r * r * S_xy + r * S_yN * x
    inertia[i, 0, 5] += r * S_yN
    inertia[i, 1, 0] -= r * r * S_xy + r * S_xN * y
    inertia[i, 1, 1] += r * r * S_xx + r * S_xN * x
    inertia[i, 1, 5] -= r * S_xN


@compiled
def add_laws_in_frames(closed, contacts, frame, rolling, wrench, inertia):
    """
    Do what `add_laws` does, for contacts that have frames: wrench += W P_0, A += W S W^T.

    W holds the directions (normal, sliding; rolling). Friction follows the normal velocity, to
    which the normal direction belongs.
    """
    for a in closed:
        A, w = inertia[contacts.link[a]], wrench[contacts.link[a]]
        point = contacts.point
        normal = direction(point, frame, a, 0)
        along, across = direction(point, frame, a, 1), direction(point, frame, a, 2)
        S_N, shift = contacts.S_N[a], contacts.shift[a]
        for k in range(6):
            w[k] += (contacts.P_0[a, 0] - S_N * shift) * normal[k]
            for j in range(6):
                A[k, j] += S_N * normal[k] * normal[j]
        add_friction_law(contacts, a, SLIDING, normal, along, across, w, A)
        if rolling:
            r = contacts.radius[a]
            turn = -r * frame[a, 2, 0], -r * frame[a, 2, 1], -r * frame[a, 2, 2], 0.0, 0.0, 0.0
            roll = r * frame[a, 1, 0], r * frame[a, 1, 1], r * frame[a, 1, 2], 0.0, 0.0, 0.0
            add_friction_law(contacts, a, ROLLING, normal, turn, roll, w, A)


@inlined
def add_friction_law(contacts, a, kind, normal, along, across, wrench, inertia):
    """
    Add the law of one kind of friction at contact a to its link.

    Parameters
    ----------
    contacts : record array, shape (contacts,)
        Table of contacts with linear laws.
    a : int
        Number of the contact.
    kind : int
        SLIDING or ROLLING.
    normal, along, across : tuple of 6 float
        Wrench of a unit normal impulse, and those of unit impulses along both axes.
    wrench : ndarray, shape (6,)
        Wrench of the link about O; added to.
    inertia : ndarray, shape (6, 6)
        Inertia of the link about O; added to.

    """
    k, shift = 1 + 2 * kind, contacts.shift[a]
    S_xx, S_xy, S_yy = contacts.S_xx[a, kind], contacts.S_xy[a, kind], contacts.S_yy[a, kind]
    S_xN, S_yN = contacts.S_xN[a, kind], contacts.S_yN[a, kind]
    P_x, P_y = contacts.P_0[a, k] - S_xN * shift, contacts.P_0[a, k + 1] - S_yN * shift
    for i in range(6):
        wrench[i] += P_x * along[i] + P_y * across[i]
        for j in range(6):
            x = S_xN * normal[j] + S_xx * along[j] + S_xy * across[j]
            y = S_yN * normal[j] + S_xy * along[j] + S_yy * across[j]
            inertia[i, j] += along[i] * x + across[i] * y

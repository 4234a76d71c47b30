# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The Delassus operator: how contact velocities follow from contact impulses, joints eliminated.

``gamma = G P + gamma_free + shift``, section VII. The operator is dense, with a row and a column
for every component of a closed contact.

`condense` forms it from loads of unit impulses in the chain without contacts: the unit wrenches of
a contact go to the root of the chain together, and leave loads on the way. These are rows X, and
``G = X X^T``; see `free_chain`. Two contacts share the loads of the root, and on one arm those of
the joints that both have to pass. G is symmetric to the last bit.

`closed`, `contacts` and `chain` are those of a `problem.Problem`. The number of components of a
contact is `width`: 3, or 5 with rolling friction. `solution.shift` is in none of the arrays here,
so that it may change while they serve.
"""

import math
from typing import NamedTuple

import numpy as np

from snake_sim_ros.contact.contacts import Contacts, stiffness
from snake_sim_ros.contact.directions import add_contact_wrench, contact_velocities
from snake_sim_ros.dynamics.articulated_body import Chain, FreeChain, solve_chain
from snake_sim_ros.dynamics.compilation import compiled, four, inlined, Packs, pair
from snake_sim_ros.dynamics.free_chain import (
    factor_free,
    fold_wrench,
    joint_column,
    root_load,
    unfold_free,
)
from snake_sim_ros.dynamics.spatial_vectors import add, scaled
from snake_sim_ros.scene.parameters import Array


class Delassus(NamedTuple):
    """Arrays for c rows; component j of contact a has the row ``contacts.newton.row[a] + j``."""

    operator: Array  # (c, c) G [1/kg]
    system: Array  # (c, c+1) matrix [1] and right side [N s] of a linear system
    free_velocity: Array  # (c,) relative velocities without contact impulses and shifts [m/s]
    packed: Array  # (c,) velocities [m/s] or impulses [N s] of the closed contacts
    loads: Array  # (c, 2n+4) loads X of unit impulses in a chain of n links [kg^-1/2]
    depth: Array  # (c, 2) joints of both arms that a contact loads, in its first row


def make_delassus(rows: int, links: int) -> Delassus:
    """Return the arrays for a number of rows and of links."""
    return Delassus(
        operator=np.zeros((rows, rows)),
        system=np.zeros((rows, rows + 1)),
        free_velocity=np.zeros(rows + 1),  # filled in pairs
        packed=np.zeros(rows),
        loads=np.zeros((rows + 1, 2 * links + 4)),
        depth=np.zeros((rows, 2), np.int64),
    )


@inlined
def fill_wrenches(closed: Array, contacts: Contacts, chain: Chain) -> None:
    """
    Fill the wrenches of the links with momentum and contact impulses S, eqs. (75), (76).

    `chain.wrench` is filled from `chain.momentum` and the impulses of the closed contacts.
    """
    for i in range(len(chain.wrench)):
        for k in range(6):
            chain.wrench[i, k] = chain.momentum[i, k]
    add_contact_wrench(closed, contacts, chain.frame, chain.wrench)


@inlined
def end_twists(closed: Array, contacts: Contacts, chain: Chain) -> None:
    """
    Fill the twists and relative velocities that the impulses lead to, (84), (86), (90)-(92).

    The chain is a factored one. Its twists are filled, and gamma of the closed contacts.
    """
    fill_wrenches(closed, contacts, chain)
    solve_chain(chain, chain.torque)
    contact_velocities(closed, contacts, chain.frame, chain.twist)


@inlined
def condensed_twists(
    closed: Array, width: int, contacts: Contacts, chain: Chain, delassus: Delassus
) -> None:
    """Fill the twists of all links that momentum, torques and contact impulses lead to."""
    X, load, depth = delassus.loads, chain.free.end_load, delassus.depth
    middle = 6 + 2 * ((len(chain.axis) + 1) // 2)
    for m in range(len(load)):
        load[m] = chain.free.load[m]
    for a in closed:
        row, P = contacts.newton.row[a], contacts.solution.impulse[a]
        end, last = 6 + 2 * depth[row, 0], middle + 2 * depth[row, 1]
        if P[0] != 0.0 or P[1] != 0.0 or P[2] != 0.0:
            for m in range(end):
                load[m] += X[row, m] * P[0] + X[row + 1, m] * P[1] + X[row + 2, m] * P[2]
            for m in range(middle, last):
                load[m] += X[row, m] * P[0] + X[row + 1, m] * P[1] + X[row + 2, m] * P[2]
        if width > 3:
            for m in range(end):
                load[m] += X[row + 3, m] * P[3] + X[row + 4, m] * P[4]
            for m in range(middle, last):
                load[m] += X[row + 3, m] * P[3] + X[row + 4, m] * P[4]
    unfold_free(chain.free, load, chain.twist)


@inlined
def fill_free_velocities(
    closed: Array, width: int, contacts: Contacts, delassus: Delassus
) -> None:
    """Fill delassus.packed with ``gamma_free + shift``."""
    for a in closed:
        row = contacts.newton.row[a]
        for i in range(width):
            delassus.packed[row + i] = delassus.free_velocity[row + i]
        delassus.packed[row] += contacts.solution.shift[a]


@inlined
def condensed_velocities(
    closed: Array, width: int, contacts: Contacts, delassus: Delassus
) -> None:
    """
    Fill the relative velocities with ``G P + gamma_free + shift``.

    ``delassus.packed`` is filled with the velocities, too.
    """
    solution, newton = contacts.solution, contacts.newton
    fill_free_velocities(closed, width, contacts, delassus)
    for a in closed:
        for j in range(width):
            add_response(
                solution.impulse[a, j], newton.row[a] + j, closed, width, contacts, delassus
            )
    for a in closed:
        for j in range(width):
            solution.gamma[a, j] = delassus.packed[newton.row[a] + j]


@inlined
def add_response(
    P: float, column: int, closed: Array, width: int, contacts: Contacts, delassus: Delassus
) -> None:
    """Add the velocities that an impulse P [N s] causes to delassus.packed; G is symmetric."""
    if P != 0.0:
        for a in closed:
            row = contacts.newton.row[a]
            for i in range(width):
                delassus.packed[row + i] += delassus.operator[column, row + i] * P


@inlined
def condensed_system(closed: Array, width: int, contacts: Contacts, delassus: Delassus) -> None:
    """Fill ``delassus.system`` with the matrix 1 + S G, and S gamma_free beside it."""
    newton = contacts.newton
    rows = width * len(closed)
    B = delassus.system
    for column in range(rows + 1):
        g = delassus.free_velocity if column == rows else delassus.operator[column]
        for k, a in enumerate(closed):
            row = width * k
            g_N = g[row]
            B[row, column] = newton.S_N[a] * g_N
            for j in range(1, width, 2):
                kind = j // 2
                g_x, g_y = g[row + j], g[row + j + 1]
                S_xx, S_xy, S_yy, S_xN, S_yN = stiffness(contacts, a, kind)
                B[row + j, column] = S_xN * g_N + S_xx * g_x + S_xy * g_y
                B[row + j + 1, column] = S_yN * g_N + S_xy * g_x + S_yy * g_y
    for row in range(rows):
        B[row, row] += 1.0


@inlined
def eliminate(B: Array, rows: int) -> float:
    """
    Replace column `rows` of B by the solution x of ``B[:, :rows] x = B[:, rows]``.

    Returns
    -------
    float
        The sign of the determinant, 1 or -1.

    """
    sign = 1.0
    for k in range(rows):
        pivot = k
        for i in range(k + 1, rows):
            if abs(B[i, k]) > abs(B[pivot, k]):
                pivot = i
        if pivot != k:
            sign = -sign
            for j in range(k, rows + 1):
                B[k, j], B[pivot, j] = B[pivot, j], B[k, j]
        sign = math.copysign(sign, sign * B[k, k])
        for i in range(k + 1, rows):
            share = B[i, k] / B[k, k]
            if share != 0.0:
                for j in range(k + 1, rows + 1):
                    B[i, j] -= share * B[k, j]
    for k in range(rows - 1, -1, -1):
        for j in range(k + 1, rows):
            B[k, rows] -= B[k, j] * B[j, rows]
        B[k, rows] /= B[k, k]
    return sign


@inlined
def condense(
    closed: Array, width: int, contacts: Contacts, chain: Chain, delassus: Delassus
) -> None:
    """
    Factor the chain without contacts, and fill the Delassus operator and the free velocities.

    The rows of the contacts are numbered in the order of `closed`.
    """
    factor_free(chain)
    G, X, depth = delassus.operator, delassus.loads, delassus.depth
    joints = len(chain.axis)
    middle = 6 + 2 * ((joints + 1) // 2)
    for k, a in enumerate(closed):
        row = width * k
        contacts.newton.row[a] = row
        fill_loads(contacts, a, width, chain, X, depth[row])
        end, last = 6 + 2 * depth[row, 0], middle + 2 * depth[row, 1]
        for j in range(0, width, 2):
            columns = Columns(end, middle, last)
            fill_velocities(delassus.free_velocity, X, chain.free.load, row + j, columns)
        for other in range(0, row + 1, width):
            end = 6 + 2 * min(depth[row, 0], depth[other, 0])
            last = middle + 2 * min(depth[row, 1], depth[other, 1])
            columns = Columns(end, middle, last)
            fill_block(G, X, row, other, columns)
            for j in range(3, width):
                for i in range(width):
                    fill_entry(G, X, row + j, other + i, columns)
                    fill_entry(G, X, row + i, other + j, columns)


class Columns(NamedTuple):
    """Where loads may be other than 0: in X[:, :end] and X[:, middle:last]."""

    end: int  # end of the first arm, with the root
    middle: int  # begin of the second arm
    last: int  # end of the second arm


@inlined
def fill_block(G: Array, X: Array, row: int, other: int, columns: Columns) -> None:
    """
    Fill the entries of G for normal and sliding components of two contacts.

    Parameters
    ----------
    G : ndarray, shape (c, c)
    X : ndarray, shape (c, 2n+4)
        Loads of unit impulses.
    row, other : int
        First rows of the contacts.
    columns : Columns
        Those of both contacts.

    """
    o = four(0.0, 0.0, 0.0, 0.0)
    x, y, z = o, o, o
    for m in range(columns.end):
        loads = four(X[other, m], X[other + 1, m], X[other + 2, m], 0.0)
        x = x + X[row, m] * loads
        y = y + X[row + 1, m] * loads
        z = z + X[row + 2, m] * loads
    for m in range(columns.middle, columns.last):
        loads = four(X[other, m], X[other + 1, m], X[other + 2, m], 0.0)
        x = x + X[row, m] * loads
        y = y + X[row + 1, m] * loads
        z = z + X[row + 2, m] * loads
    G[row, other], G[row, other + 1], G[row, other + 2] = x[0], x[1], x[2]
    G[row + 1, other], G[row + 1, other + 1], G[row + 1, other + 2] = y[0], y[1], y[2]
    G[row + 2, other], G[row + 2, other + 1], G[row + 2, other + 2] = z[0], z[1], z[2]
    G[other, row], G[other + 1, row], G[other + 2, row] = x[0], x[1], x[2]
    G[other, row + 1], G[other + 1, row + 1], G[other + 2, row + 1] = y[0], y[1], y[2]
    G[other, row + 2], G[other + 1, row + 2], G[other + 2, row + 2] = z[0], z[1], z[2]


@inlined
def fill_velocities(velocity: Array, X: Array, load: Array, row: int, columns: Columns) -> None:
    """Fill the velocities of two components of a contact that loads cause; see `fill_block`."""
    both = pair(0.0, 0.0)
    for m in range(columns.end):
        both = both + load[m] * pair(X[row, m], X[row + 1, m])
    for m in range(columns.middle, columns.last):
        both = both + load[m] * pair(X[row, m], X[row + 1, m])
    velocity[row], velocity[row + 1] = both[0], both[1]


@compiled
def fill_entry(G: Array, X: Array, i: int, j: int, columns: Columns) -> None:
    """Fill an entry of G and its mirror image; see `fill_block`."""
    entry = 0.0
    for m in range(columns.end):
        entry += X[i, m] * X[j, m]
    for m in range(columns.middle, columns.last):
        entry += X[i, m] * X[j, m]
    G[i, j] = G[j, i] = entry


@inlined
def fill_loads(
    contacts: Contacts, a: int, width: int, chain: Chain, X: Array, depth: Array
) -> None:
    """
    Fill the loads of unit impulses at contact a, and how many joints of both arms they pass.

    Parameters
    ----------
    contacts : Contacts
    a, width : int
        Number of the contact, and of its components.
    chain : Chain
        Factored by `factor_free`.
    X : ndarray, shape (c, 2n+4)
        Filled in the columns of the contact.
    depth : ndarray of int, shape (2,)
        Filled.

    """
    geometry, newton = contacts.geometry, contacts.newton
    n, row = len(chain.twist), newton.row[a]
    root = n // 2
    i, other = link_and_other(chain.frame, contacts, a)
    force, turn = unit_wrenches(geometry.point, contacts, chain.frame, a)
    depth[0], depth[1] = max(0, root - i), max(0, i - root)
    # Variables, because Numba would compile `carry_to_root` once for each literal.
    count, adds = min(width, 3), other >= 0
    if adds:
        depth[0], depth[1] = max(depth[0], root - other), max(depth[1], other - root)
        X[row : row + width] = 0.0
        minus, _ = unit_wrenches(geometry.other_point, contacts, chain.frame, a)
        minus = scaled(-1.0, minus)
        minus = carry_to_root(chain.free, other, minus, X, (row, count), adds)
        force = add(minus, carry_to_root(chain.free, i, force, X, (row, count), adds))
    else:
        force = carry_to_root(chain.free, i, force, X, (row, count), adds)
    load = root_load(chain.free.root, force)
    for m in range(6):
        X[row, m], X[row + 1, m], X[row + 2, m] = load[m][0], load[m][1], load[m][2]
    if width > 3:
        turn = carry_to_root(chain.free, i, turn, X, (row + 3, width - 3), adds)
        load = root_load(chain.free.root, turn)
        for m in range(6):
            X[row + 3, m], X[row + 4, m] = load[m][0], load[m][1]


@inlined
def link_and_other(frame: Array | None, contacts: Contacts, a: int) -> tuple[int, int]:
    """Return the link of contact a, and the one that it touches or -1."""
    if frame is None:
        return contacts.geometry.link[a], -1
    return contacts.geometry.link[a], contacts.geometry.other_link[a]


@inlined
def unit_wrenches(
    point: Array, contacts: Contacts, frame: Array | None, a: int
) -> tuple[Packs, Packs]:
    """
    Return the wrenches of unit impulses at contact a.

    Parameters
    ----------
    point : ndarray, shape (contacts, 3)
        Contact points of one link, from O in axes of I [m].
    contacts : Contacts
    frame : ndarray, shape (contacts, 3, 3), or None
        Contact frames in I; None on a flat floor.
    a : int
        Number of the contact.

    Returns
    -------
    force : tuple of 6 `four`
        Those of the normal and of both sliding components.
    turn : tuple of 6 `four`
        Those of both rolling components.

    """
    geometry = contacts.geometry
    p, r, o = point[a], geometry.radius[a], four(0.0, 0.0, 0.0, 0.0)
    if frame is None:
        c, s = geometry.heading[a, 0], geometry.heading[a, 1]
        x, y, z = four(0.0, c, -s, 0.0), four(0.0, s, c, 0.0), four(1.0, 0.0, 0.0, 0.0)
        turn = four(0.0, r, 0.0, 0.0), four(-r, 0.0, 0.0, 0.0), o, o, o, o
    else:
        e = frame[a]
        x = four(e[0, 0], e[1, 0], e[2, 0], 0.0)
        y = four(e[0, 1], e[1, 1], e[2, 1], 0.0)
        z = four(e[0, 2], e[1, 2], e[2, 2], 0.0)
        turn = (
            four(-r * e[2, 0], r * e[1, 0], 0.0, 0.0),
            four(-r * e[2, 1], r * e[1, 1], 0.0, 0.0),
            four(-r * e[2, 2], r * e[1, 2], 0.0, 0.0),
            o, o, o,
        )  # fmt: skip
    return (p[1] * z - p[2] * y, p[2] * x - p[0] * z, p[0] * y - p[1] * x, x, y, z), turn


@inlined
def carry_to_root(
    free: FreeChain, i: int, w: Packs, X: Array, rows: tuple[int, int], adds: bool
) -> Packs:
    """
    Return what the root feels of wrenches on link i; fill their loads on the way.

    Parameters
    ----------
    free : FreeChain
    i : int
        Number of the link.
    w : tuple of 6 `four`
        Wrenches.
    X : ndarray, shape (c, 2n+4)
        Loads.
    rows : tuple of int
        Row of X for the first wrench, and number of wrenches: 2 or 3.
    adds : bool
        Whether loads are added to those in X.

    """
    n, (row, count) = len(free.axis) + 1, rows
    root = n // 2
    while i != root:
        j = i if i < root else i - 1
        load0, load1, w = fold_wrench(free.axis[j], free.reach[j], w)
        m = joint_column(n, j)
        if adds:
            load0 = load0 + four(X[row, m], X[row + 1, m], X[row + count - 1, m], 0.0)
            load1 = load1 + four(X[row, m + 1], X[row + 1, m + 1], X[row + count - 1, m + 1], 0.0)
        X[row, m], X[row + 1, m] = load0[0], load0[1]
        X[row, m + 1], X[row + 1, m + 1] = load1[0], load1[1]
        if count > 2:
            X[row + 2, m], X[row + 2, m + 1] = load0[2], load1[2]
        i += 1 if i < root else -1
    return w

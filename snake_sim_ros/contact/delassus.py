# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The Delassus operator: how contact velocities follow from contact impulses, joints eliminated.

``gamma = G P + gamma_free + shift``, section VII. The operator is dense, with a row and a column
for every component of a closed contact. `condensing.condense` forms it.

`closed`, `contacts` and `chain` are those of a `solver.Problem`. The number of components of a
contact is `width`: 3, or 5 with rolling friction. `contacts.shift` is in none of the arrays here,
so that it may change while they serve.
"""

import math
from typing import NamedTuple

import numpy as np

from snake_sim_ros.contact.directions import add_contact_wrench, contact_velocities
from snake_sim_ros.dynamics.articulated_body import solve_chain
from snake_sim_ros.dynamics.compilation import compiled, inlined, merged
from snake_sim_ros.dynamics.free_chain import unfold_free
from snake_sim_ros.scene.parameters import Array


class Delassus(NamedTuple):
    """Arrays for c rows; component j of contact a has the row ``contacts.row[a] + j``."""

    operator: Array  # (c, c) G [1/kg]
    system: Array  # (c, c+1) matrix and right side of a linear system
    free_velocity: Array  # (c,) relative velocities without contact impulses and shifts [m/s]
    packed: Array  # (c,) velocities [m/s] or impulses [N s] of the closed contacts
    loads: Array  # (c, 2n+4) loads X of unit impulses in a chain of n links
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
def fill_wrenches(closed, contacts, chain):
    """
    Fill the wrenches of the links with momentum and contact impulses S, eqs. (75), (76).

    `chain.wrench` is filled from `chain.momentum` and the impulses of the closed contacts.
    """
    for i in range(len(chain.wrench)):
        for k in range(6):
            chain.wrench[i, k] = chain.momentum[i, k]
    add_contact_wrench(closed, contacts, chain.frame, chain.wrench)


@compiled
def end_twists(closed, contacts, chain):
    """
    Fill the twists and relative velocities that the impulses lead to, (84), (86), (90)-(92).

    The chain is a factored one. Its twists are filled, and gamma of the closed contacts.
    """
    fill_wrenches(closed, contacts, chain)
    solve_chain(chain, chain.torque)
    contact_velocities(closed, contacts, chain.frame, chain.twist)


@inlined
def condensed_twists(closed, width, contacts, chain, delassus):
    """Fill the twists of all links that momentum, torques and contact impulses lead to."""
    X, load, depth = delassus.loads, chain.free.end_load, delassus.depth
    middle = 6 + 2 * ((len(chain.axis) + 1) // 2)
    for m in range(len(load)):
        load[m] = chain.free.load[m]
    for a in closed:
        row, P = contacts.row[a], contacts.impulse[a]
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
def fill_free_velocities(closed, width, contacts, delassus):
    """Fill delassus.packed with ``gamma_free + shift``."""
    for a in closed:
        row = contacts.row[a]
        for i in range(width):
            delassus.packed[row + i] = delassus.free_velocity[row + i]
        delassus.packed[row] += contacts.shift[a]


@inlined
def condensed_velocities(closed, width, contacts, delassus):
    """
    Fill the relative velocities with ``G P + gamma_free + shift``.

    ``delassus.packed`` is filled with the velocities, too.
    """
    G, packed = delassus.operator, delassus.packed
    fill_free_velocities(closed, width, contacts, delassus)
    for b in closed:
        for j in range(width):
            P = contacts.impulse[b, j]
            if P != 0.0:
                column = contacts.row[b] + j  # G is symmetric
                for a in closed:
                    row = contacts.row[a]
                    for i in range(width):
                        packed[row + i] += G[column, row + i] * P
    for a in closed:
        for j in range(width):
            contacts.gamma[a, j] = packed[contacts.row[a] + j]


@compiled
def solve_condensed(closed, width, contacts, delassus):
    """
    Fill impulses and velocities with the solution of ``P = P_0 - S (G P + gamma_free)``.

    G and gamma_free are those that `condense` filled, P_0 and S the linear laws of the contacts.

    Returns
    -------
    bool
        Whether the solution is finite.

    """
    rows = width * len(closed)
    B = delassus.system
    condensed_system(closed, width, contacts, delassus)
    for k, a in enumerate(closed):
        for j in range(width):
            row = width * k + j
            B[row, rows] = contacts.P_0[a, j] - B[row, rows]
    eliminate(B, rows)
    finite = 0.0
    for k, a in enumerate(closed):
        for j in range(width):
            contacts.impulse[a, j] = B[width * k + j, rows]
            finite += B[width * k + j, rows]
    condensed_velocities(closed, width, contacts, delassus)
    return math.isfinite(finite)


@merged
def condensed_system(closed, width, contacts, delassus):
    """Fill ``delassus.system`` with the matrix 1 + S G, and S gamma_free beside it."""
    rows = width * len(closed)
    B = delassus.system
    for column in range(rows + 1):
        g = delassus.free_velocity if column == rows else delassus.operator[column]
        for k, a in enumerate(closed):
            row = width * k
            g_N = g[row]
            B[row, column] = contacts.S_N[a] * g_N
            for j in range(1, width, 2):
                kind = j // 2
                g_x, g_y = g[row + j], g[row + j + 1]
                S_xx, S_xy, S_yy = (
                    contacts.S_xx[a, kind],
                    contacts.S_xy[a, kind],
                    contacts.S_yy[a, kind],
                )
                S_xN, S_yN = contacts.S_xN[a, kind], contacts.S_yN[a, kind]
                B[row + j, column] = S_xN * g_N + S_xx * g_x + S_xy * g_y
                B[row + j + 1, column] = S_yN * g_N + S_xy * g_x + S_yy * g_y
    for row in range(rows):
        B[row, row] += 1.0


@merged
def eliminate(B, rows):
    """Replace column `rows` of B by the solution x of ``B[:, :rows] x = B[:, rows]``."""
    for k in range(rows):
        pivot = k
        for i in range(k + 1, rows):
            if abs(B[i, k]) > abs(B[pivot, k]):
                pivot = i
        if pivot != k:
            for j in range(k, rows + 1):
                B[k, j], B[pivot, j] = B[pivot, j], B[k, j]
        for i in range(k + 1, rows):
            share = B[i, k] / B[k, k]
            if share != 0.0:
                for j in range(k + 1, rows + 1):
                    B[i, j] -= share * B[k, j]
    for k in range(rows - 1, -1, -1):
        for j in range(k + 1, rows):
            B[k, rows] -= B[k, j] * B[j, rows]
        B[k, rows] /= B[k, k]

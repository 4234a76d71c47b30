"""
The Delassus operator: how contact velocities follow from contact impulses, joints eliminated.

``gamma = G P + gamma_free``, section VII. The operator is dense, with a row and a column for every
component of a closed contact. Every column costs one solution of the chain; the solver that is
linear in the number of links works without the operator.

`closed`, `contacts` and `chain` are those of a `solver.Problem`. The number of components of a
contact is `width`: 3, or 5 with rolling friction.
"""

import math
from typing import NamedTuple

import numpy as np

from snake_sim_ros.contact.directions import add_contact_wrench
from snake_sim_ros.contact.directions import contact_velocities
from snake_sim_ros.dynamics.articulated_body import solve_chain
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.compilation import merged
from snake_sim_ros.scene.parameters import Array


class Delassus(NamedTuple):
    """Arrays for c rows; row and column ``width k + j`` are component j of the k-th contact."""

    operator: Array  # (c, c) G [1/kg]
    system: Array  # (c, c+1) matrix and right side of a linear system
    free_velocity: Array  # (c,) relative velocities without contact impulses [m/s]
    packed: Array  # (c,) velocities [m/s] or impulses [N s] of the closed contacts


def make_delassus(size: int) -> Delassus:
    """Return the arrays for a number of rows."""
    return Delassus(
        operator=np.zeros((size, size)),
        system=np.zeros((size, size + 1)),
        free_velocity=np.zeros(size),
        packed=np.zeros(size),
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


@compiled
def condense(closed, width, contacts, chain, delassus):
    """
    Fill the Delassus operator and the free velocities.

    The chain is a factored one. Its wrenches and twists are overwritten, and so are the impulses
    and velocities of the closed contacts.
    """
    for a in closed:
        contacts.impulse[a] = 0.0
    end_twists(closed, contacts, chain)
    for k, a in enumerate(closed):
        for j in range(width):
            delassus.free_velocity[width * k + j] = contacts.gamma[a, j]
    for k, a in enumerate(closed):
        for j in range(width):
            contacts.impulse[a, j] = 1.0
            chain.wrench[:] = 0.0
            add_contact_wrench(closed[k : k + 1], contacts, chain.frame, chain.wrench)
            contacts.impulse[a, j] = 0.0
            solve_chain(chain, chain.no_torque)
            contact_velocities(closed, contacts, chain.frame, chain.twist)
            for other, b in enumerate(closed):
                for i in range(width):
                    delassus.operator[width * k + j, width * other + i] = contacts.gamma[b, i]


@compiled
def condensed_velocities(closed, width, contacts, delassus):
    """
    Fill the relative velocities with ``G P + gamma_free``, as `condense` filled G and gamma_free.

    ``delassus.packed`` is filled with the velocities, too.
    """
    rows = width * len(closed)
    packed = delassus.packed
    for row in range(rows):
        packed[row] = delassus.free_velocity[row]
    for k, a in enumerate(closed):
        for j in range(width):
            P = contacts.impulse[a, j]
            for row in range(rows):
                packed[row] += delassus.operator[width * k + j, row] * P  # G is symmetric
    for k, a in enumerate(closed):
        for j in range(width):
            contacts.gamma[a, j] = packed[width * k + j]


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

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The contact problem with linear laws on the Delassus operator: a small dense system.

Every law leaves its impulse some freedom. A contact that pushes has its normal impulse, one that
sticks both sliding components, and one that slides a single one, since its impulse stays on the
edge of the disc: with the impulse on the edge, ``P_T = d P_N + t s``, where d points to the edge
and t along it. The unknowns z are the free components, at most five a contact. For each there is
an equation of velocities, ``z/S + r . gamma = ...``, with the stiffness S of the law and the
direction r that z has. Contacts that do not push are left out.

Impulses follow as ``P = c_1 z_1 + c_2 z_2 + ... + P_held``, where c is r, and for a normal
impulse also d of its friction. The matrix ``r_i . G c_j + 1/S_i`` is symmetric where no contact
slides. Its compliances 1/S are small, and G keeps all of its digits.
"""

import math
from typing import NamedTuple

import numpy as np

from snake_sim_ros.contact.delassus import condensed_velocities, fill_free_velocities
from snake_sim_ros.contact.laws import anchored_disc, grip, rolling_disc
from snake_sim_ros.contact.linear_laws import disc_law, normal_law
from snake_sim_ros.contact.table import FREE
from snake_sim_ros.dynamics.compilation import compiled, inlined, merged
from snake_sim_ros.scene.parameters import Array


class Reduced(NamedTuple):
    """Arrays for c unknowns: as many as the Delassus operator has rows."""

    system: Array  # (c+1, c) the matrix transposed, and below it the right side
    response: Array  # (c, c) velocities for a unit of every unknown [1/kg]
    impulse: Array  # (c,) impulses by rows of the operator, first those held [N s]
    row: Array  # (c,) row of the operator for the first component of r
    along: Array  # (c, 2) r, in this row and the next one
    is_normal: Array  # (c,) 1 if the unknown is a normal impulse
    follow: Array  # (c, 4) for a normal impulse d of sliding and rolling
    compliance: Array  # (c,) 1/S [1/kg]
    goal: Array  # (c,) right sides of the laws, z/S + r . gamma [m/s]


def make_reduced(rows: int) -> Reduced:
    """Return the arrays for a Delassus operator of so many rows."""
    zeros = np.zeros
    return Reduced(
        system=zeros((rows + 1, rows)),
        response=zeros((rows, rows)),
        impulse=zeros(rows),
        row=zeros(rows, np.int64),
        along=zeros((rows, 2)),
        is_normal=zeros(rows, np.int64),
        follow=zeros((rows, 4)),
        compliance=zeros(rows),
        goal=zeros(rows),
    )


@inlined
def reduced_step(laws, closed, contacts, delassus, reduced):
    """
    Fill impulses and velocities with the solution for the laws linear about the trial velocities.

    Parameters
    ----------
    laws, closed, contacts
        Those of a `solver.Problem`. Trial, anchor, selection_center and disc_radius are read,
        impulse and gamma are filled.
    delassus : Delassus
        As `condense` filled it.
    reduced : Reduced

    Returns
    -------
    bool
        Whether the solution is finite.

    """
    width = 5 if laws.rolling.mu_x > 0.0 else 3
    count = reduce_laws(laws, closed, contacts, reduced)
    held_velocities(closed, width, contacts, delassus, reduced)
    fill_responses(count, closed, width, contacts, delassus.operator, reduced)
    for attempt in range(2):
        fill_system(count, delassus.packed, reduced)
        if eliminate_columns(reduced.system, count, attempt > 0):
            break
    finite = expand(count, closed, width, contacts, reduced)
    condensed_velocities(closed, width, contacts, delassus)
    return finite


@inlined
def reduce_laws(laws, closed, contacts, reduced):
    """Fill the unknowns, their laws and the held impulses; return how many unknowns there are."""
    count = 0
    for a in closed:
        row, radius = contacts.row[a], contacts.disc_radius[a]
        P_N, S_N = normal_law(
            laws, contacts.selection_center[a], contacts.anchor[a, 0], contacts.trial[a, 0]
        )
        normal, reduced.impulse[row] = -1, 0.0
        if S_N > 0.0:
            normal = count
            add_unknown(count, row, 1.0, 0.0, 1.0 / S_N, reduced)
            reduced.goal[count] = P_N / S_N + contacts.trial[a, 0]
            reduced.is_normal[count] = 1
            for k in range(4):
                reduced.follow[count, k] = 0.0
            count += 1
        if radius == FREE:
            radius = P_N
        else:
            normal = -1
        factor = grip(laws.other, contacts, a)
        disc = anchored_disc(laws, laws.other, contacts, a)
        count = reduce_disc(disc, contacts, a, radius, factor, normal, count, reduced)
        if laws.rolling.mu_x > 0.0:
            disc = rolling_disc(laws, laws.other, a)
            count = reduce_disc(disc, contacts, a, radius, factor, normal, count, reduced)
    return count


@inlined
def add_unknown(count, row, x, y, compliance, reduced):
    """Add the unknown of number `count`, with r = (x, y) in a row and the next one."""
    reduced.row[count], reduced.compliance[count] = row, compliance
    reduced.along[count, 0], reduced.along[count, 1] = x, y
    reduced.is_normal[count] = 0


@merged
def reduce_disc(disc, contacts, a, radius, factor, normal, count, reduced):
    """
    Add the unknowns of one kind of friction at contact a; return how many there are then.

    Parameters
    ----------
    disc : Disc
    contacts : record array, shape (contacts,)
        Table of contacts.
    a : int
        Number of the contact.
    radius : float
        Normal impulse that limits the friction [N s].
    factor : float
        Radius of the friction disc over that impulse; see `laws.grip`.
    normal : int
        Number of the unknown that the radius follows, -1 if it is held.
    count : int
        Number of unknowns so far.
    reduced : Reduced

    """
    k = disc.column
    row = contacts.row[a] + k
    x, y = contacts.trial[a, k], contacts.trial[a, k + 1]
    P_x, P_y, S_xx, _, S_yy, d_x, d_y = disc_law(
        disc, contacts.anchor[a, k], contacts.anchor[a, k + 1], x, y, factor * radius
    )
    reduced.impulse[row] = reduced.impulse[row + 1] = 0.0
    if d_x == 0.0 and d_y == 0.0:  # it sticks, or there is no friction
        if S_xx > 0.0:
            add_unknown(count, row, 1.0, 0.0, 1.0 / S_xx, reduced)
            reduced.goal[count] = P_x / S_xx + x
            count += 1
        if S_yy > 0.0:
            add_unknown(count, row, 0.0, 1.0, 1.0 / S_yy, reduced)
            reduced.goal[count] = P_y / S_yy + y
            count += 1
        return count
    if normal >= 0:
        reduced.follow[normal, k - 1], reduced.follow[normal, k] = factor * d_x, factor * d_y
    else:
        reduced.impulse[row], reduced.impulse[row + 1] = P_x, P_y
    t_x, t_y = disc.mu_x * disc.over_y * d_y, -disc.mu_y * disc.over_x * d_x
    if S_xx + S_yy > 0.0:
        add_unknown(count, row, t_x, t_y, (t_x * t_x + t_y * t_y) / (S_xx + S_yy), reduced)
        reduced.goal[count] = t_x * x + t_y * y
        count += 1
    return count


@inlined
def held_velocities(closed, width, contacts, delassus, reduced):
    """Fill delassus.packed with the velocities that the held impulses leave."""
    G, packed = delassus.operator, delassus.packed
    fill_free_velocities(closed, width, contacts, delassus)
    for b in closed:
        for column in range(contacts.row[b] + 1, contacts.row[b] + width):
            P = reduced.impulse[column]
            if P != 0.0:
                for a in closed:
                    row = contacts.row[a]
                    for i in range(width):
                        packed[row + i] += G[column, row + i] * P


@inlined
def fill_responses(count, closed, width, contacts, G, reduced):
    """Fill the velocities ``G c`` of the closed contacts for a unit of every unknown."""
    rows = 0
    for a in closed:
        rows = max(rows, contacts.row[a] + width)
    for v in range(count):
        row, g = reduced.row[v], reduced.response[v]
        if reduced.is_normal[v]:
            x, y = reduced.follow[v, 0], reduced.follow[v, 1]
            for i in range(rows):
                g[i] = G[row, i] + x * G[row + 1, i] + y * G[row + 2, i]
            if width > 3:
                x, y = reduced.follow[v, 2], reduced.follow[v, 3]
                for i in range(rows):
                    g[i] += x * G[row + 3, i] + y * G[row + 4, i]
        else:
            x, y = reduced.along[v, 0], reduced.along[v, 1]
            for i in range(rows):
                g[i] = x * G[row, i] + y * G[row + 1, i]


@inlined
def fill_system(count, velocity, reduced):
    """Fill the linear system for the unknowns; `velocity` is that of the held impulses."""
    B = reduced.system
    for u in range(count):
        row, x, y = reduced.row[u], reduced.along[u, 0], reduced.along[u, 1]
        B[count, u] = reduced.goal[u] - x * velocity[row] - y * velocity[row + 1]
        for v in range(count):
            B[v, u] = x * reduced.response[v, row] + y * reduced.response[v, row + 1]
        B[u, u] += reduced.compliance[u]


@compiled
def eliminate_columns(B, count, searches):
    """
    Replace row `count` of B by the solution of ``B[:count].T x = B[count]``.

    The rows of B are the columns of the matrix: so the elimination goes along rows of B.

    Parameters
    ----------
    B : ndarray, shape (c+1, c)
    count : int
        Number of unknowns.
    searches : bool
        Whether pivots are searched for in each column. Without it the elimination ends at a pivot
        that is not positive.

    Returns
    -------
    bool
        Whether the elimination came to its end.

    """
    for k in range(count):
        if searches:
            pivot = k
            for i in range(k + 1, count):
                if abs(B[k, i]) > abs(B[k, pivot]):
                    pivot = i
            if pivot != k:
                for j in range(count + 1):
                    B[j, k], B[j, pivot] = B[j, pivot], B[j, k]
        elif not B[k, k] > 0.0:
            return False
        over = 1.0 / B[k, k]
        for i in range(k + 1, count):
            B[k, i] *= over
        for j in range(k + 1, count + 1):
            share = B[j, k]
            if share != 0.0:
                for i in range(k + 1, count):
                    B[j, i] -= share * B[k, i]
    for k in range(count - 1, -1, -1):
        x = B[count, k] / B[k, k]
        B[count, k] = x
        for i in range(k):
            B[count, i] -= x * B[k, i]
    return True


@inlined
def expand(count, closed, width, contacts, reduced):
    """Fill the impulses of the contacts from the unknowns; return whether they are finite."""
    P, total = reduced.impulse, 0.0
    for u in range(count):
        z, row = reduced.system[count, u], reduced.row[u]
        total += z
        P[row] += reduced.along[u, 0] * z
        P[row + 1] += reduced.along[u, 1] * z
        if reduced.is_normal[u]:
            for k in range(width - 1):
                P[row + 1 + k] += reduced.follow[u, k] * z
    for a in closed:
        for j in range(width):
            contacts.impulse[a, j] = P[contacts.row[a] + j]
    return math.isfinite(total)

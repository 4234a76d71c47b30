# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Sweeps over the contacts, and where Newton's method starts in a step.

A sweep projects the impulses of one contact after the other on the Delassus operator, with
up-to-date velocities. A step starts from the history of the last one: velocities and impulses of
its contacts are predicted, and where they are condensed, some sweeps improve the prediction.
"""

import math

from snake_sim_ros.contact.delassus import condensed_velocities, Delassus
from snake_sim_ros.contact.laws import Disc, grip, Laws, prox_half_line, rolling_disc, sliding_disc
from snake_sim_ros.contact.problem import ContactHistory
from snake_sim_ros.dynamics.compilation import compiled, inlined, merged, Table
from snake_sim_ros.scene.parameters import Array


@inlined
def project_normal(
    laws: Laws,
    G: Array,
    gamma: Array,
    rows: int,
    row: int,
    contacts: Table,
    impulse: Array,
    a: int,
) -> float:
    """
    Project and return the normal impulse of contact a [N s].

    Parameters
    ----------
    laws : Laws
    G : ndarray, shape (c, c)
        Delassus operator [1/kg].
    gamma : ndarray, shape (c,)
        Velocities of the closed contacts [m/s]; kept up to date.
    rows : int
        Number of rows of G in use.
    row : int
        First row of contact a.
    contacts : record array, shape (contacts,)
        Table of contacts; its selection centers are read.
    impulse : ndarray, shape (contacts, 5)
        Impulses [N s]; that of contact a is replaced.
    a : int
        Number of the contact.

    """
    P_N = impulse[a, 0]
    r = 1.0 / (G[row, row] + laws.compliance)
    rule = laws.compliance * (P_N - contacts.selection_center[a])
    P_N = prox_half_line(P_N - r * (gamma[row] + rule))
    set_impulse(G, gamma, rows, row, impulse, a, 0, P_N)
    return P_N


@compiled
def set_impulse(
    G: Array, gamma: Array, rows: int, column: int, impulse: Array, a: int, j: int, P: float
) -> None:
    """
    Set component j of the impulse of contact a to P, and update the velocities for the change.

    Other parameters are those of `project_normal`; `column` is the row and column of the component
    in G.
    """
    change = P - impulse[a, j]
    impulse[a, j] = P
    if change != 0.0:
        for row in range(rows):
            gamma[row] += G[column, row] * change


@merged
def predict(laws: Laws, closed: Array, contacts: Table, history: ContactHistory) -> None:
    """
    Fill trial velocities and anchors: impulses and velocities continue to change as they did.

    A new contact starts without impulse and with its velocity before the contacts act.

    `laws`, `closed` and `contacts` are those of a `problem.Problem`. The history is that of the
    last step, see `stepping.state`; gamma and selection_center of the contacts are read, trial,
    iterate and anchor filled.
    """
    last, velocity, change = history.impulse, history.velocity, history.change
    for a in closed:
        for j in range(5):
            contacts.anchor[a, j] = contacts.iterate[a, j] = last[a, j]
            contacts.trial[a, j] = contacts.gamma[a, j]
        P_N = 0.0
        if last[a, 0] > 0.0:
            P_N = last[a, 0] + change[a, 0]
            for k in range(1, 4, 2):
                x, y = velocity[a, k], velocity[a, k + 1]
                next_x, next_y = x + change[a, k], y + change[a, k + 1]
                ahead = x * next_x + y * next_y > 0.0
                contacts.trial[a, k] = next_x if ahead else x
                contacts.trial[a, k + 1] = next_y if ahead else y
        contacts.trial[a, 0] = -laws.compliance * (max(0.0, P_N) - contacts.selection_center[a])


@inlined
def improve(laws: Laws, closed: Array, contacts: Table, delassus: Delassus, sweeps: int) -> None:
    """
    Improve predicted impulses by a few projections of each contact on the Delassus operator.

    Parameters are those of `predict`, and the operator as `delassus.condense` filled it. Trial,
    iterate and anchor are replaced. A contact that sticks gets a trial velocity of zero.
    """
    width, impulse = 5 if laws.rolling.mu_x > 0.0 else 3, contacts.iterate
    rows = 0
    for a in closed:
        rows = max(rows, contacts.row[a] + width)
        for j in range(width):
            contacts.impulse[a, j] = impulse[a, j]
    condensed_velocities(closed, width, contacts, delassus)
    G, gamma = delassus.operator, delassus.packed
    for sweep in range(sweeps):
        for a in closed:
            row = contacts.row[a]
            P_N = project_normal(laws, G, gamma, rows, row, contacts, impulse, a)
            radius = grip(laws.other, contacts, a) * P_N
            P_x = impulse[a, 1] if impulse[a, 1] != 0.0 else -gamma[row + 1]
            sliding = sliding_disc(laws, laws.other, a, P_x)
            for disc in (sliding, rolling_disc(laws, laws.other, a)):
                if disc.column < width:
                    k = row + disc.column
                    sticks = project_scaled(disc, G, gamma, rows, k, impulse, a, radius)
                    if sweep == sweeps - 1:
                        for j in range(2):
                            contacts.trial[a, disc.column + j] = 0.0 if sticks else gamma[k + j]
    for a in closed:
        P_N = impulse[a, 0]
        rule = -laws.compliance * (P_N - contacts.selection_center[a])
        contacts.trial[a, 0] = rule if P_N > 0.0 else gamma[contacts.row[a]]
        for j in range(width):
            contacts.anchor[a, j] = impulse[a, j]


@inlined
def project_scaled(
    disc: Disc, G: Array, gamma: Array, rows: int, k: int, impulse: Array, a: int, radius: float
) -> bool:
    """
    Project the friction of contact a on a disc, with the scaled impulses of `linear_problem`.

    Parameters
    ----------
    disc : Disc
    G, gamma, rows, impulse, a
        As in `sweeps.project_normal`.
    k : int
        First row of the friction.
    radius : float
        Radius of the disc [N s].

    Returns
    -------
    bool
        Whether the contact sticks.

    """
    j, mu_x, mu_y = disc.column, disc.mu_x, disc.mu_y
    xx, xy, yy = mu_x * mu_x * G[k, k], mu_x * mu_y * G[k, k + 1], mu_y * mu_y * G[k + 1, k + 1]
    half = 0.5 * (xx - yy)
    largest = 0.5 * (xx + yy) + math.sqrt(half * half + xy * xy)
    if not largest > 0.0:
        return False
    x = disc.over_x * impulse[a, j] - mu_x * gamma[k] / largest
    y = disc.over_y * impulse[a, j + 1] - mu_y * gamma[k + 1] / largest
    length = math.sqrt(x * x + y * y)
    shrink = radius / length if length > radius else 1.0
    set_impulse(G, gamma, rows, k, impulse, a, j, mu_x * shrink * x)
    set_impulse(G, gamma, rows, k + 1, impulse, a, j + 1, mu_y * shrink * y)
    return length <= radius


@merged
def remember(closed: Array, contacts: Table, history: ContactHistory) -> None:
    """
    Fill the history with impulses, velocities and changes of the closed contacts, 0 for open ones.

    The parameters are those of `predict`. The history of the last step is replaced by that of this
    step.
    """
    last, velocity, change = history.impulse, history.velocity, history.change
    for a in closed:
        contacts.is_closed[a] = 1
        now = contacts.impulse[a, 0] > 0.0
        before = now and last[a, 0] > 0.0
        change[a, 0] = contacts.impulse[a, 0] - last[a, 0] if before else 0.0
        for j in range(1, 5):
            difference = contacts.gamma[a, j] - velocity[a, j]
            change[a, j] = difference if before else 0.0
        for j in range(5):
            last[a, j] = contacts.impulse[a, j] if now else 0.0
            velocity[a, j] = contacts.gamma[a, j] if now else 0.0
    for a in range(len(contacts)):
        if contacts.is_closed[a] == 0 and last[a, 0] > 0.0:
            for j in range(5):
                last[a, j] = velocity[a, j] = change[a, j] = 0.0
        contacts.is_closed[a] = 0

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where the contact solvers of Newton start in a step: from the history of the last one."""

import math

from snake_sim_ros.contact.delassus import condensed_velocities
from snake_sim_ros.contact.laws import grip, rolling_disc, sliding_disc
from snake_sim_ros.contact.sweeps import project_normal, set_impulse
from snake_sim_ros.dynamics.compilation import inlined, merged


@merged
def predict(laws, closed, contacts, history):
    """
    Fill trial velocities and anchors: impulses and velocities continue to change as they did.

    A new contact starts without impulse and with its velocity before the contacts act.

    `laws`, `closed` and `contacts` are those of a `solver.Problem`. The history is that of the
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
def improve(laws, closed, contacts, delassus, sweeps):
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
def project_scaled(disc, G, gamma, rows, k, impulse, a, radius):
    """
    Project the friction of contact a on a disc, with the scaled impulses of `linear_laws`.

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
def remember(closed, contacts, history):
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

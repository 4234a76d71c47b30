# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Sweeps over the contacts, and where Newton's method starts in a step.

A sweep projects the impulses of one contact after the other on the Delassus operator, with
up-to-date velocities. A step starts from the history of the last one: velocities and impulses of
its contacts are predicted, and where they are condensed, some sweeps improve the prediction.
"""

import math
from typing import NamedTuple

from snake_sim_ros.contact.contacts import Contacts
from snake_sim_ros.contact.delassus import condensed_velocities, Delassus
from snake_sim_ros.contact.laws import (
    Disc,
    grip,
    impulse_width,
    Laws,
    prox_half_line,
    prox_scaled,
    rolling_disc,
    sliding_disc,
)
from snake_sim_ros.contact.problem import ContactHistory
from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.scene.parameters import Array


class Sweep(NamedTuple):
    """The Delassus operator of the closed contacts, with impulses and up-to-date velocities."""

    G: Array  # (c, c) Delassus operator [1/kg]
    gamma: Array  # (c,) velocities of the closed contacts [m/s]
    rows: int  # number of rows of G in use
    impulse: Array  # (contacts, 5) impulses [N s]


@inlined
def project_normal(laws: Laws, sweep: Sweep, row: int, contacts: Contacts, a: int) -> float:
    """
    Project and return the normal impulse of contact a [N s].

    Parameters
    ----------
    laws : Laws
    sweep : Sweep
    row : int
        First row of contact a.
    contacts : Contacts
        Their selection centers are read.
    a : int
        Number of the contact.

    """
    G, gamma, P_N = sweep.G, sweep.gamma, sweep.impulse[a, 0]
    r = 1.0 / (G[row, row] + laws.compliance)
    rule = laws.compliance * (P_N - contacts.solution.selection_center[a])
    P_N = prox_half_line(P_N - r * (gamma[row] + rule))
    set_impulse(sweep, row, a, 0, P_N)
    return P_N


@compiled
def set_impulse(sweep: Sweep, column: int, a: int, j: int, P: float) -> None:
    """
    Set component j of the impulse of contact a to P, and update the velocities for the change.

    `column` is the row and column of the component in the Delassus operator.
    """
    change = P - sweep.impulse[a, j]
    sweep.impulse[a, j] = P
    if change != 0.0:
        for row in range(sweep.rows):
            sweep.gamma[row] += sweep.G[column, row] * change


@inlined
def predict(laws: Laws, closed: Array, contacts: Contacts, history: ContactHistory) -> None:
    """
    Fill trial velocities and anchors: impulses and velocities continue to change as they did.

    A new contact starts without impulse and with its velocity before the contacts act.

    `laws`, `closed` and `contacts` are those of a `problem.Problem`. The history is that of the
    last step, see `stepping.state`; gamma and selection_center of the contacts are read, trial,
    iterate and anchor filled.
    """
    solution, newton = contacts.solution, contacts.newton
    last, change = history.impulse, history.change
    for a in closed:
        for j in range(5):
            newton.anchor[a, j] = newton.iterate[a, j] = last[a, j]
            newton.trial[a, j] = solution.gamma[a, j]
        P_N = 0.0
        if last[a, 0] > 0.0:
            P_N = last[a, 0] + change[a, 0]
            for k in range(1, 4, 2):
                newton.trial[a, k], newton.trial[a, k + 1] = next_velocity(history, a, k)
        newton.trial[a, 0] = -laws.compliance * (max(0.0, P_N) - solution.selection_center[a])


@inlined
def next_velocity(history: ContactHistory, a: int, k: int) -> tuple[float, float]:
    """
    Return components k and k+1 of the velocity of contact a if they change as in the last step.

    A velocity that would turn by more than a right angle is the last one: friction would stop it.
    """
    x, y = history.velocity[a, k], history.velocity[a, k + 1]
    next_x, next_y = x + history.change[a, k], y + history.change[a, k + 1]
    ahead = x * next_x + y * next_y > 0.0
    return (next_x, next_y) if ahead else (x, y)


@inlined
def improve(
    laws: Laws, closed: Array, contacts: Contacts, delassus: Delassus, sweeps: int
) -> None:
    """
    Improve predicted impulses by a few projections of each contact on the Delassus operator.

    Parameters are those of `predict`, and the operator as `delassus.condense` filled it. Trial,
    iterate and anchor are replaced. A contact that sticks gets a trial velocity of zero.
    """
    solution, newton = contacts.solution, contacts.newton
    width, impulse = impulse_width(laws), newton.iterate
    rows = 0
    for a in closed:
        rows = max(rows, newton.row[a] + width)
        for j in range(width):
            solution.impulse[a, j] = impulse[a, j]
    condensed_velocities(closed, width, contacts, delassus)
    gamma = delassus.packed
    sweep = Sweep(delassus.operator, gamma, rows, impulse)
    for k in range(sweeps):
        for a in closed:
            row = newton.row[a]
            P_N = project_normal(laws, sweep, row, contacts, a)
            radius = grip(laws.other, contacts, a) * P_N
            P_x = impulse[a, 1] if impulse[a, 1] != 0.0 else -gamma[row + 1]
            sliding = sliding_disc(laws, laws.other, a, P_x)
            for disc in (sliding, rolling_disc(laws, laws.other, a)):
                if disc.column < width:
                    first = row + disc.column
                    sticks = project_scaled(disc, sweep, first, a, radius)
                    if k == sweeps - 1:
                        for j in range(2):
                            newton.trial[a, disc.column + j] = 0.0 if sticks else gamma[first + j]
    for a in closed:
        P_N = impulse[a, 0]
        rule = -laws.compliance * (P_N - solution.selection_center[a])
        newton.trial[a, 0] = rule if P_N > 0.0 else gamma[newton.row[a]]
        for j in range(width):
            newton.anchor[a, j] = impulse[a, j]


@inlined
def project_scaled(disc: Disc, sweep: Sweep, k: int, a: int, radius: float) -> bool:
    """
    Project the friction of contact a on a disc, with the scaled impulses of `linear_problem`.

    Parameters
    ----------
    disc : Disc
    sweep : Sweep
    k : int
        First row of the friction.
    a : int
        Number of the contact.
    radius : float
        Radius of the disc [N s].

    Returns
    -------
    bool
        Whether the contact sticks.

    """
    G, gamma, impulse = sweep.G, sweep.gamma, sweep.impulse
    j, mu_x, mu_y = disc.column, disc.mu_x, disc.mu_y
    xx, xy, yy = mu_x * mu_x * G[k, k], mu_x * mu_y * G[k, k + 1], mu_y * mu_y * G[k + 1, k + 1]
    half = 0.5 * (xx - yy)
    largest = 0.5 * (xx + yy) + math.sqrt(half * half + xy * xy)
    if not largest > 0.0:
        return False
    x = disc.over_x * impulse[a, j] - mu_x * gamma[k] / largest
    y = disc.over_y * impulse[a, j + 1] - mu_y * gamma[k + 1] / largest
    x, y, sticks = prox_scaled(disc, x, y, radius)
    set_impulse(sweep, k, a, j, x)
    set_impulse(sweep, k + 1, a, j + 1, y)
    return sticks


@inlined
def remember(closed: Array, contacts: Contacts, history: ContactHistory) -> None:
    """
    Fill the history with impulses, velocities and changes of the closed contacts, 0 for open ones.

    The parameters are those of `predict`. The history of the last step is replaced by that of this
    step.
    """
    solution = contacts.solution
    last, velocity, change = history.impulse, history.velocity, history.change
    for a in closed:
        now = solution.impulse[a, 0] > 0.0
        before = now and last[a, 0] > 0.0
        change[a, 0] = solution.impulse[a, 0] - last[a, 0] if before else 0.0
        for j in range(1, 5):
            difference = solution.gamma[a, j] - velocity[a, j]
            change[a, j] = difference if before else 0.0
        for j in range(5):
            last[a, j] = solution.impulse[a, j] if now else 0.0
            velocity[a, j] = solution.gamma[a, j] if now else 0.0
    forget_others(closed, contacts, history)


@inlined
def forget_others(closed: Array, contacts: Contacts, history: ContactHistory) -> None:
    """Fill the history of contacts that are not closed with 0."""
    newton, last = contacts.newton, history.impulse
    if len(closed) == len(last):
        return
    for a in closed:
        newton.is_closed[a] = 1
    for a in range(len(last)):
        if last[a, 0] > 0.0 and newton.is_closed[a] == 0:
            for j in range(5):
                last[a, j] = history.velocity[a, j] = history.change[a, j] = 0.0
    for a in closed:
        newton.is_closed[a] = 0

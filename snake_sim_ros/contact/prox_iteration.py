# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The paper's iteration, compiled: projections of all contacts at once, eqs. (84)-(93)."""

import math
from typing import NamedTuple, Protocol

from snake_sim_ros.contact.contacts import Contacts
from snake_sim_ros.contact.delassus import condense, condensed_velocities, Delassus, end_twists
from snake_sim_ros.contact.laws import (
    grip,
    impulse_width,
    Laws,
    natural_map,
    prox_disc,
    prox_ellipse,
    prox_half_line,
    rolling_disc,
    rolls,
    sliding_disc,
)
from snake_sim_ros.contact.newton import line_search, move
from snake_sim_ros.contact.problem import (
    ContactHistory,
    Joints,
    joints_residual,
    Outcome,
    Problem,
    solve_contacts,
)
from snake_sim_ros.contact.sweeps import forget_others
from snake_sim_ros.dynamics.articulated_body import factor_chain, reset_chain
from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.dynamics.joint_laws import anchor_axes, linearize_axes
from snake_sim_ros.scene.parameters import Array

# A contact problem with more impulse components is not condensed: it would not pay.
MOST_CONDENSED_ROWS = 48
MOST_CHANGES = 300  # solutions of a step, with other laws of the joints, before it is unconverged


@compiled
def copy_impulses(closed: Array, impulse: Array, contacts: Contacts) -> None:
    """Copy the impulses of the closed contacts, from shape (contacts, 5) [N s], to the table."""
    for a in closed:
        for j in range(5):
            contacts.solution.impulse[a, j] = impulse[a, j]


@inlined
def prox_sliding(laws: Laws, contacts: Contacts, a: int, P_N: float) -> tuple[float, float]:
    """Return the projection of the sliding impulse of contact a for a normal one, eq. (88)."""
    solution, radius = contacts.solution, grip(laws.other, contacts, a) * P_N
    x = solution.impulse[a, 1] - laws.r_T * solution.gamma[a, 1]
    y = solution.impulse[a, 2] - laws.r_T * solution.gamma[a, 2]
    disc = sliding_disc(laws, laws.other, a, x)
    return prox_ellipse(x, y, disc.mu_x * radius, disc.mu_y * radius)


@inlined
def prox_sweep(laws: Laws, closed: Array, contacts: Contacts, impulse: Array) -> float:
    """
    Fill `impulse` with one projection of the impulses in the table, eqs. (87)-(89).

    The sets of sliding and rolling impulses are those of the new normal impulse.

    Returns
    -------
    float
        Left side of the stopping rule (93) [N s].

    """
    solution = contacts.solution
    normal = sliding = rolling = 0.0
    for a in closed:
        P_N, P_x, P_y = solution.impulse[a, 0], solution.impulse[a, 1], solution.impulse[a, 2]
        rule = laws.compliance * (P_N - solution.selection_center[a])
        new = prox_half_line(P_N - laws.r_N * (solution.gamma[a, 0] + rule))
        new_x, new_y = prox_sliding(laws, contacts, a, new)
        normal += (new - P_N) ** 2
        sliding += (new_x - P_x) ** 2 + (new_y - P_y) ** 2
        impulse[a, 0], impulse[a, 1], impulse[a, 2] = new, new_x, new_y
        P_x, P_y = solution.impulse[a, 3], solution.impulse[a, 4]
        new_x = new_y = 0.0
        if rolls(laws):
            radius = grip(laws.other, contacts, a) * new
            new_x, new_y = prox_disc(
                P_x - laws.r_V * solution.gamma[a, 3],
                P_y - laws.r_V * solution.gamma[a, 4],
                rolling_disc(laws, laws.other, a).mu_x * radius,
            )
        rolling += (new_x - P_x) ** 2 + (new_y - P_y) ** 2
        impulse[a, 3], impulse[a, 4] = new_x, new_y
    return math.sqrt(normal) + math.sqrt(sliding) + math.sqrt(rolling)


class ProxIteration(NamedTuple):
    """The paper's iteration, with the arrays of the Delassus operator."""

    delassus: Delassus  # for up to MOST_CONDENSED_ROWS


@solve_contacts.register(ProxIteration)
@inlined
def solve_with_projections(
    solver: ProxIteration, problem: Problem, history: ContactHistory, limit: int
) -> Outcome:
    """
    Iterate impulses and twists until the contact laws hold; see `problem.solve_contacts`.

    The residual is that of the impulses before the last projection, to which the twists belong.
    """
    laws, closed, contacts, chain, _, _ = problem
    delassus, impulse, tolerance = solver.delassus, history.impulse, laws.change_tolerance
    reset_chain(chain)
    factor_chain(chain)
    width = impulse_width(laws)
    columns = width * len(closed)
    condensed = False
    iterations, change = 0, math.inf
    while not change < tolerance and iterations < limit:
        if 0 < iterations == columns <= len(delassus.packed):
            # After as many sweeps as the Delassus operator has columns, forming it costs no more
            # than was spent so far, and later sweeps cost less. The iterates stay the same.
            condense(closed, width, contacts, chain, delassus)
            condensed = True
        copy_impulses(closed, impulse, contacts)
        if condensed:
            condensed_velocities(closed, width, contacts, delassus)
        else:
            end_twists(closed, contacts, chain)
        change = prox_sweep(laws, closed, contacts, impulse)
        iterations += 1
    if condensed:
        end_twists(closed, contacts, chain)
    forget_others(closed, contacts, history)
    residual, printed = natural_map(laws, closed, contacts, 0.0)
    return Outcome(iterations, change < tolerance, residual, printed, False)


class Trial(NamedTuple):
    """A solution of the contacts with linear laws of the joints, which may not hold."""

    iterations: int  # of the contact solver
    converged: bool  # whether its residual is within the tolerance
    attempt: int  # number of the solution in its step, from 0
    left: int  # iterations that it was allowed to take


class Counts(Protocol):
    """What the laws count in the report of the steps."""

    iterations: int  # of the contact solver
    unconverged: int  # steps without an end


@inlined
def joint_laws_change(
    laws: Laws, contacts: Contacts, joints: Joints, trial: Trial, report: Counts
) -> bool:
    """
    Make the laws of the joints linear about the last solution; return whether they did not hold.

    This is for methods whose iterations leave the joints as they are. The way from one solution to
    the next is searched as that of Newton's method, by the joints alone. If the solution `trial`
    took all iterations that were left, there is no other one. The report counts the iterations of
    all solutions but the last one, and a step without an end.

    `laws` and `contacts` are those of a `problem.Problem`; the rates in `joints.axes` are those of
    the solution.
    """
    if not joints.take_part or joints_residual(joints) <= laws.residual_tolerance:
        return False
    if trial.attempt + 1 == MOST_CHANGES or trial.iterations >= trial.left:
        report.unconverged += trial.converged
        return False
    report.iterations += trial.iterations
    none = contacts.geometry.link[:0]
    fraction = line_search(laws, none, contacts, joints) if trial.attempt > 0 else 1.0
    move(none, contacts, joints, fraction if fraction > 0.0 else 1.0)
    anchor_axes(joints.axes)
    linearize_axes(joints.laws, joints.axes, (joints.torque, joints.damping))
    return True

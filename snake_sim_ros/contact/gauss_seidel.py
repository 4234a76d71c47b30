# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Projected Gauss-Seidel iteration on the condensed contact problem, contact by contact.

The projections are those of the paper's iteration, eqs. (87)-(89). The prox parameters follow from
the Delassus operator, 1/G_kk, and the velocities contain all impulses found so far [1].

Contacts that share a load in many ways need up to 100 000 sweeps until the share is that of the
selection rule: only the compliance, 1e-4 of G, decides it. So sweeps find which contacts stick,
slide and open, and Newton's method on the same operator goes on from there.

.. [1] F. Jourdan, P. Alart, M. Jean, "A Gauss-Seidel like algorithm to solve frictional contact
   problems", 1998.
"""

from typing import Any, NamedTuple

from snake_sim_ros.contact.admissible import without_gain
from snake_sim_ros.contact.delassus import condense, condensed_twists, condensed_velocities
from snake_sim_ros.contact.laws import Laws, natural_map
from snake_sim_ros.contact.newton import is_negligible, iterate_laws, Operator
from snake_sim_ros.contact.problem import Outcome, Problem, solve_contacts
from snake_sim_ros.contact.prox_iteration import copy_impulses, forget_open
from snake_sim_ros.contact.sweeps import sweep
from snake_sim_ros.dynamics.compilation import compiled, inlined, Table
from snake_sim_ros.scene.parameters import Array

SWEEPS = 100  # sweeps between two tries of Newton's method
NEWTON_ITERATIONS = 20  # of one try, at most


@inlined
def keep_impulses(closed: Array, contacts: Table, impulse: Array) -> None:
    """Fill the impulses of closed contacts, of shape (contacts, 5) [N s], with those used."""
    for a in closed:
        for j in range(5):
            impulse[a, j] = contacts.impulse[a, j]


@compiled
def begin_at_impulses(laws: Laws, closed: Array, contacts: Table) -> None:
    """Start Newton's method at the impulses and velocities of the contacts."""
    for a in closed:
        for j in range(5):
            contacts.anchor[a, j] = contacts.iterate[a, j] = contacts.impulse[a, j]
            contacts.trial[a, j] = contacts.gamma[a, j]
        P_N = contacts.impulse[a, 0]
        if P_N > 0.0:
            contacts.trial[a, 0] = -laws.compliance * (P_N - contacts.selection_center[a])


class GaussSeidel(NamedTuple):
    """Projected Gauss-Seidel iteration, with the arrays of the Delassus operator."""

    operator: Operator


@solve_contacts.register(GaussSeidel)
@inlined
def solve_with_sweeps(
    solver: GaussSeidel, model: Any, problem: Problem, history: Any, limit: int
) -> Outcome:
    """Sweep until the contact laws hold; see `problem.solve_contacts`."""
    laws, closed, contacts, chain = problem
    operator, impulse, tolerance = solver.operator, history.impulse, model.residual_tolerance
    delassus = operator.delassus
    width = 5 if laws.rolling.mu_x > 0.0 else 3
    condense(closed, width, contacts, chain, delassus)
    operator.is_condensed[0] = 1
    iterations, sweeps, converged = 0, 0, False
    while True:
        copy_impulses(closed, impulse, contacts)
        condensed_velocities(closed, width, contacts, delassus)  # anew: rounding does not add up
        residual, printed = natural_map(laws, closed, contacts, tolerance)
        ends = residual <= tolerance
        converged = ends and is_negligible(laws, closed, contacts, residual, tolerance)
        if converged or iterations >= limit:
            break
        if ends or sweeps == SWEEPS:
            begin_at_impulses(laws, closed, contacts)
            most = min(NEWTON_ITERATIONS, limit - iterations)
            spent, new, new_printed, exact = iterate_laws(
                problem, tolerance, most, operator, 0, False
            )
            iterations, sweeps = iterations + spent, 0
            if new <= tolerance and exact:
                residual, printed, converged = new, new_printed, True
                keep_impulses(closed, contacts, impulse)
                break
            copy_impulses(closed, impulse, contacts)
            condensed_velocities(closed, width, contacts, delassus)
            if ends or iterations >= limit:
                converged = ends and most == NEWTON_ITERATIONS
                break
        sweep(laws, closed, width, contacts, delassus, impulse)
        iterations, sweeps = iterations + 1, sweeps + 1
    condensed_twists(closed, width, contacts, chain, delassus)
    outcome = Outcome(iterations, converged, residual, printed, False)
    outcome = without_gain(problem, outcome)
    if not outcome.converged:  # others may be in the table now
        keep_impulses(closed, contacts, impulse)
    forget_open(closed, contacts, impulse)
    return outcome

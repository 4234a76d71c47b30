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

import math
from typing import NamedTuple

from snake_sim_benchmarks.comparison.baselines.dense_newton import whole_operator
from snake_sim_ros.contact.admissible import take_admissible
from snake_sim_ros.contact.contacts import Contacts
from snake_sim_ros.contact.delassus import (
    condense,
    condensed_twists,
    condensed_velocities,
    Delassus,
)
from snake_sim_ros.contact.laws import (
    grip,
    impulse_width,
    Laws,
    natural_map,
    prox_disc,
    prox_ellipse,
    rolling_disc,
    sliding_disc,
)
from snake_sim_ros.contact.linear_problem import Operator
from snake_sim_ros.contact.newton import (
    COUPLED,
    COUPLED_ITERATIONS,
    is_negligible,
    iterate_laws,
    Round,
)
from snake_sim_ros.contact.problem import ContactHistory, Joints, Outcome, Problem, solve_contacts
from snake_sim_ros.contact.prox_iteration import copy_impulses
from snake_sim_ros.contact.sweeps import forget_others, project_normal, set_impulse, Sweep
from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.methods import METHODS, paper_method

SWEEPS = 100  # sweeps between two tries of Newton's method
NEWTON_ITERATIONS = 20  # of one try, at most


@inlined
def sweep_contacts(
    laws: Laws, closed: Array, width: int, contacts: Contacts, delassus: Delassus, impulse: Array
) -> None:
    """Project the impulse of every closed contact once, with up-to-date velocities."""
    G, gamma = delassus.operator, delassus.packed
    sweep = Sweep(G, gamma, width * len(closed), impulse)
    for k, a in enumerate(closed):
        row = width * k
        P_N = project_normal(laws, sweep, row, contacts, a)
        radius = grip(laws.other, contacts, a) * P_N
        project_sliding(laws, sweep, row, a, radius)
        if width == 5:
            r = 1.0 / largest_eigenvalue(G, row + 3)
            x, y = impulse[a, 3] - r * gamma[row + 3], impulse[a, 4] - r * gamma[row + 4]
            x, y = prox_disc(x, y, rolling_disc(laws, laws.other, a).mu_x * radius)
            set_impulse(sweep, row + 3, a, 3, x)
            set_impulse(sweep, row + 4, a, 4, y)
        else:
            impulse[a, 3] = impulse[a, 4] = 0.0


@compiled
def project_sliding(laws: Laws, sweep: Sweep, row: int, a: int, radius: float) -> None:
    """
    Project the sliding impulse of contact a.

    Parameters are those of `project_normal`; `radius` is the normal impulse of the contact times
    its grip [N s].
    """
    gamma, impulse = sweep.gamma, sweep.impulse
    r = 1.0 / largest_eigenvalue(sweep.G, row + 1)
    x, y = impulse[a, 1] - r * gamma[row + 1], impulse[a, 2] - r * gamma[row + 2]
    disc = sliding_disc(laws, laws.other, a, x)
    x, y = prox_ellipse(x, y, disc.mu_x * radius, disc.mu_y * radius)
    set_impulse(sweep, row + 1, a, 1, x)
    set_impulse(sweep, row + 2, a, 2, y)


@compiled
def largest_eigenvalue(G: Array, k: int) -> float:
    """Return the larger eigenvalue of the 2x2 block of G that begins at k."""
    half, off = 0.5 * (G[k, k] - G[k + 1, k + 1]), G[k, k + 1]
    return 0.5 * (G[k, k] + G[k + 1, k + 1]) + math.sqrt(half * half + off * off)


@inlined
def keep_impulses(closed: Array, contacts: Contacts, impulse: Array) -> None:
    """Fill the impulses of closed contacts, of shape (contacts, 5) [N s], with those used."""
    for a in closed:
        for j in range(5):
            impulse[a, j] = contacts.solution.impulse[a, j]


@compiled
def begin_at_impulses(laws: Laws, closed: Array, contacts: Contacts) -> None:
    """Start Newton's method at the impulses and velocities of the contacts."""
    solution, newton = contacts.solution, contacts.newton
    for a in closed:
        for j in range(5):
            newton.anchor[a, j] = newton.iterate[a, j] = solution.impulse[a, j]
            newton.trial[a, j] = solution.gamma[a, j]
        P_N = solution.impulse[a, 0]
        if P_N > 0.0:
            newton.trial[a, 0] = -laws.compliance * (P_N - solution.selection_center[a])


class GaussSeidel(NamedTuple):
    """Projected Gauss-Seidel iteration, with the arrays of the Delassus operator."""

    operator: Operator


@solve_contacts.register(GaussSeidel)
@inlined
def solve_with_sweeps(
    solver: GaussSeidel, problem: Problem, history: ContactHistory, limit: int
) -> Outcome:
    """Sweep until the contact laws hold; see `problem.solve_contacts`."""
    laws, closed, contacts, chain, pairs, joints = problem
    known = Joints(False, joints.laws, joints.axes, joints.torque, joints.damping)
    problem = Problem(laws, closed, contacts, chain, pairs, known)
    operator, impulse, tolerance = solver.operator, history.impulse, laws.residual_tolerance
    delassus = operator.delassus
    width = impulse_width(laws)
    condense(closed, width, contacts, chain, delassus)
    operator.is_condensed[0] = 1
    iterations, sweeps, converged = 0, 0, False
    while True:
        copy_impulses(closed, impulse, contacts)
        condensed_velocities(closed, width, contacts, delassus)  # anew: rounding does not add up
        residual, printed = natural_map(laws, closed, contacts, tolerance)
        ends = residual <= tolerance
        converged = ends and is_negligible(laws, closed, contacts, residual)
        if converged or iterations >= limit:
            break
        if ends or sweeps == SWEEPS:
            begin_at_impulses(laws, closed, contacts)
            most = min(NEWTON_ITERATIONS, limit - iterations)
            once = Round(COUPLED, tolerance, COUPLED_ITERATIONS, False)
            spent, new, new_printed, exact = iterate_laws(problem, most, operator, once)
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
        sweep_contacts(laws, closed, width, contacts, delassus, impulse)
        iterations, sweeps = iterations + 1, sweeps + 1
    condensed_twists(closed, width, contacts, chain, delassus)
    if not converged:
        residual, printed = take_admissible(problem)
        keep_impulses(closed, contacts, impulse)
    forget_others(closed, contacts, history)
    return Outcome(iterations, converged, residual, printed, False)


METHODS['gauss_seidel'] = paper_method(lambda scene: GaussSeidel(whole_operator(scene)))

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Gauss-Seidel iteration with a friction pyramid in place of the ellipse, as `contact.gauss_seidel`.

The solvers of ODE, Bullet and Gazebo bound ``|P_x| <= mu_x P_N`` and ``|P_y| <= mu_y P_N`` alone:
they clip two numbers instead of projecting on an ellipse. Along an axis of the contact frame this
is Coulomb friction. In between it is not: both components reach their bounds however slow the
slide is in one of them. The force is then along a diagonal of the box for any direction of
sliding, and up to sqrt(2) times too large for isotropic friction. It turns a body that slides at
an angle toward the axis in which it is faster.
"""

from typing import NamedTuple

from snake_sim_benchmarks.comparison.baselines.penalty import BOUND
from snake_sim_ros.contact.contacts import Contacts
from snake_sim_ros.contact.delassus import (
    condense,
    condensed_twists,
    condensed_velocities,
    Delassus,
)
from snake_sim_ros.contact.laws import grip, Laws, natural_map, prox_half_line, sliding_disc
from snake_sim_ros.contact.problem import ContactHistory, Outcome, Problem, solve_contacts
from snake_sim_ros.contact.prox_iteration import copy_impulses
from snake_sim_ros.contact.sweeps import project_normal, set_impulse, Sweep
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.scene.parameters import Array


@inlined
def clipped(P: float, bound: float) -> float:
    """Return the number in [-bound, bound] that is nearest to P."""
    return min(max(P, -bound), bound)


@inlined
def sweep_pyramid(
    laws: Laws, closed: Array, contacts: Contacts, delassus: Delassus, impulse: Array
) -> None:
    """Project all components of the closed contacts in turn, each with updated velocities."""
    G, gamma = delassus.operator, delassus.packed
    sweep = Sweep(G, gamma, 3 * len(closed), impulse)
    for k, a in enumerate(closed):
        row = 3 * k
        P_N = project_normal(laws, sweep, row, contacts, a)
        radius = grip(laws.other, contacts, a) * P_N
        x = impulse[a, 1] - gamma[row + 1] / G[row + 1, row + 1]
        disc = sliding_disc(laws, laws.other, a, x)
        set_impulse(sweep, row + 1, a, 1, clipped(x, disc.mu_x * radius))
        y = impulse[a, 2] - gamma[row + 2] / G[row + 2, row + 2]
        set_impulse(sweep, row + 2, a, 2, clipped(y, disc.mu_y * radius))


@inlined
def pyramid_map(laws: Laws, closed: Array, contacts: Contacts) -> float:
    """Return ``max |P - prox(P - r gamma)|/r`` of the pyramid, with the selection rule [m/s]."""
    solution = contacts.solution
    normal = sliding = 0.0
    for a in closed:
        P_N, P_x, P_y = solution.impulse[a, 0], solution.impulse[a, 1], solution.impulse[a, 2]
        rule = laws.compliance * (P_N - solution.selection_center[a])
        normal = max(
            normal, abs(P_N - prox_half_line(P_N - laws.r_N * (solution.gamma[a, 0] + rule)))
        )
        radius, r = grip(laws.other, contacts, a) * P_N, laws.r_T
        x, y = P_x - r * solution.gamma[a, 1], P_y - r * solution.gamma[a, 2]
        disc = sliding_disc(laws, laws.other, a, x)
        x, y = clipped(x, disc.mu_x * radius), clipped(y, disc.mu_y * radius)
        sliding = max(sliding, abs(P_x - x), abs(P_y - y))
    return max(normal / laws.r_N, sliding / laws.r_T)


class Pyramid(NamedTuple):
    """Gauss-Seidel iteration on the pyramid, with the arrays of the Delassus operator."""

    delassus: Delassus


@solve_contacts.register(Pyramid)
@inlined
def solve_with_pyramid(
    solver: Pyramid, problem: Problem, history: ContactHistory, limit: int
) -> Outcome:
    """
    Sweep until the laws of the pyramid hold; see `problem.solve_contacts`.

    Its residual is that of the pyramid, and its printed residual that of the paper's laws.
    """
    laws, closed, contacts, chain, _, _ = problem
    delassus, impulse, tolerance = solver.delassus, history.impulse, laws.residual_tolerance
    condense(closed, 3, contacts, chain, delassus)
    for a in closed:
        impulse[a, 3] = impulse[a, 4] = 0.0
    iterations = 0
    while True:
        copy_impulses(closed, impulse, contacts)
        condensed_velocities(closed, 3, contacts, delassus)  # anew: rounding does not add up
        residual = pyramid_map(laws, closed, contacts)
        if residual <= tolerance or iterations >= limit:
            break
        sweep_pyramid(laws, closed, contacts, delassus, impulse)
        iterations += 1
    _, printed = natural_map(laws, closed, contacts, BOUND)
    condensed_twists(closed, 3, contacts, chain, delassus)
    return Outcome(iterations, residual <= tolerance, residual, printed, False)

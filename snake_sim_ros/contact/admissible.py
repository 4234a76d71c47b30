# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Admissible impulses next to those of an iteration, and what is taken of them if it does not end.

The rounds of a solver do not come closer to the laws one by one, so the impulses that left least
of them are kept. Contacts only take energy: the power ``P . gamma`` of the impulses with the
velocities after them is not positive. Impulses that satisfy the laws have none that is; those of
an iteration that ends before may drive the robot. Of admissible ones, a share s of all is
admissible, since their sets are cones, and has the power ``s (P . gamma_free + s P . G P)``. It is
not positive up to ``s = -P . gamma_free/(P . G P)``, the share that takes most energy.
"""

import math

from snake_sim_ros.contact.contacts import Contacts
from snake_sim_ros.contact.delassus import end_twists
from snake_sim_ros.contact.laws import (
    Disc,
    grip,
    Laws,
    natural_map,
    prox_scaled,
    rolling_disc,
    sliding_disc,
)
from snake_sim_ros.contact.problem import Problem
from snake_sim_ros.dynamics.articulated_body import factor_chain, reset_chain
from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.scene.parameters import Array


@inlined
def anchor_at_iterate(laws: Laws, closed: Array, contacts: Contacts) -> None:
    """Fill the anchors with the admissible impulses next to the iterate, in scaled components."""
    newton = contacts.newton
    for a in closed:
        P_N = max(0.0, newton.iterate[a, 0])
        newton.anchor[a, 0] = P_N
        radius = grip(laws.other, contacts, a) * P_N
        disc = sliding_disc(laws, laws.other, a, newton.iterate[a, 1])
        anchor_disc(disc, contacts, a, radius)
        anchor_disc(rolling_disc(laws, laws.other, a), contacts, a, radius)


@inlined
def anchor_disc(disc: Disc, contacts: Contacts, a: int, radius: float) -> None:
    """Fill the anchor of one kind of friction at contact a, for a disc of given radius [N s]."""
    newton = contacts.newton
    k = disc.column
    x, y = disc.over_x * newton.iterate[a, k], disc.over_y * newton.iterate[a, k + 1]
    newton.anchor[a, k], newton.anchor[a, k + 1], _ = prox_scaled(disc, x, y, radius)


@compiled
def keep_best(closed: Array, contacts: Contacts, residual: float, best: float) -> float:
    """
    Keep the impulses if their residual is less than the best one so far; return the least one.

    `closed` and `contacts` are those of a `problem.Problem`. Residuals are those of its laws
    [m/s], infinite before the first one.
    """
    if not residual < best:
        return best
    for a in closed:
        for j in range(5):
            contacts.newton.best_impulse[a, j] = contacts.solution.impulse[a, j]
    return residual


@inlined
def return_best(closed: Array, contacts: Contacts) -> None:
    """Return to the impulses of `keep_best`, without their velocities."""
    for a in closed:
        for j in range(5):
            contacts.solution.impulse[a, j] = contacts.newton.best_impulse[a, j]


@inlined
def power(closed: Array, contacts: Contacts) -> float:
    """Return ``P . gamma`` of the closed contacts without their shifts [J]."""
    solution = contacts.solution
    total = 0.0
    for a in closed:
        total -= solution.impulse[a, 0] * solution.shift[a]
        for j in range(5):
            total += solution.impulse[a, j] * solution.gamma[a, j]
    return total


@compiled
def take_admissible(problem: Problem) -> tuple[float, float]:
    """
    Fill the largest share of the admissible impulses next to the present ones that takes energy.

    Velocities and twists are filled, too.

    Returns
    -------
    residual, printed_residual : float
        As `natural_map` returns them [m/s].

    """
    laws, closed, contacts, chain, _, _ = problem
    solution, newton = contacts.solution, contacts.newton
    reset_chain(chain)
    factor_chain(chain)
    for a in closed:
        for j in range(5):
            P = solution.impulse[a, j]
            newton.iterate[a, j] = P if math.isfinite(P) else 0.0
            solution.impulse[a, j] = 0.0
    anchor_at_iterate(laws, closed, contacts)
    end_twists(closed, contacts, chain)
    use_share(1.0, closed, contacts)
    free = power(closed, contacts)
    end_twists(closed, contacts, chain)
    whole = power(closed, contacts)
    if not whole <= 0.0:
        use_share(free / (free - whole) if free < 0.0 else 0.0, closed, contacts)
        end_twists(closed, contacts, chain)
    return natural_map(laws, closed, contacts, 0.0)


@inlined
def use_share(share: float, closed: Array, contacts: Contacts) -> None:
    """Fill the impulses with a share of the anchors."""
    for a in closed:
        for j in range(5):
            contacts.solution.impulse[a, j] = share * contacts.newton.anchor[a, j]

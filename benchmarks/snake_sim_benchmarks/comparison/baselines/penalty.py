# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Regularized contact, compiled: spring-dampers and smooth friction, in a semi-implicit Euler step.

Most simulators used such laws before set-valued ones, and many still do. A contact is a spring
with a damper that can only push, and friction is a smooth function of the sliding velocity, zero
at rest. A robot on a slope therefore creeps, it sinks into the floor, and the stiffness of springs
that do not belong to the robot limits the step.
"""

import math
from typing import NamedTuple

from snake_sim_ros.contact.contacts import Contacts
from snake_sim_ros.contact.delassus import end_twists
from snake_sim_ros.contact.laws import grip, Laws, natural_map, sliding_disc
from snake_sim_ros.contact.problem import ContactHistory, Outcome, Problem, solve_contacts
from snake_sim_ros.dynamics.articulated_body import factor_chain, reset_chain
from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.scene.parameters import Array

BOUND = 1e9  # natural_map may return bounds up to this, since no iteration stops by them [m/s]


class PenaltyLaw(NamedTuple):
    """The numbers of `integrators.Penalty`; compiled functions take this record as `law`."""

    rational: bool  # whether phi is s/(1 + s), not tanh(s)
    sliding_velocity: float  # [m/s]
    stiffness: float  # [N/m]
    damping_ratio: float


@inlined
def share_over_speed(rational: bool, s: float) -> float:
    """Return phi(s)/s: the share of Coulomb friction that acts, over the sliding velocity s."""
    if rational:
        return 1.0 / (1.0 + s)
    return math.tanh(s) / s if s > 1e-8 else 1.0  # below, 1 - s^2/3 is 1 to rounding


@compiled
def penalty_forces(
    law: PenaltyLaw, laws: Laws, closed: Array, contacts: Contacts, mass: Array
) -> None:
    """
    Fill contacts.solution.impulse with contact forces [N], from gaps and velocities.

    The laws are those of `integrators.Penalty`; m is the mass of the link in contact, of `mass`
    (n,) [kg]. As eps goes to 0, friction becomes the sliding law of the ellipse.
    """
    geometry, solution = contacts.geometry, contacts.solution
    for a in closed:
        gap, half_mass = geometry.gap[a], 0.5 * mass[geometry.link[a]]
        damping = 2.0 * law.damping_ratio * math.sqrt(law.stiffness * half_mass)
        push = (
            max(0.0, -law.stiffness * gap - damping * solution.gamma[a, 0]) if gap < 0.0 else 0.0
        )
        disc = sliding_disc(laws, laws.other, a, -solution.gamma[a, 1])
        grips = push * grip(laws.other, contacts, a)
        x, y = disc.mu_x * solution.gamma[a, 1], disc.mu_y * solution.gamma[a, 2]
        scale = max(disc.mu_x, disc.mu_y) * law.sliding_velocity
        drag = 0.0
        if scale > 0.0:
            s = math.sqrt(x * x + y * y) / scale
            drag = grips * share_over_speed(law.rational, s) / scale
        solution.impulse[a, 0] = push
        solution.impulse[a, 1] = -drag * disc.mu_x * x
        solution.impulse[a, 2] = -drag * disc.mu_y * y
        solution.impulse[a, 3] = solution.impulse[a, 4] = 0.0


@inlined
def make_impulses(dt: float, closed: Array, contacts: Contacts, impulse: Array) -> None:
    """Multiply the forces of the table by dt [s], and copy them to `impulse`, (contacts, 5)."""
    impulse[:] = 0.0
    for a in closed:
        for j in range(3):
            contacts.solution.impulse[a, j] *= dt
            impulse[a, j] = contacts.solution.impulse[a, j]


class Springs(NamedTuple):
    """The regularized law as a solver of steps."""

    law: PenaltyLaw
    mass: Array  # (n,) of the links [kg]
    dt: float  # [s]


@solve_contacts.register(Springs)
@inlined
def solve_with_springs(
    springs: Springs, problem: Problem, history: ContactHistory, limit: int
) -> Outcome:
    """
    Fill contact impulses and the velocities that follow from them; see `problem.solve_contacts`.

    Forces are those of the middle configuration and of the velocities at the start. The residual
    is that of the set-valued laws, for these impulses and the velocities that follow.
    """
    laws, closed, contacts, chain, _, _ = problem
    penalty_forces(springs.law, laws, closed, contacts, springs.mass)
    make_impulses(springs.dt, closed, contacts, history.impulse)
    reset_chain(chain)
    factor_chain(chain)
    end_twists(closed, contacts, chain)
    residual, printed = natural_map(laws, closed, contacts, BOUND)
    return Outcome(1, True, residual, printed, False)

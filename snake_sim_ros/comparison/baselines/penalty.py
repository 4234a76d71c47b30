"""
Regularized contact compiled: spring-dampers and smooth friction, in a semi-implicit Euler step.

What most simulators did before set-valued laws, and many still do: a contact is a spring with a
damper that can only push, and friction is a smooth function of the sliding velocity, zero at rest.
A robot on a slope therefore creeps, it sinks in, and the step is limited by the stiffness of
springs that are not of the robot.
"""

import math
from typing import NamedTuple

from snake_sim_ros.contact.contacts import GAMMA
from snake_sim_ros.contact.contacts import GAP
from snake_sim_ros.contact.contacts import IMPULSE
from snake_sim_ros.contact.contacts import link_of
from snake_sim_ros.contact.contacts import natural_map
from snake_sim_ros.contact.contacts import sliding_disc
from snake_sim_ros.contact.delassus import end_twists
from snake_sim_ros.dynamics.articulated_body import factor_chain
from snake_sim_ros.dynamics.articulated_body import unload_chain
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.compilation import cycle_counter
from snake_sim_ros.dynamics.compilation import merged
from snake_sim_ros.stepping.moreau import begin_step
from snake_sim_ros.stepping.moreau import end_step

BOUND = 1e9  # m/s: a bound of the residual stands for it, which is not what the step stops by


class PenaltyLaw(NamedTuple):
    """The numbers of `integrators.Penalty` as the compiled step takes them."""

    rational: bool
    sliding_velocity: float
    stiffness: float
    damping_ratio: float


@merged
def share_over_speed(rational, s):
    """Return phi(s)/s: how much of Coulomb friction acts, over the sliding velocity."""
    if rational:
        return 1.0 / (1.0 + s)
    return math.tanh(s) / s if s > 1e-8 else 1.0  # there it is 1 - s^2/3, 1 to rounding


@compiled
def penalty_forces(law, laws, contact, table, mass):
    """
    Fill the impulse columns with contact forces [N], from the gaps and velocities of the table.

    ``F_N = max(0, -k g - d gamma_N)`` in contacts with g < 0, where ``d = 2 zeta sqrt(k m/2)`` for
    a link of mass m, and ``F_T = -F_N diag(mu) w/|w| phi(|w|/(mu_max eps))`` for ``w = diag(mu)
    gamma_T``: as eps goes to 0, the sliding law of the ellipse.
    """
    for a in contact:
        gap, half_mass = table[a, GAP], 0.5 * mass[link_of(laws.other, table, len(mass), a)]
        damping = 2.0 * law.damping_ratio * math.sqrt(law.stiffness * half_mass)
        push = max(0.0, -law.stiffness * gap - damping * table[a, GAMMA]) if gap < 0.0 else 0.0
        disc = sliding_disc(laws, laws.other, a)
        x, y = disc.mu_x * table[a, GAMMA + 1], disc.mu_y * table[a, GAMMA + 2]
        scale = max(disc.mu_x, disc.mu_y) * law.sliding_velocity
        drag = 0.0
        if scale > 0.0:
            s = math.sqrt(x * x + y * y) / scale
            drag = push * share_over_speed(law.rational, s) / scale
        table[a, IMPULSE] = push
        table[a, IMPULSE + 1] = -drag * disc.mu_x * x
        table[a, IMPULSE + 2] = -drag * disc.mu_y * y
        table[a, IMPULSE + 3] = table[a, IMPULSE + 4] = 0.0


@merged
def make_impulses(dt, contact, table, impulse):
    """Turn the forces of the table into impulses, and fill those of all contacts."""
    impulse[:] = 0.0
    for a in contact:
        for j in range(3):
            table[a, IMPULSE + j] *= dt
            impulse[a, j] = table[a, IMPULSE + j]


@compiled
def advance(law, model, work, q, u, history, angle, rate, report, cycles):
    """
    Advance q, u and history in place by one step a reference; see `spatial.SpatialStepper`.

    Forces are those of the middle configuration and of the velocities at the start. The residual
    says how far they and the velocities they lead to are from the set-valued laws.
    """
    for k in range(len(angle)):
        cycles[k] = cycle_counter()
        count, laws = begin_step(model, work, q, u, history[0], angle[k], rate[k])
        contact = work.contact[:count]
        penalty_forces(law, laws, contact, work.table, model.mass)
        make_impulses(model.dt, contact, work.table, history[0])
        unload_chain(work.chain)
        factor_chain(work.chain)
        end_twists(contact, work.table, work.chain)
        residual, printed = natural_map(laws, contact, work.table, BOUND)
        outcome = (1, True, residual, printed, False)
        if not end_step(model, work, q, u, history, count, outcome, report):
            break
    cycles[len(angle)] = cycle_counter()

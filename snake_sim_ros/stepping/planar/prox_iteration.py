# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The algorithm of `contact.prox_iteration`, the paper's iteration, in the plane."""

import math
from typing import NamedTuple

from snake_sim_ros.contact.laws import grip, sliding_disc
from snake_sim_ros.contact.natural_map import natural_map
from snake_sim_ros.contact.projections import prox_ellipse, prox_half_line
from snake_sim_ros.contact.prox_iteration import copy_impulses
from snake_sim_ros.contact.solver import Outcome
from snake_sim_ros.dynamics.compilation import inlined, merged
from snake_sim_ros.stepping.planar import equilibrium
from snake_sim_ros.stepping.planar.solver import solve_in_plane


@merged
def prox_friction(model, work, impulse):
    """Fill impulse as `contact.prox_iteration.prox_sweep` does, for known loads."""
    laws, contacts = model.laws, work.contacts
    normal = sliding = 0.0
    for a in work.closed:
        P_N, P_x, P_y = contacts.impulse[a, 0], contacts.impulse[a, 1], contacts.impulse[a, 2]
        radius = prox_half_line(P_N)
        radius *= grip(laws.other, contacts, a)
        x, y = P_x - laws.r_T * contacts.gamma[a, 1], P_y - laws.r_T * contacts.gamma[a, 2]
        disc = sliding_disc(laws, laws.other, a, x)
        new_x, new_y = prox_ellipse(x, y, disc.mu_x * radius, disc.mu_y * radius)
        normal += (P_N - impulse[a, 0]) ** 2
        sliding += (new_x - P_x) ** 2 + (new_y - P_y) ** 2
        impulse[a, 0], impulse[a, 1], impulse[a, 2] = P_N, new_x, new_y
    return math.sqrt(normal) + math.sqrt(sliding)


@merged
def project_in_plane(model, work, impulse, limit):
    """Iterate until the friction laws hold, with loads that follow from the friction."""
    equilibrium.factor_bare(work)
    iterations, change = 0, math.inf
    while not change < model.tolerance and iterations < limit:
        copy_impulses(work.closed, impulse, work.contacts)
        equilibrium.planar_twists(model, work)
        equilibrium.find_loads(model, work)
        change = prox_friction(model, work, impulse)
        iterations += 1
    residual, printed = natural_map(model.laws, work.closed, work.contacts, 0.0)
    return Outcome(iterations, change < model.tolerance, residual, printed, False)


class PlanarProxIteration(NamedTuple):
    """The paper's iteration; it needs no arrays of its own."""

    no_arrays: None = None


@solve_in_plane.register(PlanarProxIteration)
@inlined
def solve_plane_with_projections(solver, model, work, closed, history, limit):
    """Solve the contacts of a step; see `solver.solve_in_plane`."""
    return project_in_plane(model, work, history.impulse, limit)

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The algorithm of `contact.gauss_seidel` in the plane."""

from typing import NamedTuple

from snake_sim_ros.contact.delassus import condensed_velocities, Delassus
from snake_sim_ros.contact.laws import grip
from snake_sim_ros.contact.natural_map import natural_map
from snake_sim_ros.contact.projections import prox_half_line
from snake_sim_ros.contact.prox_iteration import copy_impulses
from snake_sim_ros.contact.solver import Outcome
from snake_sim_ros.contact.sweeps import project_sliding
from snake_sim_ros.dynamics.compilation import inlined, merged
from snake_sim_ros.stepping.planar import equilibrium
from snake_sim_ros.stepping.planar.solver import solve_in_plane


@merged
def sweep_in_plane(model, work, delassus, impulse, limit):
    """
    Sweep until the friction laws hold, with loads that follow from the friction.

    They follow by half of their change: the load of a nearly straight robot changes by more than
    its friction, and both would oscillate.
    """
    closed, contacts = work.closed, work.contacts
    tolerance, rows = model.residual_tolerance, 3 * len(closed)
    equilibrium.factor_bare(work)
    equilibrium.condense_sliding(model, work, delassus)
    iterations = 0
    while True:
        copy_impulses(closed, impulse, contacts)
        condensed_velocities(closed, 3, contacts, delassus)
        equilibrium.find_loads(model, work)
        residual, printed = natural_map(model.laws, closed, contacts, tolerance)
        if residual <= tolerance or iterations >= limit:
            break
        for k, a in enumerate(closed):
            last = impulse[a, 0] if impulse[a, 0] > 0.0 else contacts.impulse[a, 0]
            impulse[a, 0] = 0.5 * (last + contacts.impulse[a, 0])
            radius = prox_half_line(impulse[a, 0]) * grip(model.laws.other, contacts, a)
            G, gamma = delassus.operator, delassus.packed
            project_sliding(model.laws, G, gamma, rows, 3 * k, impulse, a, radius)
        iterations += 1
    equilibrium.planar_twists(model, work)
    for a in closed:
        impulse[a, 0] = contacts.impulse[a, 0]
    return Outcome(iterations, residual <= tolerance, residual, printed, False)


class PlanarGaussSeidel(NamedTuple):
    """Projected Gauss-Seidel iteration on the Delassus operator, with its arrays."""

    delassus: Delassus


@solve_in_plane.register(PlanarGaussSeidel)
@inlined
def solve_plane_with_sweeps(solver, model, work, closed, history, limit):
    """Solve the contacts of a step; see `solver.solve_in_plane`."""
    return sweep_in_plane(model, work, solver.delassus, history.impulse, limit)

"""Projected Gauss-Seidel iteration in the plane."""

from snake_sim_ros.contact.contacts import IMPULSE
from snake_sim_ros.contact.contacts import natural_map
from snake_sim_ros.contact.delassus import condensed_velocities
from snake_sim_ros.contact.gauss_seidel import project_sliding
from snake_sim_ros.contact.projections import prox_half_line
from snake_sim_ros.contact.prox_iteration import load
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.compilation import cycle_counter
from snake_sim_ros.dynamics.compilation import merged
from snake_sim_ros.stepping.planar import equilibrium
from snake_sim_ros.stepping.planar import moreau as planar


@merged
def iterate_in_plane(model, work, delassus, impulse):
    """
    Sweep as `iterate` does, in the plane: the loads follow from the friction.

    They follow by half, since the load of a nearly straight robot answers to its friction with
    more than that, so that both would go to and fro.
    """
    contact, table = work.contact, work.table
    tolerance, rows = model.residual_tolerance, 3 * len(contact)
    equilibrium.factor_bare(work)
    equilibrium.condense(model, work, delassus)
    iterations = 0
    while True:
        load(contact, impulse, table)
        condensed_velocities(contact, 3, table, delassus)
        equilibrium.find_loads(model, work)
        residual, printed = natural_map(model.laws, contact, table, tolerance)
        if residual <= tolerance or iterations >= model.iteration_limit:
            break
        for k, a in enumerate(contact):
            last = impulse[a, 0] if impulse[a, 0] > 0.0 else table[a, IMPULSE]
            impulse[a, 0] = 0.5 * (last + table[a, IMPULSE])
            radius = prox_half_line(impulse[a, 0])
            G, gamma = delassus.operator, delassus.packed
            project_sliding(model.laws, G, gamma, rows, 3 * k, impulse, a, radius)
        iterations += 1
    equilibrium.end_twists(model, work)
    for a in contact:
        impulse[a, 0] = table[a, IMPULSE]
    return iterations, residual <= tolerance, residual, printed, False


@compiled
def advance_in_plane(delassus, model, work, q, u, history, angle, rate, report, cycles):
    """Advance q, u and history in place by one step a reference; see `planar_stepper`."""
    for k in range(len(angle)):
        cycles[k] = cycle_counter()
        count = planar.begin_step(model, work, q, u, angle[k], rate[k])
        outcome = iterate_in_plane(model, work, delassus, history[0])
        if not planar.end_step(model, work, q, u, history, count, outcome, report):
            break
    cycles[len(angle)] = cycle_counter()

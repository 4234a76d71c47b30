"""The paper's iteration in the plane."""

import math

from snake_sim_ros.contact.contacts import GAMMA
from snake_sim_ros.contact.contacts import IMPULSE
from snake_sim_ros.contact.contacts import natural_map
from snake_sim_ros.contact.projections import prox_ellipse
from snake_sim_ros.contact.projections import prox_half_line
from snake_sim_ros.contact.prox_iteration import load
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.compilation import cycle_counter
from snake_sim_ros.dynamics.compilation import merged
from snake_sim_ros.stepping.planar import equilibrium
from snake_sim_ros.stepping.planar import moreau as planar


@merged
def prox_friction(model, work, impulse):
    """Fill impulse as `prox_sweep` does, with loads that are known."""
    laws, table = model.laws, work.table
    normal = sliding = 0.0
    for a in work.contact:
        P_N, P_x, P_y = table[a, IMPULSE], table[a, IMPULSE + 1], table[a, IMPULSE + 2]
        radius = prox_half_line(P_N)
        new_x, new_y = prox_ellipse(
            P_x - laws.r_T * table[a, GAMMA + 1],
            P_y - laws.r_T * table[a, GAMMA + 2],
            laws.sliding.mu_x * radius,
            laws.sliding.mu_y * radius,
        )
        normal += (P_N - impulse[a, 0]) ** 2
        sliding += (new_x - P_x) ** 2 + (new_y - P_y) ** 2
        impulse[a, 0], impulse[a, 1], impulse[a, 2] = P_N, new_x, new_y
    return math.sqrt(normal) + math.sqrt(sliding)


@merged
def iterate_in_plane(model, work, impulse):
    """Iterate as `iterate` does, in the plane: the loads follow from the friction."""
    equilibrium.factor_bare(work)
    iterations, change = 0, math.inf
    while not change < model.tolerance and iterations < model.iteration_limit:
        load(work.contact, impulse, work.table)
        equilibrium.end_twists(model, work)
        equilibrium.find_loads(model, work)
        change = prox_friction(model, work, impulse)
        iterations += 1
    residual, printed = natural_map(model.laws, work.contact, work.table, 0.0)
    return iterations, change < model.tolerance, residual, printed, False


@compiled
def advance_in_plane(model, work, q, u, history, angle, rate, report, cycles):
    """Advance q, u and history in place by one step a reference; see `planar_stepper`."""
    for k in range(len(angle)):
        cycles[k] = cycle_counter()
        count = planar.begin_step(model, work, q, u, angle[k], rate[k])
        outcome = iterate_in_plane(model, work, history[0])
        if not planar.end_step(model, work, q, u, history, count, outcome, report):
            break
    cycles[len(angle)] = cycle_counter()

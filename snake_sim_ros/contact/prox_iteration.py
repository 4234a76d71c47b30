"""The paper's iteration compiled: projections of all contacts at once, eqs. (84)-(93)."""

import math

from snake_sim_ros.contact.contacts import CENTER
from snake_sim_ros.contact.contacts import GAMMA
from snake_sim_ros.contact.contacts import IMPULSE
from snake_sim_ros.contact.contacts import natural_map
from snake_sim_ros.contact.contacts import rolling_disc
from snake_sim_ros.contact.contacts import sliding_disc
from snake_sim_ros.contact.delassus import condense
from snake_sim_ros.contact.delassus import condensed_velocities
from snake_sim_ros.contact.delassus import end_twists
from snake_sim_ros.contact.projections import prox_disc
from snake_sim_ros.contact.projections import prox_ellipse
from snake_sim_ros.contact.projections import prox_half_line
from snake_sim_ros.dynamics.articulated_body import factor_chain
from snake_sim_ros.dynamics.articulated_body import unload_chain
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.compilation import cycle_counter
from snake_sim_ros.dynamics.compilation import merged
from snake_sim_ros.stepping.moreau import begin_step
from snake_sim_ros.stepping.moreau import end_step

# Most impulse components of a contact problem that is condensed: for larger ones it does not pay.
CONDENSED = 48


@compiled
def load(contact, impulse, table):
    """Fill the impulses of the table."""
    for a in contact:
        for j in range(5):
            table[a, IMPULSE + j] = impulse[a, j]


@merged
def prox_sweep(laws, contact, table, impulse):
    """
    Fill impulse with one projection of the impulses in the table, eqs. (87)-(89).

    The sliding and rolling sets take the new normal impulse. The left side of the stopping rule
    (93) is returned [N s].
    """
    normal = sliding = rolling = 0.0
    for a in contact:
        P_N, P_x, P_y = table[a, IMPULSE], table[a, IMPULSE + 1], table[a, IMPULSE + 2]
        rule = laws.compliance * (P_N - table[a, CENTER])
        new = prox_half_line(P_N - laws.r_N * (table[a, GAMMA] + rule))
        disc = sliding_disc(laws, laws.other, a)
        new_x, new_y = prox_ellipse(
            P_x - laws.r_T * table[a, GAMMA + 1],
            P_y - laws.r_T * table[a, GAMMA + 2],
            disc.mu_x * new,
            disc.mu_y * new,
        )
        normal += (new - P_N) ** 2
        sliding += (new_x - P_x) ** 2 + (new_y - P_y) ** 2
        impulse[a, 0], impulse[a, 1], impulse[a, 2] = new, new_x, new_y
        P_x, P_y = table[a, IMPULSE + 3], table[a, IMPULSE + 4]
        new_x = new_y = 0.0
        if laws.rolling.mu_x > 0.0:
            new_x, new_y = prox_disc(
                P_x - laws.r_V * table[a, GAMMA + 3],
                P_y - laws.r_V * table[a, GAMMA + 4],
                rolling_disc(laws, laws.other, a).mu_x * new,
            )
        rolling += (new_x - P_x) ** 2 + (new_y - P_y) ** 2
        impulse[a, 3], impulse[a, 4] = new_x, new_y
    return math.sqrt(normal) + math.sqrt(sliding) + math.sqrt(rolling)


@merged
def iterate(laws, tolerance, limit, contact, table, chain, delassus, impulse):
    """
    Iterate impulse and twists until the contact laws hold; return what `moreau.end_step` takes.

    The residual is that of the impulses before the last projection, those of the twists.
    """
    unload_chain(chain)
    factor_chain(chain)
    width = 5 if laws.rolling.mu_x > 0.0 else 3
    columns = width * len(contact)
    condensed = False
    iterations, change = 0, math.inf
    while not change < tolerance and iterations < limit:
        if 0 < iterations == columns <= len(delassus.packed):
            # After as many sweeps as the Delassus operator has columns, forming it costs no more
            # than was spent, and a sweep costs less from here on. The iterates stay the same.
            condense(contact, width, table, chain, delassus)
            condensed = True
        load(contact, impulse, table)
        if condensed:
            condensed_velocities(contact, width, table, delassus)
        else:
            end_twists(contact, table, chain)
        change = prox_sweep(laws, contact, table, impulse)
        iterations += 1
    if condensed:
        end_twists(contact, table, chain)
    residual, printed = natural_map(laws, contact, table, 0.0)
    return iterations, change < tolerance, residual, printed, False


@compiled
def advance(delassus, model, work, q, u, history, angle, rate, report, cycles):
    """Advance q, u and history in place by one step a reference; see `spatial.SpatialStepper`."""
    for k in range(len(angle)):
        cycles[k] = cycle_counter()
        count, laws = begin_step(model, work, q, u, history[0], angle[k], rate[k])
        outcome = iterate(
            laws, model.tolerance, model.iteration_limit,
            work.contact[:count], work.table, work.chain, delassus, history[0],
        )  # fmt: skip
        if not end_step(model, work, q, u, history, count, outcome, report):
            break
    cycles[len(angle)] = cycle_counter()

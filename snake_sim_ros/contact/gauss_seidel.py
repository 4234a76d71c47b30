"""
Projected Gauss-Seidel iteration on the condensed contact problem, one contact after the other.

The projections are those of the paper's iteration, eqs. (87)-(89), with prox parameters from the
Delassus operator, 1/G_kk, and with the velocities that the impulses before have made [1].

.. [1] F. Jourdan, P. Alart, M. Jean, "A Gauss-Seidel like algorithm to solve frictional contact
   problems", 1998.
"""

import math

from snake_sim_ros.contact.contacts import CENTER
from snake_sim_ros.contact.contacts import natural_map
from snake_sim_ros.contact.contacts import rolling_disc
from snake_sim_ros.contact.contacts import sliding_disc
from snake_sim_ros.contact.delassus import condense
from snake_sim_ros.contact.delassus import condensed_velocities
from snake_sim_ros.contact.delassus import end_twists
from snake_sim_ros.contact.projections import prox_disc
from snake_sim_ros.contact.projections import prox_ellipse
from snake_sim_ros.contact.projections import prox_half_line
from snake_sim_ros.contact.prox_iteration import load
from snake_sim_ros.dynamics.articulated_body import factor_chain
from snake_sim_ros.dynamics.articulated_body import unload_chain
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.compilation import cycle_counter
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.compilation import merged
from snake_sim_ros.stepping.moreau import begin_step
from snake_sim_ros.stepping.moreau import end_step


@merged
def sweep(laws, contact, width, table, delassus, impulse):
    """Project the impulse of every closed contact once, with the velocities of that moment."""
    G, gamma, rows = delassus.operator, delassus.packed, width * len(contact)
    for k, a in enumerate(contact):
        row = width * k
        P_N = project_normal(laws, G, gamma, rows, row, table, impulse, a)
        project_sliding(laws, G, gamma, rows, row, impulse, a, P_N)
        if width == 5:
            r = 1.0 / largest_eigenvalue(G, row + 3)
            x, y = impulse[a, 3] - r * gamma[row + 3], impulse[a, 4] - r * gamma[row + 4]
            x, y = prox_disc(x, y, rolling_disc(laws, laws.other, a).mu_x * P_N)
            put(G, gamma, rows, row + 3, impulse, a, 3, x)
            put(G, gamma, rows, row + 4, impulse, a, 4, y)
        else:
            impulse[a, 3] = impulse[a, 4] = 0.0


@inlined
def project_normal(laws, G, gamma, rows, row, table, impulse, a):
    """Project and return the normal impulse of contact a, whose rows begin at `row`."""
    P_N = impulse[a, 0]
    r = 1.0 / (G[row, row] + laws.compliance)
    rule = laws.compliance * (P_N - table[a, CENTER])
    P_N = prox_half_line(P_N - r * (gamma[row] + rule))
    put(G, gamma, rows, row, impulse, a, 0, P_N)
    return P_N


@compiled
def project_sliding(laws, G, gamma, rows, row, impulse, a, P_N):
    """Project the sliding impulse of contact a, whose rows begin at `row`."""
    r = 1.0 / largest_eigenvalue(G, row + 1)
    x, y = impulse[a, 1] - r * gamma[row + 1], impulse[a, 2] - r * gamma[row + 2]
    disc = sliding_disc(laws, laws.other, a)
    x, y = prox_ellipse(x, y, disc.mu_x * P_N, disc.mu_y * P_N)
    put(G, gamma, rows, row + 1, impulse, a, 1, x)
    put(G, gamma, rows, row + 2, impulse, a, 2, y)


@compiled
def put(G, gamma, rows, column, impulse, a, j, P):
    """Set an impulse, and add what its change does to all velocities."""
    change = P - impulse[a, j]
    impulse[a, j] = P
    if change != 0.0:
        for row in range(rows):
            gamma[row] += G[column, row] * change


@compiled
def largest_eigenvalue(G, k):
    """Return the larger eigenvalue of the 2x2 block of G at k."""
    half, off = 0.5 * (G[k, k] - G[k + 1, k + 1]), G[k, k + 1]
    return 0.5 * (G[k, k] + G[k + 1, k + 1]) + math.sqrt(half * half + off * off)


@merged
def iterate(laws, tolerance, limit, contact, table, chain, delassus, impulse):
    """Sweep until the contact laws hold; return what `moreau.end_step` takes."""
    unload_chain(chain)
    factor_chain(chain)
    width = 5 if laws.rolling.mu_x > 0.0 else 3
    condense(contact, width, table, chain, delassus)
    iterations = 0
    while True:
        load(contact, impulse, table)
        condensed_velocities(contact, width, table, delassus)  # anew: rounding does not add up
        residual, printed = natural_map(laws, contact, table, tolerance)
        if residual <= tolerance or iterations >= limit:
            break
        sweep(laws, contact, width, table, delassus, impulse)
        iterations += 1
    end_twists(contact, table, chain)
    return iterations, residual <= tolerance, residual, printed, False


@compiled
def advance(delassus, model, work, q, u, history, angle, rate, report, cycles):
    """Advance q, u and history in place by one step a reference; see `spatial.SpatialStepper`."""
    for k in range(len(angle)):
        cycles[k] = cycle_counter()
        count, laws = begin_step(model, work, q, u, history[0], angle[k], rate[k])
        outcome = iterate(
            laws, model.residual_tolerance, model.iteration_limit,
            work.contact[:count], work.table, work.chain, delassus, history[0],
        )  # fmt: skip
        if not end_step(model, work, q, u, history, count, outcome, report):
            break
    cycles[len(angle)] = cycle_counter()

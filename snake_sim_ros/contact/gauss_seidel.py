# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Projected Gauss-Seidel iteration on the condensed contact problem, contact by contact.

The projections are those of the paper's iteration, eqs. (87)-(89). The prox parameters follow from
the Delassus operator, 1/G_kk, and the velocities contain all impulses found so far [1].

.. [1] F. Jourdan, P. Alart, M. Jean, "A Gauss-Seidel like algorithm to solve frictional contact
   problems", 1998.
"""

import math
from typing import NamedTuple

from snake_sim_ros.contact.admissible import without_gain
from snake_sim_ros.contact.condensing import condense
from snake_sim_ros.contact.delassus import condensed_twists
from snake_sim_ros.contact.delassus import condensed_velocities
from snake_sim_ros.contact.delassus import Delassus
from snake_sim_ros.contact.laws import grip
from snake_sim_ros.contact.laws import rolling_disc
from snake_sim_ros.contact.laws import sliding_disc
from snake_sim_ros.contact.natural_map import natural_map
from snake_sim_ros.contact.projections import prox_disc
from snake_sim_ros.contact.projections import prox_ellipse
from snake_sim_ros.contact.projections import prox_half_line
from snake_sim_ros.contact.prox_iteration import copy_impulses
from snake_sim_ros.contact.prox_iteration import forget_open
from snake_sim_ros.contact.solver import Outcome
from snake_sim_ros.contact.solver import solve
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.compilation import merged


@merged
def sweep(laws, closed, width, contacts, delassus, impulse):
    """Project the impulse of every closed contact once, with the velocities of that moment."""
    G, gamma, rows = delassus.operator, delassus.packed, width * len(closed)
    for k, a in enumerate(closed):
        row = width * k
        P_N = project_normal(laws, G, gamma, rows, row, contacts, impulse, a)
        radius = grip(laws.other, contacts, a) * P_N
        project_sliding(laws, G, gamma, rows, row, impulse, a, radius)
        if width == 5:
            r = 1.0 / largest_eigenvalue(G, row + 3)
            x, y = impulse[a, 3] - r * gamma[row + 3], impulse[a, 4] - r * gamma[row + 4]
            x, y = prox_disc(x, y, rolling_disc(laws, laws.other, a).mu_x * radius)
            set_impulse(G, gamma, rows, row + 3, impulse, a, 3, x)
            set_impulse(G, gamma, rows, row + 4, impulse, a, 4, y)
        else:
            impulse[a, 3] = impulse[a, 4] = 0.0


@inlined
def project_normal(laws, G, gamma, rows, row, contacts, impulse, a):
    """
    Project and return the normal impulse of contact a [N s].

    Parameters
    ----------
    laws : Laws
    G : ndarray, shape (c, c)
        Delassus operator [1/kg].
    gamma : ndarray, shape (c,)
        Velocities of the closed contacts [m/s]; kept up to date.
    rows : int
        Number of rows of G in use.
    row : int
        First row of contact a.
    contacts : record array, shape (contacts,)
        Table of contacts; its selection centers are read.
    impulse : ndarray, shape (contacts, 5)
        Impulses [N s]; that of contact a is replaced.
    a : int
        Number of the contact.

    """
    P_N = impulse[a, 0]
    r = 1.0 / (G[row, row] + laws.compliance)
    rule = laws.compliance * (P_N - contacts.selection_center[a])
    P_N = prox_half_line(P_N - r * (gamma[row] + rule))
    set_impulse(G, gamma, rows, row, impulse, a, 0, P_N)
    return P_N


@compiled
def project_sliding(laws, G, gamma, rows, row, impulse, a, radius):
    """
    Project the sliding impulse of contact a.

    Parameters are those of `project_normal`; `radius` is the normal impulse of the contact times
    its grip [N s].
    """
    r = 1.0 / largest_eigenvalue(G, row + 1)
    x, y = impulse[a, 1] - r * gamma[row + 1], impulse[a, 2] - r * gamma[row + 2]
    disc = sliding_disc(laws, laws.other, a, x)
    x, y = prox_ellipse(x, y, disc.mu_x * radius, disc.mu_y * radius)
    set_impulse(G, gamma, rows, row + 1, impulse, a, 1, x)
    set_impulse(G, gamma, rows, row + 2, impulse, a, 2, y)


@compiled
def set_impulse(G, gamma, rows, column, impulse, a, j, P):
    """
    Set component j of the impulse of contact a to P, and update the velocities for the change.

    Other parameters are those of `project_normal`; `column` is the row and column of the component
    in G.
    """
    change = P - impulse[a, j]
    impulse[a, j] = P
    if change != 0.0:
        for row in range(rows):
            gamma[row] += G[column, row] * change


@compiled
def largest_eigenvalue(G, k):
    """Return the larger eigenvalue of the 2x2 block of G that begins at k."""
    half, off = 0.5 * (G[k, k] - G[k + 1, k + 1]), G[k, k + 1]
    return 0.5 * (G[k, k] + G[k + 1, k + 1]) + math.sqrt(half * half + off * off)


@inlined
def keep_impulses(closed, contacts, impulse):
    """Fill the impulses of closed contacts, of shape (contacts, 5) [N s], with those used."""
    for a in closed:
        for j in range(5):
            impulse[a, j] = contacts.impulse[a, j]


class GaussSeidel(NamedTuple):
    """Projected Gauss-Seidel iteration, with the arrays of the Delassus operator."""

    delassus: Delassus


@solve.register(GaussSeidel)
@inlined
def solve_with_sweeps(solver, model, problem, history, limit):
    """Sweep until the contact laws hold; see `solver.solve`."""
    laws, closed, contacts, chain = problem
    delassus, impulse, tolerance = solver.delassus, history.impulse, model.residual_tolerance
    width = 5 if laws.rolling.mu_x > 0.0 else 3
    condense(closed, width, contacts, chain, delassus)
    iterations = 0
    while True:
        copy_impulses(closed, impulse, contacts)
        condensed_velocities(closed, width, contacts, delassus)  # anew: rounding does not add up
        residual, printed = natural_map(laws, closed, contacts, tolerance)
        if residual <= tolerance or iterations >= limit:
            break
        sweep(laws, closed, width, contacts, delassus, impulse)
        iterations += 1
    condensed_twists(closed, width, contacts, chain, delassus)
    outcome = Outcome(iterations, residual <= tolerance, residual, printed, False)
    outcome = without_gain(problem, outcome)
    if not outcome.converged:  # others may be in the table now
        keep_impulses(closed, contacts, impulse)
    forget_open(closed, contacts, impulse)
    return outcome

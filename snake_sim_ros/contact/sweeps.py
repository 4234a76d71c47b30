# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Projections of single contacts on the Delassus operator, with up-to-date velocities."""

import math

from snake_sim_ros.contact.laws import grip, rolling_disc, sliding_disc
from snake_sim_ros.contact.projections import prox_disc, prox_ellipse, prox_half_line
from snake_sim_ros.dynamics.compilation import compiled, inlined, merged


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

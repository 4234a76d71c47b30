# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How gaps are closed by a move of the configuration alone.

Contacts that carry load have no gap, but a step leaves one of the size of its error. The twists
that remove it within a time h are the response of the chain to fictitious normal impulses nu,
``G_NN nu = -g/h``. They move the coordinates and change no velocity, so that closing a gap neither
bounces nor drives a link.
"""

import math

from snake_sim_ros.contact.delassus import eliminate
from snake_sim_ros.contact.linear_problem import solve_linear
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.compilation import merged
from snake_sim_ros.dynamics.free_chain import unfold_free

# The normal directions of a stiff chain may depend on each other. A little compliance, relative to
# the Delassus operator, then leaves the smallest impulses.
COMPLIANCE = 1e-7


@merged
def close_gaps(operator, problem, h):
    """
    Fill the twists of the chain with those that close the end gaps of contacts in a time h [s].

    The contacts are those of the closed ones whose `S_N` is 1 instead of 0.

    Parameters
    ----------
    operator : Operator
        As `newton.prepare_contacts` left it.
    problem : Problem
        Momentum and torques of its chain are set to 0, if the contacts are not condensed.
    h : float
        Time for which the twists move the links [s].

    """
    if operator.is_condensed[0]:
        close_condensed(problem.closed, problem.contacts, problem.chain, operator.delassus, h)
    else:
        close_on_links(problem, h)


@inlined
def close_condensed(closed, contacts, chain, delassus, h):
    """Do what `close_gaps` does with the Delassus operator."""
    B, G, load, X = delassus.system, delassus.operator, chain.free.end_load, delassus.loads
    depth, middle = delassus.depth, 6 + 2 * ((len(chain.axis) + 1) // 2)
    count = 0
    for a in closed:
        if contacts.S_N[a] > 0.0:
            column, row = contacts.row[a], 0
            for b in closed:
                if contacts.S_N[b] > 0.0:
                    B[row, count] = G[contacts.row[b], column]
                    row += 1
            B[count, count] *= 1.0 + COMPLIANCE
            count += 1
    row = 0
    for a in closed:
        if contacts.S_N[a] > 0.0:
            B[row, count] = -contacts.end_gap[a] / h
            row += 1
    eliminate(B, count)
    for m in range(len(load)):
        load[m] = 0.0
    row = 0
    for a in closed:
        if contacts.S_N[a] > 0.0:
            column = contacts.row[a]
            for m in range(6 + 2 * depth[column, 0]):
                load[m] += X[column, m] * B[row, count]
            for m in range(middle, middle + 2 * depth[column, 1]):
                load[m] += X[column, m] * B[row, count]
            row += 1
    unfold_free(chain.free, load, chain.twist)


@compiled
def close_on_links(problem, h):
    """Do what `close_gaps` does by a sweep over the chain, with stiff linear laws."""
    laws, closed, contacts, chain = problem
    for i in range(len(chain.momentum)):
        for k in range(6):
            chain.momentum[i, k] = 0.0
    for j in range(len(chain.torque)):
        chain.torque[j, 0] = chain.torque[j, 1] = 0.0
    for a in closed:
        S_N = contacts.S_N[a] / laws.proximal_compliance
        # A sphere that has left its cell has an infinite gap, and nothing to close.
        gap = contacts.end_gap[a] if math.isfinite(contacts.end_gap[a]) else 0.0
        contacts.S_N[a], contacts.trial[a, 0] = S_N, 0.0
        contacts.law_impulse[a, 0] = -S_N * gap / h
        contacts.P_0[a, 0] = contacts.law_impulse[a, 0]
        contacts.shift[a] = 0.0
        for kind in range(2):
            contacts.S_xx[a, kind] = contacts.S_xy[a, kind] = contacts.S_yy[a, kind] = 0.0
            contacts.S_xN[a, kind] = contacts.S_yN[a, kind] = 0.0
        for k in range(1, 5):
            contacts.P_0[a, k] = contacts.law_impulse[a, k] = contacts.trial[a, k] = 0.0
    solve_linear(problem, False)

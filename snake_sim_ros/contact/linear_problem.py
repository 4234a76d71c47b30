# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The contact problem with linear laws, which one Newton iteration solves exactly.

The laws join the inertia of the links (`linear_laws`), and a sweep over the chain solves the
problem. A contact of two links cannot be folded into the inertia of one; `couple_pairs` solves for
such contacts in addition. The alternative is a dense problem with the Delassus operator.
"""

import math

from snake_sim_ros.contact.delassus import condensed_system, eliminate, fill_wrenches
from snake_sim_ros.contact.directions import add_contact_wrench, contact_velocities
from snake_sim_ros.contact.laws_on_links import add_laws
from snake_sim_ros.contact.linear_laws import linear_impulses, linearize
from snake_sim_ros.contact.reduced_problem import reduced_step
from snake_sim_ros.contact.table import SLIDING
from snake_sim_ros.dynamics.articulated_body import (
    correct_chain,
    factor_chain,
    find_residual,
    reset_chain,
    solve_residual,
)
from snake_sim_ros.dynamics.compilation import compiled, inlined, merged

MOST_CORRECTIONS = 4  # of the twists in one linear step
FAR = 1e-4  # a solution that is farther from the trial velocities is not corrected [m/s]
SMALL_CORRECTION = 1e-6  # after it the next one would be rounding [m/s, rad/s]


@inlined
def linear_step(problem, operator, always):
    """
    Fill velocities and impulses with the solution for the laws linear about the trial velocities.

    Parameters
    ----------
    problem : Problem
        Its contacts need trial, anchor, selection_center and disc_radius. Their gamma and impulse
        are filled and, if they are not condensed, the twists of the chain.
    operator : Operator or None
        If it has the contacts of this step, the small dense problem is solved, without the chain.
        Otherwise the chain is solved together with the laws.
    always : bool
        Whether the solution on the chain is corrected for rounding however far it is from the
        trial velocities.

    Returns
    -------
    finite : bool
        Whether the solution is finite.
    exact : bool
        Whether it was corrected for rounding. Usually it is not if it is far from the trial
        velocities, so that another iteration follows anyway.

    """
    laws, closed, contacts, _ = problem
    if operator is not None:
        if operator.is_condensed[0]:
            return reduced_step(laws, closed, contacts, operator.delassus, operator.reduced), True
    linearize(laws, closed, contacts)
    return solve_linear(problem, always)


@merged
def solve_linear(problem, always):
    """Solve the chain together with linear laws; return what `linear_step` returns."""
    laws, closed, contacts, chain = problem
    rolling = laws.rolling.mu_x > 0.0
    reset_chain(chain)
    single = closed[: count_single(closed, contacts, chain.pair_delassus)]
    add_laws(single, contacts, chain.frame, rolling, chain.wrench, chain.inertia)
    factor_chain(chain)
    exact = True
    for k in range(MOST_CORRECTIONS if len(closed) > 0 else 1):  # a chain in the air is not stiff
        if k > 0:  # solve once more for what rounding left
            fill_wrenches(closed, contacts, chain)
            find_residual(chain)
        largest = correct_chain(chain)
        largest = max(
            largest,
            couple_pairs(k > 0, closed[len(single) :], 3, contacts, chain, chain.pair_delassus),
        )
        contact_velocities(closed, contacts, chain.frame, chain.twist)
        linear_impulses(single, contacts, rolling)
        if k == 0 and not always and is_far(single, contacts):
            exact = False
            break
        if k > 0 and not largest > SMALL_CORRECTION:
            break
    return math.isfinite(chain.twist[0, 3] + chain.twist[len(chain.twist) - 1, 3]), exact


@inlined
def is_far(closed, contacts):
    """Return whether a contact velocity is farther than FAR from the trial velocity."""
    farthest = 0.0
    for a in closed:
        for j in range(3):
            farthest = max(farthest, abs(contacts.gamma[a, j] - contacts.trial[a, j]))
    return farthest > FAR


@inlined
def list_pairs_last(closed, contacts, pairs):
    """
    Move the contacts of two links behind all others, as `solve_linear` needs them.

    The order within either kind stays. `pairs` is that of `couple_pairs`.
    """
    if pairs is None:
        return
    count = 0
    for k in range(len(closed)):
        a = closed[k]
        if contacts.other_link[a] < 0:
            for j in range(k, count, -1):
                closed[j] = closed[j - 1]
            closed[count] = a
            count += 1


@inlined
def count_single(closed, contacts, pairs):
    """Return the number of contacts that are not of two links; these are listed last."""
    if pairs is None:
        return len(closed)
    count = len(closed)
    while count > 0 and contacts.other_link[closed[count - 1]] >= 0:
        count -= 1
    return count


@inlined
def couple_pairs(again, closed, width, contacts, chain, pairs):
    """
    Solve for the contacts of links with each other, and add what they do to the twists.

    A sweep over the chain cannot fold the law of such a contact into the inertia of one link.
    Instead the chain is solved for a unit of every component of their impulses, which leaves a
    small dense problem. The impulses are corrected whenever the twists are. If they were solved
    for only once, they would keep what rounding left of the twists, 1e-7 m/s and more, and
    Newton's method would circle there.

    Parameters
    ----------
    again : bool
        Whether the impulses are corrected for what the laws leave at the present twists; if not,
        they are solved for the first time.
    closed : ndarray of int, shape (k,)
        Numbers of the closed contacts of two links.
    width : int
        Components per contact: 3, or 5 with rolling friction.
    contacts : record array, shape (contacts,)
        Table of contacts with linear laws; impulses are filled.
    chain : Chain
        Its twists are added to.
    pairs : Delassus or None
        ``chain.pair_delassus``, an argument of its own so that Numba leaves out the branch on
        None.

    Returns
    -------
    float
        Largest component of a twist that was added.

    """
    if pairs is None or len(closed) == 0:
        return 0.0
    for j in range(len(chain.residual_torque)):
        chain.residual_torque[j, 0] = chain.residual_torque[j, 1] = 0.0
    if not again:
        condense_pairs(closed, width, contacts, chain, pairs)
    contact_velocities(closed, contacts, chain.frame, chain.twist)
    solve_correction(closed, width, contacts, pairs)
    chain.wrench[:] = 0.0
    add_contact_wrench(closed, contacts, chain.frame, chain.wrench)
    add_kept_impulses(closed, width, contacts, pairs)
    return correct_chain(chain)


@compiled
def condense_pairs(closed, width, contacts, chain, pairs):
    """Fill G of the contacts of two links on the factored chain; set their impulses to 0."""
    for a in closed:
        contacts.impulse[a] = 0.0
    for k, a in enumerate(closed):
        for j in range(width):
            row = pairs.operator[width * k + j]
            stiffness = contacts.S_N[a]
            if j > 0:
                stiffness = contacts.S_xx[a, SLIDING] + contacts.S_yy[a, SLIDING]
            if stiffness == 0.0:  # the impulse is 0
                row[: width * len(closed)] = 0.0
                continue
            contacts.impulse[a, j] = 1.0
            chain.wrench[:] = 0.0
            add_contact_wrench(closed[k : k + 1], contacts, chain.frame, chain.wrench)
            contacts.impulse[a, j] = 0.0
            solve_residual(chain)
            contact_velocities(closed, contacts, chain.frame, chain.correction)
            for other, b in enumerate(closed):
                for i in range(width):
                    shift = contacts.shift[b] if i == 0 else 0.0
                    row[width * other + i] = contacts.gamma[b, i] - shift


@compiled
def solve_correction(closed, width, contacts, delassus):
    """
    Fill the impulses with a correction for what the laws leave at the present velocities.

    The dense problem with G is solved. The impulses before are kept in ``delassus.packed``. The
    stiffness of the laws costs as many digits here as it does in the chain, see
    `articulated_body.find_residual`.
    """
    rows = width * len(closed)
    B, packed = delassus.system, delassus.packed
    for k, a in enumerate(closed):
        for j in range(width):
            packed[width * k + j] = contacts.impulse[a, j]
    condensed_system(closed, width, contacts, delassus)
    linear_impulses(closed, contacts, width > 3)
    for k, a in enumerate(closed):
        for j in range(width):
            B[width * k + j, rows] = contacts.impulse[a, j] - packed[width * k + j]
    eliminate(B, rows)
    for k, a in enumerate(closed):
        for j in range(width):
            contacts.impulse[a, j] = B[width * k + j, rows]


@inlined
def add_kept_impulses(closed, width, contacts, delassus):
    """Add the impulses that `solve_correction` kept to its correction."""
    for k, a in enumerate(closed):
        for j in range(width):
            contacts.impulse[a, j] += delassus.packed[width * k + j]

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The exact line search of Newton's method between two iterates.

With held disc radii the contact problem is convex, and the search finds its minimum on the way.
"""

import math

from snake_sim_ros.contact.laws import anchored_disc, grip, rolling_disc
from snake_sim_ros.contact.linear_laws import disc_law, normal_law
from snake_sim_ros.contact.table import FREE
from snake_sim_ros.dynamics.compilation import compiled, inlined


@compiled
def law_error(laws, closed, contacts, fraction):
    """
    Compare impulses and laws at a fraction of the way from the trial to the solution.

    Velocities are between `trial` and `gamma`, impulses between `iterate` and `impulse`. `laws`,
    `closed` and `contacts` are those of a `solver.Problem`; the fraction is from 0 to 1.

    Returns
    -------
    slope : float
        ``sum (P - P(gamma)) . (gamma - trial)``. For held radii it is the derivative of a convex
        function along the way.
    residual : float
        Largest ``|P - P(gamma)|/r`` [m/s].

    """
    slope = normal = sliding = rolling = 0.0
    for a in closed:
        step = contacts.gamma[a, 0] - contacts.trial[a, 0]
        P_N, _ = normal_law(
            laws,
            contacts.selection_center[a],
            contacts.anchor[a, 0],
            contacts.trial[a, 0] + fraction * step,
        )
        radius = P_N if contacts.disc_radius[a] == FREE else contacts.disc_radius[a]
        radius *= grip(laws.other, contacts, a)
        P = contacts.iterate[a, 0]
        d = P + fraction * (contacts.impulse[a, 0] - P) - P_N
        normal = max(normal, abs(d))
        slope += d * step
        disc = anchored_disc(laws, laws.other, contacts, a)
        d, along = disc_law_error(disc, contacts, a, radius, fraction)
        sliding = max(sliding, d)
        slope += along
        if laws.rolling.mu_x > 0.0:
            d, along = disc_law_error(
                rolling_disc(laws, laws.other, a), contacts, a, radius, fraction
            )
            rolling = max(rolling, d)
            slope += along
    return slope, max(normal / laws.r_N, sliding / laws.r_T, rolling / laws.r_V)


@inlined
def disc_law_error(disc, contacts, a, radius, fraction):
    """Return |P - P(gamma)| of one kind of friction at contact a, and its part of the slope."""
    k = disc.column
    x, y = contacts.trial[a, k], contacts.trial[a, k + 1]
    step_x, step_y = contacts.gamma[a, k] - x, contacts.gamma[a, k + 1] - y
    law_x, law_y, _, _, _, _, _ = disc_law(
        disc, contacts.anchor[a, k], contacts.anchor[a, k + 1],
        x + fraction * step_x, y + fraction * step_y, radius,
    )  # fmt: skip
    P_x, P_y = contacts.iterate[a, k], contacts.iterate[a, k + 1]
    d_x = P_x + fraction * (contacts.impulse[a, k] - P_x) - law_x
    d_y = P_y + fraction * (contacts.impulse[a, k + 1] - P_y) - law_y
    return math.sqrt(d_x * d_x + d_y * d_y), d_x * step_x + d_y * step_y


@inlined
def line_search(laws, closed, contacts):
    """
    Return the fraction of the way at which the slope of `law_error` nearly vanishes.

    The fraction is 1 if the slope is still negative at the end of the way, and 0 if it is not
    negative at its start. The method is false position with halved weights (Illinois).
    """
    high, above = 1.0, law_error(laws, closed, contacts, 1.0)[0]
    if not above > 0.0:
        return 1.0
    low, below = 0.0, law_error(laws, closed, contacts, 0.0)[0]
    if not below < 0.0:
        return 0.0
    enough = 0.1 * min(-below, above)
    fraction, side = 0.5, 0
    for _ in range(20):
        fraction = low - below * (high - low) / (above - below)
        slope = law_error(laws, closed, contacts, fraction)[0]
        if abs(slope) <= enough:
            break
        if slope > 0.0:
            high, above = fraction, slope
            below *= 0.5 if side > 0 else 1.0
            side = 1
        else:
            low, below = fraction, slope
            above *= 0.5 if side < 0 else 1.0
            side = -1
    return fraction


@inlined
def move_trial(closed, contacts, fraction):
    """
    Move trial and iterate of the contacts a fraction of the way to the solution.

    `trial` moves toward `gamma`, `iterate` toward `impulse`. The fraction is from 0 to 1.
    """
    for a in closed:
        for j in range(5):
            trial, P = contacts.trial[a, j], contacts.iterate[a, j]
            if fraction == 1.0:  # exact to the last bit
                contacts.trial[a, j], contacts.iterate[a, j] = (
                    contacts.gamma[a, j],
                    contacts.impulse[a, j],
                )
            else:
                contacts.trial[a, j] = trial + fraction * (contacts.gamma[a, j] - trial)
                contacts.iterate[a, j] = P + fraction * (contacts.impulse[a, j] - P)

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The natural-map residual of the contact laws, by which all contact solvers are judged."""

import math

from snake_sim_ros.contact.laws import grip, rolling_disc, sliding_disc
from snake_sim_ros.contact.projections import prox_ellipse
from snake_sim_ros.dynamics.compilation import compiled, inlined


@compiled
def natural_map(laws, closed, contacts, enough):
    """
    Return how far the closed contacts are from their laws, ``max |P - prox_C(P - r gamma)|/r``.

    All solvers are judged by this residual. The sets of sliding and rolling impulses are those of
    the given normal impulse.

    Parameters
    ----------
    laws, closed, contacts
        Those of a `solver.Problem`; impulse, gamma and selection_center of the contacts are read.
    enough : float
        Accuracy that suffices [m/s]. The projection on an ellipse is costly, so an upper bound of
        the sliding residual is returned in its place where the bound is at most `enough`.

    Returns
    -------
    residual : float
        Residual of the laws with the selection rule [m/s]: gamma_N is replaced by
        ``gamma_N + compliance (P_N - selection_center)``.
    printed_residual : float
        Residual of the laws as the paper prints them, without the rule [m/s].

    """
    if enough > 0.0 and laws.rolling.mu_x <= 0.0:
        residual, printed = sliding_bound(laws, laws.other, closed, contacts)
        if residual <= enough:
            return residual, printed
    selected = printed = tangential = 0.0
    for a in closed:
        P_N = contacts.impulse[a, 0]
        x = P_N - laws.r_N * contacts.gamma[a, 0]
        rule = laws.compliance * (P_N - contacts.selection_center[a])
        selected = max(selected, abs(P_N - max(0.0, x - laws.r_N * rule)))
        printed = max(printed, abs(P_N - max(0.0, x)))
        P_x, gamma_x, radius = contacts.impulse[a, 1], contacts.gamma[a, 1], P_N
        radius *= grip(laws.other, contacts, a)
        slide = disc_residual(
            P_x, contacts.impulse[a, 2], gamma_x, contacts.gamma[a, 2],
            sliding_disc(laws, laws.other, a, P_x - laws.r_T * gamma_x), radius, laws.r_T, enough,
        )  # fmt: skip
        tangential = max(tangential, slide)
        if laws.rolling.mu_x > 0.0:
            roll = disc_residual(
                contacts.impulse[a, 3], contacts.impulse[a, 4], contacts.gamma[a, 3],
                contacts.gamma[a, 4], rolling_disc(laws, laws.other, a), radius, laws.r_V, enough,
            )  # fmt: skip
            tangential = max(tangential, roll)
    return max(selected / laws.r_N, tangential), max(printed / laws.r_N, tangential)


@inlined
def sliding_bound(laws, other, closed, contacts):
    """
    Return upper bounds of both results of `natural_map`, or infinity.

    The bounds take one square root per contact. They hold where nothing but `laws.sliding` acts:
    on a flat floor without rolling friction. `other` is ``laws.other``, an argument of its own so
    that Numba leaves out branches on None.
    """
    if other is not None:
        return math.inf, math.inf
    mu_x, mu_y = laws.sliding.mu_x, laws.sliding.mu_y
    over_x, over_y, r = laws.sliding.over_x, laws.sliding.over_y, laws.r_T
    lowest, highest = min(mu_x, mu_y), max(over_x, over_y)
    if lowest <= 0.0:
        return math.inf, math.inf
    weight = r * highest * highest
    selected = printed = slip = stick = 0.0
    for a in closed:
        P_N, P_x, P_y = contacts.impulse[a, 0], contacts.impulse[a, 1], contacts.impulse[a, 2]
        gamma_x, gamma_y = contacts.gamma[a, 1], contacts.gamma[a, 2]
        x = P_N - laws.r_N * contacts.gamma[a, 0]
        rule = laws.compliance * (P_N - contacts.selection_center[a])
        selected = max(selected, abs(P_N - max(0.0, x - laws.r_N * rule)))
        printed = max(printed, abs(P_N - max(0.0, x)))
        x, y = over_x * (P_x - r * gamma_x), over_y * (P_y - r * gamma_y)
        if x * x + y * y <= P_N * P_N:
            stick = max(stick, gamma_x * gamma_x + gamma_y * gamma_y)
        else:  # as in disc_residual; its second part is shorter than its first
            e_x = P_x * over_x - weight * mu_x * gamma_x
            e_y = P_y * over_y - weight * mu_y * gamma_y
            shrink = min(1.0, max(0.0, P_N) / math.sqrt(e_x * e_x + e_y * e_y))
            d_x, d_y = P_x - mu_x * shrink * e_x, P_y - mu_y * shrink * e_y
            slip = max(slip, d_x * d_x + d_y * d_y)
    share = 2.0 - (lowest * min(over_x, over_y)) ** 2
    tangential = max(math.sqrt(stick), share * math.sqrt(slip) / r)
    return max(selected / laws.r_N, tangential), max(printed / laws.r_N, tangential)


@inlined
def disc_residual(P_x, P_y, gamma_x, gamma_y, disc, bound, r, enough):
    """
    Return ``|P - prox(P - r gamma)|/r`` of one kind of friction [m/s], or an upper bound of it.

    The ellipse has the half axes ``mu_x bound`` and ``mu_y bound``. Let e be the point of the
    ellipse S disc, S = diag(mu_x, mu_y), that the disc projection of ``S^-1 P - r/mu_min^2 S
    gamma`` gives. Then P - r gamma lies ``(1 - mu_min^2 S^-2)(P - e)`` beside the normal of the
    ellipse in e. Projections do not expand distances, so the residual is at most the length of
    this vector plus |P - e|. For a disc the sum is |P - e|, which is the residual itself.
    """
    x, y = P_x - r * gamma_x, P_y - r * gamma_y
    mu_x, mu_y, over_x, over_y = disc.mu_x, disc.mu_y, disc.over_x, disc.over_y
    lowest, highest = min(mu_x, mu_y), max(over_x, over_y)
    if lowest > 0.0 and bound > 0.0:
        if (x * over_x) ** 2 + (y * over_y) ** 2 <= bound * bound:
            return math.sqrt(gamma_x * gamma_x + gamma_y * gamma_y)
        weight = r * highest * highest
        e_x = P_x * over_x - weight * mu_x * gamma_x
        e_y = P_y * over_y - weight * mu_y * gamma_y
        shrink = min(1.0, bound / math.sqrt(e_x * e_x + e_y * e_y))
        d_x, d_y = P_x - mu_x * shrink * e_x, P_y - mu_y * shrink * e_y
        b_x, b_y = (1.0 - (lowest * over_x) ** 2) * d_x, (1.0 - (lowest * over_y) ** 2) * d_y
        misfit = (math.sqrt(d_x * d_x + d_y * d_y) + math.sqrt(b_x * b_x + b_y * b_y)) / r
        if misfit <= enough:
            return misfit
    e_x, e_y = prox_ellipse(x, y, mu_x * bound, mu_y * bound)
    return math.sqrt((P_x - e_x) ** 2 + (P_y - e_y) ** 2) / r

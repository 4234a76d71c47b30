# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The contact laws as impulses that follow from velocities, and their linear form in the chain.

With the selection rule a normal impulse is ``P_N = max(0, -gamma_N/compliance)``. A tangential
law is first scaled by its coefficients, S = diag(mu_x, mu_y): the ellipse becomes the disc of
radius P_N, and the law keeps its form. Then ``S^-1 P = prox_disc(S^-1 anchor -
S gamma/epsilon)``. The anchor is the impulse of the last iterate; when it no longer changes, this
is the law itself (proximal point method [1]_), and nothing creeps. In patches of the ground the
radius is P_N times a factor, and where friction differs forward and backward, mu_x follows the
sign of the anchor; see `laws`.

The derivative of the impulses with respect to the velocity adds a 6x6 matrix to the inertia of the
link that a contact touches. The matrix is not symmetric because sliding friction follows the
normal impulse. What remains to be solved is the forward dynamics of a chain, see `linear_problem`.

.. [1] R. T. Rockafellar, "Monotone operators and the proximal point algorithm", 1976.
"""

import math

from snake_sim_ros.contact.laws import anchored_disc, grip, rolling_disc
from snake_sim_ros.contact.table import FREE, ROLLING, SLIDING
from snake_sim_ros.dynamics.compilation import compiled, inlined, merged


@merged
def linearize(laws, closed, contacts):
    """
    Fill the linear laws of the closed contacts, about their trial velocities.

    `laws`, `closed` and `contacts` are those of a `solver.Problem`. The trial, anchor,
    selection_center and disc_radius of the contacts are read; law_impulse, P_0 and S_N to S_yN are
    filled.
    """
    for a in closed:
        P_N, S_N = normal_law(
            laws, contacts.selection_center[a], contacts.anchor[a, 0], contacts.trial[a, 0]
        )
        contacts.law_impulse[a, 0] = P_N
        contacts.P_0[a, 0], contacts.S_N[a] = P_N + S_N * contacts.trial[a, 0], S_N
        factor = grip(laws.other, contacts, a)
        radius, follow = (
            (P_N, S_N) if contacts.disc_radius[a] == FREE else (contacts.disc_radius[a], 0.0)
        )
        radius, follow = factor * radius, factor * follow
        linearize_disc(anchored_disc(laws, laws.other, contacts, a), contacts, a, radius, follow)
        if laws.rolling.mu_x > 0.0:
            linearize_disc(rolling_disc(laws, laws.other, a), contacts, a, radius, follow)


@compiled
def normal_law(laws, center, anchor, gamma):
    """
    Return the normal impulse that follows from a velocity, and its stiffness.

    Parameters
    ----------
    laws : Laws
    center, anchor : float
        Normal impulses that the selection rule and the proximal point method start from [N s].
    gamma : float
        Normal velocity gamma_N [m/s].

    Returns
    -------
    P_N : float
        [N s]
    S_N : float
        Minus the derivative of P_N with respect to gamma_N [kg].

    """
    proximal = (
        0.0 if laws.compliance > 1e-2 * laws.proximal_compliance else laws.proximal_compliance
    )
    stiffness = 1.0 / (laws.compliance + proximal)
    P_N = stiffness * (laws.compliance * center + proximal * anchor - gamma)
    return (P_N, stiffness) if P_N > 0.0 else (0.0, 0.0)


@inlined
def linearize_disc(disc, contacts, a, radius, S_N):
    """
    Fill the linear law of one kind of friction at contact a.

    Parameters
    ----------
    disc : Disc
    contacts : record array, shape (contacts,)
        Table of contacts.
    a : int
        Number of the contact.
    radius : float
        Radius of the friction disc: the normal impulse times the grip [N s].
    S_N : float
        Minus the derivative of the radius with respect to gamma_N [kg]; 0 if it is held.

    """
    k = disc.column
    x, y, normal = contacts.trial[a, k], contacts.trial[a, k + 1], contacts.trial[a, 0]
    P_x, P_y, S_xx, S_xy, S_yy, d_x, d_y = disc_law(
        disc, contacts.anchor[a, k], contacts.anchor[a, k + 1], x, y, radius
    )
    kind = SLIDING if k == 1 else ROLLING
    contacts.law_impulse[a, k], contacts.law_impulse[a, k + 1] = P_x, P_y
    S_xN, S_yN = d_x * S_N, d_y * S_N
    contacts.P_0[a, k] = P_x + S_xx * x + S_xy * y + S_xN * normal
    contacts.P_0[a, k + 1] = P_y + S_xy * x + S_yy * y + S_yN * normal
    contacts.S_xx[a, kind], contacts.S_xy[a, kind], contacts.S_yy[a, kind] = S_xx, S_xy, S_yy
    contacts.S_xN[a, kind], contacts.S_yN[a, kind] = S_xN, S_yN


@compiled
def disc_law(disc, anchor_x, anchor_y, gamma_x, gamma_y, radius):
    """
    Return the tangential impulse that follows from a velocity, and its derivatives.

    Parameters
    ----------
    disc : Disc
    anchor_x, anchor_y : float
        Prox center of the proximal point method [N s].
    gamma_x, gamma_y : float
        Sliding or rolling velocity [m/s].
    radius : float
        Radius of the friction disc: the normal impulse [N s].

    Returns
    -------
    P_x, P_y : float
        [N s]
    S_xx, S_xy, S_yy : float
        Minus the derivative with respect to gamma [kg].
    d_x, d_y : float
        Derivative with respect to the radius: 0 when the contact sticks.

    """
    if radius <= 0.0 or disc.stiffness <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    mu_x, mu_y, over = disc.mu_x, disc.mu_y, disc.stiffness
    x = disc.over_x * anchor_x - over * mu_x * gamma_x
    y = disc.over_y * anchor_y - over * mu_y * gamma_y
    square = x * x + y * y
    if square <= radius * radius:
        return mu_x * x, mu_y * y, over * mu_x * mu_x, 0.0, over * mu_y * mu_y, 0.0, 0.0
    shrink = 1.0 / math.sqrt(square)
    x, y = x * shrink, y * shrink
    d_x, d_y = mu_x * x, mu_y * y
    shrink *= radius * over
    S_xx, S_xy, S_yy = shrink * (mu_x * y) ** 2, -shrink * d_x * d_y, shrink * (mu_y * x) ** 2
    return radius * d_x, radius * d_y, S_xx, S_xy, S_yy, d_x, d_y


@merged
def linear_impulses(closed, contacts, rolling):
    """
    Fill the impulses of the linear laws at the velocities of the contacts.

    They are computed from the impulses at the trial velocities, so that few digits cancel.
    `closed` and `contacts` are those of a `solver.Problem`, with linear laws; `rolling` says
    whether there is rolling friction.
    """
    for a in closed:
        normal = contacts.gamma[a, 0] - contacts.trial[a, 0]
        contacts.impulse[a, 0] = contacts.law_impulse[a, 0] - contacts.S_N[a] * normal
        for k in range(1, 5 if rolling else 3, 2):
            kind = SLIDING if k == 1 else ROLLING
            x = contacts.gamma[a, k] - contacts.trial[a, k]
            y = contacts.gamma[a, k + 1] - contacts.trial[a, k + 1]
            S_xx, S_xy, S_yy = (
                contacts.S_xx[a, kind],
                contacts.S_xy[a, kind],
                contacts.S_yy[a, kind],
            )
            S_xN, S_yN = contacts.S_xN[a, kind], contacts.S_yN[a, kind]
            P_x, P_y = contacts.law_impulse[a, k], contacts.law_impulse[a, k + 1]
            contacts.impulse[a, k] = P_x - S_xx * x - S_xy * y - S_xN * normal
            contacts.impulse[a, k + 1] = P_y - S_xy * x - S_yy * y - S_yN * normal

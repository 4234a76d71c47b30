# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The contact problem with linear laws, which one Newton iteration solves exactly.

**Linear laws.** With the selection rule a normal impulse is ``P_N = max(0,
-gamma_N/compliance)``. A tangential law is first scaled by its coefficients, S = diag(mu_x, mu_y):
the ellipse becomes the disc of radius P_N, and the law keeps its form. Then ``S^-1 P =
prox_disc(S^-1 anchor - S gamma/epsilon)``. The anchor is the impulse of the last iterate; when it
no longer changes, this is the law itself (proximal point method [1]_), and nothing creeps. In
patches of the ground the radius is P_N times a factor, and where friction differs forward and
backward, mu_x follows the sign of the anchor; see `laws`.

**Through the chain.** The derivative of the impulses with respect to the velocity adds a 6x6
matrix to the inertia of the link that a contact touches. The matrix is not symmetric because
sliding friction follows the normal impulse. What remains is the forward dynamics of a chain, and
one sweep solves it. A contact of two links cannot be folded into the inertia of one;
`couple_pairs` solves for such contacts in addition.

**On the Delassus operator.** The alternative for few contacts is a small dense system. Every law
leaves its impulse some freedom. A contact that pushes has its normal impulse, one that sticks both
sliding components, and one that slides a single one, since its impulse stays on the edge of the
disc: with the impulse on the edge, ``P_T = d P_N + t s``, where d points to the edge and t along
it. The unknowns z are the free components, at most five a contact. For each there is an equation
of velocities, ``z/S + r . gamma = ...``, with the stiffness S of the law and the direction r that
z has. Contacts that do not push are left out. Impulses follow as ``P = c_1 z_1 + c_2 z_2 + ... +
P_held``, where c is r, and for a normal impulse also d of its friction. The matrix ``r_i . G c_j +
1/S_i`` is symmetric where no contact slides. Its compliances 1/S are small, and G keeps all of its
digits.

.. [1] R. T. Rockafellar, "Monotone operators and the proximal point algorithm", 1976.
"""

import math
from typing import NamedTuple

import numpy as np

from snake_sim_ros.contact.contacts import CLOSE, Contacts, ROLLING, SLIDING, stiffness
from snake_sim_ros.contact.delassus import (
    add_response,
    condensed_system,
    condensed_velocities,
    Delassus,
    eliminate,
    fill_free_velocities,
    fill_wrenches,
)
from snake_sim_ros.contact.directions import add_contact_wrench, contact_velocities
from snake_sim_ros.contact.laws import (
    anchored_disc,
    Disc,
    grip,
    impulse_width,
    Laws,
    rolling_disc,
    rolls,
    selects,
    STICKING,
)
from snake_sim_ros.contact.problem import Joints, Problem
from snake_sim_ros.contact.shapes import moved, outer, times, triple
from snake_sim_ros.dynamics.articulated_body import (
    Chain,
    correct_chain,
    factor_chain,
    find_residual,
    reset_chain,
    solve_residual,
)
from snake_sim_ros.dynamics.balance import axis_loads, axis_rates
from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.dynamics.joint_laws import linearize_axes
from snake_sim_ros.dynamics.spatial_vectors import Three
from snake_sim_ros.scene.parameters import Array

MOST_CORRECTIONS = 4  # of the twists in one linear step
FAR = 1e-4  # a solution that is farther from the trial velocities is not corrected [m/s]
CLOSER = 10.0  # stiffness of contacts that stick, relative to `disc_law`; see `close_law`
SMALL_CORRECTION = 1e-6  # after it the next one would be rounding [m/s, rad/s]


@inlined
def linearize(laws: Laws, closed: Array, contacts: Contacts) -> None:
    """
    Fill the linear laws of the closed contacts, about their trial velocities.

    `laws`, `closed` and `contacts` are those of a `problem.Problem`. The trial, anchor,
    selection_center and disc_radius of the contacts are read; law_impulse, P_0 and S_N to S_yN are
    filled.
    """
    solution, newton = contacts.solution, contacts.newton
    for a in closed:
        P_N, S_N = normal_law(
            laws, solution.selection_center[a], newton.anchor[a, 0], newton.trial[a, 0]
        )
        newton.law_impulse[a, 0] = P_N
        newton.P_0[a, 0], newton.S_N[a] = P_N + S_N * newton.trial[a, 0], S_N
        factor = grip(laws.other, contacts, a)
        radius, follow = (
            (P_N, S_N) if newton.disc_radius[a] < 0.0 else (newton.disc_radius[a], 0.0)
        )
        radius, follow = factor * radius, factor * follow
        linearize_disc(anchored_disc(laws, laws.other, contacts, a), contacts, a, radius, follow)
        if rolls(laws):
            linearize_disc(rolling_disc(laws, laws.other, a), contacts, a, radius, follow)


@inlined
def normal_law(laws: Laws, center: float, anchor: float, gamma: float) -> tuple[float, float]:
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
    proximal = 0.0 if selects(laws) else laws.proximal_compliance
    stiffness = 1.0 / (laws.compliance + proximal)
    P_N = stiffness * (laws.compliance * center + proximal * anchor - gamma)
    return (P_N, stiffness) if P_N > 0.0 else (0.0, 0.0)


@inlined
def linearize_disc(disc: Disc, contacts: Contacts, a: int, radius: float, S_N: float) -> None:
    """
    Fill the linear law of one kind of friction at contact a.

    Parameters
    ----------
    disc : Disc
    contacts : Contacts
    a : int
        Number of the contact.
    radius : float
        Radius of the friction disc: the normal impulse times the grip [N s].
    S_N : float
        Minus the derivative of the radius with respect to gamma_N [kg]; 0 if it is held.

    """
    newton = contacts.newton
    k = disc.column
    x, y, normal = newton.trial[a, k], newton.trial[a, k + 1], newton.trial[a, 0]
    if newton.disc_radius[a] == CLOSE:
        P_x, P_y, S_xx, S_xy, S_yy, d_x, d_y = close_law(
            disc, newton.iterate[a, k], newton.iterate[a, k + 1], x, y, radius
        )
    else:
        P_x, P_y, S_xx, S_xy, S_yy, d_x, d_y = disc_law(
            disc, newton.anchor[a, k], newton.anchor[a, k + 1], x, y, radius
        )
    kind = SLIDING if k == 1 else ROLLING
    newton.law_impulse[a, k], newton.law_impulse[a, k + 1] = P_x, P_y
    S_xN, S_yN = d_x * S_N, d_y * S_N
    newton.P_0[a, k] = P_x + S_xx * x + S_xy * y + S_xN * normal
    newton.P_0[a, k + 1] = P_y + S_xy * x + S_yy * y + S_yN * normal
    newton.S_xx[a, kind], newton.S_xy[a, kind], newton.S_yy[a, kind] = S_xx, S_xy, S_yy
    newton.S_xN[a, kind], newton.S_yN[a, kind] = S_xN, S_yN


@inlined
def disc_law(
    disc: Disc, anchor_x: float, anchor_y: float, gamma_x: float, gamma_y: float, radius: float
) -> tuple[float, ...]:
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


@compiled
def close_law(
    disc: Disc, P_x: float, P_y: float, gamma_x: float, gamma_y: float, radius: float
) -> tuple[float, ...]:
    """
    Return what `disc_law` does, for an impulse and a velocity that need not belong together.

    The law is ``P = prox(P - r gamma)`` with r as large as an effective mass, made linear in both,
    so that a velocity alone does not say where a contact slides to, nor whether it does. A contact
    that sticks is CLOSER times as stiff as in `disc_law`, from P.
    """
    if radius <= 0.0 or disc.stiffness <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    mu_x, mu_y, r = disc.mu_x, disc.mu_y, STICKING * disc.stiffness
    most = CLOSER * disc.stiffness
    x = disc.over_x * P_x - r * mu_x * gamma_x
    y = disc.over_y * P_y - r * mu_y * gamma_y
    length = math.sqrt(x * x + y * y)
    if length <= radius:
        S_xx, S_yy = most * mu_x * mu_x, most * mu_y * mu_y
        return P_x - S_xx * gamma_x, P_y - S_yy * gamma_y, S_xx, 0.0, S_yy, 0.0, 0.0
    x, y = x / length, y / length
    S = r * radius / (length - radius)
    S = S if S < most else most
    d_x, d_y = mu_x * x, mu_y * y
    S_xx, S_xy, S_yy = S * (mu_x * y) ** 2, -S * d_x * d_y, S * (mu_y * x) ** 2
    P_x = radius * d_x - S_xx * gamma_x - S_xy * gamma_y
    P_y = radius * d_y - S_xy * gamma_x - S_yy * gamma_y
    return P_x, P_y, S_xx, S_xy, S_yy, d_x, d_y


@inlined
def linear_impulses(closed: Array, contacts: Contacts, rolling: bool) -> None:
    """
    Fill the impulses of the linear laws at the velocities of the contacts.

    They are computed from the impulses at the trial velocities, so that few digits cancel.
    `closed` and `contacts` are those of a `problem.Problem`, with linear laws; `rolling` says
    whether there is rolling friction.
    """
    solution, newton = contacts.solution, contacts.newton
    for a in closed:
        normal = solution.gamma[a, 0] - newton.trial[a, 0]
        solution.impulse[a, 0] = newton.law_impulse[a, 0] - newton.S_N[a] * normal
        for k in range(1, 5 if rolling else 3, 2):
            kind = SLIDING if k == 1 else ROLLING
            x = solution.gamma[a, k] - newton.trial[a, k]
            y = solution.gamma[a, k + 1] - newton.trial[a, k + 1]
            S_xx, S_xy, S_yy, S_xN, S_yN = stiffness(contacts, a, kind)
            P_x, P_y = newton.law_impulse[a, k], newton.law_impulse[a, k + 1]
            solution.impulse[a, k] = P_x - S_xx * x - S_xy * y - S_xN * normal
            solution.impulse[a, k + 1] = P_y - S_xy * x - S_yy * y - S_yN * normal


@inlined
def add_laws(
    closed: Array,
    contacts: Contacts,
    frame: Array | None,
    rolling: bool,
    wrench: Array,
    inertia: Array,
) -> None:
    """
    Add the linear laws to the wrenches and to the inertias of the links.

    Parameters
    ----------
    closed : ndarray of int, shape (k,)
        Numbers of the contacts, none of two links.
    contacts : Contacts
        With linear laws.
    frame : ndarray, shape (contacts, 3, 3), or None
        Contact frames in I; None on a flat floor.
    rolling : bool
        Whether there is rolling friction.
    wrench : ndarray, shape (n, 6)
        Moment about O [N m s] and impulse [N s] of every link, in axes of I; added to.
    inertia : ndarray, shape (n, 6, 6)
        Inertia of every link about O, in axes of I; added to.

    """
    if frame is not None:
        add_laws_in_frames(closed, contacts, frame, rolling, wrench, inertia)
        return
    for a in closed:
        i = contacts.geometry.link[a]
        add_point_law(contacts, a, wrench, inertia, i)
        if rolling:
            add_rolling_law(contacts, a, wrench, inertia, i)


@inlined
def add_point_law(contacts: Contacts, a: int, wrench: Array, inertia: Array, i: int) -> None:
    """
    Add the impulse ``P_0 - S gamma`` of contact a, normal and sliding, to link i.

    In axes of I it is ``force - K v``, where ``v = v_O + omega x p`` is the velocity of the
    contact point and K = [[xx, xy, xz], [xy, yy, yz], [0, 0, zz]]. About O this is A += J^T K J
    with J = [-p~, 1].
    """
    geometry, solution, newton = contacts.geometry, contacts.solution, contacts.newton
    cx, cy = geometry.heading[a, 0], geometry.heading[a, 1]
    x, y, z = geometry.point[a, 0], geometry.point[a, 1], geometry.point[a, 2]
    S_xx, S_xy, S_yy, S_xN, S_yN = stiffness(contacts, a, SLIDING)
    shift = solution.shift[a]
    P_x, P_y = newton.P_0[a, 1] - S_xN * shift, newton.P_0[a, 2] - S_yN * shift
    fz = newton.P_0[a, 0] - newton.S_N[a] * shift
    fx, fy = cx * P_x - cy * P_y, cy * P_x + cx * P_y
    wrench[i, 0] += y * fz - z * fy
    wrench[i, 1] += z * fx - x * fz
    wrench[i, 2] += x * fy - y * fx
    wrench[i, 3] += fx
    wrench[i, 4] += fy
    wrench[i, 5] += fz
    xx = cx * cx * S_xx - 2.0 * cx * cy * S_xy + cy * cy * S_yy
    xy = cx * cy * (S_xx - S_yy) + (cx * cx - cy * cy) * S_xy
    yy = cy * cy * S_xx + 2.0 * cx * cy * S_xy + cx * cx * S_yy
    xz, yz, zz = cx * S_xN - cy * S_yN, cy * S_xN + cx * S_yN, newton.S_N[a]
    rows = (
        (-z * xy, -z * yy, y * zz - z * yz),  # p~ K
        (z * xx, z * xy, z * xz - x * zz),
        (x * xy - y * xx, x * yy - y * xy, x * yz - y * xz),
        (xx, xy, xz),  # K
        (xy, yy, yz),
        (0.0, 0.0, zz),
    )
    add_point_inertia(rows, (x, y, z), inertia[i])


@inlined
def add_point_inertia(rows: tuple[Three, ...], point: Three, inertia: Array) -> None:
    """Add J^T K J to an inertia (6, 6); its rows are (p x r, r) for rows r of p~ K and K."""
    x, y, z = point
    for k in range(6):
        a_x, a_y, a_z = rows[k]
        inertia[k, 0] += y * a_z - z * a_y
        inertia[k, 1] += z * a_x - x * a_z
        inertia[k, 2] += x * a_y - y * a_x
        inertia[k, 3] += a_x
        inertia[k, 4] += a_y
        inertia[k, 5] += a_z


@inlined
def add_rolling_law(contacts: Contacts, a: int, wrench: Array, inertia: Array, i: int) -> None:
    """Add the rolling torque r (P_v, -P_u) of contact a to link i, eqs. (36), (37)."""
    geometry, solution, newton = contacts.geometry, contacts.solution, contacts.newton
    x, y, r = geometry.point[a, 0], geometry.point[a, 1], geometry.radius[a]
    S_xx, S_xy, S_yy, S_xN, S_yN = stiffness(contacts, a, ROLLING)
    wrench[i, 0] += r * (newton.P_0[a, 4] - S_yN * solution.shift[a])
    wrench[i, 1] -= r * (newton.P_0[a, 3] - S_xN * solution.shift[a])
    inertia[i, 0, 0] += r * r * S_yy + r * S_yN * y
    inertia[i, 0, 1] -= r * r * S_xy + r * S_yN * x
    inertia[i, 0, 5] += r * S_yN
    inertia[i, 1, 0] -= r * r * S_xy + r * S_xN * y
    inertia[i, 1, 1] += r * r * S_xx + r * S_xN * x
    inertia[i, 1, 5] -= r * S_xN


@compiled
def add_laws_in_frames(
    closed: Array, contacts: Contacts, frame: Array, rolling: bool, wrench: Array, inertia: Array
) -> None:
    """Do what `add_laws` does, for contacts that have frames."""
    geometry = contacts.geometry
    for a in closed:
        i = geometry.link[a]
        normal, e_x, e_y = triple(frame[a], 0), triple(frame[a], 1), triple(frame[a], 2)
        add_point_law_in_frame(contacts, a, (normal, e_x, e_y), wrench[i], inertia[i])
        if rolling:
            r, point = geometry.radius[a], triple(geometry.point, a)
            directions = outer(point, normal), normal, times(-r, e_y), times(r, e_x)
            add_rolling_law_in_frame(contacts, a, directions, wrench[i], inertia[i])


@inlined
def add_point_law_in_frame(
    contacts: Contacts, a: int, axes: tuple[Three, Three, Three], wrench: Array, inertia: Array
) -> None:
    """
    Do what `add_point_law` does, for a contact with its axes normal, e_x and e_y in I.

    ``K = n (S_N n)^T + e_x (S_xN n + S_xx e_x + S_xy e_y)^T + e_y (S_yN n + S_xy e_x + S_yy
    e_y)^T``.
    """
    newton, (normal, e_x, e_y) = contacts.newton, axes
    S_xx, S_xy, S_yy, S_xN, S_yN = stiffness(contacts, a, SLIDING)
    S_N, shift, p = newton.S_N[a], contacts.solution.shift[a], triple(contacts.geometry.point, a)
    force = times(newton.P_0[a, 0] - S_N * shift, normal)
    force = moved(force, newton.P_0[a, 1] - S_xN * shift, e_x)
    force = moved(force, newton.P_0[a, 2] - S_yN * shift, e_y)
    moment = outer(p, force)
    by_x = moved(moved(times(S_xN, normal), S_xx, e_x), S_xy, e_y)
    by_y = moved(moved(times(S_yN, normal), S_xy, e_x), S_yy, e_y)
    x = moved(moved(times(S_N * normal[0], normal), e_x[0], by_x), e_y[0], by_y)
    y = moved(moved(times(S_N * normal[1], normal), e_x[1], by_x), e_y[1], by_y)
    z = moved(moved(times(S_N * normal[2], normal), e_x[2], by_x), e_y[2], by_y)
    rows = (
        moved(times(p[1], z), -p[2], y),  # p~ K
        moved(times(p[2], x), -p[0], z),
        moved(times(p[0], y), -p[1], x),
        x,  # K
        y,
        z,
    )
    for k in range(3):
        wrench[k] += moment[k]
        wrench[3 + k] += force[k]
    add_point_inertia(rows, p, inertia)


@inlined
def add_rolling_law_in_frame(
    contacts: Contacts, a: int, directions: tuple[Three, Three, Three, Three], wrench: Array,
    inertia: Array,
) -> None:  # fmt: skip
    """
    Add the rolling torque of contact a to its link.

    Parameters
    ----------
    contacts : Contacts
        With linear laws.
    a : int
        Number of the contact.
    directions : tuple of 3 float each
        Moment and force of a unit normal impulse, and the moments of unit impulses of rolling.
    wrench : ndarray, shape (6,)
        Wrench of the link about O; added to.
    inertia : ndarray, shape (6, 6)
        Inertia of the link about O; added to.

    """
    newton, (moment, normal, along, across) = contacts.newton, directions
    S_xx, S_xy, S_yy, S_xN, S_yN = stiffness(contacts, a, ROLLING)
    shift = contacts.solution.shift[a]
    P_x, P_y = newton.P_0[a, 3] - S_xN * shift, newton.P_0[a, 4] - S_yN * shift
    for k in range(3):
        wrench[k] += P_x * along[k] + P_y * across[k]
        follow = S_xN * along[k] + S_yN * across[k]
        by_along = S_xx * along[k] + S_xy * across[k]
        by_across = S_xy * along[k] + S_yy * across[k]
        for j in range(3):
            inertia[k, j] += follow * moment[j] + by_along * along[j] + by_across * across[j]
            inertia[k, 3 + j] += follow * normal[j]


class Reduced(NamedTuple):
    """Arrays for c unknowns: as many as the Delassus operator has rows."""

    system: Array  # (c+1, c) the matrix transposed [1/kg], and below it the right side [m/s]
    response: Array  # (c, c) velocities for a unit of every unknown [1/kg]
    impulse: Array  # (c,) impulses by rows of the operator, first those held [N s]
    row: Array  # (c,) row of the operator for the first component of r
    along: Array  # (c, 2) r, in this row and the next one [1]
    is_normal: Array  # (c,) 1 if the unknown is a normal impulse
    follow: Array  # (c, 4) for a normal impulse d of sliding and rolling [1]
    compliance: Array  # (c,) 1/S [1/kg]
    goal: Array  # (c,) right sides of the laws, z/S + r . gamma [m/s]


def make_reduced(rows: int) -> Reduced:
    """Return the arrays for a Delassus operator of so many rows."""
    zeros = np.zeros
    return Reduced(
        system=zeros((rows + 1, rows)),
        response=zeros((rows, rows)),
        impulse=zeros(rows),
        row=zeros(rows, np.int64),
        along=zeros((rows, 2)),
        is_normal=zeros(rows, np.int64),
        follow=zeros((rows, 4)),
        compliance=zeros(rows),
        goal=zeros(rows),
    )


class Operator(NamedTuple):
    """The Delassus operator of few contacts, and arrays for linear problems on it."""

    delassus: Delassus  # of the contacts that are condensed
    reduced: Reduced  # of their linear problem
    most: int  # largest number of contacts that are condensed
    swept: int  # how often sweeps over the contacts are tried
    is_condensed: Array  # (1,) 1 if the contacts of this step are


@inlined
def reduced_step(
    laws: Laws, closed: Array, contacts: Contacts, delassus: Delassus, reduced: Reduced
) -> bool:
    """
    Fill impulses and velocities with the solution for the laws linear about the trial velocities.

    Parameters
    ----------
    laws, closed, contacts
        Those of a `problem.Problem`. Trial, anchor, selection_center and disc_radius are read,
        impulse and gamma are filled.
    delassus : Delassus
        As `condense` filled it.
    reduced : Reduced

    Returns
    -------
    bool
        Whether the solution is finite.

    """
    width = impulse_width(laws)
    count = reduce_laws(laws, closed, contacts, reduced)
    held_velocities(closed, width, contacts, delassus, reduced)
    fill_responses(count, closed, width, contacts, delassus.operator, reduced)
    for attempt in range(2):
        fill_system(count, delassus.packed, reduced)
        if eliminate_columns(reduced.system, count, attempt > 0):
            break
    finite = expand(count, closed, width, contacts, reduced)
    condensed_velocities(closed, width, contacts, delassus)
    return finite


@inlined
def reduce_laws(laws: Laws, closed: Array, contacts: Contacts, reduced: Reduced) -> int:
    """Fill the unknowns, their laws and the held impulses; return how many unknowns there are."""
    solution, newton = contacts.solution, contacts.newton
    count = 0
    for a in closed:
        row, radius = newton.row[a], newton.disc_radius[a]
        P_N, S_N = normal_law(
            laws, solution.selection_center[a], newton.anchor[a, 0], newton.trial[a, 0]
        )
        normal, reduced.impulse[row] = -1, 0.0
        if S_N > 0.0:
            normal = count
            add_unknown(count, row, 1.0, 0.0, 1.0 / S_N, reduced)
            reduced.goal[count] = P_N / S_N + newton.trial[a, 0]
            reduced.is_normal[count] = 1
            for k in range(4):
                reduced.follow[count, k] = 0.0
            count += 1
        if radius < 0.0:
            radius = P_N
        else:
            normal = -1
        bound = Bound(radius, grip(laws.other, contacts, a), normal)
        disc = anchored_disc(laws, laws.other, contacts, a)
        count = reduce_disc(disc, contacts, a, bound, count, reduced)
        if rolls(laws):
            disc = rolling_disc(laws, laws.other, a)
            count = reduce_disc(disc, contacts, a, bound, count, reduced)
    return count


@inlined
def add_unknown(
    count: int, row: int, x: float, y: float, compliance: float, reduced: Reduced
) -> None:
    """Add the unknown of number `count`, with r = (x, y) in a row and the next one."""
    reduced.row[count], reduced.compliance[count] = row, compliance
    reduced.along[count, 0], reduced.along[count, 1] = x, y
    reduced.is_normal[count] = 0


class Bound(NamedTuple):
    """What bounds the friction of a contact."""

    P_N: float  # normal impulse [N s]
    factor: float  # radius of the friction disc over that impulse; see `laws.grip` [1]
    normal: int  # number of the unknown that is this impulse, -1 if the radius is held


@inlined
def reduce_disc(
    disc: Disc, contacts: Contacts, a: int, bound: Bound, count: int, reduced: Reduced
) -> int:
    """
    Add the unknowns of one kind of friction at contact a; return how many there are then.

    Parameters
    ----------
    disc : Disc
    contacts : Contacts
    a : int
        Number of the contact.
    bound : Bound
    count : int
        Number of unknowns so far.
    reduced : Reduced

    """
    newton, factor, normal = contacts.newton, bound.factor, bound.normal
    k = disc.column
    row = newton.row[a] + k
    x, y = newton.trial[a, k], newton.trial[a, k + 1]
    P_x, P_y, S_xx, _, S_yy, d_x, d_y = disc_law(
        disc, newton.anchor[a, k], newton.anchor[a, k + 1], x, y, factor * bound.P_N
    )
    reduced.impulse[row] = reduced.impulse[row + 1] = 0.0
    if d_x == 0.0 and d_y == 0.0:  # it sticks, or there is no friction
        if S_xx > 0.0:
            add_unknown(count, row, 1.0, 0.0, 1.0 / S_xx, reduced)
            reduced.goal[count] = P_x / S_xx + x
            count += 1
        if S_yy > 0.0:
            add_unknown(count, row, 0.0, 1.0, 1.0 / S_yy, reduced)
            reduced.goal[count] = P_y / S_yy + y
            count += 1
        return count
    if normal >= 0:
        reduced.follow[normal, k - 1], reduced.follow[normal, k] = factor * d_x, factor * d_y
    else:
        reduced.impulse[row], reduced.impulse[row + 1] = P_x, P_y
    t_x, t_y = disc.mu_x * disc.over_y * d_y, -disc.mu_y * disc.over_x * d_x
    if S_xx + S_yy > 0.0:
        add_unknown(count, row, t_x, t_y, (t_x * t_x + t_y * t_y) / (S_xx + S_yy), reduced)
        reduced.goal[count] = t_x * x + t_y * y
        count += 1
    return count


@inlined
def held_velocities(
    closed: Array, width: int, contacts: Contacts, delassus: Delassus, reduced: Reduced
) -> None:
    """Fill delassus.packed with the velocities that the held impulses leave."""
    fill_free_velocities(closed, width, contacts, delassus)
    for a in closed:
        for column in range(contacts.newton.row[a] + 1, contacts.newton.row[a] + width):
            add_response(reduced.impulse[column], column, closed, width, contacts, delassus)


@inlined
def fill_responses(
    count: int, closed: Array, width: int, contacts: Contacts, G: Array, reduced: Reduced
) -> None:
    """Fill the velocities ``G c`` of the closed contacts for a unit of every unknown."""
    rows = 0
    for a in closed:
        rows = max(rows, contacts.newton.row[a] + width)
    for v in range(count):
        row, g = reduced.row[v], reduced.response[v]
        if reduced.is_normal[v]:
            x, y = reduced.follow[v, 0], reduced.follow[v, 1]
            for i in range(rows):
                g[i] = G[row, i] + x * G[row + 1, i] + y * G[row + 2, i]
            if width > 3:
                x, y = reduced.follow[v, 2], reduced.follow[v, 3]
                for i in range(rows):
                    g[i] += x * G[row + 3, i] + y * G[row + 4, i]
        else:
            x, y = reduced.along[v, 0], reduced.along[v, 1]
            for i in range(rows):
                g[i] = x * G[row, i] + y * G[row + 1, i]


@inlined
def fill_system(count: int, velocity: Array, reduced: Reduced) -> None:
    """Fill the linear system for the unknowns; `velocity` is that of the held impulses."""
    B = reduced.system
    for u in range(count):
        row, x, y = reduced.row[u], reduced.along[u, 0], reduced.along[u, 1]
        B[count, u] = reduced.goal[u] - x * velocity[row] - y * velocity[row + 1]
        for v in range(count):
            B[v, u] = x * reduced.response[v, row] + y * reduced.response[v, row + 1]
        B[u, u] += reduced.compliance[u]


@compiled
def eliminate_columns(B: Array, count: int, searches: bool) -> bool:
    """
    Replace row `count` of B by the solution of ``B[:count].T x = B[count]``.

    The rows of B are the columns of the matrix: so the elimination goes along rows of B.

    Parameters
    ----------
    B : ndarray, shape (c+1, c)
    count : int
        Number of unknowns.
    searches : bool
        Whether pivots are searched for in each column. Without it the elimination ends at a pivot
        that is not positive.

    Returns
    -------
    bool
        Whether the elimination came to its end.

    """
    for k in range(count):
        if searches:
            pivot = k
            for i in range(k + 1, count):
                if abs(B[k, i]) > abs(B[k, pivot]):
                    pivot = i
            if pivot != k:
                for j in range(count + 1):
                    B[j, k], B[j, pivot] = B[j, pivot], B[j, k]
        elif not B[k, k] > 0.0:
            return False
        over = 1.0 / B[k, k]
        for i in range(k + 1, count):
            B[k, i] *= over
        for j in range(k + 1, count + 1):
            share = B[j, k]
            if share != 0.0:
                for i in range(k + 1, count):
                    B[j, i] -= share * B[k, i]
    for k in range(count - 1, -1, -1):
        x = B[count, k] / B[k, k]
        B[count, k] = x
        for i in range(k):
            B[count, i] -= x * B[k, i]
    return True


@inlined
def expand(count: int, closed: Array, width: int, contacts: Contacts, reduced: Reduced) -> bool:
    """Fill the impulses of the contacts from the unknowns; return whether they are finite."""
    P, total = reduced.impulse, 0.0
    for u in range(count):
        z, row = reduced.system[count, u], reduced.row[u]
        total += z
        P[row] += reduced.along[u, 0] * z
        P[row + 1] += reduced.along[u, 1] * z
        if reduced.is_normal[u]:
            for k in range(width - 1):
                P[row + 1 + k] += reduced.follow[u, k] * z
    for a in closed:
        for j in range(width):
            contacts.solution.impulse[a, j] = P[contacts.newton.row[a] + j]
    return math.isfinite(total)


@inlined
def linear_step(problem: Problem, operator: Operator | None, always: bool) -> tuple[bool, bool]:
    """
    Fill velocities and impulses with the solution for the laws linear about the trial velocities.

    Parameters
    ----------
    problem : Problem
        Its contacts need trial, anchor, selection_center and disc_radius. Their gamma and impulse
        are filled and, if they are not condensed, the twists of the chain and the rates of axes
        that have laws, of which trial and anchor are read.
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
    laws, closed, contacts = problem.laws, problem.closed, problem.contacts
    if operator is not None:
        if operator.is_condensed[0]:
            return reduced_step(laws, closed, contacts, operator.delassus, operator.reduced), True
    linearize(laws, closed, contacts)
    joints, chain = problem.joints, problem.chain
    if joints.take_part:
        load_chain(joints, chain)
    finite, exact = solve_linear(problem, always)
    if joints.take_part:
        axis_rates(chain, joints.axes.rate)
    return finite, exact


@inlined
def load_chain(joints: Joints, chain: Chain) -> None:
    """Load the chain with the laws of the joints, linear about their trial rates."""
    linearize_axes(joints.laws, joints.axes, (joints.torque, joints.damping))
    axis_loads(joints.torque, joints.damping, chain)


@inlined
def solve_linear(problem: Problem, always: bool) -> tuple[bool, bool]:
    """Solve the chain together with linear laws; return what `linear_step` returns."""
    laws, closed, contacts, chain, pairs, _ = problem
    rolling = rolls(laws)
    reset_chain(chain)
    single = closed[: count_single(closed, contacts, pairs)]
    add_laws(single, contacts, chain.frame, rolling, chain.wrench, chain.inertia)
    factor_chain(chain)
    exact = True
    for k in range(MOST_CORRECTIONS if len(closed) > 0 else 1):  # a chain in the air is not stiff
        if k > 0:  # solve once more for what rounding left
            fill_wrenches(closed, contacts, chain)
            find_residual(chain)
        largest = correct_chain(chain)
        coupled = couple_pairs(k > 0, closed[len(single) :], 3, contacts, chain, pairs)
        largest = max(largest, coupled)
        contact_velocities(closed, contacts, chain.frame, chain.twist)
        linear_impulses(single, contacts, rolling)
        if k == 0 and not always and is_far(single, contacts):
            exact = False
            break
        if k > 0 and not largest > SMALL_CORRECTION:
            break
    return math.isfinite(chain.twist[0, 3] + chain.twist[len(chain.twist) - 1, 3]), exact


@inlined
def is_far(closed: Array, contacts: Contacts) -> bool:
    """Return whether a contact velocity is farther than FAR from the trial velocity."""
    farthest = 0.0
    for a in closed:
        for j in range(3):
            farthest = max(
                farthest, abs(contacts.solution.gamma[a, j] - contacts.newton.trial[a, j])
            )
    return farthest > FAR


@inlined
def list_pairs_last(closed: Array, contacts: Contacts, pairs: Delassus | None) -> None:
    """
    Move the contacts of two links behind all others, as `solve_linear` needs them.

    The order within either kind stays. `pairs` is that of `couple_pairs`.
    """
    if pairs is None:
        return
    count = 0
    for k in range(len(closed)):
        a = closed[k]
        if contacts.geometry.other_link[a] < 0:
            for j in range(k, count, -1):
                closed[j] = closed[j - 1]
            closed[count] = a
            count += 1


@inlined
def count_single(closed: Array, contacts: Contacts, pairs: Delassus | None) -> int:
    """Return the number of contacts that are not of two links; these are listed last."""
    if pairs is None:
        return len(closed)
    count = len(closed)
    while count > 0 and contacts.geometry.other_link[closed[count - 1]] >= 0:
        count -= 1
    return count


@inlined
def couple_pairs(
    again: bool,
    closed: Array,
    width: int,
    contacts: Contacts,
    chain: Chain,
    pairs: Delassus | None,
) -> float:
    """
    Solve for the contacts of links with each other, and add what they do to the twists.

    A sweep over the chain cannot fold the law of such a contact into the inertia of one link.
    Instead the chain is solved for a unit of every component of their impulses, which leaves a
    small dense problem. The impulses are corrected whenever the twists are. If they were solved
    for only once, they would keep what rounding left of the twists, 1e-7 m/s and more, and
    Newton's method would cycle there.

    Parameters
    ----------
    again : bool
        Whether the impulses are corrected for what the laws leave at the present twists; if not,
        they are solved for the first time.
    closed : ndarray of int, shape (k,)
        Numbers of the closed contacts of two links.
    width : int
        Components per contact: 3, or 5 with rolling friction.
    contacts : Contacts
        With linear laws; impulses are filled.
    chain : Chain
        Its twists are added to.
    pairs : Delassus or None
        ``problem.pairs``, an argument of its own so that Numba leaves out the branch on
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
def condense_pairs(
    closed: Array, width: int, contacts: Contacts, chain: Chain, pairs: Delassus
) -> None:
    """Fill G of the contacts of two links on the factored chain; set their impulses to 0."""
    solution, newton = contacts.solution, contacts.newton
    for a in closed:
        solution.impulse[a] = 0.0
    for k, a in enumerate(closed):
        for j in range(width):
            row = pairs.operator[width * k + j]
            stiffness = newton.S_N[a]
            if j > 0:
                stiffness = newton.S_xx[a, SLIDING] + newton.S_yy[a, SLIDING]
            if stiffness == 0.0:  # the impulse is 0
                row[: width * len(closed)] = 0.0
                continue
            solution.impulse[a, j] = 1.0
            chain.wrench[:] = 0.0
            add_contact_wrench(closed[k : k + 1], contacts, chain.frame, chain.wrench)
            solution.impulse[a, j] = 0.0
            solve_residual(chain)
            contact_velocities(closed, contacts, chain.frame, chain.correction)
            for other, b in enumerate(closed):
                for i in range(width):
                    shift = solution.shift[b] if i == 0 else 0.0
                    row[width * other + i] = solution.gamma[b, i] - shift


@compiled
def solve_correction(closed: Array, width: int, contacts: Contacts, delassus: Delassus) -> None:
    """
    Fill the impulses with a correction for what the laws leave at the present velocities.

    The dense problem with G is solved. The impulses before are kept in ``delassus.packed``. The
    stiffness of the laws costs as many digits here as it does in the chain, see
    `articulated_body.find_residual`.
    """
    solution = contacts.solution
    rows = width * len(closed)
    B, packed = delassus.system, delassus.packed
    for k, a in enumerate(closed):
        for j in range(width):
            packed[width * k + j] = solution.impulse[a, j]
    condensed_system(closed, width, contacts, delassus)
    linear_impulses(closed, contacts, width > 3)
    for k, a in enumerate(closed):
        for j in range(width):
            B[width * k + j, rows] = solution.impulse[a, j] - packed[width * k + j]
    eliminate(B, rows)
    for k, a in enumerate(closed):
        for j in range(width):
            solution.impulse[a, j] = B[width * k + j, rows]


@inlined
def add_kept_impulses(closed: Array, width: int, contacts: Contacts, delassus: Delassus) -> None:
    """Add the impulses that `solve_correction` kept to its correction."""
    for k, a in enumerate(closed):
        for j in range(width):
            contacts.solution.impulse[a, j] += delassus.packed[width * k + j]

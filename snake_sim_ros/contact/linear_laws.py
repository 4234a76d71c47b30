"""
The contact laws as impulses that follow from velocities, linear about a trial, in the chain.

With the selection rule a normal impulse is ``P_N = max(0, -gamma_N/compliance)``. A tangential
law is first scaled by its coefficients, S = diag(mu_x, mu_y): the ellipse becomes the disc of
radius P_N, the law stays the same. Then ``S^-1 P = prox_disc(S^-1 anchor - S gamma/epsilon)``,
which is the law itself when the anchor, the impulse of the last iterate, no longer changes
(proximal point method [1]_): nothing creeps.

The derivative of the impulses with respect to the velocity adds a 6x6 matrix to the inertia of the
link that a contact touches, not symmetric because sliding friction follows the normal impulse.
What is left is the forward dynamics of a chain.

.. [1] R. T. Rockafellar, "Monotone operators and the proximal point algorithm", 1976.
"""

import math

from snake_sim_ros.contact.delassus import condensed_system
from snake_sim_ros.contact.delassus import condensed_velocities
from snake_sim_ros.contact.delassus import eliminate
from snake_sim_ros.contact.delassus import fill_wrenches
from snake_sim_ros.contact.delassus import solve_condensed
from snake_sim_ros.contact.directions import add_contact_wrench
from snake_sim_ros.contact.directions import contact_velocities
from snake_sim_ros.contact.directions import direction
from snake_sim_ros.contact.laws import rolling_disc
from snake_sim_ros.contact.laws import sliding_disc
from snake_sim_ros.contact.table import FREE
from snake_sim_ros.contact.table import ROLLING
from snake_sim_ros.contact.table import SLIDING
from snake_sim_ros.dynamics.articulated_body import correct_chain
from snake_sim_ros.dynamics.articulated_body import factor_chain
from snake_sim_ros.dynamics.articulated_body import find_residual
from snake_sim_ros.dynamics.articulated_body import reset_chain
from snake_sim_ros.dynamics.articulated_body import solve_residual
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.compilation import merged

MOST_CORRECTIONS = 4  # of the twists, at most
SMALL_CORRECTION = 1e-6  # correction after which the next one would be rounding [m/s, rad/s]


@compiled
def normal_law(laws, center, anchor, gamma):
    """Return the impulse that follows from gamma_N, and its derivative with the opposite sign."""
    proximal = (
        0.0 if laws.compliance > 1e-2 * laws.proximal_compliance else laws.proximal_compliance
    )
    stiffness = 1.0 / (laws.compliance + proximal)
    P_N = stiffness * (laws.compliance * center + proximal * anchor - gamma)
    return (P_N, stiffness) if P_N > 0.0 else (0.0, 0.0)


@compiled
def disc_law(disc, anchor_x, anchor_y, gamma_x, gamma_y, radius):
    """
    Return the tangential impulse that follows from gamma for a disc radius, and its derivatives.

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


@inlined
def linearize_disc(disc, contacts, a, radius, S_N):
    """Fill the law of one kind of friction at contact a; S_N is how the radius follows gamma_N."""
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


@merged
def linearize(laws, closed, contacts):
    """Fill the laws of all contacts, linear about TRIAL."""
    for a in closed:
        P_N, S_N = normal_law(
            laws, contacts.selection_center[a], contacts.anchor[a, 0], contacts.trial[a, 0]
        )
        contacts.law_impulse[a, 0] = P_N
        contacts.P_0[a, 0], contacts.S_N[a] = P_N + S_N * contacts.trial[a, 0], S_N
        radius, follow = (
            (P_N, S_N) if contacts.disc_radius[a] == FREE else (contacts.disc_radius[a], 0.0)
        )
        linearize_disc(sliding_disc(laws, laws.other, a), contacts, a, radius, follow)
        if laws.rolling.mu_x > 0.0:
            linearize_disc(rolling_disc(laws, laws.other, a), contacts, a, radius, follow)


@inlined
def add_laws(closed, contacts, frame, rolling, wrench, inertia):
    """Add the linear laws to the wrenches and to the inertias of the links."""
    if frame is not None:
        add_laws_in_frames(closed, contacts, frame, rolling, wrench, inertia)
        return
    n = len(wrench)
    for a in closed:
        i = a if a < n else a - n
        add_point_law(contacts, a, wrench, inertia, i)
        if rolling:
            add_rolling_law(contacts, a, wrench, inertia, i)


@merged
def add_point_law(contacts, a, wrench, inertia, i):
    """
    Add to link i the impulse ``P_0 - S gamma`` of contact a, normal and sliding.

    In axes of I it is ``force - K v``, ``v = v_O + omega x p`` the velocity of the contact point,
    K = [[xx, xy, xz], [xy, yy, yz], [0, 0, zz]]; about O that is A += J^T K J, J = [-p~, 1].
    """
    cx, cy = contacts.heading[a, 0], contacts.heading[a, 1]
    x, y, z = contacts.point[a, 0], contacts.point[a, 1], contacts.point[a, 2]
    S_xN, S_yN, shift = contacts.S_xN[a, SLIDING], contacts.S_yN[a, SLIDING], contacts.shift[a]
    P_x, P_y = contacts.P_0[a, 1] - S_xN * shift, contacts.P_0[a, 2] - S_yN * shift
    fz = contacts.P_0[a, 0] - contacts.S_N[a] * shift
    fx, fy = cx * P_x - cy * P_y, cy * P_x + cx * P_y
    wrench[i, 0] += y * fz - z * fy
    wrench[i, 1] += z * fx - x * fz
    wrench[i, 2] += x * fy - y * fx
    wrench[i, 3] += fx
    wrench[i, 4] += fy
    wrench[i, 5] += fz
    S_xx, S_xy, S_yy = (
        contacts.S_xx[a, SLIDING],
        contacts.S_xy[a, SLIDING],
        contacts.S_yy[a, SLIDING],
    )
    xx = cx * cx * S_xx - 2.0 * cx * cy * S_xy + cy * cy * S_yy
    xy = cx * cy * (S_xx - S_yy) + (cx * cx - cy * cy) * S_xy
    yy = cy * cy * S_xx + 2.0 * cx * cy * S_xy + cx * cx * S_yy
    xz, yz, zz = cx * S_xN - cy * S_yN, cy * S_xN + cx * S_yN, contacts.S_N[a]
    rows = (
        (-z * xy, -z * yy, y * zz - z * yz),  # p~ K
        (z * xx, z * xy, z * xz - x * zz),
        (x * xy - y * xx, x * yy - y * xy, x * yz - y * xz),
        (xx, xy, xz),  # K
        (xy, yy, yz),
        (0.0, 0.0, zz),
    )
    for k in range(6):  # (p x r, r) is a row of J^T K J
        a_x, a_y, a_z = rows[k]
        inertia[i, k, 0] += y * a_z - z * a_y
        inertia[i, k, 1] += z * a_x - x * a_z
        inertia[i, k, 2] += x * a_y - y * a_x
        inertia[i, k, 3] += a_x
        inertia[i, k, 4] += a_y
        inertia[i, k, 5] += a_z


@merged
def add_rolling_law(contacts, a, wrench, inertia, i):
    """Add to link i the rolling torque r (P_v, -P_u) of contact a, eqs. (36), (37)."""
    x, y, r = contacts.point[a, 0], contacts.point[a, 1], contacts.radius[a]
    wrench[i, 0] += r * (contacts.P_0[a, 4] - contacts.S_yN[a, ROLLING] * contacts.shift[a])
    wrench[i, 1] -= r * (contacts.P_0[a, 3] - contacts.S_xN[a, ROLLING] * contacts.shift[a])
    S_xx, S_xy, S_yy = (
        contacts.S_xx[a, ROLLING],
        contacts.S_xy[a, ROLLING],
        contacts.S_yy[a, ROLLING],
    )
    S_xN, S_yN = contacts.S_xN[a, ROLLING], contacts.S_yN[a, ROLLING]
    inertia[i, 0, 0] += r * r * S_yy + r * S_yN * y
    inertia[i, 0, 1] -= r * r * S_xy + r * S_yN * x
    inertia[i, 0, 5] += r * S_yN
    inertia[i, 1, 0] -= r * r * S_xy + r * S_xN * y
    inertia[i, 1, 1] += r * r * S_xx + r * S_xN * x
    inertia[i, 1, 5] -= r * S_xN


@compiled
def add_laws_in_frames(closed, contacts, frame, rolling, wrench, inertia):
    """
    Do what `add_laws` does, for contacts with frames: wrench += W P_0, A += W S W^T.

    W are the directions (normal, sliding; rolling). Friction follows the normal velocity, which
    follows from the first of them.
    """
    for a in closed:
        A, w = inertia[contacts.link[a]], wrench[contacts.link[a]]
        normal = direction(contacts, frame, a, 0)
        along, across = direction(contacts, frame, a, 1), direction(contacts, frame, a, 2)
        S_N, shift = contacts.S_N[a], contacts.shift[a]
        for k in range(6):
            w[k] += (contacts.P_0[a, 0] - S_N * shift) * normal[k]
            for j in range(6):
                A[k, j] += S_N * normal[k] * normal[j]
        add_friction_law(contacts, a, SLIDING, normal, along, across, w, A)
        if rolling:
            r = contacts.radius[a]
            turn = -r * frame[a, 2, 0], -r * frame[a, 2, 1], -r * frame[a, 2, 2], 0.0, 0.0, 0.0
            roll = r * frame[a, 1, 0], r * frame[a, 1, 1], r * frame[a, 1, 2], 0.0, 0.0, 0.0
            add_friction_law(contacts, a, ROLLING, normal, turn, roll, w, A)


@inlined
def add_friction_law(contacts, a, kind, normal, along, across, wrench, inertia):
    """Add the law of one kind of friction at contact a to its link, along two directions."""
    k, shift = 1 + 2 * kind, contacts.shift[a]
    S_xx, S_xy, S_yy = contacts.S_xx[a, kind], contacts.S_xy[a, kind], contacts.S_yy[a, kind]
    S_xN, S_yN = contacts.S_xN[a, kind], contacts.S_yN[a, kind]
    P_x, P_y = contacts.P_0[a, k] - S_xN * shift, contacts.P_0[a, k + 1] - S_yN * shift
    for i in range(6):
        wrench[i] += P_x * along[i] + P_y * across[i]
        for j in range(6):
            x = S_xN * normal[j] + S_xx * along[j] + S_xy * across[j]
            y = S_yN * normal[j] + S_xy * along[j] + S_yy * across[j]
            inertia[i, j] += along[i] * x + across[i] * y


@merged
def linear_impulses(closed, contacts, rolling):
    """Fill the impulses of the linear laws at GAMMA, from those at TRIAL: few digits cancel."""
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


@inlined
def count_single(closed, contacts, pairs):
    """Return the number of contacts without those of two links, which are listed last."""
    if pairs is None:
        return len(closed)
    count = len(closed)
    while count > 0 and contacts.other_link[closed[count - 1]] >= 0:
        count -= 1
    return count


@inlined
def couple_pairs(again, closed, width, contacts, chain, pairs):
    """
    Add to the twists what the contacts of two links do to them; fill the impulses of these.

    They couple two links, which a sweep over the chain cannot fold into the inertia of one. The
    chain is solved for a unit of every component of their impulses instead; what is left is a
    small dense problem. `pair_delassus` is the Delassus operator of the chain, None without such
    contacts. Whenever the twists are corrected, so are these impulses: solved for once, they keep
    what rounding left of the twists, 1e-7 m/s and more, and Newton's method circles there.

    Parameters
    ----------
    again : bool
        Whether to correct the impulses for what the laws leave at the twists now.

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
    """Fill G of the contacts of two links on the prepared chain; set their impulses to 0."""
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
    Fill the impulses with what the laws leave at GAMMA, answered by G; keep the old ones packed.

    To be added to the old ones. The stiffness of the laws costs as many digits here as in the
    chain, see `articulated_body.find_residual`.
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
    """Add to the impulses those that `solve_correction` kept."""
    for k, a in enumerate(closed):
        for j in range(width):
            contacts.impulse[a, j] += delassus.packed[width * k + j]


@inlined
def linear_step(problem, delassus):
    """
    Fill GAMMA and IMPULSE with the solution for the laws linear about TRIAL.

    Without a Delassus operator (None) the chain is solved with the laws, else G without the chain.

    Returns
    -------
    bool
        Whether the solution is finite.

    """
    laws, closed, contacts, chain = problem
    linearize(laws, closed, contacts)
    rolling = laws.rolling.mu_x > 0.0
    if delassus is not None:
        width = 5 if rolling else 3
        finite = solve_condensed(closed, width, contacts, delassus)
        if (
            chain.pair_delassus is not None
        ):  # links that are pressed together, stiff where little moves
            solve_correction(closed, width, contacts, delassus)
            add_kept_impulses(closed, width, contacts, delassus)
            condensed_velocities(closed, width, contacts, delassus)
        return finite
    reset_chain(chain)
    single = closed[: count_single(closed, contacts, chain.pair_delassus)]
    add_laws(single, contacts, chain.frame, rolling, chain.wrench, chain.inertia)
    factor_chain(chain)
    for k in range(MOST_CORRECTIONS if len(closed) > 0 else 1):  # a chain in the air is not stiff
        if k > 0:  # once more for what rounding left
            fill_wrenches(closed, contacts, chain)
            find_residual(chain)
        largest = correct_chain(chain)
        largest = max(
            largest,
            couple_pairs(k > 0, closed[len(single) :], 3, contacts, chain, chain.pair_delassus),
        )
        contact_velocities(closed, contacts, chain.frame, chain.twist)
        linear_impulses(single, contacts, rolling)
        if k > 0 and not largest > SMALL_CORRECTION:
            break
    return math.isfinite(chain.twist[0, 3] + chain.twist[len(chain.twist) - 1, 3])

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

from snake_sim_ros.contact.contacts import add_contact_wrench
from snake_sim_ros.contact.contacts import CENTER
from snake_sim_ros.contact.contacts import contact_velocities
from snake_sim_ros.contact.contacts import direction
from snake_sim_ros.contact.contacts import GAMMA
from snake_sim_ros.contact.contacts import HEADING
from snake_sim_ros.contact.contacts import IMPULSE
from snake_sim_ros.contact.contacts import LAW
from snake_sim_ros.contact.contacts import LINK
from snake_sim_ros.contact.contacts import OTHER
from snake_sim_ros.contact.contacts import POINT
from snake_sim_ros.contact.contacts import RADIUS
from snake_sim_ros.contact.contacts import rolling_disc
from snake_sim_ros.contact.contacts import SHIFT
from snake_sim_ros.contact.contacts import sliding_disc
from snake_sim_ros.contact.delassus import condensed_system
from snake_sim_ros.contact.delassus import condensed_velocities
from snake_sim_ros.contact.delassus import eliminate
from snake_sim_ros.contact.delassus import load_chain
from snake_sim_ros.contact.delassus import solve_condensed
from snake_sim_ros.dynamics.articulated_body import correct_chain
from snake_sim_ros.dynamics.articulated_body import factor_chain
from snake_sim_ros.dynamics.articulated_body import left_over
from snake_sim_ros.dynamics.articulated_body import respond
from snake_sim_ros.dynamics.articulated_body import unload_chain
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.compilation import merged

# More columns of the table of contacts; GAMMA and IMPULSE are the solution of a linear problem.
# LAW: P_N, S_NN at gamma = 0; then for sliding and for rolling P_x, P_y, S_xx, S_xy, S_yy, S_xN,
# S_yN of P = P_0 - S gamma.
SLIDING = LAW + 2
ROLLING = LAW + 9
TRIAL = LAW + 16  # relative velocities about which the laws are linear
ITERATE = TRIAL + 5  # impulses that go with them
ANCHOR = ITERATE + 5  # impulses that the proximal point method starts from
DISC = ANCHOR + 5  # radius of the disc if it is held, FREE if it is the normal impulse
HELD = DISC + 1  # radius to hold next
STEP = HELD + 1  # how far the one held before was from what it led to
FORCE = STEP + 1  # impulses of the laws at TRIAL
SAVED = FORCE + 5  # trial and iterate, to come back to
NOTED = SAVED + 10  # whether the contact is in the list of the closed ones; see newton.remember
FREE = -1.0

CORRECTIONS = 4  # of the twists, at most
SMALL = 1e-6  # correction after which the next one would be rounding [m/s, rad/s]


@compiled
def normal_law(laws, center, anchor, gamma):
    """Return the impulse that follows from gamma_N, and its derivative with the opposite sign."""
    proximal = 0.0 if laws.compliance > 1e-2 * laws.proximal else laws.proximal
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
def linearize_disc(disc, table, a, radius, S_N):
    """Fill the law of one kind of friction at contact a; S_N is how the radius follows gamma_N."""
    k = disc.column
    x, y, normal = table[a, TRIAL + k], table[a, TRIAL + k + 1], table[a, TRIAL]
    P_x, P_y, S_xx, S_xy, S_yy, d_x, d_y = disc_law(
        disc, table[a, ANCHOR + k], table[a, ANCHOR + k + 1], x, y, radius
    )
    law = SLIDING if k == 1 else ROLLING
    table[a, FORCE + k], table[a, FORCE + k + 1] = P_x, P_y
    S_xN, S_yN = d_x * S_N, d_y * S_N
    table[a, law] = P_x + S_xx * x + S_xy * y + S_xN * normal
    table[a, law + 1] = P_y + S_xy * x + S_yy * y + S_yN * normal
    table[a, law + 2], table[a, law + 3], table[a, law + 4] = S_xx, S_xy, S_yy
    table[a, law + 5], table[a, law + 6] = S_xN, S_yN


@merged
def linearize(laws, contact, table):
    """Fill the laws of all contacts, linear about TRIAL."""
    for a in contact:
        P_N, S_N = normal_law(laws, table[a, CENTER], table[a, ANCHOR], table[a, TRIAL])
        table[a, FORCE] = P_N
        table[a, LAW], table[a, LAW + 1] = P_N + S_N * table[a, TRIAL], S_N
        radius, follow = (P_N, S_N) if table[a, DISC] == FREE else (table[a, DISC], 0.0)
        linearize_disc(sliding_disc(laws, laws.other, a), table, a, radius, follow)
        if laws.rolling.mu_x > 0.0:
            linearize_disc(rolling_disc(laws, laws.other, a), table, a, radius, follow)


@inlined
def add_laws(contact, table, frame, rolling, wrench, inertia):
    """Add the linear laws to the wrenches and to the inertias of the links."""
    if frame is not None:
        add_laws_in_frames(contact, table, frame, rolling, wrench, inertia)
        return
    n = len(wrench)
    for a in contact:
        i = a if a < n else a - n
        add_point_law(table, a, wrench, inertia, i)
        if rolling:
            add_rolling_law(table, a, wrench, inertia, i)


@merged
def add_point_law(table, a, wrench, inertia, i):
    """
    Add to link i the impulse ``P_0 - S gamma`` of contact a, normal and sliding.

    In axes of I it is ``force - K v``, ``v = v_O + omega x p`` the velocity of the contact point,
    K = [[xx, xy, xz], [xy, yy, yz], [0, 0, zz]]; about O that is A += J^T K J, J = [-p~, 1].
    """
    cx, cy = table[a, HEADING], table[a, HEADING + 1]
    x, y, z = table[a, POINT], table[a, POINT + 1], table[a, POINT + 2]
    S_xN, S_yN, shift = table[a, SLIDING + 5], table[a, SLIDING + 6], table[a, SHIFT]
    P_x, P_y = table[a, SLIDING] - S_xN * shift, table[a, SLIDING + 1] - S_yN * shift
    fz = table[a, LAW] - table[a, LAW + 1] * shift
    fx, fy = cx * P_x - cy * P_y, cy * P_x + cx * P_y
    wrench[i, 0] += y * fz - z * fy
    wrench[i, 1] += z * fx - x * fz
    wrench[i, 2] += x * fy - y * fx
    wrench[i, 3] += fx
    wrench[i, 4] += fy
    wrench[i, 5] += fz
    S_xx, S_xy, S_yy = table[a, SLIDING + 2], table[a, SLIDING + 3], table[a, SLIDING + 4]
    xx = cx * cx * S_xx - 2.0 * cx * cy * S_xy + cy * cy * S_yy
    xy = cx * cy * (S_xx - S_yy) + (cx * cx - cy * cy) * S_xy
    yy = cy * cy * S_xx + 2.0 * cx * cy * S_xy + cx * cx * S_yy
    xz, yz, zz = cx * S_xN - cy * S_yN, cy * S_xN + cx * S_yN, table[a, LAW + 1]
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
def add_rolling_law(table, a, wrench, inertia, i):
    """Add to link i the rolling torque r (P_v, -P_u) of contact a, eqs. (36), (37)."""
    x, y, r = table[a, POINT], table[a, POINT + 1], table[a, RADIUS]
    wrench[i, 0] += r * (table[a, ROLLING + 1] - table[a, ROLLING + 6] * table[a, SHIFT])
    wrench[i, 1] -= r * (table[a, ROLLING] - table[a, ROLLING + 5] * table[a, SHIFT])
    S_xx, S_xy, S_yy = table[a, ROLLING + 2], table[a, ROLLING + 3], table[a, ROLLING + 4]
    S_xN, S_yN = table[a, ROLLING + 5], table[a, ROLLING + 6]
    inertia[i, 0, 0] += r * r * S_yy + r * S_yN * y
    inertia[i, 0, 1] -= r * r * S_xy + r * S_yN * x
    inertia[i, 0, 5] += r * S_yN
    inertia[i, 1, 0] -= r * r * S_xy + r * S_xN * y
    inertia[i, 1, 1] += r * r * S_xx + r * S_xN * x
    inertia[i, 1, 5] -= r * S_xN


@compiled
def add_laws_in_frames(contact, table, frame, rolling, wrench, inertia):
    """
    Do what `add_laws` does, for contacts with frames: wrench += W P_0, A += W S W^T.

    W are the directions (normal, sliding; rolling). Friction follows the normal velocity, which
    follows from the first of them.
    """
    for a in contact:
        A, w = inertia[int(table[a, LINK])], wrench[int(table[a, LINK])]
        normal = direction(table, frame, a, 0)
        along, across = direction(table, frame, a, 1), direction(table, frame, a, 2)
        S_N, shift = table[a, LAW + 1], table[a, SHIFT]
        for k in range(6):
            w[k] += (table[a, LAW] - S_N * shift) * normal[k]
            for j in range(6):
                A[k, j] += S_N * normal[k] * normal[j]
        add_friction_law(table, a, SLIDING, normal, along, across, w, A)
        if rolling:
            r = table[a, RADIUS]
            turn = -r * frame[a, 2, 0], -r * frame[a, 2, 1], -r * frame[a, 2, 2], 0.0, 0.0, 0.0
            roll = r * frame[a, 1, 0], r * frame[a, 1, 1], r * frame[a, 1, 2], 0.0, 0.0, 0.0
            add_friction_law(table, a, ROLLING, normal, turn, roll, w, A)


@inlined
def add_friction_law(table, a, law, normal, along, across, wrench, inertia):
    """Add the law of one kind of friction at contact a to its link, along two directions."""
    S_xx, S_xy, S_yy = table[a, law + 2], table[a, law + 3], table[a, law + 4]
    S_xN, S_yN, shift = table[a, law + 5], table[a, law + 6], table[a, SHIFT]
    P_x, P_y = table[a, law] - S_xN * shift, table[a, law + 1] - S_yN * shift
    for k in range(6):
        wrench[k] += P_x * along[k] + P_y * across[k]
        for j in range(6):
            x = S_xN * normal[j] + S_xx * along[j] + S_xy * across[j]
            y = S_yN * normal[j] + S_xy * along[j] + S_yy * across[j]
            inertia[k, j] += along[k] * x + across[k] * y


@merged
def linear_impulses(contact, table, rolling):
    """Fill the impulses of the linear laws at GAMMA, from those at TRIAL: few digits cancel."""
    for a in contact:
        normal = table[a, GAMMA] - table[a, TRIAL]
        table[a, IMPULSE] = table[a, FORCE] - table[a, LAW + 1] * normal
        for k in range(1, 5 if rolling else 3, 2):
            law = SLIDING if k == 1 else ROLLING
            x = table[a, GAMMA + k] - table[a, TRIAL + k]
            y = table[a, GAMMA + k + 1] - table[a, TRIAL + k + 1]
            S_xx, S_xy, S_yy = table[a, law + 2], table[a, law + 3], table[a, law + 4]
            S_xN, S_yN = table[a, law + 5], table[a, law + 6]
            P_x, P_y = table[a, FORCE + k], table[a, FORCE + k + 1]
            table[a, IMPULSE + k] = P_x - S_xx * x - S_xy * y - S_xN * normal
            table[a, IMPULSE + k + 1] = P_y - S_xy * x - S_yy * y - S_yN * normal


@inlined
def single_count(contact, table, pairs):
    """Return the number of contacts without those of two links, which are listed last."""
    if pairs is None:
        return len(contact)
    count = len(contact)
    while count > 0 and table[contact[count - 1], OTHER] >= 0.0:
        count -= 1
    return count


@inlined
def couple_pairs(again, contact, width, table, chain, pairs):
    """
    Add to the twists what the contacts of two links do to them; fill the impulses of these.

    They couple two links, which a sweep over the chain cannot fold into the inertia of one. The
    chain is solved for a unit of every component of their impulses instead; what is left is a
    small dense problem. `pairs` is the Delassus operator of the chain, None without such contacts.
    Whenever the twists are corrected, so are these impulses: solved for once, they keep what
    rounding left of the twists, 1e-7 m/s and more, and Newton's method circles there.

    Parameters
    ----------
    again : bool
        Whether to correct the impulses for what the laws leave at the twists now.

    Returns
    -------
    float
        Largest component of a twist that was added.

    """
    if pairs is None or len(contact) == 0:
        return 0.0
    for j in range(len(chain.left_over)):
        chain.left_over[j, 0] = chain.left_over[j, 1] = 0.0
    if not again:
        respond_to_pairs(contact, width, table, chain, pairs)
    contact_velocities(contact, table, chain.frame, chain.twist)
    solve_left_over(contact, width, table, pairs)
    chain.wrench[:] = 0.0
    add_contact_wrench(contact, table, chain.frame, chain.wrench)
    add_packed(contact, width, table, pairs)
    return correct_chain(chain)


@compiled
def respond_to_pairs(contact, width, table, chain, pairs):
    """Fill G of the contacts of two links on the prepared chain; set their impulses to 0."""
    for a in contact:
        table[a, IMPULSE : IMPULSE + 5] = 0.0
    for k, a in enumerate(contact):
        for j in range(width):
            row = pairs.operator[width * k + j]
            stiffness = table[a, LAW + 1]
            if j > 0:
                stiffness = table[a, SLIDING + 2] + table[a, SLIDING + 4]
            if stiffness == 0.0:  # the impulse is 0
                row[: width * len(contact)] = 0.0
                continue
            table[a, IMPULSE + j] = 1.0
            chain.wrench[:] = 0.0
            add_contact_wrench(contact[k : k + 1], table, chain.frame, chain.wrench)
            table[a, IMPULSE + j] = 0.0
            respond(chain)
            contact_velocities(contact, table, chain.frame, chain.correction)
            for other, b in enumerate(contact):
                for i in range(width):
                    shift = table[b, SHIFT] if i == 0 else 0.0
                    row[width * other + i] = table[b, GAMMA + i] - shift


@compiled
def solve_left_over(contact, width, table, delassus):
    """
    Fill the impulses with what the laws leave at GAMMA, answered by G; keep the old ones packed.

    To be added to the old ones. The stiffness of the laws costs as many digits here as in the
    chain, see `articulated_body.left_over`.
    """
    rows = width * len(contact)
    B, packed = delassus.system, delassus.packed
    for k, a in enumerate(contact):
        for j in range(width):
            packed[width * k + j] = table[a, IMPULSE + j]
    condensed_system(contact, width, table, LAW, delassus)
    linear_impulses(contact, table, width > 3)
    for k, a in enumerate(contact):
        for j in range(width):
            B[width * k + j, rows] = table[a, IMPULSE + j] - packed[width * k + j]
    eliminate(B, rows)
    for k, a in enumerate(contact):
        for j in range(width):
            table[a, IMPULSE + j] = B[width * k + j, rows]


@inlined
def add_packed(contact, width, table, delassus):
    """Add to the impulses those that `solve_left_over` kept."""
    for k, a in enumerate(contact):
        for j in range(width):
            table[a, IMPULSE + j] += delassus.packed[width * k + j]


@inlined
def linear_step(laws, contact, table, chain, delassus):
    """
    Fill GAMMA and IMPULSE with the solution for the laws linear about TRIAL.

    Without a Delassus operator (None) the chain is solved with the laws, else G without the chain.

    Returns
    -------
    bool
        Whether the solution is finite.

    """
    linearize(laws, contact, table)
    rolling = laws.rolling.mu_x > 0.0
    if delassus is not None:
        width = 5 if rolling else 3
        finite = solve_condensed(contact, width, table, LAW, delassus)
        if chain.pairs is not None:  # links that are pressed together, stiff where little moves
            solve_left_over(contact, width, table, delassus)
            add_packed(contact, width, table, delassus)
            condensed_velocities(contact, width, table, delassus)
        return finite
    unload_chain(chain)
    single = contact[: single_count(contact, table, chain.pairs)]
    add_laws(single, table, chain.frame, rolling, chain.wrench, chain.inertia)
    factor_chain(chain)
    for k in range(CORRECTIONS if len(contact) > 0 else 1):  # a chain in the air is not stiff
        if k > 0:  # once more for what rounding left
            load_chain(contact, table, chain)
            left_over(chain)
        largest = correct_chain(chain)
        largest = max(
            largest, couple_pairs(k > 0, contact[len(single) :], 3, table, chain, chain.pairs)
        )
        contact_velocities(contact, table, chain.frame, chain.twist)
        linear_impulses(single, table, rolling)
        if k > 0 and not largest > SMALL:
            break
    return math.isfinite(chain.twist[0, 3] + chain.twist[len(chain.twist) - 1, 3])

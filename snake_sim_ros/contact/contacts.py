"""
Compiled mechanics of the contacts: eqs. (9)-(37), (76), and the judge of all contact solvers.

Contacts a are numbered as in eq. (10), fronts first; `contact` lists the closed ones. All that
belongs to a contact is in its row of the table, under the columns named below. An impulse, and the
relative velocity that goes with it, is (normal, sliding along and across the link, rolling along x
and y of I).

Where there is more than a flat floor, contacts have frames in an array of their own, and rolling
is along the axes of the frame; see `scenery`. Without it the array is None.
"""

import math
from typing import NamedTuple

from snake_sim_ros.contact.projections import DEPTH
from snake_sim_ros.contact.projections import FINE
from snake_sim_ros.contact.projections import IMPACT
from snake_sim_ros.contact.projections import prox_ellipse
from snake_sim_ros.contact.projections import REST
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.compilation import merged

# Columns of the table.
POINT = 0  # contact point from O
HEADING = 3  # horizontal direction of the link axis: e_x of the contact frame
RADIUS = 5  # of the sphere
GAMMA = 6  # relative velocities [m/s]
IMPULSE = 11  # impulses [N s]
GAP = 16  # gap [m]
SHIFT = 17  # velocity that a gap still leaves open: a part of the normal GAMMA [m/s]
START = 18  # normal velocity before the contacts act [m/s]
CENTER = 19  # normal impulse about which the selection rule is compliant [N s]
LINK = 20  # number of the link, and of the other one it touches or -1; in contacts with frames
OTHER = 21
LAST = 22  # normal impulse of the last step [N s]
LAW = 23  # first column of `linear_laws`

FRICTIONLESS = 1e-100  # friction of which nothing is left in squares


class Disc(NamedTuple):
    """Friction coefficients of one kind, scaled to a disc; see linear_laws."""

    column: int  # of the first component among those of an impulse
    mu_x: float
    mu_y: float
    over_x: float  # 1/mu_x and 1/mu_y, or 0
    over_y: float
    stiffness: float  # of the proximal point method, in scaled components; 0 without friction


def make_disc(column: int, mu_x: float, mu_y: float, proximal: float) -> Disc:
    """Return friction coefficients scaled to a disc, for a compliance [1/kg]."""
    mu_x, mu_y = (mu if mu > FRICTIONLESS else 0.0 for mu in (mu_x, mu_y))
    return Disc(
        column=column,
        mu_x=mu_x,
        mu_y=mu_y,
        over_x=1.0 / mu_x if mu_x > 0.0 else 0.0,
        over_y=1.0 / mu_y if mu_y > 0.0 else 0.0,
        stiffness=2.0 / (proximal * (mu_x**2 + mu_y**2)) if max(mu_x, mu_y) > 0.0 else 0.0,
    )


class OtherFriction(NamedTuple):
    """Friction of contacts that are not with the ground: with pegs, then of two links."""

    first_peg: int
    first_pair: int
    peg: Disc
    pair: Disc
    rolling: Disc  # none


class Laws(NamedTuple):
    """The numbers of the contact laws and of their judge."""

    sliding: Disc
    rolling: Disc
    compliance: float  # of the selection rule [1/kg]
    least: float  # compliance that the rule is not reduced below [1/kg]
    proximal: float  # compliance of the proximal point method [1/kg]
    r_N: float
    r_T: float
    r_V: float
    other: OtherFriction | None = None  # where there is more than a flat floor


@inlined
def sliding_disc(laws, other, a):
    """Return the sliding friction of contact a; `other` is that of the laws."""
    if other is None:
        return laws.sliding
    if a >= other.first_pair:
        return other.pair
    return other.peg if a >= other.first_peg else laws.sliding


@inlined
def rolling_disc(laws, other, a):
    """Return the rolling friction of contact a; `other` is that of the laws."""
    if other is None:
        return laws.rolling
    return other.rolling if a >= other.first_peg else laws.rolling


@inlined
def link_of(other, table, n, a):
    """Return the link of contact a; `other` is the friction of the laws."""
    if other is None:
        return a if a < n else a - n
    return int(table[a, LINK])


@merged
def closed_contacts(tolerance, offset, radius, height, R, center, contact, table):
    """
    Fill closed contacts, their points and frames; return how many are closed.

    Deviation: a contact counts as closed up to a gap of `tolerance` [m], not of 0: gaps at the
    size of rounding do not open and close contacts.

    Deviation: a vertical link has no heading; e_x^I stands in for it, as in `reference.py`.
    """
    n = len(R)
    count = 0
    for i in range(n):
        x, y, z = R[i, 0, 2], R[i, 1, 2], R[i, 2, 2]
        for a, signed in ((i, offset[i]), (n + i, -offset[i])):
            gap = height[i] + signed * z - radius[i]
            if gap <= tolerance:
                contact[count] = a
                count += 1
                table[a, GAP] = gap
                table[a, SHIFT] = 0.0
                c = math.sqrt(x * x + y * y)
                flat = c > 1e-6
                table[a, HEADING] = x / c if flat else 1.0
                table[a, HEADING + 1] = y / c if flat else 0.0
                table[a, POINT] = center[i, 0] + signed * x
                table[a, POINT + 1] = center[i, 1] + signed * y
                table[a, POINT + 2] = center[i, 2] + signed * z - radius[i]
                table[a, RADIUS] = radius[i]
    return count


@compiled
def add_contact_wrench(contact, table, frame, wrench):
    """Add the impulse wrench S of the contacts to that of every link, eq. (76)."""
    if frame is not None:
        add_wrench_in_frames(contact, table, frame, wrench)
        return
    n = len(wrench)
    for a in contact:
        i = a if a < n else a - n
        cx, cy = table[a, HEADING], table[a, HEADING + 1]
        x, y, z = table[a, POINT], table[a, POINT + 1], table[a, POINT + 2]
        px = cx * table[a, IMPULSE + 1] - cy * table[a, IMPULSE + 2]
        py = cy * table[a, IMPULSE + 1] + cx * table[a, IMPULSE + 2]
        pz = table[a, IMPULSE]
        wrench[i, 0] += y * pz - z * py + table[a, RADIUS] * table[a, IMPULSE + 4]
        wrench[i, 1] += z * px - x * pz - table[a, RADIUS] * table[a, IMPULSE + 3]
        wrench[i, 2] += x * py - y * px
        wrench[i, 3] += px
        wrench[i, 4] += py
        wrench[i, 5] += pz


@compiled
def contact_velocities(contact, table, frame, twist):
    """Fill the relative velocities of the closed contacts, eqs. (90)-(92)."""
    if frame is not None:
        velocities_in_frames(contact, table, frame, twist)
        return
    n = len(twist)
    for a in contact:
        i = a if a < n else a - n
        cx, cy = table[a, HEADING], table[a, HEADING + 1]
        x, y, z = table[a, POINT], table[a, POINT + 1], table[a, POINT + 2]
        wx, wy, wz = twist[i, 0], twist[i, 1], twist[i, 2]
        vx = twist[i, 3] + wy * z - wz * y
        vy = twist[i, 4] + wz * x - wx * z
        table[a, GAMMA] = twist[i, 5] + wx * y - wy * x + table[a, SHIFT]
        table[a, GAMMA + 1] = cx * vx + cy * vy
        table[a, GAMMA + 2] = cx * vy - cy * vx
        table[a, GAMMA + 3] = -table[a, RADIUS] * wy
        table[a, GAMMA + 4] = table[a, RADIUS] * wx


@inlined
def direction(table, frame, a, k):
    """Return the wrench of a unit impulse along axis k of the frame of contact a."""
    x, y, z = table[a, POINT], table[a, POINT + 1], table[a, POINT + 2]
    ex, ey, ez = frame[a, k, 0], frame[a, k, 1], frame[a, k, 2]
    return y * ez - z * ey, z * ex - x * ez, x * ey - y * ex, ex, ey, ez


@compiled
def add_wrench_in_frames(contact, table, frame, wrench):
    """Do what `add_contact_wrench` does, for contacts with frames."""
    for a in contact:
        i, other = int(table[a, LINK]), int(table[a, OTHER])
        for k in range(3):
            w = direction(table, frame, a, k)
            for j in range(6):
                wrench[i, j] += table[a, IMPULSE + k] * w[j]
                if other >= 0:
                    wrench[other, j] -= table[a, IMPULSE + k] * w[j]
        for k in range(3):
            roll = table[a, IMPULSE + 4] * frame[a, 1, k] - table[a, IMPULSE + 3] * frame[a, 2, k]
            wrench[i, k] += table[a, RADIUS] * roll


@compiled
def velocities_in_frames(contact, table, frame, twist):
    """Do what `contact_velocities` does, for contacts with frames."""
    for a in contact:
        i, other = int(table[a, LINK]), int(table[a, OTHER])
        for k in range(3):
            w = direction(table, frame, a, k)
            gamma = table[a, SHIFT] if k == 0 else 0.0
            for j in range(6):
                gamma += w[j] * (twist[i, j] - (twist[other, j] if other >= 0 else 0.0))
            table[a, GAMMA + k] = gamma
        along = across = 0.0
        for k in range(3):
            along += frame[a, 1, k] * twist[i, k]
            across += frame[a, 2, k] * twist[i, k]
        table[a, GAMMA + 3] = -table[a, RADIUS] * across
        table[a, GAMMA + 4] = table[a, RADIUS] * along


@inlined
def depth_share(table, a):
    """Return the depth of contact a over DEPTH, 0 if it is not inside."""
    return max(0.0, -table[a, GAP]) / DEPTH


@inlined
def selected(laws, contact, table, mass, impulse, press, dt, fall):
    """
    Fill CENTER, and return the laws with the compliance that this step selects with.

    GAMMA is of the start of a step of dt [s], impulse of the last one; weight adds `fall` [m/s].

    Deviation: the compliance of the selection rule moves a contact into the floor by compliance
    times P_N. It is reduced where that would be more than `press`, for the largest normal impulse
    that is to be expected: the last one of a contact, or twice what stops its link alone and half
    its weight.

    Deviation: while all contacts that carry load are at rest, the rule selects the impulses next
    to the last ones instead of those of least norm, so that nothing sinks or creeps. Beside those
    of an impact it would make bodies bounce.
    """
    n = len(mass)
    most = fastest = heaviest = 0.0
    for m in mass:
        heaviest += IMPACT * m * fall
    for a in contact:
        stop = 0.5 * fall - 2.0 * table[a, GAMMA]
        most = max(most, impulse[a, 0], mass[link_of(laws.other, table, n, a)] * stop)
        if impulse[a, 0] > 0.0:
            slip = max(abs(table[a, GAMMA + 1]), abs(table[a, GAMMA + 2]))
            fastest = max(fastest, abs(table[a, GAMMA]), slip)
    compliance = laws.compliance
    if most > 0.0:
        compliance = min(compliance, max(laws.least, press / most))
    highest = max(press / compliance, min(most, heaviest)) if compliance > 0.0 else 0.0
    mean, loaded, own = 0.0, 0, min(1.0, FINE / dt)
    for a in contact:
        if impulse[a, 0] > 0.0:
            mean += min(1.0, depth_share(table, a))
            loaded += 1
    mean /= max(1, loaded)
    for a in contact:
        share = 0.0  # of a contact that lands
        if impulse[a, 0] > 0.0:
            share = min(1.0, max(0.0, mean + own * (depth_share(table, a) - mean)))
        rests = fastest <= REST
        table[a, CENTER] = min(impulse[a, 0], heaviest) if rests else share * highest
    return Laws(
        laws.sliding, laws.rolling, compliance, laws.least, laws.proximal,
        laws.r_N, laws.r_T, laws.r_V, laws.other,
    )  # fmt: skip


@compiled
def natural_map(laws, contact, table, enough):
    """
    Return how far closed contacts are from their laws: ``max |P - prox_C(P - r gamma)|/r`` [m/s].

    This is the one judge of all solvers. The sets of sliding and rolling are those of the normal
    impulse given. Where an upper bound for orthotropic sliding is not above `enough`, it stands
    for the value: the projection on an ellipse is not cheap.

    Returns
    -------
    residual : float
        Of the laws with the selection rule: ``gamma_N + compliance (P_N - CENTER)`` for gamma_N.
    printed_residual : float
        Of the laws of the paper, without the rule.

    """
    if enough > 0.0 and laws.rolling.mu_x <= 0.0:
        residual, printed = sliding_bound(laws, laws.other, contact, table)
        if residual <= enough:
            return residual, printed
    selected = printed = tangential = 0.0
    for a in contact:
        P_N = table[a, IMPULSE]
        x = P_N - laws.r_N * table[a, GAMMA]
        rule = laws.compliance * (P_N - table[a, CENTER])
        selected = max(selected, abs(P_N - max(0.0, x - laws.r_N * rule)))
        printed = max(printed, abs(P_N - max(0.0, x)))
        slide = disc_misfit(
            table[a, IMPULSE + 1], table[a, IMPULSE + 2], table[a, GAMMA + 1],
            table[a, GAMMA + 2], sliding_disc(laws, laws.other, a), P_N, laws.r_T, enough,
        )  # fmt: skip
        tangential = max(tangential, slide)
        if laws.rolling.mu_x > 0.0:
            roll = disc_misfit(
                table[a, IMPULSE + 3], table[a, IMPULSE + 4], table[a, GAMMA + 3],
                table[a, GAMMA + 4], rolling_disc(laws, laws.other, a), P_N, laws.r_V, enough,
            )  # fmt: skip
            tangential = max(tangential, roll)
    return max(selected / laws.r_N, tangential), max(printed / laws.r_N, tangential)


@inlined
def sliding_bound(laws, other, contact, table):
    """
    Return upper bounds of what `natural_map` does, at one root a contact, or infinity.

    They are for one kind of friction; `other` is that of the laws.
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
    for a in contact:
        P_N, P_x, P_y = table[a, IMPULSE], table[a, IMPULSE + 1], table[a, IMPULSE + 2]
        gamma_x, gamma_y = table[a, GAMMA + 1], table[a, GAMMA + 2]
        x = P_N - laws.r_N * table[a, GAMMA]
        rule = laws.compliance * (P_N - table[a, CENTER])
        selected = max(selected, abs(P_N - max(0.0, x - laws.r_N * rule)))
        printed = max(printed, abs(P_N - max(0.0, x)))
        x, y = over_x * (P_x - r * gamma_x), over_y * (P_y - r * gamma_y)
        if x * x + y * y <= P_N * P_N:
            stick = max(stick, gamma_x * gamma_x + gamma_y * gamma_y)
        else:  # as in disc_misfit, whose second part is shorter than the first
            e_x = P_x * over_x - weight * mu_x * gamma_x
            e_y = P_y * over_y - weight * mu_y * gamma_y
            shrink = min(1.0, max(0.0, P_N) / math.sqrt(e_x * e_x + e_y * e_y))
            d_x, d_y = P_x - mu_x * shrink * e_x, P_y - mu_y * shrink * e_y
            slip = max(slip, d_x * d_x + d_y * d_y)
    share = 2.0 - (lowest * min(over_x, over_y)) ** 2
    tangential = max(math.sqrt(stick), share * math.sqrt(slip) / r)
    return max(selected / laws.r_N, tangential), max(printed / laws.r_N, tangential)


@inlined
def disc_misfit(P_x, P_y, gamma_x, gamma_y, disc, bound, r, enough):
    """
    Return ``|P - prox(P - r gamma)|/r`` for half axes (mu_x, mu_y) bound, or an upper bound of it.

    Let e be the point of the ellipse S disc, S = diag(mu_x, mu_y), that the disc projection of
    ``S^-1 P - r/mu_min^2 S gamma`` gives. Then P - r gamma lies ``(1 - mu_min^2 S^-2)(P - e)``
    beside the normal of the ellipse in e, and because projections do not expand, the residual is
    at most that and |P - e| together. For a disc this is |P - e|, the value itself.
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

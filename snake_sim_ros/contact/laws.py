# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The set-valued contact laws: admissible sets, projections, residual, and the selection rule.

A law is an inclusion in the normal cone of a convex set C, ``-gamma in N_C(P)``, section V of the
paper. It is equivalent to ``P = prox_C(P - r gamma)`` for any r > 0. The sets are cones in the
normal impulse, so that one law covers contact forces and impacts. Impulses are in N s. The
natural-map residual, by which all contact solvers are judged, measures how far that equation does
not hold.

The selection rule, `apply_selection_rule`, says which normal impulses a step takes where they are
not unique. `test/oracle/contact_laws.py` has it in NumPy.

Functions here take the part ``laws.other`` beside the laws themselves, as an argument `other`.
Numba leaves out a branch on None only where an argument is None, not a field of one, and a scene
with a flat floor must not pay for the branches of other scenes.
"""

import math
from typing import NamedTuple

from snake_sim_ros.contact.contacts import Contacts
from snake_sim_ros.contact.directions import direction
from snake_sim_ros.dynamics.articulated_body import Chain
from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.scene.obstacles import first_pair, first_peg, is_flat
from snake_sim_ros.scene.parameters import Array, Scene

FRICTIONLESS = 1e-100  # coefficients whose squares would underflow count as zero
PRESS_SPEED = 5e-7  # velocity at which the selection rule may press a contact into the floor [m/s]
IMPACT_WEIGHTS = 10.0  # an impulse of more weights of the robot in a step is that of an impact
REST_SPEED = 1e-6  # velocity up to which a contact that carries load is at rest [m/s]
# Compliance of the proximal point method for friction, relative to the Delassus operator. It
# changes no solution. An iteration leaves ``1/(1 + eigenvalue/STICKING)`` of an error along an
# eigenvector of that operator. Contacts that stick on links nearly in line hold each other, with
# eigenvalues of 1e-6 and less. With a smaller compliance, Newton's method converges from fewer
# starts.
STICKING = 1e-6
SELECTING = 1e-2  # the rule selects from this compliance on, relative to the proximal point method
# A step of the projection on an ellipse that is smaller, relative to the result, is the last one:
# its square is below rounding.
LAST_STEP = 1e-8
LEAST_COMPLIANCE = 1e-6  # the rule is not reduced below it; relative to the Delassus operator


class Disc(NamedTuple):
    """Friction coefficients of one kind of friction, scaled to a disc; see `linear_problem`."""

    column: int  # of the first component in an impulse
    mu_x: float  # coefficient along the link [1]
    mu_y: float  # coefficient across it [1]
    over_x: float  # 1/mu_x; 0 where there is no friction [1]
    over_y: float  # 1/mu_y [1]
    stiffness: float  # of the proximal point method, scaled; 0 without friction [kg]


def make_disc(column: int, mu_x: float, mu_y: float, proximal: float) -> Disc:
    """
    Return the friction coefficients of one kind of friction, scaled to a disc.

    Parameters
    ----------
    column : int
        Column of the first of the two components in an impulse: 1 for sliding, 3 for rolling.
    mu_x, mu_y : float
        Friction coefficients along x and y of the contact frame.
    proximal : float
        Compliance of the proximal point method [1/kg].

    """
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
    """
    Friction besides one ellipse everywhere on the ground.

    A contact with the ground has the ellipse `Laws.sliding` while its impulse along the link is
    negative, against sliding forward, and `backward` while it is positive. Both have the same half
    axis across, so that the admissible set, half of each, is convex, and the ellipse in which an
    impulse lies has the same normals. The friction of a contact with the ground is multiplied by
    a factor; see `grip`. Contacts with pegs follow, then those of two links.
    """

    first_peg: int  # number of the first contact with a peg
    first_pair: int  # number of the first contact of two links
    peg: Disc  # sliding friction at pegs
    pair: Disc  # sliding friction between links
    rolling: Disc  # zero: such contacts have no rolling friction
    backward: Disc  # sliding friction against sliding backward
    has_sides: bool  # whether `backward` differs from `Laws.sliding`
    is_viscous: bool  # whether there is viscous friction on the ground
    viscous_x: float  # that of a contact along its link [N s/m]
    viscous_y: float  # and across it [N s/m]
    falls: bool  # whether sliding friction on the ground falls with speed
    kinetic_ratio: float  # at high speed, over that at rest [1]
    stribeck_speed: float  # at which it has fallen half way [m/s]


def make_other_friction(scene: Scene, proximal: float) -> OtherFriction | None:
    """Return friction backward, of pegs and between links, for a compliance [1/kg]."""
    if is_flat(scene):
        return None
    floor = scene.friction
    mu, mu_pair = scene.pegs.friction, scene.self_contact_friction
    return OtherFriction(
        first_peg=first_peg(scene),
        first_pair=first_pair(scene),
        peg=make_disc(1, mu, mu, proximal),
        pair=make_disc(1, mu_pair, mu_pair, proximal),
        rolling=make_disc(3, 0.0, 0.0, proximal),
        backward=make_disc(1, floor.against_backward, floor.transversal, proximal),
        has_sides=floor.has_direction,
        is_viscous=floor.is_viscous,
        viscous_x=floor.viscous_of_contact[0],
        viscous_y=floor.viscous_of_contact[1],
        falls=floor.falls,
        kinetic_ratio=floor.kinetic_ratio,
        stribeck_speed=floor.stribeck_speed,
    )


class Laws(NamedTuple):
    """The numbers of the contact laws, of the selection rule and of the natural map."""

    sliding: Disc  # against sliding forward, on the ground
    rolling: Disc  # on the ground
    compliance: float  # of the selection rule [1/kg]
    least_compliance: float  # the rule is not reduced below it [1/kg]
    proximal_compliance: float  # compliance of the proximal point method [1/kg]
    r_N: float  # prox parameter of the normal law [kg]
    r_T: float  # of sliding [kg]
    r_V: float  # of rolling [kg]
    residual_tolerance: float  # residual up to which the laws hold [m/s]
    change_tolerance: float  # change of impulses at which the paper's iteration stops, (93) [N s]
    other: OtherFriction | None = None  # None on a flat floor


@inlined
def sliding_disc(laws: Laws, other: OtherFriction | None, a: int, P_x: float) -> Disc:
    """Return the sliding friction of contact a, for an impulse P_x along its link."""
    if other is None:
        return laws.sliding
    if a >= other.first_pair:
        return other.pair
    return other.peg if a >= other.first_peg else floor_disc(laws, other, P_x)


@inlined
def floor_disc(laws: Laws, other: OtherFriction | None, P_x: float) -> Disc:
    """Return the sliding friction of a contact with the ground, as `sliding_disc` does."""
    if other is None:
        return laws.sliding
    return other.backward if P_x > 0.0 else laws.sliding


@inlined
def anchored_disc(laws: Laws, other: OtherFriction | None, contacts: Contacts, a: int) -> Disc:
    """Return the sliding friction of contact a for its anchor or, from 0, against its trial."""
    P_x = contacts.newton.anchor[a, 1]
    return sliding_disc(laws, other, a, P_x if P_x != 0.0 else -contacts.newton.trial[a, 1])


@inlined
def changes_side(other: OtherFriction | None, contacts: Contacts, a: int) -> bool:
    """Return whether the iterate of contact a has friction of another side than its anchor."""
    if other is None:
        return False
    crosses = contacts.newton.iterate[a, 1] * contacts.newton.anchor[a, 1] < 0.0
    return crosses and other.has_sides and a < other.first_peg


@inlined
def grip(other: OtherFriction | None, contacts: Contacts, a: int) -> float:
    """
    Return the factor of all friction of contact a: that of patches, and of its sliding speed.

    The speed is that of `gamma`: an iteration takes the one that it has found last, and where it
    ends, the residual of the laws is that for the factor at the end of the step.
    """
    geometry, solution = contacts.geometry, contacts.solution
    if other is None:
        return 1.0
    factor = geometry.grip[a]
    if other.falls and a < other.first_peg:
        factor *= stribeck_factor(
            other.kinetic_ratio, other.stribeck_speed, solution.gamma[a, 1], solution.gamma[a, 2]
        )
    return factor


@inlined
def stribeck_factor(ratio: float, speed: float, x: float, y: float) -> float:
    """
    Return sliding friction at a velocity (x, y) [m/s] over that at rest.

    The law is that of [1]_; it has fallen half way to `ratio` at `speed` [m/s].

    .. [1] D. P. Hess, A. Soom, "Friction at a lubricated line contact operating at oscillating
       sliding velocities", J. Tribology 112(1), 1990.
    """
    return ratio + (1.0 - ratio) / (1.0 + (x * x + y * y) / (speed * speed))


@inlined
def viscosity(other: OtherFriction, h: float, contacts: Contacts, a: int) -> tuple[float, float]:
    """Return viscous impulse in a time h [s] over velocity, along and across a link [kg]."""
    factor = h * contacts.geometry.grip[a]
    return factor * other.viscous_x, factor * other.viscous_y


@inlined
def add_viscous_friction(
    other: OtherFriction | None, h: float, closed: Array, contacts: Contacts, chain: Chain
) -> None:
    """
    Add the viscous friction of a step to the inertias of the links, ``M + sum_k c_k h w_k w_k^T``.

    Viscous friction is no inclusion: the impulse -c h gamma_T follows from the velocity at the end
    of the step, as momentum does. So the links resist this velocity, and the impulses of all other
    laws are those without the viscous part. Contacts that are yet to close have none.

    Parameters
    ----------
    other : OtherFriction or None
        ``laws.other``.
    h : float
        Time for which the impulses of the step act [s].
    closed, contacts, chain
        Those of a `problem.Problem`, with shifts; ``chain.bare`` is added to.

    """
    geometry, solution, frame = contacts.geometry, contacts.solution, chain.frame
    if other is None:
        return
    assert frame is not None
    for k in range(len(closed) if other.is_viscous else 0):
        a = closed[k]
        if a < other.first_peg and solution.shift[a] <= 0.0:
            resistance = viscosity(other, h, contacts, a)
            inertia = chain.bare[geometry.link[a]]
            for axis in range(2):
                w = direction(geometry.point, frame, a, axis + 1)
                for i in range(6):
                    for j in range(6):
                        inertia[i, j] += resistance[axis] * w[i] * w[j]


@inlined
def selects(laws: Laws) -> bool:
    """Return whether the selection rule makes normal impulses unique, without a proximal point."""
    return laws.compliance > SELECTING * laws.proximal_compliance


@inlined
def rolls(laws: Laws) -> bool:
    """Return whether any contact has rolling friction."""
    return laws.rolling.mu_x > 0.0


@inlined
def impulse_width(laws: Laws) -> int:
    """Return how many components of an impulse take part: 3, or 5 with rolling friction."""
    return 5 if rolls(laws) else 3


@inlined
def rolling_disc(laws: Laws, other: OtherFriction | None, a: int) -> Disc:
    """Return the rolling friction of contact a."""
    if other is None:
        return laws.rolling
    return other.rolling if a >= other.first_peg else laws.rolling


@compiled
def prox_half_line(x: float) -> float:
    """Return the nearest number that is not negative: Signorini's law, eqs. (52)-(54)."""
    return max(0.0, x)


@compiled
def prox_disc(x: float, y: float, radius: float) -> tuple[float, float]:
    """Return the nearest point of a disc about 0: isotropic sliding and rolling friction."""
    length = math.sqrt(x * x + y * y)
    if length <= radius:
        return x, y
    return x * radius / length, y * radius / length


@inlined
def prox_scaled(disc: Disc, x: float, y: float, radius: float) -> tuple[float, float, bool]:
    """
    Return the impulse in a scaled disc that is next to a scaled one, and whether it is that one.

    The components x and y are those of ``S^-1 P``, S = diag(mu_x, mu_y) [N s]; the impulse that
    is returned is P. What is next to it in the scaled plane is on the ellipse, too, but it is not
    `prox_ellipse`, unless the ellipse is a disc.
    """
    square = x * x + y * y
    shrink = 1.0 if square <= radius * radius else radius / math.sqrt(square)
    return disc.mu_x * shrink * x, disc.mu_y * shrink * y, shrink == 1.0


@compiled
def prox_ellipse(x: float, y: float, a: float, b: float) -> tuple[float, float]:
    """
    Return the nearest point of the ellipse with half axes a, b: orthotropic Coulomb friction.

    The point is ``(x a^2/(t + a^2), y b^2/(t + b^2))``, where t > 0 puts it on the boundary.
    Newton's method solves ``1/s(t) = 1`` from the left, where s^2 is the left side of the equation
    of the ellipse. It converges monotonically because 1/s is increasing and concave, so that it
    needs no safeguard.
    """
    if a <= 0.0 or b <= 0.0:
        return min(max(x, -a), a) if a > 0.0 else 0.0, min(max(y, -b), b) if b > 0.0 else 0.0
    if a == b:
        return prox_disc(x, y, a)
    if x * x * b * b + y * y * a * a <= a * a * b * b:
        return x, y
    scale = 1.0 / max(a, b)
    a, b = scale * a, scale * b
    aa, bb = a * a, b * b
    ux, uy = a * abs(scale * x), b * abs(scale * y)
    t = max(ux - aa, uy - bb, 0.0)
    step = math.inf
    while step > LAST_STEP * (t + min(aa, bb)):
        over_a, over_b = 1.0 / (t + aa), 1.0 / (t + bb)
        p, q = (ux * over_a) ** 2, (uy * over_b) ** 2
        square = p + q
        step = square * (math.sqrt(square) - 1.0) / (p * over_a + q * over_b)
        t += step
    return x * aa / (t + aa), y * bb / (t + bb)


@inlined
def natural_map(
    laws: Laws, closed: Array, contacts: Contacts, enough: float
) -> tuple[float, float]:
    """
    Return how far the closed contacts are from their laws, ``max |P - prox_C(P - r gamma)|/r``.

    All solvers are judged by this residual. The sets of sliding and rolling impulses are those of
    the given normal impulse.

    Parameters
    ----------
    laws, closed, contacts
        Those of a `problem.Problem`; impulse, gamma and selection_center of the contacts are read.
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
    solution = contacts.solution
    if enough > 0.0 and not rolls(laws):
        residual, printed = sliding_bound(laws, laws.other, closed, contacts)
        if residual <= enough:
            return residual, printed
    selected = printed = tangential = 0.0
    for a in closed:
        P_N = solution.impulse[a, 0]
        x = P_N - laws.r_N * solution.gamma[a, 0]
        rule = laws.compliance * (P_N - solution.selection_center[a])
        selected = max(selected, abs(P_N - max(0.0, x - laws.r_N * rule)))
        printed = max(printed, abs(P_N - max(0.0, x)))
        P_x, gamma_x, radius = solution.impulse[a, 1], solution.gamma[a, 1], P_N
        radius *= grip(laws.other, contacts, a)
        disc = sliding_disc(laws, laws.other, a, P_x - laws.r_T * gamma_x)
        P, gamma = (P_x, solution.impulse[a, 2]), (gamma_x, solution.gamma[a, 2])
        slide = disc_residual(P, gamma, disc, radius, laws.r_T, enough)
        tangential = max(tangential, slide)
        if rolls(laws):
            disc = rolling_disc(laws, laws.other, a)
            P = solution.impulse[a, 3], solution.impulse[a, 4]
            gamma = solution.gamma[a, 3], solution.gamma[a, 4]
            roll = disc_residual(P, gamma, disc, radius, laws.r_V, enough)
            tangential = max(tangential, roll)
    return max(selected / laws.r_N, tangential), max(printed / laws.r_N, tangential)


@inlined
def sliding_bound(
    laws: Laws, other: OtherFriction | None, closed: Array, contacts: Contacts
) -> tuple[float, float]:
    """
    Return upper bounds of both results of `natural_map`, or infinity.

    The bounds take one square root per contact. They hold where nothing but `laws.sliding` acts:
    on a flat floor without rolling friction. `other` is ``laws.other``, an argument of its own so
    that Numba leaves out branches on None.
    """
    solution = contacts.solution
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
        P_N, P_x, P_y = solution.impulse[a, 0], solution.impulse[a, 1], solution.impulse[a, 2]
        gamma_x, gamma_y = solution.gamma[a, 1], solution.gamma[a, 2]
        x = P_N - laws.r_N * solution.gamma[a, 0]
        rule = laws.compliance * (P_N - solution.selection_center[a])
        selected = max(selected, abs(P_N - max(0.0, x - laws.r_N * rule)))
        printed = max(printed, abs(P_N - max(0.0, x)))
        x, y = over_x * (P_x - r * gamma_x), over_y * (P_y - r * gamma_y)
        if x * x + y * y <= P_N * P_N:
            stick = max(stick, gamma_x * gamma_x + gamma_y * gamma_y)
        else:  # as in disc_residual; its second part is shorter than its first
            e_x = P_x * over_x - weight * mu_x * gamma_x
            e_y = P_y * over_y - weight * mu_y * gamma_y
            e_x, e_y, _ = prox_scaled(laws.sliding, e_x, e_y, max(0.0, P_N))
            d_x, d_y = P_x - e_x, P_y - e_y
            slip = max(slip, d_x * d_x + d_y * d_y)
    share = 2.0 - (lowest * min(over_x, over_y)) ** 2
    tangential = max(math.sqrt(stick), share * math.sqrt(slip) / r)
    return max(selected / laws.r_N, tangential), max(printed / laws.r_N, tangential)


@inlined
def disc_residual(
    P: tuple[float, float],
    gamma: tuple[float, float],
    disc: Disc,
    bound: float,
    r: float,
    enough: float,
) -> float:
    """
    Return ``|P - prox(P - r gamma)|/r`` of one kind of friction [m/s], or an upper bound of it.

    The ellipse has the half axes ``mu_x bound`` and ``mu_y bound``. Let e be the point of the
    ellipse S disc, S = diag(mu_x, mu_y), that the disc projection of ``S^-1 P - r/mu_min^2 S
    gamma`` gives. Then P - r gamma lies ``(1 - mu_min^2 S^-2)(P - e)`` beside the normal of the
    ellipse in e. Projections do not expand distances, so the residual is at most the length of
    this vector plus |P - e|. For a disc the sum is |P - e|, which is the residual itself.
    """
    (P_x, P_y), (gamma_x, gamma_y) = P, gamma
    x, y = P_x - r * gamma_x, P_y - r * gamma_y
    mu_x, mu_y, over_x, over_y = disc.mu_x, disc.mu_y, disc.over_x, disc.over_y
    lowest, highest = min(mu_x, mu_y), max(over_x, over_y)
    if lowest > 0.0 and bound > 0.0:
        if (x * over_x) ** 2 + (y * over_y) ** 2 <= bound * bound:
            return math.sqrt(gamma_x * gamma_x + gamma_y * gamma_y)
        weight = r * highest * highest
        e_x = P_x * over_x - weight * mu_x * gamma_x
        e_y = P_y * over_y - weight * mu_y * gamma_y
        e_x, e_y, _ = prox_scaled(disc, e_x, e_y, bound)
        d_x, d_y = P_x - e_x, P_y - e_y
        b_x, b_y = (1.0 - (lowest * over_x) ** 2) * d_x, (1.0 - (lowest * over_y) ** 2) * d_y
        misfit = (math.sqrt(d_x * d_x + d_y * d_y) + math.sqrt(b_x * b_x + b_y * b_y)) / r
        if misfit <= enough:
            return misfit
    e_x, e_y = prox_ellipse(x, y, mu_x * bound, mu_y * bound)
    return math.sqrt((P_x - e_x) ** 2 + (P_y - e_y) ** 2) / r


@inlined
def apply_selection_rule(
    laws: Laws,
    closed: Array,
    contacts: Contacts,
    mass: Array,
    impulse: Array,
    speeds: tuple[float, float],
) -> Laws:
    """
    Fill the selection centers, and return the laws with the compliance of this step.

    Deviation: the rule moves a contact into the floor at ``compliance P_N``. The compliance is
    reduced if this velocity would be too fast for the largest normal impulse to be expected, but
    not below `least_compliance`. That impulse is the last one of a contact, or twice the impulse
    that stops its link alone plus half the weight of the link.

    Deviation: the centers are 0, so that the rule selects the impulses of least norm. While all
    contacts that carry load are at rest, they are the last impulses instead, so that nothing sinks
    or creeps. They exclude impulses of impacts, which would make bodies bounce.

    Parameters
    ----------
    laws, closed, contacts
        Those of a `problem.Problem`. The contacts have velocities at the start of the step;
        selection_center is filled.
    mass : ndarray, shape (n,)
        Masses of the links [kg].
    impulse : ndarray, shape (contacts, 5)
        Impulses of the last step [N s].
    speeds : tuple of float
        Velocity at which the rule may press a contact into the floor, and downward velocity that
        the weight adds in the step [m/s].

    """
    solution, (press_speed, fall) = contacts.solution, speeds
    most = fastest = heaviest = 0.0
    for m in mass:
        heaviest += IMPACT_WEIGHTS * m * max(0.0, fall)
    for a in closed:
        stop = 0.5 * fall - 2.0 * solution.gamma[a, 0]
        most = max(most, impulse[a, 0], mass[contacts.geometry.link[a]] * stop)
        if impulse[a, 0] > 0.0:
            slip = max(abs(solution.gamma[a, 1]), abs(solution.gamma[a, 2]))
            fastest = max(fastest, abs(solution.gamma[a, 0]), slip)
    compliance = laws.compliance
    if most > 0.0:
        compliance = min(compliance, max(laws.least_compliance, press_speed / most))
    for a in closed:
        solution.selection_center[a] = (
            min(impulse[a, 0], heaviest) if fastest <= REST_SPEED else 0.0
        )
    return Laws(
        laws.sliding, laws.rolling, compliance, laws.least_compliance, laws.proximal_compliance,
        laws.r_N, laws.r_T, laws.r_V, laws.residual_tolerance, laws.change_tolerance, laws.other,
    )  # fmt: skip

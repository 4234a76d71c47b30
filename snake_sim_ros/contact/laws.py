# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The numbers of the set-valued contact laws, and of the methods that solve them.

Functions here take the part ``laws.other`` beside the laws themselves, as an argument `other`.
Numba leaves out a branch on None only where an argument is None, not a field of one, and a scene
with a flat floor must not pay for the branches of other scenes.
"""

from typing import NamedTuple

from snake_sim_ros.dynamics.compilation import inlined

FRICTIONLESS = 1e-100  # coefficients whose squares would underflow count as zero


class Disc(NamedTuple):
    """Friction coefficients of one kind of friction, scaled to a disc; see `linear_laws`."""

    column: int  # of the first component in an impulse
    mu_x: float
    mu_y: float
    over_x: float  # 1/mu_x and 1/mu_y; 0 where there is no friction
    over_y: float
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
    its `grip` in the table; see `grip`. Contacts with pegs follow, then those of two links.
    """

    first_peg: int  # number of the first contact with a peg
    first_pair: int  # number of the first contact of two links
    peg: Disc
    pair: Disc
    rolling: Disc  # zero: such contacts have no rolling friction
    backward: Disc
    has_sides: bool  # whether `backward` differs from `Laws.sliding`


class Laws(NamedTuple):
    """The numbers of the contact laws, of the selection rule and of the natural map."""

    sliding: Disc
    rolling: Disc
    compliance: float  # of the selection rule [1/kg]
    least_compliance: float  # the rule is not reduced below it [1/kg]
    proximal_compliance: float  # compliance of the proximal point method [1/kg]
    r_N: float  # prox parameters: normal, sliding, rolling [kg]
    r_T: float
    r_V: float
    other: OtherFriction | None = None  # None on a flat floor


@inlined
def sliding_disc(laws, other, a, P_x):
    """Return the sliding friction of contact a, for an impulse P_x along its link."""
    if other is None:
        return laws.sliding
    if a >= other.first_pair:
        return other.pair
    return other.peg if a >= other.first_peg else ground_disc(laws, other, P_x)


@inlined
def floor_disc(laws, other, P_x):
    """Return the sliding friction of a contact with the ground, as `sliding_disc` does."""
    return laws.sliding if other is None else ground_disc(laws, other, P_x)


@inlined
def ground_disc(laws, other, P_x):
    """Return the sliding friction of the ground in a scene with an `OtherFriction`."""
    return other.backward if P_x > 0.0 else laws.sliding


@inlined
def anchored_disc(laws, other, contacts, a):
    """Return the sliding friction of contact a for its anchor or, from 0, against its trial."""
    return sliding_disc(laws, other, a, anchored_side(contacts, a))


@inlined
def anchored_side(contacts, a):
    """Return a number with the sign of the anchor along the link or, from 0, against the trial."""
    P_x = contacts.anchor[a, 1]
    return P_x if P_x != 0.0 else -contacts.trial[a, 1]


@inlined
def changes_side(other, contacts, a):
    """Return whether the iterate of contact a has friction of another side than its anchor."""
    if other is None:
        return False
    crosses = contacts.iterate[a, 1] * contacts.anchor[a, 1] < 0.0
    return crosses and other.has_sides and a < other.first_peg


@inlined
def grip(other, contacts, a):
    """Return the factor of all friction of contact a: 1 but for patches of the ground."""
    return 1.0 if other is None else contacts.grip[a]


@inlined
def rolling_disc(laws, other, a):
    """Return the rolling friction of contact a."""
    if other is None:
        return laws.rolling
    return other.rolling if a >= other.first_peg else laws.rolling


@inlined
def link_of(other, contacts, n, a):
    """Return the index of the link of contact a, for n links."""
    if other is None:
        return a if a < n else a - n
    return contacts.link[a]

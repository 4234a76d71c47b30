"""The numbers of the set-valued contact laws: friction of every kind, and of their solvers."""

from typing import NamedTuple

from snake_sim_ros.dynamics.compilation import inlined

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
    least_compliance: float  # compliance that the rule is not reduced below [1/kg]
    proximal_compliance: float  # compliance of the proximal point method [1/kg]
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
def link_of(other, contacts, n, a):
    """Return the link of contact a; `other` is the friction of the laws."""
    if other is None:
        return a if a < n else a - n
    return contacts.link[a]

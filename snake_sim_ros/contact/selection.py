"""
The selection rule: which normal impulses a step takes where they are not unique.

`selection_compliance` and `selection_center` say it in NumPy, `apply_selection_rule` is the same
compiled.
"""

import numpy as np

from snake_sim_ros.contact.laws import Laws
from snake_sim_ros.contact.laws import link_of
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.scene.parameters import Array

PRESS_SPEED = 5e-7  # velocity at which the selection rule may press a contact into the floor [m/s]
IMPACT_WEIGHTS = (
    10.0  # an impulse of more than so many weights of the robot in a step is of an impact
)
REST_SPEED = 1e-6  # velocity up to which a contact that carries load is at rest [m/s]
DEPTH_LIMIT = 5e-7  # penetration beyond which the selection rule presses no deeper [m]
# Steps up to this one look at the depth of each contact, larger ones more and more at the mean of
# all: what they move the links by makes the depths of single contacts rough [s].
FINE_STEP = 2.5e-4
LEAST_COMPLIANCE = (
    1e-6  # compliance that it is not reduced below, relative to the Delassus operator
)


def selection_compliance(
    compliance: float, least: float, most: float, press_speed: float = PRESS_SPEED
) -> float:
    """
    Return the compliance of the selection rule in a step [1/kg].

    Deviation: it moves a contact into the floor at ``compliance P_N``, and is reduced where that
    would be more than `press_speed` [m/s] for the largest normal impulse to be expected, but not
    below `least`.
    """
    return min(compliance, max(least, press_speed / most)) if most > 0.0 else compliance


def selection_center(
    dt: float, P_N: Array, gamma: Array, gap: Array, compliance: float, most: float, weight: float,
    press_speed: float = PRESS_SPEED,
) -> Array:  # fmt: skip
    """
    Return the normal impulses about which the selection rule is compliant in a step.

    Deviation: those that the rule presses in with `press_speed`, times depth over DEPTH: at most
    so deep, contacts go no deeper. The depth is that of the contact for steps up to FINE, and in a
    share that grows with the step the mean of those that carry load; a contact that lands has
    none. But the last ones P_N while all contacts that carry load are at rest, so that nothing
    sinks or creeps; those of an impact would make bodies bounce.

    Parameters
    ----------
    dt : float
        Time step [s].
    P_N : ndarray, shape (m,)
        Last normal impulses [N s].
    gamma : ndarray, shape (m, 3)
        Normal and sliding velocities at the start of the step [m/s].
    gap : ndarray, shape (m,)
        In the middle of the step [m].
    compliance, most : float
        That of the step [1/kg], and the largest normal impulse that is to be expected [N s].
    weight : float
        Of the robot, times the step [N s].
    press_speed : float
        Velocity at which the rule may press a contact into the floor [m/s]; methods differ in it.

    """
    if np.abs(gamma[P_N > 0.0]).max(initial=0.0) <= REST_SPEED:
        return np.minimum(P_N, IMPACT_WEIGHTS * weight)
    highest = (
        max(press_speed / compliance, min(most, IMPACT_WEIGHTS * weight))
        if compliance > 0.0
        else 0.0
    )
    depth, own = np.maximum(-gap, 0.0) / DEPTH_LIMIT, min(1.0, FINE_STEP / dt)
    mean = np.minimum(depth, 1.0)[P_N > 0.0].mean() if (P_N > 0.0).any() else 0.0
    share = np.where(P_N > 0.0, np.clip(mean + own * (depth - mean), 0.0, 1.0), 0.0)
    return np.asarray(highest * share)


@inlined
def depth_share(contacts, a):
    """Return the depth of contact a over DEPTH, 0 if it is not inside."""
    return max(0.0, -contacts.gap[a]) / DEPTH_LIMIT


@inlined
def apply_selection_rule(laws, closed, contacts, mass, impulse, press_speed, dt, fall):
    """
    Fill CENTER, and return the laws with the compliance that this step selects with.

    GAMMA is of the start of a step of dt [s], impulse of the last one; weight adds `fall` [m/s].

    Deviation: the compliance of the selection rule moves a contact into the floor by compliance
    times P_N. It is reduced where that would be more than `press_speed`, for the largest normal
    impulse that is to be expected: the last one of a contact, or twice what stops its link alone
    and half its weight.

    Deviation: while all contacts that carry load are at rest, the rule selects the impulses next
    to the last ones instead of those of least norm, so that nothing sinks or creeps. Beside those
    of an impact it would make bodies bounce.
    """
    n = len(mass)
    most = fastest = heaviest = 0.0
    for m in mass:
        heaviest += IMPACT_WEIGHTS * m * fall
    for a in closed:
        stop = 0.5 * fall - 2.0 * contacts.gamma[a, 0]
        most = max(most, impulse[a, 0], mass[link_of(laws.other, contacts, n, a)] * stop)
        if impulse[a, 0] > 0.0:
            slip = max(abs(contacts.gamma[a, 1]), abs(contacts.gamma[a, 2]))
            fastest = max(fastest, abs(contacts.gamma[a, 0]), slip)
    compliance = laws.compliance
    if most > 0.0:
        compliance = min(compliance, max(laws.least_compliance, press_speed / most))
    highest = max(press_speed / compliance, min(most, heaviest)) if compliance > 0.0 else 0.0
    mean, loaded, own = 0.0, 0, min(1.0, FINE_STEP / dt)
    for a in closed:
        if impulse[a, 0] > 0.0:
            mean += min(1.0, depth_share(contacts, a))
            loaded += 1
    mean /= max(1, loaded)
    for a in closed:
        share = 0.0  # of a contact that lands
        if impulse[a, 0] > 0.0:
            share = min(1.0, max(0.0, mean + own * (depth_share(contacts, a) - mean)))
        rests = fastest <= REST_SPEED
        contacts.selection_center[a] = min(impulse[a, 0], heaviest) if rests else share * highest
    return Laws(
        laws.sliding, laws.rolling, compliance, laws.least_compliance, laws.proximal_compliance,
        laws.r_N, laws.r_T, laws.r_V, laws.other,
    )  # fmt: skip

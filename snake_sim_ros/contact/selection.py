# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The selection rule: which normal impulses a step takes where they are not unique.

`selection_compliance` and `selection_center` define the rule in NumPy; `apply_selection_rule` is
its compiled form.
"""

import numpy as np

from snake_sim_ros.contact.laws import Laws
from snake_sim_ros.contact.laws import link_of
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.scene.parameters import Array

PRESS_SPEED = 5e-7  # velocity at which the selection rule may press a contact into the floor [m/s]
IMPACT_WEIGHTS = 10.0  # an impulse of more weights of the robot in a step is that of an impact
REST_SPEED = 1e-6  # velocity up to which a contact that carries load is at rest [m/s]
DEPTH_LIMIT = 5e-7  # penetration beyond which the selection rule presses no deeper [m]
# Up to this step the rule uses the depth of each contact, in larger steps more and more the mean
# depth of all: the way that links move in a step makes the depths of single contacts rough [s].
FINE_STEP = 2.5e-4
LEAST_COMPLIANCE = 1e-6  # the rule is not reduced below it; relative to the Delassus operator


def selection_compliance(
    compliance: float, least: float, most: float, press_speed: float = PRESS_SPEED
) -> float:
    """
    Return the compliance of the selection rule in a step [1/kg].

    Deviation: the rule moves a contact into the floor at ``compliance P_N``. The compliance is
    reduced if this velocity would exceed `press_speed` for the largest normal impulse to be
    expected, but not below `least`.

    Parameters
    ----------
    compliance, least : float
        Compliance of the scene, and the one that it is not reduced below [1/kg].
    most : float
        Largest normal impulse to be expected [N s].
    press_speed : float
        Velocity at which the rule may press a contact into the floor [m/s].

    """
    return min(compliance, max(least, press_speed / most)) if most > 0.0 else compliance


def selection_center(
    dt: float, P_N: Array, gamma: Array, gap: Array, compliance: float, most: float, weight: float,
    press_speed: float = PRESS_SPEED,
) -> Array:  # fmt: skip
    """
    Return the normal impulses about which the selection rule is compliant in a step.

    Deviation: the center of a contact is the impulse that the rule presses in with `press_speed`,
    times its depth over DEPTH_LIMIT, so that contacts sink no deeper than this limit. The depth is
    that of the contact for steps up to FINE_STEP; with larger steps a growing share of it is the
    mean depth of the contacts that carry load. A contact that lands has the center 0. While all
    contacts that carry load are at rest, the centers are the last impulses P_N instead, so that
    nothing sinks or creeps. They exclude impulses of impacts, which would make bodies bounce.

    Parameters
    ----------
    dt : float
        Time step [s].
    P_N : ndarray, shape (m,)
        Last normal impulses [N s].
    gamma : ndarray, shape (m, 3)
        Normal and sliding velocities at the start of the step [m/s].
    gap : ndarray, shape (m,)
        Gaps in the middle of the step [m].
    compliance : float
        Compliance of the rule in the step [1/kg].
    most : float
        Largest normal impulse to be expected [N s].
    weight : float
        Weight of the robot times the step [N s]; one that points upward, below 0, counts as 0.
    press_speed : float
        Velocity at which the rule may press a contact into the floor [m/s]; methods differ in it.

    Returns
    -------
    ndarray, shape (m,)
        [N s]

    """
    heaviest = IMPACT_WEIGHTS * max(0.0, weight)
    if np.abs(gamma[P_N > 0.0]).max(initial=0.0) <= REST_SPEED:
        return np.minimum(P_N, heaviest)
    highest = max(press_speed / compliance, min(most, heaviest)) if compliance > 0.0 else 0.0
    depth, own = np.maximum(-gap, 0.0) / DEPTH_LIMIT, min(1.0, FINE_STEP / dt)
    mean = np.minimum(depth, 1.0)[P_N > 0.0].mean() if (P_N > 0.0).any() else 0.0
    share = np.where(P_N > 0.0, np.clip(mean + own * (depth - mean), 0.0, 1.0), 0.0)
    return np.asarray(highest * share)


@inlined
def depth_share(contacts, a):
    """Return the depth of contact a over DEPTH_LIMIT, 0 if it is not inside the floor."""
    return max(0.0, -contacts.gap[a]) / DEPTH_LIMIT


@inlined
def apply_selection_rule(laws, closed, contacts, mass, impulse, press_speed, dt, fall):
    """
    Fill the selection centers, and return the laws with the compliance of this step.

    Deviation: the compliance moves a contact into the floor, see `selection_compliance`. The
    largest normal impulse to be expected is the last one of a contact, or twice the impulse that
    stops its link alone plus half the weight of the link.

    Deviation: at rest the rule selects the impulses next to the last ones instead of those of
    least norm, see `selection_center`.

    Parameters
    ----------
    laws, closed, contacts
        Those of a `solver.Problem`. The contacts have gaps and velocities at the start of the
        step; selection_center is filled.
    mass : ndarray, shape (n,)
        Masses of the links [kg].
    impulse : ndarray, shape (contacts, 5)
        Impulses of the last step [N s].
    press_speed, fall : float
        Velocity at which the rule may press a contact into the floor, and downward velocity that
        the weight adds in the step [m/s].
    dt : float
        Time step [s].

    """
    n = len(mass)
    most = fastest = heaviest = 0.0
    for m in mass:
        heaviest += IMPACT_WEIGHTS * m * max(0.0, fall)
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
        share = 0.0  # for a contact that lands
        if impulse[a, 0] > 0.0:
            share = min(1.0, max(0.0, mean + own * (depth_share(contacts, a) - mean)))
        rests = fastest <= REST_SPEED
        contacts.selection_center[a] = min(impulse[a, 0], heaviest) if rests else share * highest
    return Laws(
        laws.sliding, laws.rolling, compliance, laws.least_compliance, laws.proximal_compliance,
        laws.r_N, laws.r_T, laws.r_V, laws.other,
    )  # fmt: skip

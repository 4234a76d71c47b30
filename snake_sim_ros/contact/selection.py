# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The selection rule: which normal impulses a step takes where they are not unique.

`selection_compliance` and `selection_center` define the rule in NumPy; `apply_selection_rule` is
its compiled form.
"""

import numpy as np

from snake_sim_ros.contact.laws import Laws, link_of
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.scene.parameters import Array

PRESS_SPEED = 5e-7  # velocity at which the selection rule may press a contact into the floor [m/s]
IMPACT_WEIGHTS = 10.0  # an impulse of more weights of the robot in a step is that of an impact
REST_SPEED = 1e-6  # velocity up to which a contact that carries load is at rest [m/s]
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


def selection_center(P_N: Array, gamma: Array, weight: float) -> Array:
    """
    Return the normal impulses about which the selection rule is compliant in a step.

    Deviation: the centers are 0, so that the rule selects the impulses of least norm. While all
    contacts that carry load are at rest, they are the last impulses P_N instead, so that nothing
    sinks or creeps. They exclude impulses of impacts, which would make bodies bounce.

    Parameters
    ----------
    P_N : ndarray, shape (m,)
        Last normal impulses [N s].
    gamma : ndarray, shape (m, 3)
        Normal and sliding velocities at the start of the step [m/s].
    weight : float
        Weight of the robot times the step [N s]; one that points upward, below 0, counts as 0.

    Returns
    -------
    ndarray, shape (m,)
        [N s]

    """
    if np.abs(gamma[P_N > 0.0]).max(initial=0.0) > REST_SPEED:
        return np.zeros(len(P_N))
    return np.minimum(P_N, IMPACT_WEIGHTS * max(0.0, weight))


@inlined
def apply_selection_rule(laws, closed, contacts, mass, impulse, press_speed, fall):
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
        Those of a `solver.Problem`. The contacts have velocities at the start of the step;
        selection_center is filled.
    mass : ndarray, shape (n,)
        Masses of the links [kg].
    impulse : ndarray, shape (contacts, 5)
        Impulses of the last step [N s].
    press_speed, fall : float
        Velocity at which the rule may press a contact into the floor, and downward velocity that
        the weight adds in the step [m/s].

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
    for a in closed:
        contacts.selection_center[a] = (
            min(impulse[a, 0], heaviest) if fastest <= REST_SPEED else 0.0
        )
    return Laws(
        laws.sliding, laws.rolling, compliance, laws.least_compliance, laws.proximal_compliance,
        laws.r_N, laws.r_T, laws.r_V, laws.other,
    )  # fmt: skip

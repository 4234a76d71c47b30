"""
The selection rule in NumPy: which normal impulses a step takes where they are not unique.

`contacts.selected` is the same compiled.
"""

import numpy as np

from snake_sim_ros.contact.projections import DEPTH
from snake_sim_ros.contact.projections import FINE
from snake_sim_ros.contact.projections import IMPACT
from snake_sim_ros.contact.projections import PRESS
from snake_sim_ros.contact.projections import REST
from snake_sim_ros.scene.parameters import Array


def selection_compliance(
    compliance: float, least: float, most: float, press: float = PRESS
) -> float:
    """
    Return the compliance of the selection rule in a step [1/kg].

    Deviation: it moves a contact into the floor at ``compliance P_N``, and is reduced where that
    would be more than `press` [m/s] for the largest normal impulse to be expected, but not below
    `least`.
    """
    return min(compliance, max(least, press / most)) if most > 0.0 else compliance


def selection_center(
    dt: float, P_N: Array, gamma: Array, gap: Array, compliance: float, most: float, weight: float,
    press: float = PRESS,
) -> Array:  # fmt: skip
    """
    Return the normal impulses about which the selection rule is compliant in a step.

    Deviation: those that the rule presses in with `press`, times depth over DEPTH: at most so
    deep, contacts go no deeper. The depth is that of the contact for steps up to FINE, and in a
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
    press : float
        Velocity at which the rule may press a contact into the floor [m/s]; methods differ in it.

    """
    if np.abs(gamma[P_N > 0.0]).max(initial=0.0) <= REST:
        return np.minimum(P_N, IMPACT * weight)
    highest = max(press / compliance, min(most, IMPACT * weight)) if compliance > 0.0 else 0.0
    depth, own = np.maximum(-gap, 0.0) / DEPTH, min(1.0, FINE / dt)
    mean = np.minimum(depth, 1.0)[P_N > 0.0].mean() if (P_N > 0.0).any() else 0.0
    share = np.where(P_N > 0.0, np.clip(mean + own * (depth - mean), 0.0, 1.0), 0.0)
    return np.asarray(highest * share)

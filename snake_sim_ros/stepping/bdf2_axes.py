# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The laws on the axes of joints in a part of a step of method `bdf2`; see `dynamics.joint_laws`.

Joint angles are coordinates of this method, so that a stop is exact: the rate of the end leads to
the stop at most, ``w <= (limit - angle_hat)/h_q``. A joint that meets its stop lands as a contact
does. The rate after the impact is that of a second solution, in which the impulses of controllers
and friction stay what they are, and the stop holds with the bound 0.
"""

import math

from snake_sim_ros.dynamics.balance import joint_rates
from snake_sim_ros.dynamics.compilation import inlined, merged
from snake_sim_ros.dynamics.joint_laws import (
    begin_axis,
    begin_axis_impact,
    controller_impulse,
    first_law,
    is_at_stop,
    joint_laws_change,
    stop_axis,
)


@merged
def begin_axes(laws, own, work, angle, h, h_q):
    """
    Begin a part with the laws of the joints; the chain has the controllers of its predicted end.

    `angle`, shape (n-1, 2), are the joint angles at the start [rad]. A joint beyond its stop there
    goes no further.
    """
    axes, chain = work.axes, work.chain
    for j in range(len(axes.rate)):
        for k in range(2):
            axes.torque[j, k], axes.damping[j, k] = chain.torque[j, k], chain.damping[j, 2 * k]
            axes.rate[j, k] = own.star.rate[j, k]
            begin_axis(laws, axes, h, j, k)
            if laws.stop < math.inf:
                hat = own.hat.angle[j, k]
                low = (min(-laws.stop, angle[j, k]) - hat) / h_q
                high = (max(laws.stop, angle[j, k]) - hat) / h_q
                stop_axis(laws, axes, j, k, low, high)
            chain.torque[j, k], chain.damping[j, 2 * k] = first_law(laws.inertia, axes, j, k)


@inlined
def axes_change(laws, work, outcome, attempt, left, report):
    """Return whether the laws of the joints ask for another solution, and prepare it."""
    if not laws.present:
        return False
    chain = work.chain
    joint_rates(work.R, chain.twist, work.axes.rate)
    return joint_laws_change(
        laws, work.axes, chain.torque, chain.damping[:, ::2], outcome, attempt, left, report
    )


@inlined
def joints_meet_stops(laws, rate, work):
    """
    Return whether joints with rates (n-1, 2) meet their stops, and fill work.applied.

    These are the impulses of the controllers in a part.
    """
    meets, axes, chain = False, work.axes, work.chain
    for j in range(len(rate)):
        for k in range(2):
            work.applied[j, k] = chain.torque[j, k] - chain.damping[j, 2 * k] * rate[j, k]
            if laws.present:
                work.applied[j, k] = controller_impulse(axes, j, k)
                meets = meets or is_at_stop(laws, axes, j, k)
    return meets


@inlined
def begin_impact(laws, work):
    """Fill the laws of the joints in an impact: the torques stay what they are."""
    axes, chain = work.axes, work.chain
    for j in range(len(work.applied)):
        for k in range(2):
            if laws.present:
                chain.torque[j, k], chain.damping[j, 2 * k] = begin_axis_impact(
                    laws, axes, j, k, chain.torque[j, k], chain.damping[j, 2 * k]
                )
            else:
                chain.torque[j, k], chain.damping[j, 2 * k] = work.applied[j, k], 0.0

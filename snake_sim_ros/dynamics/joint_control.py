# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
PD control of one axis of a cardan joint, and where in the time step it acts.

Assumption: the paper prints the gains of the controller, but not its formula. Here the derivative
term acts on the difference to the reference rate.
"""

from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.scene.parameters import PD_SCHEMES

START, MIDPOINT, AVERAGE, END = range(len(PD_SCHEMES))


@compiled
def pd_law(scheme, dt, start, mid, reference, stiffness, damping):
    """
    Return torque and damping of the law ``torque - damping * rate_end`` that acts in a step.

    The scheme determines at which angle, rate and time the controller looks:

    - START: all at the start of the step, explicit; stable only for ``dt < 2 K_d/K_p``.
    - MIDPOINT: angle and time at the middle, rate at the start, explicit.
    - AVERAGE: mean angle and mean rate of the step, linearly implicit, of second order:
      ``angle_mean = angle_mid + dt/4 (rate_end - rate_start)``.
    - END: all at the end, linearly implicit: ``angle_end = angle_mid + dt/2 rate_end``.

    Parameters
    ----------
    scheme : int
        START, MIDPOINT, AVERAGE or END.
    dt : float
        Time step [s].
    start, mid : tuple of float
        Joint angle [rad] and rate [rad/s] in the configurations at start and middle of the step,
        both rates with the velocities of the start.
    reference : tuple of float
        Reference angle [rad] and rate [rad/s] at the middle of the step.
    stiffness, damping : float
        Gains [N m/rad], [N m s/rad].

    Returns
    -------
    torque : float
        [N m]
    damping : float
        Coefficient of the joint rate at the end of the step [N m s/rad]; 0 in explicit schemes.

    """
    angle, rate = reference
    if scheme == START:
        angle -= dt / 2 * rate
        return stiffness * (angle - start[0]) + damping * (rate - start[1]), 0.0
    if scheme == MIDPOINT:
        return stiffness * (angle - mid[0]) + damping * (rate - mid[1]), 0.0
    if scheme == AVERAGE:
        angle += dt / 4 * mid[1]
        torque = stiffness * (angle - mid[0]) + damping * (rate - mid[1] / 2)
        return torque, damping / 2 + stiffness * dt / 4
    angle += dt / 2 * rate
    return stiffness * (angle - mid[0]) + damping * rate, damping + stiffness * dt / 2


@compiled
def implicit_pd_law(dt, angle, rate, reference, stiffness, damping):
    """
    Return torque and damping as `pd_law` does, with all at the end, linear about a predicted end.

    Parameters
    ----------
    dt : float
        Time over which the rate acts on the angle [s].
    angle, rate : float
        Predicted angle [rad] and rate [rad/s] at the end.
    reference : tuple of float
        Reference angle [rad] and rate [rad/s] at the end.
    stiffness, damping : float
        As in `pd_law`.

    """
    torque = stiffness * (reference[0] - angle + dt * rate) + damping * reference[1]
    return torque, damping + stiffness * dt

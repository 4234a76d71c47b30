# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The laws on the yaw axes of joints in a step in the plane; see `dynamics.joint_laws`.

The arrays of `joint_laws.AxisLaws` are those of all axes, of which the first column is used. Pitch
joints hold a flat robot; `is_overloaded` says whether they could.
"""

import math

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
def begin_yaw_axes(model, work, q, u):
    """Begin a step of the paper from q and u with the laws of the yaw joints."""
    laws, axes, dt = model.joint_laws, work.axes, model.dt
    for j in range(len(work.torque)):
        turn = u[j + 1, 2] - u[j, 2]
        begin_yaw_axis(model, work, j, dt, turn)
        angle_mid = q[3 + j] - q[2 + j] + dt / 2 * turn
        if angle_mid >= laws.stop:
            axes.high[j, 0] = 0.0
        elif angle_mid <= -laws.stop:
            axes.low[j, 0] = 0.0
        first_yaw_law(model, work, j)


@merged
def begin_predicted_yaw_axes(model, work, start, hat, u_star, h, h_q):
    """
    Begin a part of a step of `bdf2` with the laws of the yaw joints, as `bdf2_axes.begin_axes`.

    Headings (n,) at the start and without the rates of the end are `start` and `hat` [rad], and
    u_star, shape (n, 3), are the predicted velocities.
    """
    laws, stop = model.joint_laws, model.joint_laws.stop
    for j in range(len(work.torque)):
        begin_yaw_axis(model, work, j, h, u_star[j + 1, 2] - u_star[j, 2])
        if stop < math.inf:
            angle, bend = start[j + 1] - start[j], hat[j + 1] - hat[j]
            low, high = (min(-stop, angle) - bend) / h_q, (max(stop, angle) - bend) / h_q
            stop_axis(laws, work.axes, j, 0, low, high)
        first_yaw_law(model, work, j)


@inlined
def begin_yaw_axis(model, work, j, h, rate):
    """Begin a part of h [s] with the laws of yaw joint j, whose rate is expected [rad/s]."""
    axes = work.axes
    axes.torque[j, 0], axes.damping[j, 0] = work.torque[j], work.chain.damping[j]
    axes.rate[j, 0] = rate
    begin_axis(model.joint_laws, axes, h, j, 0)


@inlined
def first_yaw_law(model, work, j):
    """Fill torque and damping of yaw joint j to begin with."""
    laws = model.joint_laws
    work.torque[j], work.chain.damping[j] = first_law(laws.inertia, work.axes, j, 0)


@inlined
def yaw_axes_change(model, work, outcome, attempt, left, report):
    """Return whether the laws of the joints ask for another solution, and prepare it."""
    n, laws = len(work.twist), model.joint_laws
    if not laws.present:
        return False
    for j in range(n - 1):
        work.axes.rate[j, 0] = work.twist[j + 1, 0] - work.twist[j, 0]
    torque, damping = work.torque.reshape(n - 1, 1), work.chain.damping.reshape(n - 1, 1)
    return joint_laws_change(laws, work.axes, torque, damping, outcome, attempt, left, report)


@inlined
def joint_impulses_in_plane(model, work):
    """Fill work.applied, the impulses of the controllers; return whether a joint meets a stop."""
    for j in range(len(work.applied)):
        rate = work.twist[j + 1, 0] - work.twist[j, 0]
        work.applied[j, 0] = work.torque[j] - work.chain.damping[j] * rate
        work.applied[j, 1] = -model.hold[j] * work.upright.rate[j]
    meets = False
    if model.joint_laws.present:
        for j in range(len(work.applied)):
            work.applied[j, 0] = controller_impulse(work.axes, j, 0)
            meets = meets or is_at_stop(model.joint_laws, work.axes, j, 0)
    return meets


@inlined
def begin_planar_impact(model, work):
    """Fill the laws of the yaw joints in an impact, with the torques of the part before it."""
    for j in range(len(work.torque)):
        work.torque[j], work.chain.damping[j] = begin_axis_impact(
            model.joint_laws, work.axes, j, 0, work.torque[j], work.chain.damping[j]
        )


@inlined
def is_overloaded(model, work):
    """Return whether a pitch joint needs more than its limit and its friction to hold a robot."""
    laws = model.joint_laws
    if laws.present:
        h = model.dt * work.standing.part[0]
        for j in range(len(work.torque)):
            most = laws.torque_limit[j, 1] + laws.friction[j, 1]
            if most < math.inf and abs(model.hold[j] * work.upright.rate[j]) > h * most:
                return True
    return False

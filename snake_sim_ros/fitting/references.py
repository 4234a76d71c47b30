# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The references that joints followed, from the commands that were recorded.

`held` is the law of `sim`: a command acts from its stamp on and is extrapolated with its velocity
for a while; a trajectory begins at the present reference. `interpolated` takes the commands of the
bag of a run, which are samples of its gait, as points of a smooth curve.
"""

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from snake_sim_ros.fitting.recording import Command, Recording
from snake_sim_ros.gaits.joint_reference import JointReference, motion_through
from snake_sim_ros.recording.from_messages import joint_axes
from snake_sim_ros.scene.parameters import Array, Robot

LAWS = ('held', 'interpolated')
HORIZON = 0.05  # s for which `sim` extrapolates a command with its velocity, unless it is told


def references(
    recording: Recording, robot: Robot, times: Array, law: str, horizon: float = HORIZON
) -> tuple[Array, Array]:
    """
    Return the references of the joints.

    Parameters
    ----------
    recording : Recording
    robot : Robot
    times : ndarray, shape (k,)
        Increasing [s].
    law : str
        One of LAWS.
    horizon : float, optional
        Time for which a command is extrapolated with its velocity [s].

    Returns
    -------
    angle, rate : ndarray, shape (k, n-1, 2)
        (yaw, pitch) [rad], [rad/s]

    """
    commands = recording.commands
    if law == 'interpolated' and len(commands) > 1 and _are_points(commands, robot):
        return _curve(commands, robot, times)
    first = recording.joint_angle[0].copy()
    reference = JointReference(
        np.full(first.shape, -np.inf), np.nan_to_num(first), np.zeros(first.shape)
    )
    moments = np.array([command.time for command in commands])
    places = np.searchsorted(times, moments)
    ends = np.append(places[1:], len(times))
    parts = [reference.sample(times[: places[0]], horizon, robot.joint_limit)]
    for command, begin, end in zip(commands, places, ends, strict=True):
        reference = _after(command, reference, robot, horizon)
        if end > begin:
            parts.append(reference.sample(times[begin:end], horizon, robot.joint_limit))
            reference = reference.settled(float(times[end - 1]))
    angle, rate = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return angle, rate


def _after(command: Command, last: JointReference, robot: Robot, horizon: float) -> JointReference:
    """Return the reference after a command; one that is not usable changes nothing."""
    message, limit = command.message, robot.joint_limit
    count = robot.link_count - 1
    if command.topic == 'position_commands':
        angle = np.array(message.data, dtype=float)
        if len(angle) != 2 * count or not np.isfinite(angle).all():
            return last
        still = np.zeros(len(angle))
        axes = np.arange(len(angle))
        return last.commanded(axes, command.time, np.clip(angle, -limit, limit), still)
    if command.topic == 'joint_trajectory':
        return _moved(command, last, robot, horizon)
    angle = joint_axes(message.name, message.position, count).ravel()
    rate = joint_axes(message.name, message.velocity, count).ravel()
    axes = np.flatnonzero(np.isfinite(angle))
    if not len(axes) or command.time < last.stamp.flat[axes].max():
        return last
    told = np.clip(angle[axes], -limit, limit), np.nan_to_num(rate[axes])
    return last.commanded(axes, command.time, *told)


def _moved(command: Command, last: JointReference, robot: Robot, horizon: float) -> JointReference:
    """Return the reference with a trajectory that begins where the joints are told to be."""
    message, begin, count = command.message, command.time, robot.link_count - 1
    order = joint_axes(message.joint_names, range(len(message.joint_names)), count).ravel()
    axes = np.flatnonzero(np.isfinite(order))
    columns = order[axes].astype(int)
    spans = [point.time_from_start for point in message.points]
    times = begin + np.array([span.sec + 1e-9 * span.nanosec for span in spans])
    rows = [point for point, time in zip(message.points, times, strict=True) if time > begin]
    if not len(axes) or not rows:
        return last
    angle = np.array([point.positions for point in rows])[:, columns]
    with_rates = all(len(point.velocities) for point in rows)
    rate = np.array([point.velocities for point in rows])[:, columns] if with_rates else None
    if not np.isfinite(angle).all() or (np.diff(times) <= 0.0).any():
        return last
    start = last.sample(np.array([begin]), horizon, robot.joint_limit)
    here, speed = (part.reshape(1, -1)[:, axes] for part in start)
    limited = np.clip(angle, -robot.joint_limit, robot.joint_limit)
    return last.moved(motion_through(
        axes, np.insert(times[times > begin], 0, begin), np.concatenate([here, limited]),
        None if rate is None else np.concatenate([speed, rate]),
    ))  # fmt: skip


def _are_points(commands: Sequence[Command], robot: Robot) -> bool:
    """Return whether all commands are angles and velocities of all joints."""
    count = 2 * (robot.link_count - 1)
    return all(
        item.topic == 'joint_command'
        and len(item.message.position) == len(item.message.velocity) == count
        for item in commands
    )


def _curve(commands: Sequence[Command], robot: Robot, times: Array) -> tuple[Array, Array]:
    """Return angles and rates on the curve through commands with velocities."""
    moments, first = np.unique([item.time for item in commands], return_index=True)
    count = robot.link_count - 1
    angle, rate = (
        np.array([
            joint_axes(commands[k].message.name, getattr(commands[k].message, part), count)
            for k in first
        ])
        for part in ('position', 'velocity')
    )  # fmt: skip
    curve = CubicHermiteSpline(moments, angle, rate)
    within = np.clip(times, moments[0], moments[-1])
    return curve(within), curve.derivative()(within)

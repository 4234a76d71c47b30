# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Joint commands that were received: a function for each topic makes a reference of a message.

A message is taken as a whole or not at all. An angle beyond the joint limit is clamped to it, and
a sentence reports it. Any other message that is not usable is rejected with one sentence.
"""

from collections.abc import Sequence
from dataclasses import dataclass
import difflib
from functools import cache

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from snake_sim_ros.gaits.joint_reference import JointReference, Motion, NONE
from snake_sim_ros.nodes.joint_names import joint_names
from snake_sim_ros.nodes.stamps import seconds_from
from snake_sim_ros.scene.checked_records import cut, quoted
from snake_sim_ros.scene.parameters import Array, Robot

ROUNDING = 1e-9  # rad, rad/s; a motion may exceed limits at its points by so much
STREAM = 0.5  # s; commands for a joint that come more often are a stream


class RejectedCommand(ValueError):
    """
    A command is not usable.

    The text of the error says why; `kind` is the sort of mistake, by which warnings are throttled.
    """

    def __init__(self, kind: str, sentence: str) -> None:
        super().__init__(sentence)
        self.kind = kind


@dataclass(frozen=True)
class ReceivedCommand:
    """
    The effect of a message on the joints.

    Sentences that are not empty are about a joint that was beyond the joint limit, and about one
    that jumps to the first point of a trajectory.
    """

    reference: JointReference  # of all joints from now on
    clamped: str = ''
    jump: str = ''
    moves_pitch: bool = False  # whether a trajectory has pitch joints that are not at zero
    effort: tuple[Array, Array] | None = None  # axes along the robot, and torques [N m]


@dataclass(frozen=True, kw_only=True)
class ReceivedTrajectory(ReceivedCommand):
    """The effect of a trajectory."""

    motion: Motion


def joint_command(
    message: JointState, last: JointReference, robot: Robot, now: float
) -> ReceivedCommand:
    """
    Take a command for some joints; the other joints keep their reference.

    Parameters
    ----------
    message : JointState
        Joint names with positions [rad] and, optionally, velocities [rad/s] and, for a robot with
        effort_commands, efforts [N m], which may be without positions. Its stamp is the time at
        which the positions hold. A stamp of zero means now; so does a stamp in the future, such
        as any stamp of a wall clock.
    last : JointReference
        The reference before the message.
    robot : Robot
    now : float
        Simulated time [s].

    Raises
    ------
    RejectedCommand
        If the message is not usable.

    """
    topic, names = 'joint_command', list(message.name)
    axes = axes_of(topic, names, robot)
    count = len(names)
    effort = _efforts(message, names, axes) if robot.effort_commands else None
    if effort and not message.position and not message.velocity:
        return ReceivedCommand(last, effort=effort)
    if len(message.position) != count:
        raise RejectedCommand(
            'length',
            f'{topic} must have one position a name: got {len(message.position)} positions for '
            f'{count} names',
        )
    if len(message.velocity) not in (0, count):
        raise RejectedCommand(
            'length',
            f'{topic} must have no velocity or one a name: got {len(message.velocity)} velocities '
            f'for {count} names',
        )
    position = np.array(message.position)
    velocity = np.array(message.velocity) if message.velocity else np.zeros(count)
    check_finite(topic, 'position', names, position)
    check_rates(topic, names, velocity, robot.joint_rate_limit)

    stamp = _stamp(topic, message, last, axes, now)
    position, clamped = clamped_to(topic, names, position, robot.joint_limit)
    told = last.commanded(axes, stamp, position, velocity)
    return ReceivedCommand(told, clamped, effort=effort)


def _stamp(
    topic: str, message: JointState, last: JointReference, axes: Array, now: float
) -> float:
    """Return the time at which the positions of some axes hold [s]; raise if it is late."""
    stamp = seconds_from(message.header.stamp)
    if stamp <= 0.0 or stamp > now:
        stamp = now
    begun = (
        motion.begin
        for motion in last.motions
        if motion.begin <= now and np.isin(motion.axes, axes).any()
    )
    newest = max([float(last.stamp.flat[axes].max()), *begun])
    if stamp < newest:
        raise RejectedCommand(
            'late',
            f'{topic} is late: stamped {stamp:.4f} s, after one of {newest:.4f} s was taken',
        )
    return stamp


def _efforts(message: JointState, names: list[str], axes: Array) -> tuple[Array, Array] | None:
    """Return axes and torques of a command, None if it has none; raise if they are not usable."""
    if not message.effort:
        return None
    if len(message.effort) != len(names):
        raise RejectedCommand(
            'length',
            f'joint_command must have no effort or one a name: got {len(message.effort)} efforts '
            f'for {len(names)} names',
        )
    effort = np.array(message.effort)
    check_finite('joint_command', 'effort', names, effort)
    return axes, effort


def position_commands(
    message: Float64MultiArray, last: JointReference, robot: Robot, now: float
) -> ReceivedCommand:
    """
    Take the positions of all joints in their order [rad], as a forward_command_controller does.

    Raises
    ------
    RejectedCommand
        If the message is not usable.

    """
    topic, names = 'position_commands', joint_names(robot.link_count)
    position = np.array(message.data)
    if len(position) != len(names):
        raise RejectedCommand(
            'length',
            f'{topic} must have {len(names)} numbers, {names[0]} to {names[-1]}; '
            f'got {len(position)}',
        )
    check_finite(topic, 'position', names, position)
    position, clamped = clamped_to(topic, names, position, robot.joint_limit)
    axes = np.arange(len(names))
    return ReceivedCommand(last.commanded(axes, now, position, np.zeros(len(names))), clamped)


def extrapolated(reference: JointReference, robot: Robot, now: float, horizon: float) -> str:
    """Return a sentence about a joint that its velocity takes beyond the limit by now, or ''."""
    age = np.minimum(now - reference.stamp, horizon)
    angle = np.abs(reference.angle + age * reference.rate)
    if angle.max() <= robot.joint_limit + ROUNDING:
        return ''
    worst = joint_names(robot.link_count)[int(angle.argmax())]
    return (
        f'joint_command: {worst} is clamped to the joint limit, +-{robot.joint_limit:.4g} rad; '
        f'with its velocity it would reach {angle.max():.4g} rad'
    )


def jump_between(
    topic: str,
    last: JointReference,
    new: JointReference,
    robot: Robot,
    now: float,
    *,
    horizon: float,
    period: float,
) -> str:
    """
    Return a sentence about the joint that a command moves by far too much at once, or ''.

    In a stream of commands a joint has the time since the last one to get there, or else a period.

    Parameters
    ----------
    topic : str
    last, new : JointReference
        Before and after the command.
    robot : Robot
    now : float
        Simulated time [s].
    horizon : float
        Time for which a command is extrapolated [s].
    period : float
        Publish period [s].

    """
    moment = np.array([now])
    angles = [item.sample(moment, horizon, robot.joint_limit)[0][0] for item in (last, new)]
    way, since = np.abs(angles[1] - angles[0]), new.stamp - last.stamp
    span = np.where((since > STREAM) | (since < period), period, since)
    for motion in last.motions:
        if motion.begin <= now:
            span.flat[motion.axes[motion.axes != NONE]] = period
    limit = robot.joint_rate_limit
    too_far = way / span
    worst = int(too_far.argmax())
    needed = float(too_far.flat[worst])
    if needed <= limit * (1.0 + ROUNDING):
        return ''
    before, after = (float(angle.flat[worst]) for angle in angles)
    return (
        f'{topic}: {joint_names(robot.link_count)[worst]} jumps from {before:.4g} rad to '
        f'{after:.4g} rad; {needed:.4g} rad/s would be needed, at most {limit:.4g} rad/s; '
        f'it is led there at that rate'
    )


@cache
def _axes_by_name(link_count: int) -> dict[str, int]:
    return {name: axis for axis, name in enumerate(joint_names(link_count))}


def axes_of(topic: str, given: list[str], robot: Robot) -> Array:
    """Return the indices along the robot of named axes, shape (names,); raise if unknown."""
    known = _axes_by_name(robot.link_count)
    names = list(known)
    if not given:
        raise RejectedCommand(
            'no names', f'{topic} names no joints; name some of {names[0]} to {names[-1]}'
        )
    for name in given:
        if name not in known:
            close = difflib.get_close_matches(cut(name), names, n=1)
            hint = (
                f'did you mean {close[0]}?' if close else f'joints are {names[0]} to {names[-1]}'
            )
            raise RejectedCommand('name', f'{topic}: unknown joint {quoted(name)}; {hint}')
    if len(set(given)) < len(given):
        twice = next(name for name in given if given.count(name) > 1)
        raise RejectedCommand('twice', f'{topic} names joint {twice} more than once')
    return np.array([known[name] for name in given])


def check_finite(topic: str, what: str, names: Sequence[str], values: Array) -> None:
    """Raise if a number is not finite; values have shape (..., joints)."""
    if not np.isfinite(values).all():
        bad = int(np.argmin(np.isfinite(values)))
        raise RejectedCommand(
            'not finite',
            f'{topic}: {what} of {names[bad % len(names)]} must be finite, got {values.flat[bad]}',
        )


def check_rates(topic: str, names: Sequence[str], values: Array, limit: float) -> None:
    """Raise if a rate is not finite or beyond a limit [rad/s]; shape (..., joints)."""
    check_finite(topic, 'velocity', names, values)
    if np.abs(values).max() > limit:
        worst = int(np.abs(values).argmax())
        raise RejectedCommand(
            'velocity range',
            f'{topic}: velocity of {names[worst % len(names)]} must be within +-{limit:.4g} '
            f'rad/s, got {values.flat[worst]:.4g} rad/s',
        )


def clamped_to(topic: str, names: Sequence[str], angle: Array, limit: float) -> tuple[Array, str]:
    """Return angles within the limit, shape (..., joints), and a sentence about the largest."""
    if np.abs(angle).max() <= limit:
        return angle, ''
    worst = int(np.abs(angle).argmax())
    return np.clip(angle, -limit, limit), (
        f'{topic}: position of {names[worst % len(names)]} is clamped to the joint limit, '
        f'+-{limit:.4g} rad; got {angle.flat[worst]:.4g} rad'
    )

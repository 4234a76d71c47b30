"""
Commands from messages, as pure functions: what the joints are told after a message.

A message is taken whole or not at all. An angle beyond the joint limit is clamped to it, which is
said; everything else that is not usable is refused with one sentence.
"""

from collections.abc import Sequence
from dataclasses import dataclass
import difflib
from functools import cache
from reprlib import repr as shortened

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from snake_sim_ros.gaits.joint_reference import JointReference
from snake_sim_ros.gaits.joint_reference import Motion
from snake_sim_ros.gaits.joint_reference import motion_through
from snake_sim_ros.nodes.command_messages import joint_names
from snake_sim_ros.nodes.messages import seconds_from
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Robot

FARTHEST = 3600.0  # s, how far ahead of simulated time a trajectory may begin
ROUNDING = 1e-9  # rad, rad/s, by which a motion may be beyond limits at its points
WAITING = 20  # trajectories that may wait for their begin: each costs time with every message


class RejectedCommand(ValueError):
    """A command is not usable; the message says why, `kind` what sort of mistake it is."""

    def __init__(self, kind: str, sentence: str) -> None:
        super().__init__(sentence)
        self.kind = kind


@dataclass(frozen=True)
class Command:
    """
    What a message tells the joints.

    Attributes
    ----------
    reference : JointReference
        What all joints are told from now on.
    clamped : str
        What was beyond the joint limit, as a sentence; empty if nothing was.
    jump : str
        What jumps to the first point of a trajectory, as a sentence; empty if nothing does.

    """

    reference: JointReference
    clamped: str = ''
    jump: str = ''


def joint_command(message: JointState, last: JointReference, robot: Robot, now: float) -> Command:
    """
    Take a command for some joints; those that it does not name keep what they had.

    Parameters
    ----------
    message : JointState
        Joints by name, with positions [rad] and, if any, velocities [rad/s]. Its stamp is the time
        at which the positions hold; a zero stamp and one of the future, which all stamps of a wall
        clock are, mean now.
    last : JointReference
    robot : Robot
    now : float
        Simulated time [s].

    Raises
    ------
    RejectedCommand

    """
    topic, names = 'joint_command', list(message.name)
    axes = _axes(topic, names, robot)
    count = len(names)
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
    _check_finite(topic, 'position', names, position)
    _check_rates(topic, names, velocity, robot.joint_rate_limit)

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
    position, clamped = _clamped(topic, names, position, robot.joint_limit)
    return Command(last.commanded(axes, stamp, position, velocity), clamped)


def position_commands(
    message: Float64MultiArray, last: JointReference, robot: Robot, now: float
) -> Command:
    """
    Take positions of all joints in their order [rad], as a forward_command_controller does.

    Raises
    ------
    RejectedCommand

    """
    topic, names = 'position_commands', joint_names(robot.link_count)
    position = np.array(message.data)
    if len(position) != len(names):
        raise RejectedCommand(
            'length',
            f'{topic} must have {len(names)} numbers, {names[0]} to {names[-1]}; '
            f'got {len(position)}',
        )
    _check_finite(topic, 'position', names, position)
    position, clamped = _clamped(topic, names, position, robot.joint_limit)
    axes = np.arange(len(names))
    return Command(last.commanded(axes, now, position, np.zeros(len(names))), clamped)


def joint_trajectory(
    message: JointTrajectory, last: JointReference, robot: Robot, now: float, horizon: float
) -> Command:
    """
    Take a trajectory of some joints, as a joint_trajectory_controller does.

    It begins at the stamp of its header, a zero stamp means now. Until then the joints go on with
    what they were told; then they move from there through those points that are not in the past:
    on straight lines if points have positions only, cubic in time if they have velocities. Joints
    that would exceed the rate limit on their way to the first point jump to it, as they would with
    any other command. Accelerations and efforts are not used.

    Parameters
    ----------
    message : JointTrajectory
    last : JointReference
    robot : Robot
    now : float
        Simulated time [s].
    horizon : float
        How long a command before it is extrapolated [s].

    Raises
    ------
    RejectedCommand

    """
    topic, names = 'joint_trajectory', list(message.joint_names)
    axes = _axes(topic, names, robot)
    times, angle, rate = _points(topic, message, robot)
    begin = seconds_from(message.header.stamp) or now
    if begin > now + FARTHEST:
        raise RejectedCommand(
            'stamp',
            f'{topic} must begin within an hour of simulated time {now:.4f} s, got a stamp of '
            f'{begin:.4f} s; zero means now',
        )
    if sum(now < motion.begin < begin for motion in last.motions) >= WAITING:
        raise RejectedCommand(
            'waiting',
            f'{topic}: {WAITING} trajectories that begin earlier still wait; one may have as '
            f'many points as you like',
        )
    times = times + begin
    if times[-1] < now:
        raise RejectedCommand(
            'late', f'{topic} is late: its last point is at {times[-1]:.4f} s, it is {now:.4f} s'
        )
    angle, clamped = _clamped(topic, names, angle, robot.joint_limit)
    begin = max(begin, now)
    ahead = times >= begin
    times, angle = times[ahead], angle[ahead]
    rate = None if rate is None else rate[ahead]
    jump = ''
    if times[0] > begin:
        start = last.sample(np.array([begin]), horizon, robot.joint_limit)
        start_angle, start_rate = (part.reshape(1, -1)[:, axes] for part in start)
        times, angle = np.insert(times, 0, begin), np.vstack([start_angle, angle])
        rate = None if rate is None else np.vstack([start_rate, rate])
        way = motion_through(axes, times[:2], angle[:2], None if rate is None else rate[:2])
        (needed,) = way.extremes()[1]
        too_fast = needed > robot.joint_rate_limit + ROUNDING
        if too_fast.any():
            jump = _jump(topic, names, angle[:2], needed, robot.joint_rate_limit)
            angle[0, too_fast] = angle[1, too_fast]
            if rate is not None:
                rate[0, too_fast] = 0.0
    motion = motion_through(axes, times, angle, rate)
    swing = _check_motion(topic, names, motion, robot)
    return Command(last.moved(motion), clamped or swing, jump)


def extrapolated(reference: JointReference, robot: Robot, now: float, horizon: float) -> str:
    """Return what goes beyond the joint limit with its velocity by now, as a sentence, or ''."""
    age = np.minimum(now - reference.stamp, horizon)
    angle = np.abs(reference.angle + age * reference.rate)
    if angle.max() <= robot.joint_limit + ROUNDING:
        return ''
    worst = joint_names(robot.link_count)[int(angle.argmax())]
    return (
        f'joint_command: {worst} is clamped to the joint limit, +-{robot.joint_limit:.4g} rad; '
        f'with its velocity it would reach {angle.max():.4g} rad'
    )


@cache
def _axes_by_name(link_count: int) -> dict[str, int]:
    return {name: axis for axis, name in enumerate(joint_names(link_count))}


def _axes(topic: str, given: list[str], robot: Robot) -> Array:
    """Return which axes some names are, counted along the robot, shape (names,)."""
    known = _axes_by_name(robot.link_count)
    names = list(known)
    if not given:
        raise RejectedCommand(
            'no names', f'{topic} names no joints; name some of {names[0]} to {names[-1]}'
        )
    for name in given:
        if name not in known:
            close = difflib.get_close_matches(name, names, n=1)
            hint = (
                f'did you mean {close[0]}?' if close else f'joints are {names[0]} to {names[-1]}'
            )
            raise RejectedCommand('name', f'{topic}: unknown joint {shortened(name)}; {hint}')
    if len(set(given)) < len(given):
        twice = next(name for name in given if given.count(name) > 1)
        raise RejectedCommand('twice', f'{topic} names joint {twice} more than once')
    return np.array([known[name] for name in given])


def _jump(topic: str, names: Sequence[str], angle: Array, rate: Array, limit: float) -> str:
    """Return what is said of joints that jump to their first point: angle (2, k), rate (k,)."""
    worst = int(rate.argmax())
    start, first = angle[:, worst].tolist()
    return (
        f'{topic}: {names[worst]} jumps from {start:.4g} rad to its first point, {first:.4g} rad; '
        f'{rate[worst]:.4g} rad/s would be needed, at most {limit:.4g} rad/s'
    )


def _points(
    topic: str, message: JointTrajectory, robot: Robot
) -> tuple[Array, Array, Array | None]:
    """Return times from start (points,), angles and rates (points, joints) of a trajectory."""
    names, points = list(message.joint_names), message.points
    if not points:
        raise RejectedCommand('no points', f'{topic} has no points')
    with_rates = bool(points[0].velocities)
    for number, point in enumerate(points, start=1):
        for what, values, wanted in (
            ('positions', point.positions, len(names)),
            ('velocities', point.velocities, len(names) if with_rates else 0),
        ):
            if len(values) != wanted:
                raise RejectedCommand(
                    'length',
                    f'{topic}: point {number} must have {wanted} {what}, got {len(values)} '
                    f'(as many as joints; velocities in all points or in none)',
                )
    times = np.array([p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in points])
    angle = np.array([point.positions for point in points])
    rate = np.array([point.velocities for point in points]) if with_rates else None
    steps = np.diff(times, prepend=0.0)
    wrong = (steps < 0.0) | ((steps == 0.0) & (np.arange(len(steps)) > 0))
    if wrong.any():
        number = int(wrong.argmax())
        raise RejectedCommand(
            'order',
            f'{topic}: time_from_start must be at least 0 s and increase from point to point, '
            f'got {times[number]:g} s after {times[number] - steps[number]:g} s at point '
            f'{number + 1}',
        )
    _check_finite(topic, 'position', names, angle)
    if rate is not None:
        _check_rates(topic, names, rate, robot.joint_rate_limit)
        if rate[-1].any():
            worst = int(np.abs(rate[-1]).argmax())
            raise RejectedCommand(
                'end',
                f'{topic}: velocities of the last point must be 0 rad/s, got '
                f'{rate[-1, worst]:.4g} rad/s for {names[worst]}',
            )
    return times, angle, rate


def _check_finite(topic: str, what: str, names: Sequence[str], values: Array) -> None:
    """Raise if a number is not finite; values have shape (..., joints)."""
    if not np.isfinite(values).all():
        bad = int(np.argmin(np.isfinite(values)))
        raise RejectedCommand(
            'not finite',
            f'{topic}: {what} of {names[bad % len(names)]} must be finite, got {values.flat[bad]}',
        )


def _check_rates(topic: str, names: Sequence[str], values: Array, limit: float) -> None:
    _check_finite(topic, 'velocity', names, values)
    if np.abs(values).max() > limit:
        worst = int(np.abs(values).argmax())
        raise RejectedCommand(
            'velocity range',
            f'{topic}: velocity of {names[worst % len(names)]} must be within +-{limit:.4g} '
            f'rad/s, got {values.flat[worst]:.4g} rad/s',
        )


def _check_motion(topic: str, names: Sequence[str], motion: Motion, robot: Robot) -> str:
    """
    Raise if a joint would move faster than its limit, between points as well as at them.

    Returns
    -------
    str
        What goes beyond the joint limit between two points, as a sentence; empty if nothing does.

    """
    angle, rate = motion.extremes()
    if rate.max() > robot.joint_rate_limit + ROUNDING:
        piece, worst = np.unravel_index(int(rate.argmax()), rate.shape)
        raise RejectedCommand(
            'velocity range',
            f'{topic}: {names[int(worst)]} would move at {rate[piece, worst]:.4g} rad/s until '
            f't = {motion.times[piece + 1]:.4f} s; at most {robot.joint_rate_limit:.4g} rad/s',
        )
    if angle.max() <= robot.joint_limit + ROUNDING:
        return ''
    piece, worst = np.unravel_index(int(angle.argmax()), angle.shape)
    return (
        f'{topic}: {names[int(worst)]} is clamped to the joint limit, +-{robot.joint_limit:.4g} '
        f'rad; it would swing to {angle[piece, worst]:.4g} rad until '
        f't = {motion.times[piece + 1]:.4f} s'
    )


def _clamped(topic: str, names: Sequence[str], angle: Array, limit: float) -> tuple[Array, str]:
    """Return angles within the limit, shape (..., joints), and the sentence about the worst."""
    if np.abs(angle).max() <= limit:
        return angle, ''
    worst = int(np.abs(angle).argmax())
    return np.clip(angle, -limit, limit), (
        f'{topic}: position of {names[worst % len(names)]} is clamped to the joint limit, '
        f'+-{limit:.4g} rad; got {angle.flat[worst]:.4g} rad'
    )

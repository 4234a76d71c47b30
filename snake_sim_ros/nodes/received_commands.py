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
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from snake_sim_ros.gaits.joint_reference import JointReference, Motion, motion_through, NONE
from snake_sim_ros.nodes.messages import EPOCH, seconds_from
from snake_sim_ros.scene.chain import JointLimits
from snake_sim_ros.scene.checked_records import cut, quoted
from snake_sim_ros.scene.parameters import Array, range_text, Robot

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
    # axes along the robot, and which of them have a position, a velocity, an effort, shape (3, k)
    given: tuple[Array, Array]
    clamped: str = ''
    jump: str = ''
    moves_pitch: bool = False  # whether a trajectory has pitch joints that are not at zero
    effort: tuple[Array, Array] | None = None  # axes along the robot, and torques [N m]


@dataclass(frozen=True, kw_only=True)
class ReceivedTrajectory(ReceivedCommand):
    """The effect of a trajectory."""

    motion: Motion


KINDS = {'position': 'positions', 'velocity': 'velocities', 'effort': 'efforts'}


def joint_command(
    message: JointState,
    last: JointReference,
    robot: Robot,
    now: float,
    horizon: float,
    unclaimed: Array | None = None,
) -> ReceivedCommand:
    """
    Take a command for some joints; the other joints keep their reference.

    Velocities without positions move the joints on from where their references are. Efforts
    without both leave the references as they are.

    Parameters
    ----------
    message : JointState
        Joint names with positions [rad], velocities [rad/s] or both, and, for a robot with
        effort_commands, efforts [N m], which may be without them. Its stamp is the time at
        which the positions hold. A stamp of zero means now; so does a stamp in the future, such
        as any stamp of a wall clock.
    last : JointReference
        The reference before the message.
    robot : Robot
    now : float
        Simulated time [s].
    horizon : float
        Time for which the reference before is extrapolated [s].
    unclaimed : ndarray of bool, shape (3, axes), optional
        Axes along the robot that had no position, no velocity, no effort yet. There a NaN is what
        ros2_control sends for an interface that no controller has claimed: no command. Default:
        none, so that all numbers must be finite.

    Raises
    ------
    RejectedCommand
        If the message is not usable.

    """
    topic, names = 'joint_command', list(message.name)
    axes, signs, limits = axes_of(topic, names, robot)
    lists = _lists_of(topic, message, names, robot, axes, unclaimed)
    given = np.zeros((len(KINDS), len(names)), dtype=bool)
    for row, kind in enumerate(KINDS):
        if kind in lists:
            given[row] = ~np.isnan(lists[kind])
    all_given, effort, moved = (axes, given), None, given[0] | given[1]
    if 'effort' in lists and given[2].any():
        effort = axes[given[2]], signs[given[2]] * lists['effort'][given[2]]
    if not moved.all():
        names = [name for name, moves in zip(names, moved, strict=True) if moves]
        axes, signs = axes[moved], signs[moved]
        limits = JointLimits(*(each[moved] for each in limits))
    if not names:
        return ReceivedCommand(last, all_given, effort=effort)
    nothing = np.full(len(moved), np.nan)
    position, velocity = (lists.get(kind, nothing)[moved] for kind in ('position', 'velocity'))
    velocity[np.isnan(velocity)] = 0.0
    check_rates(topic, names, velocity, limits)
    stamp = _stamp(topic, message, last, axes, now)
    if (goes_on := np.isnan(position)).any():
        there = signs * last.sample(np.array([stamp]), horizon, robot.limits)[0].flat[axes]
        position = np.where(goes_on, there, position)
    position, clamped = clamped_to(topic, names, position, limits)
    reference = last.commanded(axes, stamp, signs * position, signs * velocity)
    return ReceivedCommand(reference, all_given, clamped, effort=effort)


def _lists_of(
    topic: str,
    message: JointState,
    names: list[str],
    robot: Robot,
    axes: Array,
    unclaimed: Array | None,
) -> dict[str, Array]:
    """Return kind -> numbers of named joints, (k,), NaN where a controller has not claimed one."""
    count = len(names)
    lists = {kind: values for kind in KINDS if len(values := getattr(message, kind))}
    if not robot.effort_commands and lists.pop('effort', None) is not None and not lists:
        raise RejectedCommand(
            'effort',
            f'{topic}: efforts alone need a robot that takes them: robot.effort_commands is false',
        )
    if not lists:
        raise RejectedCommand(
            'length',
            f'{topic} must have one position a name: got 0 positions for {count} names',
        )
    found = {}
    for kind, values in lists.items():
        if len(values) != count:
            number = 'one position' if kind == 'position' else f'no {kind} or one'
            raise RejectedCommand(
                'length',
                f'{topic} must have {number} a name: got {len(values)} {KINDS[kind]} '
                f'for {count} names',
            )
        found[kind] = numbers = np.array(values)
        if not np.isfinite(numbers).all():
            free = unclaimed is not None and unclaimed[list(KINDS).index(kind), axes]
            check_finite(topic, kind, names, np.where(free & np.isnan(numbers), 0.0, numbers))
    return found


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
    topic, names = 'position_commands', robot.axis_names
    position = np.array(message.data)
    if len(position) != len(names):
        raise RejectedCommand(
            'length',
            f'{topic} must have {len(names)} numbers, {names[0]} to {names[-1]}; '
            f'got {len(position)}',
        )
    check_finite(topic, 'position', names, position)
    axes, signs, limits = _known_axes(names, robot)
    position, clamped = clamped_to(topic, names, position, limits)
    reference = last.commanded(axes, now, signs * position, np.zeros(len(names)))
    return ReceivedCommand(reference, positions_of(axes), clamped)


def positions_of(axes: Array) -> tuple[Array, Array]:
    """Return what is given where some axes have positions alone, see `ReceivedCommand.given`."""
    return axes, np.outer((True, False, False), np.ones(len(axes), dtype=bool))


def extrapolated(reference: JointReference, robot: Robot, now: float, horizon: float) -> str:
    """Return a sentence about a joint that its velocity takes beyond the limit by now, or ''."""
    age = np.minimum(now - reference.stamp, horizon)
    angle = reference.angle + age * reference.rate
    excess = robot.limits.excess(angle, angle)
    if excess.max(initial=0.0) <= ROUNDING:
        return ''
    worst = np.array([int(excess.argmax())])
    (low,), (high,), _ = robot.limits_of_axes(worst)
    (reached,) = robot.place_signs[worst] * angle.flat[worst]
    return (
        f'joint_command: {robot.name_of_axis(int(worst[0]))} is clamped to the joint limit, '
        f'{range_text(low, high)}; with its velocity it would reach {reached:.4g} rad'
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
    angles = [item.sample(moment, horizon, robot.limits)[0][0] for item in (last, new)]
    way, since = np.abs(angles[1] - angles[0]), new.stamp - last.stamp
    span = np.where((since > STREAM) | (since < period), period, since)
    for motion in last.motions:
        if motion.begin <= now:
            span.flat[motion.axes[motion.axes != NONE]] = period
    needed_rate, limits = way / span, robot.limits.rate
    worst = int((needed_rate / limits).argmax())
    needed, limit = float(needed_rate.flat[worst]), float(limits.flat[worst])
    if needed <= limit * (1.0 + ROUNDING):
        return ''
    before, after = (float(angle.flat[worst]) for angle in angles)
    return (
        f'{topic}: {robot.name_of_axis(worst)} jumps from {before:.4g} rad to '
        f'{after:.4g} rad; {needed:.4g} rad/s would be needed, at most {limit:.4g} rad/s; '
        f'it is led there at that rate'
    )


@lru_cache(maxsize=16)
def _axes_by_name(robot: Robot) -> dict[str, int]:
    """Return name -> place along the robot of every axis, yaw before pitch."""
    return dict(zip(robot.axis_names, robot.axis_places.tolist(), strict=True))


class NamedAxes(NamedTuple):
    """The axes that a message names."""

    places: Array  # (k,) along the robot
    signs: Array  # (k,) -1 where the model turns the other way
    limits: JointLimits  # (k,) with the signs of the axes


@lru_cache(maxsize=16)  # Commands name the same axes again and again.
def _known_axes(names: tuple[str, ...], robot: Robot) -> NamedAxes:
    """Return axes of a robot by their names."""
    known = _axes_by_name(robot)
    places = np.array([known[name] for name in names])
    return NamedAxes(places, robot.place_signs[places], robot.limits_of_axes(places))


def axes_of(topic: str, given: list[str], robot: Robot) -> NamedAxes:
    """Return named axes; raise if one is unknown, or is named twice."""
    known = _axes_by_name(robot)
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
    return _known_axes(tuple(given), robot)


def check_finite(topic: str, what: str, names: Sequence[str], values: Array) -> None:
    """Raise if a number is not finite; values have shape (..., joints)."""
    if not np.isfinite(values).all():
        bad = int(np.argmin(np.isfinite(values)))
        raise RejectedCommand(
            'not finite',
            f'{topic}: {what} of {names[bad % len(names)]} must be finite, got {values.flat[bad]}',
        )


def check_rates(topic: str, names: Sequence[str], values: Array, limits: JointLimits) -> None:
    """Raise if a rate is not finite or beyond its limit [rad/s]; shape (..., joints)."""
    check_finite(topic, 'velocity', names, values)
    excess = np.abs(values) - limits.rate
    if excess.max() > 0.0:
        worst = int(excess.argmax())
        k = worst % len(names)
        raise RejectedCommand(
            'velocity range',
            f'{topic}: velocity of {names[k]} must be within +-{limits.rate[k]:.4g} '
            f'rad/s, got {values.flat[worst]:.4g} rad/s',
        )


def clamped_to(
    topic: str, names: Sequence[str], angle: Array, limits: JointLimits
) -> tuple[Array, str]:
    """Return angles within the limits, shape (..., joints), and a sentence about the furthest."""
    excess = limits.excess(angle, angle)
    worst = int(excess.argmax())
    if excess.flat[worst] <= 0.0:
        return angle, ''
    k = worst % len(names)
    return np.clip(angle, limits.low, limits.high), (
        f'{topic}: position of {names[k]} is clamped to the joint limit, '
        f'{range_text(limits.low[k], limits.high[k])}; got {angle.flat[worst]:.4g} rad'
    )


# ---- trajectories -------------------------------------------------------------------------------

# Joint trajectories that were received: a reference made of a message.
#
# As for the other commands in `received_commands`, a message is taken as a whole or not at all.


TOPIC = 'joint_trajectory'
FARTHEST_BEGIN = 3600.0  # s that a trajectory may begin ahead of simulated time
MOST_WAITING = 20  # trajectories that may wait for their begin; each costs time with every message


@dataclass(frozen=True)
class ReadTrajectory:
    """
    A trajectory whose points are usable, before it has a place in time.

    Attributes
    ----------
    names : list of str
        Names of joints.
    stamp : float
        When it begins [s]; 0 means now.
    axes : ndarray of int, shape (k,)
        Joint axes, counted along the robot, yaw before pitch.
    times : ndarray, shape (points,)
        Since the begin [s].
    angle, rate : ndarray, shape (points, k)
        [rad], [rad/s]; the rate is None if there are none.
    pieces : ndarray, shape (points, 4, k)
        Coefficients of the motion to each point, as in `Motion`. The one to a first point, which
        depends on where the joints are, is filled when they are known.
    extremes : tuple of ndarray, shape (points-1, k)
        Those of `Motion` on the way to each point but the first.
    clamped : str
        The sentence about an angle beyond the joint limit; empty if there is none.
    moves_pitch : bool
        Whether pitch joints are commanded anything but zero.

    """

    names: list[str]
    stamp: float
    axes: Array
    times: Array
    angle: Array
    rate: Array | None
    pieces: Array
    extremes: tuple[Array, Array, Array]
    clamped: str
    moves_pitch: bool


def read_trajectory(message: JointTrajectory, robot: Robot) -> ReadTrajectory:
    """Return a trajectory of some joints, or raise RejectedCommand; see `joint_trajectory`."""
    names = list(message.joint_names)
    axes, signs, limits = axes_of(TOPIC, names, robot)
    times, angle, rate = _points(message)
    _check_points(names, times, angle, rate, limits)
    angle, clamped = clamped_to(TOPIC, names, angle, limits)
    angle, rate = signs * angle, None if rate is None else signs * rate
    pieces = np.zeros((len(times), 4, len(axes)))
    extremes = (np.empty((0, len(axes))),) * 3
    if len(times) > 1:
        motion = motion_through(axes, times, angle, rate)
        pieces[1:], extremes = motion.coefficients, motion.extremes()
    moves = (angle,) if rate is None else (angle, rate)
    moves_pitch = any(values[:, axes % 2 == 1].any() for values in moves)
    return ReadTrajectory(
        *(names, seconds_from(message.header.stamp), axes, times, angle, rate),
        *(pieces, extremes, clamped, moves_pitch),
    )


def joint_trajectory(
    trajectory: JointTrajectory,
    last: JointReference,
    robot: Robot,
    now: float,
    horizon: float,
) -> ReceivedTrajectory:
    """
    Take a trajectory of some joints, as a joint_trajectory_controller does.

    It begins at the stamp of its header. A stamp of zero means now; so does any stamp of a wall
    clock. Until then the joints follow their present reference. From there they move through those
    points that are not in the past: on straight lines if the points have positions only, cubic in
    time if they have velocities. Joints that would exceed the rate limit on their way to the first
    point jump to it, as they do with any other command. Accelerations and efforts are not used.

    The other parameters and the error are those of `received_commands.joint_command`. A previous
    command is extrapolated for the time `horizon` [s].
    """
    message = read_trajectory(trajectory, robot)
    axes, pieces, jump, swing = message.axes, message.pieces, '', ''
    begin, times = _in_simulated_time(message, last, now)
    first = int(np.searchsorted(times, begin))
    if times[first] > begin:
        start = last.sample(np.array([begin]), horizon, robot.limits)
        start_angle, start_rate = (part.reshape(-1)[axes] for part in start)
        limit = robot.limits.rate.flat[axes]
        way, jump = _way_to(message, first, (begin, start_angle, start_rate), times[first], limit)
        swing = _check_pieces(message, times[first:], way.extremes(), robot)
        pieces[first] = way.coefficients[0]
        motion = Motion(axes, np.insert(times[first:], 0, begin), pieces[first:])
    elif first + 1 == len(times):
        motion = motion_through(axes, times[first:], message.angle[first:], None)
    else:
        motion = Motion(axes, times[first:], pieces[first + 1 :])
    rest = [each[first:] for each in message.extremes]
    swing = _check_pieces(message, times[first + 1 :], rest, robot) or swing
    return ReceivedTrajectory(
        *(last.moved(motion), positions_of(axes), message.clamped or swing, jump),
        *(message.moves_pitch,),
        motion=motion,
    )


def _points(message: JointTrajectory) -> tuple[Array, Array, Array | None]:
    """Return times [s], angles [rad], shape (points, joints), and rates [rad/s] if given."""
    points, joints = message.points, len(message.joint_names)
    if not points:
        raise RejectedCommand('no points', f'{TOPIC} has no points')
    has_rates = len(points[0].velocities) > 0
    for k, point in enumerate(points):
        for what, values, wanted in (
            ('positions', point.positions, joints),
            ('velocities', point.velocities, joints * has_rates),
        ):
            if len(values) != wanted:
                raise RejectedCommand(
                    'length',
                    f'{TOPIC}: point {k + 1} must have {wanted} {what}, got {len(values)} '
                    f'(as many as joints; velocities in all points or in none)',
                )
    durations = [point.time_from_start for point in points]
    times = np.array([each.sec + 1e-9 * each.nanosec for each in durations])
    angle, rate = (
        np.frombuffer(b''.join(lists)).reshape(len(points), -1)  # ten times faster than np.array
        for lists in ([p.positions for p in points], [p.velocities for p in points])
    )
    return times, angle, rate if has_rates else None


def _check_points(
    names: Sequence[str], times: Array, angle: Array, rate: Array | None, limits: JointLimits
) -> None:
    """Raise if the points of a trajectory are not usable."""
    steps = np.diff(times, prepend=0.0)
    wrong = (steps < 0.0) | ((steps == 0.0) & (np.arange(len(steps)) > 0))
    if wrong.any():
        number = int(wrong.argmax())
        raise RejectedCommand(
            'order',
            f'{TOPIC}: time_from_start must be at least 0 s and increase from point to point, '
            f'got {times[number]:g} s after {times[number] - steps[number]:g} s at point '
            f'{number + 1}',
        )
    check_finite(TOPIC, 'position', names, angle)
    if rate is not None:
        check_rates(TOPIC, names, rate, limits)
        if rate[-1].any():
            worst = int(np.abs(rate[-1]).argmax())
            raise RejectedCommand(
                'end',
                f'{TOPIC}: velocities of the last point must be 0 rad/s, got '
                f'{rate[-1, worst]:.4g} rad/s for {names[worst]}',
            )


def _in_simulated_time(
    message: ReadTrajectory, last: JointReference, now: float
) -> tuple[float, Array]:
    """Return when a trajectory begins to move the joints, and the times of its points [s]."""
    begin = message.stamp if 0.0 < message.stamp < EPOCH else now
    if begin > now + FARTHEST_BEGIN:
        raise RejectedCommand(
            'stamp',
            f'{TOPIC} must begin within an hour of simulated time {now:.4f} s, got a stamp of '
            f'{begin:.4f} s; zero means now',
        )
    if sum(now < motion.begin < begin for motion in last.motions) >= MOST_WAITING:
        raise RejectedCommand(
            'waiting',
            f'{TOPIC}: {MOST_WAITING} trajectories that begin earlier still wait',
        )
    times = message.times + begin
    if times[-1] < now:
        raise RejectedCommand(
            'late',
            f'{TOPIC} is late: its last point is at {times[-1]:.4f} s, it is {now:.4f} s',
        )
    return max(begin, now), times


def _way_to(
    message: ReadTrajectory,
    first: int,
    start: tuple[float, Array, Array],
    end: float,
    limit: Array,
) -> tuple[Motion, str]:
    """
    Return the motion from the present place of the joints to a point of a trajectory.

    Joints that would exceed the rate limit on their way jump to the point instead.

    Parameters
    ----------
    message : ReadTrajectory
    first : int
        Which point it is.
    start : tuple
        Time at which the trajectory begins [s], angle [rad] and rate [rad/s] there, shape (k,).
    end : float
        Time of the point [s].
    limit : ndarray, shape (k,)
        Largest rates [rad/s].

    Returns
    -------
    way : Motion
    jump : str
        The sentence about the joints that jump; empty if none does.

    """
    begin, start_angle, start_rate = start
    times = np.array([begin, end])
    angle = np.array([start_angle, message.angle[first]])
    rate = None if message.rate is None else np.array([start_rate, message.rate[first]])
    way = motion_through(message.axes, times, angle, rate)
    (needed,) = way.extremes()[2]
    too_fast = needed > limit + ROUNDING
    if not too_fast.any():
        return way, ''
    jump = _jump_sentence(message.names, angle, needed, limit)
    angle[0, too_fast] = angle[1, too_fast]
    if rate is not None:
        rate[0, too_fast] = 0.0
    return motion_through(message.axes, times, angle, rate), jump


def _jump_sentence(names: Sequence[str], angle: Array, rate: Array, limit: Array) -> str:
    """Return a sentence about the worst jump: angle (2, k) [rad], rate and limit (k,) [rad/s]."""
    worst = int((rate / limit).argmax())
    start, first = angle[:, worst].tolist()
    return (
        f'{TOPIC}: {names[worst]} jumps from {start:.4g} rad to its first point, {first:.4g} rad; '
        f'{rate[worst]:.4g} rad/s would be needed, at most {limit[worst]:.4g} rad/s; it is led '
        f'there at that rate'
    )


def _check_pieces(
    message: ReadTrajectory, ends: Array, extremes: Sequence[Array], robot: Robot
) -> str:
    """
    Raise if a joint would move faster than its limit, between points as well as at them.

    Parameters
    ----------
    message : ReadTrajectory
    ends : ndarray
        When each piece ends [s].
    extremes : sequence of ndarray, shape (pieces, k)
        Those of `Motion` in each piece.
    robot : Robot

    Returns
    -------
    str
        A sentence about a joint that exceeds its limit between two points; empty if none does.

    """
    names, axes = message.names, message.axes
    limits = JointLimits(*(each.flat[axes] for each in robot.limits))
    (low, high, rate), (least, largest, fastest) = limits, extremes
    piece, k = _worst(fastest - rate)
    if k is not None:
        raise RejectedCommand(
            'velocity range',
            f'{TOPIC}: {names[k]} would move at {fastest[piece, k]:.4g} rad/s until '
            f't = {ends[piece]:.4f} s; at most {rate[k]:.4g} rad/s',
        )
    piece, k = _worst(limits.excess(least, largest))
    if k is None:
        return ''
    (lower,), (upper,), _ = robot.limits_of_axes(axes[[k]])
    is_low = low[k] - least[piece, k] > largest[piece, k] - high[k]
    reached = robot.place_signs[axes[k]] * (least if is_low else largest)[piece, k]
    return (
        f'{TOPIC}: {names[k]} is clamped to the joint limit, {range_text(lower, upper)}; it would '
        f'swing to {reached:.4g} rad until t = {ends[piece]:.4f} s'
    )


def _worst(excess: Array) -> tuple[int, int | None]:
    """Return the piece and the joint of the largest excess (pieces, k); None without one."""
    if excess.max(initial=0.0) <= ROUNDING:
        return 0, None
    piece, k = np.unravel_index(int(excess.argmax()), excess.shape)
    return int(piece), int(k)

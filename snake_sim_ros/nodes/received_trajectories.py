# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Joint trajectories that were received: a reference made of a message.

As for the other commands in `received_commands`, a message is taken as a whole or not at all.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from trajectory_msgs.msg import JointTrajectory

from snake_sim_ros.gaits.joint_reference import JointReference, Motion, motion_through
from snake_sim_ros.nodes.received_commands import (
    axes_of,
    check_finite,
    check_rates,
    clamped_to,
    ReceivedTrajectory,
    RejectedCommand,
    ROUNDING,
)
from snake_sim_ros.nodes.stamps import EPOCH, seconds_from
from snake_sim_ros.scene.parameters import Array, Robot

TOPIC = 'joint_trajectory'
FARTHEST = 3600.0  # s that a trajectory may begin ahead of simulated time
WAITING = 20  # trajectories that may wait for their begin; each costs time with every message


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
    reach, speed : ndarray, shape (points-1, k)
        Largest magnitudes of angle [rad] and rate [rad/s] on the way to each point but the first.
    clamped : str
        The sentence about an angle beyond the joint limit; empty if there is none.
    moves_pitch : bool
        Whether pitch joints are told anything but zero.

    """

    names: list[str]
    stamp: float
    axes: Array
    times: Array
    angle: Array
    rate: Array | None
    pieces: Array
    reach: Array
    speed: Array
    clamped: str
    moves_pitch: bool


def read_trajectory(message: JointTrajectory, robot: Robot) -> ReadTrajectory:
    """Return a trajectory of some joints, or raise RejectedCommand; see `joint_trajectory`."""
    names = list(message.joint_names)
    axes = axes_of(TOPIC, names, robot)
    times, angle, rate = _points(message)
    _check_points(names, times, angle, rate, robot)
    angle, clamped = clamped_to(TOPIC, names, angle, robot.joint_limit)
    pieces = np.zeros((len(times), 4, len(axes)))
    reach = speed = np.empty((0, len(axes)))
    if len(times) > 1:
        motion = motion_through(axes, times, angle, rate)
        pieces[1:], (reach, speed) = motion.coefficients, motion.extremes()
    told = (angle,) if rate is None else (angle, rate)
    moves_pitch = any(values[:, axes % 2 == 1].any() for values in told)
    return ReadTrajectory(
        *(names, seconds_from(message.header.stamp), axes, times, angle, rate),
        *(pieces, reach, speed, clamped, moves_pitch),
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
        start = last.sample(np.array([begin]), horizon, robot.joint_limit)
        start_angle, start_rate = (part.reshape(-1)[axes] for part in start)
        way, jump = _way_to(
            message, first, (begin, start_angle, start_rate), times[first], robot.joint_rate_limit
        )
        swing = _check_pieces(message.names, times[first:], *way.extremes(), robot)
        pieces[first] = way.coefficients[0]
        motion = Motion(axes, np.insert(times[first:], 0, begin), pieces[first:])
    elif first + 1 == len(times):
        motion = motion_through(axes, times[first:], message.angle[first:], None)
    else:
        motion = Motion(axes, times[first:], pieces[first + 1 :])
    reach, speed = message.reach[first:], message.speed[first:]
    swing = _check_pieces(message.names, times[first + 1 :], reach, speed, robot) or swing
    told = last.moved(motion), message.clamped or swing, jump, message.moves_pitch
    return ReceivedTrajectory(*told, motion=motion)


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
    angle = np.array([point.positions for point in points])
    rate = np.array([point.velocities for point in points]) if has_rates else None
    return times, angle, rate


def _check_points(
    names: Sequence[str], times: Array, angle: Array, rate: Array | None, robot: Robot
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
        check_rates(TOPIC, names, rate, robot.joint_rate_limit)
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
    if begin > now + FARTHEST:
        raise RejectedCommand(
            'stamp',
            f'{TOPIC} must begin within an hour of simulated time {now:.4f} s, got a stamp of '
            f'{begin:.4f} s; zero means now',
        )
    if sum(now < motion.begin < begin for motion in last.motions) >= WAITING:
        raise RejectedCommand(
            'waiting',
            f'{TOPIC}: {WAITING} trajectories that begin earlier still wait',
        )
    times = message.times + begin
    if times[-1] < now:
        raise RejectedCommand(
            'late', f'{TOPIC} is late: its last point is at {times[-1]:.4f} s, it is {now:.4f} s'
        )
    return max(begin, now), times


def _way_to(
    message: ReadTrajectory,
    first: int,
    start: tuple[float, Array, Array],
    end: float,
    limit: float,
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
    limit : float
        Largest rate [rad/s].

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
    (needed,) = way.extremes()[1]
    too_fast = needed > limit + ROUNDING
    if not too_fast.any():
        return way, ''
    jump = _jump(message.names, angle, needed, limit)
    angle[0, too_fast] = angle[1, too_fast]
    if rate is not None:
        rate[0, too_fast] = 0.0
    return motion_through(message.axes, times, angle, rate), jump


def _jump(names: Sequence[str], angle: Array, rate: Array, limit: float) -> str:
    """Return a sentence about the worst jump: angle (2, k) [rad], rate (k,) [rad/s]."""
    worst = int(rate.argmax())
    start, first = angle[:, worst].tolist()
    return (
        f'{TOPIC}: {names[worst]} jumps from {start:.4g} rad to its first point, {first:.4g} rad; '
        f'{rate[worst]:.4g} rad/s would be needed, at most {limit:.4g} rad/s; it is led there at '
        f'that rate'
    )


def _check_pieces(
    names: Sequence[str], ends: Array, angle: Array, rate: Array, robot: Robot
) -> str:
    """
    Raise if a joint would move faster than its limit, between points as well as at them.

    Parameters
    ----------
    names : sequence of str
        Names of the joints.
    ends : ndarray
        When each piece ends [s].
    angle, rate : ndarray, shape (pieces, k)
        Largest magnitudes in each piece [rad], [rad/s].
    robot : Robot

    Returns
    -------
    str
        A sentence about a joint that exceeds its limit between two points; empty if none does.

    """
    if rate.max(initial=0.0) > robot.joint_rate_limit + ROUNDING:
        piece, worst = np.unravel_index(int(rate.argmax()), rate.shape)
        raise RejectedCommand(
            'velocity range',
            f'{TOPIC}: {names[int(worst)]} would move at {rate[piece, worst]:.4g} rad/s until '
            f't = {ends[piece]:.4f} s; at most {robot.joint_rate_limit:.4g} rad/s',
        )
    if angle.max(initial=0.0) <= robot.joint_limit + ROUNDING:
        return ''
    piece, worst = np.unravel_index(int(angle.argmax()), angle.shape)
    return (
        f'{TOPIC}: {names[int(worst)]} is clamped to the joint limit, +-{robot.joint_limit:.4g} '
        f'rad; it would swing to {angle[piece, worst]:.4g} rad until '
        f't = {ends[piece]:.4f} s'
    )

"""
Joint trajectories that were received: a reference made of a message.

As for the other commands in `received_commands`, a message is taken as a whole or not at all.
"""

from collections.abc import Sequence

import numpy as np
from trajectory_msgs.msg import JointTrajectory

from snake_sim_ros.gaits.joint_reference import JointReference
from snake_sim_ros.gaits.joint_reference import Motion
from snake_sim_ros.gaits.joint_reference import motion_through
from snake_sim_ros.nodes.received_commands import axes_of
from snake_sim_ros.nodes.received_commands import check_finite
from snake_sim_ros.nodes.received_commands import check_rates
from snake_sim_ros.nodes.received_commands import clamped_to
from snake_sim_ros.nodes.received_commands import ReceivedCommand
from snake_sim_ros.nodes.received_commands import RejectedCommand
from snake_sim_ros.nodes.received_commands import ROUNDING
from snake_sim_ros.nodes.stamps import seconds_from
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Robot

FARTHEST = 3600.0  # s that a trajectory may begin ahead of simulated time
WAITING = 20  # trajectories that may wait for their begin; each costs time with every message
# Times (points,) [s], angles (points, k) [rad], and rates [rad/s] or None.
Points = tuple[Array, Array, Array | None]


def joint_trajectory(
    message: JointTrajectory, last: JointReference, robot: Robot, now: float, horizon: float
) -> ReceivedCommand:
    """
    Take a trajectory of some joints, as a joint_trajectory_controller does.

    It begins at the stamp of its header; a stamp of zero means now. Until then the joints follow
    their present reference. From there they move through those points that are not in the past: on
    straight lines if the points have positions only, cubic in time if they have velocities. Joints
    that would exceed the rate limit on their way to the first point jump to it, as they do with
    any other command. Accelerations and efforts are not used.

    The other parameters and the error are those of `received_commands.joint_command`. A previous
    command is extrapolated for the time `horizon` [s].
    """
    topic, names = 'joint_trajectory', list(message.joint_names)
    axes = axes_of(topic, names, robot)
    times, angle, rate = _points(topic, message, robot)
    begin, times = _in_simulated_time(topic, message, times, last, now)
    angle, clamped = clamped_to(topic, names, angle, robot.joint_limit)
    ahead = times >= begin
    points, jump = (times[ahead], angle[ahead], None if rate is None else rate[ahead]), ''
    if points[0][0] > begin:
        start = last.sample(np.array([begin]), horizon, robot.joint_limit)
        start_angle, start_rate = (part.reshape(1, -1)[:, axes] for part in start)
        points, jump = _with_start(
            (topic, names, axes), (begin, start_angle, start_rate), points, robot.joint_rate_limit
        )
    motion = motion_through(axes, *points)
    swing = _check_motion(topic, names, motion, robot)
    return ReceivedCommand(last.moved(motion), clamped or swing, jump)


def _points(topic: str, message: JointTrajectory, robot: Robot) -> Points:
    """Return the points of a trajectory, with times from its start; raise if one is not usable."""
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
    check_finite(topic, 'position', names, angle)
    if rate is not None:
        check_rates(topic, names, rate, robot.joint_rate_limit)
        if rate[-1].any():
            worst = int(np.abs(rate[-1]).argmax())
            raise RejectedCommand(
                'end',
                f'{topic}: velocities of the last point must be 0 rad/s, got '
                f'{rate[-1, worst]:.4g} rad/s for {names[worst]}',
            )
    return times, angle, rate


def _in_simulated_time(
    topic: str, message: JointTrajectory, times: Array, last: JointReference, now: float
) -> tuple[float, Array]:
    """Return when a trajectory begins to move the joints, and the times of its points [s]."""
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
    return max(begin, now), times


def _with_start(
    joints: tuple[str, list[str], Array],
    start: tuple[float, Array, Array],
    points: Points,
    limit: float,
) -> tuple[Points, str]:
    """
    Prepend the present place of the joints to the points of a trajectory.

    Joints that would exceed the rate limit on their way to the first point jump there instead.

    Parameters
    ----------
    joints : tuple
        The topic, the names of the joints, and the indices of their axes.
    start : tuple
        Time at which the trajectory begins [s], angle [rad] and rate [rad/s] there, shape (1, k).
    points : Points
    limit : float
        Largest rate [rad/s].

    Returns
    -------
    points : Points
    jump : str
        The sentence about the joints that jump; empty if none does.

    """
    topic, names, axes = joints
    begin, start_angle, start_rate = start
    times, angle, rate = points
    times, angle = np.insert(times, 0, begin), np.vstack([start_angle, angle])
    rate = None if rate is None else np.vstack([start_rate, rate])
    way = motion_through(axes, times[:2], angle[:2], None if rate is None else rate[:2])
    (needed,) = way.extremes()[1]
    too_fast = needed > limit + ROUNDING
    jump = ''
    if too_fast.any():
        jump = _jump(topic, names, angle[:2], needed, limit)
        angle[0, too_fast] = angle[1, too_fast]
        if rate is not None:
            rate[0, too_fast] = 0.0
    return (times, angle, rate), jump


def _jump(topic: str, names: Sequence[str], angle: Array, rate: Array, limit: float) -> str:
    """Return a sentence about the worst jump: angle (2, k) [rad], rate (k,) [rad/s]."""
    worst = int(rate.argmax())
    start, first = angle[:, worst].tolist()
    return (
        f'{topic}: {names[worst]} jumps from {start:.4g} rad to its first point, {first:.4g} rad; '
        f'{rate[worst]:.4g} rad/s would be needed, at most {limit:.4g} rad/s'
    )


def _check_motion(topic: str, names: Sequence[str], motion: Motion, robot: Robot) -> str:
    """
    Raise if a joint would move faster than its limit, between points as well as at them.

    Returns
    -------
    str
        A sentence about a joint that exceeds its limit between two points; empty if none does.

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

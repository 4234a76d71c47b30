# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What nodes that move a robot hear: a clock, joint angles, poses, and velocity commands.

A gait that starts, or starts over, waits for joint angles that hold now, but not forever. Angles
that change faster than joints can move are those of a robot that was put back.
"""

from collections.abc import Sequence
from dataclasses import dataclass
import math
import time

from geometry_msgs.msg import PoseArray, Twist, TwistStamped
import numpy as np
from rclpy.clock import JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from snake_sim_ros.gaits.steering import Steering
from snake_sim_ros.nodes.executors import ThrottledWarnings
from snake_sim_ros.nodes.messages import EPOCH
from snake_sim_ros.recording.from_messages import poses
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array, Robot

# ---- jumps --------------------------------------------------------------------------------------

MANY_JUMPS = 4  # jumps in a row, each soon after the one before
SOON_AFTER = 0.2  # s between two jumps in a row; resets do not follow each other that fast
CALM = 1.0  # s without a jump after which all is well again
OF_TIME = 'time goes back and forth: is there more than one publisher of /clock?'
OF_ROBOT = 'joint_states jump back and forth: is there more than one publisher of joint_states?'


class Jumps:
    """
    Counts jumps, distinguishes single ones from repeated ones, and warns of the latter.

    All times are those of the monotonic clock, since the clock of the node may be what jumps.
    """

    def __init__(self, warn: ThrottledWarnings) -> None:
        self._warn = warn
        self._row: list[bool] = []
        self._last = -CALM

    def add(self, *, of_time: bool) -> None:
        """Count a jump of the time or of the robot."""
        now = time.monotonic()
        if now - self._last > (CALM if len(self._row) == MANY_JUMPS else SOON_AFTER):
            self._row = []
        self._last = now
        if len(self._row) == MANY_JUMPS:
            return
        self._row.append(of_time)
        if len(self._row) == MANY_JUMPS:
            # Simulators that share names have two times and two robots.
            sentence = OF_TIME if any(self._row) else OF_ROBOT
            self._warn('jumps', f'{sentence} The gait waits until this stops')

    @property
    def many(self) -> bool:
        """Whether there were many jumps in a row, the last of them less than `CALM` ago."""
        return len(self._row) == MANY_JUMPS and time.monotonic() - self._last < CALM


# ---- the clock ----------------------------------------------------------------------------------

APART = 5.0  # s between a stamp and the clock, more than messages are under way
PERSISTENT = 2.0  # s for which all stamps must be so far away


class ClockWatch:
    """
    Notices jumps of the clock of a node, and compares it with the stamps of a robot.

    Time that goes back once is a simulation that was reset. Time that goes back and forth comes
    from two publishers of /clock, and no command can be right until it ends.

    Parameters
    ----------
    node : Node
    jumps : Jumps
        Counts how often time goes back.
    warn : ThrottledWarnings

    """

    def __init__(self, node: Node, jumps: Jumps, warn: ThrottledWarnings) -> None:
        self._node, self._jumps, self._warn = node, jumps, warn
        self._latest = 0  # newest time that was seen [ns]
        self._jumped = False
        self._apart_since: float | None = None
        self._warned = False
        threshold = JumpThreshold(
            min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=True
        )
        # A timer may see none of the times between which a clock goes back and forth.
        self._handle = node.get_clock().create_jump_callback(
            threshold, post_callback=self._on_jump
        )

    def went_back(self, now: int) -> str:
        """
        Return a sentence if time went back, or is that of another clock, since the last call.

        Parameters
        ----------
        now : int
            Time of the clock [ns].

        Returns
        -------
        str
            Empty if time just advanced.

        """
        latest, self._latest = self._latest, now
        jumped, self._jumped = self._jumped, False
        if now < latest:
            if not jumped:  # The wall clock was set back.
                self._jumps.add(of_time=True)
            return f'time went back from {1e-9 * latest:.4f} s'
        return 'time jumped' if jumped else ''

    def compare(self, stamp: int) -> None:
        """Warn, once, if all stamps of a robot [ns] have been far from the clock for a while."""
        now = self._node.get_clock().now().nanoseconds
        ahead = 1e-9 * (stamp - now)
        if stamp == 0 or abs(ahead) < APART or not self._foreign(ahead):
            self._apart_since, self._warned = None, False
            return
        if self._apart_since is None:
            self._apart_since = time.monotonic()
        if self._warned or time.monotonic() - self._apart_since < PERSISTENT:
            return
        self._warned = True
        if self._simulated:
            advice = 'set use_sim_time to false, since this robot goes by the wall clock'
        else:
            advice = 'set use_sim_time to true for a simulated robot, else synchronize the clocks'
        self._warn(
            'clock',
            f'joint_states are stamped {1e-9 * stamp:.1f} s, but the clock of this node says '
            f'{1e-9 * now:.1f} s: {advice}',
        )

    @property
    def _simulated(self) -> bool:
        return bool(self._node.get_parameter('use_sim_time').value)

    def _foreign(self, ahead: float) -> bool:
        # Several simulated robots follow one /clock, and the others have a time of their own.
        return ahead > EPOCH or not self._simulated

    def _on_jump(self, jump: TimeJump) -> None:
        self._jumped = True
        if jump.delta.nanoseconds < 0:
            self._jumps.add(of_time=True)


# ---- joint angles -------------------------------------------------------------------------------

FRESH = 0.05  # s for which angles hold, by the clock of the node or by that of the machine
ANGLES_WAIT = 1.0  # s of waiting for angles while nobody publishes any that are usable
DISCOVERY = 4.0  # s after its start for which a node may not know of a publisher that exists
SILENT_WAIT = 5.0  # s of waiting while there is a publisher that has said nothing yet
ANGLES_UNKNOWN = 'the gait starts without knowing where the joints are'
SAME = 0.01  # rad between two angles that count as the same


@dataclass(frozen=True)
class Measured:
    """Angles [rad], rates [rad/s] and torques [N m] of joints, (axes,), and their time [ns]."""

    angle: Array
    rate: Array  # 0 if it is not known, as the torque
    torque: Array
    stamp: int
    arrived: float  # s on the monotonic clock


def measured(message: JointState, names: Sequence[str]) -> Measured:
    """
    Return what a robot reports of some joints; joints with other names are left out.

    Raises
    ------
    ValueError
        If the angles of these joints are not usable; the text says why.

    """
    given = list(message.name)
    missing = [name for name in names if name not in given]
    if missing:
        what = (
            f'{missing[0]} is'
            if len(missing) == 1
            else (f'{missing[0]} and {len(missing) - 1} more are')
        )
        got = f'{len(given)} names, {given[0]} to {given[-1]}' if given else 'no names'
        raise ValueError(f'must name all joints of the gait, {what} missing; got {got}')
    if len(message.position) != len(given):
        raise ValueError(
            f'must have one position a name, got {len(message.position)} positions for '
            f'{len(given)} names'
        )
    order = [given.index(name) for name in names]
    angle = np.array(message.position)[order]
    worst = int(np.argmax(np.where(np.isfinite(angle), np.abs(angle), math.inf)))
    if not abs(angle[worst]) <= math.pi:
        raise ValueError(
            f'must have angles within +-3.1416 rad, got {angle[worst]:.4g} for {names[worst]}'
        )
    rate, torque = (
        np.nan_to_num(np.array(values)[order])
        if len(values) == len(given)
        else np.zeros(len(names))
        for values in (message.velocity, message.effort)
    )
    stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
    return Measured(angle, rate, torque, stamp, time.monotonic())


def put_back(before: Measured, after: Measured, rate_limit: float | Array) -> bool:
    """
    Return whether the angles of two times are not those of one motion.

    A joint is not faster than its rate limit [rad/s], or than twice the rates that it reports. A
    simulation that is reset reports other angles at the same time, or at an earlier one.
    """
    if before.stamp == 0 or after.stamp == 0:
        return False
    span = 1e-9 * max(after.stamp - before.stamp, 0)
    fastest = 2.0 * np.maximum(np.abs(before.rate), np.abs(after.rate))
    reach = SAME + span * np.fmax(fastest, rate_limit)
    return bool((np.abs(after.angle - before.angle) > reach).any())


class MeasuredStart:
    """
    Reads joint_states for a gait, and says when it may start and from which angles.

    Parameters
    ----------
    node : Node
    robot : Robot
    clock : ClockWatch
        Takes the stamps of all joint_states.
    jumps : Jumps
        Counts how often the robot was put back.
    used : bool
        Whether the gait starts from measured angles; otherwise only the stamps count.

    """

    def __init__(
        self, node: Node, robot: Robot, clock: ClockWatch, jumps: Jumps, *, used: bool
    ) -> None:
        self._node, self._robot, self._used = node, robot, used
        self._clock, self._jumps = clock, jumps
        self._names, self._limits = list(robot.axis_names), robot.limits_of_axes(robot.axis_places)
        self._last: Measured | None = None
        self._put_back = self._refused = False
        self._missing_since: float | None = None  # s on the monotonic clock
        self._warned = False  # that angles are missing
        self._made = time.monotonic()
        # The newest message counts, and whoever publishes at whatever reliability is heard.
        quality = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        node.create_subscription(JointState, 'joint_states', self._on_joint_states, quality)

    @property
    def last(self) -> Measured | None:
        """What the joints said last."""
        return self._last

    def was_put_back(self) -> bool:
        """Return whether the robot was put back since the last call."""
        over, self._put_back = self._put_back, False
        return over

    def forget(self, now: int) -> None:
        """Forget angles of a time after now [ns], which time has gone back to."""
        if self._last and self._last.stamp > now:
            self._last = None

    def settled(self, now: int) -> bool:
        """Return whether angles are known that hold now [ns], or will not be waited for."""
        if not self._used:
            return True
        if self._angles(now) is not None:
            self._missing_since, self._warned = None, False
            return True
        if self._missing_since is None:
            self._missing_since = time.monotonic()
        silent = not self._refused and self._node.count_publishers('joint_states') > 0
        end = self._missing_since + (SILENT_WAIT if silent else ANGLES_WAIT)
        if time.monotonic() < max(end, self._made + DISCOVERY):
            return False
        if not (self._warned or self._refused):
            self._warned = True
            why = 'nothing comes on' if silent else 'nobody publishes'
            self._node.get_logger().warning(
                f'{why} joint_states: {ANGLES_UNKNOWN}; start_from:=now does not wait for them'
            )
        return True

    def posture(self, now: int, start: Array) -> Array | None:
        """
        Return the angles from which to blend into a gait, shape (n-1, 2) [rad].

        None if they are not known, or the same as those at the start of the gait.
        """
        angle = self._angles(now) if self._used else None
        if angle is None or np.abs(angle - self._robot.by_axis(start)).max() <= SAME:
            return None
        return self._robot.by_joint(np.clip(angle, self._limits.low, self._limits.high), 0.0)

    def _angles(self, now: int) -> Array | None:
        last = self._last
        if last is None:
            return None
        age = min(abs(1e-9 * (now - last.stamp)), time.monotonic() - last.arrived)
        return last.angle if age <= FRESH else None

    def _on_joint_states(self, message: JointState) -> None:
        stamp = message.header.stamp
        self._clock.compare(stamp.sec * 1_000_000_000 + stamp.nanosec)
        if not self._used:
            return
        try:
            new = measured(message, self._names)
        except ValueError as error:
            if not self._refused:
                self._refused = True
                self._node.get_logger().warning(
                    f'joint_states {error}; without usable ones {ANGLES_UNKNOWN}'
                )
            return
        last, self._last = self._last, new
        if last and put_back(last, new, self._limits.rate):
            self._put_back = True
            self._jumps.add(of_time=False)


# ---- poses --------------------------------------------------------------------------------------


def link_poses(message: PoseArray, robot: Robot) -> tuple[Array, Array]:
    """
    Return centers (n, 3) [m] and Euler parameters (n, 4) of all links, as `poses` does.

    Raises
    ------
    ParameterError
        If there is not one for each link, or a number is not finite.

    """
    place, orientation = poses(message, robot)
    if len(place) != robot.link_count:
        raise ParameterError(f'must be the {robot.link_count} links, got {len(place)} poses')
    known = np.isfinite(np.hstack([place, orientation])).all(axis=1)
    if not known.all():
        link = int(np.argmin(known))
        got = (place if not np.isfinite(place[link]).all() else orientation)[link].tolist()
        raise ParameterError(f'must be finite, got {got} of link {link + 1}')
    return place, orientation


# ---- velocity commands --------------------------------------------------------------------------


def steering_from(message: Twist, warn: ThrottledWarnings) -> Steering | None:
    """Return what a Twist asks for, or None and a warning if it is not finite."""
    for part in ('linear', 'angular'):
        for axis in ('x', 'y', 'z'):
            value = getattr(getattr(message, part), axis)
            if not math.isfinite(value):
                warn(
                    'not finite',
                    f'cmd_vel: {part}.{axis} must be finite, got {value}; '
                    f'the last good cmd_vel holds',
                )
                return None
    if any((message.linear.y, message.linear.z, message.angular.x, message.angular.y)):
        warn('unused', 'cmd_vel: only linear.x and angular.z steer; the rest is not used')
    return Steering(message.linear.x, message.angular.z)


def time_of(
    message: TwistStamped, now: int, timeout: float, warn: ThrottledWarnings
) -> int | None:
    """
    Return the time from which a TwistStamped counts [ns], or None and a warning if it is late.

    A stamp of zero means now, and so does a stamp in the future, such as any of a wall clock.

    Parameters
    ----------
    message : TwistStamped
    now : int
        Time of the clock [ns].
    timeout : float
        Time for which a cmd_vel holds [s]; 0 is forever, and then no message is late.
    warn : ThrottledWarnings

    """
    stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
    if stamp == 0 or stamp > now:
        return now
    if 0.0 < timeout < 1e-9 * (now - stamp):
        warn(
            'late',
            f'cmd_vel is late: stamped {1e-9 * stamp:.4f} s, {1e-9 * (now - stamp):.4g} s ago by '
            f'the clock of this node, more than cmd_vel_timeout, {timeout:g} s; it is not used',
        )
        return None
    return stamp

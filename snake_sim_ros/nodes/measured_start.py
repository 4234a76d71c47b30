# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Where a gait starts: at the joint angles that the robot reports on joint_states.

A gait that starts, or starts over, waits for angles that hold now. If none come, it does not wait
for ever. Angles that change faster than joints can are those of a robot that was put back.
"""

from collections.abc import Sequence
from dataclasses import dataclass
import math
import time

import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from snake_sim_ros.nodes.clock_watch import ClockWatch
from snake_sim_ros.nodes.joint_names import joint_names
from snake_sim_ros.nodes.jumps import Jumps
from snake_sim_ros.scene.parameters import Array, Robot

FRESH = 0.05  # s for which angles hold, by the clock of the node or by that of the machine
WAIT = 1.0  # s of waiting for angles while nobody publishes any that are usable
DISCOVERY = 4.0  # s after its start for which a node may not know of a publisher that exists
SILENT_WAIT = 5.0  # s of waiting while there is a publisher that has said nothing yet
UNKNOWN = 'the gait starts without knowing where the joints are'
SAME = 0.01  # rad between two angles that count as the same


@dataclass(frozen=True)
class Measured:
    """Joint angles [rad] and, if known, rates [rad/s], shape (2 (n-1),), and their time [ns]."""

    angle: Array
    rate: Array
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
    known = len(message.velocity) == len(given)
    rate = np.array(message.velocity)[order] if known else np.zeros(len(names))
    stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
    return Measured(angle, rate, stamp, time.monotonic())


def put_back(before: Measured, after: Measured, rate_limit: float) -> bool:
    """
    Return whether the angles of two times are not those of one motion.

    A joint is not faster than the rate limit [rad/s], or than twice the rates that it reports. A
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
        self._names = joint_names(robot.link_count)
        self._last: Measured | None = None
        self._put_back = self._refused = False
        self._missing_since: float | None = None  # s on the monotonic clock
        self._told = False  # that angles are missing
        self._made = time.monotonic()
        # The newest message counts, and whoever publishes at whatever reliability is heard.
        quality = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        node.create_subscription(JointState, 'joint_states', self._on_joint_states, quality)

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
            self._missing_since, self._told = None, False
            return True
        if self._missing_since is None:
            self._missing_since = time.monotonic()
        silent = not self._refused and self._node.count_publishers('joint_states') > 0
        end = self._missing_since + (SILENT_WAIT if silent else WAIT)
        if time.monotonic() < max(end, self._made + DISCOVERY):
            return False
        if not (self._told or self._refused):
            self._told = True
            why = 'nothing comes on' if silent else 'nobody publishes'
            self._node.get_logger().warning(
                f'{why} joint_states: {UNKNOWN}; start_from:=now does not wait for them'
            )
        return True

    def posture(self, now: int, start: Array) -> Array | None:
        """
        Return the angles from which to blend into a gait, shape (n-1, 2) [rad].

        None if they are not known, or the same as those at the start of the gait.
        """
        angle = self._angles(now) if self._used else None
        if angle is None or np.abs(angle - start.ravel()).max() <= SAME:
            return None
        limit = self._robot.joint_limit
        return np.clip(angle, -limit, limit).reshape(start.shape)

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
                    f'joint_states {error}; without usable ones {UNKNOWN}'
                )
            return
        last, self._last = self._last, new
        if last and put_back(last, new, self._robot.joint_rate_limit):
            self._put_back = True
            self._jumps.add(of_time=False)

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a node notices of its clock: time that goes back, and a clock that is not the robot's."""

import time

from rclpy.clock import JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node

from snake_sim_ros.nodes.jumps import Jumps
from snake_sim_ros.nodes.throttled_warnings import ThrottledWarnings

APART = 5.0  # s between a stamp and the clock, more than messages are under way
PERSISTENT = 2.0  # s for which all stamps must be so far away
WALL = 1e8  # s by which a wall clock is ahead of any simulated time


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
        self._told = False
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
            Empty if time just went on.

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
            self._apart_since, self._told = None, False
            return
        if self._apart_since is None:
            self._apart_since = time.monotonic()
        if self._told or time.monotonic() - self._apart_since < PERSISTENT:
            return
        self._told = True
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
        return ahead > WALL or not self._simulated

    def _on_jump(self, jump: TimeJump) -> None:
        self._jumped = True
        if jump.delta.nanoseconds < 0:
            self._jumps.add(of_time=True)

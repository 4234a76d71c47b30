# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Jumps of the time or of a robot: one is a reset, many in a row are two sources of one topic."""

import time

from snake_sim_ros.nodes.throttled_warnings import ThrottledWarnings

MANY = 4  # jumps in a row, each soon after the one before
SOON = 0.2  # s between two jumps in a row; resets do not follow each other that fast
CALM = 1.0  # s without a jump after which all is well again
OF_TIME = 'time goes back and forth: is there more than one publisher of /clock?'
OF_ROBOT = 'joint_states jump back and forth: is there more than one publisher of joint_states?'


class Jumps:
    """
    Counts jumps, tells single ones from those back and forth, and warns of these.

    All times are those of the monotonic clock, since the clock of the node may be what jumps.
    """

    def __init__(self, warn: ThrottledWarnings) -> None:
        self._warn = warn
        self._row: list[bool] = []
        self._last = -CALM

    def add(self, *, of_time: bool) -> None:
        """Count a jump of the time or of the robot."""
        now = time.monotonic()
        if now - self._last > (CALM if len(self._row) == MANY else SOON):
            self._row = []
        self._last = now
        if len(self._row) == MANY:
            return
        self._row.append(of_time)
        if len(self._row) == MANY:
            # Simulators that share names have two times and two robots.
            sentence = OF_TIME if any(self._row) else OF_ROBOT
            self._warn('jumps', f'{sentence} the gait waits until there is not')

    @property
    def many(self) -> bool:
        """Whether there were many jumps in a row, the last of them less than `CALM` ago."""
        return len(self._row) == MANY and time.monotonic() - self._last < CALM

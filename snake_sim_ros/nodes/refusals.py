# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Messages that a node refuses: a sentence in its log, and for a while in its diagnostics."""

import math
import time

from snake_sim_ros.nodes.throttled_warnings import ThrottledWarnings

REMEMBERED = 10.0  # s of wall time for which a refusal is in the diagnostics


class Refusals:
    """
    The refused messages of some topics.

    Attributes
    ----------
    count : int

    """

    def __init__(self, warn: ThrottledWarnings) -> None:
        self._warn = warn
        self._last, self._time = '', -math.inf
        self.count = 0

    def add(self, topic: str, reason: object) -> None:
        """Note and log that a message on a topic was refused."""
        self._last, self._time = f'{topic}: {reason}', time.monotonic()
        self.count += 1
        self._warn(topic, self._last)

    def remarks(self) -> list[str]:
        """Return a sentence on the last one if it is not old."""
        return [self._last] if time.monotonic() - self._time < REMEMBERED else []

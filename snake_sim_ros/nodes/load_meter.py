# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""How fast the node `sim` runs and what this costs, second by second."""

import math
import time

from snake_sim_ros.nodes.throttled_warnings import WARN_PERIOD

INTERVAL = 1.0  # s of wall time
SHORTEST = 0.1  # s of wall time that must have run for a real-time factor


class LoadMeter:
    """
    Measures the real-time factor and the processor time of this process, interval by interval.

    Attributes
    ----------
    real_time_factor : float
        Simulated time per wall time of the last interval, without the time of standing still.
    processor : float
        Processor time per wall time of the last interval, of all threads.
    overruns : int
        How often the node gave up catching up with wall time, ever.
    advanced, halted : float
        Simulated time, and wall time of standing still, in this interval [s].

    """

    def __init__(self) -> None:
        self.real_time_factor = self.processor = 0.0
        self.overruns, self._slipped = 0, -math.inf
        self.restart(time.perf_counter())

    def restart(self, now: float) -> None:
        """Begin an interval at a time of `time.perf_counter`."""
        self._begin, self._used = now, time.process_time()
        self.advanced = self.halted = 0.0

    def slip(self, now: float) -> None:
        """Note that the node gave up catching up at a time of `time.perf_counter`."""
        self.overruns += 1
        self._slipped = now

    def slips(self, now: float) -> bool:
        """Return whether it did so lately."""
        return now - self._slipped < WARN_PERIOD

    def complete(self, now: float) -> bool:
        """Return whether the interval is over; if so, note its numbers and begin the next one."""
        elapsed = now - self._begin
        if elapsed < INTERVAL:
            return False
        if elapsed - self.halted > SHORTEST:
            self.real_time_factor = self.advanced / (elapsed - self.halted)
        used = self._used
        self.restart(now)
        self.processor = (self._used - used) / elapsed
        return True

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Steps of a run with the gait of its scene, in calls that end some times a second."""

import math
import time
from typing import Protocol

from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.samples import Samples
from snake_sim_ros.stepping.sampling import Limits

FIRST_PORTION = 25  # steps of a call if unconverged ones are limited; doubles while all converge
LEAST_STEPS, MOST_STEPS = 100, 20_000  # of a call, whose references are in memory
PORTION_SECONDS = 0.1  # wall time that a call is to take [s]
SHORTEST = PORTION_SECONDS / 32  # wall time of a call up to which the next one may be so long [s]


class Advances(Protocol):
    """What takes the steps: a `Simulation`."""

    step_count: int
    report: Report

    @property
    def compile_seconds(self) -> float: ...  # noqa: D102

    def gait_reference(self, steps: int) -> tuple[Array, Array]: ...  # noqa: D102

    def advance(  # noqa: D102
        self, angle: Array, rate: Array, samples: Samples | None = None
    ) -> Report: ...


class Portions:
    """Calls of `Simulation.advance` with the gait of the scene, and their wall time."""

    def __init__(
        self, simulation: Advances, samples: Samples, limits: Limits, portion: int, timed: bool
    ) -> None:
        self.simulation, self.samples, self.limits = simulation, samples, limits
        self.time_references, self.seconds = timed, 0.0
        self.is_cautious = not math.isinf(limits.unconverged)
        self.in_time = 0  # steps taken before the limit of the wall time
        self.begin, self.portion = simulation.step_count, max(portion, samples.every)
        if self.is_cautious:
            self.portion = FIRST_PORTION

    @property
    def done(self) -> int:
        """Number of steps taken."""
        return self.simulation.step_count - self.begin

    def __call__(self, most: int) -> None:
        """Take a portion of steps, at most so many."""
        simulation, count = self.simulation, min(self.portion, most)
        begin = time.perf_counter() if self.time_references else math.nan
        reference, compiled = simulation.gait_reference(count), simulation.compile_seconds
        begin = begin if self.time_references else time.perf_counter()
        simulation.advance(*reference, self.samples.after(self.done))
        compiled = simulation.compile_seconds - compiled
        seconds = time.perf_counter() - begin - compiled
        self.seconds += seconds
        if self.seconds <= self.limits.seconds:
            self.in_time = self.done
        if self.is_cautious and simulation.report.unconverged:
            self.portion = FIRST_PORTION
        elif seconds < PORTION_SECONDS:
            growth = 2 if self.is_cautious else PORTION_SECONDS / max(seconds, SHORTEST)
            self.portion = min(int(growth * self.portion), MOST_STEPS)

    def over(self) -> bool:
        """Return whether no further step is taken."""
        report, limits = self.simulation.report, self.limits
        ended = self.seconds > limits.seconds or report.unconverged >= limits.unconverged
        return ended or bool(report.failure)

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Which step of the physics took longest, and when steps outlast their publish period."""

import numpy as np

from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.simulation import Simulation


def step_times(cycles: Array, steps: int, seconds: float) -> Array:
    """Return the times of steps with these time stamps, which took some seconds in all [s]."""
    ticks = np.diff(cycles[: steps + 1])
    return np.asarray(ticks * (seconds / max(1, int(ticks.sum()))))


class SlowSteps:
    """
    The longest step of a simulation, and the periods that were too short for their steps.

    Attributes
    ----------
    longest : float
        Wall time of the longest step [s], 0 before there was one.
    when : float
        Simulated time at its start [s].
    late_periods : int
        How many publish periods took longer than they should.

    """

    def __init__(self) -> None:
        self.longest = self.when = 0.0
        self.late_periods = 0

    def look(self, simulation: Simulation, seconds: float, most: float) -> str:
        """
        Look at the steps of a period; the sentence says what was wrong with them, if anything.

        Parameters
        ----------
        simulation : Simulation
            After these steps.
        seconds, most : float
            Wall time that they took, and that of a publish period [s].

        """
        report = simulation.last
        if seconds <= min(most, self.longest) or not report.steps:
            return ''  # No step is longer than all of them, so that nothing is new.
        source = simulation.budget if simulation.budget.share else simulation.stepper
        times = step_times(source.cycles, report.steps, seconds)
        if not len(times):  # A method that is not compiled does not time its steps.
            times = np.full(report.steps, seconds / report.steps)
        k, dt = int(times.argmax()), simulation.scene.dt
        when = simulation.time - (report.steps - k) * dt
        if times[k] > self.longest:
            self.longest, self.when = float(times[k]), when
        if seconds <= most:
            return ''
        self.late_periods += 1
        return (
            f'{report.steps} steps took {1e3 * seconds:.3g} ms, longer than their publish period '
            f'of {1e3 * most:.3g} ms: {1e3 * times[k]:.3g} ms of it the one at t = {when:.7g} s; '
            f'iterations {report.iterations_max} at most, steps unconverged {report.unconverged}'
        )

    def values(self) -> dict[str, object]:
        """Return name -> value for /diagnostics."""
        return {
            'longest_step': f'{1e3 * self.longest:.3g} ms at t = {self.when:.7g} s',
            'late_periods': self.late_periods,
        }

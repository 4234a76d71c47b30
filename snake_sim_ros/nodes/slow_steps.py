# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Which step of the physics took longest, and when and why steps outlast their publish period."""

import numpy as np

from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.simulation import Simulation

HARD = 40  # contact iterations; a step with more takes a part of a millisecond


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
    sentence : str
        What was wrong with the steps of the last period, and why; empty if nothing was.

    """

    def __init__(self) -> None:
        self.longest = self.when = 0.0
        self.late_periods = 0
        self.sentence = ''

    def look(self, simulation: Simulation, seconds: float, used: float, most: float) -> None:
        """
        Look at the steps of a period.

        Parameters
        ----------
        simulation : Simulation
            After these steps.
        seconds, used, most : float
            Wall time and processor time that they took, and wall time of a publish period [s].

        """
        report, self.sentence = simulation.last, ''
        if seconds <= min(most, self.longest) or not report.steps:
            return  # No step is longer than all of them, so that nothing is new.
        source = simulation.budget if simulation.budget.share else simulation.stepper
        times = step_times(source.cycles, report.steps, seconds)
        if not len(times):  # A method that is not compiled does not time its steps.
            times = np.full(report.steps, seconds / report.steps)
        k, dt = int(times.argmax()), simulation.scene.dt
        when = simulation.time - (report.steps - k) * dt
        if times[k] > self.longest:
            self.longest, self.when = float(times[k]), when
        if seconds > most:
            self.late_periods += 1
            self.sentence = (
                f'{report.steps} steps took {1e3 * seconds:.3g} ms, longer than their publish '
                f'period of {1e3 * most:.3g} ms: {1e3 * times[k]:.3g} ms of it the one at '
                f't = {when:.7g} s; {reason(report, seconds, used, most)}'
            )

    def values(self) -> dict[str, object]:
        """Return name -> value for /diagnostics."""
        return {
            'longest_step': f'{1e3 * self.longest:.3g} ms at t = {self.when:.7g} s',
            'late_periods': self.late_periods,
        }


def reason(report: Report, seconds: float, used: float, most: float) -> str:
    """Return why steps took too long, as a clause; arguments as of `SlowSteps.look`."""
    if used <= most:
        return f'other work had the processor for {1e3 * (seconds - used):.3g} ms'
    if report.unconverged or report.iterations_max > HARD:
        return (
            f'iterations {report.iterations_max} at most, steps unconverged {report.unconverged}'
        )
    return (
        f'a step takes {1e6 * used / report.steps:.3g} us of processor time, and '
        f'{1e6 * most / report.steps:.3g} us would keep time'
    )

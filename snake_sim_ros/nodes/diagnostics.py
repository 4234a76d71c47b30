# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The load of the node `sim`, its slowest steps, and what it says of them on /diagnostics."""

import math
import re
import time

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
import numpy as np

from snake_sim_ros.nodes.executors import WARN_PERIOD
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.methods import method_of
from snake_sim_ros.stepping.simulation import Simulation

# ---- load ---------------------------------------------------------------------------------------

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


# ---- slow steps ---------------------------------------------------------------------------------

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


# ---- messages -----------------------------------------------------------------------------------

SLOW = re.compile(r'real-time factor \S+ of ([^\s;]+)(?:; )?')  # the warning that time slips


def values_of(simulation: Simulation) -> dict[str, object]:
    """Return name -> value of what a simulation reports of its steps."""
    report, last = simulation.report, simulation.last
    return {
        'level': last.level,
        'planar_steps': report.planar_steps,
        'method': method_of(simulation.scene),
        'steps': report.steps,
        'residual': f'{last.residual_max:.3g}',
        'residual_max': f'{report.residual_max:.3g}',
        'printed_residual_max': f'{report.printed_residual_max:.3g}',
        'fallbacks': report.fallbacks,
        'iterations_per_step': f'{report.iterations / max(report.steps, 1):.3g}',
        'iterations_max': report.iterations_max,
        'unconverged_steps': report.unconverged,
        'penetration_max': f'{report.penetration_max:.3g}',
        'contacts': last.contacts,
        'overflows': report.overflows,
        'saturated_joints': saturated_joints(simulation),
    }


def saturated_joints(simulation: Simulation) -> int:
    """Return how many joint axes are at their torque limit after the last step."""
    limit = simulation.scene.robot.per_joint('torque_limit')
    return int((np.abs(simulation.last.joint_torque) >= limit * (1.0 - 1e-9)).sum())


def shown(status: DiagnosticStatus) -> dict[str, str]:
    """
    Return name -> text that the viewer shows of a status; any node may have made it.

    The warning of a real-time factor changes all the time: its numbers have a row of their own,
    and the other rows stay as they are.
    """
    values = {item.key: item.value for item in status.values}
    factor = values.get('real_time_factor', '-')
    try:
        factor = f'{float(factor):.2f}'
    except ValueError:  # It is a word, or missing.
        pass
    state = status.message
    if slow := SLOW.search(state):
        factor = f'{factor} of {slow[1]}'
        state = state.replace(slow[0], '') or 'running slowly'
    return {
        'level': values.get('level', '-'),
        'real-time factor': factor,
        'sim': state,
    }


def is_paused(status: DiagnosticStatus) -> bool:
    """Return whether a status is that of a paused simulation."""
    return any((item.key, item.value) == ('state', 'paused') for item in status.values)


def status_of(
    name: str, failure: str, warning: str, state: str, values: dict[str, object]
) -> DiagnosticStatus:
    """
    Return a status: an error if there is a failure, else a warning if there is one.

    Parameters
    ----------
    name : str
        Name of the node.
    failure, warning : str
        One sentence each; empty if there is none.
    state : str
        The message if there is neither.
    values : dict
        Name -> value, as `values_of` returns them.

    """
    level, values = DiagnosticStatus.OK, {'state': state, **values}
    if warning:
        level = DiagnosticStatus.WARN
    if failure:
        level = DiagnosticStatus.ERROR
    return DiagnosticStatus(
        level=level,
        name=f'{name}: physics',
        hardware_id='simulated',
        message=failure or warning or state,
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )

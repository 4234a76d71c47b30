# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The parts `cycle` and `accuracy` of the bench: errors after one period of the gait.

Over 15 s the landings of a gait make the error a matter of chance, to 0.1 % in case C. Over one
period they do not: a method starts from a state of the steady gait, and its error is the distance
of the middle link from where a converged run from the same state is a period later, over the
distance that this one has gone. A row of `cycle` has the spread of these errors over phases of the
gait, for an entrant and its step. A row of `accuracy` has their spread over perturbed scenes, for
the accuracy that was asked for, which is its tolerance.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
import math

import numpy as np

from snake_sim_benchmarks.comparison.bench_rows import Entry, Row
from snake_sim_benchmarks.comparison.ensembles import (
    entered_rows,
    family,
    Field,
    frequency,
    spread_rows,
    Trial,
)
from snake_sim_benchmarks.comparison.entrants import Entrant
from snake_sim_benchmarks.comparison.paths import compiled_course, Course, Start
from snake_sim_ros import Scene, Simulation, State
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import Array, with_settings
from snake_sim_ros.stepping.accuracy import with_accuracy
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.simulation import sample

# ---- cycle --------------------------------------------------------------------------------------


PHASES = 16
QUICK_PHASES = 4
RESIDUAL = 1e-12  # m/s, at which the solver of the reference stops
# Rounding keeps some steps, one in a thousand of case C, at residuals of 1e-11 m/s.
ITERATION_LIMIT = 200
PORTION = 4000  # steps of the reference for which joint references are computed together
STEP_SECONDS = 6e-6  # expected wall time of a step of the reference


def period(scene: Scene) -> float:
    """Return the period of the gait [s]."""
    return 2 * math.pi / frequency(scene)


def cycles(
    scenes: Mapping[str, Scene], field: Field, steps: tuple[float, float], phases: int
) -> Iterator[Entry]:
    """
    Yield an entry for each case: all entrants for a period, from some phases of the gait on.

    The steps of entrants and of the reference are rounded to divide the period.

    Parameters
    ----------
    scenes : mapping
        Cases, name -> scene.
    field : callable
    steps : tuple of float
        Time steps of the two runs from which the reference is extrapolated, the second half the
        first [s].
    phases : int

    """
    for case, scene in scenes.items():
        one = replace(scene, duration=period(scene))
        entered = [
            (entrant, replace(row, dt=_dividing(one.duration, row.dt)))
            for entrant, row in entered_rows('cycle', case, one, field(case))
        ]
        run = partial(_cycles, one, entered, steps, phases)
        guess = STEP_SECONDS * 3 * phases * one.duration / steps[0] + 0.5 * len(entered)
        yield Entry(tuple(row for _, row in entered), run, guess)


def _cycles(
    scene: Scene,
    entered: Sequence[tuple[Entrant, Row]],
    steps: tuple[float, float],
    phases: int,
) -> list[Row]:
    coarse, fine = (reference_run(scene, dt) for dt in steps)
    starts = steady_starts(coarse, phases)
    return spread_rows(entered, (trial_from(scene, start, coarse, fine) for start in starts))


def _dividing(duration: float, dt: float) -> float:
    """Return the time step next to dt that divides a duration [s]."""
    return duration / max(round(duration / dt), 1)


def reference_run(scene: Scene, dt: float) -> Scene:
    """Return a scene as a reference runs it, with a step next to dt that divides a phase [s]."""
    settings = {
        'method': 'newton', 'level': 'spatial', 'solver.residual_tolerance': RESIDUAL,
        'solver.iteration_limit': ITERATION_LIMIT,
        'dt': _dividing(scene.duration / PHASES, dt),
    }  # fmt: skip
    return with_settings(scene, settings)


def steady_starts(scene: Scene, phases: int) -> list[Start]:
    """
    Return states of a scene at phases of one period of its gait, when the gait is steady.

    That is from the second whole period after the soft start on.
    """
    cycle = period(scene)
    first = math.ceil(scene.gait.soft_start / cycle - 1e-9) + 1
    simulation = Simulation(scene)
    steps = round(cycle / phases / scene.dt)
    samples = first * phases + phases - 1
    states = sample(simulation, steps, samples)
    return [
        Start(State(states.coordinates[k], states.velocity[k]), k * steps * scene.dt)
        for k in range(first * phases, samples + 1)
    ]


def end_after(scene: Scene, start: Start) -> Array:
    """Return the center of the middle link after a scene's duration from a start [m]."""
    stepper = make_stepper(scene)
    state, history = start.state, stepper.empty_history()
    left, done = round(scene.duration / scene.dt), 0
    while left:
        count = min(left, PORTION)
        times = start.time + (done + 0.5 + np.arange(count)) * scene.dt
        reference = gait.reference(scene.gait, times, scene.robot.link_count - 1)
        state, history, _ = stepper.advance(state, history, *reference)
        left, done = left - count, done + count
    return np.asarray(state.q[scene.robot.middle_link, :3])


def trial_from(scene: Scene, start: Start, coarse: Scene, fine: Scene) -> Trial:
    """Return the trial from a start, with the end of two runs extrapolated to a step of zero."""
    ends = [end_after(each, start) for each in (coarse, fine)]
    end = 2 * ends[1] - ends[0]
    way = float(np.linalg.norm(end - start.state.q[scene.robot.middle_link, :3]))
    doubt = float(np.linalg.norm(end - ends[1])) / way

    def error(course: Course) -> float:
        return math.inf if course.failure else float(np.linalg.norm(course.path[-1] - end)) / way

    return Trial(scene, error, doubt, start)


# ---- accuracy -----------------------------------------------------------------------------------


ASKED = (1e-2, 1e-3, 1e-4)
TRIALS, QUICK_TRIALS = 8, 2  # scenes of each case
PERIODS = 5  # of a reference until the gait is steady, and after that


def accuracies(
    scenes: Mapping[str, Scene], steps: tuple[float, float], trials: int
) -> Iterator[Entry]:
    """
    Yield an entry for each case, with a row for each accuracy.

    Parameters
    ----------
    scenes : mapping
        Cases, name -> scene.
    steps : tuple of float
        Time steps of the two runs from which the reference is extrapolated, the second half the
        first [s].
    trials : int
        Number of perturbed scenes.

    """
    for case, scene in scenes.items():
        one = replace(scene, duration=period(scene))
        entered = [_entered(case, one, accuracy) for accuracy in ASKED]
        run = partial(_accuracies, one, entered, steps, trials)
        guess = STEP_SECONDS * PERIODS * trials * one.duration / steps[0]
        yield Entry(tuple(row for _, row in entered), run, guess)


def _entered(case: str, scene: Scene, accuracy: float) -> tuple[Entrant, Row]:
    """Return who runs a case with an accuracy, and the row in which only the keys are filled."""
    own = with_accuracy(scene, accuracy, scene.duration)
    settings = {
        'method': own.method,
        'accuracy': accuracy,
        'solver.residual_tolerance': own.solver.residual_tolerance,
    }
    row = Row(
        part='accuracy', case=case, method=own.method, level='auto', setting='accuracy',
        dt=own.dt, tolerance=accuracy, n=own.robot.link_count, duration=own.duration,
    )  # fmt: skip
    rates = (1 / own.dt,)
    return Entrant(row.method, row.setting, rates, compiled_course, settings, row.level), row


def _accuracies(
    scene: Scene, entered: Sequence[tuple[Entrant, Row]], steps: tuple[float, float], trials: int
) -> list[Row]:
    return spread_rows(entered, (_trial(each, steps) for each in family(scene, trials)))


def _trial(scene: Scene, steps: tuple[float, float]) -> Trial:
    coarse, fine = (reference_run(scene, dt) for dt in steps)
    (start,) = steady_starts(coarse, 1)
    return trial_from(scene, start, coarse, fine)

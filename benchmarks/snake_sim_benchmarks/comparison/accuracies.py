# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The part `accuracy` of the bench: errors of runs that were asked for an accuracy.

A run goes on from a state of the steady gait for one period, as in `cycles`, in perturbed scenes
of each case, as in `ensembles`. A row has the accuracy that was asked for, as its tolerance, and
the spread of the errors.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

from snake_sim_benchmarks.comparison.bench_rows import Entry, Row
from snake_sim_benchmarks.comparison.courses import compiled_course
from snake_sim_benchmarks.comparison.cycles import (
    period,
    reference_run,
    steady_starts,
    STEP_SECONDS,
    trial_from,
)
from snake_sim_benchmarks.comparison.entrants import Entrant
from snake_sim_benchmarks.comparison.families import family
from snake_sim_benchmarks.comparison.judges import spread_rows, Trial
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.stepping.accuracy import with_accuracy

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

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Trials of many entrants side by side, and the rows of the bench that come of them.

In every trial all entrants take turns, so that a disturbance of the machine affects them all and
ratios of their times are those of one run.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
import math
from typing import NamedTuple

import numpy as np

from snake_sim_benchmarks.comparison.bench_rows import Row
from snake_sim_benchmarks.comparison.courses import Course, Start, step_count
from snake_sim_benchmarks.comparison.entrants import Entrant
from snake_sim_benchmarks.comparison.spread import root_mean_square, spread
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Scene


class Trial(NamedTuple):
    """
    A run that every entrant takes.

    Attributes
    ----------
    scene : Scene
        Without the settings and the step of an entrant.
    error : callable
        ``error(course)`` returns the error of a course, relative to the way gone.
    doubt : float
        Error of the reference of this trial, relative to the way gone.
    start : Start or None
        None for the start of the scene.
    step_factor : float
        What the time step of an entrant is multiplied by.

    """

    scene: Scene
    error: Callable[[Course], float]
    doubt: float
    start: Start | None = None
    step_factor: float = 1.0


@dataclass
class Result:
    """
    What an entrant did in some trials.

    Attributes
    ----------
    row : Row
        With its keys only.
    errors, costs : list of float
        Relative errors, and processor time over simulated time.
    unconverged : int
    message : str
        The first failure, or why the entrant was refused.
    refused : bool
        Whether it cannot run at all.

    """

    row: Row
    errors: list[float] = field(default_factory=list)
    costs: list[float] = field(default_factory=list)
    unconverged: int = 0
    message: str = ''
    refused: bool = False

    def take(self, entrant: Entrant, trial: Trial) -> None:
        """Let an entrant run a trial, unless it was refused before."""
        if self.refused:
            return
        try:
            scene = entrant.scene(trial.scene, self.row.dt * trial.step_factor)
            course = entrant.run(scene, trial.start)
        except ParameterError as error:
            self.refused, self.message = True, str(error)
            return
        self.errors.append(trial.error(course))
        self.costs.append(course.seconds / (step_count(scene) * scene.dt))
        self.unconverged += course.unconverged
        self.message = self.message or course.failure

    @property
    def status(self) -> str:
        """Status of all runs, as in `base.Status`, or refused."""
        if self.refused:
            return 'refused'
        if not np.isfinite(self.errors).all():
            return 'diverged'
        return 'max_iterations' if self.unconverged else 'converged'

    def judged(self, doubts: Sequence[float]) -> Row:
        """Return the row with costs and status."""
        if self.refused:
            return replace(self.row, status=self.status, message=self.message)
        return replace(
            self.row,
            status=self.status,
            message=self.message,
            trials=len(self.errors),
            unconverged=self.unconverged,
            reference_error=float(root_mean_square(np.array(doubts))),
            seconds_per_second=float(np.nanmedian(self.costs)) if self.costs else math.nan,
        )


def results(
    entered: Sequence[tuple[Entrant, Row]], trials: Iterable[Trial]
) -> tuple[list[Result], list[float]]:
    """Return the results of all entrants in all trials, and the doubts of the trials."""
    found, doubts = [Result(row) for _, row in entered], []
    for trial in trials:
        doubts.append(trial.doubt)
        for result, (entrant, _) in zip(found, entered, strict=True):
            result.take(entrant, trial)
    return found, doubts


def spread_rows(entered: Sequence[tuple[Entrant, Row]], trials: Iterable[Trial]) -> list[Row]:
    """Return rows with the spread of errors over trials."""
    found, doubts = results(entered, trials)
    rows = []
    for result in found:
        row = result.judged(doubts)
        if not result.refused:
            of = spread(result.errors)
            row = replace(row, error_rms=of.rms, rms_low=of.low, rms_high=of.high,
                          error_median=of.median, error_quantile=of.quantile)  # fmt: skip
        rows.append(row)
    return rows


def worst_rows(entered: Sequence[tuple[Entrant, Row]], trials: Iterable[Trial]) -> list[Row]:
    """Return rows with the largest error of all trials."""
    found, doubts = results(entered, trials)
    return [
        row if result.refused else replace(row, error_path=max(result.errors))
        for result in found
        for row in [result.judged(doubts)]
    ]

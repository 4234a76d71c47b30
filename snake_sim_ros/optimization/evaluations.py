# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Evaluations: the runs of values in one scene or several, and what they achieve together."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any

from snake_sim_ros.optimization.problem import Problem
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.studies.runs import Plan, Row
from snake_sim_ros.studies.study import known_result
from snake_sim_ros.studies.workers import results_of, Workers

Result = dict[str, Any]
NO_VALUE = 'an objective or a constraint has no value'


@dataclass(frozen=True)
class Point:
    """
    Values that are to be evaluated.

    Attributes
    ----------
    number : int
        Of the evaluation, from 0.
    search : int
        Number of the search that asks, from 0; -1 for the scene as it is.
    generation : int
        Of that search, from 0.
    values : dict
        Values of the scene by their names.

    """

    number: int
    search: int
    generation: int
    values: Mapping[str, Any]


@dataclass(frozen=True)
class Evaluation:
    """
    What values achieve.

    Attributes
    ----------
    point : Point
    losses : tuple of float
        For each objective, less is better; NaN if it has no value.
    excess : float
        By how much the constraints do not hold, see `expressions.Constraint`, largest over all
        scenes; 0 is feasible, inf is without a value.
    metrics : dict
        Of the scene in which the first objective is worst, or the mean over all scenes.
    status, failure : str
        Of the first run that failed; or of the run that is shown.
    seconds : float
        Time of all runs [s].
    is_new : bool
        Whether any of its runs was run now.

    """

    point: Point
    losses: tuple[float, ...]
    excess: float
    metrics: Mapping[str, float | None]
    status: str
    failure: str
    seconds: float
    is_new: bool

    @property
    def is_feasible(self) -> bool:
        """Whether all constraints hold."""
        return self.excess == 0.0


class Evaluator:
    """
    Evaluates points with workers.

    Parameters
    ----------
    problem : Problem
    plan : Plan
        `Problem.plan` or `Problem.check_plan`.
    pool : Workers
    known : dict
        Results of runs by their keys, for those that are not run again; what is run is added.
    keep : callable
        Called with new results of runs.
    observe : callable
        Called with every evaluation as it is done.

    """

    def __init__(
        self,
        problem: Problem,
        plan: Plan,
        pool: Workers,
        known: dict[str, Result],
        keep: Callable[[Sequence[Result]], object],
        observe: Callable[[Evaluation], object],
    ) -> None:
        self.problem, self.plan, self.pool = problem, plan, pool
        self.known, self.keep, self.observe = known, keep, observe

    def __call__(self, points: Sequence[Point]) -> list[Evaluation]:
        """Return the evaluations of points, in their order."""
        count = len(self.problem.robust.scenes)
        found: list[dict[int, Result]] = [{} for _ in points]
        done: list[Evaluation | None] = [None] * len(points)
        for result, is_new in self._results(self._rows(points)):
            k, scene = divmod(result['row'], count)
            found[k][scene] = result | {'is_new': is_new}
            if len(found[k]) == count:
                results = [found[k][index] for index in range(count)]
                evaluation = evaluation_of(self.problem, points[k], results)
                done[k] = evaluation
                self.observe(evaluation)
        return [item for item in done if item]

    def _rows(self, points: Sequence[Point]) -> list[Row]:
        """Return the runs of points: all scenes of the first one, then those of the next."""
        robust, scene = self.problem.robust, self.plan.scene
        rows: list[Row] = []
        for point in points:
            for index in range(len(robust.scenes)):
                try:
                    values = robust.settings(scene, point.values, index)
                except ParameterError:  # the run is refused, too, and says why
                    values = dict(point.values)
                rows.append(Row(len(rows), values))
        return rows

    def _results(self, rows: Sequence[Row]) -> Iterator[tuple[Result, bool]]:
        """Yield the results of runs as they are done, and whether they were run now."""
        missing = []
        for row in rows:
            result = known_result(self.plan, row, self.known) if self.known else None
            if result:
                yield result, False
            else:
                missing.append(row)
        for chunk in results_of(self.plan, missing, self.pool):
            named = [result for result in chunk if result['key']]  # others were refused at once
            self.keep(named)
            self.known |= {result['key']: result for result in named}
            for result in chunk:
                yield result, True


def evaluation_of(problem: Problem, point: Point, results: Sequence[Result]) -> Evaluation:
    """Return what values achieve, from the results in all scenes."""
    short = problem.names()
    losses, excess = [], 0.0
    for result in results:
        numbers = {name: _number(result[key]) for name, key in short.items()}
        found = [item.sign * item.expression.value(numbers) for item in problem.objectives]
        losses.append(found)
        if any(map(math.isnan, found)) or result['failure']:
            excess = math.inf
        excess = max(excess, sum(item.excess(numbers) for item in problem.constraints))
    together = [problem.robust.of(column) for column in zip(*losses, strict=True)]
    shown = None if excess == math.inf else problem.robust.shown([item[0] for item in losses])
    failed = next((item for item in results if item['failure']), results[shown or 0])
    if excess == math.inf:
        together = [math.nan] * len(together)
    return Evaluation(
        point, tuple(together), excess, _metrics(problem, results, shown), failed['status'],
        failed['failure'] or (NO_VALUE if math.isinf(excess) else ''),
        sum(item['seconds'] for item in results), any(item['is_new'] for item in results),
    )  # fmt: skip


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)


def _metrics(
    problem: Problem, results: Sequence[Result], shown: int | None
) -> dict[str, float | None]:
    """Return the metrics of the result that is shown, or their means; None without a value."""
    names = [metric.name for metric in problem.metrics]
    if shown is not None:
        return {name: results[shown][name] for name in names}
    columns = {name: [result[name] for result in results] for name in names}
    return {
        name: None if None in values else math.fsum(values) / len(values)
        for name, values in columns.items()
    }

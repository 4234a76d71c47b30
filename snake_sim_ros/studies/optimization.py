# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
An optimization: generations of all searches are evaluated together, then judged.

A generation does not depend on the number of workers, nor on the order in which they are done.
Searches are repeatable, so that the journal of runs is all that is kept: an optimization that was
interrupted does the same again, and finds the runs that are done.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from functools import cached_property, partial
import math
from pathlib import Path
import time
from typing import Any, TYPE_CHECKING

import numpy as np

from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.files import write_whole
from snake_sim_ros.scene.parameters import Array, Scene, scene_to_text, with_settings
from snake_sim_ros.studies import table
from snake_sim_ros.studies.problem import Problem, problem_from
from snake_sim_ros.studies.runs import Plan, Row
from snake_sim_ros.studies.searches import front_of, library, scalar_losses, Search
from snake_sim_ros.studies.table import Result
from snake_sim_ros.studies.workers import results_of, threads, Workers

if TYPE_CHECKING:
    import polars

HISTORY = 'the history of an optimization'
HISTORY_COLUMNS = {'row', 'generation', 'excess'}  # which no other table has
NO_VALUE = 'an objective or a constraint has no value'
Run = Callable[[Plan, Iterable[Row]], Iterator[tuple[list[Result], bool]]]  # see `results_of`


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
    What values achieve, in one scene or in several together.

    Attributes
    ----------
    point : Point
    losses : tuple of float
        For each objective, less is better; NaN if it has no value.
    excess : float
        By how much the constraints do not hold, see `expressions.Expression`, largest over all
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


Observe = Callable[[Evaluation], object]


def evaluations_of(
    problem: Problem, plan: Plan, points: Sequence[Point], run: Run, observe: Observe
) -> list[Evaluation]:
    """
    Return the evaluations of points, in their order.

    Parameters
    ----------
    problem : Problem
    plan : Plan
        `Problem.plan` or `Problem.check_plan`.
    points : sequence of Point
    run : callable
        ``run(plan, rows)`` yields the results of rows, and whether they were run now.
    observe : callable
        Called with every evaluation as it is done.

    """
    robust, rows = problem.robust, list[Row]()
    count = len(robust.scenes)
    for point in points:  # all scenes of the first one, then those of the next
        for index in range(count):
            try:
                values = robust.settings(plan.scene, point.values, index)
            except ParameterError:  # the run is refused, too, and says why
                values = dict(point.values)
            rows.append(Row(len(rows), values))
    found: list[dict[int, Result]] = [{} for _ in points]
    done: dict[int, Evaluation] = {}
    for results, is_new in run(plan, rows):
        for result in results:
            k, index = divmod(result['row'], count)
            found[k][index] = result | {'is_new': is_new}
            if len(found[k]) == count:
                together = [found[k][index] for index in range(count)]
                done[k] = _evaluation(problem, points[k], together)
                observe(done[k])
    return [done[k] for k in sorted(done)]


def _evaluation(problem: Problem, point: Point, results: Sequence[Result]) -> Evaluation:
    """Return what values achieve, from the results in all scenes."""
    short = problem.names()
    losses, excess = [], 0.0
    for result in results:
        numbers = {
            name: math.nan if result[key] is None else float(result[key])
            for name, key in short.items()
        }
        found = [item.sign * item.expression.value(numbers) for item in problem.objectives]
        losses.append(found)
        if any(map(math.isnan, found)) or result['failure']:
            excess = math.inf
        excess = max(excess, sum(item.value(numbers) for item in problem.constraints))
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


def _metrics(
    problem: Problem, results: Sequence[Result], shown: int | None
) -> dict[str, float | None]:
    """Return the metrics of the result that is shown, or their means; None without a value."""
    kept = results if shown is None else [results[shown]]
    columns = {item.name: [result[item.name] for result in kept] for item in problem.metrics}
    return {
        name: None if None in values else math.fsum(values) / len(values)
        for name, values in columns.items()
    }


@dataclass
class Outcome:
    """
    What an optimization found.

    Attributes
    ----------
    problem : Problem
    evaluations : list of Evaluation
        In their order.
    stopped : str
        'evaluations', 'tolerance', 'stagnation' or 'seconds'; 'interrupted' until it stops.
    checks : dict
        Number of an evaluation -> what the settings of the check say of it, for the scene as it is
        and the best.

    """

    problem: Problem
    evaluations: list[Evaluation] = field(default_factory=list)
    stopped: str = 'interrupted'
    checks: dict[int, Evaluation] = field(default_factory=dict)

    @cached_property
    def best(self) -> list[Evaluation]:
        """The best evaluation, or the front from the least to the largest first objective."""
        losses, feasible = losses_of(self.problem, self.evaluations)
        found = [self.evaluations[k] for k in front_of(losses, feasible)]
        return sorted(found, key=lambda item: self.objectives_of(item)[0])

    @property
    def scenes(self) -> list[Scene]:
        """The scenes of the best evaluations."""
        return [with_settings(self.problem.scene, item.point.values) for item in self.best]

    def objectives_of(self, evaluation: Evaluation) -> list[float]:
        """Return the values of the objectives as their expressions say."""
        pairs = zip(self.problem.objectives, evaluation.losses, strict=True)
        return [item.sign * loss for item, loss in pairs]

    def history(self) -> 'polars.DataFrame':
        """Return the table of all evaluations."""
        metrics = [metric.name for metric in self.problem.metrics]
        names = objective_names(self.problem)
        best = {item.point.number for item in self.best}
        rows = [
            {
                'row': item.point.number, 'search': item.point.search,
                'generation': item.point.generation, **item.point.values, **item.metrics,
                **dict(zip(names, self.objectives_of(item), strict=True)),
                'excess': item.excess, 'feasible': item.is_feasible,
                'best': item.point.number in best, 'status': item.status,
                'failure': item.failure, 'seconds': item.seconds,
            }
            for item in self.evaluations
        ]  # fmt: skip
        return table.frame_of(rows, [*metrics, *names, 'excess'])


def objective_names(problem: Problem) -> list[str]:
    """Return the columns of the objectives."""
    return ['objective'] if len(problem.objectives) == 1 else ['objective_1', 'objective_2']


def losses_of(problem: Problem, evaluations: Sequence[Evaluation]) -> tuple[Array, Array]:
    """Return losses, shape (evaluations, objectives), and which evaluations are feasible."""
    losses = np.reshape([item.losses for item in evaluations], (-1, len(problem.objectives)))
    return losses.astype(float), np.array([item.is_feasible for item in evaluations], dtype=bool)


def optimize(
    scene: Scene | str | Path,
    vary: Mapping[str, Any],
    *,
    out: str | Path | None = None,
    workers: AbstractContextManager[Workers] | None = None,
    observe: Observe | None = None,
    **given: Any,
) -> Outcome:
    """
    Find the values of a scene for which an expression of metrics is largest or least.

    Parameters
    ----------
    scene : Scene, str or Path
        A scene, a YAML file, or the name of one in config/.
    vary : mapping
        Dotted names of values of the scene to bounds ``{'low': ..., 'high': ...}``.
    out : str or Path, optional
        Parquet or CSV file of the history. The journal beside it has the runs that are done, which
        are not run again.
    workers : context manager of Workers, optional
        As for `study`. Default: threads on all cores.
    observe : callable, optional
        Called with every `Evaluation` as it is done.
    **given
        `maximize`, `minimize` or `objectives`, and what else the file of an optimization has; see
        docs/optimization.md. `metrics` may have functions of a `Trajectory`.

    Raises
    ------
    ParameterError
        If anything given is not usable.

    """
    outcome = Outcome(problem_from({'scene': scene, 'vary': vary, **given}))
    run_optimization(outcome, Path(out) if out else None, workers, observe)
    return outcome


def run_optimization(
    outcome: Outcome,
    out: Path | None = None,
    workers: AbstractContextManager[Workers] | None = None,
    observe: Observe | None = None,
) -> None:
    """
    Fill an outcome that only has its problem; see `optimize`.

    After an interruption or an error, the outcome and the file have what was done.
    """
    library()
    problem, evaluations = outcome.problem, outcome.evaluations
    seen = observe or (lambda evaluation: None)

    def history() -> 'polars.DataFrame | None':
        return outcome.history() if evaluations else None

    with (
        table.stored(out, HISTORY, HISTORY_COLUMNS, history) as (known, keep),
        workers or threads() as pool,
    ):
        run = partial(results_of, workers=pool, known=known, keep=keep)
        stopped = _Loop(problem, evaluations).run(
            lambda points: evaluations_of(problem, problem.plan(), points, run, seen)
        )
        if problem.check:
            points = {item.point.number: item.point for item in [*evaluations[:1], *outcome.best]}
            checks = evaluations_of(
                problem, problem.check_plan(), list(points.values()), run, lambda item: None
            )
            outcome.checks |= {item.point.number: item for item in checks}
        outcome.stopped = stopped


class _Loop:
    """
    The searches of an optimization, and its history.

    Parameters
    ----------
    problem : Problem
    evaluations : list of Evaluation
        To which those that are done are added.

    """

    def __init__(self, problem: Problem, evaluations: list[Evaluation]) -> None:
        self.problem, self.evaluations = problem, evaluations
        settings = problem.settings
        count = len(problem.bounds)
        ends = np.linspace(0.0, 1.0, settings.weights) if len(problem.objectives) > 1 else [1.0]
        self.weights = [float(weight) for _ in range(settings.starts) for weight in ends]
        # The first start is the scene as it is, others are drawn.
        drawn = np.random.default_rng([settings.seed, 0]).random((settings.starts, count))
        drawn[0], self.present = problem.present()
        self.searches = [
            Search(drawn[k // len(ends)], [settings.seed, 1, k], settings.population)
            for k in range(len(self.weights))
        ]
        self.ended: dict[int, str] = {}
        self.shares = [drawn[0]]  # of the bounds, for every evaluation
        self.order: list[tuple[float, float]] = []  # what sorts evaluations, least first

    def run(self, evaluate: Callable[[Sequence[Point]], Sequence[Evaluation]]) -> str:
        """Evaluate generations until the optimization stops; return why."""
        stop, begin = self.problem.stop, time.monotonic()
        while len(self.ended) < len(self.searches):
            if self.evaluations and 0.0 < stop.seconds < time.monotonic() - begin:
                return 'seconds'
            first = len(self.evaluations)
            points = self._points()
            room = stop.evaluations - first
            self.evaluations += evaluate(points[:room])
            if room <= len(points):
                return 'evaluations'
            self._judge(first)
        return 'tolerance' if 'tolerance' in self.ended.values() else 'stagnation'

    def _points(self) -> list[Point]:
        """Return the next generation of all searches, after the scene as it is."""
        first = len(self.evaluations)
        points = [] if first else [Point(0, -1, 0, self.present)]
        for k, search in enumerate(self.searches):
            if k not in self.ended:
                asked = search.ask()
                self.shares += asked
                for shares in asked:
                    values = self.problem.values_at(shares)
                    points.append(Point(first + len(points), k, search.generation, values))
        return points

    def _judge(self, first: int) -> None:
        """Tell the searches what evaluations from this number on achieved, and end some."""
        is_front = len(self.problem.objectives) > 1
        if not is_front:
            self.order += self._order(first, 1.0)
        for k, search in enumerate(self.searches):
            if k in self.ended:
                continue
            better = None
            if is_front:  # whose scale may have changed
                self.order = self._order(0, self.weights[k])
                best = min(range(len(self.order)), key=lambda j: (self.order[j], j))
                better = None if self.evaluations[best].point.search == k else self.shares[best]
            found = enumerate(self.evaluations[first:], first)
            search.tell([self.order[j] for j, item in found if item.point.search == k], better)
            if search.spread < self.problem.stop.tolerance or search.is_at_its_end:
                self.ended[k] = 'tolerance'
            elif 0 < self.problem.stop.stagnation <= self._since(k):
                self.ended[k] = 'stagnation'

    def _order(self, first: int, weight: float) -> list[tuple[float, float]]:
        """
        Return what sorts the evaluations from a number on, for a search with a weight.

        The feasible ones come first, by their loss, then the others by their excess.
        """
        found = self.evaluations[first:]
        losses = scalar_losses(*losses_of(self.problem, found), weight).tolist()
        pairs = zip(found, losses, strict=True)
        return [(0.0, loss) if item.is_feasible else (1.0, item.excess) for item, loss in pairs]

    def _since(self, search: int) -> int:
        """Return the number of evaluations of a search after its best one."""
        own = [
            key
            for key, item in zip(self.order, self.evaluations, strict=True)
            if item.point.search == search
        ]
        return len(own) - 1 - min(range(len(own)), key=lambda j: (own[j], j))


def write_scenes(outcome: Outcome, out: Path) -> list[Path]:
    """
    Write the best scene, or those of the front, each as a scene that can be run.

    Parameters
    ----------
    outcome : Outcome
    out : Path
        File of the history: ``gait.parquet`` has the scene ``gait.best.yaml`` beside it, or
        ``gait.front/01.yaml`` and so on.

    """
    if len(outcome.problem.objectives) == 1:
        paths = [table.beside(out, 'best')][: len(outcome.best)]
    else:
        folder = table.beside(out, 'front')
        folder.mkdir(exist_ok=True)
        digits = max(2, len(str(len(outcome.best))))
        paths = [folder / f'{k + 1:0{digits}}.yaml' for k in range(len(outcome.best))]
    for path, item, scene in zip(paths, outcome.best, outcome.scenes, strict=True):
        numbers = ', '.join(f'{name} {value:.6g}' for name, value in _named(outcome, item).items())
        found = f'# Found by snake-sim optimize, evaluation {item.point.number}: {numbers}\n'
        write_whole(path, found + scene_to_text(scene))
    if len(outcome.problem.objectives) > 1:
        for old in {*folder.glob('[0-9]*.yaml')} - {*paths}:
            old.unlink()
    return paths


def _named(outcome: Outcome, item: Evaluation) -> dict[str, float]:
    """Return the objectives of an evaluation by their expressions."""
    texts = [objective.expression.text for objective in outcome.problem.objectives]
    return dict(zip(texts, outcome.objectives_of(item), strict=True))


def summary(outcome: Outcome) -> dict[str, Any]:
    """Return what was found, name -> value as JSON has them."""
    evaluations = outcome.evaluations
    found: dict[str, Any] = {
        'evaluations': len(evaluations),
        'found': sum(not item.is_new for item in evaluations),
        'feasible': sum(item.is_feasible for item in evaluations),
        'stopped': outcome.stopped,
        **Counter(item.status for item in evaluations),
    }
    if evaluations:
        found['start'] = described(outcome, evaluations[0])
    best = [described(outcome, item) for item in outcome.best]
    is_front = len(outcome.problem.objectives) > 1
    return found | ({'front': best} if is_front else {'best': next(iter(best), None)})


def described(outcome: Outcome, item: Evaluation) -> dict[str, Any]:
    """Return an evaluation and its check, if there is one, name -> value as JSON has them."""
    found = {
        'evaluation': item.point.number,
        'values': dict(item.point.values),
        **_achieved(outcome, item),
    }
    check = outcome.checks.get(item.point.number)
    return found | ({'check': _achieved(outcome, check)} if check else {})


def _achieved(outcome: Outcome, item: Evaluation) -> dict[str, Any]:
    """Return what values achieve, name -> value as JSON has them."""
    names = objective_names(outcome.problem)
    return {
        **_finite(dict(zip(names, outcome.objectives_of(item), strict=True))),
        'feasible': item.is_feasible,
        'metrics': _finite(item.metrics),
        'status': item.status,
    }


def _finite(numbers: Mapping[str, float | None]) -> dict[str, float | None]:
    """Return numbers without those that JSON does not have."""
    return {
        name: value if value is not None and math.isfinite(value) else None
        for name, value in numbers.items()
    }

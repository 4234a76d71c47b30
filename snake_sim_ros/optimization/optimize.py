# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The loop of an optimization: generations of all searches are evaluated together, then judged.

A generation does not depend on the number of workers, nor on the order in which they are done.
Searches are repeatable, so that the journal of runs is all that is kept: an optimization that was
interrupted does the same again, and finds the runs that are done.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
import time
from typing import Any, TYPE_CHECKING

import numpy as np

from snake_sim_ros.optimization.evaluations import Evaluation, Evaluator, Point, Result
from snake_sim_ros.optimization.fronts import front_of, ordered, scalar_losses
from snake_sim_ros.optimization.problem import Problem, problem_from
from snake_sim_ros.optimization.searches import library, Search
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array, Scene, with_settings
from snake_sim_ros.studies import table
from snake_sim_ros.studies.journal import Journal, journal_of
from snake_sim_ros.studies.workers import threads, Workers

if TYPE_CHECKING:
    import polars

Observe = Callable[[Evaluation], object]


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
    evaluations: list[Evaluation]
    stopped: str
    checks: dict[int, Evaluation]

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
    problem = problem_from({'scene': scene, 'vary': vary, **given})
    outcome = Outcome(problem, [], 'interrupted', {})
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
    table.library()
    library()
    problem, seen = outcome.problem, observe or (lambda evaluation: None)
    with _store(outcome, out) as (known, keep), workers or threads() as pool:
        evaluate = Evaluator(problem, problem.plan(), pool, known, keep, seen)
        stopped = _Loop(problem, outcome.evaluations).run(evaluate)
        if problem.check:
            points = {item.point.number: item.point for item in outcome.evaluations[:1]}
            points |= {item.point.number: item.point for item in outcome.best}
            check = Evaluator(problem, problem.check_plan(), pool, known, keep, lambda item: None)
            outcome.checks |= {item.point.number: item for item in check(list(points.values()))}
        outcome.stopped = stopped


@contextmanager
def _store(
    outcome: Outcome, out: Path | None
) -> Iterator[tuple[dict[str, Result], Callable[[Sequence[Result]], object]]]:
    """Give the runs of a journal, and what keeps more of them; write the history at the end."""
    if not out:
        yield {}, lambda chunk: None
        return
    table.check_path(out)
    _check_history(out)
    journal = Journal(journal_of(out))
    try:
        yield {row['key']: row for row in journal.rows() if row.get('key')}, journal.add
    finally:
        if outcome.evaluations:
            table.write(outcome.history(), out)
        journal.close(remove=False)


def _check_history(path: Path) -> None:
    """Raise an error if a file is there that is no history, which is not to be written over."""
    if not path.exists():
        return
    pl = table.library()
    try:
        columns = (
            pl.read_csv(path, n_rows=1).columns
            if path.suffix == '.csv'
            else (pl.read_parquet_schema(path))
        )
    except Exception:  # polars raises errors of its own and of the system
        columns = []
    if not {'row', 'generation', 'excess'} <= set(columns):
        raise ParameterError(f'{path} is not the history of an optimization; name another file')


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

    def run(self, evaluate: Callable[[Sequence[Point]], list[Evaluation]]) -> str:
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
        """Return what sorts the evaluations from a number on, for a search with a weight."""
        found = self.evaluations[first:]
        losses = scalar_losses(*losses_of(self.problem, found), weight)
        return ordered(losses.tolist(), [item.excess for item in found])

    def _since(self, search: int) -> int:
        """Return the number of evaluations of a search after its best one."""
        own = [
            key
            for key, item in zip(self.order, self.evaluations, strict=True)
            if item.point.search == search
        ]
        return len(own) - 1 - min(range(len(own)), key=lambda j: (own[j], j))

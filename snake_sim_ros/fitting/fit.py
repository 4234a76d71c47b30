# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The search for the values that explain a recording: least squares, after a global stage."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from snake_sim_ros.fitting.replay import ALIGNED, LOST, Replay, Residual, Segment
from snake_sim_ros.fitting.unknowns import scene_at, step_of, Unknown
from snake_sim_ros.optimization.searches import Search
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.studies.workers import core_count

TOLERANCE = 1e-6  # relative change of the sum of squares, or of the values, at which a fit ends
MOST_EVALUATIONS = 60  # of the residuals, besides differences
NEAR = np.log(10.0)  # a global stage searches within this factor of positive values
SPREAD_END = 0.01  # share of the box at which a global stage ends


@dataclass(frozen=True)
class Fit:
    """
    What a fit found.

    Attributes
    ----------
    replay : Replay
    unknowns : tuple of Unknown
    x : ndarray, shape (p,)
        Coordinates of the values.
    residuals : list of Residual
        Of each segment.
    jacobians : list of ndarray, shape (numbers, p)
        Derivatives of the flat residual of each segment.
    at_bound : tuple of str
        Names of the values that are at a bound.
    evaluations : int
        How often the recording was simulated.

    """

    replay: Replay
    unknowns: tuple[Unknown, ...]
    x: Array
    residuals: list[Residual]
    jacobians: list[Array]
    at_bound: tuple[str, ...]
    evaluations: int

    @property
    def values(self) -> list[float]:
        """The values found."""
        pairs = zip(self.unknowns, self.x, strict=True)
        return [unknown.value(float(x)) for unknown, x in pairs]

    @property
    def scene(self) -> Scene:
        """The scene of the replay with the values found."""
        return scene_at(self.replay.scene, self.unknowns, self.x)

    @property
    def freedom(self) -> int:
        """Number of measured numbers that are not used up by values and alignments."""
        count = sum(len(item.flat()) for item in self.residuals)
        return count - ALIGNED * len(self.residuals) - len(self.x)


class _Evaluations:
    """Residuals and their derivatives, simulated in threads."""

    def __init__(self, replay: Replay, unknowns: tuple[Unknown, ...], threads: int) -> None:
        self.replay, self.unknowns, self.threads = replay, unknowns, threads
        self.count = 0
        self.tell: Callable[[int, float], object] = lambda count, cost: None
        self.pool = ThreadPoolExecutor(threads)

    def all(self, points: Sequence[Array]) -> list[list[Residual]]:
        """Return the residuals of all segments at some points."""
        segments = self.replay.segments
        parts = [segments[k :: self.threads] for k in range(self.threads)]
        waiting = [[self.pool.submit(self._residuals, x, part) for part in parts] for x in points]
        found = []
        for futures in waiting:
            residuals: list[Residual] = [None] * len(segments)  # type: ignore[list-item]
            for k, future in enumerate(futures):
                residuals[k :: self.threads] = future.result()
            found.append(residuals)
        self.count += len(points)
        return found

    def _residuals(self, x: Array, part: tuple[Segment, ...]) -> list[Residual]:
        try:
            scene = scene_at(self.replay.scene, self.unknowns, x)
            return self.replay.residuals(scene, part)
        except ParameterError as error:
            values = [u.value(float(place)) for u, place in zip(self.unknowns, x, strict=True)]
            raise ParameterError(f'values {values} cannot be simulated: {error}') from None

    def flat(self, x: Array) -> Array:
        """Return all residuals as one array."""
        (residuals,) = self.all([x])
        found = np.concatenate([item.flat() for item in residuals])
        self.tell(self.count, float(found @ found))
        return found

    def jacobians(self, x: Array) -> list[Array]:
        """Return the derivatives of the residuals of each segment by central differences."""
        points, spans = [], []
        for k, unknown in enumerate(self.unknowns):
            ends = x[k] + step_of(unknown) * np.array([-1.0, 1.0])
            ends = np.clip(ends, *unknown.bounds)
            for end in ends:
                point = x.copy()
                point[k] = end
                points.append(point)
            spans.append(ends[1] - ends[0])
        residuals = self.all(points)
        columns = [
            [(after.flat() - before.flat()) / span for before, after in zip(*pair, strict=True)]
            for pair, span in zip(
                zip(residuals[::2], residuals[1::2], strict=True), spans, strict=True
            )
        ]
        return [np.column_stack(parts) for parts in zip(*columns, strict=True)]

    def jacobian(self, x: Array) -> Array:
        """Return the derivatives of all residuals."""
        return np.concatenate(self.jacobians(x))


@contextmanager
def _evaluations(
    replay: Replay, unknowns: tuple[Unknown, ...], threads: int | None
) -> Iterator[_Evaluations]:
    found = _Evaluations(replay, unknowns, threads or core_count())
    try:
        yield found
    finally:
        found.pool.shutdown(cancel_futures=True)


def fit(
    replay: Replay,
    unknowns: tuple[Unknown, ...],
    *,
    threads: int | None = None,
    globally: int = 0,
    seed: int = 0,
    progress: Callable[[int, float], object] | None = None,
) -> Fit:
    """
    Return the values that explain a recording best.

    Parameters
    ----------
    replay : Replay
    unknowns : tuple of Unknown
    threads : int, optional
        Default: one for each core.
    globally : int, optional
        Most simulations of a global stage before least squares; 0 for none.
    seed : int, optional
        Of the global stage.
    progress : callable, optional
        Called with the number of simulations so far and the sum of squares.

    Raises
    ------
    ParameterError
        If no segment can be simulated with the values of the scene.

    """
    replay.compile()
    x = np.array([unknown.coordinate(unknown.start) for unknown in unknowns])
    low, high = np.array([unknown.bounds for unknown in unknowns]).T
    with _evaluations(replay, unknowns, threads) as evaluate:
        evaluate.tell = progress or evaluate.tell
        if np.abs(evaluate.flat(x)).min() >= LOST:
            raise ParameterError('every segment diverges with the values of the scene')
        if globally:
            x = _searched(evaluate, x, low, high, globally, seed)
        found = least_squares(
            evaluate.flat, np.clip(x, low, high), evaluate.jacobian, bounds=(low, high),
            x_scale='jac', ftol=TOLERANCE, xtol=TOLERANCE, gtol=TOLERANCE,
            max_nfev=MOST_EVALUATIONS,
        )  # fmt: skip
        (residuals,) = evaluate.all([found.x])
        jacobians = evaluate.jacobians(found.x)
        at_bound = tuple(
            unknown.name for unknown, side in zip(unknowns, found.active_mask, strict=True) if side
        )
        return Fit(replay, unknowns, found.x, residuals, jacobians, at_bound, evaluate.count)


def _searched(
    evaluate: _Evaluations, x: Array, low: Array, high: Array, most: int, seed: int
) -> Array:
    """Return the best point of a CMA-ES search in a box around the start."""
    unknowns = evaluate.unknowns
    reach = np.array([NEAR if u.is_positive else max(1.0, 10 * abs(u.start)) for u in unknowns])
    low, high = np.maximum(low, x - reach), np.minimum(high, x + reach)
    search = Search((x - low) / (high - low), [seed], 0)
    best, least = x, np.inf
    while evaluate.count < most and search.spread > SPREAD_END and not search.is_at_its_end:
        points = [low + shares * (high - low) for shares in search.ask()]
        costs = [
            float(sum((item.flat() ** 2).sum() for item in residuals))
            for residuals in evaluate.all(points)
        ]
        search.tell([(cost,) for cost in costs])
        if min(costs) < least:
            least, best = min(costs), points[int(np.argmin(costs))]
        evaluate.tell(evaluate.count, least)
    return best

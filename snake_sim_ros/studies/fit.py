# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The values of a scene that explain a recording: their names, and the search for them.

The search is one of least squares, if asked for after a global stage by CMA-ES.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
import math
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from snake_sim_ros.scene.checked_records import flat_fields, nearest, ParameterError, quoted
from snake_sim_ros.scene.parameters import Array, Scene, with_settings
from snake_sim_ros.studies.replay import (
    ALIGNED,
    AS_STATED,
    eased,
    FARTHEST_OFFSET,
    has_eased,
    LOST,
    Replay,
    Residual,
    Segment,
    Setup,
)
from snake_sim_ros.studies.searches import Search
from snake_sim_ros.studies.workers import closing_pool, core_count

PHYSICS = ('robot.', 'friction.', 'pegs.', 'self_contact_friction')  # prefixes
FIXED = ('robot.link_count', 'robot.joint_limit', 'robot.joint_rate_limit')
FARTHEST = math.log(1e3)  # a positive value changes at most by this factor
LARGEST = 700.0  # logarithm of a number that a computer has, for ends of intervals
STEP = 0.02  # of differences: a share of a positive value
LEAST_SIZE = 0.05  # of a value that is not positive, for its step and for relative changes
TOLERANCE = 1e-6  # relative change of the sum of squares, or of the values, at which a fit ends
EASED_TOLERANCE = 1e-2  # the same for a search in an eased model, from which another one starts
MOST_EVALUATIONS = 60  # of the residuals, besides differences
NEAR = np.log(10.0)  # a global stage searches within this factor of positive values
SPREAD_END = 0.01  # share of the box at which a global stage ends
# Where a search starts if a scene has 0: with a little friction in joints that lie flat, contacts
# are often not solved, and such segments are lost.
FROM_ZERO = {'robot.joint_friction': 0.1}  # N m
FARTHEST_MARKER, FARTHEST_TILT = 0.5, 0.5  # m, rad
# What belongs to the setup of a measurement, not to a scene: field, distance from its start, unit.
SETUP = {
    'time_offset.joints': ('joints', FARTHEST_OFFSET, 's'),
    'time_offset.poses': ('poses', FARTHEST_OFFSET, 's'),
    **{f'marker.{axis}': (axis, FARTHEST_MARKER, 'm') for axis in 'xyz'},
    **{f'frame.{turn}': (turn, FARTHEST_TILT, 'rad') for turn in ('roll', 'pitch')},
}
OFFSETS = 'time_offset.joints', 'time_offset.poses'


@dataclass(frozen=True)
class Unknown:
    """
    A number that a fit finds, one for all of its names.

    Attributes
    ----------
    names : tuple of str
        Dotted names in a scene.
    start : float
        Its value in the scene.
    low, high : float
        Its limits.
    unit : str
    is_positive : bool
        Whether it is positive, and its logarithm is what is found.

    """

    names: tuple[str, ...]
    start: float
    low: float
    high: float
    unit: str
    is_positive: bool

    @property
    def name(self) -> str:
        """All names as they were given."""
        return '='.join(self.names)

    @property
    def bounds(self) -> tuple[float, float]:
        """Least and largest coordinate."""
        if not self.is_positive:
            return self.low, self.high
        middle = math.log(self.start)
        low = math.log(self.low) if self.low > 0.0 else -math.inf
        high = math.log(self.high) if self.high < math.inf else math.inf
        return max(low, middle - FARTHEST) - 1e-9, min(high, middle + FARTHEST) + 1e-9

    @property
    def step(self) -> float:
        """Step of a coordinate for differences."""
        return STEP if self.is_positive else STEP * max(abs(self.start), LEAST_SIZE)

    def coordinate(self, value: float) -> float:
        """Return the coordinate of a value, its logarithm if it is positive."""
        return math.log(value) if self.is_positive else value

    def value(self, coordinate: float) -> float:
        """Return the value of a coordinate."""
        found = math.exp(min(coordinate, LARGEST)) if self.is_positive else coordinate
        return min(max(found, self.low), self.high)


def unknowns_of(
    scene: Scene, free: Sequence[str], setup: Setup = AS_STATED
) -> tuple[Unknown, ...]:
    """
    Return the unknowns of a fit.

    Parameters
    ----------
    scene : Scene
        With the values to start from.
    free : sequence of str
        Dotted names; names with ``=`` between them have one value. Those of SETUP are not of the
        scene, but of `replay.Setup`.
    setup : Setup, optional
        Where those start.

    Raises
    ------
    ParameterError
        If a name is unknown, given twice, or not one of a number that physics depends on.

    """
    known, found, seen = flat_fields(scene), [], set[str]()
    for item in free:
        names = tuple(part.strip() for part in item.split('='))
        for name in names:
            if name in seen:
                raise ParameterError(f'--free {name} is given twice')
            seen.add(name)
            if name not in SETUP:
                _check(name, scene)
        if any(name in SETUP for name in names):
            found.append(_of_setup(names, setup))
            continue
        start, limits = known[names[0]]
        start = start or FROM_ZERO.get(names[0], 0.0)
        above = limits['above'] + 1e-12 if limits['above'] >= 0.0 else -math.inf
        low = max(limits['minimum'], above)
        found.append(Unknown(
            names, float(start), float(low), float(limits['maximum']), limits['unit'],
            is_positive=low >= 0.0 and start > 0.0,
        ))  # fmt: skip
    if not found:
        raise ParameterError('--free must name at least one value, such as friction.transversal')
    return tuple(found)


def _of_setup(names: tuple[str, ...], setup: Setup) -> Unknown:
    """Return the unknown of one or several numbers of a setup."""
    if others := [name for name in names if name not in SETUP]:
        raise ParameterError(f'--free {"=".join(names)}: {others[0]} is a number of the scene')
    (field, far, unit), *more = (SETUP[name] for name in names)
    if any(other != unit for _, _, other in more):
        raise ParameterError(f'--free {"=".join(names)}: these are numbers of different kinds')
    start = getattr(setup, field)
    return Unknown(names, start, start - far, start + far, unit, is_positive=False)


def _check(name: str, scene: Scene) -> None:
    """Raise if a name is not one of a number that a fit can find."""
    known = flat_fields(scene)
    usable = [
        each for each, (value, _) in known.items()
        if each.startswith(PHYSICS) and each not in FIXED and isinstance(value, float)
    ]  # fmt: skip
    if name in usable:
        return
    if name not in known:
        hint = nearest(name, [*known, *SETUP])
        raise ParameterError(f'--free: unknown name {quoted(name)}; {hint}')
    value = known[name][0]
    if isinstance(value, tuple):
        raise ParameterError(
            f'--free {name}: a fit finds one number, this is a list of {len(value)}; give one '
            f'number in the scene'
        )
    if value is None:
        raise ParameterError(f'--free {name} has no value in the scene; --set one to start from')
    if isinstance(value, (str, bool)):
        raise ParameterError(f'--free {name}: a fit finds numbers, this is {quoted(value)}')
    raise ParameterError(
        f'--free {name}: a fit finds only numbers of the robot and of friction; '
        f'choose from: {", ".join([*usable, *SETUP])}'
    )


def scene_at(scene: Scene, unknowns: Sequence[Unknown], x: Array) -> Scene:
    """Return the scene with the values of coordinates."""
    settings = {
        name: unknown.value(float(place))
        for unknown, place in zip(unknowns, x, strict=True)
        for name in unknown.names
        if name not in SETUP
    }
    return with_settings(scene, settings)


def setup_at(setup: Setup, unknowns: Sequence[Unknown], x: Array) -> Setup:
    """Return the setup with the values of coordinates; what is not unknown stays."""
    values = {
        SETUP[name][0]: unknown.value(float(place))
        for unknown, place in zip(unknowns, x, strict=True)
        for name in unknown.names
        if name in SETUP
    }
    return setup._replace(**values)


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
    def setup(self) -> Setup:
        """The setup found, or that of the replay."""
        return setup_at(self.replay.setup, self.unknowns, self.x)

    @property
    def freedom(self) -> int:
        """Number of measured numbers that are not used up by values and alignments."""
        count = sum(len(item.flat()) for item in self.residuals)
        return count - ALIGNED * len(self.residuals) - len(self.x)


class Evaluations:
    """Residuals and their derivatives, simulated in the threads of a pool."""

    def __init__(
        self, replay: Replay, unknowns: tuple[Unknown, ...], pool: Executor, threads: int
    ) -> None:
        self.replay, self.unknowns, self.pool, self.threads = replay, unknowns, pool, threads
        self.of_setup = np.array([unknown.names[0] in SETUP for unknown in unknowns], dtype=bool)
        self.count, self.is_eased = 0, False  # whether models are those of `replay.eased`
        self.report: Callable[[int, float], object] = lambda count, cost: None
        self._residuals: dict[bytes, list[Residual]] = {}  # of points since the last derivatives
        self._jacobians: dict[bytes, list[Array]] = {}  # of the last one

    def all(self, points: Sequence[Array]) -> list[list[Residual]]:
        """Return the residuals of all segments at some points, one simulation for each scene."""
        segments = self.replay.segments
        parts = [segments[k :: self.threads] for k in range(self.threads)]
        alike: dict[bytes, list[int]] = {}  # points that differ in the setup only
        for k, x in enumerate(points):
            alike.setdefault(x[~self.of_setup].tobytes(), []).append(k)
        groups = [[points[k] for k in group] for group in alike.values()]
        waiting = [[self.pool.submit(self._of, group, part) for part in parts] for group in groups]
        found: list[list[Residual]] = [[None] * len(segments) for _ in points]  # type: ignore[list-item]
        for group, futures in zip(alike.values(), waiting, strict=True):
            for k, future in enumerate(futures):
                for point, residuals in zip(group, future.result(), strict=True):
                    found[point][k :: self.threads] = residuals
        self.count += len(groups)
        return found

    def _of(self, points: Sequence[Array], part: tuple[Segment, ...]) -> list[list[Residual]]:
        """Return the residuals of some segments at points with one scene."""
        try:
            scene = self._scene(points[0])
            setups = [setup_at(self.replay.setup, self.unknowns, x) for x in points]
            return self.replay.residuals_of(scene, setups, part)
        except ParameterError as error:
            pairs = zip(self.unknowns, points[0], strict=True)
            values = [unknown.value(float(place)) for unknown, place in pairs]
            raise ParameterError(f'values {values} cannot be simulated: {error}') from None

    def _scene(self, x: Array) -> Scene:
        """Return the scene of a point."""
        scene = scene_at(self.replay.scene, self.unknowns, x)
        return eased(scene) if self.is_eased else scene

    def begin(self, x: Array, known: list[Residual] | None = None) -> None:
        """
        Begin a search at a point with what is compiled, and the residuals there if they are known.

        Raises
        ------
        ParameterError
            If no segment can be simulated there.

        """
        self._residuals, self._jacobians = {}, {}
        if known:
            self._residuals[x.tobytes()] = known
        else:
            self.replay.compile(self._scene(x))
        if np.abs(self.flat(x)).min() >= LOST:
            raise ParameterError('every segment diverges with the values of the scene')

    def residuals(self, x: Array) -> list[Residual]:
        """Return the residuals at a point."""
        key = x.tobytes()
        if key not in self._residuals:
            (self._residuals[key],) = self.all([x])
        return self._residuals[key]

    def flat(self, x: Array) -> Array:
        """Return all residuals as one array."""
        found = np.concatenate([item.flat() for item in self.residuals(x)])
        self.report(self.count, float(found @ found))
        return found

    def jacobians(self, x: Array) -> list[Array]:
        """
        Return the derivatives of the residuals of each segment by central differences.

        Where a segment is lost on one side, they are those to the other side, and else 0.
        """
        key = x.tobytes()
        if key not in self._jacobians:
            self._jacobians = {key: self._differences(x)}
            self._residuals = {key: self.residuals(x)}
        return self._jacobians[key]

    def _differences(self, x: Array) -> list[Array]:
        low, high = np.array([unknown.bounds for unknown in self.unknowns]).T
        steps = np.array([unknown.step for unknown in self.unknowns])
        ends = np.clip(x - steps, low, high), np.clip(x + steps, low, high)
        points = [np.where(np.arange(len(x)) == k, end, x) for k in range(len(x)) for end in ends]
        there, here = self.all(points), self.residuals(x)
        return [
            np.column_stack([
                _slope([(ends[0][k], low[j]), (x[k], here[j]), (ends[1][k], high[j])])
                for k, (low, high) in enumerate(zip(there[::2], there[1::2], strict=True))
            ])
            for j in range(len(here))
        ]  # fmt: skip

    def jacobian(self, x: Array) -> Array:
        """Return the derivatives of all residuals."""
        return np.concatenate(self.jacobians(x))


def _slope(places: Sequence[tuple[float, Residual]]) -> Array:
    """Return the derivative of the flat residual of a segment along a coordinate."""
    known = [(place, item) for place, item in places if not item.is_lost]
    if len(known) < 2:
        return np.zeros(len(places[0][1].flat()))
    (low, before), (high, after) = known[0], known[-1]
    return (after.flat() - before.flat()) / (high - low)


def fit(
    replay: Replay,
    unknowns: tuple[Unknown, ...],
    *,
    threads: int | None = None,
    globally: int = 0,
    seed: int = 0,
    progress: Callable[[int, float], object] | None = None,
    known: list[Residual] | None = None,
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
    known : list of Residual, optional
        Those of the scene of the replay, if it has been simulated.

    Raises
    ------
    ParameterError
        If no segment can be simulated with the values of the scene.

    """
    x = np.array([unknown.coordinate(unknown.start) for unknown in unknowns])
    low, high = np.array([unknown.bounds for unknown in unknowns]).T
    count = threads or core_count()
    with closing_pool(ThreadPoolExecutor(count)) as pool:
        evaluate = Evaluations(replay, unknowns, pool, count)
        evaluate.report = progress or evaluate.report
        evaluate.is_eased = has_eased(replay, scene_at(replay.scene, unknowns, x))
        evaluate.begin(
            x, known if not evaluate.is_eased and _is_as_given(replay, unknowns) else None
        )
        if globally:
            x = _searched(evaluate, x, low, high, globally, seed)
        x = start = np.clip(x, low, high)
        if evaluate.is_eased:
            x = _least_squares(evaluate, x, start, EASED_TOLERANCE).x
            evaluate.is_eased = False
            evaluate.begin(x)
        found = _least_squares(evaluate, x, start, TOLERANCE)
        at_bound = tuple(
            unknown.name for unknown, side in zip(unknowns, found.active_mask, strict=True) if side
        )
        jacobians, residuals = evaluate.jacobians(found.x), evaluate.residuals(found.x)
        return Fit(replay, unknowns, found.x, residuals, jacobians, at_bound, evaluate.count)


def _is_as_given(replay: Replay, unknowns: Sequence[Unknown]) -> bool:
    """Return whether a search starts in the scene of a replay."""
    given = flat_fields(replay.scene)
    return all(
        given[name][0] == unknown.start
        for unknown in unknowns
        for name in unknown.names
        if name not in SETUP
    )


def _least_squares(evaluate: Evaluations, x: Array, start: Array, tolerance: float) -> Any:
    """Return what SciPy finds from a point x, in a search that began at another."""
    hold = _hold(evaluate.unknowns)
    return least_squares(
        lambda y: np.concatenate([evaluate.flat(y), hold @ (y - start)]), x,
        lambda y: np.concatenate([evaluate.jacobian(y), hold]),
        bounds=np.array([unknown.bounds for unknown in evaluate.unknowns]).T,
        x_scale='jac', ftol=tolerance, xtol=tolerance, gtol=tolerance,
        max_nfev=MOST_EVALUATIONS,
    )  # fmt: skip


def _hold(unknowns: Sequence[Unknown]) -> Array:
    """
    Return the derivatives of residuals that hold coordinates where a search starts, (p, p).

    Each says that the standard deviation of a coordinate is the farthest that it may go: FARTHEST,
    or half its range, if it has one. It moves what a recording determines by much less than its
    noise, and what it does not determine stays, which would otherwise follow the errors of
    derivatives as far as bounds allow.
    """
    far = [FARTHEST if u.is_positive else (u.high - u.low) / 2 for u in unknowns]
    return np.diag(1.0 / np.array(far))


def _searched(
    evaluate: Evaluations, x: Array, low: Array, high: Array, most: int, seed: int
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
        evaluate.report(evaluate.count, least)
    return best

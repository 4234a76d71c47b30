# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What an optimization is: a scene, bounds of values, objectives and constraints; and as a file.

An objective may hold for several scenes, whose values differ by given factors: it is robust then.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np

from snake_sim_ros.scene.checked_records import (
    CheckedRecord,
    from_mapping,
    nearest,
    ParameterError,
    quantity,
    quoted,
    scaled,
)
from snake_sim_ros.scene.parameters import Array, named_values, Scene, with_settings
from snake_sim_ros.studies.expressions import constraint_of, Expression, expression_of
from snake_sim_ros.studies.metrics import Metric, METRICS, metrics_of, USUAL_METRICS
from snake_sim_ros.studies.runs import Plan
from snake_sim_ros.studies.study import (
    followers_of,
    loaded,
    mapping_at,
    scene_and_values,
    scene_with,
    Settings,
    settings_of,
    with_followers,
)
from snake_sim_ros.studies.variations import check_names, Range

GOALS = {'maximize': -1.0, 'minimize': 1.0}  # and the sign with which a value is a loss
# Of the history, besides values and metrics.
COLUMNS = (
    *('row', 'search', 'generation', 'objective', 'objective_1', 'objective_2', 'excess'),
    *('feasible', 'best', 'status', 'failure', 'seconds'),
)
PROBLEM_KEYS = (
    *('scene', 'set', 'vary', 'follow', *GOALS, 'objectives', 'constraints', 'metrics'),
    *('robust', 'stop', 'check'),
)
MEASURES = ('worst', 'mean')
ROBUST_EXAMPLE = '{over: {friction: 0.3}, measure: worst}'
MOST_SCENES = 1000  # for one evaluation
# How friction falls with speed, not how large it is: a factor of all friction leaves it alone.
SHAPES = ('friction.kinetic_ratio', 'friction.stribeck_speed')


@dataclass(frozen=True)
class Robust:
    """
    The scenes in which values are judged, and how.

    Attributes
    ----------
    measure : str
        One of MEASURES.
    scenes : tuple of dict
        Dotted name of a value -> factor, for each scene.

    """

    measure: str = 'worst'
    scenes: tuple[Mapping[str, float], ...] = ({},)

    def of(self, losses: Sequence[float]) -> float:
        """Return the loss of values, from those in all scenes."""
        return max(losses) if self.measure == 'worst' else math.fsum(losses) / len(losses)

    def shown(self, losses: Sequence[float]) -> int | None:
        """Return the scene whose metrics stand for all; None if that is their mean."""
        return losses.index(max(losses)) if self.measure == 'worst' else None

    def settings(self, scene: Scene, values: Mapping[str, Any], index: int) -> dict[str, Any]:
        """Return values and, besides them, what differs in one of the scenes."""
        factors = self.scenes[index]
        if not factors:
            return dict(values)
        keys = {name.removesuffix('_deg'): name for name in values}
        found, flat = dict(values), named_values(with_settings(scene, values))
        for name, factor in factors.items():
            key = keys.get(name, name)
            found[key] = scaled(values[key] if key in values else flat[name][0], factor)
        return found


def robust_of(given: Any, scene: Scene) -> Robust:
    """
    Return what `robust` of a file says, as in ROBUST_EXAMPLE.

    Raises
    ------
    ParameterError
        If it is something else.

    """
    if given is None:
        return Robust()
    if not isinstance(given, Mapping) or not isinstance(given.get('over'), Mapping):
        raise ParameterError(f'robust must be like {ROBUST_EXAMPLE}, got {quoted(given)}')
    for key in given:
        if key not in ('over', 'measure'):
            raise ParameterError(
                f'robust: unknown key {quoted(key)}; must be like {ROBUST_EXAMPLE}'
            )
    measure = given.get('measure', 'worst')
    if measure not in MEASURES:
        raise ParameterError(f'robust: measure must be worst or mean, got {quoted(measure)}')
    if not given['over']:
        raise ParameterError(f'robust: over must name a value, such as {ROBUST_EXAMPLE}')
    groups = [_group(name, factors, scene) for name, factors in given['over'].items()]
    scenes = []
    for parts in itertools.product(*groups):
        names = [name for part in parts for name in part]
        for name in names:
            if names.count(name) > 1:
                raise ParameterError(f'robust: over: {name} is given twice')
        scenes.append({name: factor for part in parts for name, factor in part.items()})
    if len(scenes) > MOST_SCENES:
        raise ParameterError(
            f'robust: over must make at most {MOST_SCENES} scenes, got {len(scenes)}'
        )
    return Robust(measure, tuple(scenes))


def _group(name: Any, given: Any, scene: Scene) -> list[dict[str, float]]:
    """Return the factors of a value, or of all values in a part of the scene such as friction."""
    flat = named_values(scene)
    plain = str(name).removesuffix('_deg')
    inside = [plain] if plain in flat else [key for key in flat if key.startswith(f'{plain}.')]
    inside = [
        key for key in inside
        if key == plain or (flat[key][0] is not None and key not in SHAPES)
    ]  # fmt: skip
    if not inside:
        raise ParameterError(f'robust: over: unknown name {quoted(name)}; {nearest(plain, flat)}')
    for key in inside:
        leaves = _leaves(flat[key][0])
        if not leaves or not all(isinstance(leaf, float) for leaf in leaves):
            raise ParameterError(
                f'robust: over: {key} is {flat[key][0]!r}, which no factor changes; name a number '
                f'of the scene such as friction.longitudinal'
            )
    if not any(any(_leaves(flat[key][0])) for key in inside):
        raise ParameterError(f'robust: over: {name} is 0 in the scene, which no factor changes')
    return [dict.fromkeys(inside, factor) for factor in _factors(name, given)]


def _leaves(value: Any) -> list[Any]:
    """Return the values in nested tuples."""
    return (
        [leaf for entry in value for leaf in _leaves(entry)]
        if isinstance(value, tuple)
        else [value]
    )


def _factors(name: str, given: Any) -> tuple[float, ...]:
    """Return factors: those listed, or 1 - s, 1, 1 + s of a share s."""
    listed = given if isinstance(given, (list, tuple)) else [given]
    for number in listed:
        is_number = isinstance(number, (int, float)) and not isinstance(number, bool)
        if not is_number or not math.isfinite(number) or not number > 0.0:
            break
    else:
        if isinstance(given, (list, tuple)) and listed:
            return tuple(map(float, listed))
        if listed and given < 1.0:
            return (1.0 - given, 1.0, 1.0 + given)
    raise ParameterError(
        f'robust: over: {name} must be a share above 0 and below 1 such as 0.3 (+-30 %), or '
        f'factors such as [0.7, 1, 1.3], got {quoted(given)}'
    )


@dataclass(frozen=True, kw_only=True)
class SearchSettings(Settings):
    """The values of an optimization that are one number."""

    starts: int = quantity(1, '1', 'searches from different places', minimum=1, maximum=1000)
    population: int = quantity(
        0, '1', 'samples of a generation (0 = the default of CMA-ES)', minimum=0, maximum=10**5
    )
    weights: int = quantity(5, '1', 'searches along a front', minimum=2, maximum=1000)

    def __post_init__(self) -> None:
        """Check every field, and that a generation can be ranked."""
        super().__post_init__()
        if self.population == 1:
            raise ParameterError('population must be at least 2, or 0 for the default, got 1')


@dataclass(frozen=True, kw_only=True)
class Stop(CheckedRecord):
    """When an optimization stops, whatever comes first."""

    evaluations: int = quantity(200, '1', 'number of evaluations', minimum=1, maximum=10**7)
    tolerance: float = quantity(
        1e-4, '1', 'a search ends when its samples differ by less, as a share of the bounds',
        minimum=0, maximum=1,
    )  # fmt: skip
    stagnation: int = quantity(
        0, '1', 'a search ends after this many evaluations without improvement (0 = never)',
        minimum=0,
    )  # fmt: skip
    seconds: float = quantity(
        0.0, 's', 'wall time after which no generation begins (0 = unlimited)', minimum=0
    )


@dataclass(frozen=True)
class Objective:
    """An expression of metrics, and the sign with which it is a loss."""

    expression: Expression
    sign: float


@dataclass(frozen=True)
class Problem:
    """
    An optimization.

    Attributes
    ----------
    scene : Scene
        With the values that are set.
    given : frozenset of str
        Names of the values that are set, vary or follow.
    bounds : dict
        Dotted name of a value -> its range.
    follow : dict
        Dotted name of a value -> an expression of those with bounds.
    objectives : tuple of Objective
        One or two.
    constraints : tuple of Expression
    metrics : tuple of Metric
    robust : Robust
    stop : Stop
    check : dict
        Values of the scene in which the result is checked; empty for no check.
    settings : SearchSettings

    """

    scene: Scene
    given: frozenset[str]
    bounds: Mapping[str, Range]
    follow: Mapping[str, Expression]
    objectives: tuple[Objective, ...]
    constraints: tuple[Expression, ...]
    metrics: tuple[Metric, ...]
    robust: Robust
    stop: Stop
    check: Mapping[str, Any]
    settings: SearchSettings

    def plan(self) -> Plan:
        """Return what all runs have in common."""
        settings = self.settings
        return Plan(
            self.scene, self.given, self.metrics, settings.rate, time_limit=settings.time_limit
        )  # fmt: skip

    def check_plan(self) -> Plan:
        """Return what the runs of the check have in common: their own steps, all the time."""
        settings = {'accuracy': 0.0, **self.check}
        scene, given = with_settings(self.scene, settings), self.given | settings.keys()
        return Plan(scene, given, self.metrics, self.settings.rate)

    def values_at(self, shares: Array) -> dict[str, float]:
        """Return the values at shares of the bounds, and those that follow from them."""
        pairs = zip(self.bounds.items(), shares.tolist(), strict=True)
        return with_followers(
            {name: bound.at(share) for (name, bound), share in pairs}, self.follow
        )

    def present(self) -> tuple[Array, dict[str, float]]:
        """Return where the scene itself is: shares of the bounds, and values within them."""
        flat, shares, values = named_values(self.scene), [], {}
        for name, bound in self.bounds.items():
            value = flat[name.removesuffix('_deg')][0]
            if name.endswith('_deg'):
                value = math.degrees(value)
            values[name] = min(max(value, bound.low), bound.high)
            shares.append(_share(bound, values[name]))
        return np.array(shares), with_followers(values, self.follow)

    def names(self) -> dict[str, str]:
        """Return the name of every metric in expressions -> in results."""
        return _short_names(self.metrics)


def _share(bound: Range, value: float) -> float:
    """Return the share of a range at which a value is, the inverse of `Range.at`."""
    if bound.scale == 'log':
        share = math.log(value / bound.low) / math.log(bound.high / bound.low)
    else:
        share = (value - bound.low) / (bound.high - bound.low)
    return min(max(share, 0.0), 1.0)


def _short_names(metrics: Sequence[Metric]) -> dict[str, str]:
    """Return names without the modules of functions -> names."""
    return {metric.name.rpartition(':')[2]: metric.name for metric in metrics}


def load_problem(path: Path) -> Problem:
    """
    Read an optimization from a YAML file; its scene and modules are searched beside it first.

    Raises
    ------
    ParameterError
        If the file is missing, or if anything in it is not usable.

    """
    return loaded(path, problem_from)


def problem_from(mapping: Any, folder: Path | None = None) -> Problem:
    """
    Return an optimization from what its file says, see docs/optimization.md.

    Raises
    ------
    ParameterError
        If anything in it is not usable.

    """
    settings = settings_of(SearchSettings, mapping, PROBLEM_KEYS)
    stop: Stop = from_mapping(Stop, mapping.get('stop'), 'stop')
    scene, fixed, vary = scene_and_values(mapping, folder)
    bounds = {name: _bound(name, given, scene) for name, given in vary.items()}
    follow = followers_of(mapping, bounds, fixed, scene)
    objectives, constraints, metrics = _goals(mapping, folder)
    given = frozenset([*fixed, *bounds, *follow])
    check = mapping_at(mapping, 'check')
    check_names(scene, [*check, *(name for name in given if name not in check)], 'check')
    for name in check:
        if name in {*bounds, *follow}:
            raise ParameterError(f'check: {name} must not vary')
    scene_with(scene, check, 'check')
    robust = robust_of(mapping.get('robust'), scene)
    return Problem(scene, given, bounds, follow, objectives, constraints, metrics, robust, stop,
                   check, settings)  # fmt: skip


def _bound(name: str, given: Any, scene: Scene) -> Range:
    """Return the range of a value, whose ends the scene must take."""
    if not isinstance(given, Mapping) or not {'low', 'high'} <= given.keys():
        raise ParameterError(
            f'vary: {name} must have bounds such as {{low: 0.1, high: 0.3}}, got {quoted(given)}'
        )
    if 'count' in given:
        raise ParameterError(f'vary: {name} has no count of values in an optimization')
    bound: Range = from_mapping(Range, given, f'vary: {name}')
    value = named_values(scene)[name.removesuffix('_deg')][0]
    if not isinstance(value, float):
        raise ParameterError(
            f'vary: {name} is {quoted(value)} in the scene; only numbers with a fraction have '
            f'bounds'
        )
    for end in (bound.low, bound.high):
        scene_with(scene, {name: end}, 'vary')
    return bound


def _goals(
    mapping: Mapping[str, Any], folder: Path | None
) -> tuple[tuple[Objective, ...], tuple[Expression, ...], tuple[Metric, ...]]:
    """Return objectives, constraints, and the metrics that they need or that are listed."""
    own = metrics_of(mapping.get('metrics', USUAL_METRICS), folder)
    short, plain = _short_names(own), [metric.name for metric in own]
    if len(short) < len(own):
        raise ParameterError(
            f'metrics: functions must have different names, got {", ".join(plain)}'
        )
    known = [*METRICS, *short]
    found = [key for key in (*GOALS, 'objectives') if key in mapping]
    if len(found) != 1:
        raise ParameterError(
            'there must be one of maximize, minimize (an expression such as speed) and objectives '
            f'(two of them, which are maximized), got {" and ".join(found) or "none"}'
        )
    texts, sign = mapping[found[0]], GOALS.get(found[0], GOALS['maximize'])
    if found[0] == 'objectives':
        if not isinstance(texts, (list, tuple)) or len(texts) != 2:
            raise ParameterError(
                f'objectives must be two, such as [speed, -cost_of_transport], got {quoted(texts)}'
            )
    else:
        texts = [texts]
    objectives = tuple(Objective(expression_of(text, known, found[0]), sign) for text in texts)
    texts = mapping.get('constraints', [])
    if not isinstance(texts, (list, tuple)):
        texts = [texts]
    constraints = tuple(constraint_of(text, known, 'constraints') for text in texts)
    for name in plain:
        if name in COLUMNS or name in mapping['vary']:
            raise ParameterError(f'metrics: the history has another column {name}; rename it')
    needed = {name for item in objectives for name in item.expression.names}
    needed |= {name for item in constraints for name in item.names}
    others = [METRICS[name] for name in METRICS if name in needed and name not in short]
    return objectives, constraints, (*own, *others)

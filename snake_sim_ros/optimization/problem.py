# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What an optimization is: a scene, bounds of values, objectives, constraints; and as a file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from pathlib import Path
from typing import Any

import numpy as np

from snake_sim_ros.optimization.expressions import (
    Constraint,
    constraint_of,
    Expression,
    expression_of,
)
from snake_sim_ros.optimization.robust import Robust, robust_of
from snake_sim_ros.scene.checked_records import (
    CheckedRecord,
    flat_fields,
    from_mapping,
    ParameterError,
    quantity,
    quoted,
)
from snake_sim_ros.scene.parameters import Array, Scene, with_settings
from snake_sim_ros.studies.keys import physics_version
from snake_sim_ros.studies.metrics import Metric, METRICS, metrics_of, USUAL_METRICS
from snake_sim_ros.studies.runs import Plan
from snake_sim_ros.studies.study_file import loaded, mapping_at, scene_and_values, settings_of
from snake_sim_ros.studies.variations import check_names, Range

GOALS = {'maximize': -1.0, 'minimize': 1.0}  # and the sign with which a value is a loss
# Of the history, besides values and metrics.
COLUMNS = (
    *('row', 'search', 'generation', 'objective', 'objective_1', 'objective_2', 'excess'),
    *('feasible', 'best', 'status', 'failure', 'seconds'),
)
PARTS = (
    *('scene', 'set', 'vary', 'follow', *GOALS, 'objectives', 'constraints', 'metrics'),
    *('robust', 'stop', 'check'),
)


@dataclass(frozen=True, kw_only=True)
class Settings(CheckedRecord):
    """The values of an optimization that are one number."""

    seed: int = quantity(0, '1', 'seed of what is drawn', minimum=0)
    starts: int = quantity(1, '1', 'searches from different places', minimum=1, maximum=1000)
    population: int = quantity(
        0, '1', 'samples of a generation; 0: the usual number of CMA-ES', minimum=0, maximum=10**5
    )
    weights: int = quantity(5, '1', 'searches along a front', minimum=2, maximum=1000)
    rate: float = quantity(20.0, 'Hz', 'samples a second of which metrics are taken', above=0)

    def __post_init__(self) -> None:
        """Check every field, and that a generation has an order."""
        super().__post_init__()
        if self.population == 1:
            raise ParameterError('population must be at least 2, or 0 for the usual, got 1')


@dataclass(frozen=True, kw_only=True)
class Stop(CheckedRecord):
    """When an optimization stops, whatever comes first."""

    evaluations: int = quantity(200, '1', 'number of evaluations', minimum=1, maximum=10**7)
    tolerance: float = quantity(
        1e-4, '1', 'a search ends when its samples differ by less, as a share of the bounds',
        minimum=0, maximum=1,
    )  # fmt: skip
    stagnation: int = quantity(
        0, '1', 'a search ends after so many evaluations without a better one; 0: never', minimum=0
    )
    seconds: float = quantity(0.0, 's', 'wall time after which no generation begins; 0: any',
                              minimum=0)  # fmt: skip


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
    constraints : tuple of Constraint
    metrics : tuple of Metric
    robust : Robust
    stop : Stop
    check : dict
        Values of the scene in which the result is checked; empty for no check.
    settings : Settings

    """

    scene: Scene
    given: frozenset[str]
    bounds: Mapping[str, Range]
    follow: Mapping[str, Expression]
    objectives: tuple[Objective, ...]
    constraints: tuple[Constraint, ...]
    metrics: tuple[Metric, ...]
    robust: Robust
    stop: Stop
    check: Mapping[str, Any]
    settings: Settings

    def plan(self) -> Plan:
        """Return what all runs have in common."""
        return Plan(
            self.scene, self.given, self.metrics, self.settings.rate, None, physics_version()
        )

    def check_plan(self) -> Plan:
        """Return what the runs of the check have in common, with steps as they are given."""
        settings = {'accuracy': 0.0, **self.check}
        scene, given = with_settings(self.scene, settings), self.given | settings.keys()
        return Plan(scene, given, self.metrics, self.settings.rate, None, physics_version())

    def values_at(self, shares: Array) -> dict[str, float]:
        """Return the values at shares of the bounds, and those that follow from them."""
        pairs = zip(self.bounds.items(), shares.tolist(), strict=True)
        return self.with_followers({name: bound.at(share) for (name, bound), share in pairs})

    def with_followers(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return values, and those that follow from them."""
        return {**values, **{name: item.value(values) for name, item in self.follow.items()}}

    def present(self) -> tuple[Array, dict[str, float]]:
        """Return where the scene itself is: shares of the bounds, and values within them."""
        flat, shares, values = flat_fields(self.scene), [], {}
        for name, bound in self.bounds.items():
            value = flat[name.removesuffix('_deg')][0]
            if name.endswith('_deg'):
                value = math.degrees(value)
            values[name] = min(max(value, bound.low), bound.high)
            shares.append(_share(bound, values[name]))
        return np.array(shares), self.with_followers(values)

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
    settings = settings_of(Settings, mapping, PARTS)
    stop: Stop = from_mapping(Stop, mapping.get('stop'), 'stop')
    scene, fixed, vary = scene_and_values(mapping, folder)
    bounds = {name: _bound(name, given, scene) for name, given in vary.items()}
    follow = _followers(mapping_at(mapping, 'follow'), bounds, fixed, scene)
    objectives, constraints, metrics = _goals(mapping, folder)
    given = frozenset([*fixed, *bounds, *follow])
    check = mapping_at(mapping, 'check')
    check_names(scene, [*check, *(name for name in given if name not in check)], 'check')
    for name in check:
        if name in {*bounds, *follow}:
            raise ParameterError(f'check: {name} must not vary')
    try:
        with_settings(scene, check)
    except ParameterError as error:
        raise ParameterError(f'check: {error}') from None
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
    value = flat_fields(scene)[name.removesuffix('_deg')][0]
    if not isinstance(value, float):
        raise ParameterError(
            f'vary: {name} is {quoted(value)} in the scene; only numbers with a fraction have '
            f'bounds'
        )
    for end in (bound.low, bound.high):
        try:
            with_settings(scene, {name: end})
        except ParameterError as error:
            raise ParameterError(f'vary: {error}') from None
    return bound


def _followers(
    given: Mapping[str, Any], bounds: Mapping[str, Range], fixed: Mapping[str, Any], scene: Scene
) -> dict[str, Expression]:
    """Return the values that follow from others."""
    check_names(scene, list(given), 'follow')
    taken = {name.removesuffix('_deg') for name in (*bounds, *fixed)}
    for name in given:
        if name.removesuffix('_deg') in taken:
            raise ParameterError(f'follow: {name} must not be in set or in vary as well')
    return {name: expression_of(text, bounds, f'follow: {name}') for name, text in given.items()}


def _goals(
    mapping: Mapping[str, Any], folder: Path | None
) -> tuple[tuple[Objective, ...], tuple[Constraint, ...], tuple[Metric, ...]]:
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

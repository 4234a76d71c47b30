# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Objectives that hold for more than one scene: values that differ by given factors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import itertools
import math
from typing import Any

from snake_sim_ros.scene.checked_records import flat_fields, nearest, ParameterError, quoted
from snake_sim_ros.scene.parameters import Scene, with_settings

MEASURES = ('worst', 'mean')
EXAMPLE = '{over: {friction: 0.3}, measure: worst}'
MOST = 1000  # scenes for one evaluation


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
        found, flat = dict(values), flat_fields(with_settings(scene, values))
        for name, factor in factors.items():
            key = keys.get(name, name)
            found[key] = _scaled(values[key] if key in values else flat[name][0], factor)
        return found


def _scaled(value: Any, factor: float) -> Any:
    if isinstance(value, tuple):
        return tuple(_scaled(entry, factor) for entry in value)
    return value * factor


def robust_of(given: Any, scene: Scene) -> Robust:
    """
    Return what `robust` of a file says, as in EXAMPLE.

    Raises
    ------
    ParameterError
        If it is something else.

    """
    if given is None:
        return Robust()
    if not isinstance(given, Mapping) or not isinstance(given.get('over'), Mapping):
        raise ParameterError(f'robust must be like {EXAMPLE}, got {quoted(given)}')
    for key in given:
        if key not in ('over', 'measure'):
            raise ParameterError(f'robust: unknown key {quoted(key)}; must be like {EXAMPLE}')
    measure = given.get('measure', 'worst')
    if measure not in MEASURES:
        raise ParameterError(f'robust: measure must be worst or mean, got {quoted(measure)}')
    if not given['over']:
        raise ParameterError(f'robust: over must name a value, such as {EXAMPLE}')
    groups = [_group(name, factors, scene) for name, factors in given['over'].items()]
    scenes = []
    for parts in itertools.product(*groups):
        names = [name for part in parts for name in part]
        for name in names:
            if names.count(name) > 1:
                raise ParameterError(f'robust: over: {name} is given twice')
        scenes.append({name: factor for part in parts for name, factor in part.items()})
    if len(scenes) > MOST:
        raise ParameterError(f'robust: over must make at most {MOST} scenes, got {len(scenes)}')
    return Robust(measure, tuple(scenes))


def _group(name: Any, given: Any, scene: Scene) -> list[dict[str, float]]:
    """Return the factors of a value, or of all values in a part of the scene such as friction."""
    flat = flat_fields(scene)
    plain = str(name).removesuffix('_deg')
    inside = [plain] if plain in flat else [key for key in flat if key.startswith(f'{plain}.')]
    inside = [key for key in inside if key == plain or flat[key][0] is not None]
    if not inside:
        raise ParameterError(f'robust: over: unknown name {quoted(name)}; {nearest(plain, flat)}')
    for key in inside:
        if not _is_number(flat[key][0]):
            raise ParameterError(
                f'robust: over: {key} is {flat[key][0]!r}, which no factor changes; name a number '
                f'of the scene such as friction.longitudinal'
            )
    if not any(_leaves(flat[key][0]) for key in inside):
        raise ParameterError(f'robust: over: {name} is 0 in the scene, which no factor changes')
    return [dict.fromkeys(inside, factor) for factor in _factors(name, given)]


def _is_number(value: Any) -> bool:
    if isinstance(value, tuple):
        return bool(value) and all(map(_is_number, value))
    return isinstance(value, float)


def _leaves(value: Any) -> bool:
    """Return whether a number, or one of several, is not 0."""
    return any(value) if isinstance(value, tuple) else bool(value)


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

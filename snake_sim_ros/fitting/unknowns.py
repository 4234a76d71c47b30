# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The values of a scene that a fit finds: their names, bounds and scales."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

from snake_sim_ros.scene.checked_records import flat_fields, nearest, ParameterError, quoted
from snake_sim_ros.scene.parameters import Array, Scene, with_settings

ROOMS = ('robot.', 'friction.', 'pegs.', 'self_contact_friction')  # whose numbers are physics
FIXED = ('robot.link_count', 'robot.joint_limit', 'robot.joint_rate_limit')
FARTHEST = math.log(1e3)  # a positive value changes at most by this factor
STEP = 0.02  # of differences: a share of a positive value


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

    def coordinate(self, value: float) -> float:
        """Return the coordinate of a value, its logarithm if it is positive."""
        return math.log(value) if self.is_positive else value

    def value(self, coordinate: float) -> float:
        """Return the value of a coordinate."""
        found = math.exp(coordinate) if self.is_positive else coordinate
        return min(max(found, self.low), self.high)


def unknowns_of(scene: Scene, free: Sequence[str]) -> tuple[Unknown, ...]:
    """
    Return the unknowns of a fit.

    Parameters
    ----------
    scene : Scene
        With the values to start from.
    free : sequence of str
        Dotted names; names with ``=`` between them have one value.

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
            _check(name, scene)
        start, limits = known[names[0]]
        above = limits['above'] + 1e-12 if limits['above'] >= 0.0 else -math.inf
        low = max(limits['minimum'], above)
        found.append(Unknown(
            names, float(start), float(low), float(limits['maximum']), limits['unit'],
            is_positive=low >= 0.0 and start > 0.0,
        ))  # fmt: skip
    if not found:
        raise ParameterError('--free must name at least one value, such as friction.transversal')
    return tuple(found)


def _check(name: str, scene: Scene) -> None:
    """Raise if a name is not one of a number that a fit can find."""
    known = flat_fields(scene)
    usable = [
        each for each, (value, _) in known.items()
        if each.startswith(ROOMS) and each not in FIXED
        and isinstance(value, float) and not isinstance(value, bool)
    ]  # fmt: skip
    if name in usable:
        return
    if name not in known:
        raise ParameterError(f'--free: unknown name {quoted(name)}; {nearest(name, known)}')
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
        f'--free {name}: a fit finds numbers of the robot and of friction, this one is chosen; '
        f'choose from: {", ".join(usable)}'
    )


def scene_at(scene: Scene, unknowns: Sequence[Unknown], x: Array) -> Scene:
    """Return the scene with the values of coordinates."""
    settings = {
        name: unknown.value(float(place))
        for unknown, place in zip(unknowns, x, strict=True)
        for name in unknown.names
    }
    return with_settings(scene, settings)


def step_of(unknown: Unknown) -> float:
    """Return the step of a coordinate for differences."""
    return STEP if unknown.is_positive else STEP * max(abs(unknown.start), 0.05)

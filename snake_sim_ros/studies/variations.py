# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The design of a study: what varies, and the values of every row.

The values of a row depend on the seed of the study and on the number of the row alone: more rows
leave those before as they are. Only a Latin hypercube depends on the number of rows, since it
divides the ranges into as many parts.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
import math
from typing import Any

import numpy as np
from scipy.special import ndtri

from snake_sim_ros.scene.checked_records import (
    CheckedRecord,
    from_mapping,
    nearest,
    ParameterError,
    quantity,
    quoted,
)
from snake_sim_ros.scene.parameters import Array, named_values, Scene

SCALES = ('linear', 'log')
COMBINED = ('grid', 'list')  # samplings of listed values; the others draw from ranges
SAMPLINGS = (*COMBINED, 'random', 'sobol', 'latin_hypercube')
LEAST_SHARE = 2.0**-53  # a normal distribution has no values at 0 and 1
EXAMPLE = '[0.1, 0.2] or {low: 0.1, high: 0.3, count: 5} or {mean: 0.2, deviation: 0.05}'


@dataclass(frozen=True)
class Listed:
    """Values that are listed one by one; of equal shares if they are drawn."""

    values: tuple[Any, ...]

    def at(self, share: float) -> Any:
        """Return the value at a share of the distribution, from 0 to 1."""
        return self.values[min(int(share * len(self.values)), len(self.values) - 1)]


@dataclass(frozen=True, kw_only=True)
class Range(CheckedRecord):
    """A range of numbers, with equal steps or equal ratios."""

    low: float = quantity(0.0, '', 'lowest value')
    high: float = quantity(1.0, '', 'highest value')
    count: int = quantity(0, '1', 'number of values in a grid or a list', minimum=0)
    scale: str = quantity('linear', '', 'equal steps or equal ratios', choices=SCALES)

    def __post_init__(self) -> None:
        """Check every field, and that the range has a length and, if it must, a logarithm."""
        super().__post_init__()
        if not self.low < self.high:
            raise ParameterError(f'high must be above low, {self.low:g}, got {self.high:g}')
        if self.scale == 'log' and not self.low > 0.0:
            raise ParameterError(f'low must be above 0 for the scale log, got {self.low:g}')

    @property
    def values(self) -> tuple[float, ...]:
        """The values of a grid or a list, both ends included."""
        space = np.geomspace if self.scale == 'log' else np.linspace
        return tuple(space(self.low, self.high, self.count).tolist())

    def at(self, share: float) -> float:
        """Return the value at a share of the distribution, from 0 to 1."""
        if self.scale == 'log':
            value = math.exp((1 - share) * math.log(self.low) + share * math.log(self.high))
        else:
            value = (1 - share) * self.low + share * self.high
        return min(max(value, self.low), self.high)


@dataclass(frozen=True, kw_only=True)
class Normal(CheckedRecord):
    """A normal distribution."""

    mean: float = quantity(0.0, '', 'mean')
    deviation: float = quantity(1.0, '', 'standard deviation', above=0)

    def at(self, share: float) -> float:
        """Return the value at a share of the distribution, from 0 to 1."""
        share = min(max(share, LEAST_SHARE), 1.0 - LEAST_SHARE)
        return self.mean + self.deviation * float(ndtri(share))


Variation = Listed | Range | Normal


@dataclass(frozen=True)
class Variations:
    """
    All values that vary, and how they are combined into rows.

    Attributes
    ----------
    of : dict
        Dotted name of a value -> how it varies.
    sampling : str
        One of SAMPLINGS.
    samples : int
        Number of rows that are drawn; 0 for a grid and a list.
    seed : int
    shares : ndarray, shape (samples, variations)
        Of the distributions, if they are not drawn row by row.

    """

    of: Mapping[str, Variation]
    sampling: str = 'grid'
    samples: int = 0
    seed: int = 0
    shares: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check that the values can be combined, and draw what is not drawn row by row."""
        combined = self.sampling in COMBINED
        for name, variation in self.of.items():
            if combined and isinstance(variation, Normal):
                drawn = ', '.join(SAMPLINGS[2:])
                raise ParameterError(
                    f'vary: {name} is a distribution, which needs sampling {drawn}; '
                    f'got {self.sampling}'
                )
            if combined and not variation.values:  # type: ignore[union-attr]
                raise ParameterError(
                    f'vary: {name} needs a count of values for sampling {self.sampling}, such as '
                    f'count: 5'
                )
        if combined and self.samples:
            raise ParameterError(
                f'samples is for {", ".join(SAMPLINGS[2:])}; a {self.sampling} has the rows of '
                f'its values, got samples {self.samples}'
            )
        if not combined and not self.samples:
            raise ParameterError(f'samples must be given for sampling {self.sampling}')
        if self.sampling == 'list' and len(set(self._counts)) > 1:
            counts = ', '.join(map(str, self._counts))
            raise ParameterError(f'vary: a list needs values of one length, got {counts} values')
        object.__setattr__(self, 'shares', self._drawn())

    @property
    def _counts(self) -> list[int]:
        return [len(variation.values) for variation in self.of.values()]  # type: ignore[union-attr]

    def _drawn(self) -> Array:
        """Return the shares of all rows for the designs that belong together."""
        if self.sampling not in ('sobol', 'latin_hypercube'):
            return np.zeros((0, 0))
        # It takes a while to import, and other studies do without.
        from scipy.stats import qmc

        seed = np.random.default_rng(self.seed)
        if self.sampling == 'latin_hypercube':
            return np.asarray(qmc.LatinHypercube(len(self.of), seed=seed).random(self.samples))
        # The sequence is balanced for powers of two; more rows of it extend those before.
        power = max(self.samples - 1, 0).bit_length()
        return np.asarray(qmc.Sobol(len(self.of), seed=seed).random_base2(power)[: self.samples])

    def __len__(self) -> int:
        """Return the number of rows."""
        if self.sampling == 'grid':
            return math.prod(self._counts)
        return self._counts[0] if self.sampling == 'list' else self.samples

    def row(self, number: int) -> dict[str, Any]:
        """Return the values of a row, counted from 0, by their names."""
        variations = self.of.values()
        if self.sampling in COMBINED:
            if self.sampling == 'grid':  # the last value varies fastest
                places: Sequence[Any] = np.unravel_index(number, self._counts)
            else:
                places = [number] * len(self.of)
            found = [v.values[int(k)] for v, k in zip(variations, places, strict=True)]  # type: ignore[union-attr]
        else:
            shares = self.shares[number] if len(self.shares) else self._shares_of(number)
            found = [v.at(s) for v, s in zip(variations, shares.tolist(), strict=True)]
        return dict(zip(self.of, found, strict=True))

    def _shares_of(self, number: int) -> Array:
        return np.random.default_rng([self.seed, number]).random(len(self.of))


def variation_of(name: str, given: Any) -> Variation:
    """
    Return how a value varies.

    Parameters
    ----------
    name : str
        For messages.
    given : list or mapping
        As in EXAMPLE.

    Raises
    ------
    ParameterError
        If it is something else.

    """
    if isinstance(given, (list, tuple, np.ndarray)):
        values = given.tolist() if isinstance(given, np.ndarray) else given
        if not values:
            raise ParameterError(f'vary: {name} must have values, got an empty list')
        for value in values:
            _check_value(name, value)
        return Listed(tuple(map(_hashable, values)))
    if isinstance(given, Mapping):
        kind: type = Normal if {'mean', 'deviation'} & given.keys() else Range
        needed = ('mean', 'deviation') if kind is Normal else ('low', 'high')
        for key in needed:
            if key not in given and set(given) <= {item.name for item in fields(kind)}:
                raise ParameterError(f'vary: {name} has no {key}; it is {EXAMPLE}')
        variation: Variation = from_mapping(kind, given, f'vary: {name}')
        return variation
    raise ParameterError(
        f'vary: {name} must be like {EXAMPLE}, got {quoted(given)}; what does not vary belongs '
        f'to set'
    )


def _check_value(name: str, value: Any) -> None:
    """Raise an error if a listed value is nothing that a scene may have."""
    if isinstance(value, (list, tuple)):
        for entry in value:
            _check_value(name, entry)
    elif isinstance(value, float) and not math.isfinite(value):
        raise ParameterError(f'vary: {name} must be finite, got {value}')
    elif not isinstance(value, (int, float, str, np.number)):
        raise ParameterError(f'vary: {name} must have numbers or texts, got {quoted(value)}')


def is_number(value: Any) -> bool:
    """Return whether a listed value is a number."""
    return isinstance(value, (int, float, np.number)) and not isinstance(value, bool)


def _hashable(value: Any) -> Any:
    return tuple(map(_hashable, value)) if isinstance(value, (list, tuple)) else value


def check_names(scene: Scene, names: Sequence[str], where: str) -> None:
    """
    Check that names are those of values of a scene, and that no value is named twice.

    Raises
    ------
    ParameterError
        If not; the message suggests the nearest name.

    """
    known = named_values(scene)
    found: set[str] = set()
    for name in names:
        plain = name.removesuffix('_deg') if isinstance(name, str) else name
        if plain not in known:
            raise ParameterError(f'{where}: unknown name {quoted(name)}; {nearest(plain, known)}')
        if plain != name and not known[plain][1]['unit'].startswith('rad'):
            raise ParameterError(f'{where}: {name}: {plain} is not an angle')
        if plain in found:
            raise ParameterError(f'{where}: {plain} is given twice')
        found.add(plain)

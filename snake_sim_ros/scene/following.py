# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""How a robot follows a path, and the path: a record of a scene; see `controllers.following`."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from snake_sim_ros.scene.checked_records import CheckedRecord, ParameterError, quantity

Numbers = tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Following(CheckedRecord):
    """
    A path, and how it is followed; the gains are for robots of 1 to 3 m.

    The path is a spline through some points, straight between two, or a circle. A robot without a
    path moves with its gait as it is.
    """

    points: tuple[Numbers, ...] = quantity(
        (), 'm', 'points of the path, each x and y; two are a line, more a cubic spline'
    )
    closed: bool = quantity(False, '', 'whether the path goes on from its last point to the first')
    center: Numbers = quantity((), 'm', 'x and y of the center of a circle, in place of points')
    radius: float = quantity(1.5, 'm', 'radius of the circle; below 0 it is followed clockwise')
    speed: float = quantity(
        0.0, 'm/s', 'speed along the path; 0 = that of the gait as it is', minimum=0
    )
    lookahead: float = quantity(0.5, 'm', 'lookahead distance Delta', above=0)
    integral_gain: float = quantity(
        0.02, '1', 'gain sigma of the integral of the cross-track error (0 = none)', minimum=0
    )
    heading_gain: float = quantity(
        2.0, '1/m', 'gain k: an error of the heading decays over the distance 1/k', above=0
    )
    heading_filter: float = quantity(
        0.0, 'rad/s', 'natural frequency of the reference filter of the course (0 = none)',
        minimum=0,
    )  # fmt: skip
    period: float = quantity(0.1, 's', 'time from one correction to the next', above=0, maximum=10)

    def __post_init__(self) -> None:
        """Check every field, and that the path is one."""
        super().__post_init__()
        if self.points and self.center:
            raise ParameterError('a path has points or a center, got both')
        if self.center and len(self.center) != 2:
            raise ParameterError(f'center must have 2 components, got {len(self.center)}')
        if self.radius == 0.0:
            raise ParameterError('radius of a circle must not be 0 m')
        if self.points:
            points_of('points', self.points)

    def __bool__(self) -> bool:
        """Return whether there is a path."""
        return bool(self.points or self.center)


def points_of(what: str, given: Any) -> np.ndarray[Any, Any]:
    """
    Return points of a user as an array (k, 2).

    Raises
    ------
    ParameterError
        If they are not two or more, each finite and apart from the one before.

    """
    try:
        found = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        found = np.zeros(0)
    if found.ndim != 2 or found.shape[1] != 2 or len(found) < 2:
        raise ParameterError(
            f'{what} of a path must be two or more, each x and y, got {_shape(given, found)}'
        )
    if not np.isfinite(found).all():
        k = int(np.argmin(np.isfinite(found).all(axis=1)))
        raise ParameterError(f'{what} of a path must be finite, got {found[k].tolist()}')
    steps = np.hypot(*np.diff(found, axis=0).T)
    if not steps.all():
        k = int(steps.argmin())
        raise ParameterError(
            f'{what} of a path must be apart from each other, got {found[k].tolist()} twice'
        )
    return found


def _shape(given: Any, found: np.ndarray[Any, Any]) -> str:
    lengths = {len(each) for each in given if hasattr(each, '__len__')} if given else set()
    return f'{len(given)} of {sorted(lengths)} numbers' if lengths else f'shape {found.shape}'

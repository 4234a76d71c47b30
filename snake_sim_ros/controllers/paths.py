# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Paths on the floor, by arc length: lines, circles, splines, and points from anywhere.

A path is kept as short straight pieces, with the direction interpolated between their ends. Pieces
of a curve with radius r are at most ``sqrt(8 r SAG)`` long, so that it is met within SAG.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.following import Following, points_of
from snake_sim_ros.scene.parameters import Array

SAG = 1e-5  # how far pieces may be off the curve [m]
PIECES = 4000  # of a spline; a path of 40 m has pieces of 1 cm
SEARCH = 0.5  # how far along the path from the last place the next one is looked for [m]


class Place(NamedTuple):
    """A place on a path, and how far a point is off it; of several paths, arrays."""

    arc: Any  # arc length from the begin of the path; below 0 or beyond its length outside [m]
    cross_track: Any  # cross-track error, positive if the point is to the left [m]
    direction: Any  # of the path, counterclockwise from the x axis [rad]
    curvature: Any  # positive to the left [1/m]


class Pieces(NamedTuple):
    """The straight pieces of a path or, with the same number of pieces, of several paths."""

    begin: Array  # (..., k-1, 2) [m, frame I]
    way: Array  # (..., k-1, 2) from there to the end [m]
    length: Array  # (..., k-1) [m]
    arc: Array  # (..., k) arc lengths of the begins, and of the end of the path [m]
    direction: Array  # (..., k) there, as in `PlanarPath` [rad]

    def nearest(self, point: Array, arc: Array | None = None, closed: bool = False) -> Place:
        """Return the places nearest to points (..., 2), as `PlanarPath.nearest` does."""
        from_begin, total = point[..., None, :] - self.begin, self.arc[..., -1]
        share = (from_begin * self.way).sum(axis=-1) / self.length**2
        held = np.clip(share, 0.0, 1.0)
        apart = from_begin - held[..., None] * self.way
        off = np.hypot(apart[..., 0], apart[..., 1])
        if arc is not None:
            away = self.arc[..., :-1] + held * self.length - arc[..., None]
            if closed:
                away -= total[..., None] * np.round(away / total[..., None])
            else:
                away -= (np.minimum(np.maximum(arc, 0.0), total) - arc)[..., None]
            off = np.where(np.abs(away) > SEARCH + self.length, math.inf, off)
        k = off.argmin(axis=-1)
        rows = np.indices(k.shape, sparse=True)
        here, end = (*rows, k), (*rows, k + 1)
        s, length, way, at = held[here], self.length[here], self.way[here], from_begin[here]
        bend = self.direction[end] - self.direction[here]
        direction, curvature = self.direction[here] + s * bend, bend / length
        side = way[..., 0] * at[..., 1] - way[..., 1] * at[..., 0]
        cross = np.copysign(off[here], side)
        if not closed:
            # On the straight continuation beyond an end.
            last = off.shape[-1] - 1
            share = share[here]
            is_beyond = ((k == 0) & (share < 0.0)) | ((k == last) & (share > 1.0))
            s, curvature = np.where(is_beyond, share, s), np.where(is_beyond, 0.0, curvature)
            cross = np.where(is_beyond, side / length, cross)
        return Place(self.arc[here] + s * length, cross, direction, curvature)

    def part(self, first: int, last: int) -> 'Pieces':
        """Return the pieces of a path with numbers from `first` up to `last`, without that."""
        ends = slice(first, last + 1)
        begin, way, length = (array[first:last] for array in self[:3])
        return Pieces(begin, way, length, self.arc[ends], self.direction[ends])

    def ahead(self, arc: Array) -> Array:
        """Return the directions at arc lengths (...) of open paths, (...) [rad]."""
        inside = np.clip(arc, 0.0, self.arc[..., -1])
        k = np.minimum((self.arc <= inside[..., None]).sum(axis=-1), self.arc.shape[-1] - 1) - 1
        rows = np.indices(k.shape, sparse=True)
        here, end = (*rows, k), (*rows, k + 1)
        share = (inside - self.arc[here]) / self.length[here]
        begin = self.direction[here]
        return np.asarray(begin + share * (self.direction[end] - begin))


@dataclass(frozen=True, eq=False)
class PlanarPath:
    """
    A path on the floor; an open one goes on straight beyond its ends.

    Attributes
    ----------
    points : ndarray, shape (k, 2)
        [m, frame I]
    direction : ndarray, shape (k,)
        Of the path at the points, without jumps of 2 pi [rad].
    closed : bool
        Whether the last point is the first one again.

    """

    points: Array
    direction: Array
    closed: bool = False

    @cached_property
    def arc(self) -> Array:
        """Arc lengths of the points, (k,) [m]."""
        steps = np.hypot(*np.diff(self.points, axis=0).T)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @cached_property
    def pieces(self) -> Pieces:
        """The straight pieces between the points."""
        way, length = np.diff(self.points, axis=0), np.diff(self.arc)
        return Pieces(self.points[:-1], way, length, self.arc, self.direction)

    @cached_property
    def _longest(self) -> float:
        """Length of the longest piece [m]."""
        return float(self.pieces.length.max())

    @classmethod
    def of(cls, following: Following) -> 'PlanarPath':
        """Return the path of a scene."""
        return _path_of(following)

    @classmethod
    def line(cls, begin: ArrayLike, end: ArrayLike) -> 'PlanarPath':
        """Return the straight line from one point to another [m]."""
        points = points_of('ends', [begin, end])
        x, y = points[1] - points[0]
        return cls(points, np.full(2, math.atan2(y, x)))

    @classmethod
    def circle(
        cls, center: ArrayLike, radius: float, begin: float = 0.0, turn: float = 2 * math.pi
    ) -> 'PlanarPath':
        """
        Return an arc about a center [m].

        Parameters
        ----------
        center : array_like, shape (2,)
            [m]
        radius : float
            [m]
        begin : float
            Direction from the center to the first point [rad].
        turn : float
            Angle of the arc, positive counterclockwise [rad]; with 2 pi or more it is a circle
            that is followed forever.

        """
        if not 0.0 < radius < math.inf:
            raise ParameterError(f'radius of a circle must be above 0 m and finite, got {radius}')
        if not 0.0 < abs(turn) < math.inf:
            raise ParameterError(f'turn of a circle must be finite and not 0, got {turn}')
        closed = abs(turn) >= 2 * math.pi
        turn = math.copysign(2 * math.pi, turn) if closed else turn
        count = 1 + math.ceil(abs(turn) * math.sqrt(radius / (8 * SAG)))
        angle = begin + np.linspace(0.0, turn, count)
        around = np.column_stack([np.cos(angle), np.sin(angle)])
        quarter = math.copysign(math.pi / 2, turn)
        return cls(np.asarray(center, dtype=float) + radius * around, angle + quarter, closed)

    @classmethod
    def spline(cls, points: ArrayLike, *, closed: bool = False) -> 'PlanarPath':
        """
        Return the cubic spline through some points, by the length of the chords between them.

        Parameters
        ----------
        points : array_like, shape (k, 2)
            In order, each apart from the one before [m].
        closed : bool, optional
            Whether the path goes on from the last point to the first one.

        """
        from scipy.interpolate import CubicSpline

        given = points_of('points', points)
        if len(given) == 2:
            return cls.line(*given)
        if closed:
            is_there = np.hypot(*(given[-1] - given[0])) < SAG
            given = np.vstack([given[:-1] if is_there else given, given[:1]])
        chord = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(given, axis=0).T))])
        curve = CubicSpline(chord, given, bc_type='periodic' if closed else 'natural')
        places = np.linspace(0.0, chord[-1], PIECES)
        tangent = curve(places, 1)
        direction = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
        return cls(curve(places), direction, closed)

    @property
    def length(self) -> float:
        """Arc length from the first point to the last one [m]."""
        return float(self.arc[-1])

    def track(self, points: Array) -> tuple[Array, Array]:
        """
        Return arc lengths and cross-track errors of a motion, shape (m,) each [m].

        Parameters
        ----------
        points : ndarray, shape (m, 2)
            Places at times in order [m, frame I].

        """
        places, arc = [], None
        for point in points:
            places.append(self.nearest(point, arc))
            arc = places[-1].arc
        arcs, errors = np.array([(place.arc, place.cross_track) for place in places]).T
        return np.unwrap(arcs, period=self.length) if self.closed else arcs, errors

    def nearest(self, point: ArrayLike, arc: float | None = None) -> Place:
        """
        Return the place that is nearest to a point.

        Parameters
        ----------
        point : array_like, shape (2,)
            [m, frame I]
        arc : float, optional
            Arc length of a place before; then the next one is looked for within SEARCH of it, so
            that a path may cross itself. By default, it is looked for everywhere.

        """
        at = None if arc is None else np.asarray(arc, dtype=float)
        pieces, closed = self.pieces, self.closed
        if arc is not None:
            reach = SEARCH + 2.0 * self._longest
            first, last = np.searchsorted(self.arc, (arc - reach, arc + reach))
            if 0 < first < last < len(self.arc):  # inside of the path: its ends do not matter
                pieces, closed = pieces.part(int(first) - 1, int(last)), True
        return Place(*map(float, pieces.nearest(np.asarray(point, dtype=float), at, closed)))


@lru_cache(maxsize=16)
def _path_of(following: Following) -> PlanarPath:
    """Return the path of a scene, which several ask for: its controller, and each metric."""
    if not following.center:
        return PlanarPath.spline(following.points, closed=following.closed)
    turn = math.copysign(2 * math.pi, following.radius)
    return PlanarPath.circle(following.center, abs(following.radius), turn=turn)

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

from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.records import entry
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


@compiled
def place_on(
    begin: Array, way: Array, length: Array, arc: Array, direction: Array, reach: float,
    closed: bool, point: Array, last: float, place: Array,
) -> None:  # fmt: skip
    """
    Fill the `Place` (4,) that is nearest to a point, as `PlanarPath.nearest` does.

    Parameters
    ----------
    begin, way, length, arc, direction : ndarray
        The `Pieces` of a path.
    reach : float
        How far from the last place pieces may begin or end to be looked at [m].
    closed : bool
    point : ndarray, shape (2,)
        [m, frame I]
    last : float
        Arc length of the last place, or NaN [m].
    place : ndarray, shape (4,)
        Filled.

    """
    count = len(length)
    total, first, end, follows = arc[count], 0, count, not math.isnan(last)
    if last - reach > 0.0 and last + reach < total:  # inside of the path
        first = int(np.searchsorted(arc, last - reach)) - 1
        end = int(np.searchsorted(arc, last + reach))
    inside = last if closed else min(max(last, 0.0), total)
    k, nearest, held = 0, math.inf, 0.0
    for i in range(first, end):
        x, y = point[0] - begin[i, 0], point[1] - begin[i, 1]
        s = min(max((x * way[i, 0] + y * way[i, 1]) / length[i] ** 2, 0.0), 1.0)
        away = arc[i] + s * length[i] - inside
        if closed:
            away -= total * np.floor(away / total + 0.5)
        if follows and abs(away) > SEARCH + length[i]:
            continue
        x, y = x - s * way[i, 0], y - s * way[i, 1]
        if x * x + y * y < nearest:
            k, nearest, held = i, x * x + y * y, s
    x, y = point[0] - begin[k, 0], point[1] - begin[k, 1]
    share, side = (x * way[k, 0] + y * way[k, 1]) / length[k] ** 2, way[k, 0] * y - way[k, 1] * x
    bend = direction[k + 1] - direction[k]
    place[2] = direction[k] + held * bend
    if not closed and ((k == 0 and share < 0.0) or (k == count - 1 and share > 1.0)):
        # On the straight continuation beyond an end.
        place[0], place[1], place[3] = arc[k] + share * length[k], side / length[k], 0.0
    else:
        off = math.hypot(x - held * way[k, 0], y - held * way[k, 1])
        place[0], place[1] = arc[k] + held * length[k], math.copysign(off, side)
        place[3] = bend / length[k]


class Pieces(NamedTuple):
    """The straight pieces of a path or, with the same number of pieces, of several paths."""

    begin: Array  # (..., k-1, 2) [m, frame I]
    way: Array  # (..., k-1, 2) from there to the end [m]
    length: Array  # (..., k-1) [m]
    arc: Array  # (..., k) arc lengths of the begins, and of the end of the path [m]
    direction: Array  # (..., k) there, as in `PlanarPath` [rad]

    def nearest(self, point: Array, arc: Array) -> Place:
        """Return the places of open paths (m) nearest to points (m, 2), after others at arcs."""
        places = np.empty((len(point), 4))
        places_on_each(self, np.ascontiguousarray(point), np.ascontiguousarray(arc), places)
        return Place(*places.T)

    def ahead(self, arc: Array) -> Array:
        """Return the directions at arc lengths (...) of open paths, (...) [rad]."""
        inside = np.clip(arc, 0.0, self.arc[..., -1])
        k = np.minimum((self.arc <= inside[..., None]).sum(axis=-1), self.arc.shape[-1] - 1) - 1
        rows = np.indices(k.shape, sparse=True)
        here, end = (*rows, k), (*rows, k + 1)
        share = (inside - self.arc[here]) / self.length[here]
        begin = self.direction[here]
        return np.asarray(begin + share * (self.direction[end] - begin))


@entry
def places_on_each(pieces: Pieces, points: Array, last: Array, places: Array) -> None:
    """Fill the places (m, 4) of open paths for points (m, 2), see `place_on`."""
    for k in range(len(points)):
        place_on(
            pieces.begin[k], pieces.way[k], pieces.length[k], pieces.arc[k], pieces.direction[k],
            math.inf, False, points[k], last[k], places[k],
        )  # fmt: skip


class Course(NamedTuple):
    """A path as compiled functions take it."""

    pieces: Pieces
    reach: float  # see `place_on` [m]
    closed: bool


@compiled
def place_on_course(course: Course, point: Array, last: float, place: Array) -> None:
    """Fill the place (4,) for a point (2,), see `place_on`."""
    pieces = course.pieces
    place_on(
        pieces.begin, pieces.way, pieces.length, pieces.arc, pieces.direction, course.reach,
        course.closed, point, last, place,
    )  # fmt: skip


@entry
def places_along(course: Course, points: Array, last: float, places: Array) -> None:
    """Fill the places (m, 4) for points (m, 2), each after the one before; see `place_on`."""
    for k in range(len(points)):
        place_on_course(course, points[k], last, places[k])
        last = places[k, 0]


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
    def course(self) -> Course:
        """The same for compiled functions."""
        pieces = Pieces(*map(np.ascontiguousarray, self.pieces))
        return Course(pieces, SEARCH + 2.0 * float(pieces.length.max()), self.closed)

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
        places = np.empty((len(points), 4))
        places_along(self.course, np.ascontiguousarray(points, dtype=float), math.nan, places)
        arcs, errors = places[:, 0], places[:, 1]
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
        points, places = np.array([point], dtype=float), np.empty((1, 4))
        places_along(self.course, points, math.nan if arc is None else float(arc), places)
        return Place(*places[0].tolist())


@lru_cache(maxsize=16)
def _path_of(following: Following) -> PlanarPath:
    """Return the path of a scene, which several ask for: its controller, and each metric."""
    if not following.center:
        return PlanarPath.spline(following.points, closed=following.closed)
    turn = math.copysign(2 * math.pi, following.radius)
    return PlanarPath.circle(following.center, abs(following.radius), turn=turn)

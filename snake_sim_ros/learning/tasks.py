# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What a snake is to do in an episode: what it is told of that, and what its progress is worth.

The place of a robot is the mean of its link centers on the floor; it heads from its last link to
its first one, as a `PathFollower` has it. A task is that of several robots, each with an episode
of its own; arrays have a row for each.
"""

from collections.abc import Callable
import math
from typing import NamedTuple, Protocol

import numpy as np

from snake_sim_ros.controllers.paths import PIECES, Pieces, PlanarPath
from snake_sim_ros.scene.parameters import Array

NEAREST, FARTHEST = 0.7, 2.5  # of goals [m]
REACHED = 0.15  # distance at which a goal is reached [m]
BONUS = 1.0  # reward of a goal
TURNS = 0.6  # largest change of direction from one point of a path to the next [rad]
POINTS, APART = 6, 1.0  # of a path, and the way from one to the next [m]
EACH = 31  # of the points of a spline is one of the path: every 4 cm, within 0.2 mm of the curve
LOOKAHEAD = 0.5  # along the path, where the direction to take is looked up [m]


class Motion(NamedTuple):
    """Where robots are and head."""

    place: Array  # (..., 2) [m, frame I]
    heading: Array  # (...) counterclockwise from e_x of I [rad]

    @classmethod
    def of(cls, position: Array) -> 'Motion':
        """Return that of link centers (..., n, 3) [m]."""
        ahead = position[..., 0, :2] - position[..., -1, :2]
        # The sum of a row, unlike that of `sum`, does not depend on how many rows there are.
        place = position[..., :2].cumsum(axis=-2)[..., -1, :] / position.shape[-2]
        return cls(place, np.arctan2(ahead[..., 1], ahead[..., 0]))

    def of_robot(self, row: int) -> 'Motion':
        """Return that of one of several robots."""
        return Motion(self.place[row], self.heading[row])


def directed(angle: Array, *rest: Array) -> Array:
    """Return sine and cosine of angles, and what else a command has, as columns."""
    return np.stack([np.sin(angle), np.cos(angle), *rest], axis=-1)


class Task(Protocol):
    """
    A task of some robots, each with an episode of its own.

    Parameters
    ----------
    count : int
        Number of the robots.

    Attributes
    ----------
    labels : tuple of str
        What each number of `command` is, with its unit.
    bound : ndarray, shape (k,)
        Largest absolute values of the numbers.

    """

    labels: tuple[str, ...]
    bound: Array

    def start(self, row: int, motion: Motion, draws: np.random.Generator) -> None:
        """Begin the episode of one robot, whose motion this is."""
        ...

    def command(self, motion: Motion) -> Array:
        """Return what the agents are told, shape (count, k)."""
        ...

    def progress(self, before: Motion, now: Motion) -> tuple[dict[str, Array], Array]:
        """Return the terms of the rewards in a period by name, and which tasks are done."""
        ...


class Forward:
    """Move along the heading of the start; the term `forward` is the way in this direction [m]."""

    labels: tuple[str, ...] = ('sine of the course', 'cosine of the course')
    bound = np.ones(2)

    def __init__(self, count: int) -> None:
        self.course = np.zeros(count)

    def start(self, row: int, motion: Motion, draws: np.random.Generator) -> None:
        """Take the direction of the start."""
        self.course[row] = motion.heading

    def command(self, motion: Motion) -> Array:
        """Return the direction to take from the heading."""
        return directed(self.course - motion.heading)

    def progress(self, before: Motion, now: Motion) -> tuple[dict[str, Array], Array]:
        """Return the way forward."""
        way = now.place - before.place
        along = way[:, 0] * np.cos(self.course) + way[:, 1] * np.sin(self.course)
        return {'forward': along}, np.zeros(len(along), bool)


class Sideways(Forward):
    """Move to the left of the heading of the start; the rest is as in `Forward`."""

    def start(self, row: int, motion: Motion, draws: np.random.Generator) -> None:
        """Take the direction to the left."""
        self.course[row] = motion.heading + math.pi / 2


class Goal:
    """Reach a goal in any direction; the term `nearer` is the distance that is gained [m]."""

    labels: tuple[str, ...] = ('sine of the bearing', 'cosine of the bearing', 'distance [m]')
    bound = np.array([1.0, 1.0, 10.0])

    def __init__(self, count: int) -> None:
        self.goal = np.zeros((count, 2))

    def start(self, row: int, motion: Motion, draws: np.random.Generator) -> None:
        """Draw a goal, evenly in the area of a ring."""
        distance = math.sqrt(draws.uniform(NEAREST**2, FARTHEST**2))
        angle = draws.uniform(-math.pi, math.pi)
        self.goal[row] = motion.place + distance * np.array([math.cos(angle), math.sin(angle)])

    def command(self, motion: Motion) -> Array:
        """Return where the goals are from the robots, as from their headings."""
        x, y = (self.goal - motion.place).T
        return directed(np.arctan2(y, x) - motion.heading, np.hypot(x, y))

    def progress(self, before: Motion, now: Motion) -> tuple[dict[str, Array], Array]:
        """Return the gained distances, and a bonus where the goal is reached."""
        was, left = (np.hypot(*(self.goal - each.place).T) for each in (before, now))
        return {'nearer': was - left, 'reached': BONUS * (left < REACHED)}, left < REACHED


class Path:
    """
    Follow a winding path that begins along the heading of the start.

    The terms are `covered`, the arc length that is gained [m], and `cross_track`, minus the share
    of it by which the robot is off the path, in lookahead distances.
    """

    labels: tuple[str, ...] = (
        'sine of the direction',
        'cosine of the direction',
        'cross-track error [m]',
    )
    bound = np.array([1.0, 1.0, 5.0])

    def __init__(self, count: int) -> None:
        k = len(range(0, PIECES, EACH))
        begin, way = np.zeros((2, count, k - 1, 2))
        arc, direction = np.zeros((2, count, k))
        self.pieces = Pieces(begin, way, np.ones((count, k - 1)), arc, direction)
        self.arc, self.cross_track = np.zeros((2, count))

    def start(self, row: int, motion: Motion, draws: np.random.Generator) -> None:
        """Draw a path."""
        turns = draws.uniform(-TURNS, TURNS, POINTS - 1)
        course = motion.heading + np.concatenate([[0.0], np.cumsum(turns)])
        steps = APART * np.column_stack([np.cos(course), np.sin(course)])
        points = motion.place + np.cumsum(np.vstack([[0, 0], steps]), axis=0)
        path = PlanarPath.spline(points)
        path = PlanarPath(path.points[::EACH], path.direction[::EACH])
        for array, part in zip(self.pieces, path.pieces, strict=True):
            array[row] = part
        place = path.nearest(motion.place)
        self.arc[row], self.cross_track[row] = place.arc, place.cross_track

    def command(self, motion: Motion) -> Array:
        """Return the directions of the paths ahead from the headings, and cross-track errors."""
        ahead = self.pieces.ahead(self.arc + LOOKAHEAD)
        return directed(ahead - motion.heading, self.cross_track)

    def progress(self, before: Motion, now: Motion) -> tuple[dict[str, Array], Array]:
        """Return the gained arc lengths, and the ends of the paths as done."""
        place = self.pieces.nearest(now.place, self.arc)
        covered = place.arc - self.arc
        self.arc, self.cross_track = place.arc, place.cross_track
        off = np.minimum(np.abs(self.cross_track) / LOOKAHEAD, 1.0)
        terms = {'covered': covered, 'cross_track': -off * np.abs(covered)}
        return terms, self.arc >= self.pieces.arc[:, -1]


TASKS: dict[str, Callable[[int], Task]] = {
    'forward': Forward,
    'sideways': Sideways,
    'goal': Goal,
    'path': Path,
}

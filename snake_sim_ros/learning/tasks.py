# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What a snake is to do in an episode: what it is told of that, and what its progress is worth.

The place of a robot is the mean of its link centers on the floor; it heads from its last link to
its first one, as a `PathFollower` has it.
"""

from collections.abc import Callable
import math
from typing import NamedTuple, Protocol

import numpy as np

from snake_sim_ros.controllers.paths import PlanarPath
from snake_sim_ros.scene.parameters import Array

NEAREST, FARTHEST = 0.7, 2.5  # of goals [m]
REACHED = 0.15  # distance at which a goal is reached [m]
BONUS = 1.0  # reward of a goal
TURNS = 0.6  # largest change of direction from one point of a path to the next [rad]
POINTS, APART = 6, 1.0  # of a path, and the way from one to the next [m]
LOOKAHEAD = 0.5  # along the path, where the direction to take is looked up [m]


class Motion(NamedTuple):
    """Where a robot is and heads."""

    place: Array  # (2,) [m, frame I]
    heading: float  # counterclockwise from e_x of I [rad]

    @classmethod
    def of(cls, position: Array) -> 'Motion':
        """Return that of link centers (n, 3) [m]."""
        ahead = position[0, :2] - position[-1, :2]
        return cls(position[:, :2].mean(axis=0), math.atan2(ahead[1], ahead[0]))


class Task(Protocol):
    """
    A task.

    Attributes
    ----------
    labels : tuple of str
        What each number of `command` is, with its unit.
    bound : ndarray, shape (k,)
        Largest absolute values of the numbers.

    """

    labels: tuple[str, ...]
    bound: Array

    def start(self, motion: Motion, draws: np.random.Generator) -> None:
        """Begin an episode."""
        ...

    def command(self, motion: Motion) -> Array:
        """Return what the agent is told."""
        ...

    def progress(self, before: Motion, now: Motion) -> tuple[dict[str, float], bool]:
        """Return the terms of the reward in a period by name, and whether the task is done."""
        ...


class Forward:
    """Move along the heading of the start; the term `forward` is the way in this direction [m]."""

    labels: tuple[str, ...] = ('sine of the course', 'cosine of the course')
    bound = np.ones(2)

    def start(self, motion: Motion, draws: np.random.Generator) -> None:
        """Take the direction of the start."""
        self.course = motion.heading

    def command(self, motion: Motion) -> Array:
        """Return the direction to take from the heading."""
        off = self.course - motion.heading
        return np.array([math.sin(off), math.cos(off)])

    def progress(self, before: Motion, now: Motion) -> tuple[dict[str, float], bool]:
        """Return the way forward."""
        along = np.array([math.cos(self.course), math.sin(self.course)])
        return {'forward': float((now.place - before.place) @ along)}, False


class Goal:
    """Reach a goal in any direction; the term `nearer` is the distance that is gained [m]."""

    labels: tuple[str, ...] = ('sine of the bearing', 'cosine of the bearing', 'distance [m]')
    bound = np.array([1.0, 1.0, 10.0])

    def start(self, motion: Motion, draws: np.random.Generator) -> None:
        """Draw a goal, evenly in the area of a ring."""
        distance = math.sqrt(draws.uniform(NEAREST**2, FARTHEST**2))
        angle = draws.uniform(-math.pi, math.pi)
        self.goal = motion.place + distance * np.array([math.cos(angle), math.sin(angle)])

    def command(self, motion: Motion) -> Array:
        """Return where the goal is from the robot, as from its heading."""
        way = self.goal - motion.place
        bearing = math.atan2(way[1], way[0]) - motion.heading
        return np.array([math.sin(bearing), math.cos(bearing), math.hypot(*way)])

    def progress(self, before: Motion, now: Motion) -> tuple[dict[str, float], bool]:
        """Return the gained distance, and a bonus when the goal is reached."""
        was, left = (math.hypot(*(self.goal - each.place)) for each in (before, now))
        terms = {'nearer': was - left, 'reached': BONUS * (left < REACHED)}
        return terms, left < REACHED


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

    def start(self, motion: Motion, draws: np.random.Generator) -> None:
        """Draw a path."""
        turns = draws.uniform(-TURNS, TURNS, POINTS - 1)
        course = motion.heading + np.concatenate([[0.0], np.cumsum(turns)])
        steps = APART * np.column_stack([np.cos(course), np.sin(course)])
        self.path = PlanarPath.spline(motion.place + np.cumsum(np.vstack([[0, 0], steps]), axis=0))
        self.at = self.path.nearest(motion.place)

    def command(self, motion: Motion) -> Array:
        """Return the direction of the path ahead from the heading, and the cross-track error."""
        ahead = np.interp(self.at.arc + LOOKAHEAD, self.path.arc, self.path.direction)
        off = float(ahead) - motion.heading
        return np.array([math.sin(off), math.cos(off), self.at.cross_track])

    def progress(self, before: Motion, now: Motion) -> tuple[dict[str, float], bool]:
        """Return the gained arc length, and the end of the path as done."""
        last, self.at = self.at, self.path.nearest(now.place, self.at.arc)
        covered = self.at.arc - last.arc
        off = min(abs(self.at.cross_track) / LOOKAHEAD, 1.0)
        return {'covered': covered, 'cross_track': -off * abs(covered)}, (
            self.at.arc >= self.path.length
        )


TASKS: dict[str, Callable[[], Task]] = {'forward': Forward, 'goal': Goal, 'path': Path}

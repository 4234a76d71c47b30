# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Converged paths of scenes, each computed once, and the distances of courses from them."""

from dataclasses import replace
import math
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from snake_sim_benchmarks.comparison.courses import Course
from snake_sim_ros.scene.parameters import Array, Scene, steps_in
from snake_sim_ros.stepping.simulation import sample, Simulation

# Between two points of a converged path [s]. Courses have samples at times of their own, between
# which a spline goes; where the velocity jumps it is off by some hundredths of a millimeter.
POINT_PERIOD = 0.005


class ConvergedPath(NamedTuple):
    """
    The path of the middle link in a converged solution.

    Attributes
    ----------
    position : callable
        ``position(time)`` returns the center of the link, shape (m, 3) [m].
    way : float
        Distance from the start to the end [m].
    doubt : float
        Largest distance from the path of the run with the smallest steps, over the way.

    """

    position: CubicSpline
    way: float
    doubt: float


class ConvergedPaths:
    """
    The converged paths of scenes, from two runs of `newton` extrapolated to a step of zero.

    Parameters
    ----------
    steps : tuple of float
        Time steps of the two runs, the second half the first [s].

    """

    def __init__(self, steps: tuple[float, float]) -> None:
        self.steps = steps
        self._known: dict[Scene, ConvergedPath] = {}

    def path(self, scene: Scene) -> ConvergedPath:
        """Return the converged path of a scene, whatever its method, level and step."""
        key = replace(scene, method='newton', level='spatial', dt=self.steps[1])
        if key not in self._known:
            coarse, fine = (_path(replace(key, dt=dt)) for dt in self.steps)
            self._known[key] = converged_path(2 * fine - coarse, fine)
        return self._known[key]


def converged_path(points: Array, fine: Array) -> ConvergedPath:
    """Return the path through points (m, 3) every POINT_PERIOD, and its doubt, see above."""
    times = POINT_PERIOD * np.arange(len(points))
    way = float(np.linalg.norm(points[-1] - points[0]))
    doubt = float(np.linalg.norm(points - fine, axis=1).max() / way)
    return ConvergedPath(CubicSpline(times, points), way, doubt)


def _path(scene: Scene) -> Array:
    """Return the points of the middle link in a run, shape (m, 3) [m]."""
    simulation = Simulation(scene)
    steps = steps_in(POINT_PERIOD, scene.dt, 'period of points')
    return sample(simulation, steps, steps_in(scene.duration, POINT_PERIOD, 'duration')).path


def course_error(course: Course, expected: ConvergedPath) -> float:
    """
    Return the largest distance from a converged path at any time, over the way gone.

    It is infinite for a run that ended early.
    """
    if course.failure:
        return math.inf
    apart = np.linalg.norm(course.path - expected.position(course.time), axis=1)
    return float(apart.max() / expected.way)

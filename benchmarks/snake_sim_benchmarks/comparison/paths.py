# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Paths of runs: how far two of them are apart, the course of one compiled call, the converged path.

A course is that of the middle link, with the processor time of the one call that takes all steps
of a run. This is the accounting by which contenders are compared.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
import math
import time
from typing import NamedTuple, Protocol

import numpy as np
from scipy.interpolate import CubicSpline

from snake_sim_ros import Scene, Simulation, State
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import Array, steps_in
from snake_sim_ros.scene.posture import joint_angles
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.simulation import sample
from snake_sim_ros.stepping.state import initial_state
from snake_sim_ros.stepping.trajectory import Trajectory

SAMPLING_PERIOD = 0.1  # s between two samples of runs that are compared

# ---- differences of two runs --------------------------------------------------------------------


class Motion(NamedTuple):
    """
    The part of a run that is compared with other runs.

    Attributes
    ----------
    path : ndarray, shape (m, 3)
        Center of the middle link [m, frame I].
    heading : ndarray, shape (m,)
        Direction of the mean link axis in the plane, without jumps [rad].
    joint_angle : ndarray, shape (m, n-1, 2)
        (yaw, pitch) [rad].

    """

    path: Array
    heading: Array
    joint_angle: Array


def heading(axis: Array) -> Array:
    """Return the direction (m,) of the mean of link axes (m, n, 3) in the plane [rad]."""
    x, y, _ = axis.sum(axis=1).T
    return np.unwrap(np.arctan2(y, x))


def motion(trajectory: Trajectory) -> Motion:
    """Return path, heading and joint angles of a trajectory."""
    angle = joint_angles(trajectory.coordinates)
    return Motion(trajectory.path, heading(trajectory.axis), angle)


def extrapolated(coarse: Trajectory, fine: Trajectory) -> Motion:
    """Return the motion extrapolated to a time step of zero, for first order and steps 2 to 1."""
    angles = [joint_angles(run.coordinates) for run in (fine, coarse)]
    return Motion(
        path=2 * fine.path - coarse.path,
        heading=heading(2 * fine.axis - coarse.axis),
        joint_angle=2 * angles[0] - angles[1],
    )


def path_error(path: Array, expected: Array) -> float:
    """
    Return the largest distance of two paths at any time, over the length of the way gone.

    The way is the distance from the first point of the expected path to the last. The error is
    infinite for paths of different lengths, of which one belongs to a run that ended early.
    """
    if path.shape != expected.shape:
        return math.inf
    way = np.linalg.norm(expected[-1] - expected[0])
    return float(np.linalg.norm(path - expected, axis=-1).max() / way)


def largest_difference(values: Array, expected: Array) -> float:
    """Return the largest absolute difference; infinity for runs of different lengths."""
    if values.shape != expected.shape:
        return math.inf
    return float(np.abs(values - expected).max(initial=0.0))


# ---- courses ------------------------------------------------------------------------------------


CALLS = 2  # timed calls of a run, of which the shortest counts,
LONG_CALL = 0.1  # unless the first one takes so long [s] that disturbances are small


class Start(NamedTuple):
    """A state, and the time of the gait at which a run starts from it [s]."""

    state: State
    time: float


class Course(NamedTuple):
    """
    Where the middle link was in a run.

    Attributes
    ----------
    time : ndarray, shape (m,)
        Time since the start of the run, which is the first one [s].
    path : ndarray, shape (m, 3)
        Center of the middle link [m, frame I].
    seconds : float
        Processor time of one thread for all steps [s].
    unconverged : int
        Steps that did not converge, for methods that report them.
    failure : str
        Why the run ended early; empty if it did not.

    """

    time: Array
    path: Array
    seconds: float
    unconverged: int
    failure: str


class Runner(Protocol):
    """Runs a scene for its duration, from its own start or from another one."""

    def __call__(self, scene: Scene, start: Start | None = None) -> Course: ...  # noqa: D102


def step_count(scene: Scene) -> int:
    """Return the number of whole steps in the duration of a scene."""
    return math.floor(scene.duration / scene.dt * (1.0 + 1e-12) + 1e-9)


def portions(scene: Scene) -> Iterator[tuple[int, int]]:
    """Yield first and last step of portions as long as SAMPLING_PERIOD, or of one step."""
    steps, every = step_count(scene), max(round(SAMPLING_PERIOD / scene.dt), 1)
    for first in range(0, steps, every):
        yield first, min(first + every, steps)


def least_seconds(call: Callable[[], object]) -> float:
    """Return the processor time of this thread in the shortest of a few calls [s]."""
    times = []
    for _ in range(CALLS):
        begin = time.thread_time_ns()
        call()
        times.append(1e-9 * (time.thread_time_ns() - begin))
        if times[0] > LONG_CALL:
            break
    return min(times)


def compiled_course(scene: Scene, start: Start | None = None) -> Course:
    """
    Return the course of a scene by its method.

    All steps are taken twice: in portions, between which the path is read, and in timed calls.
    """
    stepper, middle = make_stepper(scene), scene.robot.middle_link
    state, begin = start or (initial_state(scene), 0.0)
    times = begin + (0.5 + np.arange(step_count(scene))) * scene.dt
    angle, rate = gait.reference(scene.gait, times, scene.robot.link_count - 1)
    history, now = stepper.empty_history(), state
    time, path, unconverged = [0.0], [state.q[middle, :3]], 0
    for first, last in portions(scene):
        now, history, report = stepper.advance(now, history, angle[first:last], rate[first:last])
        unconverged += report.unconverged
        if report.failure:
            found = np.array(time), np.array(path)
            return Course(*found, math.nan, unconverged, report.failure)
        time.append(last * scene.dt)
        path.append(now.q[middle, :3])
    seconds = least_seconds(lambda: stepper.advance(state, stepper.empty_history(), angle, rate))
    return Course(np.array(time), np.array(path), seconds, unconverged, '')


# ---- converged paths ----------------------------------------------------------------------------


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

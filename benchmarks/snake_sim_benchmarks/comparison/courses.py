# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The course of the middle link in one run, with the processor time of a single compiled call.

This is the accounting by which contenders are compared: the time of one thread in the one call
that takes all steps of a run. References are computed before it, and the path is read after it, or
in another run with the same steps. What Python does counts for nobody.
"""

from collections.abc import Callable, Iterator
import math
import time
from typing import NamedTuple, Protocol

import numpy as np

from snake_sim_benchmarks.comparison.timed_run import SAMPLING_PERIOD
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.state import initial_state, State

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
        Steps that did not converge, where a method tells.
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

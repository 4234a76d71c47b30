# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The part `throughput` of the bench: many robots at once, on one thread and on two.

All robots differ in friction and gait. Ours are taken by threads of one process, each robot in one
compiled call, those of MuJoCo by `mujoco.rollout`. What is known before the first step is made
before the clock starts: models, starts, joint references, and memory for the results.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from functools import partial
import math
import time
from typing import Protocol

import numpy as np

from snake_sim_benchmarks.comparison.bench_rows import Entry, Row
from snake_sim_benchmarks.comparison.bench_tables import on_threads, THREADS
from snake_sim_benchmarks.comparison.contenders import LOOSE_TOLERANCE
from snake_sim_benchmarks.comparison.ensembles import family, worst_of_neighbors
from snake_sim_benchmarks.comparison.entrants import Entrant
from snake_sim_benchmarks.comparison.mujoco_model import MujocoSettings, searched_for
from snake_sim_benchmarks.comparison.mujoco_runs import rolled_course, Rollouts
from snake_sim_benchmarks.comparison.paths import compiled_course, ConvergedPaths, step_count
from snake_sim_ros import Scene
from snake_sim_ros.scene import gait
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.state import initial_state

ROBOTS, LEAST_ROBOTS = 1000, 64
QUICK_ROBOTS = 64
WALL = 20.0  # wall time after which a row has no further robots [s]
BATCH_STEPS = 600_000  # of all robots whose references are in memory at a time, some 200 MB
OURS = (('bdf2', (20, 30, 40, 100, 200)), ('newton', (4000,)))  # steps a second
# Settings that hold an error over the neighbors of a scene, and their steps a second over those
# they were found for: the fastest of the part `robust` at 5, 1 and 0.1 %, where there are any.
MUJOCO: Mapping[str, Sequence[tuple[str, float]]] = {
    'lateral_undulation': (('A 3 %', 1.0), ('A 1 %', 1.0)),
    'sidewinding': (('C 5 %', 1.0), ('C 1 %', 1.0)),
    'sinus_lifting': (('D 5 %', 1.0), ('D 1 %', 1.5)),
}


class Robots(Protocol):
    """Robots that are ready to run."""

    def __call__(self) -> None: ...  # noqa: D102

    def close(self) -> None: ...  # noqa: D102


class MakeRobots(Protocol):
    """Makes the robots of some scenes ready to run on a number of threads."""

    def __call__(self, scenes: Sequence[Scene], *, threads: int) -> Robots: ...  # noqa: D102


def throughput(
    scenes: Mapping[str, Scene], paths: ConvergedPaths, *, quick: bool
) -> Iterator[Entry]:
    """Yield an entry for every case, setting and number of steps."""
    robots = QUICK_ROBOTS if quick else ROBOTS
    for case, scene in scenes.items():
        for entrant, rate, ready in [*_ours(), *_mujoco(case)]:
            row = Row(
                part='throughput', case=case, method=entrant.method, dt=1 / rate,
                level=entrant.level, n=scene.robot.link_count,
                duration=scene.duration,
            )  # fmt: skip
            rows = tuple(replace(row, setting=on_threads(entrant.setting, k)) for k in THREADS)
            run = partial(_rows, rows, entrant, scene, ready, paths, robots)
            yield Entry(rows, run, 2 * WALL)


def _ours() -> Iterator[tuple[Entrant, float, MakeRobots]]:
    for method, rates in OURS:
        loose = LOOSE_TOLERANCE if method == 'bdf2' else {}
        setting = 'residual 1e-5 m/s' if loose else 'default'
        settings = {'method': method, **loose}
        entrant = Entrant(method, setting, rates, compiled_course, settings, level='auto')
        for rate in rates:
            yield entrant, rate, OurRobots


def _mujoco(case: str) -> Iterator[tuple[Entrant, float, MakeRobots]]:
    for name, multiple in MUJOCO.get(case, ()):
        settings = MujocoSettings(contact=name)
        rate = multiple * searched_for(case)[name].rate
        course = partial(rolled_course, settings=settings)
        yield Entrant('mujoco', name, (rate,), course), rate, partial(Rollouts, settings=settings)


def _rows(
    rows: Sequence[Row], entrant: Entrant, scene: Scene, ready: MakeRobots, paths: ConvergedPaths,
    robots: int,
) -> list[Row]:  # fmt: skip
    """Return the rows of a setting, one for each number of threads."""
    worst = worst_of_neighbors(entrant, rows[0], scene, paths)
    own = [entrant.scene(each, rows[0].dt) for each in family(scene, robots)]
    with closing(ready(own[:1], threads=1)) as robot:
        robot()  # compiles
    found = []
    for row, threads in zip(rows, THREADS, strict=True):
        count, seconds = _run(own, ready, threads)
        found.append(
            replace(
                row, status=worst.status, message=worst.message, error_path=worst.error_path,
                reference_error=worst.reference_error, trials=count, seconds=seconds,
                seconds_per_second=seconds / (count * step_count(own[0]) * own[0].dt),
            )
        )  # fmt: skip
    return found


def _run(scenes: Sequence[Scene], ready: MakeRobots, threads: int) -> tuple[int, float]:
    """Run robots in batches until WALL is over; return how many, and the wall time [s]."""
    count, seconds = 0, 0.0
    for batch in _batches(scenes, threads):
        if seconds > WALL and count >= LEAST_ROBOTS:
            break
        with closing(ready(batch, threads=threads)) as robots:
            begin = time.perf_counter()
            robots()
            seconds += time.perf_counter() - begin
        count += len(batch)
    return count, seconds


def _batches(scenes: Sequence[Scene], threads: int) -> Iterable[Sequence[Scene]]:
    size = max(8 * threads, math.ceil(BATCH_STEPS / step_count(scenes[0])))
    return (scenes[first : first + size] for first in range(0, len(scenes), size))


class OurRobots:
    """
    Robots whose steps are taken by their methods, each in one call.

    Parameters
    ----------
    scenes : sequence of Scene
    threads : int

    """

    def __init__(self, scenes: Sequence[Scene], *, threads: int) -> None:
        self.calls: list[Callable[[], object]] = []
        for scene in scenes:
            stepper, state = make_stepper(scene), initial_state(scene)
            times = (0.5 + np.arange(step_count(scene))) * scene.dt
            reference = gait.reference(scene.gait, times, scene.robot.link_count - 1)
            call = partial(stepper.advance, state, stepper.empty_history(), *reference)
            self.calls.append(call)
        self.pool = ThreadPoolExecutor(threads)

    def __call__(self) -> None:
        """Run all robots."""
        for done in [self.pool.submit(call) for call in self.calls]:
            done.result()

    def close(self) -> None:
        """End the threads."""
        self.pool.shutdown()

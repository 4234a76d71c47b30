# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How long scenes with worlds take, beside MuJoCo at equal error, for the page on worlds.

The error of a run is the largest distance of the middle link, at any time, from a converged run of
rigid contacts, over the way gone. MuJoCo has the same geometry and enters with its own contacts,
with those found by hand, and with all of its search on a flat floor. Of each side the fastest run
counts whose error is within a bound. The two take turns then, and the least times are compared.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
import math
import sys
from typing import NamedTuple

from snake_sim_benchmarks.comparison.mujoco_model import CONTACT_MODELS, MujocoSettings
from snake_sim_benchmarks.comparison.mujoco_runs import rolled_course
from snake_sim_benchmarks.comparison.paths import (
    compiled_course,
    ConvergedPaths,
    course_error,
    Runner,
)
from snake_sim_ros import load_scene, Scene

WORLDS = {'stairs': 9.0, 'rough': 9.0, 'pole_climb': 5.0}  # and how long they are run [s]
BOUNDS = (0.1, 0.05, 0.02, 0.01)
FINE = 1 / 8000, 1 / 16_000  # steps of the runs that are extrapolated to the converged one [s]
RATES = {'newton': (500, 1000, 2000, 4000), 'bdf2': (50, 100, 200, 400, 1000)}
OF_MUJOCO = (100, 200, 400, 800, 1600, 3200)  # steps a second
TURNS = 5


class Run(NamedTuple):
    """A run of a scene, and how far it is off."""

    name: str
    run: Runner
    scene: Scene
    error: float
    seconds: float  # of processor time


def ours(scene: Scene) -> Iterator[tuple[str, Runner, Scene]]:
    """Yield the runs of this package."""
    for method, rates in RATES.items():
        for rate in rates:
            yield method, compiled_course, replace(scene, method=method, dt=1 / rate)


def mujoco(scene: Scene) -> Iterator[tuple[str, Runner, Scene]]:
    """Yield those of MuJoCo."""
    for name in CONTACT_MODELS:
        run = partial(rolled_course, settings=MujocoSettings(contact=name))
        for rate in OF_MUJOCO:
            yield f'MuJoCo {name}', run, replace(scene, dt=1 / rate)


def compared(name: str, paths: ConvergedPaths) -> Iterator[str]:
    """Yield the rows of a table for a world."""
    scene = replace(load_scene(name), level='spatial', duration=WORLDS[name])
    path = paths.path(scene)
    sides = []
    for contenders in (ours, mujoco):
        runs = []
        for entrant, run, entered in contenders(scene):
            course = run(entered)
            runs.append(Run(entrant, run, entered, course_error(course, path), course.seconds))
        sides.append(runs)
        best = min(runs, key=lambda each: each.error)
        print(f'{name}: least error {best.error:.2g} of {best.name} at {best.scene.dt:g} s')
    print(f'{name}: the converged path is known to {path.doubt:.2g} of {path.way:.2f} m')
    for bound in BOUNDS:
        found = [fastest(runs, bound) for runs in sides]
        times = [math.inf, math.inf]
        for _ in range(TURNS):
            for k, each in enumerate(found):
                if each:
                    times[k] = min(times[k], each.run(each.scene).seconds)
        cells = [cell(each, seconds) for each, seconds in zip(found, times, strict=True)]
        ratio = f'{times[1] / times[0]:.2g}' if all(map(math.isfinite, times)) else ''
        yield f'| `{name}` | {100 * bound:g} % | {cells[0]} | {cells[1]} | {ratio} |'


def fastest(runs: list[Run], bound: float) -> Run | None:
    """Return the fastest run with an error up to a bound."""
    good = [each for each in runs if each.error <= bound]
    return min(good, key=lambda each: each.seconds, default=None)


def cell(run: Run | None, seconds: float) -> str:
    """Return what a table says of a run that took some seconds."""
    if run is None:
        return 'none'
    speed = run.scene.duration / seconds
    return f'{run.name}, 1/{1 / run.scene.dt:.0f} s: {100 * run.error:.2g} %, {speed:.3g}'


def main(names: list[str]) -> None:
    """Print the table of some worlds, or of all."""
    paths = ConvergedPaths(FINE)
    rows = [row for name in names or WORLDS for row in compared(name, paths)]
    print('| world | error at most | this package | MuJoCo | faster by |\n|---|---|---|---|---|')
    print('\n'.join(rows))


if __name__ == '__main__':
    main(sys.argv[1:])

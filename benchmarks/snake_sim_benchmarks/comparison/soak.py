# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Very long runs, which show whether penetration and memory stay bounded.

In `sidewinding` and `lateral_undulation` the robot moves on without end. Among pegs, which it
passes in some seconds, it starts again after every duration of the scene.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
import os
from pathlib import Path
import time
from typing import Any

from snake_sim_ros import Report, Scene, Simulation
from snake_sim_ros.scene.parameters import load_scene, steps_in, with_settings
from snake_sim_ros.stepping.samples import Samples

MARKS = (10**4, 10**5, 10**6, 10**7)  # numbers of steps after which the state of a soak is noted
QUICK_MARKS = (10**3, 10**4, 10**5)
LAST_PERIOD = 1.0  # s before a mark in which `penetration_end` is the largest
SOAKED_SCENES: dict[str, dict[str, Any]] = {  # scene: settings
    'lateral_undulation': {'level': 'spatial'},
    'sidewinding': {},
    'obstacle_aided': {},
}


@dataclass(frozen=True)
class Mark:
    """
    The state of a soak after some steps.

    Memory is the resident memory of the process, None if the system does not provide it.
    """

    steps: int  # number that was asked for; the report has the number that was done
    seconds: float  # wall time of all steps
    report: Report  # of all steps
    penetration_end: float  # largest in the last second, or since a later previous mark [m]
    memory_begin: int | None  # after compiling [B]
    memory_end: int | None  # at the mark [B]


def resident_memory() -> int | None:
    """Return the resident memory of this process [B], or None if the system has no /proc."""
    try:
        pages = Path('/proc/self/statm').read_text(encoding='ascii').split()[1]
    except OSError:
        return None
    return int(pages) * os.sysconf('SC_PAGE_SIZE')


def soaked_scene(name: str) -> Scene:
    """Return one of the scenes of SOAKED_SCENES."""
    return with_settings(load_scene(name), SOAKED_SCENES[name])


class EndlessRun:
    """
    A scene that is run on and on, a second at a time.

    Parameters
    ----------
    scene : Scene
    start : callable, optional
        If given, the robot starts again after every duration of the scene, from the simulation
        that this returns for the number of the round.

    Attributes
    ----------
    simulation : Simulation
        That of this round.
    round : int
        Its number, from 0.
    report, latest : Report
        That of all steps, and of the last call.
    seconds : float
        Wall time of all steps, without that of the joint references.

    """

    def __init__(self, scene: Scene, start: Callable[[int], Simulation] | None = None) -> None:
        self.start, self.round = start, 0
        self.simulation = start(0) if start else Simulation(scene)
        self.second = steps_in(LAST_PERIOD, scene.dt, 'second')
        self.whole = steps_in(scene.duration, scene.dt, 'duration')
        self.report, self.latest, self.seconds = Report(), Report(), 0.0

    def advance(self, most: int, samples: Samples | None = None) -> float:
        """Take the steps of a second, or fewer; return their wall time [s]."""
        steps = min(self.second, most)
        if self.start:
            if self.simulation.step_count == self.whole:
                self.round += 1
                self.simulation = self.start(self.round)
            steps = min(steps, self.whole - self.simulation.step_count)
        reference = self.simulation.gait_reference(steps)
        begin = time.perf_counter()
        self.latest = self.simulation.advance(*reference, samples)
        seconds = time.perf_counter() - begin
        self.seconds += seconds
        self.report += self.latest
        return seconds


def soak(scene: Scene, marks: Sequence[int], *, restarts: bool) -> Iterator[Mark]:
    """
    Run a scene for very many steps, and yield its state at some of them.

    Parameters
    ----------
    scene : Scene
    marks : sequence of int
        Numbers of steps, ascending. The run ends with the last one, or if it diverges.
    restarts : bool
        Whether the robot starts again after every duration of the scene.

    """
    run = EndlessRun(scene, (lambda number: Simulation(scene)) if restarts else None)
    run.simulation.compile()
    memory = resident_memory()
    for mark in marks:
        while run.report.steps < mark and not run.report.failure:
            run.advance(mark - run.report.steps)
        depth = run.latest.penetration_max
        yield Mark(mark, run.seconds, run.report, depth, memory, resident_memory())

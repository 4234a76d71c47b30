"""
Very long runs, which show whether penetration and memory stay bounded.

In `sidewinding` and `lateral_undulation` the robot moves on without end. Among pegs, which it
passes in some seconds, it starts again after every duration of the scene.
"""

from collections.abc import Iterator
from collections.abc import Sequence
from dataclasses import dataclass
import os
from pathlib import Path
import time
from typing import Any

from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.parameters import with_settings
from snake_sim_ros.scene.periods import steps_in
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.simulation import Simulation

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
    simulation = Simulation(scene)
    simulation.compile()
    chunk = steps_in(LAST_PERIOD, scene.dt, 'second')
    whole = steps_in(scene.duration, scene.dt, 'duration')
    total, seconds, latest = Report(), 0.0, Report()
    memory = resident_memory()
    for mark in marks:
        while total.steps < mark and not total.failure:
            if restarts and simulation.step_count == whole:
                simulation = Simulation(scene)
            steps = min(chunk, mark - total.steps)
            if restarts:
                steps = min(steps, whole - simulation.step_count)
            reference = simulation.gait_reference(steps)
            begin = time.perf_counter()
            latest = simulation.advance(*reference)
            seconds += time.perf_counter() - begin
            total += latest
        yield Mark(mark, seconds, total, latest.penetration_max, memory, resident_memory())

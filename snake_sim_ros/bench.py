"""
Time per step, measured inside the compiled loop, and start-up times of new processes.

What the numbers do not show: they are of one scene, one machine and one moment. The processor's
own counter is read between two steps, so nothing but the step is in them, neither references nor
recording.
"""

from dataclasses import dataclass
from dataclasses import replace
import os
import subprocess
import sys
import tempfile
import time

import numpy as np

from snake_sim_ros import gait
from snake_sim_ros.parameters import Scene
from snake_sim_ros.parameters import scene_to_text
from snake_sim_ros.records import ParameterError
from snake_sim_ros.simulation import Simulation
from snake_sim_ros.spatial import SpatialStepper
from snake_sim_ros.stepping import Report

CHUNK = 2000  # steps whose references are made at once


@dataclass(frozen=True)
class Timing:
    """
    Time per step of one scene.

    Attributes
    ----------
    median, p99 : float
        Of single steps [us].
    real_time_factor : float
        Simulated time over the sum of all steps.
    compile_seconds : float
        Of the first call in this process: compiling, or loading what was compiled before.
    report : Report

    """

    median: float
    p99: float
    real_time_factor: float
    compile_seconds: float
    report: Report


def time_steps(scene: Scene) -> Timing:
    """
    Run a scene for its duration and return the time of its steps.

    Raises
    ------
    ParameterError
        If the method of the scene is not a compiled one.

    """
    simulation = Simulation(scene)
    stepper = simulation.stepper
    if not isinstance(stepper, SpatialStepper):
        raise ParameterError(f'method {scene.method!r} is not compiled, its steps are not timed')
    compile_seconds = simulation.compile()
    steps = round(scene.duration / scene.dt)
    seconds, cycles = 0.0, []
    for first in range(0, steps, CHUNK):
        count = min(CHUNK, steps - first)
        angle, rate = gait.reference(
            scene.gait, simulation.midpoints(count), scene.robot.link_count - 1
        )
        begin = time.perf_counter()
        report = simulation.advance(angle, rate)
        seconds += time.perf_counter() - begin
        cycles.append(np.diff(stepper.cycles[: report.steps + 1]))
        if report.failure:
            break
    counts = np.concatenate(cycles)
    microseconds = 1e6 * seconds / counts.sum() * counts
    return Timing(
        median=float(np.median(microseconds)),
        p99=float(np.percentile(microseconds, 99)),
        real_time_factor=simulation.time / seconds,
        compile_seconds=compile_seconds,
        report=simulation.report,
    )


def start_up_seconds(scene: Scene, *, cold: bool) -> float:
    """Return the wall time from starting a new process to its first step done [s]."""
    one_step = replace(scene, duration=scene.dt)
    program = (
        'import sys; from snake_sim_ros.parameters import scene_from_text; '
        'from snake_sim_ros.simulation import run; '
        'scene = scene_from_text(sys.stdin.read()); run(scene, rate=1 / scene.dt)'
    )
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, 'NUMBA_CACHE_DIR': folder} if cold else None
        begin = time.perf_counter()
        subprocess.run(
            [sys.executable, '-c', program],
            input=scene_to_text(one_step),
            env=environment,
            text=True,
            check=True,
        )
        return time.perf_counter() - begin

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
from typing import Any

from llvmlite import ir
from numba.core import cgutils
from numba.core import types
from numba.extending import intrinsic
import numpy as np

from snake_sim_ros import gait
from snake_sim_ros.compilation import compiled
from snake_sim_ros.parameters import Array
from snake_sim_ros.parameters import Scene
from snake_sim_ros.parameters import scene_to_text
from snake_sim_ros.records import ParameterError
from snake_sim_ros.simulation import Simulation
from snake_sim_ros.spatial import REPORT_SIZE
from snake_sim_ros.spatial import SpatialStepper
from snake_sim_ros.spatial import step
from snake_sim_ros.stepping import initial_state
from snake_sim_ros.stepping import no_impulse
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


@intrinsic  # type: ignore[untyped-decorator]
def cycle_counter(typing_context: Any) -> Any:
    """Return the processor's time stamp counter."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(ir.IntType(64), [])
        function = cgutils.get_or_insert_function(builder.module, kind, 'llvm.readcyclecounter')
        return builder.call(function, [])

    return types.int64(), generate


@compiled
def timed_advance(model, work, q, u, impulse, angle, rate, report, cycles):
    """Advance as `spatial.advance` does, and fill cycles (steps,) with the counts of all steps."""
    for k in range(len(angle)):
        begin = cycle_counter()
        if not step(model, work, q, u, impulse, angle[k], rate[k], report):
            break
        cycles[k] = cycle_counter() - begin


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
    state, impulse = initial_state(scene), no_impulse(scene)
    q, u, numbers = state.q, state.u, np.zeros(REPORT_SIZE)
    steps = round(scene.duration / scene.dt)
    cycles = np.zeros(steps, np.int64)

    def advance(first: int, count: int, counts: Array) -> None:
        times = (first + 0.5 + np.arange(count)) * scene.dt
        angle, rate = gait.reference(scene.gait, times, scene.robot.link_count - 1)
        timed_advance(stepper.model, stepper.work, q, u, impulse, angle, rate, numbers, counts)

    compile_seconds = simulation.compile()
    advance(0, 0, cycles[:0])  # compiles the timed loop, which no user waits for
    begin, begin_cycles = time.perf_counter(), _now()
    for first in range(0, steps, CHUNK):
        count = min(CHUNK, steps - first)
        advance(first, count, cycles[first : first + count])
    microseconds = 1e6 * (time.perf_counter() - begin) / (_now() - begin_cycles) * cycles
    return Timing(
        median=float(np.median(microseconds)),
        p99=float(np.percentile(microseconds, 99)),
        real_time_factor=float(1e6 * steps * scene.dt / microseconds.sum()),
        compile_seconds=compile_seconds,
        report=stepper.report(numbers),
    )


@compiled
def _now():
    return cycle_counter()


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

"""
Time per step and error of methods and time steps, and start-up times of new processes.

The error is that of the path of the middle link against a converged solution, the largest distance
at any sample over the distance that the link gets to. The converged solution is of Newton's method
at two small time steps, extrapolated; how far it is from the finer of them says how converged it
is.

What the numbers do not show: they are of one scene, one machine and one moment. The processor's
own counter is read between two steps, so nothing but the step is in the times of steps, neither
references nor recording. On a noisy machine compare ratios: to a calibration loop, a fixed amount
of the same kind of arithmetic, that is timed beside every run.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from dataclasses import replace
import os
import subprocess
import sys
import tempfile
import time
from typing import Any

import numpy as np

from snake_sim_ros import gait
from snake_sim_ros.articulated_body import factor
from snake_sim_ros.compilation import compiled
from snake_sim_ros.compilation import cycle_counter
from snake_sim_ros.levels import what_is_not_planar
from snake_sim_ros.parameters import Array
from snake_sim_ros.parameters import load_scene
from snake_sim_ros.parameters import Robot
from snake_sim_ros.parameters import Scene
from snake_sim_ros.parameters import scene_to_text
from snake_sim_ros.parameters import with_settings
from snake_sim_ros.records import flat_fields
from snake_sim_ros.records import ParameterError
from snake_sim_ros.simulation import Simulation
from snake_sim_ros.simulation import steps_in
from snake_sim_ros.stepping import Report

SAMPLE = 0.1  # seconds between two samples of a path
CONVERGED = (1 / 16000, 1 / 32000)  # time steps of the reference
LINK_COUNTS = (10, 20, 40, 80, 160, 200)
RUNS = (  # method and steps a second
    ('newton', 4000), ('newton', 1000), ('newton', 200), ('newton', 100),
    ('bdf2', 400), ('bdf2', 100), ('bdf2', 50), ('bdf2', 20),
    ('paper', 4000), ('newton_dense', 4000),
)  # fmt: skip
LIFT = 10.0  # m, out of reach of the floor for more than a second
CASE_A = 'lateral_undulation'
SITUATIONS: dict[str, tuple[str, dict[str, Any], float]] = {  # scene, settings and lift [m]
    'all contacts': (CASE_A, {}, 0.0),
    'flight': (CASE_A, {}, LIFT),
    'few contacts': ('sidewinding', {'gait.soft_start': 0.0}, 0.0),
    'isotropic': ('lateral_undulation_isotropic', {}, 0.0),
    'rolling friction': (CASE_A, {'friction.rolling': 0.01}, 0.0),
    'isotropic, rolling': ('lateral_undulation_isotropic', {'friction.rolling': 0.01}, 0.0),
    'slope of 3 deg': (CASE_A, {'gravity': (0.513, 0.0, -9.797)}, 0.0),
}
ROUNDS = 5


@dataclass(frozen=True)
class Timing:
    """
    What a run of a scene took, and where it led.

    Attributes
    ----------
    median, p99 : float
        Time of single steps [us].
    units : float
        The median over the time of a factorization in the calibration loop.
    real_time_factor : float
        Simulated time over the time of all steps.
    compile_seconds : float
        Of the first call in this process: compiling, or loading what was compiled before.
    path : ndarray, shape (m, 3)
        Center of the middle link every SAMPLE seconds, from the start on [m].
    report : Report

    """

    median: float
    p99: float
    units: float
    real_time_factor: float
    compile_seconds: float
    path: Array
    report: Report


@compiled
def _factorizations(A, work, count):
    for _ in range(count):
        for i in range(6):
            for j in range(6):
                work[i, j] = A[i, j]
        factor(work)


def calibration() -> float:
    """Return the time of one LU factorization of a 6x6 matrix [us], the best of some loops."""
    A, work, count = np.eye(6) + 0.1, np.empty((6, 6)), 2000
    _factorizations(A, work, 1)
    best = np.inf
    for _ in range(5):
        begin = time.perf_counter()
        _factorizations(A, work, count)
        best = min(best, time.perf_counter() - begin)
    return 1e6 * float(best) / count


def time_steps(scene: Scene, *, lift: float = 0.0) -> Timing:
    """
    Run a scene for its duration, and return the times of its steps and its path.

    Parameters
    ----------
    scene : Scene
    lift : float, optional
        How high above the floor the robot starts [m].

    Raises
    ------
    ParameterError
        If the method of the scene is not a compiled one, or dt does not divide SAMPLE, or SAMPLE
        the duration.

    """
    simulation = Simulation(scene)
    simulation.state.q[:, 2] += lift
    stepper, link = simulation.stepper, scene.robot.middle_link
    if scene.method == 'reference':
        raise ParameterError(f'method {scene.method!r} is not compiled, its steps are not timed')
    sample = min(SAMPLE, scene.duration)
    steps = steps_in(sample, scene.dt, 'sampling period')
    compile_seconds = simulation.compile(scene.gait)
    unit, seconds, cycles = calibration(), 0.0, []
    start = time.perf_counter(), cycle_counter()
    path = [simulation.state.q[link, :3]]
    for _ in range(steps_in(scene.duration, sample, 'duration')):
        reference = gait.reference(
            scene.gait, simulation.midpoints(steps), scene.robot.link_count - 1
        )
        begin, compiled = time.perf_counter(), simulation.compile_seconds
        report = simulation.advance(*reference)
        compiled = simulation.compile_seconds - compiled
        seconds += time.perf_counter() - begin - compiled
        cycles.append(np.diff(stepper.cycles[: report.steps + 1]))
        path.append(simulation.state.q[link, :3])
        if report.failure:
            break
    counts = np.concatenate(cycles)
    wall, ticks = time.perf_counter() - start[0], cycle_counter() - start[1]
    microseconds = 1e6 * wall / max(ticks, 1) * counts
    median = float(np.median(microseconds)) if len(counts) else np.nan
    return Timing(
        median=median,
        p99=float(np.percentile(microseconds, 99)) if len(counts) else np.nan,
        units=median / unit,
        real_time_factor=simulation.time / seconds,
        compile_seconds=compile_seconds,
        path=np.array(path),
        report=simulation.report,
    )


def converged_path(scene: Scene) -> tuple[Array, float]:
    """
    Return the path of the middle link, extrapolated to no time step, and its own error.

    Returns
    -------
    path : ndarray, shape (m, 3)
        [m]
    error : float
        Of the finer of two runs against it, see `path_error`.

    """
    scene = replace(scene, level='spatial', method='newton')
    coarse, fine = (time_steps(replace(scene, dt=dt)).path for dt in CONVERGED)
    path = 2.0 * fine - coarse
    return path, path_error(fine, path)


def path_error(path: Array, expected: Array) -> float:
    """Return the largest distance at any time, over that of the last point from the first."""
    if path.shape != expected.shape:  # diverged
        return np.inf
    distance = np.linalg.norm(expected[-1] - expected[0])
    return float(np.linalg.norm(path - expected, axis=1).max() / distance)


@dataclass(frozen=True)
class LevelRow:
    """
    What the choice of the level makes of a scene.

    Attributes
    ----------
    level : str
        `planar`, `spatial`, or both if it changed.
    why : str
        Why it was not planar all the time; empty if it was.
    median, spatial_median : float
        Median step of the level chosen and of the spatial one [us].
    error, spatial_error : float
        Of their paths against the converged path of the spatial level, see `path_error`.
    doubt : float
        How far that path is from being converged.

    """

    level: str
    why: str
    median: float
    spatial_median: float
    error: float
    spatial_error: float
    doubt: float


def level_row(scene: Scene) -> LevelRow:
    """Run a scene at the level that `auto` takes and at the spatial level, by turns."""
    expected, doubt = converged_path(scene)
    timings: dict[str, list[Timing]] = {'auto': [], 'spatial': []}
    for _ in range(ROUNDS):
        for level, runs in timings.items():
            runs.append(time_steps(replace(scene, level=level)))
    auto, spatial = (runs[-1] for runs in timings.values())
    median, spatial_median = (
        float(np.median([timing.median for timing in runs])) for runs in timings.values()
    )
    planar_steps, steps = auto.report.planar_steps, auto.report.steps
    level = 'spatial' if planar_steps == 0 else 'planar'
    if 0 < planar_steps < steps:
        level = f'planar {100 * planar_steps / steps:.0f} %'
    return LevelRow(
        level=level,
        why='' if planar_steps == steps else auto.report.left or what_is_not_planar(scene),
        median=median,
        spatial_median=spatial_median,
        error=path_error(auto.path, expected),
        spatial_error=path_error(spatial.path, expected),
        doubt=doubt,
    )


def situations(duration: float) -> dict[str, tuple[float, float, float, int]]:
    """
    Return what steps of the default method cost by what there is to pay for; absent is free.

    The situations take turns, ROUNDS times: what disturbs the machine disturbs them all.

    Parameters
    ----------
    duration : float
        Of every run [s].

    Returns
    -------
    dict
        Name -> median step [us], its ratio to that of the first situation, iterations a step, and
        the contacts that were closed at the end.

    """
    scenes = {
        name: with_settings(
            load_scene(source), {**settings, 'level': 'spatial', 'duration': duration}
        )
        for name, (source, settings, _) in SITUATIONS.items()
    }
    timings: dict[str, list[Timing]] = {name: [] for name in SITUATIONS}
    for _ in range(ROUNDS):
        for name, scene in scenes.items():
            timings[name].append(time_steps(scene, lift=SITUATIONS[name][2]))
    medians = {
        name: float(np.median([timing.median for timing in runs]))
        for name, runs in timings.items()
    }
    first = next(iter(medians.values()))
    reports = {name: runs[-1].report for name, runs in timings.items()}
    return {
        name: (median, median / first, reports[name].iterations / reports[name].steps,
               reports[name].contacts)
        for name, median in medians.items()
    }  # fmt: skip


def cost_exponent(scene: Scene, link_counts: Iterable[int]) -> tuple[dict[int, float], float]:
    """Return the median step for numbers of links [us], and the exponent of a fitted power law."""
    medians = {}
    for n in link_counts:
        medians[n] = time_steps(replace(scene, robot=with_links(scene.robot, n))).median
    exponent, _ = np.polyfit(np.log(list(medians)), np.log(list(medians.values())), 1)
    return medians, float(exponent)


def with_links(robot: Robot, link_count: int) -> Robot:
    """Return a robot with another number of links: lists of values begin again at their end."""
    lists: dict[str, Any] = {
        name: tuple(np.resize(value, link_count + len(value) - robot.link_count))
        for name, (value, _) in flat_fields(robot).items()
        if isinstance(value, tuple)
    }
    return replace(robot, link_count=link_count, **lists)


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

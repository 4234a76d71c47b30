"""
Runs of compiled methods, timed step by step, and what steps cost by what there is to pay for.

The processor's own counter is read between two steps, so nothing but the step is in the times of
steps, neither references nor recording. What the numbers do not show: they are of one machine and
one moment. On a noisy machine compare ratios: to a calibration loop, a fixed amount of the same
kind of arithmetic, or between runs that take turns.
"""

from collections.abc import Callable
from dataclasses import dataclass
from dataclasses import replace
import math
import os
import subprocess
import sys
import tempfile
import time
from typing import Any

import numpy as np

from snake_sim_ros.comparison.course import Course
from snake_sim_ros.comparison.course import extrapolated
from snake_sim_ros.comparison.course import path_error
from snake_sim_ros.comparison.course import SAMPLE
from snake_sim_ros.dynamics.articulated_body import factor
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.compilation import cycle_counter
from snake_sim_ros.dynamics.energy import balance_error
from snake_sim_ros.dynamics.energy import BALANCE_TIME
from snake_sim_ros.scene.checked_records import flat_fields
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.parameters import Robot
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.parameters import scene_to_text
from snake_sim_ros.scene.parameters import with_settings
from snake_sim_ros.scene.posture import joint_angles
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.base import Stepper
from snake_sim_ros.stepping.methods import method_of
from snake_sim_ros.stepping.methods import what_is_not_planar
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.stepping.simulation import steps_in

CONVERGED = (1 / 16000, 1 / 32000)  # time steps of the reference
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


def timed(
    scene: Scene,
    make: Callable[[Scene], Stepper] | None = None,
    *,
    lift: float = 0.0,
    limit: float = math.inf,
) -> Course:
    """
    Run a scene for its duration, and return its course and the times of its steps.

    Parameters
    ----------
    scene : Scene
    make : callable, optional
        Makes the stepper of a scene; default: that of the scene's method.
    lift : float, optional
        How high above the floor the robot starts [m].
    limit : float, optional
        Wall time after which the run ends early [s].

    Raises
    ------
    ParameterError
        If the method of the scene is not a compiled one, or dt does not divide SAMPLE, or SAMPLE
        the duration.

    """
    if make is None and method_of(scene) == 'reference':
        raise ParameterError(f'method {scene.method!r} is not compiled, its steps are not timed')
    simulation = Simulation(scene, make and make(scene))
    simulation.state.q[:, 2] += lift
    sample = min(SAMPLE, scene.duration)
    steps = steps_in(sample, scene.dt, 'sampling period')
    compile_seconds = simulation.compile(scene.gait)
    seconds, cycles, states, late = 0.0, [], [simulation.state], False
    start = time.perf_counter(), cycle_counter()
    for _ in range(steps_in(scene.duration, sample, 'duration')):
        reference = simulation.gait_reference(steps)
        begin, compiled = time.perf_counter(), simulation.compile_seconds
        report = simulation.advance(*reference)
        compiled = simulation.compile_seconds - compiled
        seconds += time.perf_counter() - begin - compiled
        cycles.append(np.diff(simulation.stepper.cycles[: report.steps + 1]))
        late = seconds > limit
        if report.failure or late:
            break
        states.append(simulation.state)
    counts = np.concatenate(cycles)
    wall, ticks = time.perf_counter() - start[0], cycle_counter() - start[1]
    microseconds = 1e6 * wall / max(ticks, 1) * counts
    q = np.array([state.q for state in states])
    return Course(
        position=q[:, :, :3],
        axis=rotation_matrices(q[:, :, 3:])[..., 2],
        joint_angle=joint_angles(q),
        seconds=seconds,
        median=float(np.median(microseconds)) if len(counts) else math.nan,
        p99=float(np.percentile(microseconds, 99)) if len(counts) else math.nan,
        compile_seconds=compile_seconds,
        report=simulation.report,
        late=late,
    )


def energy_error(scene: Scene, make: Callable[[Scene], Stepper] | None = None) -> float:
    """
    Return `energy.balance_error` of the first BALANCE_TIME seconds of a scene.

    nan if it diverges, and for method bdf2, whose impulses are not those of a whole step.
    """
    if make is None and method_of(scene) == 'bdf2':
        return math.nan
    simulation = Simulation(scene, make and make(scene))
    q, u, impulse, torque = [simulation.state.q], [simulation.state.u], [], []
    for _ in range(steps_in(min(BALANCE_TIME, scene.duration), scene.dt, 'duration')):
        report = simulation.advance(*simulation.gait_reference(1))
        if report.failure:
            return math.nan
        q.append(simulation.state.q)
        u.append(simulation.state.u)
        impulse.append(simulation.history.impulse[:, :3])
        torque.append(report.joint_torque)
    return balance_error(scene, *map(np.array, (q, u, impulse, torque)))


def converged(scene: Scene) -> tuple[Course, float]:
    """
    Return the course of a scene at the spatial level without time step, and its own error.

    Returns
    -------
    course : Course
    error : float
        Of the path of the finer of the two runs that it is extrapolated from.

    """
    scene = replace(scene, level='spatial', method='newton')
    coarse, fine = (timed(replace(scene, dt=dt)) for dt in CONVERGED)
    course = extrapolated(coarse, fine)
    return course, path_error(fine.path, course.path)


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
    expected, doubt = converged(scene)
    timings: dict[str, list[Course]] = {'auto': [], 'spatial': []}
    for _ in range(ROUNDS):
        for level, runs in timings.items():
            runs.append(timed(replace(scene, level=level)))
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
        error=path_error(auto.path, expected.path),
        spatial_error=path_error(spatial.path, expected.path),
        doubt=doubt,
    )


def situations(duration: float) -> dict[str, Course]:
    """
    Run the default method where there is more or less to pay for; absent is free.

    The situations take turns, ROUNDS times: what disturbs the machine disturbs them all.

    Parameters
    ----------
    duration : float
        Of every run [s].

    Returns
    -------
    dict
        Name -> the run whose median step is the median of all its rounds.

    """
    scenes = {
        name: with_settings(
            load_scene(source), {**settings, 'level': 'spatial', 'duration': duration}
        )
        for name, (source, settings, _) in SITUATIONS.items()
    }
    runs: dict[str, list[Course]] = {name: [] for name in SITUATIONS}
    for _ in range(ROUNDS):
        for name, scene in scenes.items():
            runs[name].append(timed(scene, lift=SITUATIONS[name][2]))
    return {
        name: sorted(courses, key=lambda course: course.median)[ROUNDS // 2]
        for name, courses in runs.items()
    }


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
        'import sys; from snake_sim_ros.scene.parameters import scene_from_text; '
        'from snake_sim_ros.stepping.simulation import run; '
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

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Wall times of runs, of their steps, and of the stages of a step.

The cycle counter of the processor is read between two steps, so that the times of steps contain
neither references nor recording. All times are those of one machine at one moment. On a noisy
machine it is better to compare ratios, either to a calibration loop, which is a fixed amount of
the same kind of arithmetic, or between runs that take turns.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
import math
import os
import platform
import subprocess
import sys
import tempfile
import time
from typing import Any

import numpy as np

from snake_sim_benchmarks.comparison.paths import extrapolated, Motion, path_error, SAMPLING_PERIOD
from snake_sim_benchmarks.energy import balance_error, BALANCE_TIME
from snake_sim_ros import Report, Robot, Scene, Simulation, State
from snake_sim_ros.contact.newton import Newton
from snake_sim_ros.dynamics.articulated_body import factor_chain, reset_chain, solve_chain
from snake_sim_ros.dynamics.compilation import compiled, COUNTS_CYCLES, cycle_counter
from snake_sim_ros.dynamics.spatial_vectors import factor
from snake_sim_ros.scene.checked_records import flat_fields
from snake_sim_ros.scene.parameters import (
    Array,
    load_scene,
    scene_to_text,
    steps_in,
    with_settings,
)
from snake_sim_ros.scene.posture import joint_angles, joint_rates
from snake_sim_ros.stepping.base import Stepper
from snake_sim_ros.stepping.methods import method_of, METHODS, what_is_not_planar
from snake_sim_ros.stepping.model import Model, Workspace
from snake_sim_ros.stepping.moreau import begin_step, end_step, solve_step
from snake_sim_ros.stepping.planar import moreau as planar
from snake_sim_ros.stepping.planar.solvers import PlanarNewton
from snake_sim_ros.stepping.planar.stepper import PlanarStepper
from snake_sim_ros.stepping.sampling import Hooks, Keep, Limits
from snake_sim_ros.stepping.simulation import sample
from snake_sim_ros.stepping.spatial import SpatialStepper
from snake_sim_ros.stepping.steps import Steps
from snake_sim_ros.stepping.trajectory import Trajectory

# ---- runs of any method or simulator ------------------------------------------------------------


@dataclass(frozen=True)
class Timing:
    """Wall times of the steps of a run, and of compiling."""

    median: float  # of single steps [us]; nan if there were no steps
    p99: float
    compile_seconds: float  # of compiling, of loading compiled code, or of building a model [s]


@dataclass(frozen=True)
class TimedRun:
    """
    A run with its times, sampled every SAMPLING_PERIOD.

    The failure in the report of the trajectory says why it ended early.
    """

    trajectory: Trajectory
    timing: Timing
    energy_error: float = math.nan  # see `energy.balance_error`; nan if it was not computed
    late: bool = False  # whether the run was stopped because it took too long

    @property
    def simulated(self) -> float:
        """Simulated time up to the last sample [s]."""
        return float(self.trajectory.time[-1])

    @property
    def status(self) -> str:
        """Status of the run: a value of `base.Status`, or too_slow."""
        return 'too_slow' if self.late else self.trajectory.report.status.value


def timing_of(microseconds: Array, compile_seconds: float) -> Timing:
    """Return the timing of steps with these wall times, shape (steps,) [us]."""
    if not len(microseconds):
        return Timing(math.nan, math.nan, compile_seconds)
    median, p99 = np.median(microseconds), np.percentile(microseconds, 99)
    return Timing(float(median), float(p99), compile_seconds)


def trajectory_of_states(
    scene: Scene, states: Sequence[State], period: float, report: Report, seconds: float
) -> Trajectory:
    """
    Return the record of a run that was not sampled by `simulation.sample`.

    Parameters
    ----------
    scene : Scene
    states : sequence of State
        One for each sample.
    period : float
        Between two samples [s].
    report : Report
    seconds : float
        See `Trajectory`.

    Returns
    -------
    Trajectory
        Without contacts; joint torques are not known (nan).

    """
    q, u = (np.array([getattr(state, name) for state in states]) for name in 'qu')
    m, by_axis = len(states), scene.robot.by_axis
    angle = by_axis(joint_angles(q))
    return Trajectory(
        scene=scene,
        time=period * np.arange(m),
        position=q[..., :3],
        orientation=q[..., 3:],
        joint_angle=angle,
        joint_velocity=by_axis(joint_rates(q, u)),
        joint_torque=np.full_like(angle, math.nan),
        contact_sample=np.zeros(0, dtype=int),
        contact_number=np.zeros(0, dtype=int),
        contact_point=np.zeros((0, 3)),
        contact_force=np.zeros((0, 3)),
        level=np.full(m, 'spatial'),
        report=report,
        seconds=seconds,
        interrupted=False,
        velocity=u,
    )


# ---- runs of compiled methods -------------------------------------------------------------------


REFERENCE_STEPS = (1 / 32000, 1 / 64000)  # s, of the two runs that are extrapolated
LIFTED_HEIGHT = 10.0  # m, out of reach of the floor for more than a second
CASE_A_NAME = 'lateral_undulation'
SITUATIONS: dict[str, tuple[str, dict[str, Any], float]] = {  # scene, settings and lift [m]
    'all contacts': (CASE_A_NAME, {}, 0.0),
    'flight': (CASE_A_NAME, {}, LIFTED_HEIGHT),
    'few contacts': ('sidewinding', {'gait.soft_start': 0.0}, 0.0),
    'isotropic': ('lateral_undulation_isotropic', {}, 0.0),
    'rolling friction': (CASE_A_NAME, {'friction.rolling': 0.01}, 0.0),
    'isotropic, rolling': ('lateral_undulation_isotropic', {'friction.rolling': 0.01}, 0.0),
    'slope of 3 deg': (CASE_A_NAME, {'gravity': (0.513, 0.0, -9.797)}, 0.0),
}
ROUNDS = 5  # number of runs of everything that takes turns


@compiled
def _factorizations(A: Array, work: Array, count: int) -> None:
    for _ in range(count):
        for i in range(6):
            for j in range(6):
                work[i, j] = A[i, j]
        factor(work)


def calibration() -> float:
    """Return the time of one LU factorization of a 6x6 matrix [us], the shortest of some loops."""
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
) -> TimedRun:
    """
    Run a scene for its duration, and return its trajectory and the times of its steps.

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
        If dt does not divide SAMPLING_PERIOD, or SAMPLING_PERIOD the duration.

    """
    simulation = Simulation(scene, make and make(scene))
    simulation.state.q[:, 2] += lift
    period = min(SAMPLING_PERIOD, scene.duration)
    steps = steps_in(period, scene.dt, 'sampling period')
    samples = steps_in(scene.duration, period, 'duration')
    compile_seconds = simulation.compile(scene.gait)
    cycles: list[Array] = []

    def note(seconds: float) -> None:
        cycles.append(np.diff(simulation.stepper.cycles[: simulation.last.steps + 1]))

    start = time.perf_counter(), cycle_counter()
    trajectory = sample(
        simulation, steps, samples, limits=Limits(seconds=limit), hooks=Hooks(progress=note)
    )
    wall, ticks = time.perf_counter() - start[0], cycle_counter() - start[1]
    microseconds = tick_length(wall, ticks) * np.concatenate(cycles)
    return TimedRun(
        trajectory, timing_of(microseconds, compile_seconds), late=trajectory.seconds > limit
    )


def tick_length(wall: float, ticks: int) -> float:
    """
    Return the time of a tick of `cycle_counter` [us]; nan where it does not count.

    Parameters
    ----------
    wall : float
        A wall time [s].
    ticks : int
        What was counted in it.

    """
    return 1e6 * wall / ticks if ticks else math.nan


def note_on_step_times() -> str:
    """Return a sentence if times of single steps are not measured on this processor, or ''."""
    if COUNTS_CYCLES:
        return ''
    return (
        'times of single steps are left out: they come from the time stamp counter of x86_64 '
        f'processors, this is {platform.machine()}'
    )


def energy_error(scene: Scene, make: Callable[[Scene], Stepper] | None = None) -> float:
    """
    Return `energy.balance_error` of the first BALANCE seconds of a scene.

    It is nan if the run diverges, and for method bdf2, whose impulses do not act for whole steps.
    """
    if make is None and not METHODS[method_of(scene)].energy_balance:
        return math.nan
    simulation = Simulation(scene, make and make(scene))
    steps = steps_in(min(BALANCE_TIME, scene.duration), scene.dt, 'duration')
    run = sample(simulation, 1, steps, keep=Keep(impulses=True))
    if run.report.failure:
        return math.nan
    impulse, torque = run.impulse[1:, :, :3], run.scene.robot.by_joint(run.joint_torque[1:])
    return balance_error(scene, run.coordinates, run.velocity, impulse, torque)


def converged(scene: Scene) -> tuple[Motion, float]:
    """
    Return the motion of a scene extrapolated to a time step of zero, at the spatial level.

    Returns
    -------
    motion : Motion
    error : float
        Error of the path of the finer of the two runs from which it is extrapolated.

    """
    scene = replace(scene, level='spatial', method='newton')
    coarse, fine = (timed(replace(scene, dt=dt)).trajectory for dt in REFERENCE_STEPS)
    expected = extrapolated(coarse, fine)
    return expected, path_error(fine.path, expected.path)


@dataclass(frozen=True)
class LevelRow:
    """
    The level that `auto` chooses for a scene, with times and errors.

    Attributes
    ----------
    level : str
        `planar`, `spatial`, or `planar` with the share of its steps if the level changed.
    why : str
        Reason why it was not planar all the time; empty if it was.
    median, spatial_median : float
        Median time of a step at the chosen level and at the spatial one [us].
    error, spatial_error : float
        Errors of their paths against the converged path of the spatial level, see `path_error`.
    doubt : float
        Error of that converged path.

    """

    level: str
    why: str
    median: float
    spatial_median: float
    error: float
    spatial_error: float
    doubt: float


def level_row(scene: Scene) -> LevelRow:
    """Run a scene at the level that `auto` chooses and at the spatial level, in turns."""
    expected, doubt = converged(scene)
    found: dict[str, list[TimedRun]] = {'auto': [], 'spatial': []}
    for _ in range(ROUNDS):
        for level, runs in found.items():
            runs.append(timed(replace(scene, level=level)))
    auto, spatial = (runs[-1].trajectory for runs in found.values())
    median, spatial_median = (
        float(np.median([run.timing.median for run in runs])) for runs in found.values()
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


def situations(duration: float) -> dict[str, TimedRun]:
    """
    Run the default method with and without contacts and kinds of friction.

    The situations take turns, ROUNDS times, so that a disturbance of the machine affects them all.

    Parameters
    ----------
    duration : float
        Duration of every run [s].

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
    runs: dict[str, list[TimedRun]] = {name: [] for name in SITUATIONS}
    for _ in range(ROUNDS):
        for name, scene in scenes.items():
            runs[name].append(timed(scene, lift=SITUATIONS[name][2]))
    return {
        name: sorted(group, key=lambda run: run.timing.median)[ROUNDS // 2]
        for name, group in runs.items()
    }


def with_links(robot: Robot, link_count: int) -> Robot:
    """Return a robot with another number of links; lists of values are repeated."""
    lists: dict[str, Any] = {
        name: tuple(np.resize(value, link_count + len(value) - robot.link_count))
        for name, (value, _) in flat_fields(robot).items()
        if isinstance(value, tuple) and name not in ('links', 'joints', 'up')
    }
    return replace(robot, link_count=link_count, **lists)


def start_up_seconds(scene: Scene, *, cold: bool) -> float:
    """Return the wall time from the start of a new process to the end of its first step [s]."""
    one_step = replace(scene, duration=scene.dt)
    program = (
        'import sys; from snake_sim_ros.scene.parameters import scene_from_text; '
        'from snake_sim_ros.stepping.simulation import simulate; '
        'scene = scene_from_text(sys.stdin.read()); simulate(scene, rate=1 / scene.dt)'
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


# ---- stages of a step of newton -----------------------------------------------------------------


STAGES = ('kinematics, control, contacts', 'contact laws and chain', 'end of step, drift')
CHAIN_SWEEP = 'one sweep over the chain'  # part of the second stage, about one per iteration
TIMED_STEPS = 1000


@compiled
def spatial_stages(model: Model, work: Workspace, steps: Steps, stamps: Array) -> None:
    """Do what `take_moreau_step` does, with a time stamp after every stage, and a sweep apart."""
    for k in range(len(steps.angle)):
        stamps[k, 0] = cycle_counter()
        problem = begin_step(model, work, steps, k)
        stamps[k, 1] = cycle_counter()
        problem, outcome, lands = solve_step(Newton(None), model, work, steps, problem)
        stamps[k, 2] = cycle_counter()
        if not end_step(model, work, steps, problem, outcome, lands):
            break
        stamps[k, 3] = cycle_counter()
        reset_chain(work.chain)
        factor_chain(work.chain)
        solve_chain(work.chain, work.chain.torque)
        stamps[k, 4] = cycle_counter()


@compiled
def planar_stages(model: Any, work: Any, steps: Steps, stamps: Array) -> None:
    """Do what `take_planar_step` does, with a time stamp after every stage."""
    for k in range(len(steps.angle)):
        stamps[k, 0] = cycle_counter()
        count = planar.begin_planar_step(model, work, steps, k)
        stamps[k, 1] = cycle_counter()
        count, outcome = planar.solve_planar_step(PlanarNewton(), model, work, steps, count)
        stamps[k, 2] = cycle_counter()
        if not planar.end_planar_step(model, work, steps, count, outcome):
            break
        stamps[k, 3] = cycle_counter()
        stamps[k, 4] = stamps[k, 3]


def stage_times(scene: Scene, level: str) -> dict[str, float]:
    """
    Return the median time of every stage of a step, and at the spatial level of CHAIN_SWEEP [us].

    The median is that of TIMED_STEPS steps after the first second of the scene.

    Parameters
    ----------
    scene : Scene
    level : str
        `spatial` or `planar`.

    """
    stamps = np.zeros((TIMED_STEPS, 5), np.int64)
    stages = planar_stages if level == 'planar' else spatial_stages

    def loop(model: Any, work: Any, steps: Steps) -> None:
        stages(model, work, steps, stamps)

    make = PlanarStepper if level == 'planar' else SpatialStepper
    simulation = Simulation(scene, make(scene, loop))
    for steps in [TIMED_STEPS] * (round(1 / scene.dt / TIMED_STEPS) + 1):
        reference = simulation.gait_reference(steps)
        start = time.perf_counter(), cycle_counter()
        simulation.advance(*reference)
        wall, ticks = time.perf_counter() - start[0], cycle_counter() - start[1]
    medians = tick_length(wall, ticks) * np.median(np.diff(stamps, axis=1), axis=0)
    names = (*STAGES, CHAIN_SWEEP) if level == 'spatial' else STAGES
    return {name: float(median) for name, median in zip(names, medians, strict=False)}

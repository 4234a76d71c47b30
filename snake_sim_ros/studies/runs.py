# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Runs of a study: the scene of a row, the key of its run, and what the run gives for the table.

The key is a digest of all that a trajectory depends on: the scene with its steps, the rate of
samples, and the sources and the compiler of the physics. A run has a number for each metric that
any study has asked for.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
import hashlib
from pathlib import Path
import time
from typing import Any

from snake_sim_ros.dynamics import code_cache
from snake_sim_ros.gaits.blending import check_reach
from snake_sim_ros.recording.recorded_runs import read_npz, write_npz
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import samples_of, Scene, with_settings
from snake_sim_ros.stepping.base import Status
from snake_sim_ros.stepping.methods import with_usual_steps
from snake_sim_ros.stepping.sampling import (
    Hooks,
    Keep,
    LEAST_STEPS,
    Limits,
    NO_LIMITS,
    PORTION_SECONDS,
)
from snake_sim_ros.stepping.simulation import sample, Simulation
from snake_sim_ros.stepping.trajectory import Trajectory
from snake_sim_ros.studies.metrics import Metric, MetricError
from snake_sim_ros.studies.table import KEPT, Result, Run

CONVERGED, MAX_ITERATIONS, DIVERGED = (status.value for status in Status)
# Status of rows besides those of `base.Status`.
REFUSED, FAILED, OUT_OF_TIME = 'refused', 'failed', 'out_of_time'
# What computes the results of a run, besides the compiler and NumPy.
SOURCES = (*code_cache.ROOMS, 'controllers', 'studies/metrics.py')
KEY_LENGTH = 32  # hexadecimal digits


@cache
def physics_version() -> str:
    """Return a name for the contents of the physics, its compiler and the metrics."""
    return code_cache.identity(SOURCES)


@dataclass(frozen=True)
class Plan:
    """
    What all runs of a study have in common.

    Attributes
    ----------
    scene : Scene
    given : frozenset of str
        Names of the values that a user gave beside the file of the scene.
    metrics : tuple of Metric
    rate : float
        Samples a second [Hz].
    folder : Path or None
        Where trajectories are kept.
    time_limit : float
        Wall time after which a run is ended [s]; 0 is unlimited.
    version : str
        The version of the physics with which rows are to be computed.

    """

    scene: Scene
    given: frozenset[str]
    metrics: tuple[Metric, ...]
    rate: float
    folder: Path | None = None
    time_limit: float = 0.0
    version: str = field(default_factory=physics_version)

    @property
    def keep(self) -> Keep:
        """What a trajectory must have."""
        return Keep(
            contacts=bool(self.folder) or any(item.contacts for item in self.metrics),
            joints=bool(self.folder) or any(item.joints for item in self.metrics),
        )


@dataclass(frozen=True)
class Row:
    """The number of a row, from 0, and its values by their names in a scene."""

    number: int
    values: Mapping[str, Any]


class Stopped(Exception):
    """A run ended before its time because the study was interrupted."""


def never() -> bool:
    """Return that nobody interrupts."""
    return False


def scene_of(plan: Plan, values: Mapping[str, Any]) -> Scene:
    """
    Return the scene of a row, with the steps in which it is run.

    Raises
    ------
    ParameterError
        If a value is not usable, or the gait is beyond the joint limit.

    """
    scene = with_settings(plan.scene, values)
    check_reach(scene.gait, scene.robot)
    return with_usual_steps(scene, plan.given, 1.0 / plan.rate)


def key_of_run(plan: Plan, scene: Scene) -> str:
    """Return the key of the run of a scene, whose values are exact in its `repr`."""
    text = '\n'.join([physics_version(), repr(plan.rate), repr(scene)])
    return hashlib.sha256(text.encode()).hexdigest()[:KEY_LENGTH]


def trajectory_file(plan: Plan, key: str) -> Path | None:
    """Return the file of the trajectory of a run; None if trajectories are not kept."""
    return plan.folder / f'{key}.npz' if plan.folder else None


def empty_result(plan: Plan, row: Row) -> Result:
    """Return the result of a row before its run."""
    result: Result = {'row': row.number, **row.values}
    result |= dict.fromkeys(metric.name for metric in plan.metrics)
    result |= {'status': FAILED, 'failure': '', 'unconverged': 0, 'seconds': 0.0, 'key': ''}
    if plan.folder:
        result['trajectory'] = ''
    return result


def run_of(plan: Plan, result: Result) -> Run:
    """Return the run of a result for the journal, with the numbers by the metrics' identities."""
    numbers = {item.identity: result[item.name] for item in plan.metrics}
    kept = {name: number for name, number in numbers.items() if number is not None}
    return {name: result[name] for name in KEPT} | {'metrics': kept}


def known_result(plan: Plan, row: Row, known: Mapping[str, Run]) -> Result | None:
    """Return the result of a row, from known runs by their keys; None if it is to be run."""
    try:
        key = key_of_run(plan, scene_of(plan, row.values))
    except ParameterError:
        return None
    run = known.get(key)
    if run is None:
        return None
    numbers = {item.name: run['metrics'].get(item.identity) for item in plan.metrics}
    if None not in numbers.values():  # whatever has failed is not asked for
        status = MAX_ITERATIONS if run['unconverged'] else CONVERGED
        run = run | {'status': status, 'failure': ''}
    elif run['status'] == OUT_OF_TIME and 0.0 < plan.time_limit <= run['seconds']:
        return empty_result(plan, row) | {name: run[name] for name in KEPT}
    elif run['status'] != DIVERGED:
        return None
    result = empty_result(plan, row) | numbers | {name: run[name] for name in KEPT}
    if path := trajectory_file(plan, key):
        if not path.is_file():
            return None
        result['trajectory'] = path.name
    return result


def run_chunk(
    plan: Plan, rows: Sequence[Row], stopped: Callable[[], bool] = never
) -> list[Result]:
    """
    Return the results of some rows, without those after an interruption.

    Parameters
    ----------
    plan : Plan
    rows : sequence of Row
    stopped : callable, optional
        Asked some times a second whether the study was interrupted.

    Raises
    ------
    ParameterError
        If this process has another version of the physics than the plan.

    """
    if plan.version != physics_version():
        raise ParameterError(
            f'a worker has physics {physics_version()}, the study was begun with {plan.version}: '
            f'install the same sources, Numba and NumPy for all workers'
        )
    results, runner = [], _Runner(plan, stopped)
    for row in rows:
        try:
            results.append(runner.result(row))
        except Stopped:
            break
    return results


class _Runner:
    """Runs one row after the other; each shares the compiled code of the one before."""

    def __init__(self, plan: Plan, stopped: Callable[[], bool]) -> None:
        self.plan, self.stopped = plan, stopped
        self.simulation: Simulation | None = None
        self.portion = LEAST_STEPS  # steps of the last run that took PORTION_SECONDS

    def result(self, row: Row) -> Result:
        """Return the result of a row: its number, values, metrics, and how its run went."""
        result, begin, compiled = empty_result(self.plan, row), time.perf_counter(), 0.0
        try:
            scene = scene_of(self.plan, row.values)
            result['key'] = key_of_run(self.plan, scene)
            trajectory = self._kept(result)
            if trajectory is None:
                trajectory = self._run(scene)
                compiled = self.simulation.compile_seconds if self.simulation else 0.0
            if not self._is_out_of_time(trajectory, result):
                self._keep(trajectory, result)
                self._measure(trajectory, result)
        except (Stopped, OSError):
            raise
        except ParameterError as error:
            result |= {'status': REFUSED, 'failure': str(error)}
        except Exception as error:  # whatever a strange scene does, the other rows go on
            result |= {'status': FAILED, 'failure': f'{type(error).__name__}: {error}'}
        result['seconds'] = time.perf_counter() - begin - compiled
        return result

    def _kept(self, result: Result) -> Trajectory | None:
        """Return the trajectory of a run that was done for other metrics, if it was kept."""
        path = trajectory_file(self.plan, result['key'])
        if not path or not path.is_file():
            return None
        try:
            trajectory = read_npz(path)
        except ParameterError:  # it is run again
            return None
        result['trajectory'] = path.name
        return trajectory

    def _run(self, scene: Scene) -> Trajectory:
        """Return the trajectory of a scene; Stopped if the study ends meanwhile."""
        steps, samples = samples_of(scene, self.plan.rate)
        self.simulation, limits = Simulation(scene), NO_LIMITS
        if self.plan.time_limit:  # a limit of unconverged steps, not reached, keeps calls short
            limits = Limits(self.plan.time_limit, steps * samples + 1)
        hooks = Hooks(progress=self._look, portion=self.portion)
        trajectory = sample(
            self.simulation, steps, samples, keep=self.plan.keep, limits=limits, hooks=hooks
        )
        self.portion = int(PORTION_SECONDS * self.simulation.step_count / trajectory.seconds)
        return trajectory

    def _look(self, seconds: float) -> None:
        if self.stopped():
            raise Stopped

    def _is_out_of_time(self, trajectory: Trajectory, result: Result) -> bool:
        """Return whether a run was ended before its last sample, and note that."""
        report, scene = trajectory.report, trajectory.scene
        _, samples = samples_of(scene, self.plan.rate)
        if report.failure or len(trajectory.time) > samples:
            return False
        result |= {'status': OUT_OF_TIME, 'unconverged': report.unconverged}
        result['failure'] = (
            f'{trajectory.time[-1]:g} s of {scene.duration:g} s were simulated within the '
            f'time_limit, {self.plan.time_limit:g} s'
        )
        return True

    def _keep(self, trajectory: Trajectory, result: Result) -> None:
        """Write a trajectory if they are kept, with the velocities that other metrics need."""
        path = trajectory_file(self.plan, result['key'])
        if path and not result['trajectory']:
            path.parent.mkdir(parents=True, exist_ok=True)
            more = {name: getattr(trajectory, name) for name in ('velocity', 'joint_steps')}
            write_npz(trajectory, path, more)
            result['trajectory'] = path.name

    def _measure(self, trajectory: Trajectory, result: Result) -> None:
        """Note how a run went, and its metrics unless it diverged; one may fail by itself."""
        report = trajectory.report
        result |= {'status': report.status.value, 'unconverged': report.unconverged}
        result['failure'] = report.failure
        for metric in () if report.failure else self.plan.metrics:
            try:
                result[metric.name] = metric(trajectory)
            except MetricError as error:
                result['failure'] = result['failure'] or str(error)
                if result['status'] == CONVERGED:
                    result['status'] = FAILED

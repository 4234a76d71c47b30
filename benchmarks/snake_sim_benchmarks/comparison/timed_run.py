# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Runs of any method or simulator with their wall times, from which the bench makes its rows."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.posture import joint_angles, joint_rates
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.state import State
from snake_sim_ros.stepping.trajectory import Trajectory

SAMPLING_PERIOD = 0.1  # s between two samples of runs that are compared


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
    m, angle = len(states), joint_angles(q)
    return Trajectory(
        scene=scene,
        time=period * np.arange(m),
        position=q[..., :3],
        orientation=q[..., 3:],
        joint_angle=angle,
        joint_velocity=joint_rates(q, u),
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

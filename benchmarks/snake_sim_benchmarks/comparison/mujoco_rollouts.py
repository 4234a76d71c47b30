# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Runs of MuJoCo in one call of `mujoco.rollout`.

MuJoCo is an optional dependency and is imported only when a function needs it.
"""

from collections.abc import Sequence
from contextlib import closing
import math

import numpy as np

from snake_sim_benchmarks.comparison.courses import (
    Course,
    least_seconds,
    portions,
    Start,
    step_count,
)
from snake_sim_benchmarks.comparison.mujoco_model import import_mujoco, MujocoSettings
from snake_sim_benchmarks.comparison.mujoco_runs import collected_warnings, MujocoRobot
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array, Scene

PLACE = slice(1, 4)  # of the middle link, the root of the tree, in a state of MuJoCo


class Rollouts:
    """
    Robots that MuJoCo runs in one call, each with a model of its own.

    The call writes the state after every step, which takes little of its time.

    Parameters
    ----------
    scenes : sequence of Scene
        With the same robot, time step and duration.
    settings : MujocoSettings
    threads : int, optional
        With one it is the calling thread.
    start : Start, optional
        Of all robots; default: those of the scenes.

    Attributes
    ----------
    first : ndarray, shape (m, k)
        States of the robots at the start.
    states : ndarray, shape (m, steps, k)
        States after every step, once the call is over.

    Raises
    ------
    ParameterError
        If MuJoCo is not installed or cannot run a scene, see `mujoco_model.mjcf`, or if the drive
        is `torque`, which needs the caller before every step.

    """

    def __init__(
        self, scenes: Sequence[Scene], settings: MujocoSettings, threads: int = 1,
        start: Start | None = None,
    ) -> None:  # fmt: skip
        if settings.drive == 'torque':
            raise ParameterError(
                'drive must be spring or position for a run in one call, got torque'
            )
        mujoco, steps = import_mujoco(), step_count(scenes[0])
        from mujoco.rollout import Rollout

        state, begin = start or (None, 0.0)
        self.robots = [MujocoRobot(scene, settings, state) for scene in scenes]
        physics, model = mujoco.mjtState.mjSTATE_FULLPHYSICS, self.robots[0].model
        self.first = np.empty((len(scenes), mujoco.mj_stateSize(model, physics)))
        self.control = np.empty((len(scenes), steps, model.nu))
        for robot, first, control in zip(self.robots, self.first, self.control, strict=True):
            angle, rate = (values[:, robot.axes] for values in robot.reference(0, steps, begin))
            K_p, K_d = robot.gains()
            control[:] = K_p * angle + K_d * rate
            mujoco.mj_getState(robot.model, robot.data, first, physics)
        self.states = np.empty((len(scenes), steps, self.first.shape[1]))
        self.sensors = np.empty((len(scenes), steps, 0))

        self.models = [robot.model for robot in self.robots]
        self.data = [robot.data for robot in self.robots[:threads]]
        self.rollout = Rollout(nthread=0 if threads == 1 else threads)

    def __call__(self) -> None:
        """Run all robots."""
        self.rollout.rollout(
            self.models, self.data, self.first, self.control, nstep=self.control.shape[1],
            state=self.states, sensordata=self.sensors,
        )  # fmt: skip

    def close(self) -> None:
        """End the threads."""
        self.rollout.close()


def rolled_course(scene: Scene, start: Start | None = None, *, settings: MujocoSettings) -> Course:
    """
    Return the course of a scene by MuJoCo, see `courses.Course`.

    A warning of MuJoCo counts as a failure, since MuJoCo resets the robot to its start then.

    Raises
    ------
    ParameterError
        As `Rollouts` raises it.

    """
    with closing(Rollouts([scene], settings, start=start)) as rollouts:
        with collected_warnings() as warnings:
            seconds = least_seconds(rollouts)
    return _course_of(scene, rollouts.first[0], rollouts.states[0], seconds, warnings)


def _course_of(
    scene: Scene, first: Array, states: Array, seconds: float, warnings: list[str]
) -> Course:
    """Return the course in a table of states, whose columns are time, place of the root, ..."""
    last = [last for _, last in portions(scene)]
    path = np.concatenate([first[None, PLACE], states[np.array(last) - 1, PLACE]])
    failure = f'MuJoCo: {warnings[0].partition(".")[0]}' if warnings else ''
    time = scene.dt * np.array([0, *last])
    return Course(time, path, math.nan if failure else seconds, 0, failure)

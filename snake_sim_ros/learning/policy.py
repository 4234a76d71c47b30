# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A policy that was learned in an environment as a controller: in runs, studies, and over ROS."""

from collections.abc import Callable, Sequence

import numpy as np

from snake_sim_ros.controllers.controller import Measured, Reference
from snake_sim_ros.learning.actions import Torques
from snake_sim_ros.learning.environment import SnakeEnv
from snake_sim_ros.learning.tasks import Goal, Motion
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array, Scene


class PolicyController:
    """
    Moves a robot by a policy.

    It sees what the environment shows: joints, an inertial unit in every link, of which the head
    counts, and poses, of which the command of the task is made.

    Parameters
    ----------
    environment : SnakeEnv
        What the policy was learned in. Its scene is not that of the robot: this has its own.
    policy : callable
        Returns the action for an observation.
    seed : int, optional
        Of the task.
    goal : sequence of float, optional
        Where a task `goal` has its goal, (x, y) [m, frame I]; default: its seed says where.

    Raises
    ------
    ParameterError
        If actions are torques, which a controller does not command, or a goal is not two finite
        numbers, or of a task that has none.

    """

    sees_poses = sees_imus = True

    def __init__(
        self, environment: SnakeEnv, policy: Callable[[Array], Array], seed: int = 0,
        goal: Sequence[float] | None = None,
    ) -> None:  # fmt: skip
        if isinstance(environment.snakes.actions, Torques):
            raise ParameterError('a controller commands angles: the policy must not have torques')
        if goal is not None:
            if not isinstance(environment.snakes.task, Goal):
                raise ParameterError('goal: the task of the policy has none')
            if np.shape(goal) != (2,) or not np.isfinite(goal).all():
                raise ParameterError(f'goal must be two finite numbers, got {goal}')
        self.snakes, self.policy, self.seed = environment.snakes, policy, seed
        self.goal = goal
        self.period, self.sees_contacts = self.snakes.period, self.snakes.contacts

    def start(self, scene: Scene) -> None:
        """Begin an episode."""
        self.snakes.actions.start(0, scene)
        self._motion: Motion | None = None

    def control(self, measured: Measured, time: float) -> Reference:
        """Return the references of the next action."""
        snakes = self.snakes
        assert measured.position is not None
        assert measured.imu is not None
        motion = Motion.of(measured.position[None])
        if self._motion:
            snakes.task.progress(self._motion, motion)
        else:
            snakes.task.start(0, motion.of_robot(0), np.random.default_rng(self.seed))
            if self.goal is not None:
                assert isinstance(snakes.task, Goal)
                snakes.task.goal[0] = self.goal
        self._motion = motion
        joints = measured.joint_angle[None], measured.joint_velocity[None]
        force = measured.contact_wrench
        force = None if force is None else force[None, :, :3]
        seen = snakes.observation(joints, measured.imu[:1], force, motion)[0]
        shape = snakes.actions.low.shape
        what = f'a policy must return {shape[0]} finite numbers'
        action = snakes.physical(self.policy(seen), what, shape)
        references = snakes.actions.references(action[None], np.array([time]), self.period)

        def reference(times: Array) -> tuple[Array, Array]:
            angle, rate = references(times[None])
            return angle[0], rate[0]

        return reference

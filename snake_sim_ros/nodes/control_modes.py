# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What moves each joint of `sim`: its controller, or a commanded torque alone.

A command interface of ros2_control that is used alone is a mode of its joint. With positions or
velocities a joint follows its reference; with efforts alone its controller is off.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from snake_sim_ros.scene.parameters import Array, Robot, Scene
from snake_sim_ros.stepping.controlled import command_effort, commanded_effort
from snake_sim_ros.stepping.simulation import Simulation

AXES = ('yaw', 'pitch')


class ControlModes:
    """
    Turns controllers of joints off and on.

    Parameters
    ----------
    simulation : Simulation
        Its scene is changed: a controller that is off has gains of 0.

    Attributes
    ----------
    scene : Scene
        With the gains that controllers have when they are on.
    free : ndarray of bool, shape (n-1, 2)
        Axes (yaw, pitch) whose controllers are off.

    """

    def __init__(self, simulation: Simulation) -> None:
        self.scene = simulation.scene
        self.free = np.zeros((simulation.scene.robot.link_count - 1, 2), dtype=bool)
        self._simulation = simulation

    def change(self, scene: Scene) -> None:
        """Continue with another scene; what is off stays off."""
        self.scene = scene
        scene = replace(scene, robot=without_gains(scene.robot, self.free))
        if scene == self._simulation.scene:
            return
        effort = commanded_effort(self._simulation)
        self._simulation.change(scene)
        if scene.robot.effort_commands:
            command_effort(self._simulation, effort)

    def switch(self, axes: Array, *, off: Array) -> None:
        """
        Turn controllers of some axes off, and those of the others of them on.

        Parameters
        ----------
        axes : ndarray of int, shape (k,)
            Counted along the robot, yaw before pitch.
        off : ndarray of bool, shape (k,)

        """
        if (self.free.flat[axes] != off).any():
            self.free.flat[axes] = off
            self.change(self.scene)

    def reset(self) -> None:
        """Turn all controllers on, without torques besides theirs."""
        if self.scene.robot.effort_commands:
            command_effort(self._simulation, np.zeros(self.free.shape))
        self.switch(np.arange(self.free.size), off=np.zeros(self.free.size, dtype=bool))


def without_gains(robot: Robot, free: Array) -> Robot:
    """Return a robot without the gains of some axes (n-1, 2)."""
    if not free.any():
        return robot
    gains: dict[str, Any] = {
        f'{axis}_{gain}': tuple(np.where(free[:, k], 0.0, robot.per_joint(gain)[:, k]).tolist())
        for k, axis in enumerate(AXES)
        for gain in ('stiffness', 'damping')
    }
    return replace(robot, **gains)

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Torques as commands, for robots with effort_commands."""

import numpy as np

from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.stepping.state import copied


def command_effort(simulation: Simulation, effort: Array) -> None:
    """
    Let torques act on the joints from now on, besides those of their controllers.

    They count in all steps until the next call or a reset, within the torque limits of the robot.
    Joints whose gains are 0 have no other torque.

    Parameters
    ----------
    simulation : Simulation
    effort : ndarray, shape (n-1, 2)
        Torques (yaw, pitch) [N m].

    Raises
    ------
    ParameterError
        If the robot takes no efforts, or the torques are not finite or of another shape.

    """
    robot = simulation.scene.robot
    if not robot.effort_commands:
        raise ParameterError('efforts need a robot with effort_commands: true, got false')
    shape, effort = (robot.link_count - 1, 2), np.asarray(effort, dtype=float)
    if effort.shape != shape:
        raise ParameterError(f'effort must have the shape {shape}, got {effort.shape}')
    if not np.isfinite(effort).all():
        place = np.argwhere(~np.isfinite(effort))[0].tolist()
        raise ParameterError(f'effort must be finite, got {effort[tuple(place)]} at {place}')
    history = copied(simulation.history)
    if history.memory and (effort != history.control.effort).any():
        history.memory.forces_jump()
    history.control.effort[:] = effort
    simulation.history = history


def commanded_effort(simulation: Simulation) -> Array:
    """Return the torques that are commanded, shape (n-1, 2) [N m]."""
    return np.asarray(simulation.history.control.effort).copy()

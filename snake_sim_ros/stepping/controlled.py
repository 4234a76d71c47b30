# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A simulation under the control of Python: torques, and another place.

`command_effort` commands torques, for robots with effort_commands. `place` puts a robot somewhere
else as it is: same joint angles, at rest.
"""

import numpy as np

from snake_sim_ros.contact.placing import lift_out_of_world
from snake_sim_ros.dynamics.force_directions import scene_gaps
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.obstacles import contact_links, first_peg
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.rotations import CONJUGATE, product, rotation_matrices
from snake_sim_ros.stepping.levels import what_does_not_lie
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.stepping.state import copied, State

INSIDE = 1e-6  # how far a link may be inside something, as where it lies [m]


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


def place(simulation: Simulation, position: Array, orientation: Array) -> None:
    """
    Put the robot at rest where its middle link has a pose; an error changes nothing.

    Parameters
    ----------
    simulation : Simulation
    position : ndarray, shape (3,)
        Center of the middle link [m, frame I].
    orientation : ndarray, shape (4,)
        Unit Euler parameters of its frame B, scalar first.

    Raises
    ------
    ParameterError
        If a link would be inside the floor or an obstacle, if the scene stays in the plane and the
        robot would not, or if the simulation has diverged.

    """
    scene = simulation.scene
    if simulation.report.failure:
        raise ParameterError('the simulation has diverged: reset it first')
    state = placed(scene, simulation.state, position, orientation)
    _refuse_inside(scene, state.q)
    if scene.level == 'planar' and (why := what_does_not_lie(scene, state)):
        raise ParameterError(f'level is planar, but there {why}')
    simulation.state = state
    simulation.history = simulation.stepper.empty_history()


def placed(scene: Scene, state: State, position: Array, orientation: Array) -> State:
    """Return a robot moved as a rigid body to a pose of its middle link, see `place`, at rest."""
    middle = scene.robot.middle_link
    turn = product(orientation, CONJUGATE * state.q[middle, 3:])
    q = np.empty(state.q.shape)
    arm = state.q[:, :3] - state.q[middle, :3]
    q[:, :3] = position + arm @ rotation_matrices(turn).T
    q[:, 3:] = product(turn, state.q[:, 3:])
    q[:, 3:] /= np.linalg.norm(q[:, 3:], axis=1, keepdims=True)
    return State(q, np.zeros(state.u.shape))


def _refuse_inside(scene: Scene, q: Array) -> None:
    """Raise an error if a link is inside something."""
    if scene.world and lift_out_of_world(scene, q) > INSIDE:
        raise ParameterError('the robot would be inside a solid of the world')
    gap = scene_gaps(scene, q)
    a = int(gap.argmin())
    if gap[a] >= -INSIDE:
        return
    link, other = contact_links(scene)[a]
    what = f'link {other + 1}' if other >= 0 else 'the floor' if a < first_peg(scene) else 'a peg'
    raise ParameterError(f'link {link + 1} would be {-gap[a]:.3g} m inside {what}')

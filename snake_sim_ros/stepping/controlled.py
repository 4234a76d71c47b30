# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A simulation under the control of Python: runs with a controller, torques, and another place.

`controlled` runs a scene whose joints are commanded by a function, called at every sample.
`command_effort` commands torques, for robots with effort_commands. `place` puts a robot somewhere
else as it is: same joint angles, at rest.
"""

from collections.abc import Callable
import time

import numpy as np

from snake_sim_ros.dynamics.force_directions import scene_gaps
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.obstacles import contact_links, first_peg
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.rotations import CONJUGATE, product, rotation_matrices
from snake_sim_ros.stepping.contact_forces import last_span
from snake_sim_ros.stepping.levels import what_does_not_lie
from snake_sim_ros.stepping.sampling import begun_samples, Keep, trajectory_of
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.stepping.state import copied, State
from snake_sim_ros.stepping.trajectory import Trajectory

# Steps between two samples that are taken one by one, in place. More of them are one call, which
# takes as long as some 20 of these to begin.
MOST_SINGLE = 20
INSIDE = 1e-6  # how far a link may be inside something, as where it lies [m]


def controlled(
    simulation: Simulation, steps: int, samples: int,
    controller: Callable[[Simulation], tuple[Array, Array]], *, keep: Keep,
    progress: Callable[[float], object] | None = None,
) -> Trajectory:  # fmt: skip
    """
    Advance a simulation with a controller, and return samples of its motion.

    Parameters
    ----------
    simulation : Simulation
        Its present state is the first sample.
    steps : int
        Number of steps between two samples.
    samples : int
        Number of samples after the first one; fewer if a step diverges.
    controller : callable
        ``controller(simulation)`` is called at every sample but the last, and returns joint angles
        [rad] and rates [rad/s] of shape (n-1, 2), which hold until the next sample.
    keep : Keep
    progress : callable, optional
        Called with the simulated time that has passed [s] at every sample.

    """
    scene, begin = simulation.scene, time.perf_counter()
    last = simulation.state, simulation.history, simulation.last
    found, start = begun_samples(scene, *last, steps, samples), simulation.step_count
    single = steps <= MOST_SINGLE
    held = np.zeros((2, 1 if single else steps, scene.robot.link_count - 1, 2))
    for row in range(1, samples + 1):
        held[0], held[1] = controller(simulation)
        if single:
            for _ in range(steps):
                simulation.advance(held[0], held[1])
        else:
            simulation.advance(held[0], held[1], found.after((row - 1) * steps))
        if simulation.report.failure:
            break
        if single:
            history, torque = simulation.present_history, simulation.last.joint_torque
            span = last_span(scene, history)
            found.add(row * steps - 1, simulation.state, history, torque, span)
            found.is_planar[row] = simulation.last.level == 'planar'
        if progress:
            progress(row * steps * scene.dt)
    return trajectory_of(
        scene, found.until(simulation.step_count - start), keep, simulation.report,
        time.perf_counter() - begin, interrupted=False,
    )  # fmt: skip


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
    gap = scene_gaps(scene, q)
    a = int(gap.argmin())
    if gap[a] >= -INSIDE:
        return
    link, other = contact_links(scene)[a]
    what = f'link {other + 1}' if other >= 0 else 'the floor' if a < first_peg(scene) else 'a peg'
    raise ParameterError(f'link {link + 1} would be {-gap[a]:.3g} m inside {what}')

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Effects of the printed errors of the paper: inertia from half the radius, sign in eq. (84).

The steps are those of `reference` without contacts; they are dense and slow.
"""

from dataclasses import replace

import numpy as np

from snake_sim_ros.dynamics.control_loop import make_control_memory
from snake_sim_ros.dynamics.dense_joint_drift import without_drift
from snake_sim_ros.dynamics.force_directions import (
    joint_directions,
    mass_matrix,
    smooth_forces,
    torque_directions,
)
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.reference import end_coordinates, joint_torque_law, middle_coordinates
from snake_sim_ros.stepping.state import State


def consistent(scene: Scene) -> Scene:
    """Return the scene with moments of inertia from the radius as the paper states it."""
    return replace(scene, robot=replace(scene.robot, inertia='consistent'))


def step_in_the_air(
    scene: Scene, state: State, angle: Array, rate: Array, sign: float
) -> tuple[State, float, float]:
    """
    Take a step without contacts, with a sign for the first term of eq. (84).

    The step is ``P_J = -G_J^-1 (sign W_J^T u_A + W_J^T M^-1 (h + tau_C) dt)`` with
    ``G_J = W_J^T M^-1 W_J``, so that ``W_J^T u_E = (1 - sign) W_J^T u_A``.

    Parameters
    ----------
    scene : Scene
        With a joint controller of the start or the middle of the step.
    state : State
    angle, rate : ndarray, shape (n-1, 2)
        Joint references [rad], [rad/s].
    sign : float
        1 as derived, -1 as printed.

    Returns
    -------
    state : State
    before, after : float
        Largest rate of a joint gap of u_A and of u_E, in the directions of the step [m/s].

    """
    robot, dt, u_A = scene.robot, scene.dt, state.u.ravel()
    q_M = middle_coordinates(state, dt)
    R = rotation_matrices(q_M[:, 3:])
    W_J, M_inv = joint_directions(robot, R), 1.0 / np.diag(mass_matrix(robot))
    torque, _ = joint_torque_law(scene, state, q_M, make_control_memory(scene), angle, rate)
    h = smooth_forces(robot, np.array(scene.gravity), state.u)
    gained = M_inv * (h + torque_directions(R) @ torque) * dt
    G_J = W_J.T @ (M_inv[:, None] * W_J)
    P_J = -np.linalg.solve(G_J, sign * W_J.T @ u_A + W_J.T @ gained)
    u_E = u_A + gained + M_inv * (W_J @ P_J)
    u = u_E.reshape(state.u.shape)
    q = end_coordinates(state.q, q_M, state.u, u, dt)
    rates = [float(np.abs(W_J.T @ v).reshape(-1, 4)[:, :3].max()) for v in (u_A, u_E)]
    q = without_drift(robot, q, scene.drift_correction, np.full((robot.link_count - 1, 2), np.inf))
    return State(q, u), rates[0], rates[1]

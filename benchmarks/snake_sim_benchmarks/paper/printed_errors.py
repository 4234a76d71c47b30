# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Effects of the printed errors of the paper: inertia from half the radius, sign in eq. (84).

The steps are those of the paper without contacts, in dense NumPy.
"""

from dataclasses import replace

import numpy as np

from snake_sim_ros.dynamics import kinematics
from snake_sim_ros.dynamics.force_directions import (
    joint_directions,
    mass_matrix,
    smooth_forces,
    torque_directions,
)
from snake_sim_ros.dynamics.joint_control import pd_law
from snake_sim_ros.scene.parameters import Array, PD_SCHEMES, Robot, Scene
from snake_sim_ros.scene.posture import center_of_mass, joint_angles, joint_rates
from snake_sim_ros.scene.rotations import product, rotation_matrices
from snake_sim_ros.stepping.state import State


def consistent(scene: Scene) -> Scene:
    """Return the scene with moments of inertia from the radius as the paper states it."""
    return replace(scene, robot=replace(scene.robot, inertia='consistent'))


def middle_coordinates(state: State, dt: float) -> Array:
    """Return the coordinates (n, 7) at the middle of a step, eq. (72), p_M not of length 1."""
    q_M = np.empty_like(state.q)
    kinematics.middle_coordinates(dt, state.q, state.u, q_M)
    return q_M


def with_unit_parameters(q: Array) -> Array:
    """Return coordinates (n, 7) with Euler parameters of length 1."""
    return np.hstack([q[:, :3], q[:, 3:] / np.linalg.norm(q[:, 3:], axis=1, keepdims=True)])


def end_coordinates(q_M: Array, u_E: Array, dt: float) -> Array:
    """Return the coordinates (n, 7) at the end of a step, eq. (83), before joints are closed."""
    q_E = q_M.copy()
    q_E[:, :3] += dt / 2 * u_E[:, :3]
    spin = np.column_stack([np.zeros(len(u_E)), u_E[:, 3:]])
    q_E[:, 3:] += dt / 4 * product(q_M[:, 3:], spin)
    return q_E


def controller_torques(scene: Scene, state: State, q_M: Array, angle: Array, rate: Array) -> Array:
    """Return the torques (2(n-1),) of the joint controllers, all explicit terms [N m]."""
    robot, scheme = scene.robot, PD_SCHEMES.index(scene.pd_scheme)
    starts = np.stack([joint_angles(state.q), joint_rates(state.q, state.u)], -1)
    mids = np.stack([joint_angles(q_M), joint_rates(q_M, state.u)], -1)
    kp, kd = robot.per_joint('stiffness'), robot.per_joint('damping')
    torque = np.zeros(kp.shape)
    for axis in np.ndindex(kp.shape):
        looked_at = tuple(starts[axis]), tuple(mids[axis]), (angle[axis], rate[axis])
        torque[axis], _ = pd_law(scheme, scene.dt, *looked_at, kp[axis], kd[axis])
    return torque.ravel()


def with_closed_joints(robot: Robot, q: Array, rule: str) -> Array:
    """Return the coordinates without the drift of joints, section VII-C; see `joint_drift`."""
    q = with_unit_parameters(q)
    if rule == 'none':
        return q
    center, half = center_of_mass(robot, q), robot.per_link('link_length') / 2
    for i in range(robot.link_count - 1):
        inner, outer = rotation_matrices(q[i : i + 2, 3:])
        normal, sine = np.cross(inner[:, 1], outer[:, 0]), inner[:, 1] @ outer[:, 0]
        turn = np.arctan2(sine, np.linalg.norm(normal))
        axis = np.sin(turn / 2) / np.linalg.norm(normal) * normal
        q[i + 1, 3:] = product(np.array([np.cos(turn / 2), *axis]), q[i + 1, 3:])
        outer = rotation_matrices(q[i + 1 : i + 2, 3:])[0]
        q[i + 1, :3] = q[i, :3] + half[i] * inner[:, 2] + half[i + 1] * outer[:, 2]
    if rule == 'center_of_mass':
        q[:, :3] += center - center_of_mass(robot, q)
    return q


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
    unit_q_M = with_unit_parameters(q_M)
    R = rotation_matrices(unit_q_M[:, 3:])
    W_J, M_inv = joint_directions(robot, R), 1.0 / np.diag(mass_matrix(robot))
    torque = controller_torques(scene, state, unit_q_M, angle, rate)
    h = smooth_forces(robot, np.array(scene.gravity), state.u)
    gained = M_inv * (h + torque_directions(R) @ torque) * dt
    G_J = W_J.T @ (M_inv[:, None] * W_J)
    P_J = -np.linalg.solve(G_J, sign * W_J.T @ u_A + W_J.T @ gained)
    u_E = u_A + gained + M_inv * (W_J @ P_J)
    u = u_E.reshape(state.u.shape)
    q = end_coordinates(q_M, u, dt)
    rates = [float(np.abs(W_J.T @ v).reshape(-1, 4)[:, :3].max()) for v in (u_A, u_E)]
    q = with_closed_joints(robot, q, scene.drift_correction)
    return State(q, u), rates[0], rates[1]

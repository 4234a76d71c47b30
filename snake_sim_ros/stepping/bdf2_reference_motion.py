# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
States of the robot in joint coordinates, for the step of `bdf2` in dense NumPy, `bdf2_reference`.

A pose, shape (7,), is the center of mass [m, frame I] and the Euler parameters of the middle link.
Equations with roman numbers are those of `bdf2_reference`.
"""

from typing import NamedTuple

import numpy as np

from snake_sim_ros.dynamics.force_directions import joint_directions
from snake_sim_ros.scene import posture
from snake_sim_ros.scene.parameters import Array, Robot
from snake_sim_ros.scene.rotations import cross, H_bar, product, rotation_matrices
from snake_sim_ros.stepping.bdf2_memory import Bdf2Memory, CONSISTENT_SPEED
from snake_sim_ros.stepping.joint_motion import Motion
from snake_sim_ros.stepping.parts import ANEW, SMOOTH, UNKNOWN
from snake_sim_ros.stepping.state import State


def motion_of(robot: Robot, state: State) -> Motion:
    """Return a state in joint coordinates."""
    pose = np.append(posture.center_of_mass(robot, state.q), state.q[robot.link_count // 2, 3:])
    rate = posture.joint_rates(state.q, state.u)
    return Motion(pose, posture.joint_angles(state.q), rate, state.u)


def recognized(robot: Robot, state: State, memory: Bdf2Memory) -> Bdf2Memory:
    """Return the memory to go on with from a given state: UNKNOWN if u violates W_J^T u = 0."""
    half, n = robot.per_link('link_length')[:-1] / 2, robot.link_count
    W_J = joint_directions(robot, rotation_matrices(state.q[:, 3:]))
    rate = (W_J.T @ state.u.ravel()).reshape(n - 1, 4) * np.column_stack(
        [np.ones((n - 1, 3)), half]
    )
    agrees = float(np.abs(rate).max(initial=0.0)) <= CONSISTENT_SPEED
    phase = np.array([ANEW if agrees else UNKNOWN])
    return memory._replace(end=motion_of(robot, state), q=state.q, phase=phase)


def coordinates(robot: Robot, pose: Array, angle: Array) -> Array:
    """Return q (n, 7) of links with a pose (7,), as in `Motion`, and joint angles (n-1, 2)."""
    q, root = posture.chain_coordinates(robot, angle), robot.link_count // 2
    turn = product(pose[3:], q[root, 3:] * [1.0, -1.0, -1.0, -1.0])
    q[:, 3:] = product(turn, q[:, 3:])
    q[:, :3] = q[:, :3] @ rotation_matrices(turn).T
    q[:, :3] += pose[:3] - posture.center_of_mass(robot, q)
    return q


def moved(robot: Robot, pose: Array, h: float, at: Array, u: Array) -> Array:
    """Return ``pose + h F(at) u``, where `at` is the pose whose middle link turns, eq. (74)."""
    mass = robot.per_link('link_mass')
    turn = H_bar(at[3:]).T @ u[robot.link_count // 2, 3:] / 2
    return pose + h * np.append(mass @ u[:, :3] / mass.sum(), turn)


def end_of(robot: Robot, hat: Motion, h_q: float, at: Array, rate: Array, u: Array) -> Motion:
    """Return ``x_hat + h_q F(at) u``, eqs. (iii), (v), with Euler parameters of length 1."""
    pose = moved(robot, hat.pose, h_q, at, u)
    pose[3:] /= np.linalg.norm(pose[3:])
    return Motion(pose, hat.angle + h_q * rate, rate, u)


def chain_velocities(robot: Robot, R: Array, motion: Motion) -> Array:
    """
    Return the velocities (n, 6) that the joints allow, with the rates and the middle link of u*.

    The u* of other links fit the joints at the predicted end up to the error of prediction only.
    """
    n, root = robot.link_count, robot.link_count // 2
    arm = robot.per_link('link_length')[:, None] / 2 * R[:, :, 2]  # center to front joint
    turn = motion.rate[:, :1] * R[:-1, :, 1] + motion.rate[:, 1:] * R[1:, :, 0]
    omega = np.tile(R[root] @ motion.u[root, 3:], (n, 1))
    v = np.tile(motion.u[root, :3], (n, 1))
    for i in range(root + 1, n):
        omega[i] = omega[i - 1] + turn[i - 1]
        v[i] = v[i - 1] + cross(omega[i - 1], arm[i - 1]) + cross(omega[i], arm[i])
    for i in range(root - 1, -1, -1):
        omega[i] = omega[i + 1] - turn[i]
        v[i] = v[i + 1] - cross(omega[i + 1], arm[i + 1]) - cross(omega[i], arm[i])
    return np.hstack([v, np.einsum('iab,ia->ib', R, omega)])


def same(memory: Bdf2Memory, state: State) -> bool:
    """Return whether a state is the end of the last step."""
    return bool((memory.q == state.q).all() and (memory.end.u == state.u).all())


class Formula(NamedTuple):
    """What the states before say about a part, eqs. (i), (ii), (v), (vi)."""

    h: float  # time for which forces act on velocities [s]
    h_q: float  # time for which velocities act on coordinates [s]
    hat: Motion  # its rates are those of the start, and are not used
    star: Motion  # predicted end


def formula(robot: Robot, memory: Bdf2Memory, dt: float) -> Formula:
    """Return what the states before say about a part, eqs. (i), (ii), (v), (vi)."""
    A, B, phase = memory.end, memory.start, memory.phase[0]
    w = dt / memory.dt[0] if phase == SMOOTH else 0.0
    c, h = w**2 / (1 + 2 * w), dt * (1 + w) / (1 + 2 * w)
    hat = Motion(*(a + c * (a - b) for a, b in zip(A, B, strict=True)))
    half = dt / 2 if phase == ANEW else 0.0
    if phase == ANEW:
        pose = moved(robot, A.pose, half, A.pose, A.u)
        hat = hat._replace(pose=pose, angle=A.angle + half * A.rate)
    rate, u = A.rate + w * (A.rate - B.rate), A.u + w * (A.u - B.u)
    return Formula(h, h - half, hat, end_of(robot, hat, h - half, A.pose, rate, u))

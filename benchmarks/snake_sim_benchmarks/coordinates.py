# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Coordinates at the middle and at the end of a step of the paper, in dense NumPy."""

import numpy as np

from snake_sim_ros import State
from snake_sim_ros.dynamics import kinematics
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.rotations import product


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

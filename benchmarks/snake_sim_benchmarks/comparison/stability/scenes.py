# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Robots, states and errors that the scenes of several stability maps share."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from snake_sim_benchmarks.comparison.baselines.integrators import make_semi_implicit, Penalty
from snake_sim_benchmarks.comparison.stability.runs import Case
from snake_sim_ros.dynamics.force_directions import joint_directions, mass_matrix
from snake_sim_ros.scene.parameters import Array, load_scene, Robot, Scene
from snake_sim_ros.scene.posture import joint_angles
from snake_sim_ros.scene.rotations import about, product, rotation_matrices
from snake_sim_ros.stepping.base import Stepper
from snake_sim_ros.stepping.methods import METHODS
from snake_sim_ros.stepping.state import State
from snake_sim_ros.stepping.trajectory import Trajectory

G = 9.81  # m/s^2
WEIGHTLESS = (0.0, 0.0, 0.0)
FLYING_HEIGHT = 1.0  # m, so high that the robot does not touch the floor
AIKO = Robot()
MASS, LENGTH, RADIUS, OFFSET, THETA_1, THETA_3 = (
    float(AIKO.per_link(name)[0])
    for name in (
        'link_mass',
        'link_length',
        'contact_radius',
        'contact_offset',
        'inertia_transversal',
        'inertia_axial',
    )
)
CASE_A = load_scene('lateral_undulation')
CLOSED_DEPTH = 1e-9  # m, so that contacts are closed despite rounding
# For maps of contacts: this velocity counts as rest. Another map shows what solvers reach.
PRECISE_SOLVER = replace(CASE_A.solver, residual_tolerance=1e-6)


def with_method(scene: Scene, method: str) -> Scene:
    """Return the scene with the method and, if it is named, the scheme of the controller."""
    name, _, scheme = method.partition(' ')
    name = name if name in METHODS else 'newton'
    return replace(scene, method=name, level='spatial', pd_scheme=scheme or scene.pd_scheme)


def stepper_of(method: str, **penalty: Any) -> Callable[[Scene], Stepper] | None:
    """Return what makes the stepper of a baseline; None for a method of `methods.METHODS`."""
    if method != 'regularized':
        return None
    return partial(make_semi_implicit, penalty=Penalty(**penalty))


def kinetic_energy(robot: Robot, state: State) -> float:
    """Return the kinetic energy of a state [J]."""
    u = state.u.ravel()
    return float(0.5 * u @ (mass_matrix(robot) @ u))


def operator(robot: Robot, q: Array, W: Array) -> Array:
    """Return W^T M^-1 W with the joints eliminated, in a posture q of shape (n, 7)."""
    W_J = joint_directions(robot, rotation_matrices(q[:, 3:]))
    M_inv = 1.0 / np.diag(mass_matrix(robot))[:, None]
    G_J = W_J.T @ (M_inv * W)
    return np.asarray(W.T @ (M_inv * W) - G_J.T @ np.linalg.solve(W_J.T @ (M_inv * W_J), G_J))


def turned(q: Array, tilt: float) -> Array:
    """Return coordinates turned about y of I, front ends down by `tilt` [rad]."""
    turn = about(1, tilt)
    p = product(np.broadcast_to(turn, (len(q), 4)), q[:, 3:])
    return np.hstack([q[:, :3] @ rotation_matrices(turn).T, p])


def angle_error(case: Case, run: Trajectory, fine: Trajectory | None) -> float:
    """Return the largest error of a joint angle at the samples over the largest joint angle."""
    assert fine
    expected = joint_angles(fine.coordinates)
    return float(np.abs(joint_angles(run.coordinates) - expected).max() / np.abs(expected).max())


def position_error(case: Case, run: Trajectory, fine: Trajectory | None) -> float:
    """Return the largest error of the position of a link at the samples over the way it went."""
    assert fine
    way = np.linalg.norm(fine.position[-1] - fine.position[0], axis=-1).max()
    return float(np.linalg.norm(run.position - fine.position, axis=-1).max() / way)


def speed(case: Case, run: Trajectory, fine: Trajectory | None) -> float:
    """Return the largest speed of a link at the end [m/s]."""
    return float(np.linalg.norm(run.velocity[-1, :, :3], axis=-1).max())

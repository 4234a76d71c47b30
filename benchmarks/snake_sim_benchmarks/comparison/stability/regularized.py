# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Limits of regularized contact: stiff springs, and friction that is smooth at rest."""

from collections.abc import Sequence
from dataclasses import replace
import math
from typing import Any

import numpy as np

from snake_sim_benchmarks.comparison.baselines.integrators import Penalty
from snake_sim_benchmarks.comparison.stability.runs import Case
from snake_sim_benchmarks.comparison.stability.scenes import (
    AIKO,
    CLOSED_DEPTH,
    G,
    kinetic_energy,
    MASS,
    operator,
    PRECISE_SOLVER,
    stepper_of,
    with_method,
)
from snake_sim_ros.dynamics.force_directions import contact_directions
from snake_sim_ros.scene.parameters import Array, Friction, Scene
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.state import initial_state


def pushed(method: str, dt: float, v: Sequence[float], mu: float, **penalty: Any) -> Case:
    """Return three straight links that lie on the floor, pushed with a velocity."""
    robot, friction = replace(AIKO, link_count=3), Friction(longitudinal=mu, transversal=mu)
    scene = with_method(
        Scene(robot=robot, friction=friction, solver=PRECISE_SOLVER, dt=dt), method
    )
    state = initial_state(scene)
    sag = MASS * G / 2 / Penalty(**penalty).stiffness if penalty else CLOSED_DEPTH
    state.q[:, 2] -= sag
    state.u[:, :3] = v
    # A little motion in every mode; the links keep rolling at less than a micrometer a second.
    state.u[:, [2, 5]] += np.random.default_rng(1).normal(0.0, (1e-4, 1e-5), (3, 2))
    available = kinetic_energy(robot, state) + 3 * MASS * G * sag
    return Case(scene, state, 0.5, available, stepper_of(method, **penalty))


def pushed_down(method: str, dt: float, stiffness: float) -> Case:
    """Return a push into the floor, on springs of a stiffness, without friction."""
    return pushed(method, dt, (0.0, 0.0, -0.01), 0.0, stiffness=stiffness)


def pushed_along(method: str, dt: float, sliding_velocity: float) -> Case:
    """Return a push along the floor, with friction that is smooth below a sliding velocity."""
    return pushed(method, dt, (0.01, 0.0, 0.0), 0.5, sliding_velocity=sliding_velocity)


def lying_operator(direction: int) -> Array:
    """Return the Delassus operator of three straight links: 0 for normal, 1 for sliding."""
    robot = replace(AIKO, link_count=3)
    q = initial_state(Scene(robot=robot)).q
    W = contact_directions(robot, rotation_matrices(q[:, 3:]))[direction]
    return operator(robot, q, W)


def spring_limit(method: str, stiffness: float) -> float:
    """
    Return the largest stable time step of spring-dampers under three straight links [s].

    As of the joint controller at the middle: 4 - 2 c dt - w^2 dt^2 > 0 with w^2 = k g, c = d g,
    g the largest eigenvalue of the Delassus operator.
    """
    if method != 'regularized':
        return math.nan
    g = np.linalg.eigvalsh(lying_operator(0)).max()
    zeta = Penalty().damping_ratio
    ww, c = stiffness * g, 2 * zeta * math.sqrt(stiffness * MASS / 2) * g
    return float((math.sqrt(c**2 + 4 * ww) - c) / ww)


def smooth_limit(method: str, sliding_velocity: float) -> float:
    """
    Return the largest stable time step of smooth friction and springs under the same links [s].

    A force -c v that is known at the start takes c g dt of a velocity away: c g dt < 2, with the
    slope c = mu F_N/eps of friction at rest, g the largest eigenvalue in sliding direction.
    """
    if method != 'regularized':
        return math.nan
    slope = 0.5 * MASS * G / 2 / sliding_velocity
    limit = 2 / (slope * np.linalg.eigvalsh(lying_operator(1)).max())
    return float(min(limit, spring_limit(method, Penalty().stiffness)))

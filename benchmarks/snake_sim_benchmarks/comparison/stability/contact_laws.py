# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Limits of the solvers of contact laws: friction, prox parameters, mass ratios."""

from dataclasses import replace
import math
from typing import Any

import numpy as np

from snake_sim_benchmarks.comparison.stability.runs import Case
from snake_sim_benchmarks.comparison.stability.scenes import (
    AIKO,
    CASE_A,
    CLOSED_DEPTH,
    G,
    LENGTH,
    MASS,
    operator,
    PRECISE_SOLVER,
    RADIUS,
    speed,
    stepper_of,
    with_method,
)
from snake_sim_ros.dynamics.force_directions import contact_directions
from snake_sim_ros.scene.parameters import Robot, Scene, with_settings
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.state import initial_state
from snake_sim_ros.stepping.trajectory import Trajectory


def undulating(method: str, dt: float, mu: float) -> Case:
    """Return case A with another friction across the links."""
    friction = replace(CASE_A.friction, transversal=mu)
    scene = with_method(replace(CASE_A, friction=friction, solver=PRECISE_SOLVER, dt=dt), method)
    return Case(scene, initial_state(scene), 0.5, make=stepper_of(method))


def prox_robot(size: float) -> Robot:
    """Return one link with inertias of cylinders `size` times as thick as the link."""
    m, L, r = MASS, LENGTH, size * RADIUS
    return replace(
        AIKO,
        link_count=1,
        inertia_transversal=m * (3 * r**2 + L**2) / 12,
        inertia_axial=m * r**2 / 2,
    )


def sticking(method: str, factor: float, size: float) -> Case:
    """
    Return one link on a slope on which it sticks, with prox parameters times a factor.

    It is one link because its contacts are not redundant, so that all of them carry load.
    """
    r = CASE_A.solver
    solver = replace(
        r, r_normal=factor * r.r_normal, r_sliding=factor * r.r_sliding, normal_compliance=0.0
    )
    slope = (G * math.sin(0.03), 0.0, -G * math.cos(0.03))
    scene = replace(CASE_A, robot=prox_robot(size), solver=solver, gravity=slope)
    scene = with_settings(with_method(scene, method), {'gait.yaw.angular_frequency': 0.0})
    state = initial_state(scene)
    state.q[:, 2] -= CLOSED_DEPTH
    state.u[:] = np.random.default_rng(1).normal(0.0, 1e-5, state.u.shape)  # every mode of G
    fall = G * 20 * scene.dt
    return Case(scene, state, 20 * scene.dt, 0.5 * MASS * fall**2)


def prox_limit(method: str, size: float) -> float:
    """Return the factor on r at which r lambda_max of the Delassus operator is 2, for `paper`."""
    if method != 'paper':
        return math.nan
    scene = sticking(method, 1.0, size).scene
    q = initial_state(scene).q
    W_N, W_T, _ = contact_directions(scene.robot, rotation_matrices(q[:, 3:]))
    r = np.sqrt(
        np.repeat([scene.solver.r_normal, scene.solver.r_sliding], [W_N.shape[1], W_T.shape[1]])
    )
    W = np.hstack([W_N, W_T]) * r
    return float(2 / np.linalg.eigvalsh(operator(scene.robot, q, W)).max())


def heavy(method: str, ratio: float, links: float) -> Case:
    """Return a straight robot at rest whose middle link is heavier than the others."""
    n = round(links)
    factor = np.where(np.arange(n) == n // 2, ratio, 1.0)
    names = ('link_mass', 'inertia_transversal', 'inertia_axial')
    lists: dict[str, Any] = {name: tuple(factor * getattr(AIKO, name)) for name in names}
    robot = Robot(link_count=n, **lists)
    scene = with_method(
        Scene(robot=robot, friction=CASE_A.friction, solver=PRECISE_SOLVER), method
    )
    state = initial_state(scene)
    state.q[:, 2] -= CLOSED_DEPTH
    fall = G * 10 * scene.dt
    return Case(scene, state, 10 * scene.dt, 0.5 * sum(lists['link_mass']) * fall**2)


def sinking(case: Case, run: Trajectory, fine: Trajectory | None) -> float:
    """Return the largest speed of a link at the end over that of a free fall."""
    return speed(case, run, fine) / (G * case.duration)

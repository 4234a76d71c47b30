# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Limits of the joint controller, in flight and on the ground."""

from dataclasses import replace
import math
from typing import Any

import numpy as np

from snake_sim_benchmarks.comparison.stability.runs import Case
from snake_sim_benchmarks.comparison.stability.scenes import (
    AIKO,
    CASE_A,
    FLYING_HEIGHT,
    kinetic_energy,
    operator,
    WEIGHTLESS,
    with_method,
)
from snake_sim_ros.dynamics.force_directions import torque_directions
from snake_sim_ros.scene.parameters import Robot, Scene
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.state import initial_state, State


def flying(scene: Scene) -> State:
    """Return the straight robot in the air; it bends slowly, and a little in all of its modes."""
    state, n = initial_state(scene), scene.robot.link_count
    state.q[:, 2] += FLYING_HEIGHT
    slow = 0.1 * np.cos(math.pi * np.arange(n) / (n - 1))
    state.u[:, 3:5] = slow[:, None] + np.random.default_rng(1).normal(0.0, 1e-4, (n, 2))
    return state


def in_flight(method: str, dt: float, **gains: Any) -> Case:
    """Return Aiko in weightless flight, with joints that are to stay straight, pushed a little."""
    robot = replace(AIKO, **gains)
    scene = with_method(Scene(robot=robot, gravity=WEIGHTLESS, dt=dt), method)
    start = flying(scene)
    return Case(scene, start, 0.5, kinetic_energy(robot, start))


def on_the_ground(method: str, dt: float, **gains: Any) -> Case:
    """Return case A, lateral undulation, with other gains."""
    scene = with_method(replace(CASE_A, robot=replace(AIKO, **gains), dt=dt), method)
    return Case(scene, initial_state(scene), 0.5)


def control_limit(method: str, robot: Robot) -> float:
    """
    Return the largest stable time step of a scheme of the joint controller in flight [s].

    One mode with w^2 = K_p g and c = K_d g, g an eigenvalue of the mobility of the joint axes. The
    step has determinant 1 - c dt + w^2 dt^2/2 and trace 2 - c dt - w^2 dt^2/2 for `start`, so that
    dt < 2 K_d/K_p and c dt < 2; 1 - c dt and 2 - c dt - w^2 dt^2 for `midpoint`, so that
    4 - 2 c dt - w^2 dt^2 > 0. The implicit schemes have no limit.
    """
    scheme = method.partition(' ')[2]
    if scheme not in ('start', 'midpoint'):
        return math.nan
    state = flying(Scene(robot=robot))
    W_tau = torque_directions(rotation_matrices(state.q[:, 3:]))
    mobility = operator(robot, state.q, W_tau)
    limits = []
    for axis, name in enumerate(('yaw', 'pitch')):
        g = np.linalg.eigvalsh(mobility[axis::2, axis::2]).max()
        K_p, K_d = getattr(robot, f'{name}_stiffness'), getattr(robot, f'{name}_damping')
        ww, c = K_p * g, K_d * g
        limits.append((math.sqrt(c**2 + 4 * ww) - c) / ww)
        if scheme == 'start':
            limits[-1] = min(2 * K_d / K_p, 2 / c)
    return float(min(limits))

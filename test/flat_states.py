# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Flat robots and their states, for tests of the planar level."""

from dataclasses import replace

import numpy as np
from random_states import random_robot

from snake_sim_ros import Robot, State
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.posture import chain_coordinates
from snake_sim_ros.scene.rotations import about, product, rotation_matrices


def flat_robot(rng: np.random.Generator, link_count: int) -> Robot:
    """Return a robot of unequal links and joints with one contact radius, so that it lies flat."""
    n = link_count - 1
    return replace(
        random_robot(rng, link_count),
        contact_radius=0.05,
        yaw_stiffness=tuple(rng.uniform(10, 100, n)),
        pitch_stiffness=tuple(rng.uniform(100, 800, n)),
        yaw_damping=tuple(rng.uniform(0.1, 0.3, n)),
        pitch_damping=tuple(rng.uniform(0.1, 0.3, n)),
    )


def headings(q: Array) -> Array:
    """Return the headings of all links [rad], shape (n,)."""
    e_z = rotation_matrices(q[:, 3:])[:, :, 2]
    return np.arctan2(e_z[:, 1], e_z[:, 0])


def lying_flat(robot: Robot, yaw: Array, heading: float = 0.0) -> Array:
    """Return coordinates (n, 7) of a flat robot with given yaw angles (n-1,)."""
    q = chain_coordinates(robot, np.column_stack([yaw, np.zeros(len(yaw))]))
    turn = about(2, heading)
    q[:, :3] = q[:, :3] @ rotation_matrices(turn).T
    q[:, 3:] = product(turn, q[:, 3:])
    q[:, 2] = robot.per_link('contact_radius')
    return q


def in_plane(robot: Robot, q: Array, velocity: Array, spin: Array) -> State:
    """Return a state of links that turn at rates `spin` (n,); link 1 moves at `velocity` (2,)."""
    theta, half = headings(q), robot.per_link('link_length') / 2
    u = np.zeros((robot.link_count, 6))
    reach = (half * spin)[:, None] * np.column_stack([-np.sin(theta), np.cos(theta)])
    u[:, :2] = velocity + np.cumsum(reach, axis=0) - reach[0]
    u[1:, :2] += np.cumsum(reach, axis=0)[:-1]
    u[:, 3:] = rotation_matrices(q[:, 3:])[:, 2] * spin[:, None]
    return State(q, u)


def crooked(rng: np.random.Generator, robot: Robot, speed: float = 1.0) -> State:
    """Return a bent robot that slides and turns; bent one way, so that nothing makes it roll."""
    n = robot.link_count
    q = lying_flat(robot, rng.uniform(0.2, 0.5, n - 1), rng.uniform(-3.0, 3.0))
    spin = rng.uniform(-1.0, 1.0, n) * speed
    return in_plane(robot, q, rng.uniform(-0.5, 0.5, 2) * speed, spin)

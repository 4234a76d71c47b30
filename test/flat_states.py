# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Flat robots and their states, for tests of the planar level."""

from dataclasses import replace

import numpy as np
from random_states import random_robot

from snake_sim_ros import Joint, Link, Robot, Shape, State
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.posture import chain_coordinates
from snake_sim_ros.scene.rotations import about, product, rotation_matrices
from snake_sim_ros.stepping.planar.model import flat_heights


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


def flat_modules(rng: np.random.Generator, link_count: int, *, yaw: float = 0.5) -> Robot:
    """
    Return a robot of modules that lies flat: masses up to 3 times each other, any inertia.

    Joints and centers of mass are 3 cm above the floor, anywhere along a module. It has one sphere
    or two of any radius. A joint turns about the upright axis, with the probability `yaw`, or
    about the one across the module; every fifth has both axes, and every third one is upside down.
    """
    high, links, joints = 0.03, [], []
    for i in range(link_count):
        center, radii = rng.uniform(0.025, 0.04), rng.uniform(0.01, 0.03, rng.integers(1, 3))
        ends = (rng.uniform(0.01, 0.02), rng.uniform(-0.02, -0.01)) if len(radii) > 1 else (0.002,)
        links.append(
            Link(
                name=f'module_{i}',
                mass=rng.uniform(0.2, 0.6),
                center_of_mass=(center, 0.0, 0.0),
                inertia=(*(rng.uniform(0.6, 1.0, 3) * 1e-4), 0.0, 0.0, 0.0),
                shapes=tuple(
                    Shape(radius=radius, start=(center + end, 0.0, radius - high))
                    for radius, end in zip(radii, ends, strict=True)
                ),
            )
        )
    for j in range(link_count - 1):
        upright = rng.uniform() < yaw
        axis = np.array([0.0, 0.0, 1.0]) if upright or j % 5 == 4 else np.array([0.0, 1.0, 0.0])
        joints.append(
            Joint(
                name=f'servo_{j}',
                origin=(rng.uniform(0.06, 0.07), 0.0, 0.0),
                axis=tuple(-axis if j % 3 == 2 else axis),
                second_axis=(0.0, 1.0, 0.0) if j % 5 == 4 else None,
            )
        )
    gains = {'yaw_stiffness': 20.0, 'pitch_stiffness': tuple(rng.uniform(50, 200, len(joints)))}
    return Robot(links=tuple(links), joints=tuple(joints), **gains)


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
    q[:, 2] = flat_heights(robot)
    return q


def in_plane(robot: Robot, q: Array, velocity: Array, spin: Array) -> State:
    """Return a state of links that turn at rates `spin` (n,); link 1 moves at `velocity` (2,)."""
    theta, places = headings(q), robot.chain.places
    u = np.zeros((robot.link_count, 6))
    turning = spin[:, None] * np.column_stack([-np.sin(theta), np.cos(theta)])
    front, rear = places.distal[:, 2:] * turning, -places.proximal[:, 2:] * turning
    u[:, :2] = velocity + np.cumsum(rear, axis=0) - rear[0]
    u[1:, :2] += np.cumsum(front, axis=0)[:-1]
    u[:, 3:] = rotation_matrices(q[:, 3:])[:, 2] * spin[:, None]
    return State(q, u)


def crooked(rng: np.random.Generator, robot: Robot, speed: float = 1.0) -> State:
    """Return a bent robot that slides and turns; bent one way, so that nothing makes it roll."""
    n = robot.link_count
    q = lying_flat(robot, rng.uniform(0.2, 0.5, n - 1), rng.uniform(-3.0, 3.0))
    spin = rng.uniform(-1.0, 1.0, n) * speed
    for j in np.flatnonzero(robot.chain.places.present[:, 0] == 0.0):
        spin[j + 1] = spin[j]
    return in_plane(robot, q, rng.uniform(-0.5, 0.5, 2) * speed, spin)

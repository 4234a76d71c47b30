# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Random robots and states, and the exact motion of free links, for tests of single relations."""

import numpy as np

from snake_sim_ros import Joint, Link, Robot, Shape, State
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.posture import chain_coordinates
from snake_sim_ros.scene.rotations import product, rotation_matrices

E_X = np.array([1.0, 0.0, 0.0])
EPS = np.finfo(float).eps


def random_parameters(rng: np.random.Generator, count: int) -> Array:
    """Return Euler parameters of length 1, evenly spread over all rotations, shape (count, 4)."""
    p = rng.standard_normal((count, 4))
    return p / np.linalg.norm(p, axis=1)[:, None]


def random_robot(rng: np.random.Generator, link_count: int) -> Robot:
    """Return a robot like Aiko, every quantity of every link within 20 % of it."""
    names = ('link_length', 'link_mass', 'inertia_transversal', 'inertia_axial')
    names += ('contact_offset', 'contact_radius')
    aiko = Robot()
    values = {
        name: tuple(getattr(aiko, name) * rng.uniform(0.8, 1.2, link_count)) for name in names
    }
    return Robot(link_count=link_count, **values)


def random_chain(rng: np.random.Generator, link_count: int, two_axes: float = 0.3) -> Robot:
    """
    Return a robot of any links and joints: masses up to 9 times each other, axes in any direction.

    A link is about 0.1 m long along x of its frame, and has one or two capsules that touch the
    world.
    A joint has one axis, or two with the probability `two_axes`.
    """
    links, joints = [], []
    for i in range(link_count):
        turn = rotation_matrices(random_parameters(rng, 1))[0]
        tensor = turn @ np.diag(rng.uniform(0.5, 0.9, 3) * 1e-3) @ turn.T
        inertia = [*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2]]
        shapes = [
            Shape(
                radius=rng.uniform(0.02, 0.05),
                start=tuple(rng.uniform(-0.02, 0.02, 3)),
                end=tuple(rng.uniform(-0.02, 0.02, 3) + 0.1 * E_X),
            )
            for _ in range(rng.integers(1, 3))
        ]
        links.append(
            Link(
                name=f'part_{i}',
                mass=rng.uniform(0.2, 1.8),
                center_of_mass=tuple(rng.uniform(-0.02, 0.02, 3) + 0.05 * E_X),
                inertia=tuple(inertia),
                shapes=tuple(shapes),
                friction=rng.uniform(0.5, 1.5),
            )
        )
    for j in range(link_count - 1):
        axis = rng.standard_normal(3)
        second = tuple(np.cross(axis, rng.standard_normal(3)))
        joints.append(
            Joint(
                name=f'hinge_{j}',
                origin=tuple(rng.uniform(-0.01, 0.01, 3) + 0.1 * E_X),
                rotation=tuple(rng.uniform(-0.3, 0.3, 3)),
                axis=tuple(axis),
                second_axis=second if rng.uniform() < two_axes else None,
            )
        )
    return Robot(links=tuple(links), joints=tuple(joints))


def random_velocities(rng: np.random.Generator, link_count: int) -> Array:
    """Return up to 1 m/s and 2 rad/s in every component, joints or not, shape (n, 6)."""
    return rng.uniform(-1.0, 1.0, (link_count, 6)) * [1.0, 1.0, 1.0, 2.0, 2.0, 2.0]


def free_links(rng: np.random.Generator, link_count: int) -> State:
    """Return links anywhere in a cube of 2 m, with any orientation and no regard to the joints."""
    position = rng.uniform(-1.0, 1.0, (link_count, 3))
    q = np.hstack([position, random_parameters(rng, link_count)])
    return State(q, random_velocities(rng, link_count))


def jointed_links(rng: np.random.Generator, robot: Robot, angle: Array) -> State:
    """Return a robot with given joint angles (n-1, 2) in any orientation, link 1 at the origin."""
    q = chain_coordinates(robot, angle)
    turn = random_parameters(rng, 1)[0]
    q[:, :3] = q[:, :3] @ rotation_matrices(turn).T
    q[:, 3:] = product(turn, q[:, 3:])
    return State(q, random_velocities(rng, robot.link_count))


def moved(state: State, time: float) -> Array:
    """
    Return where constant u take every link in a given time, exactly, shape (n, 7).

    A constant omega in B turns by the Euler parameters (cos(a/2), sin(a/2) omega/|omega|) from the
    right, a = |omega| t.
    """
    v, omega = state.u[:, :3], state.u[:, 3:]
    speed = np.linalg.norm(omega, axis=1)[:, None]
    half = speed * time / 2
    turn = np.hstack([np.cos(half), np.sin(half) * omega / speed])
    return np.hstack([state.q[:, :3] + time * v, product(state.q[:, 3:], turn)])


def rate_of(function, state: State, step: float = 1e-5) -> Array:
    """Return the central difference of function(q) along the exact motion of the links."""
    return (function(moved(state, step)) - function(moved(state, -step))) / (2 * step)

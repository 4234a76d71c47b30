# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Two links that turn against each other, for tests of what acts on a joint."""

import numpy as np

from snake_sim_ros import Joint, Link, Robot, Scene, Shape, Solver, State
from snake_sim_ros.scene.chain import LARGEST_ANGLE
from snake_sim_ros.scene.posture import chain_coordinates, joint_angles, joint_rates
from snake_sim_ros.stepping.methods import METHODS

AXES = {'yaw': 0, 'pitch': 1}
ALONG = {'yaw': (0.0, 0.0, 1.0), 'pitch': (0.0, 1.0, 0.0)}  # in frames with x forward
INERTIA = 1e-3  # of a link of `balls` [kg m^2]
EVERY = [(method, axis) for method in METHODS for axis in AXES]
DT = 1e-3


def floating(method: str, **robot: object) -> Scene:
    """Return two links without gravity, whose joints no controller holds unless it is given."""
    free = dict.fromkeys(('yaw_stiffness', 'yaw_damping', 'pitch_stiffness', 'pitch_damping'), 0.0)
    return Scene(
        robot=Robot(link_count=2, joint_limit=0.5, **free | robot),
        gravity=(0.0, 0.0, 0.0), method=method, dt=DT, level='spatial',
        solver=Solver(tolerance=1e-13),
    )  # fmt: skip


def balls(
    method: str, *axes: str, sign: float = 1.0, limits: dict | None = None, **robot: object
) -> Scene:
    """
    Return two balls at one point whose joint has one axis or two, without gravity and controller.

    With one axis nothing but the joint angle changes, by ``angle'' = 2 torque/INERTIA, however far
    the joint is bent. The limits are those of `Joint`, the sign -1 turns the axes around.
    """
    free = dict.fromkeys(('yaw_stiffness', 'yaw_damping', 'pitch_stiffness', 'pitch_damping'), 0.0)
    first, *second = (tuple(sign * x for x in ALONG[axis]) for axis in axes)
    joint = Joint(
        name='j', axis=first, **dict(zip(['second_axis'], second, strict=False)), **(limits or {})
    )
    links = tuple(
        Link(name=name, inertia=(INERTIA,) * 3 + (0.0,) * 3, shapes=(Shape(),)) for name in 'ab'
    )
    return Scene(
        robot=Robot(links=links, joints=(joint,), **{'joint_limit': LARGEST_ANGLE} | free | robot),
        gravity=(0.0, 0.0, 0.0), method=method, dt=DT, level='spatial',
        solver=Solver(tolerance=1e-13),
    )  # fmt: skip


def hinge(scene: Scene, axis: str, rate: float) -> State:
    """
    Return a straight robot of two links whose links turn against each other, 1 m above the floor.

    The centers of the links do not move across it: each link turns about its own center.
    """
    q = chain_coordinates(scene.robot, np.zeros((1, 2)))
    q[:, 2] += 1.0
    u = np.zeros((2, 6))
    column = 4 if axis == 'yaw' else 3  # e_y is up, and e_x across
    u[:, column] = -rate / 2, rate / 2
    if joint_rates(q, u)[0, AXES[axis]] * rate < 0.0:
        u[:, column] *= -1.0
    return State(q, u)


def of_joint(state: State, axis: str) -> tuple[float, float]:
    """Return angle and rate of the joint."""
    k = AXES[axis]
    return joint_angles(state.q)[0, k], joint_rates(state.q, state.u)[0, k]

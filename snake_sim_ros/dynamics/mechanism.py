# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The numbers of a robot as compiled functions take them, from this room upward."""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from snake_sim_ros.dynamics.joint_control import ControlLoop, make_control_loop
from snake_sim_ros.dynamics.joint_laws import JointLaws, make_joint_laws
from snake_sim_ros.scene.parameters import Array, PD_SCHEMES, Robot, Scene


class Mechanism(NamedTuple):
    """The links and joints of a robot of n links, with the names of `scene.parameters.Robot`."""

    half_length: Array  # (n,) half of the link lengths [m]
    mass: Array  # (n,) [kg]
    inertia_transversal: Array  # (n,) [kg m^2]
    inertia_axial: Array  # (n,) [kg m^2]
    contact_offset: Array  # (n,) [m]
    contact_radius: Array  # (n,) [m]
    stiffness: Array  # (n-1, 2) of the joints (yaw, pitch) [N m/rad]
    damping: Array  # (n-1, 2) [N m s/rad]
    joint_laws: JointLaws  # of all axes
    control: ControlLoop
    pd_scheme: int  # index in PD_SCHEMES
    gravity: Array  # (3,) in I [m/s^2]


@lru_cache(maxsize=64)
def robot_arrays(robot: Robot) -> dict[str, Any]:
    """Return the fields of a mechanism that belong to its robot; mechanisms share them."""
    links = ('inertia_transversal', 'inertia_axial', 'contact_offset', 'contact_radius')
    return {
        'half_length': robot.per_link('link_length') / 2,
        'mass': robot.per_link('link_mass'),
        **{name: robot.per_link(name) for name in links},
        **{name: robot.per_joint(name) for name in ('stiffness', 'damping')},
        'joint_laws': make_joint_laws(robot),
    }


def make_mechanism(scene: Scene) -> Mechanism:
    """Return the mechanism of a scene; its arrays must not be changed."""
    return Mechanism(
        **robot_arrays(scene.robot),
        control=make_control_loop(scene),
        pd_scheme=PD_SCHEMES.index(scene.pd_scheme),
        gravity=np.array(scene.gravity),
    )

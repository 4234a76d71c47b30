# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The numbers of a robot as compiled functions take them, from this room upward."""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from snake_sim_ros.dynamics.joint_control import ControlLoop, make_control_loop
from snake_sim_ros.dynamics.joint_laws import JointLaws, make_joint_laws
from snake_sim_ros.scene.chain import Capsules, JointPlaces, Spheres
from snake_sim_ros.scene.parameters import Array, PD_SCHEMES, Robot, Scene


class Mechanism(NamedTuple):
    """The links and joints of a robot of n links, with the names of `scene.parameters.Robot`."""

    places: JointPlaces  # of the joints in the links
    mass: Array  # (n,) [kg]
    inertia_transversal: Array  # (n,) about e_x and e_y of a link [kg m^2]
    inertia_axial: Array  # (n,) about e_z [kg m^2]
    slender: bool  # whether this is all of the inertia
    uneven: Array  # (n, 3, 3) what the inertia of a link has besides, in its frame [kg m^2]
    spheres: Spheres  # of the links, which touch the ground and each other
    capsules: Capsules  # of the links, which touch pegs
    stiffness: Array  # (n-1, 2) of the joints (yaw, pitch) [N m/rad]
    damping: Array  # (n-1, 2) [N m s/rad]
    joint_laws: JointLaws  # of all axes
    control: ControlLoop  # around the controllers of the joints
    pd_scheme: int  # index in PD_SCHEMES
    gravity: Array  # (3,) in I [m/s^2]


@lru_cache(maxsize=64)
def robot_arrays(robot: Robot) -> dict[str, Any]:
    """Return the fields of a mechanism that belong to its robot; mechanisms share them."""
    chain = robot.chain
    across = 0.5 * (chain.inertia[:, 0, 0] + chain.inertia[:, 1, 1])
    axial = chain.inertia[:, 2, 2].copy()
    uneven = chain.inertia - np.array([np.diag(each) for each in np.c_[across, across, axial]])
    return {
        'places': chain.places,
        'mass': chain.mass,
        'inertia_transversal': across,
        'inertia_axial': axial,
        'slender': not uneven.any(),
        'uneven': uneven,
        'spheres': chain.spheres,
        'capsules': chain.capsules,
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

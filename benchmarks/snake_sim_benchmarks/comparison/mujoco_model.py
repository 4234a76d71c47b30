# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The robot of a scene as an MJCF model of MuJoCo, with the settings that a user can choose.

The contacts of MuJoCo are soft on purpose: friction grows with a velocity and the normal force
with a depth, so that a robot on a slope creeps and a robot at rest has sunk into the floor. Its
model therefore differs from the paper's, and comes closer to it the stiffer the contacts are. It
has minimal coordinates, so that its joints have no gaps.

MuJoCo is an optional dependency and is imported only when a function needs it.
"""

from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

import numpy as np

from snake_sim_benchmarks.comparison.mujoco_contacts import BY_HAND, CONTACT_MODELS, ContactModel
from snake_sim_ros.scene import obstacles
from snake_sim_ros.scene.checked_records import CheckedRecord, ParameterError, quantity
from snake_sim_ros.scene.parameters import Array, Robot, Scene
from snake_sim_ros.scene.posture import initial_coordinates, joint_angles
from snake_sim_ros.scene.robot_description import element

DRIVES = ('torque', 'position', 'spring')
INTEGRATORS = ('Euler', 'implicit', 'implicitfast', 'RK4', 'discrete')
CONES = ('elliptic', 'pyramidal')
CONTACTS = tuple(BY_HAND)
GAINS = ('stiffness', 'damping')


@dataclass(frozen=True, kw_only=True)
class MujocoSettings(CheckedRecord):
    """
    Settings that a user of MuJoCo can choose for the robot of a scene.

    All drives have the same law, K_p (reference - angle) + K_d (reference rate - rate), but
    different parts of MuJoCo compute it: for `torque` it is the caller before a step, like any
    controller, for `position` an affine actuator, and for `spring` a spring and a damper in the
    joint. The integrator determines how much of the last two is implicit.
    """

    drive: str = quantity('spring', '', 'what computes the joint torques', choices=DRIVES)
    integrator: str = quantity('discrete', '', "MuJoCo's integrator", choices=INTEGRATORS)
    cone: str = quantity('elliptic', '', 'shape of the friction cone', choices=CONES)
    contact: str = quantity(
        'accurate',
        '',
        "MuJoCo's own contacts and solver, or chosen ones",
        choices=tuple(CONTACT_MODELS),
    )

    @property
    def contact_model(self) -> ContactModel:
        """The contact model of this name."""
        return CONTACT_MODELS[self.contact]


def import_mujoco() -> Any:
    """Return the module `mujoco`; raise ParameterError if it is not installed."""
    try:
        import mujoco
    except ImportError:
        raise ParameterError(
            'MuJoCo is not installed: pip install "snake_sim_ros[peers]"'
        ) from None
    return mujoco


def tree_order(link_count: int) -> tuple[Array, Array]:
    """
    Return links and joint axes in the order in which MuJoCo has their coordinates.

    The tree has its root at the middle link, from which one arm goes to the last link and then one
    to the first. This makes it half as deep as one with its root at an end.

    Returns
    -------
    links : ndarray of int, shape (n,)
        Counted along the robot.
    axes : ndarray of int, shape (2(n-1),)
        Counted along the robot, yaw before pitch; the arm to the first link has pitch first.

    """
    middle = Robot(link_count=link_count).middle_link
    ahead, behind = np.arange(middle, link_count - 1), np.arange(middle)[::-1]
    links = np.concatenate([[middle], ahead + 1, behind])
    forward = np.column_stack([2 * ahead, 2 * ahead + 1])
    backward = np.column_stack([2 * behind + 1, 2 * behind])
    return links, np.concatenate([forward.ravel(), backward.ravel()])


def mjcf(scene: Scene, settings: MujocoSettings) -> str:
    """
    Return the robot of a scene on its floor as an MJCF model, with the start as its key frame.

    Bodies have the frames B of the links, in the order of `tree_order`. The hinges of a joint are
    yaw and pitch as in `posture.joint_angles`: about e_y of a link, then about e_x of the next
    one; from the middle to the first link it is the other way round, with axes reversed. The floor
    is a plane and the links are capsules, which touch at the contact points of the paper. MuJoCo
    puts the first tangent of such a contact along the capsule.

    Raises
    ------
    ParameterError
        If there are obstacles on the floor, if there is rolling friction, which MuJoCo measures
        in other units, or if a link has no contact radius.

    """
    _refuse_what_mujoco_has_not(scene)
    root = ElementTree.Element('mujoco')
    element(root, 'compiler', angle='radian', autolimits='true')
    contacts = settings.contact_model
    options = element(root, 'option', gravity=scene.gravity, timestep=scene.dt,
                      integrator=settings.integrator,
                      **contacts.options(settings.cone))  # fmt: skip
    if flags := contacts.flags():
        element(options, 'flag', **flags)
    shortest = 1.0 if settings.integrator == 'discrete' else 2.0
    pair = contacts.pair(scene.dt, shortest)
    world = element(root, 'worldbody')
    element(world, 'geom', name='floor', type='plane', size=(0, 0, 1), contype=0, conaffinity=0)
    contact, actuator = element(root, 'contact'), element(root, 'actuator')
    q, (links, axes) = initial_coordinates(scene), tree_order(scene.robot.link_count)
    middle, bodies = links[0], dict[int, ElementTree.Element]()
    for i in links:
        if i == middle:
            body = element(world, 'body', pos=q[i, :3], quat=q[i, 3:])
            element(body, 'freejoint')
        else:
            parent = i - 1 if i > middle else i + 1
            body = _jointed_body(bodies[parent], actuator, scene, settings.drive, i, parent)
        bodies[i] = body
        _add_link(body, scene.robot, i)
        element(contact, 'pair', geom1='floor', geom2=f'link{i}', condim=3,
                 friction=(scene.friction.longitudinal, scene.friction.transversal),
                 **pair)  # fmt: skip
    start = np.concatenate([q[middle], joint_angles(q).ravel()[axes]])
    element(element(root, 'keyframe'), 'key', name='start', qpos=start)
    return ElementTree.tostring(root, encoding='unicode')


def _refuse_what_mujoco_has_not(scene: Scene) -> None:
    """Raise an error for a scene with more than a flat floor, or with links that are points."""
    if not obstacles.is_flat(scene) or scene.friction.rolling:
        got = (
            f'friction.rolling={scene.friction.rolling:g}' if obstacles.is_flat(scene) else 'more'
        )
        raise ParameterError(f'MuJoCo gets a flat floor without rolling friction only, got {got}')
    radius, offset = (scene.robot.per_link(name) for name in ('contact_radius', 'contact_offset'))
    if not min(radius.min(), offset.min()) > 0:
        raise ParameterError(
            f'contact_radius and contact_offset must be above 0 m for MuJoCo, got '
            f'{radius.min():g} m and {offset.min():g} m'
        )


def _add_link(body: ElementTree.Element, robot: Robot, i: int) -> None:
    """Append mass and shape of link i to its body."""
    across, along, mass, radius, offset = (
        robot.per_link(name)[i]
        for name in ('inertia_transversal', 'inertia_axial', 'link_mass', 'contact_radius',
                     'contact_offset')
    )  # fmt: skip
    element(body, 'inertial', pos=(0, 0, 0), mass=mass, diaginertia=(across, across, along))
    element(body, 'geom', name=f'link{i}', type='capsule', size=(radius, offset),
             contype=0, conaffinity=0)  # fmt: skip


def _jointed_body(
    parent: ElementTree.Element,
    actuator: ElementTree.Element,
    scene: Scene,
    drive: str,
    i: int,
    other: int,
) -> ElementTree.Element:
    """Append link i to its parent, link `other`: a body with two hinges and their drives."""
    half, side, joint = scene.robot.per_link('link_length') / 2, i - other, min(i, other)
    body = element(parent, 'body', pos=(0, 0, side * (half[other] + half[i])))
    gains = zip(*(scene.robot.per_joint(name)[joint] for name in GAINS), strict=True)
    hinges = list(zip(('yaw', 'pitch'), ((0, side, 0), (side, 0, 0)), gains, strict=True))
    for axis, vector, (K_p, K_d) in hinges[::side]:
        name = f'{axis}{joint}'
        passive = {'stiffness': K_p, 'damping': K_d} if drive == 'spring' else {}
        element(body, 'joint', name=name, type='hinge', pos=(0, 0, -side * half[i]), axis=vector,
                **passive)  # fmt: skip
        affine = {'biastype': 'affine', 'biasprm': (0, -K_p, -K_d)} if drive == 'position' else {}
        element(actuator, 'general', joint=name, **affine)
    return body

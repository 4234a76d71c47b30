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

from snake_sim_ros.scene import obstacles
from snake_sim_ros.scene.checked_records import CheckedRecord
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.checked_records import quantity
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.posture import initial_coordinates
from snake_sim_ros.scene.posture import joint_angles
from snake_sim_ros.scene.robot_description import element

DRIVES = ('torque', 'position', 'spring')
INTEGRATORS = ('Euler', 'implicit', 'implicitfast', 'RK4', 'discrete')
CONES = ('elliptic', 'pyramidal')
CONTACTS = ('default', 'accurate', 'fast')
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
        'accurate', '', "MuJoCo's own contacts and solver, or chosen ones", choices=CONTACTS
    )


def import_mujoco() -> Any:
    """Return the module `mujoco`; raise ParameterError if it is not installed."""
    try:
        import mujoco
    except ImportError:
        raise ParameterError(
            'MuJoCo is not installed: pip install "snake_sim_ros[peers]"'
        ) from None
    return mujoco


def mjcf(scene: Scene, settings: MujocoSettings) -> str:
    """
    Return the robot of a scene on its floor as an MJCF model, with the start as its key frame.

    Bodies have the frames B of the links. The hinges of a joint are yaw and pitch as in
    `posture.joint_angles`: about e_y of a link, then about e_x of the next one. The floor is a
    plane and the links are capsules, which touch at the contact points of the paper. MuJoCo puts
    the first tangent of such a contact along the capsule.

    Raises
    ------
    ParameterError
        If there are obstacles on the floor, if there is rolling friction, which MuJoCo measures
        in other units, or if a link has no contact radius.

    """
    if not obstacles.is_flat(scene) or scene.friction.rolling:
        got = (
            f'friction.rolling={scene.friction.rolling:g}' if obstacles.is_flat(scene) else 'more'
        )
        raise ParameterError(f'MuJoCo gets a flat floor without rolling friction only, got {got}')
    robot = scene.robot
    lengths = [
        robot.per_link(name) for name in ('link_length', 'contact_radius', 'contact_offset')
    ]
    if not min(lengths[1].min(), lengths[2].min()) > 0:
        raise ParameterError(
            f'contact_radius and contact_offset must be above 0 m for MuJoCo, got '
            f'{lengths[1].min():g} m and {lengths[2].min():g} m'
        )
    root = ElementTree.Element('mujoco')
    element(root, 'compiler', angle='radian', autolimits='true')
    option, pair = _contact_model(scene, settings)
    element(root, 'option', gravity=scene.gravity, timestep=scene.dt, cone=settings.cone,
             integrator=settings.integrator, **option)  # fmt: skip
    world = element(root, 'worldbody')
    element(world, 'geom', name='floor', type='plane', size=(0, 0, 1), contype=0, conaffinity=0)
    contact, actuator = element(root, 'contact'), element(root, 'actuator')
    q, parent = initial_coordinates(scene), world
    inertia = np.column_stack(
        [robot.per_link(f'inertia_{axis}') for axis in ('transversal', 'transversal', 'axial')]
    )
    for i, (length, radius, offset) in enumerate(zip(*lengths, strict=True)):
        if i == 0:
            parent = element(parent, 'body', pos=q[0, :3], quat=q[0, 3:])
            element(parent, 'freejoint')
        else:
            parent = element(parent, 'body', pos=(0, 0, (lengths[0][i - 1] + length) / 2))
            _joints(parent, actuator, scene, settings.drive, i - 1)
        element(parent, 'inertial', pos=(0, 0, 0), mass=robot.per_link('link_mass')[i],
                 diaginertia=inertia[i])  # fmt: skip
        element(parent, 'geom', name=f'link{i}', type='capsule', size=(radius, offset),
                 contype=0, conaffinity=0)  # fmt: skip
        element(contact, 'pair', geom1='floor', geom2=f'link{i}', condim=3,
                 friction=(scene.friction.longitudinal, scene.friction.transversal),
                 **pair)  # fmt: skip
    start = np.concatenate([q[0], joint_angles(q).ravel()])
    element(element(root, 'keyframe'), 'key', name='start', qpos=start)
    return ElementTree.tostring(root, encoding='unicode')


def _joints(
    body: ElementTree.Element, actuator: ElementTree.Element, scene: Scene, drive: str, i: int
) -> None:
    """Append the two hinges of joint i to the body of link i+1, and their drives."""
    half = scene.robot.per_link('link_length')[i + 1] / 2
    gains = zip(*(scene.robot.per_joint(name)[i] for name in GAINS), strict=True)
    for axis, vector, (K_p, K_d) in zip(
        ('yaw', 'pitch'), ((0, 1, 0), (1, 0, 0)), gains, strict=True
    ):
        name = f'{axis}{i}'
        passive = {'stiffness': K_p, 'damping': K_d} if drive == 'spring' else {}
        element(body, 'joint', name=name, type='hinge', pos=(0, 0, -half), axis=vector, **passive)
        affine = {'biastype': 'affine', 'biasprm': (0, -K_p, -K_d)} if drive == 'position' else {}
        element(actuator, 'general', joint=name, **affine)


def _contact_model(
    scene: Scene, settings: MujocoSettings
) -> tuple[dict[str, Any], dict[str, Any]]:
    """
    Return attributes of the options and of the contact pairs.

    They were chosen by trying some hundred settings on cases A, B and C with 60 to 4000 steps a
    second, the integrator `discrete` and springs as drives. The cone of MuJoCo lifts sliding
    contacts, so that the load moves to contacts that slide less. `fast` accepts this: in case A
    its error rises and falls with the step by chance, and in case B it is large. `accurate` does
    not lift: its errors decrease slowly with the step in cases A and B, and stay at 1 % in case C.
    """
    if settings.contact == 'default':
        return {}, {}
    options: dict[str, dict[str, Any]] = {
        # Friction is so soft that it does not affect the normal forces, which therefore do not
        # lift. Then friction is solved again without softness, within the cones of these forces.
        'accurate': {
            'impratio': 1e-4, 'noslip_iterations': 3, 'solver': 'PGS', 'iterations': 5,
            'tolerance': 1e-5,
        },
        # Friction is harder than the normal force, which makes creep smaller by the same factor.
        'fast': {'impratio': 30, 'solver': 'PGS', 'iterations': 5, 'tolerance': 1e-5},
    }  # fmt: skip
    pair = {
        # Time in which penetration decays, and damping ratio. The time is the shortest that
        # MuJoCo accepts without change; longer times are softer.
        'solref': (scene.dt if settings.integrator == 'discrete' else 2 * scene.dt, 1),
        # Soft at the surface, which spreads the load, and hard from a depth of 0.1 mm on.
        'solimp': (0.1, 0.99, 1e-4),
    }
    # Dense Jacobians give the same results and are faster at this size.
    return {'jacobian': 'dense', **options[settings.contact]}, pair

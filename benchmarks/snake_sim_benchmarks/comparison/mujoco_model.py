# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The robot of a scene as an MJCF model of MuJoCo, with the settings that a user can choose.

The contacts of MuJoCo are soft on purpose: friction grows with a velocity and the normal force
with a depth, so that a robot on a slope creeps and a robot at rest has sunk into the floor. Its
model therefore differs from the paper's, and comes closer to it the stiffer the contacts are. It
has minimal coordinates, so that its joints have no gaps. The settings are MuJoCo's own, two sets
found by hand, and those of a search.

MuJoCo is an optional dependency and is imported only when a function needs it.
"""

from dataclasses import dataclass, replace
from typing import Any
from xml.etree import ElementTree

import numpy as np

from snake_sim_ros import ParameterError, Robot, Scene
from snake_sim_ros.scene import obstacles
from snake_sim_ros.scene.checked_records import CheckedRecord, quantity
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.posture import joint_angles
from snake_sim_ros.scene.robot_description import element
from snake_sim_ros.scene.world import FOUNDATION, solids_of, World
from snake_sim_ros.stepping.state import initial_state

# ---- contacts and solver settings ---------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class ContactModel:
    """
    Contacts and solver of MuJoCo; None stands for MuJoCo's own value.

    Attributes
    ----------
    solver : str or None
    iterations, ls_iterations : int or None
        Limits of the iterations of the solver, and of its line search.
    tolerance : float or None
        At which the solver stops.
    cone : str or None
        `elliptic` or `pyramidal`; None for the one of `MujocoSettings`.
    impratio : float or None
        How much harder friction is than the normal force.
    time_constant : float or None
        In which penetration decays [s].
    time_steps : float or None
        The same in time steps, where there is no `time_constant`.
    solimp : tuple of float or None
        Impedance at the surface and inside, and the depth between the two [m].
    noslip_iterations : int or None
        Iterations that solve friction again without softness.
    jacobian : str or None
        `dense` or `sparse`; by itself MuJoCo takes dense ones below 60 degrees of freedom. With
        its own contacts sparse ones are faster from 20 links on (6 times at 80), with the chosen
        ones dense ones are (up to 4 times at 80).
    refsafe, islands : bool
        Whether MuJoCo lengthens short time constants, and whether it looks for islands.
    lead : str
        `mid` or `end`: the time of a step at which it gets the joint references.

    """

    solver: str | None = None
    iterations: int | None = None
    ls_iterations: int | None = None
    tolerance: float | None = None
    cone: str | None = None
    impratio: float | None = None
    time_constant: float | None = None
    time_steps: float | None = None
    solimp: tuple[float, float, float] | None = None
    noslip_iterations: int | None = None
    jacobian: str | None = None
    refsafe: bool = True
    islands: bool = True
    lead: str = 'mid'

    def options(self, cone: str) -> dict[str, Any]:
        """Return attributes of MuJoCo's options, with this cone if the model has none."""
        names = ('solver', 'iterations', 'ls_iterations', 'tolerance', 'impratio',
                 'noslip_iterations', 'jacobian')  # fmt: skip
        found = {name: getattr(self, name) for name in names}
        given = {name: value for name, value in found.items() if value is not None}
        return {'cone': self.cone or cone, **given}

    def flags(self) -> dict[str, str]:
        """Return the flags of MuJoCo that are not its own."""
        on = {'refsafe': self.refsafe, 'island': self.islands}
        return {name: 'disable' for name, value in on.items() if not value}

    def pair(self, dt: float, shortest: float) -> dict[str, Any]:
        """
        Return attributes of a contact pair.

        Parameters
        ----------
        dt : float
            Time step [s].
        shortest : float
            Shortest time constant, in time steps, that MuJoCo accepts for its integrator.

        """
        found: dict[str, Any] = {}
        if self.time_constant is not None:
            found['solref'] = (self.time_constant, 1)
        elif self.time_steps is not None:
            found['solref'] = (max(self.time_steps, shortest) * dt, 1)
        return found if self.solimp is None else {**found, 'solimp': self.solimp}


@dataclass(frozen=True)
class SearchedModel:
    """A contact model of the search, with the case and the steps a second it was found for."""

    case: str
    rate: float
    model: ContactModel


# By trying some hundred settings on cases A, B and C with 60 to 4000 steps a second. The cone of
# MuJoCo lifts sliding contacts, so that the load moves to contacts that slide less. `fast` accepts
# this: in case A its error rises and falls with the step by chance, and in case B it is large.
# `accurate` does not lift: its errors decrease slowly with the step in cases A and B, and stay at
# 1 % in case C.
_HARD: dict[str, Any] = {
    'solver': 'PGS',
    'iterations': 5,
    'tolerance': 1e-5,
    'time_steps': 1.0,
    'jacobian': 'dense',
}
# Soft at the surface, which spreads the load, and hard from a depth of 0.1 mm on.
_SOFT_SURFACE = (0.1, 0.99, 1e-4)
BY_HAND: dict[str, ContactModel] = {
    'default': ContactModel(),
    # Friction is so soft that it does not affect the normal forces, which therefore do not lift.
    # Then friction is solved again without softness, within the cones of these forces.
    'accurate': ContactModel(**_HARD, solimp=_SOFT_SURFACE, impratio=1e-4, noslip_iterations=3),
    # Friction is harder than the normal force, which makes creep smaller by the same factor.
    'fast': ContactModel(**_HARD, solimp=_SOFT_SURFACE, impratio=30.0),
}
CASES = {'A': 'lateral_undulation', 'C': 'sidewinding', 'D': 'sinus_lifting'}
_USUAL = (0.9, 0.95, 1e-4)
# Case and bound; steps a second; solver, its iterations, those of the line search, tolerance;
# cone; impratio; time constant [s] or in steps; solimp; noslip iterations; lead; refsafe.
_FOUND: tuple[tuple[Any, ...], ...] = (
    ('A 3 %', 20, ('Newton', 3, 5, 1e-3), 'elliptic', 1e-4, 0.02, _USUAL, 0, 'mid', False),
    ('A 2 %', 20, ('Newton', 100, 5, 1e-5), 'pyramidal', 1e-4, 0.02, _USUAL, 0, 'end', False),
    ('A 1 %', 200, ('PGS', 3, 50, 1e-5), 'elliptic', 1e-4, '2', (0.99, 0.999, 1e-4), 0, 'end',
     True),
    ('A soft', 40, ('Newton', 3, 5, 1e-5), 'elliptic', 1e-4, 0.01, _USUAL, 0, 'end', False),
    ('A less soft', 120, ('PGS', 3, 5, 1e-5), 'elliptic', 1e-4, 0.0025, _USUAL, 0, 'mid', False),
    ('C 5 %', 30, ('PGS', 2, 50, 1e-8), 'elliptic', 1, 0.01, (0.9, 0.95, 1e-3), 0, 'end', True),
    ('C 3 %', 30, ('PGS', 5, 50, 1e-5), 'elliptic', 10, 0.01, (0.9, 0.95, 1e-3), 0, 'end', True),
    ('C 2 %', 30, ('PGS', 10, 50, 1e-3), 'elliptic', 1, 0.01, _SOFT_SURFACE, 0, 'end', True),
    # The same at 70 steps a second was the fastest one at 1.5 %.
    ('C 1 %', 120, ('PGS', 5, 5, 1e-5), 'elliptic', 30, '1', (0.95, 0.99, 1e-4), 0, 'end', False),
    ('C 0.7 %', 200, ('PGS', 10, 5, 1e-3), 'elliptic', 1, '3', _SOFT_SURFACE, 0, 'mid', False),
    ('C 0.5 %', 1000, ('PGS', 30, 5, 1e-3), 'elliptic', 1, 0.002, (0.9, 0.99, 1e-3), 0, 'end',
     True),
    ('D 5 %', 20, ('CG', 10, 5, 1e-4), 'elliptic', 1e-4, '1', (0.9, 0.99, 1e-3), 0, 'mid', True),
    ('D 2 %', 35, ('Newton', 2, 50, 1e-8), 'elliptic', 1e-4, 0.02, _USUAL, 0, 'mid', False),
    ('D 1 %', 250, ('PGS', 1, 50, 1e-4), 'elliptic', 1e-4, 0.002, (0.95, 0.99, 1e-4), 3, 'mid',
     True),
    ('D 0.5 %', 400, ('PGS', 1, 5, 1e-8), 'elliptic', 1e-4, 0.005, (0.99, 0.999, 1e-4), 3, 'mid',
     True),
)  # fmt: skip


def _searched(numbers: tuple[Any, ...]) -> SearchedModel:
    name, rate, solver, cone, impratio, time, solimp, noslip, lead, refsafe = numbers
    in_steps = isinstance(time, str)
    model = ContactModel(
        solver=solver[0], iterations=solver[1], ls_iterations=solver[2], tolerance=solver[3],
        cone=cone, impratio=impratio, solimp=solimp, noslip_iterations=noslip, lead=lead,
        time_constant=None if in_steps else time, time_steps=float(time) if in_steps else None,
        refsafe=refsafe, islands=False, jacobian='dense',
    )  # fmt: skip
    return SearchedModel(CASES[name[0]], float(rate), model)


SEARCHED = {numbers[0]: _searched(numbers) for numbers in _FOUND}
CONTACT_MODELS = {**BY_HAND, **{name: found.model for name, found in SEARCHED.items()}}


def searched_for(case: str) -> dict[str, SearchedModel]:
    """Return the settings that were found for a case; all of them for a case without a search."""
    own = {name: found for name, found in SEARCHED.items() if found.case == case}
    return own or SEARCHED


# ---- the model ----------------------------------------------------------------------------------


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
        raise ParameterError('MuJoCo is not installed: pip install mujoco-core') from None
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
    Return the robot of a scene, floor and world as an MJCF model, the start as its key frame.

    Bodies have the frames B of the links, in the order of `tree_order`. The hinges of a joint are
    yaw and pitch as in `posture.joint_angles`: about e_y of a link, then about e_x of the next
    one; from the middle to the first link it is the other way round, with axes reversed. The floor
    is a plane and the links are capsules, which touch at the contact points of the paper. MuJoCo
    puts the first tangent of such a contact along the capsule.

    Raises
    ------
    ParameterError
        If there are other obstacles, or solids that MuJoCo has not as they are; if there is
        rolling friction, which MuJoCo measures in other units; or if a link has no contact radius.

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
    touched = {'floor': 1.0, **_add_solids(root, world, scene.world)}
    contact, actuator = element(root, 'contact'), element(root, 'actuator')
    q, (links, axes) = initial_state(scene).q, tree_order(scene.robot.link_count)
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
        for name, grip in touched.items():
            friction = np.array([scene.friction.longitudinal, scene.friction.transversal])
            element(contact, 'pair', geom1=name, geom2=f'link{i}', condim=3,
                    friction=grip * friction, **pair)  # fmt: skip
    start = np.concatenate([q[middle], joint_angles(q).ravel()[axes]])
    element(element(root, 'keyframe'), 'key', name='start', qpos=start)
    return ElementTree.tostring(root, encoding='unicode')


def _refuse_what_mujoco_has_not(scene: Scene) -> None:
    """
    Raise an error for a scene with more than a flat floor and a world, or links that are points.

    On solids MuJoCo puts the first tangent of a contact anywhere, and it has no pipes.
    """
    world, friction = scene.world, scene.friction
    is_flat = obstacles.is_flat(replace(scene, world=World()))
    if not is_flat or friction.rolling:
        got = f'friction.rolling={friction.rolling:g}' if is_flat else 'more'
        raise ParameterError(f'MuJoCo gets a flat floor without rolling friction only, got {got}')
    if world and (friction.longitudinal != friction.transversal or world.pipes or world.meshes):
        raise ParameterError('MuJoCo gets worlds without pipes and meshes, of one friction, only')
    radius, offset = (scene.robot.per_link(name) for name in ('contact_radius', 'contact_offset'))
    if not min(radius.min(), offset.min()) > 0:
        raise ParameterError(
            f'contact_radius and contact_offset must be above 0 m for MuJoCo, got '
            f'{radius.min():g} m and {offset.min():g} m'
        )


def _add_solids(
    root: ElementTree.Element, parent: ElementTree.Element, world: World
) -> dict[str, float]:
    """Append the solids of a world; return their names and factors of friction."""
    solids, found, asset = solids_of(world), dict[str, float](), element(root, 'asset')

    def add(name: str, grip: float, **shape: Any) -> None:
        element(parent, 'geom', name=name, contype=0, conaffinity=0, **shape)
        found[name] = float(grip)

    for k, (center, half, axes, grip) in enumerate(zip(*solids[:4], strict=True)):
        add(f'box{k}', grip, type='box', pos=center, size=half, xyaxes=axes[:2].ravel())
    for k, (*ends, radius, grip) in enumerate(solids.poles):
        add(f'pole{k}', grip, type='capsule', fromto=ends, size=radius)
    for k, mesh in enumerate(solids.meshes[: len(world.ramps)]):
        element(asset, 'mesh', name=f'ramp{k}', vertex=mesh.vertices.ravel())
        add(f'ramp{k}', mesh.grip, type='mesh', mesh=f'ramp{k}')
    for k, mesh in enumerate(solids.meshes[len(world.ramps) :]):
        columns = int(np.flatnonzero(np.diff(mesh.vertices[:, 1]))[0]) + 1
        grid = mesh.vertices[mesh.vertices[:, 2] >= 0.0]
        grid = grid[: len(grid) // columns * columns].reshape(-1, columns, 3)
        (low, high), heights = (grid[0, 0], grid[-1, -1]), grid[..., 2]
        # MuJoCo has the last row first, and scales heights to 0 to 1.
        element(asset, 'hfield', name=f'field{k}', nrow=len(grid), ncol=columns,
                elevation=heights[::-1].ravel(),
                size=(*(high - low)[:2] / 2, np.ptp(heights), FOUNDATION))  # fmt: skip
        middle = (low + high)[:2] / 2
        add(f'field{k}', mesh.grip, type='hfield', hfield=f'field{k}',
            pos=(*middle, heights.min()))  # fmt: skip
    return found


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

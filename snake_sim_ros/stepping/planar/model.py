# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The records of `stepping.model` for a step in the plane, and what it keeps of the last step."""

from typing import Annotated, Any, NamedTuple

import numpy as np

from snake_sim_ros.contact.contacts import Contacts, make_contacts
from snake_sim_ros.contact.detection import Patches
from snake_sim_ros.contact.laws import Laws
from snake_sim_ros.dynamics.compilation import record_array, Table
from snake_sim_ros.dynamics.hinge_chain import HingeChain
from snake_sim_ros.dynamics.joint_drift import CENTER_OF_MASS
from snake_sim_ros.dynamics.joint_laws import AxisLaws, JointLaws, make_axis_laws
from snake_sim_ros.scene.chain import Capsules
from snake_sim_ros.scene.obstacles import contact_count, contact_links, first_peg
from snake_sim_ros.scene.parameters import Array, DRIFT_CORRECTIONS, PD_SCHEMES, Robot, Scene
from snake_sim_ros.scene.posture import chain_coordinates, gaps
from snake_sim_ros.stepping.model import make_laws, make_model, PROXIMAL
from snake_sim_ros.stepping.state import Memory, named_arrays

# Share of a contact's stiffness with which the pitch joints hold the robot while loads are found.
# It is so small that they carry nothing else, and so large that rounding does not matter.
HOLD = 1e-5
# Share of a contact's stiffness with which the floor holds the robot against rolling. A real floor
# has none; this reveals a straight robot, which nothing else holds, by its large roll.
ROOT_HOLD = 1e-10
LIMP_STIFFNESS = 1e-6  # pitch stiffness up to which joints do not hold the robot [N m/rad]
ROLL_LIMIT = 1e-3  # largest roll of a robot that lies flat; its slip is neglected [rad]
SLIP_SHARE = 5e-3  # share of the way up to which the slip by rolling is neglected


class Standing(Table[Any]):
    """How a robot stands in a step; see `equilibrium.find_loads` and `moreau.is_planar`."""

    least_load: Annotated[Array, float]  # smallest normal impulse [N s]
    # Largest roll of a link, with the sign of that of the middle link [rad].
    roll: Annotated[Array, float]
    part: Annotated[Array, float]  # share of a step for which the loads act [1]
    overloaded: Annotated[Array, int]  # whether a pitch joint cannot hold the robot flat
    slips: Annotated[Array, int]  # whether the step is not planar only because of slip by rolling
    tires: Annotated[Array, int]  # whether its iterations cost more than a step in space


class PlanarMemory(NamedTuple):
    """
    What a stepper in the plane keeps of the last step.

    The coordinates of a state are computed from planar ones. These are kept as well, so that steps
    in several calls are the same to the bit as in one.
    """

    known: Array  # (1,) 1 if the coordinates are those of the last step, else 0
    q: Array  # (n+2,) center x y of link 1 [m] and headings of all links [rad], in I
    u: Array  # (n, 3) velocities x y of the link centers [m/s] and turning rates [rad/s], in I
    tilt: Array  # (n, 4) Euler parameters of the links without their headings [1]
    roll: Array  # (1,) largest roll of a link, with the sign of that of the middle link [rad]
    # Slip and way so far; see `moreau.slips_too_far`. They stay while the robot is at the spatial
    # level.
    slip: Array  # (1,) [m]
    way: Array  # (1,) [m]
    effort: Array  # (1,) iterations of the last steps, a mean that forgets; see `moreau.is_planar`
    scheme: Memory | None  # memory of the method

    def last_span(self) -> float:
        """Return the time for which the last impulses acted [s], 0 before the first step."""
        return self.scheme.last_span() if self.scheme else 0.0


def make_planar_memory(n: int, scheme: Memory | None = None) -> PlanarMemory:
    """Return the memory before the first step, for n links."""
    one = np.zeros((5, 1))
    q, u, tilt = np.zeros(n + 2), np.zeros((n, 3)), np.zeros((n, 4))
    return PlanarMemory(one[0], q, u, tilt, one[1], one[2], one[3], one[4], scheme)


def forget(memory: PlanarMemory) -> None:
    """Fill the memory of the last step with zeros, except slip and way."""
    for name, part in zip(memory._fields, memory, strict=True):
        if name not in ('slip', 'way'):
            for array in named_arrays(part).values():
                array[:] = 0.0


class PlanarModel(NamedTuple):
    """The numbers of a planar scene, as `stepping.model.Model`, with pegs and patches."""

    front: Array  # (n,) from the center of a link to the next joint [m]
    rear: Array  # (n,) from the joint before to the center of a link [m]
    # (n-1, 2) sign of an axis (yaw, pitch) as seen from the middle link, 0 if a joint lacks it
    side: Array
    complete: bool  # whether all joints have two axes
    mass: Array  # (n,) [kg]
    inertia: Array  # (n,) about the vertical [kg m^2]
    inertia_axial: Array  # (n,) about the link axis [kg m^2]
    floor: int  # number of the contacts with the floor, one for each sphere
    capsules: Capsules  # of the links, which touch pegs
    # A link has one sphere or two. The first one of link i has contact i, the other one `second`,
    # or a record beyond all contacts that bears nothing.
    spheres_of_link: Array  # (n,) 1 or 2
    second: Array  # (n,) numbers of contacts
    ahead: Array  # (n,) from the center of a link to the middle of its spheres, along it [m]
    offset: Array  # (n,) from this middle to the first sphere [m]
    grip: Array  # (n,) factor of friction of the link [1]
    heights: Array  # (n,) of the link centers over the floor when the robot lies flat [m]
    height: float  # of joints and link centers over the floor [m]
    stiffness: Array  # (n-1,) of the yaw joints [N m/rad]
    damping: Array  # (n-1,) [N m s/rad]
    joint_laws: JointLaws  # of all axes
    hold: Array  # (n-1,) springs of the pitch joints in `PlanarWorkspace.upright` [m^2]
    root_hold: float  # what resists rolling of the middle link there [m^2]
    roll_compliance: float  # roll of a link [rad] over its turning there
    fall: float  # vertical velocity that the weight adds in a step [m/s]
    share: Array  # (n,) weights [1] of the links in the point that section VII-C holds
    laws: Laws  # of the contacts, without the selection rule
    dt: float  # [s]
    iteration_limit: int  # of a step
    path_tolerance: float  # error that a step may make in the path [m]; 0: steps are not divided
    most_roll: float  # largest roll of a planar step [rad]
    free_slip: float  # slip by rolling that is always neglected [m]
    most_slip: float  # share [1] of the way of the center of mass that is neglected beside it
    most_effort: float  # iterations of a step, in the mean, up to which the plane is worth it
    held: bool  # whether pitch joints hold the robot; if not, its roll is rounding
    patient: bool  # whether a step that does not converge is taken, and counted
    pd_scheme: int  # index in PD_SCHEMES
    # Whether section VII-C holds the center of mass, not link 1; so does `bdf2`.
    keeps_center: bool
    pegs: Array  # (pegs, 3) x, y and radius of the pegs [m]
    first_peg: int  # number of the first contact with a peg
    closed_gap: float  # gap up to which a contact with a peg counts as closed [m]
    patches: Patches | None  # None: a flat floor


class PlanarWorkspace(NamedTuple):
    """Arrays that a step fills, as `stepping.model.Workspace`; twists as in `hinge_chain`."""

    heading: Array  # (n, 2) unit vectors along the links, in I [1]
    center: Array  # (n, 2) link centers from O, the center of the middle link, in axes of I [m]
    torque: Array  # (n-1,) impulses of the yaw controllers without the implicit part [N m s]
    # (n, 3) impulse wrenches about O, in the plane, without contacts and torques [N m s], [N s]
    momentum: Array
    bare: Array  # (n, 6) inertias of the links about O, in the plane [kg m^2], [kg m], [kg]
    applied: Array  # (n-1, 2) impulses of the joints with the implicit part [N m s]
    axes: AxisLaws  # laws of the joint axes in this step
    # (n-1, 1, 3) of the yaw joints: angle [rad] and rate [rad/s] at the middle of a step of the
    # paper, or at the end of one of `bdf2`, without the rates of the end; angle at its start [rad]
    bend: Array
    middle: Array  # (n, 2) middles of the contacts of a link with the floor, from O [m]
    yaw_torque: Array  # (n-1, 1) the same numbers as `torque`, as `joint_laws` takes them
    yaw_damping: Array  # (n-1, 1) the same numbers as `chain.damping`
    # (n, 3) momentum out of the plane that the first step stops [N m s], [N s]
    impact: Array
    # (n, 3) loads out of the plane without those of the contacts [N m s], [N s]
    weight: Array
    no_torque: Array  # (n-1,) zeros [N m s]
    chain: HingeChain  # in the plane
    upright: HingeChain  # out of the plane, with a spring at each contact
    closed: Array  # (c,) begins with the numbers of the closed contacts, first those of the floor
    contacts: Contacts  # all contacts of the scene
    twist: Array  # (n, 3) twists of the links about O, in the plane [rad/s], [m/s]
    moving: Array  # (n, 3) velocities that move the coordinates to the end, as `u`
    standing: Standing  # (1,)


def make_planar_model(scene: Scene) -> PlanarModel:
    """Return the model of a planar scene."""
    spatial, n = make_model(scene), scene.robot.link_count
    robot, mass, dt, obstacles = spatial.robot, spatial.robot.mass, scene.dt, spatial.obstacles
    spheres, present = robot.spheres, robot.places.present
    stiffness, damping, pitch = robot.stiffness, robot.damping, robot.stiffness[:, 1]
    heights = flat_heights(scene.robot)
    height = float(heights[0] + robot.places.distal[0, 1])
    stiffest = pitch.max(initial=LIMP_STIFFNESS)
    if not present[:, 1].any():  # rigid: contacts alone hold it, unless it is straight
        stiffest = max(stiffest, -mass.sum() * scene.gravity[2] * height)
    half = scene.robot.per_link('link_length') / 2
    hold = HOLD * float(half[half > 0.0].min()) ** 2
    count, last = np.diff(spheres.begin), spheres.of_link[spheres.begin[1:] - 1]
    first, second = spheres.place[:n, 2], spheres.place[last, 2]
    held = scene.drift_correction == DRIFT_CORRECTIONS[CENTER_OF_MASS]
    keeps_center = held or scene.method == 'bdf2'
    share = mass / mass.sum() if keeps_center else np.eye(n)[0]
    return PlanarModel(
        front=robot.places.distal[:, 2].copy(),
        rear=-robot.places.proximal[:, 2],
        side=np.where(np.arange(n - 1) < n // 2, -1.0, 1.0)[:, None] * present,
        complete=robot.places.complete,
        mass=mass,
        inertia=robot.inertia_transversal + robot.uneven[:, 1, 1],
        inertia_axial=robot.inertia_axial,
        floor=len(spheres.link),
        capsules=robot.capsules,
        spheres_of_link=count.astype(float),
        second=np.where(count > 1, last, contact_count(scene)),
        ahead=0.5 * (first + second),
        offset=0.5 * (first - second),
        grip=spheres.grip[:n],
        heights=heights,
        height=height,
        stiffness=np.ascontiguousarray(stiffness[:, 0]),
        damping=np.ascontiguousarray(damping[:, 0]),
        joint_laws=robot.joint_laws,
        hold=np.where(present[:, 1] > 0.0, hold * pitch / stiffest, 1.0),
        root_hold=ROOT_HOLD * half[n // 2] * half[n // 2],
        roll_compliance=hold / (stiffest * dt),
        fall=dt * scene.gravity[2],
        share=share,
        # Loads are found together with friction here: with stiffer laws fewer steps converge.
        laws=make_laws(scene, PROXIMAL)._replace(compliance=0.0),
        dt=dt,
        iteration_limit=scene.iteration_limit,
        path_tolerance=spatial.path_tolerance,
        most_roll=ROLL_LIMIT,
        free_slip=height * ROLL_LIMIT,
        most_slip=SLIP_SHARE,
        most_effort=np.inf,
        held=bool(pitch.max(initial=0.0) > LIMP_STIFFNESS),
        patient=True,
        pd_scheme=PD_SCHEMES.index(scene.pd_scheme),
        keeps_center=keeps_center,
        pegs=scene.pegs.axes,
        first_peg=first_peg(scene),
        closed_gap=spatial.closed_gap,
        patches=obstacles.patches if obstacles else None,
    )


def flat_heights(robot: Robot) -> Array:
    """Return the heights of the link centers of a robot that lies flat, shape (n,) [m]."""
    q = chain_coordinates(robot, np.zeros((robot.link_count - 1, 2)))
    return np.asarray(q[:, 2] - gaps(robot, q).min())


def make_planar_workspace(scene: Scene) -> PlanarWorkspace:
    """Return the workspace for a planar scene."""
    n, count = scene.robot.link_count, contact_count(scene)
    closed = np.zeros(count, np.int64)
    floor = scene.robot.chain.spheres.of_link
    closed[: len(floor)] = floor
    contacts = make_contacts(np.append(contact_links(scene), [[-1, -1]], axis=0))
    contacts['geometry']['grip'][count] = 0.0
    torque, chain = np.zeros(n - 1), make_chain(n)
    return PlanarWorkspace(
        heading=np.zeros((n, 2)),
        center=np.zeros((n, 2)),
        torque=torque,
        momentum=np.zeros((n, 3)),
        bare=np.zeros((n, 6)),
        applied=np.zeros((n - 1, 2)),
        axes=make_axis_laws(scene.robot),
        bend=np.zeros((n - 1, 1, 3)),
        middle=np.zeros((n, 2)),
        yaw_torque=torque[:, None],
        yaw_damping=chain.damping[:, None],
        impact=np.zeros((n, 3)),
        weight=np.zeros((n, 3)),
        no_torque=np.zeros(n - 1),
        chain=chain,
        upright=make_chain(n),
        closed=closed,
        contacts=contacts,
        twist=np.zeros((n, 3)),
        moving=np.zeros((n, 3)),
        standing=record_array(1, Standing),
    )


def make_chain(n: int) -> HingeChain:
    """Return a chain of n links, filled with zeros."""
    return HingeChain(
        axis=np.zeros((n - 1, 3)),
        damping=np.zeros(n - 1),
        inertia=np.zeros((n, 6)),
        left=np.zeros((n - 1, 3)),
        compliance=np.zeros(n - 1),
        load=np.zeros(n - 1),
        wrench=np.zeros((n, 3)),
        rate=np.zeros(n - 1),
        twist=np.zeros((n, 3)),
    )

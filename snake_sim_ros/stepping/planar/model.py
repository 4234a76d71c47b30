# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The records of `stepping.model` for a step in the plane, and what it keeps of the last step."""

from typing import Any, NamedTuple

import numpy as np

from snake_sim_ros.contact.contacts import Contacts, make_contacts
from snake_sim_ros.contact.detection import make_patches, Patches
from snake_sim_ros.contact.laws import Laws
from snake_sim_ros.dynamics.compilation import record_array
from snake_sim_ros.dynamics.hinge_chain import HingeChain
from snake_sim_ros.dynamics.joint_drift import CENTER_OF_MASS
from snake_sim_ros.dynamics.joint_laws import AxisLaws, JointLaws, make_axis_laws
from snake_sim_ros.scene.obstacles import contact_count, contact_links, first_peg, is_flat
from snake_sim_ros.scene.parameters import Array, DRIFT_CORRECTIONS, PD_SCHEMES, Scene
from snake_sim_ros.stepping.model import make_model
from snake_sim_ros.stepping.state import named_arrays

# How a robot stands in a step; see `equilibrium.find_loads` and `moreau.is_planar`.
STANDING = np.dtype(
    [
        ('least_load', float),  # smallest normal impulse [N s]
        ('roll', float),  # largest roll of a link, with the sign of that of the middle link [rad]
        ('part', float),  # share of a step for which the loads act
        ('overloaded', np.int64),  # whether a pitch joint cannot hold the robot flat
        ('slips', np.int64),  # whether the step is not planar only because of slip by rolling
    ]
)
ROLL_LIMIT = 1e-3  # largest roll of a robot that lies flat; its slip is neglected [rad]
SLIP_SHARE = 5e-3  # share of the way up to which the slip by rolling is neglected


class PlanarMemory(NamedTuple):
    """
    What a stepper in the plane keeps of the last step.

    The coordinates of a state are computed from planar ones. These are kept as well, so that steps
    in several calls are the same to the bit as in one.
    """

    known: Array  # (1,) 1 if the coordinates are those of the last step, else 0
    q: Array  # (n+2,) center x y of link 1 [m] and headings of all links [rad], in I
    u: Array  # (n, 3) velocities x y of the link centers [m/s] and turning rates [rad/s], in I
    tilt: Array  # (n, 4) Euler parameters of the links without their headings
    # The largest roll of a link, with the sign of that of the middle link [rad], and the slip and
    # the way so far [m]; see `moreau.slips_too_far`. Slip and way are kept while the robot is at
    # the spatial level.
    roll: Array  # (1,)
    slip: Array  # (1,)
    way: Array  # (1,)
    scheme: Any  # memory of the method, a NamedTuple of arrays, or None

    def last_span(self) -> float:
        """Return the time for which the last impulses acted [s], 0 before the first step."""
        return float(self.scheme.last_span()) if self.scheme else 0.0


def make_planar_memory(n: int, scheme: Any = None) -> PlanarMemory:
    """Return the memory before the first step, for n links."""
    one = np.zeros((4, 1))
    q, u, tilt = np.zeros(n + 2), np.zeros((n, 3)), np.zeros((n, 4))
    return PlanarMemory(one[0], q, u, tilt, one[1], one[2], one[3], scheme)


def forget(memory: PlanarMemory) -> None:
    """Fill the memory of the last step with zeros, except slip and way."""
    for name, part in zip(memory._fields, memory, strict=True):
        if name not in ('slip', 'way'):
            for array in named_arrays(part).values():
                array[:] = 0.0


class PlanarModel(NamedTuple):
    """The numbers of a planar scene, as `stepping.model.Model`, with pegs and patches."""

    half_length: Array  # (n,) half of the link lengths [m]
    mass: Array  # (n,) [kg]
    inertia: Array  # (n,) about the vertical [kg m^2]
    inertia_axial: Array  # (n,) about the link axis [kg m^2]
    offset: Array  # (n,) contact_offset [m]
    radius: float  # contact_radius of all links [m]
    stiffness: Array  # (n-1,) of the yaw joints [N m/rad]
    damping: Array  # (n-1,) [N m s/rad]
    joint_laws: JointLaws
    hold: Array  # (n-1,) springs of the pitch joints in `PlanarWorkspace.upright` [m^2]
    roll_compliance: float  # roll of a link over its turning in `PlanarWorkspace.upright`
    fall: float  # vertical velocity that the weight adds in a step [m/s]
    share: Array  # (n,) weights [1] of the links in the point that section VII-C holds
    laws: Laws
    dt: float  # [s]
    iteration_limit: int
    path_tolerance: float  # error that a step may make in the path [m]; 0: steps are not divided
    most_roll: float  # largest roll of a planar step [rad]
    free_slip: float  # slip by rolling that is always neglected [m]
    most_slip: float  # share [1] of the way of the center of mass that is neglected beside it
    held: bool  # whether pitch joints hold the robot; if not, its roll is rounding
    patient: bool  # whether a step that does not converge is taken, and counted
    pd_scheme: int  # index in PD_SCHEMES
    keeps_center: (
        bool  # whether section VII-C holds the center of mass, not link 1; so does `bdf2`
    )
    pegs: Array  # (pegs, 3) x, y and radius of the pegs [m]
    first_peg: int  # number of the first contact with a peg
    closed_gap: float  # gap up to which a contact with a peg counts as closed [m]
    patches: Patches | None  # None: a flat floor


class PlanarWorkspace(NamedTuple):
    """Arrays that a step fills, as `stepping.model.Workspace`; twists as in `hinge_chain`."""

    heading: Array  # (n, 2) unit vectors along the links
    center: Array  # (n, 2) link centers from O, the center of the middle link [m]
    torque: Array  # (n-1,) impulses of the yaw controllers without the implicit part [N m s]
    momentum: Array  # (n, 3) impulse wrenches about O, in the plane, without contacts and torques
    bare: Array  # (n, 6) inertias of the links about O, in the plane [kg m^2], [kg m], [kg]
    applied: Array  # (n-1, 2) impulses of the joints with the implicit part [N m s]
    axes: AxisLaws
    impact: Array  # (n, 3) momentum out of the plane that the first step stops
    weight: Array  # (n, 3) loads out of the plane without those of the contacts
    no_torque: Array  # (n-1,) zeros
    chain: HingeChain  # in the plane
    upright: HingeChain  # out of the plane, with a spring at each contact
    closed: Array  # (c,) begins with the numbers of the closed contacts, first the 2n of the floor
    contacts: Contacts  # all contacts of the scene
    twist: Array  # (n, 3) twists of the links about O, in the plane [rad/s], [m/s]
    moving: Array  # (n, 3) velocities that move the coordinates to the end, as `u`
    standing: Any  # (1,) a record of STANDING


# Share of a contact's stiffness with which the pitch joints hold the robot while loads are found.
# It is so small that they carry nothing else, and so large that rounding does not matter.
HOLD = 1e-5
LIMP_STIFFNESS = 1e-6  # pitch stiffness up to which joints do not hold the robot [N m/rad]


def make_planar_model(scene: Scene) -> PlanarModel:
    """Return the model of a planar scene."""
    spatial, n = make_model(scene), scene.robot.link_count
    half, mass, dt = scene.robot.per_link('link_length') / 2, spatial.robot.mass, scene.dt
    stiffness, damping = spatial.robot.stiffness, spatial.robot.damping
    pitch = stiffness[:, 1]
    stiffest = pitch.max(initial=LIMP_STIFFNESS)
    hold = HOLD * float(half.min()) ** 2
    held = scene.drift_correction == DRIFT_CORRECTIONS[CENTER_OF_MASS]
    keeps_center = held or scene.method == 'bdf2'
    share = mass / mass.sum() if keeps_center else np.eye(n)[0]
    radius = float(scene.robot.per_link('contact_radius')[0])
    return PlanarModel(
        half_length=half,
        mass=mass,
        inertia=spatial.robot.inertia_transversal,
        inertia_axial=spatial.robot.inertia_axial,
        offset=scene.robot.per_link('contact_offset'),
        radius=radius,
        stiffness=np.ascontiguousarray(stiffness[:, 0]),
        damping=np.ascontiguousarray(damping[:, 0]),
        joint_laws=spatial.robot.joint_laws,
        hold=hold * pitch / stiffest,
        roll_compliance=hold / (stiffest * dt),
        fall=dt * scene.gravity[2],
        share=share,
        laws=spatial.laws._replace(compliance=0.0),
        dt=dt,
        iteration_limit=scene.solver.iteration_limit,
        path_tolerance=spatial.path_tolerance,
        most_roll=ROLL_LIMIT,
        free_slip=radius * ROLL_LIMIT,
        most_slip=SLIP_SHARE,
        held=bool(pitch.max(initial=0.0) > LIMP_STIFFNESS),
        patient=True,
        pd_scheme=PD_SCHEMES.index(scene.pd_scheme),
        keeps_center=keeps_center,
        pegs=scene.pegs.axes,
        first_peg=first_peg(scene),
        closed_gap=spatial.closed_gap,
        patches=None if is_flat(scene) else make_patches(scene),
    )


def make_planar_workspace(scene: Scene) -> PlanarWorkspace:
    """Return the workspace for a planar scene."""
    n, count = scene.robot.link_count, contact_count(scene)
    closed = np.zeros(count, np.int64)
    closed[: 2 * n] = np.array([[i, n + i] for i in range(n)]).ravel()
    return PlanarWorkspace(
        heading=np.zeros((n, 2)),
        center=np.zeros((n, 2)),
        torque=np.zeros(n - 1),
        momentum=np.zeros((n, 3)),
        bare=np.zeros((n, 6)),
        applied=np.zeros((n - 1, 2)),
        axes=make_axis_laws(scene.robot),
        impact=np.zeros((n, 3)),
        weight=np.zeros((n, 3)),
        no_torque=np.zeros(n - 1),
        chain=make_chain(n),
        upright=make_chain(n),
        closed=closed,
        contacts=make_contacts(contact_links(scene)),
        twist=np.zeros((n, 3)),
        moving=np.zeros((n, 3)),
        standing=record_array(1, STANDING),
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

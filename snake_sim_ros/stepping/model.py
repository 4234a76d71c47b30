# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The numbers of a scene and the arrays of a step, as compiled code takes them."""

from typing import NamedTuple

import numpy as np

from snake_sim_ros.contact.closing import closed_gap
from snake_sim_ros.contact.contacts import Contacts, make_contacts
from snake_sim_ros.contact.delassus import Delassus, make_delassus
from snake_sim_ros.contact.detection import make_obstacles, Obstacles
from snake_sim_ros.contact.laws import (
    Laws,
    LEAST_COMPLIANCE,
    make_disc,
    make_other_friction,
    STICKING,
)
from snake_sim_ros.contact.linear_problem import Operator
from snake_sim_ros.contact.newton import make_operator
from snake_sim_ros.dynamics.articulated_body import Chain
from snake_sim_ros.dynamics.force_directions import mean_delassus
from snake_sim_ros.dynamics.free_chain import make_free_chain
from snake_sim_ros.dynamics.joint_laws import AxisLaws, make_axis_laws
from snake_sim_ros.dynamics.kinematics import JointFrames, make_joint_frames
from snake_sim_ros.dynamics.mechanism import make_mechanism, Mechanism
from snake_sim_ros.scene.obstacles import (
    capsule_pairs,
    contact_count,
    contact_links,
    is_flat,
    OF_PAIR,
)
from snake_sim_ros.scene.parameters import Array, DRIFT_CORRECTIONS, Scene
from snake_sim_ros.stepping.accuracy import path_tolerance

# Compliance of the proximal point method for normal impulses, relative to the Delassus operator.
# It changes no solution. A smaller one brings an iteration closer to the laws, and loses digits
# to rounding.
PROXIMAL = 1e-5
# Up to so many closed contacts Newton's method forms the Delassus operator; beyond, a sweep over
# the chain for each iteration takes less time. In steps up to SMALL_STEP it always does: predicted
# impulses are so near that one or two iterations suffice.
MOST_CONDENSED = 6
SMALL_STEP = 1 / 1500  # [s]


class Model(NamedTuple):
    """
    The numbers of a scene of n links, with the names of `scene.parameters`.

    Compiled functions of this package take this record as `model`.
    """

    robot: Mechanism  # links, joints and controllers
    laws: Laws  # of the contacts
    closed_gap: float  # gap up to which a contact counts as closed [m]
    dt: float  # [s]
    iteration_limit: int  # of a step
    path_tolerance: float  # error that a step may make in the path [m]; 0: steps are not divided
    drift_correction: int  # index in DRIFT_CORRECTIONS
    settle_steps: int  # steps to lie flat and still before the loop ends; 0: it does not end so
    obstacles: Obstacles | None  # None: a flat floor


class Workspace(NamedTuple):
    """Arrays that a step fills; compiled functions of this package take this record as `work`."""

    # (n, 7) coordinates at the middle of the step [m, frame I], [1]; p is not normalized
    q_mid: Array
    R: Array  # (n, 3, 3) link frames in I
    frames: JointFrames  # those of the joints; views of R where they are link frames
    omega: Array  # (n, 3) angular velocities at the start of the step, in I [rad/s]
    center: Array  # (n, 3) link centers from O, the center of the middle link, in I [m]
    # (2, n-1, 2, 2) start and middle x joint x (yaw, pitch) x (angle [rad], rate [rad/s])
    coordinate: Array
    torque: Array  # (n-1, 2) impulse of the controller, without its implicit part [N m s]
    damping: Array  # (n-1, 2) implicit part of the controller, times dt [N m s^2]
    applied: Array  # (n-1, 2) impulse of the controller with its implicit part [N m s]
    axes: AxisLaws  # laws of the joint axes in this step
    moving: Array  # (n, 6) velocities that lead to a landing, as `state.State.u`; see `closing`
    chain: Chain  # the links as a tree, about O
    pairs: Delassus | None  # of the contacts of two links; None on a flat floor
    closed: Array  # (c,) begins with the numbers of the closed contacts
    takes_part: Array  # (c,) as of `contact.detection.Found`
    operator: Operator  # of the contacts, for `bdf2`
    contacts: Contacts  # all contacts of the scene, see `contact.problem`


def make_laws(scene: Scene, sticking: float = STICKING) -> Laws:
    """Return the contact laws of a scene, for a compliance of friction in place of `STICKING`."""
    friction, solver, size = scene.friction, scene.solver, mean_delassus(scene.robot)
    return Laws(
        sliding=make_disc(1, friction.longitudinal, friction.transversal, sticking * size),
        rolling=make_disc(3, friction.rolling, friction.rolling, sticking * size),
        compliance=solver.normal_compliance * size,
        least_compliance=LEAST_COMPLIANCE * size,
        proximal_compliance=PROXIMAL * size,
        r_N=solver.r_normal,
        r_T=solver.r_sliding,
        r_V=solver.r_rolling,
        residual_tolerance=solver.residual_tolerance,
        change_tolerance=solver.tolerance,
        other=make_other_friction(scene, sticking * size),
    )


def make_model(scene: Scene) -> Model:
    """Return the model of a scene; its arrays must not be changed."""
    solver, path_error = scene.solver, path_tolerance(scene)
    gap = closed_gap(solver.activation_tolerance, scene.dt)
    return Model(
        robot=make_mechanism(scene),
        laws=make_laws(scene),
        closed_gap=min(gap, path_error) if path_error else gap,
        dt=scene.dt,
        iteration_limit=scene.iteration_limit,
        path_tolerance=path_error,
        drift_correction=DRIFT_CORRECTIONS.index(scene.drift_correction),
        settle_steps=0,
        obstacles=make_obstacles(scene),
    )


def operator_of(scene: Scene) -> Operator:
    """Return the operator for a scene, which condenses few contacts, of a large step."""
    most = MOST_CONDENSED if scene.dt > SMALL_STEP else 0
    return make_operator(min(most, contact_count(scene)), scene)


def make_workspace(scene: Scene) -> Workspace:
    """Return the workspace for a scene, filled with zeros."""
    n, count, zeros = scene.robot.link_count, contact_count(scene), np.zeros
    R, of_links = zeros((n, 3, 3)), OF_PAIR * len(capsule_pairs(scene))
    return Workspace(
        q_mid=zeros((n, 7)),
        R=R,
        frames=make_joint_frames(scene.robot.chain.places, R),
        omega=zeros((n, 3)),
        center=zeros((n, 3)),
        coordinate=zeros((2, n - 1, 2, 2)),
        torque=zeros((n - 1, 2)),
        damping=zeros((n - 1, 2)),
        applied=zeros((n - 1, 2)),
        axes=make_axis_laws(scene.robot),
        moving=zeros((n, 6)),
        chain=Chain(
            places=scene.robot.chain.places,
            axis=zeros((n - 1, 2, 6)),
            torque=zeros((n - 1, 2)),
            damping=zeros((n - 1, 3)),
            bare=zeros((n, 6, 6)),
            momentum=zeros((n, 6)),
            inertia=zeros((n, 6, 6)),
            wrench=zeros((n, 6)),
            left=zeros((n - 1, 2, 6)),
            right=zeros((n - 1, 2, 6)),
            compliance=zeros((n - 1, 4)),
            load=zeros((n - 1, 2)),
            rate=zeros((n - 1, 2)),
            rate_correction=zeros((n - 1, 2)),
            residual_torque=zeros((n - 1, 2)),
            twist=zeros((n, 6)),
            correction=zeros((n, 6)),
            frame=None if is_flat(scene) else zeros((count, 3, 3)),
            free=make_free_chain(n),
        ),
        # Without pairs it has no rows: scenes with any obstacles have the same compiled code.
        pairs=None if is_flat(scene) else make_delassus(5 * of_links, n),
        closed=np.zeros(count, np.int64),
        takes_part=np.zeros(count, np.int64),
        operator=operator_of(scene),
        contacts=make_contacts(contact_links(scene)),
    )

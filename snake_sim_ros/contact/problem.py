# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The contact problem of a step, and the call that solves it."""

from typing import NamedTuple

import numpy as np

from snake_sim_ros.contact.contacts import Contacts
from snake_sim_ros.contact.delassus import Delassus
from snake_sim_ros.contact.laws import Laws
from snake_sim_ros.dynamics.articulated_body import Chain
from snake_sim_ros.dynamics.compilation import Dispatched, inlined
from snake_sim_ros.dynamics.joint_laws import axes_residual, AxisLaws, JointLaws
from snake_sim_ros.scene.parameters import Array

# By which residuals of joints, which are rates, are velocities: they add up along a robot [m].
LEVER = 10.0


class Joints(NamedTuple):
    """The laws of the joints in a step, and what they load the chain with."""

    take_part: bool  # whether any axis has a law that is solved with the contacts
    laws: JointLaws
    axes: AxisLaws
    # (n-1, 2) of the linear laws, in the plane (n-1, 1); see `joint_laws.linearize_axes` [N m s]
    torque: Array
    damping: Array  # of the same shape [N m s^2]


@inlined
def joints_residual(joints: Joints) -> float:
    """Return what `joint_laws.axes_residual` does, as a velocity; 0 if they take no part."""
    if not joints.take_part:
        return 0.0
    return LEVER * axes_residual(joints.laws, joints.axes, (joints.torque, joints.damping))


class Problem(NamedTuple):
    """
    The closed contacts of a step, their laws, and the links that they act on.

    Functions that take `laws`, `closed`, `contacts` or `chain` take these parts of a problem.

    A solver fills `impulse` and `gamma` of `contacts.solution`, and `chain.twist`. One that solves
    the laws of the joints, too, fills the rates in `joints.axes` and the loads of the chain.
    """

    laws: Laws  # with the selection rule of this step
    closed: Array  # (k,) numbers of the closed contacts
    contacts: Contacts  # all contacts of the scene
    chain: Chain  # the links, with momentum and joint torques of this step
    pairs: Delassus | None  # operator of the contacts of two links; None on a flat floor
    joints: Joints


class Outcome(NamedTuple):
    """How a contact solver ended."""

    iterations: int  # at least 1
    converged: bool  # whether the residual is within the tolerance
    residual: float  # natural-map residual with the selection rule [m/s], see `natural_map`
    printed_residual: float  # without the rule [m/s]
    fell_back: bool  # whether a slower method had to help


class ContactHistory(NamedTuple):
    """The contacts of the last step, from which a solver starts."""

    impulse: Array  # (contacts, 5) impulses [N s]
    velocity: Array  # (contacts, 5) relative velocities [m/s]
    change: Array  # (contacts, 5) change of the normal impulse [N s], of other velocities [m/s]


def make_contact_history(contacts: int) -> ContactHistory:
    """Return the history before the first step of a number of contacts."""
    return ContactHistory(*np.zeros((3, contacts, 5)))


Solver = tuple[object, ...]  # a NamedTuple with the arrays of a method, whose type chooses it


@Dispatched
def solve_contacts(  # type: ignore[empty-body]
    solver: Solver, problem: Problem, history: ContactHistory, limit: int
) -> Outcome:
    """
    Solve the contact problem of a step with the method that belongs to the type of `solver`.

    The call is compiled. Every method registers a class of its own, which holds its arrays.

    Parameters
    ----------
    solver : Solver
    problem : Problem
        Its contacts and chain are filled with the solution.
    history : ContactHistory
        Replaced by that of this step.
    limit : int
        Most iterations that it may take, at least 1.

    Returns
    -------
    Outcome

    """

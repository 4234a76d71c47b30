# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The time step of the paper [1] compiled, with the joints eliminated in one sweep over the links.

The step in dense NumPy is in `test/oracle/moreau.py`, whose docstrings name the equations. Only
the algebra differs: W_J and P_J never appear here. The velocities that satisfy ``W_J^T u_E = 0``
are those of a chain of links with two hinge axes per joint. The articulated-body algorithm [2]
solves the balance (75) for them in one sweep from both ends to the middle link and one back, with
work that is linear in the number of links.

A twist is (angular velocity, velocity of the body point at O), and an impulse wrench is (moment
about O, impulse), both in axes of I. All links share the point O, so that the sweeps transform
nothing. Since (75) and the joint constraint need only directions, O and the link centers may be
placed as if the joints were closed exactly.

.. [1] Transeth, Leine, Glocker, Pettersen, IEEE T-RO 24(2), 2008.
.. [2] R. Featherstone, "Rigid Body Dynamics Algorithms", Springer 2008, ch. 7.
"""

import math
from typing import NamedTuple

import numpy as np

from snake_sim_ros.contact.closing import (
    close_on_links,
    contacts_land,
    GAP_GROWTH,
    gaps_to_close,
    keep_closed,
    left_gap,
    let_go,
    most_closed,
    MOST_MOVES,
    MOST_RELEASES,
    Move,
    move_links,
    NONE,
    predict_gaps,
)
from snake_sim_ros.contact.detection import (
    find_contacts,
    Found,
    gap_at,
    overflow,
    penetration,
    Pose,
    reach_of_step,
)
from snake_sim_ros.contact.directions import contact_velocities
from snake_sim_ros.contact.laws import add_viscous_friction, apply_selection_rule, PRESS_SPEED
from snake_sim_ros.contact.problem import Joints, Outcome, Problem, solve_contacts, Solver
from snake_sim_ros.contact.prox_iteration import joint_laws_change, MOST_CHANGES, Trial
from snake_sim_ros.dynamics.balance import (
    axis_loads,
    control_impulses,
    joint_rates,
    link_inertia,
    smooth_momentum,
)
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.joint_control import read_by_controllers, START
from snake_sim_ros.dynamics.joint_drift import close_joints, furthest_angles, joint_violation
from snake_sim_ros.dynamics.joint_laws import begin_joint_laws, controller_impulses
from snake_sim_ros.dynamics.kinematics import (
    chain_geometry,
    copy_rows,
    end_coordinates,
    end_velocities,
    joint_coordinates,
    joint_frames,
    lies_flat_and_still,
    link_frames,
    middle_coordinates,
    rates_in_inertial_frame,
    twists,
)
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.rotations import product
from snake_sim_ros.stepping.model import Model, Workspace
from snake_sim_ros.stepping.pushes import add_pushes, whole_step
from snake_sim_ros.stepping.state import History, of_contacts
from snake_sim_ros.stepping.steps import (
    count_steps,
    iterations_left,
    LoopReport,
    note_outcome,
    noted,
    Steps,
    take_step,
)


@inlined
def begin_step(model: Model, work: Workspace, steps: Steps, k: int) -> Problem:
    """Return the contact problem of step k, section VII, with the velocities at its start."""
    q, u, R, chain = steps.q, steps.u, work.R, work.chain
    places, frames = model.robot.places, work.frames
    middle_coordinates(model.dt, q, u, work.q_mid)
    if model.robot.pd_scheme == START:
        link_frames(q[:, 3:], R)
        joint_frames(places, R, frames)
        rates_in_inertial_frame(R, u, work.omega)
        joint_coordinates(frames, work.omega, work.coordinate[0])
    link_frames(work.q_mid[:, 3:], R)
    joint_frames(places, R, frames)
    rates_in_inertial_frame(R, u, work.omega)
    joint_coordinates(frames, work.omega, work.coordinate[1])
    chain_geometry(places, R, frames, work.center, chain.axis)
    control = steps.history.control
    mid = work.coordinate[1]
    start = mid[:, :, 0], mid[:, :, 1], 0.5 * model.dt
    reference = read_by_controllers(
        model.robot.control, control, model.dt, start, steps.angle[k], steps.rate[k]
    )
    loads = work.torque, work.damping
    control_impulses(model.robot, model.dt, control, work.coordinate, reference, loads)
    laws_of_joints = model.robot.joint_laws
    if laws_of_joints.present:
        begin_joint_laws(laws_of_joints, work.axes, model.dt, mid, loads)
        if laws_of_joints.has_stops:
            furthest_angles(places, laws_of_joints.stop, q, mid, work.axes.furthest)
    axis_loads(work.torque, work.damping, chain)
    link_inertia(model.robot, R, work.center, chain.bare)
    smooth_momentum(model.robot, model.dt, (u, u), R, work.center, chain.momentum)
    stretch = whole_step(steps.pushes, k)
    add_pushes(steps.pushes, stretch, model.dt, R, work.center, chain.momentum)
    twists(u, work.omega, work.center, chain.twist)
    reach = reach_of_step(model.closed_gap, 0.5 * model.dt)
    pose = Pose(model.robot, work.q_mid, R, work.center)
    found = Found(work.closed, work.contacts, work.takes_part, chain.frame)
    count = find_contacts(model.obstacles, reach, pose, found)
    closed, contacts = work.closed[:count], work.contacts
    contact_velocities(closed, contacts, chain.frame, chain.twist)
    fall, impulse = -model.dt * model.robot.gravity[2], steps.history.impulse
    laws = apply_selection_rule(
        model.laws, closed, contacts, model.robot.mass, impulse, (PRESS_SPEED, fall)
    )
    predict_gaps(model.closed_gap, model.dt, closed, contacts)
    add_viscous_friction(laws.other, model.dt, closed, contacts, chain)
    joints = Joints(laws_of_joints.present, laws_of_joints, work.axes, work.torque, work.damping)
    return Problem(laws, closed, contacts, chain, work.pairs, joints)


@inlined
def begin_landing(problem: Problem, count: int, history: History) -> Problem:
    """Return the problem of the first `count` contacts, with velocities of the first solution."""
    laws, closed, contacts, chain, pairs, joints = problem
    contact_velocities(closed[:count], contacts, chain.frame, chain.twist)
    for a in closed[:count]:
        for j in range(5):
            history.change[a, j] = 0.0
    return Problem(laws, closed[:count], contacts, chain, pairs, joints)


@inlined
def solve_again(
    model: Model, work: Workspace, problem: Problem, trial: Trial, report: LoopReport
) -> bool:
    """Return whether the laws of the joints need another solution, and prepare it."""
    laws, _, contacts, chain, _, joints = problem
    joint_rates(model.robot.places, work.frames, chain.twist, work.axes.rate)
    if not joint_laws_change(laws, contacts, joints, trial, report):
        return False
    axis_loads(work.torque, work.damping, chain)
    return True


@inlined
def solve_step(
    solver: Solver, model: Model, work: Workspace, steps: Steps, problem: Problem
) -> tuple[Problem, Outcome, bool]:
    """
    Solve the contacts and, if they land, once more; see `closing.keep_closed`.

    Returns
    -------
    problem : Problem
        The problem whose solution the chain has.
    outcome : Outcome
        That of the last solution.
    lands : bool
        Whether it is the second one. `work.moving` then has the velocities of the first.

    """
    report, lands = steps.report[0], False
    most = report.iterations + model.iteration_limit
    while True:  # one call of the solver, which is compiled where it is called
        for attempt in range(MOST_CHANGES):
            left = iterations_left(most, report)
            outcome = solve_contacts(solver, problem, of_contacts(steps.history), left)
            trial = Trial(outcome.iterations, outcome.converged, attempt, left)
            if not solve_again(model, work, problem, trial, report):
                break
        if lands or outcome.iterations >= left or not outcome.converged:
            break
        if not contacts_land(problem.closed, problem.contacts):
            break
        if not turns_are_small(model.dt, work.chain.twist, report):
            break
        count = keep_closed(problem.closed, problem.contacts, NONE)
        end_velocities(work.chain.twist, work.R, work.center, work.moving)
        note_outcome(outcome, report)
        problem, lands = begin_landing(problem, count, steps.history), True
    return problem, outcome, lands


@inlined
def end_step(
    model: Model,
    work: Workspace,
    steps: Steps,
    problem: Problem,
    outcome: Outcome,
    lands: bool,
) -> bool:
    """
    Move q and u to the end of the step; return whether the loop continues.

    If contacts land, `work.moving` has the velocities that move the coordinates.
    """
    q, u, report = steps.q, steps.u, steps.report[0]
    if not turns_are_small(model.dt, work.chain.twist, report):
        return False
    loads, axes = (work.torque, work.damping), work.axes
    controller_impulses(model.robot.joint_laws, axes, loads, axes.rate, work.applied)
    end_velocities(work.chain.twist, work.R, work.center, u)
    end_coordinates(model.dt, work.q_mid, work.moving if lands else u, q)
    note_outcome(outcome, report)
    report.contacts = len(problem.closed)
    note_joints(model, q, report)
    robot = model.robot
    close_joints(model.drift_correction, robot.places, robot.mass, work.axes.furthest, q)
    goes_on = report_end(model, work, q, u, steps.history.settling, report)
    depth = close_step(model, work, problem, q)
    report.penetration_max = max(report.penetration_max, depth)
    return goes_on


@inlined
def close_step(model: Model, work: Workspace, problem: Problem, q: Array) -> float:
    """
    Move the coordinates at the end of a step, q (n, 7), until loaded contacts have no gaps.

    Contacts inside an obstacle are closed, too. A move after which the largest gap or
    penetration is much larger is taken back: contacts that depend on each other may need large
    moves, for which the chain is not linear.

    The problem is as it was solved; its impulses and twists are replaced, and `work.q_mid` by the
    coordinates before a move. Return the penetration of the robot at the end [m].
    """
    robot, closed, contacts, q_before = model.robot, problem.closed, problem.contacts, work.q_mid
    solution = contacts.solution
    for a in closed:
        solution.is_loaded[a] = solution.impulse[a, 0] > 0.0
    depth = penetration(model.obstacles, robot, q)
    before = depth_before = math.inf
    for move in range(MOST_MOVES + 1 if model.closed_gap > 0.0 else 0):
        for a in closed:
            solution.end_gap[a] = gap_at(model.obstacles, robot, q, contacts, a)
        to_close, worst = gaps_to_close(most_closed(model.dt), model.dt, closed, contacts)
        worst = max(worst, depth)
        if worst > GAP_GROWTH * before:
            copy_rows(q_before, q, 7)
            return depth_before
        if move == MOST_MOVES or not to_close > left_gap(model.closed_gap):
            break
        before, depth_before = worst, depth
        copy_rows(q, q_before, 7)
        for _ in range(MOST_RELEASES + 1):
            close_on_links(problem, 1.0)
            way = Move(robot.places, work.chain.twist, work.center, 1.0, to_close)
            if not let_go(closed, contacts, problem.pairs, way):
                break
        move_links(work.chain.twist, work.center, q)
        close_joints(model.drift_correction, robot.places, robot.mass, work.axes.furthest, q)
        depth = penetration(model.obstacles, robot, q)
    return depth


@inlined
def turns_are_small(dt: float, twist: Array, report: LoopReport) -> bool:
    """Return whether all links turn by less than pi/2 in dt, or report the first that does not."""
    for i in range(len(twist)):
        turn = dt * math.sqrt(twist[i, 0] ** 2 + twist[i, 1] ** 2 + twist[i, 2] ** 2)
        if not (turn < math.pi / 2 and math.isfinite(twist[i, 3] + twist[i, 4] + twist[i, 5])):
            report.failed_link, report.failed_turn = i + 1, turn
            return False
    return True


@inlined
def note_joints(model: Model, q: Array, report: LoopReport) -> None:
    """Report how far the joints are open."""
    gap, twist = joint_violation(model.robot.places, q)
    report.joint_gap_max = max(report.joint_gap_max, gap)
    report.joint_twist_max = max(report.joint_twist_max, twist)


@inlined
def report_end(
    model: Model, work: Workspace, q: Array, u: Array, settling: Array, report: LoopReport
) -> bool:
    """
    Report a step at its end.

    Returns
    -------
    bool
        False if the loop ends because the robot has lain flat and still for `settle_steps`.

    """
    report.steps += 1
    report.overflows += overflow(model.obstacles)
    if model.settle_steps == 0:
        return True
    rates_in_inertial_frame(work.R, u, work.omega)
    lies = lies_flat_and_still(model.robot.spheres, q, u, work.omega)
    left = settling[0] - 1.0 if lies else model.settle_steps
    settling[0] = left
    return left > 0.0


class Moreau(NamedTuple):
    """The step of the paper, with a contact solver; see `contact.problem.solve_contacts`."""

    solver: Solver


@take_step.register(Moreau)
@inlined
def take_moreau_step(
    own: Moreau, model: Model, work: Workspace, steps: Steps, k: int, shows: bool
) -> tuple[bool, float]:
    """Take step k, unless it diverges; see `steps.take_step`."""
    report = steps.report[0]
    before = noted(report)
    problem = begin_step(model, work, steps, k)
    problem, outcome, lands = solve_step(own.solver, model, work, steps, problem)
    goes_on = end_step(model, work, steps, problem, outcome, lands)
    count_steps(before, report)
    return goes_on, model.dt


def where_impulses_acted(scene: Scene, q: Array, u: Array) -> Array:
    """
    Return the coordinates (m, n, 7) at which the impulses before some states acted.

    They acted at the middle of the step. q and u are those of m states; see `state.State`.
    """
    acted = q.copy()
    acted[..., :3] -= scene.dt / 2 * u[..., :3]
    spin = np.concatenate([np.zeros_like(u[..., :1]), u[..., 3:]], axis=-1)
    acted[..., 3:] -= scene.dt / 4 * product(q[..., 3:], spin)
    acted[..., 3:] /= np.linalg.norm(acted[..., 3:], axis=-1, keepdims=True)
    return acted

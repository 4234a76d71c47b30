# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A method of second order: two-step differences in place of the paper's midpoint.

Deviation: the step of the paper takes its geometry at the middle, but friction, joint rates and
constraints at the velocity of the end. It is therefore of first order. Here all are taken at the
end, by BDF2 [1]_ with the steps of `formula`:

    M u_E = M u_hat + h(q*, u*) h + W(q*) P,    x_E = x_hat + h x'(q*, u_E).

The star marks the predicted end. The coordinates x are those of `motion`, with which joints are
closed exactly, so that nothing drifts. The contact laws are unchanged. They hold for u_E and are
solved by Newton's method. Contacts that may close in the step take part with their gaps; see
`events`. Those that neither carried load nor are closed at the predicted end are left out at
first, and join where the solution without them would close them: a contact that does not push
changes nothing. What a step leaves of the gaps of loaded contacts is closed by a move of the
configuration alone; see `contact.closing`. A part of a step that still ends in an obstacle is
repeated, first with the contacts that are in it, then with half of its length.

The formula never differentiates across an event, which is any jump of the velocity: a contact that
lands, however softly; a normal impulse beyond what forces make in a step (an impact without
collision); the beginning or the end of a push, where parts of a step end (see `pushes`); a sample
of the control loop or a command that changes a held torque; or a state that is not the end of the
step before (an impulse, another scene). The step after an event starts anew with

    u_hat = u_A, h = dt for velocities;    x_hat = x_A + dt/2 x'_A, h = dt/2 for coordinates,

which is exact for constant forces; for other forces each event adds an error of dt^2. If the
velocities of a given state violate the joints, the first part is the impact that corrects them:
backward Euler, ``x_hat = x_A`` and h = dt for both. The next part then starts anew.

Joint angles are coordinates of this method, so that a stop is exact: the rate of the end leads to
the stop at most, ``w <= (limit - angle_hat)/h_q``; see `dynamics.joint_laws`. A joint that meets
its stop lands as a contact does. The rate after the impact is that of a second solution, in which
the impulses of controllers and friction stay what they are, and the stop holds with the bound 0.

The same step in dense NumPy is in `test/oracle/bdf2.py`, to read beside these equations.

.. [1] E. Hairer, G. Wanner, "Solving Ordinary Differential Equations II", 1996, ch. V; for steps
   of any ratio "... I", 1993, ch. III.5.
"""

from typing import NamedTuple

from snake_sim_ros.contact.closing import keep_closed
from snake_sim_ros.contact.detection import find_contacts, Found, LANDING_SPEED, penetration, Pose
from snake_sim_ros.contact.directions import contact_velocities
from snake_sim_ros.contact.laws import add_viscous_friction, apply_selection_rule
from snake_sim_ros.contact.newton import prepare_contacts, solve_prepared
from snake_sim_ros.contact.problem import Joints, Problem
from snake_sim_ros.dynamics.balance import hold_absent_axes, link_inertia, smooth_momentum
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.joint_control import (
    held_torque,
    implicit_pd_law,
    read_by_controllers,
    torques_jump,
)
from snake_sim_ros.dynamics.joint_laws import (
    begin_axis_impact,
    begin_predicted_laws,
    controller_impulses,
)
from snake_sim_ros.dynamics.kinematics import copy_rows
from snake_sim_ros.dynamics.mechanism import Mechanism
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.stepping.bdf2.events import (
    add_approaching,
    DEEP,
    deep_contacts_take_part,
    Ending,
    Events,
    events,
    find_end_gaps,
    forget_who_took_part,
    leave_gaps,
    likely_to_push,
    place_end,
)
from snake_sim_ros.stepping.bdf2.formula import (
    ANEW,
    copy_history,
    end_references,
    first_place,
    judge_part,
    keep_references,
    least_iterations,
    next_place,
    part_of,
    path_error,
    SMOOTH,
    Task,
    TICKS,
    UNKNOWN,
)
from snake_sim_ros.stepping.bdf2.motion import (
    Bdf2Arrays,
    formula,
    keep,
    keep_state,
    keep_velocities,
    predict_end,
    recognize,
)
from snake_sim_ros.stepping.model import Model, Workspace
from snake_sim_ros.stepping.moreau import report_end, turns_are_small
from snake_sim_ros.stepping.pushes import add_pushes
from snake_sim_ros.stepping.state import History, of_contacts
from snake_sim_ros.stepping.steps import (
    count_steps,
    iterations_left,
    note_outcome,
    noted,
    Steps,
    take_step,
)

# Replaces `laws.PRESS_SPEED`, which is not small beside errors of second order: loads of a
# flat robot follow the heights of its links through the stiff joints, so that these must not sink.
PRESS_SPEED = 3e-8  # [m/s]

# Moves of the configuration in a part that close gaps. There are none at the iteration limit: such
# a part is not repeated if they drive links into an obstacle.
MOST_CLOSINGS = 3

# Where the controller may act. For both the method takes it at the end of the step.
IMPLICIT_SCHEMES = ('average', 'end')


@inlined
def begin_impact(robot: Mechanism, work: Workspace) -> None:
    """Fill the laws of the joints in an impact: the torques stay what they are."""
    laws, axes, chain = robot.joint_laws, work.axes, work.chain
    for j in range(len(work.applied)):
        for k in range(2):
            if laws.present:
                begin_axis_impact(laws, axes, j, k, work.torque[j, k], work.damping[j, k])
            else:
                chain.torque[j, k], chain.damping[j, 2 * k] = work.applied[j, k], 0.0
    hold_absent_axes(chain)


class Terms(NamedTuple):
    """What a part of a step is solved with."""

    h: float  # time over which forces act, see `formula` [s]
    h_q: float  # time over which the velocities of the end act on coordinates, see there [s]
    late: float  # time for which coordinates have moved before that [s]
    most: int  # iterations that the report is to have after the part


@inlined
def begin_part(
    model: Model, own: Bdf2Arrays, work: Workspace, terms: Terms, history: History
) -> Problem:
    """
    Return the contact problem for the predicted end of the step.

    Its closed contacts are those that can close in the step.
    """
    chain, control, h, h_q = work.chain, history.control, terms.h, terms.h_q
    for j in range(len(own.end_angle)):
        for k in range(2):
            stiffness, damping = model.robot.stiffness[j, k], model.robot.damping[j, k]
            torque, rate = 0.0, own.end_rate[j, k]
            if model.robot.control.present:
                torque, stiffness, rate = held_torque(
                    model.robot.control, control, j, k, stiffness, rate
                )
            reference, gains = (own.end_angle[j, k], rate), (stiffness, damping)
            torque, resistance = implicit_pd_law(
                h_q, own.hat.angle[j, k], reference, gains, torque
            )
            work.torque[j, k], work.damping[j, k] = h * torque, h * resistance
            chain.torque[j, k], chain.damping[j, 2 * k] = work.torque[j, k], work.damping[j, k]
        chain.damping[j, 1] = 0.0
    laws_of_joints, loads = model.robot.joint_laws, (work.torque, work.damping)
    if laws_of_joints.present:  # the solver loads the chain with them
        way = history.memory.end.angle, own.hat.angle
        begin_predicted_laws(laws_of_joints, work.axes, (h, h_q), way, own.star.rate, loads)
    hold_absent_axes(chain)
    link_inertia(model.robot, work.R, work.center, chain.bare)
    velocities = own.hat.u, own.star.u
    smooth_momentum(model.robot, h, velocities, work.R, work.center, chain.momentum)
    reach = max(model.closed_gap, LANDING_SPEED * h_q)
    pose = Pose(model.robot, work.q_mid, work.R, work.center)
    found = Found(work.closed, work.contacts, work.takes_part, chain.frame)
    count = find_contacts(model.obstacles, reach, pose, found)
    closed, contacts = work.closed[:count], work.contacts
    for a in closed:
        work.takes_part[a] = 1
    contact_velocities(closed, contacts, chain.frame, chain.twist)
    leave_gaps(model, h_q, terms.late, closed, contacts, history.impulse)
    add_viscous_friction(model.laws.other, h, closed, contacts, chain)
    laws = apply_selection_rule(
        model.laws, closed, contacts, model.robot.mass, history.impulse,
        (PRESS_SPEED, -h * model.robot.gravity[2]),
    )  # fmt: skip
    joints = Joints(laws_of_joints.present, laws_of_joints, work.axes, work.torque, work.damping)
    return Problem(laws, closed, contacts, chain, work.pairs, joints)


@inlined
def solve_landing(
    model: Model, own: Bdf2Arrays, work: Workspace, problem: Problem, terms: Terms, steps: Steps
) -> tuple[bool, Events, int]:
    """
    Solve the contacts and, if they land, the impact, until the report has `most` iterations.

    Each solution may take `least_iterations` all the same, but once the others have used them up,
    all contacts that can close take part from the start, so that there are two solutions at most.

    The velocities that move the coordinates are then in own.moving, and those after the impact in
    own.end. An impact starts from the torques of the joints, which belong to the impulses of the
    first solution. If either does not converge, there is no impact: those torques would drive the
    links. The next part then stops what still approaches.

    Returns
    -------
    is_small : bool
        Whether `turns_are_small`.
    found : Events
    count : int
        Number of contacts that are closed at the end, the first ones in the problem's `closed`.

    """
    laws, closed, contacts, chain, pairs, joints = problem
    history, report, most = of_contacts(steps.history), steps.report[0], terms.most
    found, impact = Events(False, False, 0), False
    count = len(closed)
    if report.iterations < most:
        count = likely_to_push(closed, contacts)
    while True:  # one call of the solver, which is compiled where it is called
        landing = Problem(laws, closed[:count], contacts, chain, pairs, joints)
        most = max(most, report.iterations + least_iterations(model.iteration_limit))
        prepare_contacts(work.operator, landing)
        left = iterations_left(most, report)
        outcome = solve_prepared(work.operator, landing, history, left)
        note_outcome(outcome, report)
        if impact and not outcome.converged:
            break
        if not turns_are_small(model.dt, chain.twist, report):
            return False, found, count
        if impact:
            keep_velocities(model.robot.places, work, own.end)
            break
        contact_velocities(closed[count:], contacts, chain.frame, chain.twist)
        more = add_approaching(closed, count, contacts)
        if more > count:
            count = more
            continue
        keep_velocities(model.robot.places, work, own.moving)
        keep(own.moving, own.end)
        loads = joints.torque, joints.damping
        meets = controller_impulses(
            model.robot.joint_laws, work.axes, loads, own.moving.rate, work.applied
        )
        find_end_gaps(terms.h_q, closed, contacts)
        found = events(model, terms.h, closed, contacts)
        if meets:
            found = Events(True, True, found.closed)
        if not (found.lands and outcome.converged):
            break
        count, impact = keep_closed(closed, contacts, model.closed_gap), True
        begin_impact(model.robot, work)
    return True, found, count


class Part(NamedTuple):
    """What is known of a part of a step that may be taken; its end is in own.end and own.q."""

    is_small: bool  # whether `turns_are_small`
    found: Events  # jumps of the velocities in it
    h: float  # time for which impulses acted [s]
    depth: float  # penetration at its end [m]


@inlined
def one_part(own: Bdf2Arrays, model: Model, work: Workspace, task: Task, steps: Steps) -> Part:
    """Return the `Part` that solves a task, with the references in own.end_angle."""
    report, history = steps.report[0], steps.history
    memory, depth = history.memory, 0.0
    span = memory.span[0]
    h, h_q = formula(model.robot.mass, task.dt, memory, own)
    predict_end(model, h_q, memory, own, work)
    scale = h / (span if span > 0.0 else model.dt)
    for a in range(len(history.impulse)):
        if history.impulse[a, 0] > 0.0:
            for j in range(5):
                history.impulse[a, j] *= scale
            history.change[a, 0] *= scale
    terms = Terms(h, h_q, task.dt - h_q, task.most)
    problem = begin_part(model, own, work, terms, history)
    add_pushes(steps.pushes, task.stretch, h, work.R, work.center, work.chain.momentum)
    is_small, found, count = solve_landing(model, own, work, problem, terms, steps)
    if is_small:
        most_closings = MOST_CLOSINGS if report.iterations < task.most else 0
        ending = Ending(count, h_q, most_closings, memory.depth[0] > DEEP)
        place_end(model, own, work, problem, ending, steps.q)
        depth = penetration(model.obstacles, model.robot, own.q)
    return Part(is_small, found, h, depth)


@inlined
def take_part(
    own: Bdf2Arrays, model: Model, work: Workspace, dt: float, part: Part, steps: Steps
) -> None:
    """Move to the end of a `Part` of length dt [s]."""
    memory, history, report = steps.history.memory, steps.history, steps.report[0]
    for j in range(len(work.applied)):
        for k in range(2):
            work.applied[j, k] *= model.dt / part.h
    copy_rows(own.moving.angle, own.end.angle, 2)
    for k in range(7):
        own.end.pose[k] = own.moving.pose[k]
    if part.found.jumps:
        for a in range(len(history.change)):
            if history.impulse[a, 0] > 0.0:
                for j in range(5):
                    history.change[a, j] = 0.0
    keep(memory.end, memory.start)
    keep(own.end, memory.end)
    keep_state(own.q, own.end.u, steps.q, steps.u)
    memory.span[0], memory.dt[0], memory.depth[0] = part.h, dt, part.depth
    memory.phase[0] = ANEW if part.found.jumps or memory.phase[0] == UNKNOWN else SMOOTH
    report.contacts = max(report.contacts, part.found.closed)
    report.penetration_max = max(report.penetration_max, part.depth)


@inlined
def bdf2_step(own: Bdf2Arrays, model: Model, work: Workspace, steps: Steps, k: int) -> bool:
    """Take step k in parts; return whether the loop continues."""
    report, memory = steps.report[0], steps.history.memory
    start = memory.end.angle, memory.end.rate, 0.0
    angle, rate = read_by_controllers(
        model.robot.control, steps.history.control, model.dt, start, steps.angle[k], steps.rate[k]
    )
    if memory.phase[0] == SMOOTH and torques_jump(model.robot.control, steps.history.control):
        memory.phase[0] = ANEW
    known, before = memory.span[0] > 0.0, noted(report)
    ends = own.end_angle, own.end_rate
    most = before[0] + model.iteration_limit
    report.contacts = 0
    keep_state(steps.q, steps.u, own.q_start, own.u_start)
    place = first_place(model.dt, model.path_tolerance, steps.pushes, k, memory)
    forget_who_took_part(work)
    while place.done < TICKS:
        dt, late = part_of(place, model.dt)
        end_references(model.dt, late, known, (angle, rate), memory, ends)
        copy_history(of_contacts(steps.history), own.kept)
        part = one_part(own, model, work, Task(dt, place.stretch, most), steps)
        if not part.is_small:
            keep_state(own.q_start, own.u_start, steps.q, steps.u)
            return False
        error = path_error(dt, 3, own.moving.u, own.star.u)
        is_taken, size = judge_part(model.path_tolerance, error, place.size)
        was_deep = memory.depth[0] > DEEP
        if report.iterations >= most:
            is_taken, size = True, min(2 * place.size, TICKS)
        elif part.depth > (memory.depth[0] + model.closed_gap if was_deep else DEEP):
            if deep_contacts_take_part(model, work, own.q):
                is_taken, size = False, place.size
            elif place.size > 1:
                is_taken, size = False, place.size // 2
        if is_taken:
            take_part(own, model, work, dt, part, steps)
            forget_who_took_part(work)
        else:
            copy_history(own.kept, of_contacts(steps.history))
        place = next_place(place, is_taken, size, steps.pushes, memory)
    report.further_parts += place.parts - 1
    keep_references(place.size, rate, memory)
    count_steps(before, report)
    return report_end(model, work, steps.q, steps.u, steps.history.settling, report)


@take_step.register(Bdf2Arrays)
@inlined
def take_bdf2_step(
    own: Bdf2Arrays, model: Model, work: Workspace, steps: Steps, k: int, shows: bool
) -> tuple[bool, float]:
    """Take step k, unless it diverges; see `steps.take_step`."""
    memory = steps.history.memory
    if k == 0:
        recognize(model, work, steps.q, steps.u, memory)
    goes_on = bdf2_step(own, model, work, steps, k)
    if shows or not goes_on:
        keep_state(steps.q, steps.u, memory.q, memory.end.u)
    return goes_on, memory.span[0]


def what_is_not_possible(scene: Scene) -> str:
    """Return why the method cannot run a scene, as a sentence; empty if it can."""
    if scene.pd_scheme in IMPLICIT_SCHEMES:
        return ''
    return (
        f'pd_scheme {scene.pd_scheme} is explicit, and method bdf2 takes the controller at the '
        f'end of a step; choose pd_scheme {" or ".join(IMPLICIT_SCHEMES)}, or method newton'
    )


def where_impulses_acted(scene: Scene, q: Array, u: Array) -> Array:
    """
    Return the coordinates (m, n, 7) at which the impulses before some states acted.

    They acted at the end of the step, up to the error of its prediction.
    """
    return q

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The method of `stepping.bdf2` in planar coordinates.

All contacts with the floor stay closed and their loads follow from equilibrium, so that nothing
lands and no impulse is sudden. The only event is a state that is not the end of the step before.
"""

import math
from typing import NamedTuple

import numpy as np

from snake_sim_ros.contact.detection import Patches
from snake_sim_ros.contact.problem import ContactHistory, make_contact_history, Outcome
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.joint_control import implicit_pd_law
from snake_sim_ros.dynamics.joint_laws import begin_predicted_laws
from snake_sim_ros.dynamics.kinematics import copy_rows
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.bdf2.formula import (
    ANEW,
    coefficients,
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
from snake_sim_ros.stepping.bdf2.motion import CONSISTENT_SPEED
from snake_sim_ros.stepping.planar.equilibrium import (
    fill_grips,
    fill_momentum,
    place_links_in_plane,
)
from snake_sim_ros.stepping.planar.model import PlanarModel, PlanarWorkspace
from snake_sim_ros.stepping.planar.moreau import (
    begin_planar_impact,
    end_planar_velocities,
    held_point,
    hold_absent_yaw_axes,
    is_planar,
    joint_impulses_in_plane,
    move_in_plane,
    stop_impact,
)
from snake_sim_ros.stepping.planar.solvers import (
    PlanarNewton,
    SECOND_CHANGE,
    solve_planar_contacts,
)
from snake_sim_ros.stepping.pushes import add_pushes_in_plane
from snake_sim_ros.stepping.state import of_contacts
from snake_sim_ros.stepping.steps import (
    copy_numbers,
    count_steps,
    iterations_left,
    note_outcome,
    noted,
    Steps,
    take_back,
    take_step,
)


class PlanarMotion(NamedTuple):
    """A state in the plane, as `bdf2.motion.Motion`."""

    q: Array  # (n+2,) center of mass x y [m] and headings of all links [rad], in I
    u: Array  # (n, 3) velocities x y of the link centers [m/s] and turning rates [rad/s], in I


class PlanarBdf2Memory(NamedTuple):
    """What the method keeps of the last step, besides `model.PlanarMemory`; as `Bdf2Memory`."""

    end: PlanarMotion  # state at its end
    start: PlanarMotion  # state at its start
    reference_rate: Array  # (n-1, 2) rates of the joint references [rad/s]
    dt: Array  # (1,) its length [s]
    span: Array  # (1,) time for which its impulses acted [s], 0 before the first step
    phase: Array  # (1,) UNKNOWN, ANEW or SMOOTH
    ticks: Array  # (1,) length of the next step, in parts of a step of the scene

    def last_span(self) -> float:
        """Return the time for which the last impulses acted [s], 0 before the first step."""
        return float(self.span[0])


class PlanarBdf2Arrays(NamedTuple):
    """Arrays that a step fills besides `model.PlanarWorkspace`, as `Bdf2Arrays`."""

    hat: PlanarMotion  # what the formula combines of the states before
    star: PlanarMotion  # velocities at the predicted end; the rest is not used
    end: PlanarMotion  # end of the step
    before: PlanarMotion  # start of the step of the scene, for one that is not taken
    # (n, 3) velocities that move the coordinates, as `u`: those of end before an impact
    moving: Array
    end_angle: Array  # (n-1, 2) joint references at the end [rad]
    end_rate: Array  # (n-1, 2) [rad/s]
    kept: ContactHistory  # before a part of the step
    solver: PlanarNewton  # of the contacts


def make_planar_motion(n: int) -> PlanarMotion:
    """Return arrays for a state of n links."""
    return PlanarMotion(np.zeros(n + 2), np.zeros((n, 3)))


def make_planar_bdf2_memory(n: int) -> PlanarBdf2Memory:
    """Return the memory before the first step, for n links."""
    return PlanarBdf2Memory(
        make_planar_motion(n), make_planar_motion(n), np.zeros((n - 1, 2)),
        np.zeros(1), np.zeros(1), np.zeros(1), np.zeros(1),
    )  # fmt: skip


def make_planar_arrays(n: int, contacts: int) -> PlanarBdf2Arrays:
    """Return the arrays for n links and a number of contacts."""
    hat, star, end, before = (make_planar_motion(n) for _ in range(4))
    angle, rate = np.zeros((2, n - 1, 2))
    return PlanarBdf2Arrays(
        hat,
        star,
        end,
        before,
        np.zeros((n, 3)),
        angle,
        rate,
        make_contact_history(contacts),
        PlanarNewton(),
    )


@inlined
def keep_planar(motion: PlanarMotion, to: PlanarMotion) -> None:
    """Copy a state."""
    copy_numbers(motion.q, to.q)
    copy_rows(motion.u, to.u, 3)


@inlined
def recognize_in_plane(
    model: PlanarModel, work: PlanarWorkspace, q: Array, u: Array, memory: PlanarBdf2Memory
) -> None:
    """Take q and u as the state to continue from, as `bdf2.motion.recognize`."""
    end = memory.end
    held_x, held_y = held_point(model, q)
    copy_numbers(q, end.q)
    end.q[0], end.q[1] = q[0] + held_x, q[1] + held_y
    copy_rows(u, end.u, 3)
    memory.phase[0] = ANEW if starts_anew(model, work, q, u) else UNKNOWN
    memory.ticks[0] = 0.0


@inlined
def starts_anew(model: PlanarModel, work: PlanarWorkspace, q: Array, u: Array) -> bool:
    """Return whether the velocities of a given state satisfy the joints and the floor."""
    for i in range(len(u)):
        for k in range(3):
            if work.impact[i, k] != 0.0:
                return False
    fastest = 0.0
    for j in range(len(u) - 1):
        c, s = math.cos(q[2 + j]), math.sin(q[2 + j])
        next_c, next_s = math.cos(q[3 + j]), math.sin(q[3 + j])
        inner, outer = model.front[j] * u[j, 2], model.rear[j + 1] * u[j + 1, 2]
        apart_x = u[j + 1, 0] - u[j, 0] + inner * s + outer * next_s
        apart_y = u[j + 1, 1] - u[j, 1] - inner * c - outer * next_c
        fastest = max(fastest, abs(apart_x), abs(apart_y))
        if model.side[j, 0] == 0.0:
            fastest = max(fastest, model.front[j] * abs(u[j + 1, 2] - u[j, 2]))
    return fastest <= CONSISTENT_SPEED


@inlined
def planar_formula(
    model: PlanarModel, dt: float, memory: PlanarBdf2Memory, own: PlanarBdf2Arrays
) -> tuple[float, float]:
    """
    Fill own.hat and the velocities of own.star as `bdf2.formula`.

    Returns
    -------
    h, h_q : float
        As from `bdf2.formula`.

    """
    end, start, hat, star = memory.end, memory.start, own.hat, own.star
    w, c, h, half = coefficients(dt, memory)
    for k in range(len(end.q)):
        hat.q[k] = end.q[k] + c * (end.q[k] - start.q[k])
    for i in range(len(end.u)):
        for k in range(3):
            change = end.u[i, k] - start.u[i, k]
            hat.u[i, k] = end.u[i, k] + c * change
            star.u[i, k] = end.u[i, k] + w * change
    if half > 0.0:
        move_in_plane(model, half, hat.q, end.u)
    return h, h - half


@inlined
def predict_loads(
    h: float, dt: float, work: PlanarWorkspace, memory: PlanarBdf2Memory, history: ContactHistory
) -> None:
    """Scale what the last step left of the contacts to one of dt, with impulses for a time h."""
    span, before = memory.span[0], memory.dt[0]
    if span == 0.0:
        return
    scale, ratio = h / span, dt / before
    if scale == 1.0 and ratio == 1.0:
        return
    for a in work.closed:
        for j in range(3):
            history.impulse[a, j] *= scale
        history.change[a, 0] *= scale * ratio
        history.change[a, SECOND_CHANGE] *= scale * ratio * ratio
        history.change[a, 1] *= ratio
        history.change[a, 2] *= ratio


@inlined
def begin_planar_part(
    model: PlanarModel, own: PlanarBdf2Arrays, work: PlanarWorkspace, start: Array, h: float,
    h_q: float,
) -> None:  # fmt: skip
    """
    Fill the workspace for the contact solver, with the references in own.end_angle.

    `start`, shape (n+2,), is q of the `PlanarMotion` at the start of the part.
    """
    hat, u_star = own.hat, own.star.u
    for i in range(len(u_star)):
        theta = hat.q[2 + i] + h_q * u_star[i, 2]
        work.heading[i, 0], work.heading[i, 1] = math.cos(theta), math.sin(theta)
    place_links_in_plane(model, work, model.fall * (h / model.dt))
    for j in range(len(own.end_angle)):
        reference = own.end_angle[j, 0], own.end_rate[j, 0]
        bend = hat.q[3 + j] - hat.q[2 + j]
        gains = model.stiffness[j], model.damping[j]
        torque, damping = implicit_pd_law(h_q, bend, reference, gains, 0.0)
        work.torque[j], work.chain.damping[j] = torque * h, damping * h
        work.bend[j, 0, 0], work.bend[j, 0, 1] = bend, u_star[j + 1, 2] - u_star[j, 2]
        work.bend[j, 0, 2] = start[3 + j] - start[2 + j]
    hold_absent_yaw_axes(model, work)
    if model.joint_laws.present:
        way, loads = (work.bend[:, :, 2], work.bend[:, :, 0]), (work.yaw_torque, work.yaw_damping)
        begin_predicted_laws(model.joint_laws, work.axes, (h, h_q), way, work.bend[:, :, 1], loads)
    fill_predicted_grips(model.patches, model, own, work, h_q)
    fill_momentum(model, work, hat.u, u_star)


@inlined
def fill_predicted_grips(
    patches: Patches | None,
    model: PlanarModel,
    own: PlanarBdf2Arrays,
    work: PlanarWorkspace,
    h_q: float,
) -> None:
    """Fill the grip of the contacts at the predicted end; see `equilibrium.fill_grips`."""
    if patches is None:
        return
    x, y = own.hat.q[0], own.hat.q[1]
    for i in range(len(work.center)):
        x += model.share[i] * (h_q * own.star.u[i, 0] - work.center[i, 0])
        y += model.share[i] * (h_q * own.star.u[i, 1] - work.center[i, 1])
    fill_grips(patches, model, work, x, y)


class PlanarPart(NamedTuple):
    """What is known of a part of a step that may be taken."""

    outcome: Outcome  # of the last solution of the contacts
    h: float  # time over which forces act, from `planar_formula` [s]
    h_q: float  # time over which velocities act on coordinates [s]
    meets: bool  # whether a joint meets its stop


@inlined
def planar_part(
    own: PlanarBdf2Arrays, model: PlanarModel, work: PlanarWorkspace, task: Task, steps: Steps
) -> PlanarPart:
    """
    Return the part that solves a task, with the references in own.end_angle.

    Its velocities are in own.end; if a joint meets its stop, those after this impact.
    """
    dt, stretch, most = task
    history, memory, report = steps.history, steps.history.memory.scheme, steps.report[0]
    h, h_q = planar_formula(model, dt, memory, own)
    contact_history, meets = of_contacts(history), False
    predict_loads(h, dt, work, memory, contact_history)
    begin_planar_part(model, own, work, memory.end.q, h, h_q)
    add_pushes_in_plane(steps.pushes, stretch, h, work.heading, work.center, work.momentum)
    for impact in range(2):  # one call of the solver, which is compiled where it is called
        most = max(most, report.iterations + least_iterations(model.iteration_limit))
        left = iterations_left(most, report)
        outcome = solve_planar_contacts(
            own.solver, model, work, work.closed, contact_history, left
        )
        note_outcome(outcome, report)
        if impact:
            break
        end_planar_velocities(work, own.moving)
        meets = joint_impulses_in_plane(model, work)
        if not (meets and outcome.converged):
            break
        begin_planar_impact(model, work)
    end_planar_velocities(work, own.end.u)
    return PlanarPart(outcome, h, h_q, meets)


@inlined
def take_planar(
    own: PlanarBdf2Arrays,
    model: PlanarModel,
    work: PlanarWorkspace,
    dt: float,
    part: PlanarPart,
    memory: PlanarBdf2Memory,
) -> None:
    """Move to the end of a part of length dt [s]."""
    keep_planar(memory.end, memory.start)
    keep_planar(own.hat, memory.end)
    copy_rows(own.end.u, memory.end.u, 3)
    move_in_plane(model, part.h_q, memory.end.q, own.moving)
    for j in range(len(work.applied)):
        for axis in range(2):
            work.applied[j, axis] *= model.dt / part.h
    stop_impact(work)
    memory.span[0], memory.dt[0] = part.h, dt
    memory.phase[0] = ANEW if part.meets or memory.phase[0] == UNKNOWN else SMOOTH


@inlined
def planar_step(
    own: PlanarBdf2Arrays, model: PlanarModel, work: PlanarWorkspace, steps: Steps, k: int
) -> bool:
    """Take step k; return whether it was taken."""
    report, memory = steps.report[0], steps.history.memory.scheme
    angle, rate = steps.angle[k], steps.rate[k]
    known, ends = memory.span[0] > 0.0, (own.end_angle, own.end_rate)
    before = noted(report)
    most = before[0] + model.iteration_limit
    if memory.phase[0] == UNKNOWN:
        recognize_in_plane(model, work, steps.q, steps.u, memory)
    keep_planar(memory.end, own.before)
    place = first_place(model.dt, model.path_tolerance, steps.pushes, k, memory)
    while place.done < TICKS:
        dt, late = part_of(place, model.dt)
        end_references(model.dt, late, known, (angle, rate), memory, ends)
        if model.path_tolerance > 0.0:
            copy_history(of_contacts(steps.history), own.kept)
        part = planar_part(own, model, work, Task(dt, place.stretch, most), steps)
        error = path_error(dt, 2, own.moving, own.star.u)
        taken, size = judge_part(model.path_tolerance, error, place.size)
        taken = taken or report.iterations >= most
        if not taken:
            copy_history(own.kept, of_contacts(steps.history))
        elif is_planar(model, work, steps, part.outcome):
            take_planar(own, model, work, dt, part, memory)
        else:
            keep_planar(own.before, memory.end)
            memory.phase[0] = UNKNOWN
            take_back(before, report)
            return False
        place = next_place(place, taken, size, steps.pushes, memory)
    report.further_parts += place.parts - 1
    keep_references(place.size, rate, memory)
    count_steps(before, report)
    report.steps += 1
    report.contacts = model.floor
    return True


@inlined
def fill_state(model: PlanarModel, end: PlanarMotion, steps: Steps) -> None:
    """Fill q and u of the steps from a `PlanarMotion`."""
    q = steps.q
    copy_numbers(end.q, q)
    copy_rows(end.u, steps.u, 3)
    held_x, held_y = held_point(model, q)
    q[0], q[1] = end.q[0] - held_x, end.q[1] - held_y


@take_step.register(PlanarBdf2Arrays)
@inlined
def take_bdf2_step_in_plane(
    own: PlanarBdf2Arrays,
    model: PlanarModel,
    work: PlanarWorkspace,
    steps: Steps,
    k: int,
    shows: bool,
) -> tuple[bool, float]:
    """Take step k, unless it is not planar; see `steps.take_step`."""
    memory = steps.history.memory.scheme
    goes_on = planar_step(own, model, work, steps, k)
    if (shows or not goes_on) and steps.report[0].steps > 0:
        fill_state(model, memory.end, steps)
    return goes_on, memory.span[0]

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Contacts that close in a part of a step of `bdf2`, jumps of velocities, and the end of a part.

Deviation: a contact with a gap takes part when it may close in the step, with the law
``gamma_N + (g - h gamma_N*)/h + compliance P_N >= 0``: the step ends with the gap closed, neither
open nor inside the floor. An inelastic impact in the step leads to the same configuration up to
dt^2, since the impulse closes the gap whenever in the step it acts. A contact that sticks as it
lands is taken to stick for the whole step, which is off by dt times the jump of the sliding
velocity. An impact gives the velocity afterwards: the contacts that closed are solved once more
without their gaps, with joints that are free, since no spring or damper acts in no time. With
forces of a whole step instead, its stiff controller would stop a robot with the link that lands.

At the end of a part the gaps of loaded contacts are closed, and a part that ends with contacts
deep in an obstacle is repeated with them.
"""

from typing import NamedTuple

from snake_sim_ros.contact.closing import (
    close_gaps,
    gaps_to_close,
    left_gap,
    let_go,
    most_closed,
    MOST_RELEASES,
    Move,
)
from snake_sim_ros.contact.contacts import Contacts
from snake_sim_ros.contact.detection import find_contacts, Found, gap_at, Pose
from snake_sim_ros.contact.laws import IMPACT_WEIGHTS
from snake_sim_ros.contact.newton import condense_anew
from snake_sim_ros.contact.problem import Problem
from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.dynamics.kinematics import chain_coordinates, link_frames
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.bdf2.motion import (
    add_velocities,
    Bdf2Arrays,
    keep_velocities,
    reach_end,
)
from snake_sim_ros.stepping.model import Model, Workspace

# By its law a contact that carries load has no gap. Its gap is the error of integration, of third
# order in dt. Up to RESTING_GAP its law is that of velocities alone, so that the error does not
# become a velocity. Beyond, the contact is open, and may land.
RESTING_GAP = 1e-4  # [m]
DEEP = 1e-6  # penetration at the end of a step with which it is repeated [m]
# Gap that loaded contacts keep at most, whatever the step, if they are more than FEW. Where a
# robot has fewer freedoms than contacts, unequal gaps tilt its links. What these turn about tilted
# axes, at some rad/s, must press contacts much less than the selection rule does, which is at
# `PRESS_SPEED` of the method. On a few contacts a robot tilts as a whole.
FLAT_GAP, FEW = 2e-10, 3  # [m], [1]


@inlined
def leave_gaps(
    model: Model, h_q: float, late: float, closed: Array, contacts: Contacts, impulse: Array
) -> None:
    """
    Fill the shifts, the normal velocities that gaps allow, and add them to the normal velocities.

    Parameters
    ----------
    model : Model
    h_q : float
        Time over which velocities act on coordinates [s].
    late : float
        Time for which the coordinates have moved before that [s].
    closed : ndarray, shape (k,)
        Numbers of the contacts that can close in the step.
    contacts : Contacts
        With gaps and velocities at the predicted end of the step.
    impulse : ndarray, shape (contacts, 5)
        Impulses of the last step [N s].

    """
    geometry, solution = contacts.geometry, contacts.solution
    for a in closed:
        solution.approach_velocity[a] = solution.gamma[a, 0]
        solution.last_normal_impulse[a] = impulse[a, 0]
        gap = geometry.gap[a] - h_q * solution.approach_velocity[a]
        rests = impulse[a, 0] > 0.0 and geometry.gap[a] <= RESTING_GAP
        if gap > model.closed_gap and not rests:
            solution.shift[a] = gap / h_q
        elif gap < 0.0 and not rests:  # undoes the penetration of the motion before
            solution.shift[a] = max(gap, late * min(0.0, solution.approach_velocity[a])) / h_q
        solution.gamma[a, 0] += solution.shift[a]


@inlined
def likely_to_push(closed: Array, contacts: Contacts) -> int:
    """
    Return how many contacts are likely to push; their numbers are moved to the front of `closed`.

    They carried load, or are closed at the predicted end.
    """
    geometry, solution = contacts.geometry, contacts.solution
    count = 0
    for k in range(len(closed)):
        a = closed[k]
        meets = solution.shift[a] <= 0.0 or geometry.gap[a] <= 0.0
        if meets or solution.last_normal_impulse[a] > 0.0:
            closed[k], closed[count] = closed[count], a
            count += 1
    return count


@inlined
def add_approaching(closed: Array, count: int, contacts: Contacts) -> int:
    """
    Let the contacts push, too, that close with the solution for the first `count` ones.

    Their numbers are moved to the front of `closed`, behind those. Velocities gamma are those of
    the solution, with shifts. Return how many may push then; all others have no impulse.
    """
    solution = contacts.solution
    for k in range(count, len(closed)):
        a = closed[k]
        solution.impulse[a, 0] = 0.0
        if solution.gamma[a, 0] < 0.0:
            solution.gamma[a, 0] = solution.approach_velocity[a] + solution.shift[a]
            closed[k], closed[count] = closed[count], a
            count += 1
    return count


class Events(NamedTuple):
    """Jumps of the velocities in a step."""

    jumps: bool  # whether a contact landed, or an impulse is beyond what forces make in a step
    lands: bool  # whether velocities close gaps: they are not yet those after the impact
    closed: int  # number of contacts that are closed, of all that could close


@inlined
def events(model: Model, h: float, closed: Array, contacts: Contacts) -> Events:
    """Return the `Events` of a step in which forces acted for a time h [s]."""
    solution = contacts.solution
    weight = largest = 0.0
    for m in model.robot.mass:
        weight -= m * h * model.robot.gravity[2]
    for a in closed:
        largest = max(largest, solution.last_normal_impulse[a])
    jumps, lands, count = False, False, 0
    for a in closed:
        P_N = solution.impulse[a, 0]
        count += P_N > 0.0 or solution.shift[a] <= 0.0
        if P_N > 0.0:
            lands = lands or solution.shift[a] != 0.0
            meets = solution.last_normal_impulse[a] <= 0.0 and solution.approach_velocity[a] < 0.0
            jumps = jumps or meets or P_N > IMPACT_WEIGHTS * max(weight, largest)
    return Events(jumps or lands, lands, count)


@inlined
def find_end_gaps(h_q: float, closed: Array, contacts: Contacts) -> None:
    """Fill the gaps to which the solution of the contacts leads, linear in the velocities."""
    geometry, solution = contacts.geometry, contacts.solution
    for a in closed:
        change = solution.gamma[a, 0] - solution.shift[a] - solution.approach_velocity[a]
        solution.end_gap[a] = geometry.gap[a] + h_q * change


@inlined
def add_closing(closed: Array, count: int, contacts: Contacts) -> int:
    """
    Move the contacts whose gaps are to be closed behind the first `count` ones of `closed`.

    Return how many they are with those.
    """
    for k in range(count, len(closed)):
        a = closed[k]
        if contacts.newton.S_N[a] > 0.0:
            closed[k], closed[count] = closed[count], a
            count += 1
    return count


class Ending(NamedTuple):
    """How a part ends that was solved."""

    solved: int  # number of contacts that the solver had, the first ones of the problem
    h_q: float  # time over which the velocities of the end act on coordinates [s]
    most_closings: int  # moves that close gaps, at most
    was_deep: bool  # whether a contact was deep in an obstacle at its start


@inlined
def place_end(
    model: Model,
    own: Bdf2Arrays,
    work: Workspace,
    problem: Problem,
    ending: Ending,
    q_start: Array,
) -> None:
    """
    Fill the coordinates at the end, with the gaps of the contacts closed that carry load.

    The solver gets all that close, too. If a contact was deep in an obstacle at the start, at
    q_start, all return to their depths there: the step undoes no more than it did.
    """
    count, h_q, most_closings, was_deep = ending
    laws, closed, contacts, chain, pairs, joints = problem
    geometry, solution = contacts.geometry, contacts.solution
    robot, move = model.robot, own.closing
    loaded = 0
    for a in closed:
        solution.is_loaded[a] = solution.impulse[a, 0] > 0.0
        loaded += solution.is_loaded[a]
        geometry.start_gap[a] = 0.0
        if was_deep:
            gap = gap_at(model.obstacles, robot, q_start, contacts, a)
            geometry.start_gap[a] = min(gap, 0.0)
    left = left_gap(model.closed_gap)
    if loaded > FEW:
        left = min(left, FLAT_GAP)
    for attempt in range(most_closings + 1):
        to_close, _ = gaps_to_close(most_closed(model.dt), 0.0, closed, contacts)
        if to_close > left and attempt < most_closings:
            more = add_closing(closed, count, contacts)
            closing = Problem(laws, closed[:more], contacts, chain, pairs, joints)
            if more > count:
                count = more
                condense_anew(work.operator, closing)
            for _ in range(MOST_RELEASES + 1):
                close_gaps(work.operator, closing, h_q)
                way = Move(robot.places, chain.twist, work.center, h_q, to_close)
                if not let_go(closing.closed, contacts, pairs, way):
                    break
            keep_velocities(model.robot.places, work, move)
            add_velocities(move, own.moving)
        elif attempt > 0:
            break
        reach_end(h_q, model.robot.mass, own.star.pose, own.hat, own.moving)
        moving = own.moving
        chain_coordinates(robot.places, robot.mass, moving.pose, moving.angle, own.q)
        for a in closed:
            solution.end_gap[a] = gap_at(model.obstacles, robot, own.q, contacts, a)


@compiled
def deep_contacts_take_part(model: Model, work: Workspace, q: Array) -> bool:
    """
    Let contacts take part in a step that ends too deep at q, shape (n, 7).

    Return whether any of those that are deep did not take part before.
    """
    found, contacts = False, work.contacts
    link_frames(q[:, 3:], work.R)
    pose = Pose(model.robot, q, work.R, work.center)
    table = Found(work.closed, contacts, work.takes_part, work.chain.frame)
    count = find_contacts(model.obstacles, -DEEP, pose, table)
    for a in work.closed[:count]:
        if work.takes_part[a] == 0:
            work.takes_part[a], found = 1, True
    return found


@inlined
def forget_who_took_part(work: Workspace) -> None:
    """Let contacts take part in the next part of a step by their gaps alone."""
    for a in range(len(work.takes_part)):
        work.takes_part[a] = 0

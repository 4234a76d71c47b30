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

from snake_sim_ros.contact.closing import close_gaps, gaps_to_close, left_gap, most_closed
from snake_sim_ros.contact.detection import find_contacts, gap_at
from snake_sim_ros.contact.laws import IMPACT_WEIGHTS
from snake_sim_ros.contact.newton import condense_anew
from snake_sim_ros.contact.problem import Problem
from snake_sim_ros.dynamics.compilation import compiled, inlined, merged, Table
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


@inlined
def leave_gaps(
    model: Model, h_q: float, late: float, closed: Array, contacts: Table, impulse: Array
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
    contacts : record array
        Table of contacts with gaps and velocities at the predicted end of the step.
    impulse : ndarray, shape (contacts, 5)
        Impulses of the last step [N s].

    """
    for a in closed:
        contacts.approach_velocity[a] = contacts.gamma[a, 0]
        contacts.last_normal_impulse[a] = impulse[a, 0]
        gap = contacts.gap[a] - h_q * contacts.approach_velocity[a]
        rests = impulse[a, 0] > 0.0 and contacts.gap[a] <= RESTING_GAP
        if gap > model.closed_gap and not rests:
            contacts.shift[a] = gap / h_q
        elif gap < 0.0 and not rests:  # undoes the penetration of the motion before
            contacts.shift[a] = max(gap, late * min(0.0, contacts.approach_velocity[a])) / h_q
        contacts.gamma[a, 0] += contacts.shift[a]


@inlined
def likely_to_push(closed: Array, contacts: Table) -> int:
    """
    Return how many contacts are likely to push; their numbers are moved to the front of `closed`.

    They carried load, or are closed at the predicted end.
    """
    count = 0
    for k in range(len(closed)):
        a = closed[k]
        meets = contacts.shift[a] <= 0.0 or contacts.gap[a] <= 0.0
        if meets or contacts.last_normal_impulse[a] > 0.0:
            closed[k], closed[count] = closed[count], a
            count += 1
    return count


@inlined
def add_approaching(closed: Array, count: int, contacts: Table) -> int:
    """
    Let the contacts push, too, that close with the solution for the first `count` ones.

    Their numbers are moved to the front of `closed`, behind those. Velocities gamma are those of
    the solution, with shifts. Return how many may push then; all others have no impulse.
    """
    for k in range(count, len(closed)):
        a = closed[k]
        contacts.impulse[a, 0] = 0.0
        if contacts.gamma[a, 0] < 0.0:
            contacts.gamma[a, 0] = contacts.approach_velocity[a] + contacts.shift[a]
            closed[k], closed[count] = closed[count], a
            count += 1
    return count


class Events(NamedTuple):
    """Jumps of the velocities in a step."""

    jumps: bool  # whether a contact landed, or an impulse is beyond what forces make in a step
    lands: bool  # whether velocities close gaps: they are not yet those after the impact
    closed: int  # number of contacts that are closed, of all that could close


@inlined
def events(model: Model, h: float, closed: Array, contacts: Table) -> Events:
    """Return the `Events` of a step in which forces acted for a time h [s]."""
    weight = largest = 0.0
    for m in model.robot.mass:
        weight -= m * h * model.robot.gravity[2]
    for a in closed:
        largest = max(largest, contacts.last_normal_impulse[a])
    jumps, lands, count = False, False, 0
    for a in closed:
        P_N = contacts.impulse[a, 0]
        count += P_N > 0.0 or contacts.shift[a] <= 0.0
        if P_N > 0.0:
            lands = lands or contacts.shift[a] != 0.0
            meets = contacts.last_normal_impulse[a] <= 0.0 and contacts.approach_velocity[a] < 0.0
            jumps = jumps or meets or P_N > IMPACT_WEIGHTS * max(weight, largest)
    return Events(jumps or lands, lands, count)


@inlined
def find_end_gaps(h_q: float, closed: Array, contacts: Table) -> None:
    """Fill the gaps to which the solution of the contacts leads, linear in the velocities."""
    for a in closed:
        change = contacts.gamma[a, 0] - contacts.shift[a] - contacts.approach_velocity[a]
        contacts.end_gap[a] = contacts.gap[a] + h_q * change


@inlined
def closed_at_end(tolerance: float, closed: Array, contacts: Table) -> int:
    """
    Return the number of contacts that are closed after a step.

    Their numbers are moved to the front of `closed`, and their shifts set to 0. `tolerance` is the
    gap up to which a contact is closed [m].
    """
    count = 0
    for k in range(len(closed)):
        a = closed[k]
        loaded = contacts.impulse[a, 0] > 0.0 or contacts.shift[a] == 0.0
        if loaded or contacts.end_gap[a] <= tolerance:
            contacts.shift[a] = 0.0
            closed[k], closed[count] = closed[count], a
            count += 1
    return count


@inlined
def add_closing(closed: Array, count: int, contacts: Table) -> int:
    """
    Move the contacts whose gaps are to be closed behind the first `count` ones of `closed`.

    Return how many they are with those.
    """
    for k in range(count, len(closed)):
        a = closed[k]
        if contacts.S_N[a] > 0.0:
            closed[k], closed[count] = closed[count], a
            count += 1
    return count


@merged
def place_end(
    model: Model,
    own: Bdf2Arrays,
    work: Workspace,
    problem: Problem,
    count: int,
    h_q: float,
    most_closings: int,
    was_deep: bool,
    q_start: Array,
) -> None:
    """
    Fill the coordinates at the end, with the gaps of the contacts closed that carry load.

    The solver has the first `count` contacts of the problem, and then all that close, too. There
    are at most `most_closings` moves. If a contact is deep in an obstacle at the start, at
    q_start, all return to their depths there: the step undoes no more than it did.
    """
    laws, closed, contacts, chain = problem
    offset, radius, move = model.robot.contact_offset, model.robot.contact_radius, own.closing
    for a in closed:
        contacts.is_loaded[a] = contacts.impulse[a, 0] > 0.0
        contacts.start_gap[a] = 0.0
        if was_deep:
            gap = gap_at(model.obstacles, offset, radius, q_start, contacts, a)
            contacts.start_gap[a] = min(gap, 0.0)
    for attempt in range(most_closings + 1):
        to_close, _ = gaps_to_close(most_closed(model.dt), 0.0, closed, contacts)
        if to_close > left_gap(model.closed_gap) and attempt < most_closings:
            more = add_closing(closed, count, contacts)
            closing = Problem(laws, closed[:more], contacts, chain)
            if more > count:
                count = more
                condense_anew(work.operator, closing)
            close_gaps(work.operator, closing, h_q)
            keep_velocities(work, move)
            add_velocities(move, own.moving)
        elif attempt > 0:
            break
        reach_end(h_q, model.robot.mass, own.star.pose, own.hat, own.moving)
        chain_coordinates(
            model.robot.half_length, model.robot.mass, own.moving.pose, own.moving.angle, own.q
        )
        for a in closed:
            contacts.end_gap[a] = gap_at(model.obstacles, offset, radius, own.q, contacts, a)


@compiled
def deep_contacts_take_part(model: Model, work: Workspace, q: Array) -> bool:
    """
    Let contacts take part in a step that ends too deep at q, shape (n, 7).

    Return whether any of those that are deep did not take part before.
    """
    found, contacts = False, work.contacts
    link_frames(q[:, 3:], work.R)
    pose, table = (q, work.R, work.center), (work.closed, contacts, work.chain.frame)
    count = find_contacts(model.obstacles, -DEEP, model.robot, pose, table)
    for a in work.closed[:count]:
        if contacts.takes_part[a] == 0:
            contacts.takes_part[a], found = 1, True
    return found


@inlined
def forget_who_took_part(contacts: Table) -> None:
    """Let contacts take part in the next part of a step by their gaps alone."""
    for a in range(len(contacts)):
        contacts.takes_part[a] = 0

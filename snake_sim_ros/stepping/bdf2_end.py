# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The end of a part of a step of method `bdf2`: closed gaps, and contacts that are deep."""

from snake_sim_ros.contact.closing import close_gaps, gaps_to_close, left_gap
from snake_sim_ros.contact.detection import find_contacts
from snake_sim_ros.contact.newton import condense_anew
from snake_sim_ros.contact.penetration import gap_at
from snake_sim_ros.contact.solver import Problem
from snake_sim_ros.dynamics.compilation import compiled, inlined, merged
from snake_sim_ros.dynamics.kinematics import chain_coordinates, link_frames
from snake_sim_ros.stepping.events import add_closing
from snake_sim_ros.stepping.joint_motion import add_velocities, keep_velocities, reach_end

DEEP = 1e-6  # penetration at the end of a step with which it is repeated [m]
MOST_CLOSINGS = 3  # moves of the configuration in a step that close gaps


@merged
def place_end(model, own, work, problem, count, h_q, was_deep, q_start):
    """
    Fill the coordinates at the end, with the gaps of the contacts closed that carry load.

    The solver knows the first `count` contacts of the problem, and gets to know all that close.
    If a contact is deep in an obstacle at the start, at q_start, all return to their depths there:
    the step undoes no more than it did.
    """
    laws, closed, contacts, chain = problem
    offset, radius, move = model.contact_offset, model.contact_radius, own.closing
    for a in closed:
        contacts.is_loaded[a] = contacts.impulse[a, 0] > 0.0
        contacts.start_gap[a] = 0.0
        if was_deep:
            gap = gap_at(model.obstacles, offset, radius, q_start, contacts, a)
            contacts.start_gap[a] = min(gap, 0.0)
    for attempt in range(MOST_CLOSINGS + 1):
        largest = gaps_to_close(closed, contacts)
        if largest > left_gap(model.closed_gap) and attempt < MOST_CLOSINGS:
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
        reach_end(h_q, model.mass, own.star.pose, own.hat, own.moving)
        chain_coordinates(model.half_length, model.mass, own.moving.pose, own.moving.angle, own.q)
        for a in closed:
            contacts.end_gap[a] = gap_at(model.obstacles, offset, radius, own.q, contacts, a)


@compiled
def deep_contacts_take_part(model, work, q):
    """
    Let contacts take part in a step that ends too deep at q, shape (n, 7).

    Return whether any of those that are deep did not take part before.
    """
    found, contacts = False, work.contacts
    link_frames(q[:, 3:], work.R)
    count = find_contacts(model.obstacles, -DEEP, model, work, q)
    for a in work.closed[:count]:
        if contacts.takes_part[a] == 0:
            contacts.takes_part[a], found = 1, True
    return found


@inlined
def forget_who_took_part(contacts):
    """Let contacts take part in the next part of a step by their gaps alone."""
    for a in range(len(contacts)):
        contacts.takes_part[a] = 0

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Contacts with pegs for a robot that lies flat, as `contact.detection` finds them in space."""

import math

from snake_sim_ros.contact.closing import gaps_to_close, left_gap, MOST_MOVES, predict_gaps
from snake_sim_ros.contact.detection import peg_contact, reach_of_step
from snake_sim_ros.dynamics.compilation import inlined, merged
from snake_sim_ros.dynamics.hinge_chain import factor_hinges, solve_hinges


@merged
def find_peg_contacts(model, work, q, u):
    """Fill the contacts with pegs that may close in the step; return their number."""
    n, count, contacts = len(u), 0, work.contacts
    most = reach_of_step(model.closed_gap, 0.5 * model.dt)
    for k in range(len(model.pegs)):
        peg_x, peg_y, peg_radius = model.pegs[k, 0], model.pegs[k, 1], model.pegs[k, 2]
        x, y = q[0] + 0.5 * model.dt * u[0, 0], q[1] + 0.5 * model.dt * u[0, 1]
        for i in range(n):
            link_x = x + work.center[i, 0] - work.center[0, 0]
            link_y = y + work.center[i, 1] - work.center[0, 1]
            reach = model.offset[i] + model.radius + peg_radius + most
            if (peg_x - link_x) ** 2 + (peg_y - link_y) ** 2 > reach * reach:
                continue
            c, s = work.heading[i, 0], work.heading[i, 1]
            arm, distance, normal_x, normal_y = peg_contact(
                link_x, link_y, c, s, model.offset[i], peg_x, peg_y
            )
            gap = distance - peg_radius - model.radius
            if gap <= most:
                a = model.first_peg + k * n + i
                work.closed[2 * n + count] = a
                count += 1
                contacts.link[a], contacts.gap[a], contacts.shift[a] = i, gap, 0.0
                contacts.heading[a, 0], contacts.heading[a, 1] = -normal_y, normal_x
                point_x = arm * c - model.radius * normal_x
                point_y = arm * s - model.radius * normal_y
                contacts.point[a, 0] = work.center[i, 0] + point_x
                contacts.point[a, 1] = work.center[i, 1] + point_y
                vx, vy = u[i, 0] - u[i, 2] * point_y, u[i, 1] + u[i, 2] * point_x
                contacts.gamma[a, 0] = normal_x * vx + normal_y * vy
                contacts.gamma[a, 1] = normal_x * vy - normal_y * vx
    predict_gaps(model.closed_gap, model.dt, work.closed[2 * n : 2 * n + count], contacts)
    return count


@merged
def peg_velocities(closed, work):
    """Fill the velocities of the contacts with pegs, with their shifts, from work.twist."""
    for a in closed:
        i = work.contacts.link[a]
        t_x, t_y = work.contacts.heading[a, 0], work.contacts.heading[a, 1]
        w = work.twist[i, 0]
        vx = work.twist[i, 1] - w * work.contacts.point[a, 1]
        vy = work.twist[i, 2] + w * work.contacts.point[a, 0]
        work.contacts.gamma[a, 0] = t_y * vx - t_x * vy + work.contacts.shift[a]
        work.contacts.gamma[a, 1] = t_x * vx + t_y * vy


@inlined
def add_peg_law(chain, contacts, a, normal, along, S_N, S_T):
    """Add impulses [N s] and their decrease per velocity [kg] at contact a to its link."""
    t_x, t_y = contacts.heading[a, 0], contacts.heading[a, 1]
    x, y = contacts.point[a, 0], contacts.point[a, 1]
    n_x, n_y = t_y, -t_x
    px, py = normal * n_x + along * t_x, normal * n_y + along * t_y
    xx, yy = S_N * n_x * n_x + S_T * t_x * t_x, S_N * n_y * n_y + S_T * t_y * t_y
    xy = S_N * n_x * n_y + S_T * t_x * t_y
    a_x, a_y = x * xy - y * xx, x * yy - y * xy
    i = contacts.link[a]
    A, w = chain.inertia[i], chain.wrench[i]
    A[0] += x * a_y - y * a_x
    A[1] += a_x
    A[2] += a_y
    A[3] += xx
    A[4] += xy
    A[5] += yy
    w[0] += x * py - y * px
    w[1] += px
    w[2] += py


@merged
def close_pegs(model, work, closed, q):
    """
    Close the gaps of contacts with pegs at the end of a step, as `closing.close_step` does.

    Parameters
    ----------
    model : PlanarModel
    work : PlanarWorkspace
        Its chain is replaced; impulses are read.
    closed : ndarray
        Numbers of the contacts with pegs.
    q : ndarray, shape (n+2,)
        Coordinates at the end of the step; corrected.

    Returns
    -------
    float
        Largest penetration of the robot into a peg [m].

    """
    chain, contacts, n = work.chain, work.contacts, len(work.heading)
    depth = peg_gaps(model, contacts, q)
    for a in closed:
        contacts.is_loaded[a] = contacts.impulse[a, 0] > 0.0
    for _move in range(MOST_MOVES if model.closed_gap > 0.0 else 0):
        if not gaps_to_close(closed, contacts) > left_gap(model.closed_gap):
            break
        for i in range(n):
            for k in range(6):
                chain.inertia[i, k] = work.bare[i, k]
            for k in range(3):
                chain.wrench[i, k] = 0.0
        for a in closed:
            S_N = contacts.S_N[a] / model.laws.proximal_compliance
            add_peg_law(chain, contacts, a, -S_N * contacts.end_gap[a], 0.0, S_N, 0.0)
        factor_hinges(chain)
        solve_hinges(chain, work.no_torque)
        for i in range(n):
            q[2 + i] += chain.twist[i, 0]
        q[0] += chain.twist[0, 1] - chain.twist[0, 0] * work.center[0, 1]
        q[1] += chain.twist[0, 2] + chain.twist[0, 0] * work.center[0, 0]
        depth = peg_gaps(model, contacts, q)
    return depth


@merged
def peg_gaps(model, contacts, q):
    """Fill the end gaps of all contacts with pegs; return the largest penetration [m]."""
    deepest = x = y = reach_x = reach_y = 0.0
    n = len(model.mass)
    for i in range(n if len(model.pegs) > 0 else 0):
        c, s = math.cos(q[2 + i]), math.sin(q[2 + i])
        half = model.half_length[i]
        if i > 0:
            x, y = x + reach_x + half * c, y + reach_y + half * s
        reach_x, reach_y = half * c, half * s
        for k in range(len(model.pegs)):
            _, distance, _, _ = peg_contact(
                q[0] + x, q[1] + y, c, s, model.offset[i], model.pegs[k, 0], model.pegs[k, 1]
            )
            gap = distance - model.pegs[k, 2] - model.radius
            contacts.end_gap[model.first_peg + k * n + i] = gap
            deepest = max(deepest, -gap)
    return deepest

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Contacts with pegs for a robot that lies flat, as `contact.detection` finds them in space."""

import math

from snake_sim_ros.contact.detection import peg_contact
from snake_sim_ros.dynamics.compilation import merged


@merged
def find_peg_contacts(model, work, q, u):
    """Fill the closed contacts with pegs at the middle of the step; return their number."""
    n, count, contacts = len(u), 0, work.contacts
    for k in range(len(model.pegs)):
        peg_x, peg_y, peg_radius = model.pegs[k, 0], model.pegs[k, 1], model.pegs[k, 2]
        x, y = q[0] + 0.5 * model.dt * u[0, 0], q[1] + 0.5 * model.dt * u[0, 1]
        for i in range(n):
            link_x = x + work.center[i, 0] - work.center[0, 0]
            link_y = y + work.center[i, 1] - work.center[0, 1]
            reach = model.offset[i] + model.radius + peg_radius + model.activation_tolerance
            if (peg_x - link_x) ** 2 + (peg_y - link_y) ** 2 > reach * reach:
                continue
            c, s = work.heading[i, 0], work.heading[i, 1]
            arm, distance, normal_x, normal_y = peg_contact(
                link_x, link_y, c, s, model.offset[i], peg_x, peg_y
            )
            if distance - peg_radius - model.radius <= model.activation_tolerance:
                a = model.first_peg + k * n + i
                work.closed[2 * n + count] = a
                count += 1
                contacts.link[a] = i
                contacts.heading[a, 0], contacts.heading[a, 1] = -normal_y, normal_x
                point_x = arm * c - model.radius * normal_x
                point_y = arm * s - model.radius * normal_y
                contacts.point[a, 0] = work.center[i, 0] + point_x
                contacts.point[a, 1] = work.center[i, 1] + point_y
                vx, vy = u[i, 0] - u[i, 2] * point_y, u[i, 1] + u[i, 2] * point_x
                contacts.gamma[a, 0] = normal_x * vx + normal_y * vy
                contacts.gamma[a, 1] = normal_x * vy - normal_y * vx
    return count


@merged
def peg_velocities(closed, work):
    """Fill the velocities of the closed contacts with pegs, from work.twist."""
    for a in closed:
        i = work.contacts.link[a]
        t_x, t_y = work.contacts.heading[a, 0], work.contacts.heading[a, 1]
        w = work.twist[i, 0]
        vx = work.twist[i, 1] - w * work.contacts.point[a, 1]
        vy = work.twist[i, 2] + w * work.contacts.point[a, 0]
        work.contacts.gamma[a, 0] = t_y * vx - t_x * vy
        work.contacts.gamma[a, 1] = t_x * vx + t_y * vy


@merged
def peg_depth(model, q):
    """Return the largest penetration of the robot q (n+2,) into a peg [m]."""
    deepest = x = y = reach_x = reach_y = 0.0
    for i in range(len(model.mass) if len(model.pegs) > 0 else 0):
        c, s = math.cos(q[2 + i]), math.sin(q[2 + i])
        half = model.half_length[i]
        if i > 0:
            x, y = x + reach_x + half * c, y + reach_y + half * s
        reach_x, reach_y = half * c, half * s
        for k in range(len(model.pegs)):
            _, distance, _, _ = peg_contact(
                q[0] + x, q[1] + y, c, s, model.offset[i], model.pegs[k, 0], model.pegs[k, 1]
            )
            deepest = max(deepest, model.pegs[k, 2] + model.radius - distance)
    return deepest

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Compiled generalized force directions of the contacts: velocities and wrenches, eqs. (17)-(37).

In a scene with more than a flat floor every contact has a frame, see `scene.obstacles`, and
rolling is along the axes of this frame. On a flat floor `frame` is None.

A contact of two links acts on both at one point in space. Twists place the links as if the joints
were closed, so that the point has different coordinates as one of the other link where joints are
open in the middle of a step.

`closed` and `contacts` are those of a `problem.Problem`; `frame`, `wrench` and `twist` are those
of its chain. `frame`, shape (contacts, 3, 3), has the rows normal, e_x and e_y of every contact
frame in I.
"""

from snake_sim_ros.contact.contacts import Contacts
from snake_sim_ros.contact.shapes import inner, minus, moved, outer, times, triple
from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.dynamics.spatial_vectors import Six, Three
from snake_sim_ros.scene.parameters import Array


@inlined
def add_contact_wrench(
    closed: Array, contacts: Contacts, frame: Array | None, wrench: Array
) -> None:
    """
    Add the impulses of the contacts to the wrenches of the links, S of eq. (76).

    `wrench`, shape (n, 6), is the moment about O [N m s] and the impulse [N s] of every link, in
    axes of I.
    """
    geometry, solution = contacts.geometry, contacts.solution
    if frame is not None:
        add_wrench_in_frames(closed, contacts, frame, wrench)
        return
    for a in closed:
        i = geometry.link[a]
        cx, cy = geometry.heading[a, 0], geometry.heading[a, 1]
        x, y, z = geometry.point[a, 0], geometry.point[a, 1], geometry.point[a, 2]
        px = cx * solution.impulse[a, 1] - cy * solution.impulse[a, 2]
        py = cy * solution.impulse[a, 1] + cx * solution.impulse[a, 2]
        pz = solution.impulse[a, 0]
        wrench[i, 0] += y * pz - z * py + geometry.radius[a] * solution.impulse[a, 4]
        wrench[i, 1] += z * px - x * pz - geometry.radius[a] * solution.impulse[a, 3]
        wrench[i, 2] += x * py - y * px
        wrench[i, 3] += px
        wrench[i, 4] += py
        wrench[i, 5] += pz


@compiled
def contact_velocities(
    closed: Array, contacts: Contacts, frame: Array | None, twist: Array
) -> None:
    """
    Fill the relative velocities of the closed contacts, eqs. (90)-(92).

    The `gamma` of the contacts is filled [m/s], `shift` included in the normal component. `twist`,
    shape (n, 6), is the angular velocity [rad/s] and the velocity at O [m/s] of every link, in
    axes of I.
    """
    geometry, solution = contacts.geometry, contacts.solution
    if frame is not None:
        velocities_in_frames(closed, contacts, frame, twist)
        return
    for a in closed:
        i = geometry.link[a]
        cx, cy = geometry.heading[a, 0], geometry.heading[a, 1]
        x, y, z = geometry.point[a, 0], geometry.point[a, 1], geometry.point[a, 2]
        wx, wy, wz = twist[i, 0], twist[i, 1], twist[i, 2]
        vx = twist[i, 3] + wy * z - wz * y
        vy = twist[i, 4] + wz * x - wx * z
        solution.gamma[a, 0] = twist[i, 5] + wx * y - wy * x + solution.shift[a]
        solution.gamma[a, 1] = cx * vx + cy * vy
        solution.gamma[a, 2] = cx * vy - cy * vx
        solution.gamma[a, 3] = -geometry.radius[a] * wy
        solution.gamma[a, 4] = geometry.radius[a] * wx


@inlined
def direction(point: Array, frame: Array, a: int, k: int) -> Six:
    """
    Return the wrench of a unit impulse at contact a along one axis of its frame.

    The axis k is 0 for the normal, 1 for e_x and 2 for e_y. `point`, shape (contacts, 3), are the
    contact points of one link. The result is a tuple of six numbers, moment about O and impulse,
    in axes of I.
    """
    x, y, z = point[a, 0], point[a, 1], point[a, 2]
    ex, ey, ez = frame[a, k, 0], frame[a, k, 1], frame[a, k, 2]
    return y * ez - z * ey, z * ex - x * ez, x * ey - y * ex, ex, ey, ez


@compiled
def add_wrench_in_frames(closed: Array, contacts: Contacts, frame: Array, wrench: Array) -> None:
    """Do what `add_contact_wrench` does, for contacts that have frames."""
    geometry, P = contacts.geometry, contacts.solution.impulse
    for a in closed:
        i, other, radius = geometry.link[a], geometry.other_link[a], geometry.radius[a]
        e_x, e_y = triple(frame[a], 1), triple(frame[a], 2)
        force = times(P[a, 0], triple(frame[a], 0))
        force = moved(moved(force, P[a, 1], e_x), P[a, 2], e_y)
        moment = moved(outer(triple(geometry.point, a), force), radius * P[a, 4], e_x)
        moment = moved(moment, -radius * P[a, 3], e_y)
        for k in range(3):
            wrench[i, k] += moment[k]
            wrench[i, 3 + k] += force[k]
        if other >= 0:
            moment = outer(triple(geometry.other_point, a), force)
            for k in range(3):
                wrench[other, k] -= moment[k]
                wrench[other, 3 + k] -= force[k]


@compiled
def velocities_in_frames(closed: Array, contacts: Contacts, frame: Array, twist: Array) -> None:
    """Do what `contact_velocities` does, for contacts that have frames."""
    geometry, solution, gamma = contacts.geometry, contacts.solution, contacts.solution.gamma
    for a in closed:
        i, other, radius = geometry.link[a], geometry.other_link[a], geometry.radius[a]
        omega = triple(twist, i)
        v = velocity_at(twist, i, triple(geometry.point, a))
        if other >= 0:
            v = minus(v, velocity_at(twist, other, triple(geometry.other_point, a)))
        e_x, e_y = triple(frame[a], 1), triple(frame[a], 2)
        gamma[a, 0] = inner(triple(frame[a], 0), v) + solution.shift[a]
        gamma[a, 1], gamma[a, 2] = inner(e_x, v), inner(e_y, v)
        gamma[a, 3], gamma[a, 4] = -radius * inner(e_y, omega), radius * inner(e_x, omega)


@inlined
def velocity_at(twist: Array, i: int, point: Three) -> Three:
    """Return the velocity of a point of link i [m/s]."""
    v = twist[i, 3], twist[i, 4], twist[i, 5]
    return moved(v, 1.0, outer(triple(twist, i), point))

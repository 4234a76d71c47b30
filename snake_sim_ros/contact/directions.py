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
from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.dynamics.spatial_vectors import Six
from snake_sim_ros.scene.parameters import Array


@compiled
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
    geometry, solution = contacts.geometry, contacts.solution
    for a in closed:
        i, other = geometry.link[a], geometry.other_link[a]
        for k in range(3):
            w = direction(geometry.point, frame, a, k)
            for j in range(6):
                wrench[i, j] += solution.impulse[a, k] * w[j]
            if other >= 0:
                w = direction(geometry.other_point, frame, a, k)
                for j in range(6):
                    wrench[other, j] -= solution.impulse[a, k] * w[j]
        for k in range(3):
            roll = (
                solution.impulse[a, 4] * frame[a, 1, k] - solution.impulse[a, 3] * frame[a, 2, k]
            )
            wrench[i, k] += geometry.radius[a] * roll


@compiled
def velocities_in_frames(closed: Array, contacts: Contacts, frame: Array, twist: Array) -> None:
    """Do what `contact_velocities` does, for contacts that have frames."""
    geometry, solution = contacts.geometry, contacts.solution
    for a in closed:
        i, other = geometry.link[a], geometry.other_link[a]
        for k in range(3):
            w = direction(geometry.point, frame, a, k)
            gamma = solution.shift[a] if k == 0 else 0.0
            for j in range(6):
                gamma += w[j] * twist[i, j]
            if other >= 0:
                w = direction(geometry.other_point, frame, a, k)
                for j in range(6):
                    gamma -= w[j] * twist[other, j]
            solution.gamma[a, k] = gamma
        along = across = 0.0
        for k in range(3):
            along += frame[a, 1, k] * twist[i, k]
            across += frame[a, 2, k] * twist[i, k]
        solution.gamma[a, 3] = -geometry.radius[a] * across
        solution.gamma[a, 4] = geometry.radius[a] * along

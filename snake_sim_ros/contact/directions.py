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

from snake_sim_ros.dynamics.compilation import compiled, inlined, Table
from snake_sim_ros.scene.parameters import Array


@compiled
def add_contact_wrench(closed: Array, contacts: Table, frame: Array | None, wrench: Array) -> None:
    """
    Add the impulses of the contacts to the wrenches of the links, S of eq. (76).

    `wrench`, shape (n, 6), is the moment about O [N m s] and the impulse [N s] of every link, in
    axes of I.
    """
    if frame is not None:
        add_wrench_in_frames(closed, contacts, frame, wrench)
        return
    n = len(wrench)
    for a in closed:
        i = a if a < n else a - n
        cx, cy = contacts.heading[a, 0], contacts.heading[a, 1]
        x, y, z = contacts.point[a, 0], contacts.point[a, 1], contacts.point[a, 2]
        px = cx * contacts.impulse[a, 1] - cy * contacts.impulse[a, 2]
        py = cy * contacts.impulse[a, 1] + cx * contacts.impulse[a, 2]
        pz = contacts.impulse[a, 0]
        wrench[i, 0] += y * pz - z * py + contacts.radius[a] * contacts.impulse[a, 4]
        wrench[i, 1] += z * px - x * pz - contacts.radius[a] * contacts.impulse[a, 3]
        wrench[i, 2] += x * py - y * px
        wrench[i, 3] += px
        wrench[i, 4] += py
        wrench[i, 5] += pz


@compiled
def contact_velocities(closed: Array, contacts: Table, frame: Array | None, twist: Array) -> None:
    """
    Fill the relative velocities of the closed contacts, eqs. (90)-(92).

    The `gamma` of the contacts is filled [m/s], `shift` included in the normal component. `twist`,
    shape (n, 6), is the angular velocity [rad/s] and the velocity at O [m/s] of every link, in
    axes of I.
    """
    if frame is not None:
        velocities_in_frames(closed, contacts, frame, twist)
        return
    n = len(twist)
    for a in closed:
        i = a if a < n else a - n
        cx, cy = contacts.heading[a, 0], contacts.heading[a, 1]
        x, y, z = contacts.point[a, 0], contacts.point[a, 1], contacts.point[a, 2]
        wx, wy, wz = twist[i, 0], twist[i, 1], twist[i, 2]
        vx = twist[i, 3] + wy * z - wz * y
        vy = twist[i, 4] + wz * x - wx * z
        contacts.gamma[a, 0] = twist[i, 5] + wx * y - wy * x + contacts.shift[a]
        contacts.gamma[a, 1] = cx * vx + cy * vy
        contacts.gamma[a, 2] = cx * vy - cy * vx
        contacts.gamma[a, 3] = -contacts.radius[a] * wy
        contacts.gamma[a, 4] = contacts.radius[a] * wx


@inlined
def direction(
    point: Array, frame: Array, a: int, k: int
) -> tuple[float, float, float, float, float, float]:
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
def add_wrench_in_frames(closed: Array, contacts: Table, frame: Array, wrench: Array) -> None:
    """Do what `add_contact_wrench` does, for contacts that have frames."""
    for a in closed:
        i, other = contacts.link[a], contacts.other_link[a]
        for k in range(3):
            w = direction(contacts.point, frame, a, k)
            for j in range(6):
                wrench[i, j] += contacts.impulse[a, k] * w[j]
            if other >= 0:
                w = direction(contacts.other_point, frame, a, k)
                for j in range(6):
                    wrench[other, j] -= contacts.impulse[a, k] * w[j]
        for k in range(3):
            roll = (
                contacts.impulse[a, 4] * frame[a, 1, k] - contacts.impulse[a, 3] * frame[a, 2, k]
            )
            wrench[i, k] += contacts.radius[a] * roll


@compiled
def velocities_in_frames(closed: Array, contacts: Table, frame: Array, twist: Array) -> None:
    """Do what `contact_velocities` does, for contacts that have frames."""
    for a in closed:
        i, other = contacts.link[a], contacts.other_link[a]
        for k in range(3):
            w = direction(contacts.point, frame, a, k)
            gamma = contacts.shift[a] if k == 0 else 0.0
            for j in range(6):
                gamma += w[j] * twist[i, j]
            if other >= 0:
                w = direction(contacts.other_point, frame, a, k)
                for j in range(6):
                    gamma -= w[j] * twist[other, j]
            contacts.gamma[a, k] = gamma
        along = across = 0.0
        for k in range(3):
            along += frame[a, 1, k] * twist[i, k]
            across += frame[a, 2, k] * twist[i, k]
        contacts.gamma[a, 3] = -contacts.radius[a] * across
        contacts.gamma[a, 4] = contacts.radius[a] * along

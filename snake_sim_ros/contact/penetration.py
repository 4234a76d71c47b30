# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""How deep a robot is in the floor, in an obstacle or in itself."""

import math

from snake_sim_ros.contact.detection import ground_contact, peg_contact
from snake_sim_ros.dynamics.compilation import inlined, merged
from snake_sim_ros.dynamics.kinematics import axis_z, floor_penetration


@inlined
def penetration(obstacles, offset, radius, q):
    """
    Return how deep the robot is in the floor or in an obstacle [m], 0 if it is in neither.

    Parameters
    ----------
    obstacles : Obstacles or None
        None on a flat floor; an argument of its own so that Numba leaves out the branch on None.
    offset, radius : ndarray, shape (n,)
        Distance of the contact spheres from the link center, and their radii [m].
    q : ndarray, shape (n, 7)
        Link centers [m, frame I] and unit Euler parameters.

    """
    if obstacles is None:
        return floor_penetration(offset, radius, q)
    return obstacle_penetration(obstacles, offset, radius, q)


@merged
def obstacle_penetration(obstacles, offset, radius, q):
    """Return how deep the robot is in the ground, in a peg or in itself [m], 0 if it is not."""
    lowest = 0.0
    for i in range(len(q)):
        axis = axis_z(q, i)
        for side in range(2):
            arm = offset[i] if side == 0 else -offset[i]
            x, y, z = q[i, 0] + arm * axis[0], q[i, 1] + arm * axis[1], q[i, 2] + arm * axis[2]
            for k in range(4):
                gap, _, _, _ = ground_contact(obstacles, x, y, z, radius[i], k)
                lowest = min(lowest, gap)
        for k in range(len(obstacles.pegs)):
            _, distance, _, _ = peg_contact(
                q[i, 0], q[i, 1], axis[0], axis[1], offset[i],
                obstacles.pegs[k, 0], obstacles.pegs[k, 1],
            )  # fmt: skip
            lowest = min(lowest, distance - obstacles.pegs[k, 2] - radius[i])
        if obstacles.pair_count > 0:
            for j in range(i + 2, len(q)):
                for side in range(4):
                    arm = offset[i] if side < 2 else -offset[i]
                    other = offset[j] if side % 2 == 0 else -offset[j]
                    square, beyond = 0.0, axis_z(q, j)
                    for k in range(3):
                        square += (q[i, k] + arm * axis[k] - q[j, k] - other * beyond[k]) ** 2
                    lowest = min(lowest, math.sqrt(square) - radius[i] - radius[j])
    return -lowest


@inlined
def gap_at(obstacles, offset, radius, q, contacts, a):
    """
    Return the gap of contact a [m], infinite where a cell has no contact.

    Parameters are those of `penetration`, with the table of contacts: its links are read for
    contacts that have frames.
    """
    n = len(q)
    if obstacles is None:
        i, arm = (a, offset[a]) if a < n else (a - n, -offset[a - n])
        return q[i, 2] + arm * axis_z(q, i)[2] - radius[i]
    return obstacle_gap(obstacles, offset, radius, q, contacts, a)


@merged
def obstacle_gap(obstacles, offset, radius, q, contacts, a):
    """Do what `gap_at` does, for a scene with more than a flat floor."""
    n, i = len(q), contacts.link[a]
    axis = axis_z(q, i)
    if a >= obstacles.first_pair:
        side, j = (a - obstacles.first_pair) % 4, contacts.other_link[a]
        arm = offset[i] if side < 2 else -offset[i]
        other = offset[j] if side % 2 == 0 else -offset[j]
        beyond, square = axis_z(q, j), 0.0
        for k in range(3):
            square += (q[i, k] + arm * axis[k] - q[j, k] - other * beyond[k]) ** 2
        return math.sqrt(square) - radius[i] - radius[j]
    if a >= obstacles.first_peg:
        k = (a - obstacles.first_peg) // n
        _, distance, _, _ = peg_contact(
            q[i, 0], q[i, 1], axis[0], axis[1], offset[i],
            obstacles.pegs[k, 0], obstacles.pegs[k, 1],
        )  # fmt: skip
        return distance - obstacles.pegs[k, 2] - radius[i]
    block = a // n
    side, k = (block, 0) if block < 2 else ((block - 2) // 3, (block - 2) % 3 + 1)
    arm = offset[i] if side == 0 else -offset[i]
    x, y, z = q[i, 0] + arm * axis[0], q[i, 1] + arm * axis[1], q[i, 2] + arm * axis[2]
    gap, _, _, _ = ground_contact(obstacles, x, y, z, radius[i], k)
    return gap

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Compiled contact detection: gaps and contact frames on the floor, on cells, at pegs and links.

`scene.obstacles` defines obstacles and how the contacts are numbered. A frame is (normal, e_x,
e_y): the normal, e_x along the link and e_y across it, in the order of the components of an
impulse. On a flat floor it is e_z and the heading of the link, and only `find_floor_contacts` is
called. `penetration` says how deep a robot is in the floor, in an obstacle or in itself.

Patches of the ground with another friction are sampled once a step, at the points below the
centers of the spheres where contacts are found. A sphere that crosses a border has the friction of
one patch in a step and that of the other in the next one: the border is an event in time only, and
nothing is smoothed.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from snake_sim_ros.contact.contacts import Contacts
from snake_sim_ros.dynamics.compilation import compiled, inlined, merged
from snake_sim_ros.dynamics.kinematics import axis_z, floor_penetration
from snake_sim_ros.dynamics.mechanism import Mechanism
from snake_sim_ros.dynamics.spatial_vectors import Three
from snake_sim_ros.scene.obstacles import first_pair, first_peg, is_flat, pair_contacts
from snake_sim_ros.scene.parameters import Array, Scene

LANDING_SPEED = 0.1  # a contact takes part if this speed could close its gap in the step [m/s]


@inlined
def fill_contact_frame(frame: Array, normal: Three, axis: Three) -> None:
    """
    Fill a frame with the normal, e_x along a link and e_y across it, both in the tangent plane.

    Deviation: a link at right angles to the plane has no direction in it. Its axis is replaced by
    e_x of I or, at a wall across e_x, by e_y of I.
    """
    nx, ny, nz = normal
    x, y, z = tangential_part(normal, axis)
    square = x * x + y * y + z * z
    if square <= 1e-12:
        steep = abs(nx) > 0.7
        x, y, z = tangential_part(normal, (0.0 if steep else 1.0, 1.0 if steep else 0.0, 0.0))
        square = x * x + y * y + z * z
    scale = 1.0 / math.sqrt(square)
    x, y, z = scale * x, scale * y, scale * z
    set_axis(frame, 0, normal)
    set_axis(frame, 1, (x, y, z))
    set_axis(frame, 2, (ny * z - nz * y, nz * x - nx * z, nx * y - ny * x))


@inlined
def tangential_part(normal: Three, v: Three) -> Three:
    """Return v without its part along the normal."""
    along = normal[0] * v[0] + normal[1] * v[1] + normal[2] * v[2]
    return v[0] - along * normal[0], v[1] - along * normal[1], v[2] - along * normal[2]


@inlined
def set_axis(frame: Array, k: int, v: Three) -> None:
    """Write the vector v to frame[k]."""
    frame[k, 0], frame[k, 1], frame[k, 2] = v


class Patches(NamedTuple):
    """Patches of friction of a scene; see `surroundings.Patches`."""

    factors: Array  # (rows, columns)
    cell: float  # side of a cell [m]
    origin_x: float  # corner of the cells with the least x and y [m]
    origin_y: float


def make_patches(scene: Scene) -> Patches:
    """Return the patches of a scene as the compiled step takes them; there may be none."""
    patches, rows = scene.patches, scene.patches.factors
    factors = np.array(rows, dtype=float) if rows else np.zeros((0, 0))
    return Patches(factors, patches.cell, *patches.origin)


@inlined
def patch_factor(patches: Any, x: float, y: float) -> float:
    """Return the factor of friction at a point (x, y) of I [m], 1 outside the patches."""
    row = math.floor((y - patches.origin_y) / patches.cell)
    column = math.floor((x - patches.origin_x) / patches.cell)
    if 0 <= row < patches.factors.shape[0] and 0 <= column < patches.factors.shape[1]:
        return patches.factors[row, column]
    return 1.0


@inlined
def fill_grip(patches: Any, contacts: Contacts, a: int, x: float, y: float) -> None:
    """Fill the grip of contact a, of a sphere above (x, y) of I [m]; without patches it is 1."""
    contacts.geometry.grip[a] = patch_factor(patches, x, y)


class Obstacles(NamedTuple):
    """Ground and pegs of a scene; see `parameters.Ground` and `parameters.Pegs`."""

    heights: Array  # (rows, columns) [m]
    cell: float  # side of a cell [m]
    origin_x: float  # corner of the cells with the least x and y [m]
    origin_y: float
    pegs: Array  # (pegs, 3) x, y, radius [m]
    first_peg: int  # number of the first contact with a peg
    first_pair: int  # number of the first contact of two links
    pair_count: int  # number of such contacts
    patches: Patches


def make_obstacles(scene: Scene) -> Obstacles | None:
    """Return ground and pegs in the form of the compiled step, or None if all is flat."""
    ground = scene.ground
    if is_flat(scene):
        return None
    heights = np.array(ground.heights, dtype=float)
    return Obstacles(
        heights=heights.reshape(len(ground.heights), -1) if ground.heights else np.zeros((0, 0)),
        cell=ground.cell,
        origin_x=ground.origin[0],
        origin_y=ground.origin[1],
        pegs=scene.pegs.axes,
        first_peg=first_peg(scene),
        first_pair=first_pair(scene),
        pair_count=len(pair_contacts(scene)),
        patches=make_patches(scene),
    )


@compiled
def reach_of_step(closed_gap: float, time: float) -> float:
    """Return the gap up to which a contact takes part in a step that moves it for a time [s]."""
    return max(closed_gap, LANDING_SPEED * time) if closed_gap > 0.0 else 0.0


class Pose(NamedTuple):
    """Where the links are."""

    q: Array  # (n, 7) link centers [m, frame I] and unit Euler parameters
    R: Array  # (n, 3, 3) link frames in I
    center: Array  # (n, 3) link centers from O, in axes of I [m]


class Found(NamedTuple):
    """What detection fills."""

    closed: Array  # (contacts,) numbers of the closed contacts, the first ones
    contacts: Contacts  # gaps, points, radii and links of the closed ones
    frame: Any  # (contacts, 3, 3) contact frames in I; None on a flat floor


@inlined
def find_contacts(
    obstacles: Obstacles | None, tolerance: float, robot: Mechanism, pose: Pose, found: Found
) -> int:
    """
    Fill the closed contacts, their points and frames.

    Contacts that `takes_part` names count as closed whatever their gap.

    Parameters
    ----------
    obstacles : Obstacles or None
        None on a flat floor; an argument of its own so that Numba leaves out the branch on None.
    tolerance : float
        Gap up to which a contact counts as closed [m].
    robot : Mechanism
        Offsets and radii of the contact spheres [m].
    pose : Pose
    found : Found
        Filled.

    Returns
    -------
    int
        Number of closed contacts.

    """
    if obstacles is None:
        return find_floor_contacts(tolerance, robot, pose, found)
    return find_obstacle_contacts(obstacles, tolerance, robot, pose, found)


@merged
def find_floor_contacts(tolerance: float, robot: Mechanism, pose: Pose, found: Found) -> int:
    """
    Fill the closed contacts with a flat floor; return how many they are.

    Parameters are those of `find_contacts`.

    Deviation: contacts up to a gap of `tolerance` [m], not of 0, take part; see `closing`.

    Deviation: a vertical link has no heading; e_x^I replaces it.
    """
    offset, radius = robot.contact_offset, robot.contact_radius
    q, R, center, closed, contacts = pose.q, pose.R, pose.center, found.closed, found.contacts
    geometry, solution = contacts.geometry, contacts.solution
    n = len(R)
    count = 0
    for i in range(n):
        x, y, z = R[i, 0, 2], R[i, 1, 2], R[i, 2, 2]
        for a, signed in ((i, offset[i]), (n + i, -offset[i])):
            gap = q[i, 2] + signed * z - radius[i]
            if gap <= tolerance or geometry.takes_part[a] == 1:
                closed[count] = a
                count += 1
                geometry.gap[a] = gap
                solution.shift[a] = 0.0
                c = math.sqrt(x * x + y * y)
                flat = c > 1e-6
                geometry.heading[a, 0] = x / c if flat else 1.0
                geometry.heading[a, 1] = y / c if flat else 0.0
                geometry.point[a, 0] = center[i, 0] + signed * x
                geometry.point[a, 1] = center[i, 1] + signed * y
                geometry.point[a, 2] = center[i, 2] + signed * z - radius[i]
                geometry.radius[a] = radius[i]
    return count


@merged
def find_obstacle_contacts(
    obstacles: Obstacles, tolerance: float, robot: Mechanism, pose: Pose, found: Found
) -> int:
    """
    Fill the closed contacts with ground, pegs and other links; return how many they are.

    Parameters are those of `find_contacts`.
    """
    offset, radius = robot.contact_offset, robot.contact_radius
    q, R, center = pose.q, pose.R, pose.center
    closed, contacts, frame = found.closed, found.contacts, found.frame
    geometry = contacts.geometry
    n, count = len(R), 0
    for i in range(n):
        axis = R[i, 0, 2], R[i, 1, 2], R[i, 2, 2]
        for side in range(2):
            arm = offset[i] if side == 0 else -offset[i]
            x, y, z = q[i, 0] + arm * axis[0], q[i, 1] + arm * axis[1], q[i, 2] + arm * axis[2]
            for k in range(4):
                gap, nx, ny, nz = ground_contact(obstacles, x, y, z, radius[i], k)
                a = (side if k == 0 else 1 + 3 * side + k) * n + i
                if gap <= tolerance or (gap < math.inf and geometry.takes_part[a] == 1):
                    closed[count] = a
                    count += 1
                    place_contact(
                        contacts, a, gap, radius[i], on_axis(center[i], arm, axis), (nx, ny, nz)
                    )
                    geometry.link[a], geometry.other_link[a] = i, -1
                    fill_grip(obstacles.patches, contacts, a, x, y)
                    fill_contact_frame(frame[a], (nx, ny, nz), axis)
        for k in range(len(obstacles.pegs)):
            px, py, peg_radius = obstacles.pegs[k, 0], obstacles.pegs[k, 1], obstacles.pegs[k, 2]
            a = obstacles.first_peg + k * n + i
            reach = offset[i] + radius[i] + peg_radius + tolerance
            asked = geometry.takes_part[a] == 1
            if not asked and (px - q[i, 0]) ** 2 + (py - q[i, 1]) ** 2 > reach * reach:
                continue
            link = q[i, 0], q[i, 1]
            arm, distance, nx, ny = peg_contact(link, (axis[0], axis[1]), offset[i], (px, py))
            gap = distance - peg_radius - radius[i]
            if gap <= tolerance or asked:
                closed[count] = a
                count += 1
                place_contact(
                    contacts, a, gap, radius[i], on_axis(center[i], arm, axis), (nx, ny, 0.0)
                )
                geometry.link[a], geometry.other_link[a] = i, -1
                set_axis(frame[a], 0, (nx, ny, 0.0))
                set_axis(frame[a], 1, (-ny, nx, 0.0))
                set_axis(frame[a], 2, (0.0, 0.0, 1.0))
    if obstacles.pair_count > 0:
        count = find_pair_contacts(obstacles.first_pair, tolerance, robot, pose, found, count)
    return count


@inlined
def ground_contact(
    obstacles: Obstacles, x: float, y: float, z: float, radius: float, k: int
) -> tuple[float, float, float, float]:
    """
    Return gap and normal of a sphere at the box below one of four cells.

    The cells are the one below the sphere, and its neighbors along x, along y and diagonally, on
    the side on which they are nearer.

    Parameters
    ----------
    obstacles : Obstacles
    x, y, z, radius : float
        Center of the sphere in I and its radius [m].
    k : int
        Cell: 0 for the one below, 1 and 2 for the neighbors along x and y, 3 for the diagonal one.

    Returns
    -------
    gap : float
        [m]; infinite if there is no contact with the cell.
    normal_x, normal_y, normal_z : float
        Unit vector from the box to the sphere, in I.

    """
    cell = obstacles.cell
    column = math.floor((x - obstacles.origin_x) / cell)
    row = math.floor((y - obstacles.origin_y) / cell)
    own = cell_top(obstacles, column, row)
    if k == 0:
        return z - own - radius, 0.0, 0.0, 1.0
    side_x = -1 if x < obstacles.origin_x + cell * (column + 0.5) else 1
    side_y = -1 if y < obstacles.origin_y + cell * (row + 0.5) else 1
    beyond_x, beyond_y = side_x if k != 2 else 0, side_y if k != 1 else 0
    top = cell_top(obstacles, column + beyond_x, row + beyond_y)
    if top <= own:
        return math.inf, 0.0, 0.0, 1.0
    dx = dy = 0.0
    if k != 2:
        dx = x - (obstacles.origin_x + cell * (column + 0.5) + side_x * cell / 2)
    if k != 1:
        dy = y - (obstacles.origin_y + cell * (row + 0.5) + side_y * cell / 2)
    dz = max(0.0, z - top)
    if k == 3:
        along_x = cell_top(obstacles, column + side_x, row)
        along_y = cell_top(obstacles, column, row + side_y)
        if max(along_x, along_y) >= min(z, top):  # the point is on the box of another neighbor
            return math.inf, 0.0, 0.0, 1.0
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    if distance > 0.0:
        return distance - radius, dx / distance, dy / distance, dz / distance
    return -radius, 0.0, 0.0, 1.0


@inlined
def cell_top(obstacles: Obstacles, column: int, row: int) -> float:
    """Return the height of a cell [m], 0 outside the field of cells."""
    heights = obstacles.heights
    if 0 <= row < heights.shape[0] and 0 <= column < heights.shape[1]:
        return heights[row, column]
    return 0.0


@inlined
def peg_contact(
    link: tuple[float, float], axis: tuple[float, float], half: float, peg: tuple[float, float]
) -> tuple[float, float, float, float]:
    """
    Return where the axis of a link is nearest to the axis of a peg, seen from above.

    Parameters
    ----------
    link : tuple of float
        Center of the link in I: x, y [m].
    axis : tuple of float
        Horizontal part of the unit vector along the link; its length is 1 for a flat link.
    half : float
        Half the length of the axis [m].
    peg : tuple of float
        Axis of the peg in I: x, y [m].

    Returns
    -------
    arm : float
        Distance from the center of the link to the nearest point of its axis [m].
    distance : float
        Distance of this point from the axis of the peg [m].
    normal_x, normal_y : float
        Unit vector from the peg to this point, in I.

    """
    axis_x, axis_y = axis
    apart_x, apart_y = peg[0] - link[0], peg[1] - link[1]
    square = axis_x * axis_x + axis_y * axis_y
    along = (apart_x * axis_x + apart_y * axis_y) / square if square > 1e-12 else 0.0
    arm = min(max(along, -half), half)
    dx, dy = arm * axis_x - apart_x, arm * axis_y - apart_y
    distance = math.sqrt(dx * dx + dy * dy)
    if distance > 0.0:
        return arm, distance, dx / distance, dy / distance
    return arm, distance, 1.0, 0.0


@merged
def find_pair_contacts(
    a: int, tolerance: float, robot: Mechanism, pose: Pose, found: Found, count: int
) -> int:
    """
    Fill the closed contacts of links with each other; return how many contacts are closed.

    They are numbered from a on, and follow `count` closed ones found before. Both links feel a
    force at one point in space, with levers from their own centers in q: these are elsewhere than
    in `center` where joints are open. Other parameters are those of `find_contacts`.
    """
    offset, radius = robot.contact_offset, robot.contact_radius
    q, R, center = pose.q, pose.R, pose.center
    closed, contacts, frame = found.closed, found.contacts, found.frame
    geometry = contacts.geometry
    n = len(R)
    for i in range(n):
        axis = R[i, 0, 2], R[i, 1, 2], R[i, 2, 2]
        for j in range(i + 2, n):
            x, y, z = q[i, 0] - q[j, 0], q[i, 1] - q[j, 1], q[i, 2] - q[j, 2]
            reach = offset[i] + offset[j] + radius[i] + radius[j] + tolerance
            asked = False
            for side in range(4):
                asked = asked or geometry.takes_part[a + side] == 1
            if not asked and x * x + y * y + z * z > reach * reach:
                a += 4
                continue
            for side in range(4):
                arm = offset[i] if side < 2 else -offset[i]
                other = offset[j] if side % 2 == 0 else -offset[j]
                dx = x + arm * axis[0] - other * R[j, 0, 2]
                dy = y + arm * axis[1] - other * R[j, 1, 2]
                dz = z + arm * axis[2] - other * R[j, 2, 2]
                distance = math.sqrt(dx * dx + dy * dy + dz * dz)
                gap = distance - radius[i] - radius[j]
                if gap <= tolerance or geometry.takes_part[a] == 1:
                    closed[count] = a
                    count += 1
                    normal = dx / distance, dy / distance, dz / distance
                    place_contact(
                        contacts, a, gap, radius[i], on_axis(center[i], arm, axis), normal
                    )
                    for k in range(3):
                        apart = (q[i, k] - q[j, k]) - (center[i, k] - center[j, k])
                        geometry.other_point[a, k] = geometry.point[a, k] + apart
                    geometry.link[a], geometry.other_link[a] = i, j
                    fill_contact_frame(frame[a], normal, axis)
                a += 1
    return count


@inlined
def on_axis(center: Array, arm: float, axis: Three) -> Three:
    """Return the point of a link axis that is beside the center (3,) of the link by an arm [m]."""
    return center[0] + arm * axis[0], center[1] + arm * axis[1], center[2] + arm * axis[2]


@inlined
def place_contact(
    contacts: Contacts, a: int, gap: float, radius: float, sphere: Three, normal: Three
) -> None:
    """Fill gap, radius and point of contact a, on a sphere whose center is given from O."""
    geometry, solution = contacts.geometry, contacts.solution
    geometry.gap[a] = gap
    solution.shift[a] = 0.0
    geometry.radius[a] = radius
    for k in range(3):
        geometry.point[a, k] = sphere[k] - radius * normal[k]


@inlined
def penetration(obstacles: Obstacles | None, offset: Array, radius: Array, q: Array) -> float:
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
def obstacle_penetration(obstacles: Obstacles, offset: Array, radius: Array, q: Array) -> float:
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
            peg = obstacles.pegs[k, 0], obstacles.pegs[k, 1]
            _, distance, _, _ = peg_contact((q[i, 0], q[i, 1]), (axis[0], axis[1]), offset[i], peg)
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
def gap_at(
    obstacles: Obstacles | None, offset: Array, radius: Array, q: Array, contacts: Contacts, a: int
) -> float:
    """
    Return the gap of contact a [m], infinite where a cell has no contact.

    Parameters are those of `penetration`, with the contacts: their links are read for
    contacts that have frames.
    """
    n = len(q)
    if obstacles is None:
        i, arm = (a, offset[a]) if a < n else (a - n, -offset[a - n])
        return q[i, 2] + arm * axis_z(q, i)[2] - radius[i]
    return obstacle_gap(obstacles, offset, radius, q, contacts, a)


@merged
def obstacle_gap(
    obstacles: Obstacles, offset: Array, radius: Array, q: Array, contacts: Contacts, a: int
) -> float:
    """Do what `gap_at` does, for a scene with more than a flat floor."""
    n, i = len(q), contacts.geometry.link[a]
    axis = axis_z(q, i)
    if a >= obstacles.first_pair:
        side, j = (a - obstacles.first_pair) % 4, contacts.geometry.other_link[a]
        arm = offset[i] if side < 2 else -offset[i]
        other = offset[j] if side % 2 == 0 else -offset[j]
        beyond, square = axis_z(q, j), 0.0
        for k in range(3):
            square += (q[i, k] + arm * axis[k] - q[j, k] - other * beyond[k]) ** 2
        return math.sqrt(square) - radius[i] - radius[j]
    if a >= obstacles.first_peg:
        k = (a - obstacles.first_peg) // n
        peg = obstacles.pegs[k, 0], obstacles.pegs[k, 1]
        _, distance, _, _ = peg_contact((q[i, 0], q[i, 1]), (axis[0], axis[1]), offset[i], peg)
        return distance - obstacles.pegs[k, 2] - radius[i]
    block = a // n
    side, k = (block, 0) if block < 2 else ((block - 2) // 3, (block - 2) % 3 + 1)
    arm = offset[i] if side == 0 else -offset[i]
    x, y, z = q[i, 0] + arm * axis[0], q[i, 1] + arm * axis[1], q[i, 2] + arm * axis[2]
    gap, _, _, _ = ground_contact(obstacles, x, y, z, radius[i], k)
    return gap

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
from typing import NamedTuple

import numpy as np

from snake_sim_ros.contact.contacts import Contacts
from snake_sim_ros.contact.shapes import (
    across,
    Axis,
    inner,
    minus,
    moved,
    near_on_axes,
    size_of,
    times,
    triple,
)
from snake_sim_ros.contact.surroundings import (
    ASKED,
    depth_of_axis,
    depth_of_sphere,
    distance_of_axis,
    distance_of_sphere,
    find_places_of_axis,
    find_places_of_sphere,
    first_of_capsule,
    first_of_sphere,
    has_any,
    is_asked,
    make_surroundings,
    NEARBY,
    number_places,
    part_of,
    remember_what,
    Surroundings,
)
from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.dynamics.kinematics import (
    carried_in,
    carried_part,
    carried_place,
    floor_penetration,
    sphere_height,
)
from snake_sim_ros.dynamics.mechanism import Mechanism
from snake_sim_ros.dynamics.spatial_vectors import Three
from snake_sim_ros.scene.chain import Capsules, Spheres
from snake_sim_ros.scene.obstacles import (
    capsule_pairs,
    CELLS,
    first_pair,
    first_peg,
    is_flat,
    OF_CAPSULE,
    OF_PAIR,
    OF_SPHERE,
    STEEP,
    UPRIGHT,
)
from snake_sim_ros.scene.parameters import Array, Scene

Two = tuple[float, float]
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
    if square <= UPRIGHT * UPRIGHT:
        steep = abs(nx) > STEEP
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

    factors: Array  # (rows, columns) of friction [1]; rows along y of I, columns along x
    cell: float  # side of a cell [m]
    origin_x: float  # corner of the cells with the least x and y, in I [m]
    origin_y: float  # [m]


def make_patches(scene: Scene) -> Patches:
    """Return the patches of a scene as the compiled step takes them; there may be none."""
    patches, rows = scene.patches, scene.patches.factors
    factors = np.array(rows, dtype=float) if rows else np.zeros((0, 0))
    return Patches(factors, patches.cell, *patches.origin)


@inlined
def patch_factor(patches: Patches, x: float, y: float) -> float:
    """Return the factor of friction at a point (x, y) of I [m], 1 outside the patches."""
    row = math.floor((y - patches.origin_y) / patches.cell)
    column = math.floor((x - patches.origin_x) / patches.cell)
    if 0 <= row < patches.factors.shape[0] and 0 <= column < patches.factors.shape[1]:
        return patches.factors[row, column]
    return 1.0


@inlined
def fill_grip(
    patches: Patches, contacts: Contacts, a: int, place: tuple[float, float], own: float
) -> None:
    """Fill the grip of contact a, of a sphere above a place of I [m], with a factor of its own."""
    contacts.geometry.grip[a] = own * patch_factor(patches, place[0], place[1])


class Obstacles(NamedTuple):
    """Ground and pegs of a scene; see `parameters.Ground` and `parameters.Pegs`."""

    heights: Array  # (rows, columns) of the cells [m]; rows along y of I, columns along x
    cell: float  # side of a cell [m]
    origin_x: float  # corner of the cells with the least x and y, in I [m]
    origin_y: float  # [m]
    pegs: Array  # (pegs, 3) x and y in I, radius [m]
    first_peg: int  # number of the first contact with a peg
    first_pair: int  # number of the first contact of two links
    pair_count: int  # number of pairs, with OF_PAIR contacts each
    pairs: Array  # (pair_count, 2) the capsules that touch in each of them
    patches: Patches  # of friction on the ground
    world: Surroundings  # its solids


def make_obstacles(scene: Scene) -> Obstacles | None:
    """Return ground and pegs in the form of the compiled step, or None if all is flat."""
    ground, pairs = scene.ground, capsule_pairs(scene)
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
        pair_count=len(pairs),
        pairs=np.array(pairs, dtype=int).reshape(-1, 2),
        patches=make_patches(scene),
        world=make_surroundings(scene),
    )


@compiled
def reach_of_step(closed_gap: float, time: float) -> float:
    """Return the gap up to which a contact takes part in a step that moves it for a time [s]."""
    return max(closed_gap, LANDING_SPEED * time) if closed_gap > 0.0 else 0.0


class Pose(NamedTuple):
    """Where the links of a robot are."""

    robot: Mechanism  # spheres and capsules of its links
    q: Array  # (n, 7) link centers [m, frame I] and unit Euler parameters
    R: Array  # (n, 3, 3) link frames in I
    center: Array  # (n, 3) link centers from O, in axes of I [m]


class Found(NamedTuple):
    """What detection fills."""

    closed: Array  # (contacts,) numbers of the closed contacts, the first ones
    contacts: Contacts  # gaps, points, radii and links of the closed ones
    takes_part: Array  # (contacts,) 1 if one takes part in the step whatever its gap; it is read
    frame: Array | None  # (contacts, 3, 3) contact frames in I; None on a flat floor


@compiled
def find_contacts(obstacles: Obstacles | None, tolerance: float, pose: Pose, found: Found) -> int:
    """
    Fill the closed contacts, their points and frames.

    Contacts that `takes_part` names count as closed whatever their gap.

    Parameters
    ----------
    obstacles : Obstacles or None
        None on a flat floor; an argument of its own so that Numba leaves out the branch on None.
    tolerance : float
        Gap up to which a contact counts as closed [m].
    pose : Pose
    found : Found
        Filled.

    Returns
    -------
    int
        Number of closed contacts.

    """
    if obstacles is None:
        return find_floor_contacts(tolerance, pose, found)
    return find_obstacle_contacts(obstacles, tolerance, pose, found)


@inlined
def find_floor_contacts(tolerance: float, pose: Pose, found: Found) -> int:
    """
    Fill the closed contacts with a flat floor; return how many they are.

    Parameters are those of `find_contacts`.

    Deviation: contacts up to a gap of `tolerance` [m], not of 0, take part; see `closing`.

    Deviation: a vertical link has no heading; e_x^I replaces it.
    """
    spheres, q, R, center = pose.robot.spheres, pose.q, pose.R, pose.center
    closed, contacts = found.closed, found.contacts
    geometry, solution = contacts.geometry, contacts.solution
    place, radius, straight, count = spheres.place, spheres.radius, spheres.straight, 0
    for a in spheres.of_link:
        i = spheres.link[a]
        arm = carried_part(straight, R, i, place, a, 2)
        gap = q[i, 2] + arm - radius[a]
        if gap <= tolerance or found.takes_part[a] == 1:
            x, y = R[i, 0, 2], R[i, 1, 2]
            closed[count] = a
            count += 1
            geometry.gap[a] = gap
            solution.shift[a] = 0.0
            c = math.sqrt(x * x + y * y)
            flat = c > UPRIGHT
            geometry.heading[a, 0] = x / c if flat else 1.0
            geometry.heading[a, 1] = y / c if flat else 0.0
            geometry.point[a, 0] = center[i, 0] + carried_part(straight, R, i, place, a, 0)
            geometry.point[a, 1] = center[i, 1] + carried_part(straight, R, i, place, a, 1)
            geometry.point[a, 2] = center[i, 2] + arm - radius[a]
            geometry.radius[a] = radius[a]
    return count


@compiled
def find_obstacle_contacts(
    obstacles: Obstacles, tolerance: float, pose: Pose, found: Found
) -> int:
    """
    Fill the closed contacts with ground, pegs and other links; return how many they are.

    Parameters are those of `find_contacts`.
    """
    spheres, q, R, center = pose.robot.spheres, pose.q, pose.R, pose.center
    closed, contacts, frame = found.closed, found.contacts, found.frame
    assert frame is not None
    geometry, count, next_capsule = contacts.geometry, 0, 0
    search = Search(obstacles.patches, tolerance, pose, found)
    cells, has_solids = CELLS if len(obstacles.heights) > 0 else 1, has_any(obstacles.world)
    for i in range(len(R)):
        axis = R[i, 0, 2], R[i, 1, 2], R[i, 2, 2]
        for m in range(spheres.begin[i], spheres.begin[i + 1]):
            s = spheres.of_link[m]
            arm, radius = carried_in(R, i, spheres.place, s), spheres.radius[s]
            x, y, z = q[i, 0] + arm[0], q[i, 1] + arm[1], q[i, 2] + arm[2]
            hides = False
            if has_solids:
                count, hides = find_world_contacts_of_sphere(obstacles.world, search, s, count)
            for k in range(1 if hides else 0, cells):
                gap, nx, ny, nz = ground_contact(obstacles, x, y, z, radius, k)
                a = k * len(spheres.link) + s
                if gap <= tolerance or (gap < math.inf and found.takes_part[a] == 1):
                    closed[count] = a
                    count += 1
                    place_contact(contacts, a, gap, radius, beside(center[i], arm), (nx, ny, nz))
                    geometry.link[a], geometry.other_link[a] = i, -1
                    fill_grip(obstacles.patches, contacts, a, (x, y), spheres.grip[s])
                    fill_contact_frame(frame[a], (nx, ny, nz), axis)
        begin, next_capsule = next_capsule, end_of_capsules(pose.robot.capsules, next_capsule, i)
        if has_solids:
            for c in range(begin, next_capsule):
                count = find_world_contacts_of_capsule(obstacles.world, search, c, count)
        if len(obstacles.pegs) > 0:
            part = begin, next_capsule
            count = find_peg_contacts(obstacles, tolerance, pose, part, found, count)
    return find_pair_contacts(obstacles, tolerance, pose, found, count)


class Search(NamedTuple):
    """What contacts with the world are looked for."""

    patches: Patches
    tolerance: float  # gap up to which a contact counts as closed [m]
    pose: Pose
    found: Found


class Ball(NamedTuple):
    """What touches the world at a place: a sphere of the robot, or one inside of a capsule."""

    link: int
    radius: float  # [m]
    grip: float  # factor of friction of the link
    first: int  # number of the first contact of the sphere or capsule


@inlined
def find_world_contacts_of_sphere(
    world: Surroundings, search: Search, s: int, count: int
) -> tuple[int, bool]:
    """
    Fill the closed contacts of sphere s with the world, behind `count` closed ones before.

    Return how many contacts are closed, and whether a solid hides the floor below the sphere.
    """
    pose, spheres = search.pose, search.pose.robot.spheres
    i, radius = spheres.link[s], spheres.radius[s]
    center = beside(pose.q[i], carried_in(pose.R, i, spheres.place, s))
    ball = Ball(i, radius, spheres.grip[s], first_of_sphere(world, s))
    reach, inward = reach_of_world(search, ball, OF_SPHERE), carried_in(pose.R, i, world.inward, s)
    places, hides = find_places_of_sphere(world, center, radius, reach, inward)
    places = number_places(world.touched, places, OF_SPHERE)
    return fill_world_contacts(world, search, ball, places, count), hides


@inlined
def find_world_contacts_of_capsule(world: Surroundings, search: Search, c: int, count: int) -> int:
    """Do the same for the interior of capsule c, which hides no floor."""
    pose, capsules = search.pose, search.pose.robot.capsules
    i, radius = capsules.link[c], capsules.radius[c]
    axis = axis_at(pose, c)
    ball = Ball(i, radius, world.capsule_grip[c], first_of_capsule(world, c))
    reach = reach_of_world(search, ball, OF_CAPSULE)
    places = find_places_of_axis(world, axis, radius, reach)
    places = number_places(world.touched, places, OF_CAPSULE)
    return fill_world_contacts(world, search, ball, places, count)


@inlined
def reach_of_world(search: Search, ball: Ball, slots: int) -> float:
    """Return the gap up to which some contacts with the world are numbered [m]."""
    asked = is_asked(search.found.takes_part, ball.first, slots)
    return max(search.tolerance, ASKED if asked else NEARBY)


@inlined
def fill_world_contacts(
    world: Surroundings, search: Search, ball: Ball, places: int, count: int
) -> int:
    """Fill the contacts at some places of the world, if they are closed; return how many are."""
    pose, contacts, frame = search.pose, search.found.contacts, search.found.frame
    assert frame is not None
    i, touched = ball.link, world.touched
    if touched.left_out[0] - ball.radius <= search.tolerance:
        touched.overflows[0] = 1
    axis = pose.R[i, 0, 2], pose.R[i, 1, 2], pose.R[i, 2, 2]
    for k in range(places):
        a, row = ball.first + k, touched.places[k]
        gap, normal = row[0] - ball.radius, part_of(row, 1)
        center = moved(part_of(row, 9), row[0], normal)
        remember_what(touched, k, a, center)
        if gap <= search.tolerance or search.found.takes_part[a] == 1:
            search.found.closed[count] = a
            count += 1
            arm = minus(center, triple(pose.q, i))
            place_contact(contacts, a, gap, ball.radius, beside(pose.center[i], arm), normal)
            contacts.geometry.link[a], contacts.geometry.other_link[a] = i, -1
            own = ball.grip * world.grip[touched.solid[a]]
            fill_grip(search.patches, contacts, a, (center[0], center[1]), own)
            fill_contact_frame(frame[a], normal, axis)
    return count


@inlined
def overflow(obstacles: Obstacles | None) -> int:
    """Return 1 if closed contacts were left out since this was asked last, else 0."""
    if obstacles is None:
        return 0
    found = obstacles.world.touched.overflows[0]
    obstacles.world.touched.overflows[0] = 0
    return found


@inlined
def end_of_capsules(capsules: Capsules, begin: int, i: int) -> int:
    """Return where those of link i end, which begin at `begin`."""
    end = begin
    while end < len(capsules.link) and capsules.link[end] == i:
        end += 1
    return end


@inlined
def find_peg_contacts(
    obstacles: Obstacles, tolerance: float, pose: Pose, part: tuple[int, int], found: Found,
    count: int,
) -> int:  # fmt: skip
    """
    Fill the closed contacts of some capsules with pegs; return how many contacts are closed.

    They follow `count` closed ones found before. `part` is the first of the capsules and the one
    after the last. Other parameters are those of `find_contacts`.
    """
    capsules, q, R, center = pose.robot.capsules, pose.q, pose.R, pose.center
    closed, contacts, frame = found.closed, found.contacts, found.frame
    assert frame is not None
    geometry = contacts.geometry
    for c in range(part[0], part[1]):
        i, radius = capsules.link[c], capsules.radius[c]
        lever, axis = carried_in(R, i, capsules.center, c), carried_in(R, i, capsules.axis, c)
        middle = q[i, 0] + lever[0], q[i, 1] + lever[1]
        for k in range(len(obstacles.pegs)):
            a = obstacles.first_peg + k * len(capsules.link) + c
            asked = found.takes_part[a] == 1
            if not asked and is_beyond(tolerance, obstacles.pegs, capsules, middle, c, k):
                continue
            gap, arm, nx, ny = at_peg(obstacles.pegs, capsules, middle, (axis[0], axis[1]), c, k)
            if gap <= tolerance or asked:
                closed[count] = a
                count += 1
                point = on_axis(lever, arm, axis)
                place_contact(contacts, a, gap, radius, beside(center[i], point), (nx, ny, 0.0))
                geometry.link[a], geometry.other_link[a] = i, -1
                set_axis(frame[a], 0, (nx, ny, 0.0))
                set_axis(frame[a], 1, (-ny, nx, 0.0))
                set_axis(frame[a], 2, (0.0, 0.0, 1.0))
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
    if len(obstacles.heights) == 0:
        return z - radius, 0.0, 0.0, 1.0
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
    along = (apart_x * axis_x + apart_y * axis_y) / square if square > UPRIGHT * UPRIGHT else 0.0
    arm = min(max(along, -half), half)
    dx, dy = arm * axis_x - apart_x, arm * axis_y - apart_y
    distance = math.sqrt(dx * dx + dy * dy)
    if distance > 0.0:
        return arm, distance, dx / distance, dy / distance
    return arm, distance, 1.0, 0.0


@inlined
def find_pair_contacts(
    obstacles: Obstacles, tolerance: float, pose: Pose, found: Found, count: int
) -> int:
    """
    Fill the closed contacts of links with each other; return how many contacts are closed.

    They follow `count` closed ones found before. Both links feel a force at one point in space,
    with levers from their own centers in q: these are elsewhere than in `center` where joints are
    open. Other parameters are those of `find_contacts`.
    """
    robot, q, R, center = pose.robot, pose.q, pose.R, pose.center
    closed, contacts, frame = found.closed, found.contacts, found.frame
    assert frame is not None
    geometry, capsules, reaches = contacts.geometry, robot.capsules, robot.spheres.reach
    for p in range(obstacles.pair_count):
        c, d = obstacles.pairs[p, 0], obstacles.pairs[p, 1]
        i, j, first = capsules.link[c], capsules.link[d], obstacles.first_pair + OF_PAIR * p
        between, reach = minus(triple(q, i), triple(q, j)), reaches[i] + reaches[j] + tolerance
        is_near = inner(between, between) <= reach * reach
        if not is_near and not is_asked(found.takes_part, first, OF_PAIR):
            continue
        one, other = axis_at(pose, c), axis_at(pose, d)
        for k in range(OF_PAIR):
            a = first + k
            gap, place, normal = at_axes(capsules, one, other, c, d, k)
            if gap <= tolerance or (gap < math.inf and found.takes_part[a] == 1):
                closed[count] = a
                count += 1
                on_one = beside(center[i], minus(place, triple(q, i)))
                place_contact(contacts, a, gap, capsules.radius[c], on_one, normal)
                for m in range(3):
                    apart = between[m] - (center[i, m] - center[j, m])
                    geometry.other_point[a, m] = geometry.point[a, m] + apart
                geometry.link[a], geometry.other_link[a] = i, j
                fill_contact_frame(frame[a], normal, (R[i, 0, 2], R[i, 1, 2], R[i, 2, 2]))
    return count


@inlined
def axis_at(pose: Pose, c: int) -> Axis:
    """Return the axis of capsule c."""
    i, capsules = pose.robot.capsules.link[c], pose.robot.capsules
    middle = beside(pose.q[i], carried_in(pose.R, i, capsules.center, c))
    return Axis(middle, carried_in(pose.R, i, capsules.axis, c), capsules.half[c])


@inlined
def at_axes(
    capsules: Capsules, one: Axis, other: Axis, c: int, d: int, k: int
) -> tuple[float, Three, Three]:
    """
    Return the gap of contact k of capsules c and d [m], infinite if there is none.

    Besides, the point on the axis of the first one, and the unit vector from the second to it.
    """
    s, t = near_on_axes(one, other, k)
    if s == math.inf:
        return s, one.middle, one.along
    place = moved(one.middle, s, one.along)
    apart = minus(place, moved(other.middle, t, other.along))
    distance = size_of(apart)
    normal = times(1.0 / distance, apart) if distance > 0.0 else across(one.along)
    return distance - capsules.radius[c] - capsules.radius[d], place, normal


@inlined
def on_axis(center: Three, arm: float, axis: Three) -> Three:
    """Return the point of an axis that is beside a center by an arm [m]."""
    return center[0] + arm * axis[0], center[1] + arm * axis[1], center[2] + arm * axis[2]


@inlined
def beside(center: Array, lever: Three) -> Three:
    """Return the point that is beside the center (3,) of a link by a lever [m]."""
    return center[0] + lever[0], center[1] + lever[1], center[2] + lever[2]


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


@compiled
def penetration(obstacles: Obstacles | None, robot: Mechanism, q: Array) -> float:
    """
    Return how deep the robot is in the floor or in an obstacle [m], 0 if it is in neither.

    Parameters
    ----------
    obstacles : Obstacles or None
        None on a flat floor; an argument of its own so that Numba leaves out the branch on None.
    robot : Mechanism
        Spheres and capsules of its links.
    q : ndarray, shape (n, 7)
        Link centers [m, frame I] and unit Euler parameters.

    """
    spheres, lowest = robot.spheres, 0.0
    if obstacles is None:
        return floor_penetration(spheres, q)
    for s in range(len(spheres.link)):
        for k in range(CELLS if len(obstacles.heights) > 0 else 1):
            lowest = min(lowest, gap_to_ground(obstacles, spheres, q, s, k))
    if has_any(obstacles.world):
        lowest = min(lowest, -world_penetration(obstacles.world, spheres, robot.capsules, q))
    if len(obstacles.pegs) > 0:
        for c in range(len(robot.capsules.link)):
            middle, axis = from_above(robot.capsules, q, c)
            for k in range(len(obstacles.pegs)):
                gap = gap_to_peg(obstacles.pegs, robot.capsules, middle, axis, c, k)
                lowest = min(lowest, gap)
    for p in range(obstacles.pair_count):
        c, d = obstacles.pairs[p, 0], obstacles.pairs[p, 1]
        one, other = axis_of_capsule(robot.capsules, q, c), axis_of_capsule(robot.capsules, q, d)
        for k in range(OF_PAIR):
            lowest = min(lowest, at_axes(robot.capsules, one, other, c, d, k)[0])
    return -lowest


@compiled
def world_penetration(
    world: Surroundings, spheres: Spheres, capsules: Capsules, q: Array
) -> float:
    """Return how deep the robot is in the world [m], 0 if it is beside."""
    depth = 0.0
    for s in range(len(spheres.link)):
        i = spheres.link[s]
        center = beside(q[i], carried_place(spheres.straight, q, i, spheres.place, s))
        depth = max(depth, depth_of_sphere(world, center, spheres.radius[s]))
    for c in range(len(capsules.link)):
        axis = axis_of_capsule(capsules, q, c)
        depth = max(depth, depth_of_axis(world, axis, capsules.radius[c]))
    return depth


@inlined
def axis_of_capsule(capsules: Capsules, q: Array, c: int) -> Axis:
    """Return the axis of capsule c."""
    i = capsules.link[c]
    middle = beside(q[i], carried_place(False, q, i, capsules.center, c))
    return Axis(middle, carried_place(False, q, i, capsules.axis, c), capsules.half[c])


@inlined
def gap_to_world(world: Surroundings, robot: Mechanism, q: Array, a: int) -> float:
    """Return the gap of contact a [m], of which detection found what it touches."""
    k, spheres, capsules = a - world.first, robot.spheres, robot.capsules
    if k < len(spheres.link) * OF_SPHERE:
        s = k // OF_SPHERE
        i = spheres.link[s]
        c = beside(q[i], carried_place(spheres.straight, q, i, spheres.place, s))
        return distance_of_sphere(world.touched, a, c) - spheres.radius[s]
    k = (k - len(spheres.link) * OF_SPHERE) // OF_CAPSULE
    middle, along, _ = axis_of_capsule(capsules, q, k)
    return distance_of_axis(world.touched, a, middle, along) - capsules.radius[k]


@inlined
def gap_to_ground(obstacles: Obstacles, spheres: Spheres, q: Array, s: int, k: int) -> float:
    """Return the gap of sphere s to the box below one of four cells; see `ground_contact`."""
    i = spheres.link[s]
    arm = carried_place(spheres.straight, q, i, spheres.place, s)
    x, y, z = q[i, 0] + arm[0], q[i, 1] + arm[1], q[i, 2] + arm[2]
    gap, _, _, _ = ground_contact(obstacles, x, y, z, spheres.radius[s], k)
    return gap


@inlined
def from_above(capsules: Capsules, q: Array, c: int) -> tuple[Two, Two]:
    """Return x and y of the middle of capsule c [m], and of the unit vector along it, in I."""
    i = capsules.link[c]
    lever = carried_place(False, q, i, capsules.center, c)
    axis = carried_place(False, q, i, capsules.axis, c)
    return (q[i, 0] + lever[0], q[i, 1] + lever[1]), (axis[0], axis[1])


@inlined
def at_peg(
    pegs: Array, capsules: Capsules, middle: Two, axis: Two, c: int, k: int
) -> tuple[float, float, float, float]:
    """Return the gap of capsule c, see `from_above`, to peg k [m]; rest as from `peg_contact`."""
    peg = pegs[k, 0], pegs[k, 1]
    arm, distance, nx, ny = peg_contact(middle, axis, capsules.half[c], peg)
    return distance - pegs[k, 2] - capsules.radius[c], arm, nx, ny


@inlined
def gap_to_peg(pegs: Array, capsules: Capsules, middle: Two, axis: Two, c: int, k: int) -> float:
    """Return the gap of capsule c, see `from_above`, to peg k [m]."""
    gap, _, _, _ = at_peg(pegs, capsules, middle, axis, c, k)
    return gap


@inlined
def is_beyond(
    tolerance: float, pegs: Array, capsules: Capsules, middle: Two, c: int, k: int
) -> bool:
    """Return whether capsule c is too far from peg k for a gap of `tolerance` [m]."""
    reach = capsules.half[c] + capsules.radius[c] + pegs[k, 2] + tolerance
    return (pegs[k, 0] - middle[0]) ** 2 + (pegs[k, 1] - middle[1]) ** 2 > reach * reach


@inlined
def gap_at(
    obstacles: Obstacles | None, robot: Mechanism, q: Array, contacts: Contacts, a: int
) -> float:
    """
    Return the gap of contact a [m], infinite where a cell has no contact.

    Parameters are those of `penetration`, with the contacts: their links are read for
    contacts that have frames.
    """
    spheres = robot.spheres
    if obstacles is None:
        return sphere_height(spheres, q, a)
    if a >= obstacles.first_pair:
        p, k = divmod(a - obstacles.first_pair, OF_PAIR)
        c, d = obstacles.pairs[p, 0], obstacles.pairs[p, 1]
        one, other = axis_of_capsule(robot.capsules, q, c), axis_of_capsule(robot.capsules, q, d)
        return at_axes(robot.capsules, one, other, c, d, k)[0]
    if a >= obstacles.first_peg:
        k, c = divmod(a - obstacles.first_peg, len(robot.capsules.link))
        middle, axis = from_above(robot.capsules, q, c)
        return gap_to_peg(obstacles.pegs, robot.capsules, middle, axis, c, k)
    if has_any(obstacles.world) and a >= len(spheres.link):
        return gap_to_world(obstacles.world, robot, q, a)
    k, s = divmod(a, len(spheres.link))
    return gap_to_ground(obstacles, spheres, q, s, k)

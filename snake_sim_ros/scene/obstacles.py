# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Everything a robot can touch besides a flat floor: ground of cells, and pegs; gaps and frames.

This is the definition in NumPy; `contact.detection` is its compiled form. Contacts are numbered in
slots of one contact for each link, so that contact a belongs to link a % n. The first two slots
are the front and the rear spheres on the ground below them, as in eq. (10). If the ground has
cells, six more slots follow for the higher cells beside the front and the rear spheres. Then comes
a slot for every peg. Contacts of links with each other come last: four for every two links that
are not neighbors, of the spheres of one with those of the other.

A sphere is in contact with the box below each cell, at the nearest point of the box. The cell
below its center always counts. A neighbor counts only if it is higher, so that a flat ground is
flat whatever its cells. A diagonal neighbor counts only if its nearest point is not on one of the
two other neighbors, so that a straight wall is straight.

A link is in contact with a peg as a capsule, the cylinder around its axis with the two contact
spheres as its ends, at the height of the nearest point of its axis.
"""

from collections import Counter
import math
from typing import Any, NamedTuple

import numpy as np

from snake_sim_ros.scene.parameters import Array, Ground, Robot, Scene
from snake_sim_ros.scene.rotations import cross, rotation_matrices

NEIGHBOR_SLOTS = 6  # of the cells beside the two spheres of a link: along x, along y, diagonal
E_X, E_Y, E_Z = np.eye(3)
# How pictures show what has no end: the height of pegs, in contact radii, and how far boxes of the
# ground reach below the lowest of them [m].
PEG_HEIGHT, FOUNDATION = 4.0, 0.01


def is_flat(scene: Scene) -> bool:
    """
    Return whether there is nothing but the floor z = 0, with one ellipse of friction.

    Any other friction, also that of patches, needs the code for obstacles.
    """
    obstacles = scene.ground.heights or scene.pegs.x or scene.self_contact
    return not (obstacles or scene.patches.factors) and scene.friction.is_one_ellipse


def first_peg(scene: Scene) -> int:
    """Return the number of the first contact with a peg."""
    return scene.robot.link_count * (2 + (NEIGHBOR_SLOTS if scene.ground.heights else 0))


def first_pair(scene: Scene) -> int:
    """Return the number of the first contact of two links."""
    return first_peg(scene) + scene.robot.link_count * len(scene.pegs.x)


def pair_contacts(scene: Scene) -> list[tuple[int, int, int, int]]:
    """Return link, other link and the signs of their spheres, of every contact of two links."""
    n = scene.robot.link_count if scene.self_contact else 0
    apart = [(i, j) for i in range(n) for j in range(i + 2, n)]
    return [(i, j, s, t) for i, j in apart for s in (1, -1) for t in (1, -1)]


def contact_count(scene: Scene) -> int:
    """Return the number of contacts, open and closed: 2n on a flat floor."""
    n = scene.robot.link_count
    return first_pair(scene) + (2 * (n - 1) * (n - 2) if scene.self_contact else 0)


def contact_keys(scene: Scene) -> list[tuple[Any, ...]]:
    """
    Return what touches what in every contact, by which contacts of different scenes are matched.

    Returns
    -------
    list of tuple
        ('floor', side, link); ('cell', slot, link), without the ground it belongs to; ('peg', x,
        y, radius, number of equal pegs before it, link); ('pair', link, other link, and the signs
        of their spheres).

    """
    n, count = scene.robot.link_count, first_peg(scene)
    keys: list[tuple[Any, ...]] = [
        ('floor' if slot < 2 else 'cell', slot, i) for slot in range(count // n) for i in range(n)
    ]
    before: Counter[tuple[float, ...]] = Counter()
    for peg in map(tuple, scene.pegs.axes.tolist()):
        keys += [('peg', *peg, before[peg], i) for i in range(n)]
        before[peg] += 1
    return keys + [('pair', *pair) for pair in pair_contacts(scene)]


def same_contacts(before: Scene, after: Scene) -> tuple[Array, Array]:
    """
    Return the numbers of the contacts that two scenes have in common, in each of them.

    Returns
    -------
    old, new : ndarray of int, shape (k,)
        Contact ``old[k]`` of the first scene is contact ``new[k]`` of the second one. Cells of
        different grounds are different; the spheres on the ground below them are the same.

    """
    number = {key: a for a, key in enumerate(contact_keys(before))}
    ground = before.ground == after.ground
    common = [
        (number[key], a)
        for a, key in enumerate(contact_keys(after))
        if key in number and (ground or key[0] != 'cell')
    ]
    old, new = np.array(common, dtype=int).reshape(-1, 2).T
    return old, new


def contact_links(scene: Scene) -> Array:
    """Return the link of every contact and the one it touches, or -1, shape (contacts, 2)."""
    n, first = scene.robot.link_count, first_pair(scene)
    of_world = [(a % n, -1) for a in range(first)]
    return np.array(of_world + [(i, j) for i, j, _, _ in pair_contacts(scene)])


def contact_friction(scene: Scene, contacts: Array, q: Array) -> Array:
    """
    Return the coefficients of friction of some contacts, for link coordinates q (n, 7).

    Returns
    -------
    ndarray, shape (k, 5)
        mu along e_x of the contact frame, against sliding forward and backward; mu along e_y, and
        that of rolling; the factor of patches that is in them.

    """
    n, first, found = scene.robot.link_count, first_peg(scene), []
    center, axis, offset, _ = make_capsules(scene.robot, q)
    for a in map(int, contacts):
        if a >= first:
            is_pair = a >= first_pair(scene)
            mu = scene.self_contact_friction if is_pair else scene.pegs.friction
            found.append((mu, mu, mu, 0.0, 1.0))
            continue
        slot, i = divmod(a, n)
        front = slot == 0 or 2 <= slot < 2 + NEIGHBOR_SLOTS // 2
        x, y, _ = center[i] + (1 if front else -1) * offset[i] * axis[i]
        found.append(floor_friction(scene, x, y))
    return np.array(found).reshape(-1, 5)


def floor_friction(scene: Scene, x: float, y: float) -> tuple[float, float, float, float, float]:
    """Return the coefficients of the ground at (x, y) of I [m], as `contact_friction` does."""
    patches, floor, factor = scene.patches, scene.friction, 1.0
    column = math.floor((x - patches.origin[0]) / patches.cell)
    row = math.floor((y - patches.origin[1]) / patches.cell)
    if 0 <= row < len(patches.factors) and 0 <= column < len(patches.factors[0]):
        factor = patches.factors[row][column]
    along, back = factor * floor.longitudinal, factor * floor.against_backward
    return along, back, factor * floor.transversal, factor * floor.rolling, factor


def cell_height(ground: Ground, column: int, row: int) -> float:
    """Return the height of a cell [m], 0 outside the field of cells."""
    if 0 <= row < len(ground.heights) and 0 <= column < len(ground.heights[0]):
        return ground.heights[row][column]
    return 0.0


def cell_centers(ground: Ground) -> Array:
    """Return x and y of the middle of every cell, shape (rows, columns, 2) [m]."""
    rows, columns = np.indices(np.shape(ground.heights))
    return np.asarray(ground.origin + ground.cell * (np.stack([columns, rows], axis=-1) + 0.5))


def cell_at(ground: Ground, x: float, y: float) -> tuple[int, int]:
    """Return column and row of the cell at a point (x, y) of I [m]."""
    x, y = x - ground.origin[0], y - ground.origin[1]
    return math.floor(x / ground.cell), math.floor(y / ground.cell)


def nearest_points(ground: Ground, center: Array) -> list[Array | None]:
    """
    Return the nearest point to a sphere center of each of four boxes that can touch the sphere.

    The boxes are those of the cell below it, then of its neighbors along x, along y and
    diagonally, on the side on which they are nearer.

    Parameters
    ----------
    ground : Ground
    center : ndarray, shape (3,)
        Center of the sphere in I [m].

    Returns
    -------
    list of ndarray, shape (3,), or None
        [m]; None if there is no contact with the box.

    """
    column, row = cell_at(ground, center[0], center[1])
    middle = np.array(ground.origin) + ground.cell * (np.array([column, row]) + 0.5)
    side = np.where(center[:2] < middle, -1, 1)
    edge = middle + side * ground.cell / 2
    own = cell_height(ground, column, row)
    points: list[Array | None] = [np.array([center[0], center[1], own])]
    tops: list[float] = []
    for beyond in ((1, 0), (0, 1), (1, 1)):
        step = side * beyond
        top = cell_height(ground, column + step[0], row + step[1])
        x, y = np.where(beyond, edge, center[:2])
        z = min(center[2], top)
        hidden = beyond == (1, 1) and max(tops) >= z
        points.append(None if top <= own or hidden else np.array([x, y, z]))
        tops.append(top)
    return points


def tangents(normal: Array, axis: Array) -> tuple[Array, Array]:
    """
    Return e_x and e_y of a contact frame: along a link and across it, in the tangent plane.

    Deviation: a link at right angles to the plane has no direction in it. Its axis is replaced by
    e_x of I or, at a wall across e_x, by e_y of I.

    Parameters
    ----------
    normal, axis : ndarray, shape (3,)
        Unit vectors of the contact normal and along the link, in I.

    """
    e_x = axis - (axis @ normal) * normal
    if np.linalg.norm(e_x) <= 1e-6:
        axis = E_Y if abs(normal[0]) > 0.7 else E_X
        e_x = axis - (axis @ normal) * normal
    e_x = e_x / np.linalg.norm(e_x)
    return e_x, cross(normal, e_x)


class Capsules(NamedTuple):
    """Links as they touch obstacles: an axis with two contact spheres."""

    center: Array  # (n, 3) of the links [m, frame I]
    axis: Array  # (n, 3) e_z of the links in I
    offset: Array  # (n,) of the contact spheres along the axis [m]
    radius: Array  # (n,) of the contact spheres [m]


def make_capsules(robot: Robot, q: Array) -> Capsules:
    """Return the links of a robot with coordinates q, shape (n, 7)."""
    axis = rotation_matrices(q[:, 3:]) @ E_Z
    offset, radius = robot.per_link('contact_offset'), robot.per_link('contact_radius')
    return Capsules(q[:, :3], axis, offset, radius)


def contact_geometry(
    scene: Scene, q: Array, wanted: Array | None = None
) -> tuple[Array, Array, Array]:
    """
    Return gaps, levers and frames of all contacts of a scene.

    Parameters
    ----------
    scene : Scene
    q : ndarray, shape (n, 7)
        Link centers [m, frame I] and unit Euler parameters.
    wanted : ndarray of bool, shape (contacts,), optional
        Contacts to compute, together with others of the same sphere on the ground; default: all.

    Returns
    -------
    gap : ndarray, shape (contacts,)
        [m]; infinite where a neighbor is not higher, and for contacts that are not wanted.
    lever : ndarray, shape (contacts, 3)
        Link center to contact point [m, frame I].
    frame : ndarray, shape (contacts, 3, 3)
        Normal, from the obstacle or other link to the link, e_x and e_y of every contact, in I.

    """
    count, links = contact_count(scene), make_capsules(scene.robot, q)
    gap, lever, frame = np.full(count, np.inf), np.zeros((count, 3)), np.zeros((count, 3, 3))
    wanted = np.ones(count, dtype=bool) if wanted is None else wanted
    _fill_ground_contacts(scene, links, wanted, gap, lever, frame)
    _fill_peg_contacts(scene, links, wanted, gap, lever, frame)
    _fill_pair_contacts(scene, links, wanted, gap, lever, frame)
    return gap, lever, frame


def _fill_ground_contacts(
    scene: Scene, links: Capsules, wanted: Array, gap: Array, lever: Array, frame: Array
) -> None:
    """Fill gaps, levers and frames of the contacts with the ground; see `contact_geometry`."""
    n, first = scene.robot.link_count, first_peg(scene)
    for i, (center, axis, offset, radius) in enumerate(zip(*links, strict=True)):
        for side, sign in enumerate((1, -1)):
            arm = sign * offset * axis
            slots = (
                side,
                *(2 + NEIGHBOR_SLOTS // 2 * side + k for k in range(NEIGHBOR_SLOTS // 2)),
            )
            if not any(wanted[slot * n + i] for slot in slots if slot * n < first):
                continue
            points = nearest_points(scene.ground, center + arm)
            for slot, point in zip(slots, points, strict=True):
                if point is None:
                    continue
                a = slot * n + i
                apart = center + arm - point
                distance = apart[2] if slot < 2 else np.linalg.norm(apart)
                normal = E_Z if slot < 2 else apart / distance
                gap[a] = distance - radius
                lever[a] = arm - radius * normal
                frame[a] = normal, *tangents(normal, axis)


def _fill_peg_contacts(
    scene: Scene, links: Capsules, wanted: Array, gap: Array, lever: Array, frame: Array
) -> None:
    """Fill gaps, levers and frames of the contacts with pegs; see `contact_geometry`."""
    n, first = scene.robot.link_count, first_peg(scene)
    for i, (center, axis, offset, radius) in enumerate(zip(*links, strict=True)):
        for k, (x, y, peg_radius) in enumerate(scene.pegs.axes):
            a = first + k * n + i
            if not wanted[a]:
                continue
            apart = np.array([x, y]) - center[:2]
            square = axis[:2] @ axis[:2]
            along = apart @ axis[:2] / square if square > 1e-12 else 0.0
            arm = min(max(along, -offset), offset) * axis
            apart = arm[:2] - apart
            normal = np.array([*apart, 0.0]) / np.linalg.norm(apart)
            gap[a] = np.linalg.norm(apart) - peg_radius - radius
            lever[a] = arm - radius * normal
            frame[a] = normal, cross(E_Z, normal), E_Z


def _fill_pair_contacts(
    scene: Scene, links: Capsules, wanted: Array, gap: Array, lever: Array, frame: Array
) -> None:
    """Fill gaps, levers and frames of the contacts of two links; see `contact_geometry`."""
    center, axis, offset, radius = links
    for a, (i, j, s, t) in enumerate(pair_contacts(scene), first_pair(scene)):
        if not wanted[a]:
            continue
        arm = s * offset[i] * axis[i]
        apart = center[i] + arm - center[j] - t * offset[j] * axis[j]
        distance = np.linalg.norm(apart)
        gap[a] = distance - radius[i] - radius[j]
        lever[a] = arm - radius[i] * apart / distance
        frame[a] = apart / distance, *tangents(apart / distance, axis[i])


def resting_height(ground: Ground, x: float, y: float, radius: float) -> float:
    """Return the height of the center of a sphere that rests on the ground at (x, y) [m]."""
    column, row = cell_at(ground, x, y)
    most = -np.inf
    for step in np.ndindex(3, 3):
        cell = np.array([column, row]) + step - 1
        corner = np.array(ground.origin) + ground.cell * cell
        apart = np.array([x, y]) - np.clip([x, y], corner, corner + ground.cell)
        inside = radius**2 - apart @ apart
        if inside >= 0.0:
            most = max(most, cell_height(ground, *cell) + math.sqrt(inside))
    return most


def lift_onto_ground(scene: Scene, q: Array) -> float:
    """Return how far up the robot must move to touch the ground without being inside [m]."""
    lifts = []
    for center, axis, offset, radius in zip(*make_capsules(scene.robot, q), strict=True):
        for arm in (offset, -offset):
            x, y, z = center + arm * axis
            lifts.append(resting_height(scene.ground, x, y, radius) - z)
    return float(max(lifts))

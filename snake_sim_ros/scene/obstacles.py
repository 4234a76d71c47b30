# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Everything a robot can touch besides a flat floor: ground of cells, and pegs; gaps and frames.

This is the definition in NumPy; `contact.detection` is its compiled form. The first contacts are
those of the spheres of the links with the ground below them, numbered as `chain.Spheres` says: of
Aiko the front and then the rear spheres, as in eq. (10). If the ground has cells, the spheres
follow three times more, for the higher cells beside them. In a scene with a world some follow for
each sphere, and then some for each capsule; what these touch only `contact.surroundings` finds.
Then come the capsules of the links once for every peg. Contacts of links with each other come
last: OF_PAIR of every two capsules of links that are not neighbors.

A sphere is in contact with the box below each cell, at the nearest point of the box. The cell
below its center always counts. A neighbor counts only if it is higher, so that a flat ground is
flat whatever its cells. A diagonal neighbor counts only if its nearest point is not on one of the
two other neighbors, so that a straight wall is straight.

A link is in contact with a peg as capsules, of Aiko the cylinder around its axis with the two
contact spheres as its ends, at the height of the nearest point of their axes.

Two capsules touch as balls around points of their axes: first both ends of the first one with the
nearest point of the second, then both ends of the second with the interior of the first, where
they are beside it, and last the interiors with each other, where the axes cross. On each other
side by side they thus have two contacts, as on a plane, and crosswise they have one.
"""

from collections import Counter
from functools import lru_cache
import math
from typing import Any

import numpy as np

from snake_sim_ros.scene.parameters import Array, Ground, Robot, Scene
from snake_sim_ros.scene.rotations import cross, rotation_matrices

CELLS = 4  # that a sphere may touch: below it, and its neighbors along x, along y, diagonal
# Contacts that a sphere, and the interior of a capsule, may have with the world at a time.
OF_SPHERE, OF_CAPSULE = 6, 4
OF_PAIR = 5  # contacts of two capsules: of the ends of the first, of the second, of interiors
PARALLEL = 1e-12  # square of the sine of an angle below which axes are parallel
E_X, E_Y, E_Z = np.eye(3)
UPRIGHT = 1e-6  # part of a unit vector along a link, in a plane, up to which it has no direction
STEEP = 0.7  # component of a normal along e_x from which on e_x is no direction in its plane
# How pictures show what has no end: the height of pegs, in contact radii, and how far boxes of the
# ground reach below the lowest of them [m].
PEG_HEIGHT, FOUNDATION = 4.0, 0.01


def is_flat(scene: Scene) -> bool:
    """
    Return whether there is nothing but the floor z = 0, with one ellipse of friction.

    Any other friction, also that of patches, needs the code for obstacles.
    """
    obstacles = scene.ground.heights or scene.pegs.x or scene.self_contact or scene.world
    if (scene.robot.chain.spheres.grip != 1.0).any():
        return False
    return not (obstacles or scene.patches.factors) and scene.friction.is_one_ellipse


def first_peg(scene: Scene) -> int:
    """Return the number of the first contact with a peg."""
    spheres, capsules = scene.robot.chain.spheres.link, scene.robot.chain.capsules.link
    if scene.world:
        return len(spheres) * (1 + OF_SPHERE) + len(capsules) * OF_CAPSULE
    return len(spheres) * (CELLS if scene.ground.heights else 1)


def first_pair(scene: Scene) -> int:
    """Return the number of the first contact of two links."""
    return first_peg(scene) + len(scene.robot.chain.capsules.link) * len(scene.pegs.x)


def capsule_pairs(scene: Scene) -> list[tuple[int, int]]:
    """Return the two capsules that touch in each OF_PAIR contacts of links with each other."""
    return _pairs(scene.robot) if scene.self_contact else []


@lru_cache(maxsize=16)
def _pairs(robot: Robot) -> list[tuple[int, int]]:
    """Return all pairs of capsules of links that are not neighbors."""
    link = robot.chain.capsules.link.tolist()
    return [(c, d) for c, i in enumerate(link) for d, j in enumerate(link) if j > i + 1]


def contact_count(scene: Scene) -> int:
    """Return the number of contacts, open and closed: 2n for Aiko on a flat floor."""
    return first_pair(scene) + OF_PAIR * len(capsule_pairs(scene))


def contact_keys(scene: Scene) -> list[tuple[Any, ...]]:
    """
    Return what touches what in every contact, by which contacts of different scenes are matched.

    Returns
    -------
    list of tuple
        ('floor', sphere); ('cell', which, sphere), without the ground it belongs to; ('world',
        number), without the world; ('peg', x, y, radius, number of equal pegs before it,
        capsule); ('pair', capsule, other capsule, which).

    """
    chain, cells = scene.robot.chain, CELLS if scene.ground.heights else 1
    spheres, capsules = range(len(chain.spheres.link)), range(len(chain.capsules.link))
    keys: list[tuple[Any, ...]] = [
        *(('floor', s) for s in spheres),
        *(('cell', k, s) for k in range(1, cells) for s in spheres),
    ]
    keys += [('world', a) for a in range(len(keys), first_peg(scene))]
    before: Counter[tuple[float, ...]] = Counter()
    for peg in map(tuple, scene.pegs.axes.tolist()):
        keys += [('peg', *peg, before[peg], c) for c in capsules]
        before[peg] += 1
    return keys + [('pair', *pair, k) for pair in capsule_pairs(scene) for k in range(OF_PAIR)]


def same_contacts(before: Scene, after: Scene) -> tuple[Array, Array]:
    """
    Return the numbers of the contacts that two scenes have in common, in each of them.

    Returns
    -------
    old, new : ndarray of int, shape (k,)
        Contact ``old[k]`` of the first scene is contact ``new[k]`` of the second one. Cells of
        different grounds or worlds are different; the spheres on the floor are the same.

    """
    number = {key: a for a, key in enumerate(contact_keys(before))}
    same = {'cell': before.ground == after.ground, 'world': before.world == after.world}
    common = [
        (number[key], a)
        for a, key in enumerate(contact_keys(after))
        if key in number and same.get(key[0], True)
    ]
    old, new = np.array(common, dtype=int).reshape(-1, 2).T
    return old, new


def contact_links(scene: Scene) -> Array:
    """Return the link of every contact and the one it touches, or -1, shape (contacts, 2)."""
    chain, pegs = scene.robot.chain, len(scene.pegs.x)
    link = np.concatenate([
        _of_ground(scene, chain.spheres.link, chain.capsules.link),
        np.tile(chain.capsules.link, pegs),
    ])  # fmt: skip
    of_world = np.column_stack([link, np.full(len(link), -1)])
    return np.concatenate([of_world, chain.capsules.link[_capsules_of_pairs(scene)]])


def contact_radii(scene: Scene) -> Array:
    """Return the radius of the sphere or capsule of every contact, shape (contacts,) [m]."""
    chain, pegs = scene.robot.chain, len(scene.pegs.x)
    radius = chain.capsules.radius
    return np.concatenate([
        _of_ground(scene, chain.spheres.radius, radius), np.tile(radius, pegs),
        radius[_capsules_of_pairs(scene)[:, 0]],
    ])  # fmt: skip


def _capsules_of_pairs(scene: Scene) -> Array:
    """Return both capsules of every contact of links with each other, shape (contacts, 2)."""
    return np.repeat(np.array(capsule_pairs(scene), dtype=int).reshape(-1, 2), OF_PAIR, axis=0)


def _of_ground(scene: Scene, spheres: Array, capsules: Array) -> Array:
    """Return a number of every contact with floor, cells and world, of its sphere or capsule."""
    if not scene.world:
        return np.tile(spheres, CELLS if scene.ground.heights else 1)
    of_world = np.repeat(spheres, OF_SPHERE), np.repeat(capsules, OF_CAPSULE)
    return np.concatenate([spheres, *of_world])


def contact_friction(scene: Scene, contacts: Array, q: Array) -> Array:
    """
    Return the coefficients of friction of some contacts, for link coordinates q (n, 7).

    Returns
    -------
    ndarray, shape (k, 5)
        mu along e_x of the contact frame, against sliding forward and backward; mu along e_y, and
        that of rolling; the factor of patches that is in them.

    """
    first, found = first_peg(scene), []
    spheres, center = scene.robot.chain.spheres, sphere_centers(scene.robot, q)
    for a in map(int, contacts):
        if a >= first:
            is_pair = a >= first_pair(scene)
            mu = scene.self_contact_friction if is_pair else scene.pegs.friction
            found.append((mu, mu, mu, 0.0, 1.0))
            continue
        s = _sphere_of(scene, a)
        found.append(floor_friction(scene, center[s, 0], center[s, 1], spheres.grip[s]))
    return np.array(found).reshape(-1, 5)


def _sphere_of(scene: Scene, a: int) -> int:
    """Return the sphere of a contact with ground or world; of a capsule, one of its link."""
    spheres, capsules = scene.robot.chain.spheres, scene.robot.chain.capsules
    m = len(spheres.link)
    if not scene.world or a < m:
        return a % m
    if a < m * (1 + OF_SPHERE):
        return (a - m) // OF_SPHERE
    c = (a - m * (1 + OF_SPHERE)) // OF_CAPSULE
    return int(spheres.of_link[spheres.begin[capsules.link[c]]])


def floor_friction(
    scene: Scene, x: float, y: float, own: float = 1.0
) -> tuple[float, float, float, float, float]:
    """
    Return the coefficients of the ground at (x, y) of I [m], as `contact_friction` does.

    `own` is the factor of the link.
    """
    patches, floor, factor = scene.patches, scene.friction, 1.0
    column = math.floor((x - patches.origin[0]) / patches.cell)
    row = math.floor((y - patches.origin[1]) / patches.cell)
    if 0 <= row < len(patches.factors) and 0 <= column < len(patches.factors[0]):
        factor = patches.factors[row][column]
    factor *= own
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
    if np.linalg.norm(e_x) <= UPRIGHT:
        axis = E_Y if abs(normal[0]) > STEEP else E_X
        e_x = axis - (axis @ normal) * normal
    e_x = e_x / np.linalg.norm(e_x)
    return e_x, cross(normal, e_x)


def sphere_centers(robot: Robot, q: Array) -> Array:
    """Return the centers of the spheres of a robot, shape (m, 3) [m, frame I]."""
    spheres, R = robot.chain.spheres, rotation_matrices(q[:, 3:])
    return np.asarray(
        q[spheres.link, :3] + np.einsum('aij,aj->ai', R[spheres.link], spheres.place)
    )


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
    count, axes = contact_count(scene), rotation_matrices(q[:, 3:])[:, :, 2]
    gap, lever, frame = np.full(count, np.inf), np.zeros((count, 3)), np.zeros((count, 3, 3))
    wanted = np.ones(count, dtype=bool) if wanted is None else wanted
    _fill_ground_contacts(scene, q, axes, wanted, gap, lever, frame)
    _fill_peg_contacts(scene, q, wanted, gap, lever, frame)
    _fill_pair_contacts(scene, q, axes, wanted, gap, lever, frame)
    return gap, lever, frame


def _fill_ground_contacts(
    scene: Scene, q: Array, axes: Array, wanted: Array, gap: Array, lever: Array, frame: Array
) -> None:
    """Fill gaps, levers and frames of the contacts with the ground; see `contact_geometry`."""
    spheres, centers = scene.robot.chain.spheres, sphere_centers(scene.robot, q)
    m, cells = len(centers), CELLS if scene.ground.heights else 1
    for s, center in enumerate(centers):
        if not wanted[s : cells * m : m].any():
            continue
        i, radius = spheres.link[s], spheres.radius[s]
        for k, point in enumerate(nearest_points(scene.ground, center)[:cells]):
            if point is None:
                continue
            a, apart = k * m + s, center - point
            distance = apart[2] if k == 0 else np.linalg.norm(apart)
            normal = E_Z if k == 0 else apart / distance
            gap[a] = distance - radius
            lever[a] = center - q[i, :3] - radius * normal
            frame[a] = normal, *tangents(normal, axes[i])


def _fill_peg_contacts(
    scene: Scene, q: Array, wanted: Array, gap: Array, lever: Array, frame: Array
) -> None:
    """Fill gaps, levers and frames of the contacts with pegs; see `contact_geometry`."""
    capsules, first = scene.robot.chain.capsules, first_peg(scene)
    R, count = rotation_matrices(q[:, 3:]), len(scene.robot.chain.capsules.link)
    for c, (i, middle, axis, half, radius) in enumerate(zip(*capsules, strict=True)):
        middle, axis = R[i] @ middle, R[i] @ axis
        for k, (x, y, peg_radius) in enumerate(scene.pegs.axes):
            a = first + k * count + c
            if not wanted[a]:
                continue
            apart = np.array([x, y]) - q[i, :2] - middle[:2]
            square = axis[:2] @ axis[:2]
            along = apart @ axis[:2] / square if square > 1e-12 else 0.0
            arm = min(max(along, -half), half) * axis
            apart = arm[:2] - apart
            normal = np.array([*apart, 0.0]) / np.linalg.norm(apart)
            gap[a] = np.linalg.norm(apart) - peg_radius - radius
            lever[a] = middle + arm - radius * normal
            frame[a] = normal, cross(E_Z, normal), E_Z


def _fill_pair_contacts(
    scene: Scene, q: Array, axes: Array, wanted: Array, gap: Array, lever: Array, frame: Array
) -> None:
    """Fill gaps, levers and frames of the contacts of two links; see `contact_geometry`."""
    link, center, along, half, radius = scene.robot.chain.capsules
    R, first = rotation_matrices(q[:, 3:]), first_pair(scene)
    middle = q[link, :3] + np.einsum('cij,cj->ci', R[link], center)
    along = np.einsum('cij,cj->ci', R[link], along)
    for p, (c, d) in enumerate(capsule_pairs(scene)):
        i, places = link[c], nearest_on_axes(middle[c] - middle[d], along[[c, d]], half[[c, d]])
        for a, place in enumerate(places, first + OF_PAIR * p):
            if place is None or not wanted[a]:
                continue
            s, t = place
            one, other = middle[c] + s * along[c], middle[d] + t * along[d]
            distance = np.linalg.norm(one - other)
            normal = (one - other) / distance
            gap[a] = distance - radius[c] - radius[d]
            lever[a] = one - q[i, :3] - radius[c] * normal
            frame[a] = normal, *tangents(normal, axes[i])


def nearest_on_axes(apart: Array, along: Array, half: Array) -> list[tuple[float, float] | None]:
    """
    Return where the axes of two capsules are near each other, for each of their contacts.

    Parameters
    ----------
    apart : ndarray, shape (3,)
        From the middle of the second axis to that of the first one [m].
    along : ndarray, shape (2, 3)
        Unit vectors along both.
    half : ndarray, shape (2,)
        Halves of their lengths [m], 0 for a sphere, which has one end.

    Returns
    -------
    list of (s, t) or None
        Places on both axes, from their middles [m]; None if there is no such contact.

    """
    places: list[tuple[float, float] | None] = []
    a, b, cosine = apart @ along[0], apart @ along[1], along[0] @ along[1]
    for k, s in enumerate((-half[0], half[0])):
        t = min(max(b + s * cosine, -half[1]), half[1])
        places.append((s, t) if k == 0 or half[0] > 0.0 else None)
    for k, t in enumerate((-half[1], half[1])):
        s = t * cosine - a
        places.append((s, t) if abs(s) < half[0] and (k == 0 or half[1] > 0.0) else None)
    sine = 1.0 - cosine**2
    s, t = ((cosine * b - a) / sine, (b - cosine * a) / sine) if sine > PARALLEL else half
    places.append((s, t) if abs(s) < half[0] and abs(t) < half[1] else None)
    return places


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
    spheres = scene.robot.chain.spheres
    places = zip(sphere_centers(scene.robot, q), spheres.radius, strict=True)
    return float(max(resting_height(scene.ground, x, y, r) - z for (x, y, z), r in places))

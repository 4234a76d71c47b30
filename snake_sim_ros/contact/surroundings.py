# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Contacts with the solids of a world: one for each feature that is really there.

A solid consists of convex pieces: a box, a pole, a triangle; only a pipe is not convex. A sphere
may touch each piece at its nearest point p. What it touches of all of them are the places where
the distance from their union is smallest nearby:

- A piece that contains p, and has a nearest point elsewhere, is nearer there: p is no such place.
  So an edge between two faces in one plane is none, nor one that lies on another solid.
- Two pieces with one nearest point, as the faces of an edge, make one contact.
- What is seen from behind, as the far side of a thin wall, makes none.

A capsule has the spheres at its ends and, between them, contacts with edges and corners of convex
solids, poles, and rims of pipes: where both nearest points are in the interior, and the normal is
in the normal cone of the edge or corner. The cone is as much wider as the axis may tilt until
another contact carries: a link that lies across a box, on two edges, keeps both. An edge that
continues in another solid is none. A sphere at the end of a capsule leaves edges to it where the
capsule is nearer.

The contacts of a sphere or capsule have a few numbers, in the order of their normals along a fixed
direction that is parallel to nothing. So a contact keeps its number, and a solver its first guess,
when it slides from one triangle to the next one. If there are more than numbers, those with the
smallest gaps count.
"""

from functools import lru_cache
import math
from typing import Any, NamedTuple

import numpy as np

from snake_sim_ros.contact.broad_phase import (
    ASIDE,
    find_near_axis,
    find_near_point,
    Grid,
    make_grid,
    own_scratch,
)
from snake_sim_ros.contact.shapes import (
    Axis,
    axis_meets_line,
    inner,
    LINE,
    minus,
    moved,
    Near,
    NEAREST,
    nearest_along_axis,
    nearest_on_box,
    nearest_on_pipe,
    nearest_on_segment,
    nearest_on_triangle,
    outer,
    PLANE,
    POINT,
    ROUGH,
    size_of,
    times,
    Triangles,
    triple,
    TUBE,
)
from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.dynamics.spatial_vectors import Three
from snake_sim_ros.scene.obstacles import contact_count, OF_CAPSULE, OF_SPHERE
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.world import Solids, solids_of, World

SAME = 1e-10  # distance up to which points are one, and up to which a point is on a piece [m]
NEARBY = 2e-4  # gap up to which contacts are numbered [m]
ASKED = 1e-2  # the same if a contact of the shape takes part in the step whatever its gap [m]
MOST = 64  # places that are looked at for one shape; of more, those with the smallest gaps
ORDER: Three = (0.3713906763541037, 0.5570860145311556, 0.7427813527082074)  # parallel to nothing
TILT = 1e-2  # by which the axis of a capsule may tilt until it lies on its other contact [rad]
SHARP = 1e-9  # part of a unit vector up to which it is in a cone
FLAT = 1e-6  # sine of the angle between faces up to which they have no edge
COPLANAR = 1e-9  # the same up to which a face continues another
BESIDE = 1e-6  # where it is looked whether an edge continues in another solid [m]
LEVEL = 1e-9  # difference of distances from a pipe that counts [m]
CROSSING = 0.05  # sine of an angle of axis and edge from which on they meet in one point


class Touched(NamedTuple):
    """What the contacts touch, and scratch: the only arrays of surroundings that a step fills."""

    kind: Array  # (contacts,) PLANE, LINE, POINT or TUBE, see `shapes`
    spot: Array  # (contacts, 3) a point of the plane or line, or the point [m, frame I]
    along: Array  # (contacts, 3) normal of the plane or direction of the line
    thickness: Array  # (contacts,) radius around line or point [m]
    solid: Array  # (contacts,) number of the solid
    places: Array  # (MOST, 12) distance, normal, direction, thickness, facing, nearest point
    items: Array  # (MOST, 4) piece or ridge, kind, solid, and whether it is a contact
    left_out: Array  # (1,) least distance of the places that the last search had no room for [m]
    overflows: Array  # (1,) whether such a place was one of a closed contact, see `detection`


class Surroundings(NamedTuple):
    """
    The solids of a world.

    Pieces are boxes, poles, pipes and triangles, in this order. Ridges are what the interior of a
    capsule may touch: edges, corners, poles and pipes.
    """

    box_center: Array  # (b, 3) [m]
    box_half: Array  # (b, 3) half of the sides [m]
    box_axes: Array  # (b, 3, 3) directions of the sides, in rows
    poles: Array  # (p, 8) start [m], direction, length [m], radius [m]
    pipes: Array  # (q, 9) start [m], direction, length, outer and inner radius [m]
    triangles: Triangles
    edges: Array  # (e, 4, 3) both ends [m], and into both faces, at right angles to the edge
    tips: Array  # (c, 3) corners of solids [m]
    tip_begin: Array  # (c+1,) where the edges of a corner begin
    tip_edges: Array  # (., 3) directions of edges from the corners
    solid: Array  # (pieces,) number of the solid of a piece
    ridge_solid: Array  # (ridges,) the same of a ridge
    grip: Array  # (solids,) factor of friction
    pieces: Grid
    ridges: Grid
    inward: Array  # (m, 3) from the spheres of the robot into their capsules, frame B; or 0
    capsule_grip: Array  # (c,) factor of friction of the link
    first: int  # number of the first contact with the world
    touched: Touched


# ---- making -------------------------------------------------------------------------------------


def make_surroundings(scene: Scene) -> Surroundings:
    """Return the world of a scene; it may have no solids."""
    spheres, capsules = scene.robot.chain.spheres, scene.robot.chain.capsules
    contacts = contact_count(scene)
    inward = np.zeros((len(spheres.link), 3))
    for s, place in enumerate(spheres.place):
        for c in np.flatnonzero(capsules.link == spheres.link[s]):
            for side in (-1.0, 1.0):
                end = capsules.center[c] + side * capsules.half[c] * capsules.axis[c]
                same = capsules.radius[c] == spheres.radius[s]
                if capsules.half[c] > 0.0 and same and np.allclose(end, place, atol=1e-12):
                    inward[s] = -side * capsules.axis[c]
    kinds = np.zeros(contacts, dtype=int)
    return Surroundings(
        **_arrays(scene.world),
        inward=inward,
        capsule_grip=spheres.grip[spheres.of_link[spheres.begin[capsules.link]]],
        first=len(spheres.link),
        touched=Touched(
            kind=kinds, spot=np.zeros((contacts, 3)), along=np.zeros((contacts, 3)),
            thickness=np.zeros(contacts), solid=kinds.copy(), places=np.zeros((MOST, 12)),
            items=np.zeros((MOST, 4), dtype=int), left_out=np.full(1, np.inf),
            overflows=np.zeros(1, dtype=int),
        ),
    )  # fmt: skip


def _arrays(world: World) -> dict[str, Any]:
    """Return the fields of surroundings that belong to a world, with scratch of their own."""
    arrays = dict(_shared_arrays(world))
    for name in ('pieces', 'ridges'):
        arrays[name] = own_scratch(arrays[name])
    return arrays


@lru_cache(maxsize=8)
def _shared_arrays(world: World) -> dict[str, Any]:
    """Return the fields of surroundings that belong to a world."""
    solids = solids_of(world)
    boxes, poles, pipes = len(solids.box_center), len(solids.poles), len(solids.pipes)
    faces = [mesh.faces for mesh in solids.meshes]
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in solids.meshes)])
    shifted = [face + start for face, start in zip(faces, starts[:-1], strict=True)]
    corners = np.concatenate([*shifted, np.zeros((0, 3), dtype=int)])
    vertices = np.concatenate([*(mesh.vertices for mesh in solids.meshes), np.zeros((0, 3))])
    counts = [len(face) for face in faces]
    first_mesh = boxes + poles + pipes
    of_faces = np.repeat(first_mesh + np.arange(len(faces)), counts)
    a, b, c = (vertices[corners[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    triangles = Triangles(vertices, _mean_normals(vertices, corners, normals), corners, normals)
    (edges, edge_solid, tips, tip_edges, tip_solid), goes_on = _ridges(solids, triangles, of_faces)
    pole_rows, pipe_rows = _axes(solids.poles), _axes(solids.pipes)
    box_reach = np.einsum('bj,bjk->bk', solids.box_half, np.abs(solids.box_axes))
    bars = np.concatenate([solids.poles[:, :7], solids.pipes[:, :7]])
    bar_bounds = np.column_stack([
        np.minimum(bars[:, :3], bars[:, 3:6]) - bars[:, 6:],
        np.maximum(bars[:, :3], bars[:, 3:6]) + bars[:, 6:],
    ])  # fmt: skip
    piece_bounds = np.concatenate([
        np.column_stack([solids.box_center - box_reach, solids.box_center + box_reach]),
        bar_bounds,
        np.column_stack([np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)]),
    ])  # fmt: skip
    ridge_bounds = np.concatenate([
        np.column_stack([edges[:, :2].min(axis=1), edges[:, :2].max(axis=1)]),
        np.column_stack([tips, tips]),
        bar_bounds,
    ])  # fmt: skip
    bar_solid = boxes + np.arange(poles + pipes)
    return {
        'box_center': solids.box_center,
        'box_half': solids.box_half,
        'box_axes': solids.box_axes,
        'poles': pole_rows,
        'pipes': pipe_rows,
        'triangles': triangles,
        'edges': edges,
        'tips': tips,
        'tip_begin': np.concatenate([[0], np.cumsum([len(each) for each in tip_edges])]).astype(
            int
        ),
        'tip_edges': np.concatenate([*tip_edges, np.zeros((0, 3))]),
        'solid': np.concatenate([np.arange(boxes), bar_solid, of_faces]).astype(int),
        'ridge_solid': np.concatenate([edge_solid, tip_solid, bar_solid]).astype(int),
        'grip': np.concatenate([
            solids.box_grip, solids.poles[:, -1], solids.pipes[:, -1],
            [mesh.grip for mesh in solids.meshes],
        ]),
        'pieces': make_grid(piece_bounds, np.concatenate([np.zeros(first_mesh, bool), goes_on])),
        'ridges': make_grid(ridge_bounds),
    }  # fmt: skip


def _mean_normals(vertices: Array, corners: Array, normals: Array) -> Array:
    """Return the outward unit vectors at vertices, see `shapes.nearest_on_triangle`."""
    total = np.zeros(vertices.shape)
    for k in range(3):
        here, after, before = (vertices[corners[:, (k + j) % 3]] for j in range(3))
        one, other = after - here, before - here
        lengths = np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)
        angle = np.arccos(np.clip((one * other).sum(axis=1) / lengths, -1.0, 1.0))
        np.add.at(total, corners[:, k], angle[:, None] * normals)
    size = np.linalg.norm(total, axis=1, keepdims=True)
    return np.divide(total, size, out=total, where=size > 0.0)


def _axes(bars: Array) -> Array:
    """Return start, direction, length and radii of bars that are given by both ends."""
    way = bars[:, 3:6] - bars[:, :3]
    length = np.linalg.norm(way, axis=1, keepdims=True)
    return np.column_stack([bars[:, :3], way / length, length, bars[:, 6:-1]])


def _ridges(
    solids: Solids, triangles: Triangles, of_faces: Array
) -> tuple[tuple[Array, Array, Array, list[Array], Array], Array]:
    """
    Return edges and their solids, corners, the edges at each, and their solids; and `goes_on`.

    That is as of `broad_phase.make_grid`.
    """
    edges, edge_solid, tips, tip_edges, tip_solid = [np.zeros((0, 4, 3))], [], [], [], []
    goes_on = np.zeros(0, dtype=bool)
    signs = np.array([(i, j) for i in (-1.0, 1.0) for j in (-1.0, 1.0)])
    for k, (center, half, axes) in enumerate(
        zip(solids.box_center, solids.box_half, solids.box_axes, strict=True)
    ):
        for j in range(3):
            (u, v), others = (axes[(j + 1) % 3], axes[(j + 2) % 3]), [(j + 1) % 3, (j + 2) % 3]
            for one, other in signs:
                middle = center + one * half[others[0]] * u + other * half[others[1]] * v
                ends = middle - half[j] * axes[j], middle + half[j] * axes[j]
                edges.append(np.array([[*ends, -one * u, -other * v]]))
                edge_solid.append(k)
        for side in np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T:
            tips.append(center + (side * half) @ axes)
            tip_edges.append(-side[:, None] * axes)
            tip_solid.append(k)
    if len(triangles.corners):
        found, goes_on = _ridges_of_triangles(triangles)
        edges.append(found[0])
        edge_solid += of_faces[found[1]].tolist()
        tips += list(triangles.vertices[found[2]])
        tip_edges += found[3]
        tip_solid += of_faces[found[4]].tolist()
    ridges = (
        np.ascontiguousarray(np.concatenate(edges)), np.array(edge_solid, dtype=int),
        np.array(tips).reshape(-1, 3), tip_edges, np.array(tip_solid, dtype=int),
    )  # fmt: skip
    return ridges, goes_on


def _ridges_of_triangles(
    triangles: Triangles,
) -> tuple[tuple[Array, Array, Array, list[Array], Array], Array]:
    """
    Return the convex edges and pointed corners of triangles, and which triangles go on.

    Returns
    -------
    edges : ndarray, shape (e, 4, 3)
    face : ndarray of int, shape (e,)
        A triangle of each.
    tips : ndarray of int, shape (c,)
        Vertices where three convex edges meet or more.
    tip_edges : list of ndarray, shape (., 3)
        Directions of all edges from there.
    tip_face : ndarray of int, shape (c,)
    goes_on : ndarray of bool, shape (t,)
        Those whose plane is continued by others on all sides, at edges and corners.

    """
    vertices, _, corners, normals = triangles
    ends = np.concatenate([corners[:, [k, (k + 1) % 3]] for k in range(3)])
    opposite = np.concatenate([corners[:, (k + 2) % 3] for k in range(3)])
    face = np.tile(np.arange(len(corners)), 3)
    ends.sort(axis=1)
    order = np.lexsort(ends.T)
    ends, opposite, face = ends[order], opposite[order], face[order]
    is_first = np.concatenate([[True], (ends[1:] != ends[:-1]).any(axis=1)])
    one = np.flatnonzero(is_first)
    count = np.diff(np.concatenate([one, [len(ends)]]))
    other = np.where(count > 1, np.minimum(one + 1, len(ends) - 1), one)
    a, b = vertices[ends[one, 0]], vertices[ends[one, 1]]
    along = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
    into = []
    for side in (one, other):
        way = vertices[opposite[side]] - a
        way -= (way * along).sum(axis=1, keepdims=True) * along
        into.append(way / np.linalg.norm(way, axis=1, keepdims=True))
    bend = (normals[face[one]] * into[1]).sum(axis=1)
    bends = bend < -FLAT
    folds = (normals[face[one]] * normals[face[other]]).sum(axis=1) < 0.0
    ends_plane = np.zeros(len(vertices), dtype=bool)
    ends_plane[ends[one[(np.abs(bend) > COPLANAR) | folds | (count != 2)]]] = True
    goes_on = np.logical_not(ends_plane[corners].any(axis=1))
    convex = np.flatnonzero(bends | (count == 1))
    edges = np.stack([a, b, *into], axis=1)[convex]
    meeting = np.bincount(ends[one[convex]].ravel(), minlength=len(vertices))
    tips = np.flatnonzero(meeting >= 3)
    from_all = np.concatenate([ends[one, 0], ends[one, 1]])
    directions = np.concatenate([along, -along])
    faces = np.concatenate([face[one], face[one]])
    order = np.argsort(from_all, kind='stable')
    from_all, directions, faces = from_all[order], directions[order], faces[order]
    begin, end = np.searchsorted(from_all, tips), np.searchsorted(from_all, tips, side='right')
    at = [directions[i:j] for i, j in zip(begin, end, strict=True)]
    return (edges, face[one[convex]], tips, at, faces[begin]), goes_on


@inlined
def has_any(world: Surroundings) -> bool:
    """Return whether there are solids."""
    return len(world.grip) > 0


# ---- spheres ------------------------------------------------------------------------------------


@compiled
def nearest_on_piece(world: Surroundings, item: int, c: Three) -> Near:
    """Return the nearest point of a piece."""
    boxes, poles, pipes = len(world.box_center), len(world.poles), len(world.pipes)
    if item < boxes:
        return nearest_on_box(world.box_center, world.box_half, world.box_axes, item, c)
    item -= boxes
    if item < poles:
        row = world.poles[item]
        return nearest_on_segment(
            (row[0], row[1], row[2]), (row[3], row[4], row[5]), row[6], row[7], c
        )
    item -= poles
    if item < pipes:
        row = world.pipes[item]
        return nearest_on_pipe(
            (row[0], row[1], row[2]), (row[3], row[4], row[5]), row[6], (row[7], row[8]), c
        )
    item -= pipes
    return nearest_on_triangle(world.triangles, item, c)


@inlined
def is_pipe(world: Surroundings, item: int) -> bool:
    """Return whether a piece is a pipe, the only one that is not convex."""
    first = len(world.box_center) + len(world.poles)
    return first <= item < first + len(world.pipes)


@inlined
def is_triangle(world: Surroundings, item: int) -> bool:
    """Return whether a piece is a triangle."""
    return item >= len(world.box_center) + len(world.poles) + len(world.pipes)


@inlined
def note_place(touched: Touched, count: int, c: Three, near: Near, item: int, solid: int) -> int:
    """Note where a shape may touch a piece, beside `count` places before; count them."""
    places, items, k = touched.places, touched.items, count
    if count == MOST:
        for m in range(MOST):
            if k == MOST or places[m, 0] > places[k, 0]:
                k = m
        leave_out(touched, max(places[k, 0], near.distance))
        if places[k, 0] <= near.distance:
            return count
    point = moved(c, -near.distance, near.normal)
    places[k, 0] = near.distance
    for j in range(3):
        places[k, 1 + j] = near.normal[j]
        places[k, 4 + j] = near.along[j]
        places[k, 9 + j] = point[j]
    places[k, 7], places[k, 8] = near.thickness, near.facing
    items[k, 0], items[k, 1], items[k, 2], items[k, 3] = item, near.kind, solid, 1
    return count + 1 if k == count else count


@inlined
def leave_out(touched: Touched, distance: float) -> None:
    """Note that a search has no room for a place at a distance [m]."""
    touched.left_out[0] = min(touched.left_out[0], distance)


@inlined
def part_of(row: Array, begin: int) -> Three:
    """Return three numbers of a row, from `begin` on."""
    return row[begin], row[begin + 1], row[begin + 2]


@inlined
def is_better(world: Surroundings, a: int, b: int) -> bool:
    """Return whether of two places with one point it is a that makes the contact, not b."""
    places, items = world.touched.places, world.touched.items
    if items[a, 1] != items[b, 1]:
        return bool(items[a, 1] < items[b, 1])
    if items[a, 2] == items[b, 2] and abs(places[a, 8]) != abs(places[b, 8]):
        return bool(abs(places[a, 8]) > abs(places[b, 8]))
    return a < b


@inlined
def is_no_contact(world: Surroundings, count: int, a: int, c: Three) -> bool:
    """Return whether place a, of `count`, is nowhere where the distance of c is smallest."""
    places, items = world.touched.places, world.touched.items
    point = part_of(places[a], 9)
    if point[2] <= SAME:
        dx, dy, dz = c[0] - point[0], c[1] - point[1], point[2]
        if dx * dx + dy * dy + dz * dz > SAME * SAME:
            return True
    for b in range(count):
        if b == a:
            continue
        apart = size_of(minus(point, part_of(places[b], 9)))
        if apart <= SAME:
            if is_better(world, b, a):
                return True
            continue
        if places[b, 0] - places[a, 0] > SAME:
            continue
        depth = -SAME if is_pipe(world, items[b, 0]) else SAME
        if nearest_on_piece(world, items[b, 0], point).distance <= depth:
            return True
    return False


@inlined
def is_from_behind(world: Surroundings, count: int, a: int) -> bool:
    """Return whether place a is seen from behind, and not from inside of its solid."""
    places, items = world.touched.places, world.touched.items
    if places[a, 8] >= 0.0:
        return False
    for b in range(count):
        if items[b, 2] == items[a, 2] and places[b, 0] < places[a, 0] - SAME:
            return True
    return False


@inlined
def is_of_capsule(world: Surroundings, a: int, inward: Three) -> bool:
    """Return whether the capsule of a sphere, which lies inward, is nearer to place a."""
    places, kind = world.touched.places, world.touched.items[a, 1]
    if not (kind == LINE or kind == POINT):
        return False
    if inner(part_of(places[a], 1), inward) >= -SHARP:
        return False
    cosine = inner(part_of(places[a], 4), inward)
    return kind == POINT or 1.0 - cosine * cosine > CROSSING * CROSSING


@inlined
def hides_floor(world: Surroundings, count: int, c: Three) -> bool:
    """Return whether the floor below a point is inside one of `count` pieces, or on it."""
    below, hides = (c[0], c[1], 0.0), False
    for a in range(count):
        if world.touched.places[a, 0] <= c[2] + SAME:
            item = world.touched.items[a, 0]
            hides = hides or nearest_on_piece(world, item, below).distance <= SAME
    return hides


@compiled
def find_places_of_sphere(
    world: Surroundings, c: Three, radius: float, reach: float, inward: Three
) -> tuple[int, bool]:
    """
    Find where a sphere may touch the world with gaps up to `reach` [m].

    Returns
    -------
    count : int
        Number of places; those with ``items[:, 3] == 1`` are contacts.
    hides : bool
        Whether the floor below the sphere is inside a solid.

    """
    touched, count = world.touched, 0
    touched.left_out[0] = math.inf
    found, is_level = find_near_point(world.pieces, c, radius + reach)
    for k in range(found):
        item = world.pieces.found[k]
        near = nearest_on_piece(world, item, c)
        if near.distance <= radius + reach and not (is_level and is_aside(near)):
            count = note_place(touched, count, c, near, item, world.solid[item])
    hides = hides_floor(world, count, c)
    for a in range(count):
        if (
            is_no_contact(world, count, a, c)
            or is_from_behind(world, count, a)
            or is_of_capsule(world, a, inward)
        ):
            touched.items[a, 3] = 0
    for a in range(count):
        if touched.items[a, 3] == 1 and touched.places[a, 8] < 0.0:  # from inside of a solid
            touched.places[a, 0] *= -1.0
            for j in range(1, 4):
                touched.places[a, j] *= -1.0
    return count, hides


@inlined
def is_aside(near: Near) -> bool:
    """Return whether a point is clearly beside the nearest one, seen from above."""
    x, y, _ = times(near.distance, near.normal)
    return x * x + y * y > ASIDE * ASIDE


@inlined
def depth_of_sphere(world: Surroundings, c: Three, radius: float) -> float:
    """Return how deep a sphere is in the world [m], 0 if it is beside."""
    deepest, nearest, facing = 0.0, math.inf, 1.0
    found, _ = find_near_point(world.pieces, c, radius)
    for k in range(found):
        item = world.pieces.found[k]
        near = nearest_on_piece(world, item, c)
        if not is_triangle(world, item):
            deepest = max(deepest, radius - near.distance)
        elif near.distance < nearest - SAME or (
            near.distance < nearest + SAME and abs(near.facing) > abs(facing)
        ):
            nearest, facing = near.distance, near.facing
    if nearest > radius:  # of triangles that are farther, only some are found
        return deepest
    return max(deepest, radius - nearest if facing >= 0.0 else radius + nearest)


# ---- capsules -----------------------------------------------------------------------------------


@inlined
def is_in_cone(n: Three, edge: Three, along: Three) -> bool:
    """Return whether a normal looks away from an edge or face, if an axis may tilt by TILT."""
    return inner(n, edge) <= TILT * abs(inner(edge, along)) + SHARP


@inlined
def edge_of(world: Surroundings, item: int) -> tuple[Three, Three, float]:
    """Return start, direction and length of an edge."""
    start, end = triple(world.edges[item], 0), triple(world.edges[item], 1)
    way = minus(end, start)
    length = size_of(way)
    return start, times(1.0 / length, way), length


@inlined
def near_edge(world: Surroundings, item: int, axis: Axis) -> tuple[float, Near]:
    """Return where the interior of an axis is nearest to an edge, from its middle, and how."""
    start, along, length = edge_of(world, item)
    s, t = axis_meets_line(axis, start, along)
    nothing = Near(math.inf, axis.along, LINE, along, 0.0, 1.0)
    if not (abs(s) < axis.half and -SAME <= t <= length + SAME):
        return math.inf, nothing
    way = minus(moved(axis.middle, s, axis.along), moved(start, t, along))
    distance = size_of(way)
    if distance < NEAREST:
        return math.inf, nothing
    return s, Near(distance, times(1.0 / distance, way), LINE, along, 0.0, 1.0)


@inlined
def near_tip(world: Surroundings, k: int, axis: Axis) -> tuple[float, Near]:
    """Return the same for a corner."""
    tip = triple(world.tips, k)
    s = inner(minus(tip, axis.middle), axis.along)
    nothing = Near(math.inf, axis.along, POINT, axis.along, 0.0, 1.0)
    if not abs(s) < axis.half:
        return math.inf, nothing
    way = minus(moved(axis.middle, s, axis.along), tip)
    distance = size_of(way)
    if distance < NEAREST:
        return math.inf, nothing
    return s, Near(distance, times(1.0 / distance, way), POINT, axis.along, 0.0, 1.0)


@inlined
def near_pole(world: Surroundings, k: int, axis: Axis) -> tuple[float, Near]:
    """Return the same for a pole."""
    row = world.poles[k]
    start, along, length = (row[0], row[1], row[2]), (row[3], row[4], row[5]), row[6]
    s, t = axis_meets_line(axis, start, along)
    if math.isfinite(s) and not 0.0 <= t <= length:
        end = moved(start, min(max(t, 0.0), length), along)
        s = inner(minus(end, axis.middle), axis.along)
    if not abs(s) < axis.half:
        return math.inf, Near(math.inf, axis.along, LINE, along, 0.0, 1.0)
    return s, nearest_on_segment(start, along, length, row[7], moved(axis.middle, s, axis.along))


@compiled
def continues(world: Surroundings, p: Three, solid: int) -> bool:
    """Return whether a point is in or on the floor or a solid other than a given one."""
    if p[2] <= SAME:
        return True
    found, _ = find_near_point(world.pieces, p, SAME)
    for k in range(found):
        item = world.pieces.found[k]
        if world.solid[item] != solid and nearest_on_piece(world, item, p).distance <= SAME:
            return True
    return False


@inlined
def is_edge_of_union(world: Surroundings, item: int, n: Three, p: Three, along: Three) -> bool:
    """Return whether an edge touches at p with a normal n, and continues in no other solid."""
    for j in range(2, 4):
        into = triple(world.edges[item], j)
        if not is_in_cone(n, into, along):
            return False
        if continues(world, moved(p, -BESIDE, into), world.ridge_solid[item]):
            return False
    return True


@inlined
def is_tip_of_union(world: Surroundings, k: int, n: Three, along: Three) -> bool:
    """Return the same for corner k."""
    p, solid = triple(world.tips, k), world.ridge_solid[len(world.edges) + k]
    for j in range(world.tip_begin[k], world.tip_begin[k + 1]):
        if not is_in_cone(n, triple(world.tip_edges, j), along):
            return False
    for j in range(world.tip_begin[k], world.tip_begin[k + 1]):
        if continues(world, moved(p, -BESIDE, triple(world.tip_edges, j)), solid):
            return False
    return True


@compiled
def find_places_of_axis(world: Surroundings, axis: Axis, radius: float, reach: float) -> int:
    """
    Find where the interior of a capsule may touch the world with gaps up to `reach` [m].

    Return the number of places; those with ``items[:, 3] == 1`` are contacts.
    """
    touched, count, most = world.touched, 0, radius + reach
    touched.left_out[0] = math.inf
    edges, tips = len(world.edges), len(world.edges) + len(world.tips)
    pipes = tips + len(world.poles)
    for k in range(find_near_axis(world.ridges, axis, most)):
        item = world.ridges.found[k]
        if item >= pipes:
            count = find_places_at_pipe(world, item - pipes, axis, most, count)
            continue
        if item < edges:
            s, near = near_edge(world, item, axis)
        elif item < tips:
            s, near = near_tip(world, item - edges, axis)
        else:
            s, near = near_pole(world, item - tips, axis)
        if not near.distance <= most:
            continue
        x = moved(axis.middle, s, axis.along)
        p = moved(x, -near.distance, near.normal)
        if item < edges:
            touches = is_edge_of_union(world, item, near.normal, p, axis.along)
        elif item < tips:
            touches = is_tip_of_union(world, item - edges, near.normal, axis.along)
        else:
            touches = p[2] > SAME
        if touches:
            count = note_place(touched, count, x, near, item, world.ridge_solid[item])
    for a in range(count):
        for b in range(a):
            same = (
                size_of(minus(part_of(touched.places[a], 9), part_of(touched.places[b], 9)))
                <= 2.0 * SAME
            )
            if same and touched.items[b, 3] == 1:
                touched.items[a, 3] = 0
    return count


@inlined
def is_lowest(before: float, here: float, after: float) -> bool:
    """Return whether a distance is below its neighbors, of which one may be infinite."""
    falls = math.isfinite(before) and before - here > LEVEL
    rises = math.isfinite(after) and after - here > LEVEL
    return here <= before and here <= after and (falls or rises)


@compiled
def find_places_at_pipe(world: Surroundings, k: int, axis: Axis, most: float, count: int) -> int:
    """Find where the interior of an axis touches a pipe up to a distance `most` [m]; count."""
    row, half = world.pipes[k], axis.half
    start, along, length = (row[0], row[1], row[2]), (row[3], row[4], row[5]), row[6]
    radii = row[7], row[8]
    solid = len(world.box_center) + len(world.poles) + k
    before = math.inf
    here = nearest_on_pipe(start, along, length, radii, moved(axis.middle, -half, axis.along))
    for m in range(ROUGH if half > 0.0 else 0):
        after = math.inf
        following = here
        if m < ROUGH - 1:
            s = -half + (m + 1) * 2.0 * half / (ROUGH - 1)
            following = nearest_on_pipe(
                start, along, length, radii, moved(axis.middle, s, axis.along)
            )
            after = following.distance
        if is_lowest(before, here.distance, after):
            s = nearest_along_axis(start, along, length, radii, axis, m)
            if abs(s) < half * (1.0 - 1e-6):
                x = moved(axis.middle, s, axis.along)
                near = nearest_on_pipe(start, along, length, radii, x)
                if near.kind == LINE and near.distance <= most:
                    count = note_place(world.touched, count, x, near, -1 - k, solid)
        before, here = here.distance, following
    return count


@compiled
def depth_of_axis(world: Surroundings, axis: Axis, radius: float) -> float:
    """Return how deep the interior of a capsule is in edges, corners and bars [m]."""
    deepest = 0.0
    edges, tips = len(world.edges), len(world.edges) + len(world.tips)
    pipes = tips + len(world.poles)
    for k in range(find_near_axis(world.ridges, axis, radius)):
        item = world.ridges.found[k]
        if item < edges:
            _, near = near_edge(world, item, axis)
        elif item < tips:
            _, near = near_tip(world, item - edges, axis)
        elif item < pipes:
            _, near = near_pole(world, item - tips, axis)
        else:
            count = find_places_at_pipe(world, item - pipes, axis, radius, 0)
            for a in range(count):
                deepest = max(deepest, radius - world.touched.places[a, 0])
            continue
        deepest = max(deepest, radius - near.distance)
    return deepest


# ---- contacts -----------------------------------------------------------------------------------


@inlined
def number_places(touched: Touched, count: int, slots: int) -> int:
    """
    Move the contacts among `count` places to the front, in the order of their numbers.

    Return how many they are, at most `slots`: those with the smallest distances.
    """
    places, items, kept = touched.places, touched.items, 0
    for a in range(count):
        if items[a, 3] == 1:
            swap_places(touched, a, kept)
            kept += 1
    while kept > slots:
        furthest = 0
        for a in range(1, kept):
            if places[a, 0] > places[furthest, 0]:
                furthest = a
        kept -= 1
        leave_out(touched, places[furthest, 0])
        swap_places(touched, furthest, kept)
    for a in range(1, kept):
        b = a
        while b > 0 and key_of(places, b) < key_of(places, b - 1):
            swap_places(touched, b, b - 1)
            b -= 1
    return kept


@inlined
def key_of(places: Array, a: int) -> float:
    """Return by what places are ordered."""
    return inner(part_of(places[a], 1), ORDER)


@inlined
def swap_places(touched: Touched, a: int, b: int) -> None:
    """Let two places change places."""
    for j in range(12):
        kept = touched.places[a, j]
        touched.places[a, j] = touched.places[b, j]
        touched.places[b, j] = kept
    for j in range(4):
        number = touched.items[a, j]
        touched.items[a, j] = touched.items[b, j]
        touched.items[b, j] = number


@inlined
def remember_what(touched: Touched, place: int, a: int, center: Three) -> None:
    """Note what contact a touches, at a place; `center` is that of the sphere or on the axis."""
    row, kind = touched.places[place], touched.items[place, 1]
    normal, distance, thickness = part_of(row, 1), row[0], row[7]
    back = distance - thickness if kind == TUBE else distance + thickness
    spot = moved(center, -back, normal)
    for j in range(3):
        touched.spot[a, j] = spot[j]
        touched.along[a, j] = normal[j] if kind == PLANE else row[4 + j]
    touched.kind[a], touched.thickness[a] = kind, thickness
    touched.solid[a] = touched.items[place, 2]


@inlined
def distance_of_sphere(touched: Touched, a: int, c: Three) -> float:
    """
    Return the distance of a point from what contact a touched when it was found [m].

    That is continued beyond the ends of a face or edge: these are of second order in the way.
    """
    apart, kind = minus(c, triple(touched.spot, a)), touched.kind[a]
    along = triple(touched.along, a)
    if kind == PLANE:
        return inner(apart, along)
    if kind == POINT:
        return size_of(apart) - touched.thickness[a]
    rho = size_of(moved(apart, -inner(apart, along), along))
    return touched.thickness[a] - rho if kind == TUBE else rho - touched.thickness[a]


@inlined
def distance_of_axis(touched: Touched, a: int, middle: Three, along: Three) -> float:
    """Return the distance of an axis from what contact a touched when it was found [m]."""
    apart = minus(middle, triple(touched.spot, a))
    n = outer(along, triple(touched.along, a))
    if touched.kind[a] == POINT or inner(n, n) < CROSSING * CROSSING:
        radial = moved(apart, -inner(apart, along), along)
        return size_of(radial) - touched.thickness[a]
    return abs(inner(apart, n)) / size_of(n) - touched.thickness[a]


@inlined
def first_of_sphere(world: Surroundings, s: int) -> int:
    """Return the number of the first contact of sphere s with the world."""
    return world.first + s * OF_SPHERE


@inlined
def first_of_capsule(world: Surroundings, c: int) -> int:
    """Return the number of the first contact of the interior of capsule c with the world."""
    return world.first + len(world.inward) * OF_SPHERE + c * OF_CAPSULE


@inlined
def is_asked(takes_part: Array, first: int, slots: int) -> bool:
    """Return whether one of some contacts takes part whatever its gap."""
    asked = False
    for a in range(first, first + slots):
        asked = asked or takes_part[a] == 1
    return asked

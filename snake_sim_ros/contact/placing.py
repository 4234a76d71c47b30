# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where a robot is in a world, from Python: how deep, how far up it must move, what it touches."""

import numpy as np

from snake_sim_ros.contact.detection import axis_of_capsule, fill_contact_frame, world_penetration
from snake_sim_ros.contact.shapes import Axis, minus, moved, triple
from snake_sim_ros.contact.surroundings import (
    depth_of_sphere,
    find_places_of_axis,
    find_places_of_sphere,
    first_of_capsule,
    first_of_sphere,
    make_surroundings,
    NEARBY,
    number_places,
    part_of,
    Surroundings,
)
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.kinematics import carried_in
from snake_sim_ros.dynamics.records import entry
from snake_sim_ros.scene.chain import Capsules, Spheres
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.obstacles import contact_count, OF_CAPSULE, OF_SPHERE, sphere_centers
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.scene.world import solids_of, Triangles

TOUCHING = 1e-10  # depth up to which a robot is beside a solid [m]
LEAST_LIFT = 1e-8  # [m]
MOST_LIFTS = 20_000
BESIDE = 1.3e-7, 2.1e-7  # moves points so that edges and corners are above none of them [m]


@entry
def depth_of_robot(world: Surroundings, spheres: Spheres, capsules: Capsules, q: Array) -> float:
    """Return how deep a robot is in a world [m], 0 if it is beside; q has the shape (n, 7)."""
    return world_penetration(world, spheres, capsules, q)


@entry
def is_pierced(world: Surroundings, capsules: Capsules, q: Array) -> bool:
    """
    Return whether a piece of a world goes through the axis of a capsule; q has the shape (n, 7).

    Such a piece, as a thin wall between both ends, is less than half a radius from one of some
    points of the axis that are at most a radius apart.
    """
    for k in range(len(capsules.link)):
        radius, half = capsules.radius[k], capsules.half[k]
        middle, along, _ = axis_of_capsule(capsules, q, k)
        parts = int(2.0 * half / radius) + 1
        for m in range(parts + 1):
            point = moved(middle, (2.0 * m / parts - 1.0) * half, along)
            if depth_of_sphere(world, point, 0.5 * radius) > 0.0:
                return True
    return False


@entry
def fill_world_geometry(
    world: Surroundings,
    shapes: tuple[Spheres, Capsules],
    q: Array,
    R: Array,
    gap: Array,
    touching: tuple[Array, Array, Array],
) -> None:
    """
    Fill gaps, levers, frames and factors of friction of all contacts with a world that are near.

    Parameters
    ----------
    world : Surroundings
    shapes : tuple
        Spheres and capsules of the robot.
    q, R : ndarray, shapes (n, 7), (n, 3, 3)
        Link coordinates, and link frames in I.
    gap, touching : ndarray
        As `obstacles.contact_geometry` returns them, with the grip of the solids, shape
        (contacts,), behind; those of contacts with the world are filled.

    """
    spheres, capsules = shapes
    for s in range(len(spheres.link)):
        i, first = spheres.link[s], first_of_sphere(world, s)
        c = moved(triple(q, i), 1.0, carried_in(R, i, spheres.place, s))
        inward = carried_in(R, i, world.inward, s)
        count, _ = find_places_of_sphere(world, c, spheres.radius[s], NEARBY, inward)
        count = number_places(world.touched, count, OF_SPHERE)
        fill_geometry(world, (i, count, first), spheres.radius[s], q, R, (gap, touching))
    for k in range(len(capsules.link)):
        i, first = capsules.link[k], first_of_capsule(world, k)
        middle = moved(triple(q, i), 1.0, carried_in(R, i, capsules.center, k))
        axis = Axis(middle, carried_in(R, i, capsules.axis, k), capsules.half[k])
        count = find_places_of_axis(world, axis, capsules.radius[k], NEARBY)
        count = number_places(world.touched, count, OF_CAPSULE)
        fill_geometry(world, (i, count, first), capsules.radius[k], q, R, (gap, touching))


@compiled
def fill_geometry(
    world: Surroundings,
    which: tuple[int, int, int],
    radius: float,
    q: Array,
    R: Array,
    filled: tuple[Array, tuple[Array, Array, Array]],
) -> None:
    """Fill the contacts of a link at some places, the first of which has a number."""
    (i, count, first), (gap, (lever, frame, grip)) = which, filled
    for k in range(count):
        row, a = world.touched.places[k], first + k
        normal = part_of(row, 1)
        gap[a] = row[0] - radius
        arm = minus(moved(part_of(row, 9), row[0] - radius, normal), triple(q, i))
        for j in range(3):
            lever[a, j] = arm[j]
        fill_contact_frame(frame[a], normal, (R[i, 0, 2], R[i, 1, 2], R[i, 2, 2]))
        grip[a] = world.grip[world.touched.items[k, 2]]


def world_geometry(
    scene: Scene, q: Array, world: Surroundings | None = None
) -> tuple[Array, Array, Array, Array]:
    """
    Return gaps, levers and frames of contacts with the world, and the grip of what they touch.

    The first three are those of `obstacles.contact_geometry`, for coordinates q (n, 7); of other
    contacts, and of those with gaps beyond `NEARBY`, the gap is infinite. Who calls often may give
    what `make_surroundings` returns.
    """
    count, chain = contact_count(scene), scene.robot.chain
    gap, lever, frame = np.full(count, np.inf), np.zeros((count, 3)), np.zeros((count, 3, 3))
    grip, R = np.ones(count), rotation_matrices(q[:, 3:])
    shapes = chain.spheres, chain.capsules
    world = world or make_surroundings(scene)
    fill_world_geometry(world, shapes, q, R, gap, (lever, frame, grip))
    return gap, lever, frame, grip


def lift_out_of_world(scene: Scene, q: Array) -> float:
    """
    Return how far up a robot must move at least until it is in no solid [m].

    The depth changes no faster than the robot moves, so that no place between is left out.

    Raises
    ------
    ParameterError
        If there is no such place.

    """
    chain, world = scene.robot.chain, make_surroundings(scene)
    meshes = solids_of(scene.world).meshes
    moving, lift = q.copy(), 0.0
    centers, radius = sphere_centers(scene.robot, q), float(chain.spheres.radius.min())
    for _ in range(MOST_LIFTS):
        moving[:, 2] = q[:, 2] + lift
        depth = depth_of_robot(world, chain.spheres, chain.capsules, moving)
        if depth <= TOUCHING:
            is_in_mesh = any(is_inside(mesh, centers, lift).any() for mesh in meshes)
            if not (is_in_mesh or is_pierced(world, chain.capsules, moving)):
                return lift
            depth = max(radius / 2, LEAST_LIFT)
        lift += max(depth, LEAST_LIFT)
    raise ParameterError(
        f'the robot must fit beside the solids of the world at its start, and is in one up to '
        f'{lift:.3g} m above the floor'
    )


def is_inside(mesh: Triangles, points: Array, lift: float) -> Array:
    """Return whether points (k, 3), lifted, are below an odd number of triangles, shape (k,)."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    found = np.zeros(len(points), dtype=bool)
    for k, (x, y, z) in enumerate(points + np.array([*BESIDE, lift])):
        near = (low[:, 0] <= x) & (x <= high[:, 0]) & (low[:, 1] <= y) & (y <= high[:, 1])
        one, two, three = (each[near] - [x, y, z] for each in (a, b, c))
        areas = np.array([
            u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
            for u, v in ((two, three), (three, one), (one, two))
        ])  # fmt: skip
        hit = (areas > 0.0).all(axis=0) | (areas < 0.0).all(axis=0)
        weights = areas[:, hit] / areas[:, hit].sum(axis=0)
        heights = (weights * np.stack([each[hit, 2] for each in (one, two, three)])).sum(axis=0)
        found[k] = (heights > 0.0).sum() % 2 == 1
    return found

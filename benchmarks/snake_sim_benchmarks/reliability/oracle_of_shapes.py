# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Distances of spheres and capsules from solids and each other, beside those of the library coal.

    python -m snake_sim_benchmarks.reliability.oracle_of_shapes [pairs]

It prints the largest difference of each kind of pair. Needs ``pip install coal``. The shapes are
up to 1 m in size, in any orientation, and apart: a capsule is as near as the nearest of its ends
and of the features between them.
"""

from collections.abc import Sequence
import math
import sys
from typing import Any

import numpy as np

from snake_sim_ros.contact.shapes import Axis, minus, moved, near_on_axes, size_of, times
from snake_sim_ros.contact.surroundings import (
    find_places_of_axis,
    make_surroundings,
    nearest_on_piece,
    Surroundings,
)
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.scene.chain import roll_pitch_yaw
from snake_sim_ros.scene.obstacles import OF_PAIR
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.scene.world import Box, Pole, Ramp, solids_of, World

SPACING = 100.0  # between solids, each of which is met alone [m]
OF_EACH = 50  # pairs of each solid


@compiled
def distance_of_capsule(
    world: Surroundings, item: int, row: Array, half: float, pieces: int
) -> float:
    """
    Return the distance of the axis of a capsule from some pieces [m].

    `row` is the middle of the axis and its direction, `half` half of its length [m].
    """
    middle, along = (row[0], row[1], row[2]), (row[3], row[4], row[5])
    nearest = math.inf
    for piece in range(item, item + pieces):
        for side in (-1.0, 1.0):
            end = moved(middle, 1.0, times(side * half, along))
            nearest = min(nearest, nearest_on_piece(world, piece, end).distance)
    if half > 0.0:
        count = find_places_of_axis(world, Axis(middle, along, half), 0.0, SPACING / 4)
        for k in range(count):
            nearest = min(nearest, world.touched.places[k, 0])
    return nearest


@compiled
def distance_of_axes(rows: Array, half: Array) -> float:
    """
    Return the distance of the axes of two capsules [m].

    `rows` are the middle of each axis and its direction, `half` the halves of their lengths [m].
    """
    one = Axis((rows[0, 0], rows[0, 1], rows[0, 2]), (rows[0, 3], rows[0, 4], rows[0, 5]), half[0])
    two = Axis((rows[1, 0], rows[1, 1], rows[1, 2]), (rows[1, 3], rows[1, 4], rows[1, 5]), half[1])
    nearest = math.inf
    for k in range(OF_PAIR):
        s, t = near_on_axes(one, two, k)
        if s < math.inf:
            apart = minus(moved(one.middle, s, one.along), moved(two.middle, t, two.along))
            nearest = min(nearest, size_of(apart))
    return nearest


def difference_of_links(pairs: int, seed: int) -> tuple[float, int]:
    """Do the same as `largest_difference` for capsules of links and each other."""
    import coal

    rng = np.random.default_rng(seed)
    request, worst, met = coal.DistanceRequest(), 0.0, 0
    request.gjk_tolerance, request.gjk_max_iterations = 1e-14, 10_000
    for _ in range(pairs):
        p, middle = rng.normal(size=(2, 4)), rng.uniform(-0.5, 0.5, (2, 3))
        R = rotation_matrices(p / np.linalg.norm(p, axis=1, keepdims=True))
        half, radius = (
            rng.choice([0.0, 1.0], 2) * rng.uniform(0.01, 0.5, 2),
            rng.uniform(0.01, 0.1, 2),
        )
        shapes = [
            coal.Capsule(r, 2 * h) if h > 0.0 else coal.Sphere(r)
            for r, h in zip(radius, half, strict=True)
        ]
        poses = [coal.Transform3s(*each) for each in zip(R, middle, strict=True)]
        result = coal.DistanceResult()
        coal.distance(shapes[0], poses[0], shapes[1], poses[1], request, result)
        if result.min_distance <= 1e-6:
            continue
        found = distance_of_axes(np.hstack([middle, R[:, :, 2]]), half) - radius.sum()
        worst, met = max(worst, abs(found - result.min_distance)), met + 1
    return worst, met


def solids(kind: str, rng: np.random.Generator, count: int) -> tuple[World, list[Any]]:
    """Return a world of solids far apart, and each of them as coal has it: shape and placement."""
    import coal

    found: list[Any] = []
    shapes: list[Any] = []
    for k in range(count):
        place = np.array([SPACING * k, 0.0, 50.0])
        size, turn = rng.uniform(0.05, 1.0, 3), rng.uniform(-math.pi, math.pi, 3)
        if kind == 'box':
            box = Box(center=tuple(place), size=tuple(size), rpy=tuple(turn))
            found.append(box)
            shapes.append((coal.Box(*size), box.center, turn))
        elif kind == 'pole':
            way, radius = rng.normal(size=3), float(size[2]) / 4
            way *= size[0] / np.linalg.norm(way)
            pole = Pole(start=tuple(place - way), end=tuple(place + way), radius=radius)
            found.append(pole)
            shapes.append((coal.Capsule(radius, 2 * size[0]), tuple(place), way))
        else:
            ramp = Ramp(
                start=tuple(place), run=size[0], rise=size[1], width=size[2], heading=turn[2]
            )
            found.append(ramp)
            shapes.append((None, ramp, turn))
    names = {'box': 'boxes', 'pole': 'poles', 'wedge': 'ramps'}
    given: dict[str, Any] = {names[kind]: tuple(found)}
    return World(**given), shapes


def placed(shape: Any, where: Any, turn: Array, world: World, k: int) -> tuple[Any, Any]:
    """Return a shape of coal and its placement."""
    import coal

    if shape is None:
        mesh = solids_of(world).meshes[k]
        corners, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
        for vertex in mesh.vertices:
            corners.append(vertex)
        for face in mesh.faces.tolist():
            faces.append(coal.Triangle(*face))
        convex = coal.Convex(corners, faces)
        return convex, coal.Transform3s.Identity()
    R = frame_along(turn) if isinstance(shape, coal.Capsule) else roll_pitch_yaw(tuple(turn))
    return shape, coal.Transform3s(R, np.array(where))


def frame_along(way: Array) -> Array:
    """Return a rotation matrix whose third column has a direction."""
    z = way / np.linalg.norm(way)
    x = np.cross(z, np.eye(3)[np.abs(z).argmin()])
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def largest_difference(kind: str, capsules: bool, pairs: int, seed: int) -> tuple[float, int]:
    """Return the largest difference from coal of pairs that are apart [m], and their number."""
    import coal

    rng = np.random.default_rng(seed)
    world, shapes = solids(kind, rng, max(1, pairs // OF_EACH))
    surroundings = make_surroundings(Scene(world=world))
    request, worst, met = coal.DistanceRequest(), 0.0, 0
    request.gjk_tolerance, request.gjk_max_iterations = 1e-14, 10_000
    pieces = 12 if kind == 'wedge' else 1
    for k, (shape, where, turn) in enumerate(shapes):
        other, pose = placed(shape, where, turn, world, k)
        center = np.array([SPACING * k, 0.0, 50.0])
        for _ in range(OF_EACH):
            p = rng.normal(size=4)
            R = rotation_matrices(p / np.linalg.norm(p))
            half = float(rng.uniform(0.01, 0.5)) if capsules else 0.0
            radius = float(rng.uniform(0.01, 0.1))
            middle = center + rng.uniform(-1.5, 1.5, 3)
            mine = coal.Capsule(radius, 2 * half) if capsules else coal.Sphere(radius)
            result = coal.DistanceResult()
            coal.distance(mine, coal.Transform3s(R, middle), other, pose, request, result)
            if result.min_distance <= 1e-6:
                continue
            row = np.concatenate([middle, R[:, 2]])
            found = distance_of_capsule(surroundings, k * pieces, row, half, pieces) - radius
            worst, met = max(worst, abs(found - result.min_distance)), met + 1
    return worst, met


def main(arguments: Sequence[str]) -> int:
    """Print the largest differences."""
    pairs = int(arguments[0]) if arguments else 100_000
    kinds = [(kind, each) for kind in ('box', 'pole', 'wedge') for each in (False, True)]
    share = pairs // (len(kinds) + 1)
    worst, met = difference_of_links(share, len(kinds))
    print(f'links and each other: {worst:.1e} m in {met} pairs that are apart')
    for seed, (kind, capsules) in enumerate(kinds):
        worst, met = largest_difference(kind, capsules, share, seed)
        name = 'capsules' if capsules else 'spheres'
        print(f'{name} and {kind}: {worst:.1e} m in {met} pairs that are apart')
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Uniform solids of a link: their inertia, and the capsules as which they touch the world.

Spheres and capsules touch as they are, cylinders with their radius and length, so that their ends
are rounded off. Boxes are taken along their longest side, with half the mean of the other two
sides as radius, and meshes as the boxes of their bounds. What is shorter than twice its radius
touches as a sphere.
"""

import math
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote

import numpy as np

from snake_sim_ros.scene.chain import Array, Shape
from snake_sim_ros.scene.checked_records import cut, LONGEST_PATH, LONGEST_REASON, ParameterError
from snake_sim_ros.scene.files import is_file
from snake_sim_ros.scene.gait import Numbers

Body = tuple[float, Array, Array]  # mass [kg], center of mass [m], inertia about it [kg m^2]

SHORTEST = 1e-9  # half of the axis of a capsule; what has less is a sphere [m]
UNKNOWN = np.zeros((2, 3))  # bounds


class Solid(NamedTuple):
    """A uniform solid in the frame of a link."""

    kind: str  # a key of SIZES
    size: Numbers  # as there [m]; of a mesh the factors of its coordinates
    pose: Array  # (4, 4)
    file: str = ''  # of a mesh


SIZES = {
    'box': {'size': 3},
    'cylinder': {'radius': 1, 'length': 1},
    'sphere': {'radius': 1},
    'capsule': {'radius': 1, 'length': 1},  # length of its axis, as in SDFormat
    'mesh': {'scale': 3},
}


def radius_and_length(solid: Solid) -> tuple[float, float]:
    """Return the radius of a round solid and the length of its axis, 0 for a sphere [m]."""
    radius, *length = solid.size
    return radius, sum(length)


def uniform(solid: Solid) -> Body:
    """Return a solid as a body with a density of 1 kg/m^3."""
    if solid.kind == 'box':
        a, b, c = (side * side for side in solid.size)
        mass = math.prod(solid.size)
        moments = [mass / 12 * each for each in (b + c, a + c, a + b)]
    else:
        r, L = radius_and_length(solid)
        tube = math.pi * r**2 * L
        ball = 0.0 if solid.kind == 'cylinder' else 4 / 3 * math.pi * r**3  # both of its halves
        mass = tube + ball
        across = tube * (3 * r**2 + L**2) / 12 + ball * (0.4 * r**2 + L**2 / 4 + 3 / 8 * L * r)
        moments = [across, across, tube * r**2 / 2 + ball * 0.4 * r**2]
    return mass, solid.pose[:3, 3], turned(solid.pose, np.diag(moments))


def joined(bodies: list[Body]) -> Body:
    """Return several bodies as one."""
    bodies = [body for body in bodies if body[0] > 0.0]
    if len(bodies) < 2:
        return bodies[0] if bodies else (0.0, np.zeros(3), np.zeros((3, 3)))
    mass = sum(m for m, _, _ in bodies)
    center = np.asarray(sum(m * place for m, place, _ in bodies) / mass)
    total = np.zeros((3, 3))
    for m, place, inertia in bodies:
        arm = place - center
        total += inertia + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return mass, center, total


def turned(pose: Array, inertia: Array) -> Array:
    """Return an inertia in axes of a frame (4, 4) in those axes in which the frame is given."""
    return np.asarray(pose[:3, :3] @ inertia @ pose[:3, :3].T)


def reach(solid: Solid, center: Array) -> float:
    """Return a distance from a point of the link within which all of a solid is [m]."""
    if solid.kind == 'box':
        half = float(np.linalg.norm(solid.size)) / 2
    else:
        r, L = radius_and_length(solid)
        half = math.hypot(r, L / 2) if solid.kind == 'cylinder' else r + L / 2
    return float(np.linalg.norm(solid.pose[:3, 3] - center)) + half


def capsule(solid: Solid, pose: Array) -> Shape:
    """Return as what a solid of a link touches, in the frame in which the link is at a pose."""
    if solid.kind == 'box':
        along = int(np.argmax(solid.size))
        length = solid.size[along]
        radius = (sum(solid.size) - length) / 4
    else:
        along, (radius, length) = 2, radius_and_length(solid)
        length += 2 * radius if solid.kind == 'capsule' else 0.0
    at = pose @ solid.pose
    half = length / 2 - radius
    if half < SHORTEST:
        return Shape(radius=radius, start=tuple(at[:3, 3].tolist()))
    start, end = (at[:3, 3] + side * half * at[:3, along] for side in (-1.0, 1.0))
    return Shape(radius=radius, start=tuple(start.tolist()), end=tuple(end.tolist()))


# ---- meshes -------------------------------------------------------------------------------------


class Meshes(NamedTuple):
    """The meshes that a URDF in a folder names, each read once."""

    folder: Path | None
    read: dict[str, tuple[Array, str]]  # bounds, and why they are not known

    def box(self, mesh: Solid) -> Solid:
        """Return the box of a mesh; raise an error that says why there is none."""
        if mesh.file not in self.read:
            path = path_of(mesh.file, self.folder)
            self.read[mesh.file] = bounds_of(path) if path else (UNKNOWN, 'is not found')
        bounds, reason = self.read[mesh.file]
        low, high = bounds * mesh.size
        sides, pose = np.abs(high - low), mesh.pose.copy()
        if not sides.min() > 0.0:
            name = cut(mesh.file, LONGEST_PATH)
            raise ParameterError(f'the mesh {name}, which {reason or "has no volume"}')
        pose[:3, 3] += mesh.pose[:3, :3] @ (low + high) / 2
        return Solid('box', tuple(sides.tolist()), pose)


def bounds_of(path: Path) -> tuple[Array, str]:
    """Return the least and the largest coordinates of a mesh, or why they are not known."""
    try:
        import trimesh
    except ImportError:
        return UNKNOWN, "needs trimesh: pip install 'snake_sim_ros[urdf]'"
    try:
        bounds = np.asarray(trimesh.load_scene(path).bounds, dtype=float)
    except Exception as error:  # whatever readers of a dozen formats raise for broken files
        return UNKNOWN, f'is not readable: {cut(str(error), LONGEST_REASON)}'
    is_known = bounds.shape == (2, 3) and np.isfinite(bounds).all()
    return (bounds, '') if is_known else (UNKNOWN, 'is empty')


def path_of(file: str, folder: Path | None) -> Path | None:
    """Return where a mesh is, that of a package in a folder above that of the URDF."""
    scheme, mark, rest = file.rpartition('://')
    places = []
    if scheme in ('', 'file') and Path(rest).is_absolute():
        places = [Path(rest), Path(unquote(rest))]
    elif folder is not None and not mark:
        places = [folder / rest]
    elif folder is not None and scheme in ('package', 'model'):
        above = [folder.resolve(), *folder.resolve().parents]
        places = [each / name for name in (rest, rest.partition('/')[2]) for each in above]
    return next((place for place in places if is_file(place)), None)

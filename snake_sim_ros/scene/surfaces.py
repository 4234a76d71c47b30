# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The solids of a world as triangles, for pictures and markers; round ones have flat facets."""

import numpy as np

from snake_sim_ros.scene.chain import Array
from snake_sim_ros.scene.world import solids_of, World

AROUND = 32  # facets around a pole or pipe
ALONG = 6  # rings of half a ball
Surface = tuple[Array, Array]  # vertices (v, 3) [m, frame I], and triangles (t, 3) of them


def surfaces_of(world: World) -> list[Surface]:
    """Return the surface of every solid, counterclockwise as seen from outside."""
    solids = solids_of(world)
    found = [
        _box(center, half, axes)
        for center, half, axes in zip(
            solids.box_center, solids.box_half, solids.box_axes, strict=True
        )
    ]
    found += [_pole(row[:3], row[3:6], row[6]) for row in solids.poles]
    found += [_pipe(row[:3], row[3:6], row[6], row[7]) for row in solids.pipes]
    return found + [(mesh.vertices, mesh.faces) for mesh in solids.meshes]


def _box(center: Array, half: Array, axes: Array) -> Surface:
    """Return a box as twelve triangles."""
    signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3, indexing='ij'), axis=-1).reshape(-1, 3)
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [triangle for a, b, c, d in sides for triangle in ((a, b, c), (a, c, d))]
    return center + (signs * half) @ axes, np.array(faces)


def _turned(start: Array, end: Array, profile: Array, is_closed: bool) -> Surface:
    """Return the surface that a profile, rows of way along an axis and radius [m], makes."""
    axis = (end - start) / np.linalg.norm(end - start)
    one = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    one /= np.linalg.norm(one)
    angle = 2.0 * np.pi * np.arange(AROUND) / AROUND
    out = np.outer(np.cos(angle), one) + np.outer(np.sin(angle), np.cross(axis, one))
    along, radius = profile.T
    points = start + along[:, None, None] * axis + radius[:, None, None] * out
    ring, rings = np.arange(AROUND), len(profile)
    faces = []
    for k in range(rings if is_closed else rings - 1):
        a, b = k * AROUND + ring, k * AROUND + np.roll(ring, -1)
        c, d = ((k + 1) % rings) * AROUND + np.roll(ring, -1), ((k + 1) % rings) * AROUND + ring
        faces += [np.column_stack([a, b, c]), np.column_stack([a, c, d])]
    return points.reshape(-1, 3), np.concatenate(faces)


def _pole(start: Array, end: Array, radius: float) -> Surface:
    """Return a round bar with half balls as its ends."""
    turn, length = np.linspace(0.0, np.pi / 2, ALONG + 1), np.linalg.norm(end - start)
    ball = radius * np.column_stack([-np.cos(turn), np.sin(turn)])
    other = np.array([length, 0.0]) + ball[::-1] * np.array([-1.0, 1.0])
    return _turned(start, end, np.concatenate([ball, other]), False)


def _pipe(start: Array, end: Array, radius: float, inner: float) -> Surface:
    """Return a tube with flat ends."""
    length = float(np.linalg.norm(end - start))
    profile = np.array([(0.0, radius), (length, radius), (length, inner), (0.0, inner)])
    return _turned(start, end, profile, True)

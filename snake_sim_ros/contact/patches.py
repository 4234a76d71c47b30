# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Patches of the ground with another friction, compiled.

They are sampled once a step, at the points below the centers of the spheres where contacts are
found. A sphere that crosses a border has the friction of one patch in a step and that of the other
in the next one: the border is an event in time only, and nothing is smoothed.
"""

import math
from typing import NamedTuple

import numpy as np

from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.scene.parameters import Array, Scene


class Patches(NamedTuple):
    """Patches of friction of a scene; see `parameters.Patches`."""

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
def patch_factor(patches, x, y):
    """Return the factor of friction at a point (x, y) of I [m], 1 outside the patches."""
    row = math.floor((y - patches.origin_y) / patches.cell)
    column = math.floor((x - patches.origin_x) / patches.cell)
    if 0 <= row < patches.factors.shape[0] and 0 <= column < patches.factors.shape[1]:
        return patches.factors[row, column]
    return 1.0


@inlined
def fill_grip(patches, contacts, a, x, y):
    """Fill the grip of contact a, of a sphere above (x, y) of I [m]; without patches it is 1."""
    contacts.grip[a] = patch_factor(patches, x, y)

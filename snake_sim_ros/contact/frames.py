# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Contact frames in space: the normal, e_x along a link and e_y across it."""

import math

from snake_sim_ros.dynamics.compilation import inlined


@inlined
def fill_contact_frame(frame, normal, axis):
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
def tangential_part(normal, v):
    """Return v without its part along the normal."""
    along = normal[0] * v[0] + normal[1] * v[1] + normal[2] * v[2]
    return v[0] - along * normal[0], v[1] - along * normal[1], v[2] - along * normal[2]


@inlined
def set_axis(frame, k, v):
    """Write the vector v to frame[k]."""
    frame[k, 0], frame[k, 1], frame[k, 2] = v

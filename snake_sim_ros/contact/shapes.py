# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Compiled distances of a point, and of the axis of a capsule, to one shape; all are exact.

Boxes, triangles and poles are convex: there is one point of them that is nearest. Vectors are in
axes of I, points in I [m]. What touches is a sphere around the point or a capsule around the axis,
so that its gap is a distance less a radius.
"""

import math
from typing import NamedTuple

from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.spatial_vectors import Three
from snake_sim_ros.scene.obstacles import OF_PAIR, PARALLEL
from snake_sim_ros.scene.parameters import Array

# Where on a shape its nearest point is, and by what the shape continues around it: a plane, the
# surface of a round bar around a line (of an edge, with no radius) or of a ball around a point, or
# the inside of a tube around a line.
PLANE, LINE, POINT, TUBE = range(4)

NEAREST = 1e-15  # distance below which its direction is rounding [m]
ROUGH, FINE = 17, 60  # points at which a search along an axis begins, and bisections
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


class Near(NamedTuple):
    """The nearest point of a shape, as seen from a point c."""

    distance: float  # from the surface, negative inside of a box, pole or wall of a pipe [m]
    normal: Three  # unit vector from the shape to c
    kind: int  # PLANE, LINE, POINT or TUBE
    along: Three  # direction of the line, of kind LINE and TUBE
    thickness: float  # radius around the line or point [m]
    facing: float  # cosine of the angle of normal and outward normal; below 0 from behind


UP: Three = (0.0, 0.0, 1.0)
E_X: Three = (1.0, 0.0, 0.0)


@inlined
def inner(a: Three, b: Three) -> float:
    """Return the inner product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def outer(a: Three, b: Three) -> Three:
    """Return the cross product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def minus(a: Three, b: Three) -> Three:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def moved(a: Three, s: float, b: Three) -> Three:
    """Return a + s b."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@inlined
def times(s: float, a: Three) -> Three:
    """Return s a."""
    return s * a[0], s * a[1], s * a[2]


@inlined
def size_of(a: Three) -> float:
    """Return the length of a vector."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@inlined
def triple(A: Array, i: int) -> Three:
    """Return row i of an array (m, 3)."""
    return A[i, 0], A[i, 1], A[i, 2]


@inlined
def across(a: Three) -> Three:
    """Return a unit vector at right angles to a unit vector."""
    b = outer(a, E_X if abs(a[0]) < 0.7 else UP)
    return times(1.0 / size_of(b), b)


@inlined
def nearest_on_box(center: Array, half: Array, axes: Array, k: int, c: Three) -> Near:
    """Return the nearest point of box k of arrays (b, 3), (b, 3) and (b, 3, 3)."""
    apart = minus(c, triple(center, k))
    beyond, square, count, last, within = (0.0, 0.0, 0.0), 0.0, 0, 0, 0
    least, side, face = math.inf, 1.0, 0
    for j in range(3):
        axis = triple(axes[k], j)
        x = inner(apart, axis)
        over = abs(x) - half[k, j]
        sign = 1.0 if x >= 0.0 else -1.0
        if over > 0.0:
            beyond = moved(beyond, sign * over, axis)
            square += over * over
            count, last = count + 1, j
        else:
            within = j
            if -over < least:
                least, side, face = -over, sign, j
    if count == 0:
        normal = times(side, triple(axes[k], face))
        return Near(-least, normal, PLANE, normal, 0.0, 1.0)
    distance = math.sqrt(square)
    if count == 1:
        axis = triple(axes[k], last)
        normal = times(1.0 if inner(beyond, axis) > 0.0 else -1.0, axis)
        return Near(distance, normal, PLANE, normal, 0.0, 1.0)
    normal = times(1.0 / distance, beyond)
    kind = LINE if count == 2 else POINT
    return Near(distance, normal, kind, triple(axes[k], within), 0.0, 1.0)


@inlined
def nearest_on_segment(start: Three, axis: Three, length: float, radius: float, c: Three) -> Near:
    """Return the nearest point of a pole from its start along a unit vector."""
    apart = minus(c, start)
    t = inner(apart, axis)
    kind = LINE if 0.0 < t < length else POINT
    radial = moved(apart, -min(max(t, 0.0), length), axis)
    distance = size_of(radial)
    if distance < NEAREST:
        return Near(distance - radius, across(axis), kind, axis, radius, 1.0)
    return Near(distance - radius, times(1.0 / distance, radial), kind, axis, radius, 1.0)


@inlined
def nearest_on_pipe(
    start: Three, axis: Three, length: float, radii: tuple[float, float], c: Three
) -> Near:
    """Return the nearest point of a tube with (outer, inner) radius; its ends are flat."""
    apart = minus(c, start)
    t = inner(apart, axis)
    radial = moved(apart, -t, axis)
    rho = size_of(radial)
    out = times(1.0 / rho, radial) if rho >= NEAREST else across(axis)
    most, least = radii
    end, beyond = (times(-1.0, axis), -t) if t < 0.5 * length else (axis, t - length)
    if beyond <= 0.0:
        if rho >= most:
            return Near(rho - most, out, LINE, axis, most, 1.0)
        if rho <= least:
            return Near(least - rho, times(-1.0, out), TUBE, axis, least, 1.0)
        if beyond >= max(rho - most, least - rho):
            return Near(beyond, end, PLANE, end, 0.0, 1.0)
        if rho - most >= least - rho:
            return Near(rho - most, out, LINE, axis, most, 1.0)
        return Near(least - rho, times(-1.0, out), TUBE, axis, least, 1.0)
    if least <= rho <= most:
        return Near(beyond, end, PLANE, end, 0.0, 1.0)
    rim = rho - most if rho > most else rho - least
    way = moved(times(beyond, end), rim, out)
    distance = size_of(way)
    return Near(distance, times(1.0 / distance, way), LINE, outer(axis, out), 0.0, 1.0)


class Triangles(NamedTuple):
    """Triangles of meshes."""

    vertices: Array  # (v, 3) [m]
    mean_normals: Array  # (v, 3) outward at the vertices; see `nearest_on_triangle`
    corners: Array  # (t, 3) vertices of the triangles, counterclockwise from outside
    normals: Array  # (t, 3) outward


@inlined
def nearest_on_triangle(mesh: Triangles, k: int, c: Three) -> Near:
    """
    Return the nearest point of triangle k, as seen from c.

    A vertex is seen from behind if its mean normal is, the sum of the normals around it, weighted
    by the angles of the triangles [1]_: some of these may be seen from the other side than others.

    .. [1] J. A. Baerentzen, H. Aanaes, "Signed distance computation using the angle weighted
       pseudonormal", IEEE Trans. Visualization and Computer Graphics 11(3), 2005.
    """
    vertices, corners = mesh.vertices, mesh.corners
    normal = triple(mesh.normals, k)
    place = triple(vertices, corners[k, 0])
    height = inner(minus(c, place), normal)
    inside, square = True, math.inf
    best, kind, along, facing = place, POINT, normal, normal
    for j in range(3):
        a, b = triple(vertices, corners[k, j]), triple(vertices, corners[k, (j + 1) % 3])
        side, apart = minus(b, a), minus(c, a)
        if inner(outer(normal, side), apart) < 0.0:
            inside = False
            length = inner(side, side)
            t = min(max(inner(apart, side) / length, 0.0), 1.0)
            way = moved(apart, -t, side)
            if inner(way, way) < square:
                square, best = inner(way, way), way
                kind = LINE if 0.0 < t < 1.0 else POINT
                along = times(1.0 / math.sqrt(length), side)
                corner = corners[k, j] if t == 0.0 else corners[k, (j + 1) % 3]
                facing = normal if kind == LINE else triple(mesh.mean_normals, corner)
    if inside:
        if height >= 0.0:
            return Near(height, normal, PLANE, normal, 0.0, 1.0)
        return Near(-height, times(-1.0, normal), PLANE, normal, 0.0, -1.0)
    distance = math.sqrt(square)
    if distance < NEAREST:
        return Near(distance, normal, kind, along, 0.0, 1.0)
    way = times(1.0 / distance, best)
    return Near(distance, way, kind, along, 0.0, inner(way, facing))


class Axis(NamedTuple):
    """The axis of a capsule."""

    middle: Three  # [m]
    along: Three  # unit vector
    half: float  # half of its length [m]


@inlined
def axis_meets_line(axis: Axis, start: Three, along: Three) -> tuple[float, float]:
    """
    Return where the line of an axis and another line are nearest, from middle and start [m].

    Parallel lines have no such places: the first number is then infinite.
    """
    cosine = inner(axis.along, along)
    sine = 1.0 - cosine * cosine
    if sine < PARALLEL:
        return math.inf, 0.0
    apart = minus(axis.middle, start)
    a, b = inner(apart, axis.along), inner(apart, along)
    return (cosine * b - a) / sine, (b - cosine * a) / sine


@inlined
def near_on_axes(one: Axis, other: Axis, k: int) -> tuple[float, float]:
    """
    Return where contact k of two capsules is on their axes, from their middles [m].

    The first number is infinite if there is none; see `scene.obstacles.nearest_on_axes`.
    """
    if (k == 1 and one.half == 0.0) or (k == 3 and other.half == 0.0):
        return math.inf, 0.0
    if k == OF_PAIR - 1:
        s, t = axis_meets_line(one, other.middle, other.along)
        return (s if abs(s) < one.half and abs(t) < other.half else math.inf), t
    apart, cosine = minus(one.middle, other.middle), inner(one.along, other.along)
    if k < 2:
        s = one.half if k == 1 else -one.half
        t = inner(apart, other.along) + s * cosine
        return s, min(max(t, -other.half), other.half)
    t = other.half if k == 3 else -other.half
    s = t * cosine - inner(apart, one.along)
    return (s if abs(s) < one.half else math.inf), t


@inlined
def distance_of_pipe(
    start: Three, direction: Three, length: float, radii: tuple[float, float], axis: Axis, s: float
) -> float:
    """Return the distance of a tube from a point of an axis, s from its middle [m]."""
    point = moved(axis.middle, s, axis.along)
    return nearest_on_pipe(start, direction, length, radii, point).distance


@inlined
def nearest_along_axis(
    start: Three, direction: Three, length: float, radii: tuple[float, float], axis: Axis, k: int
) -> float:
    """
    Return where between two points of an axis it is nearest to a tube, from its middle [m].

    Of ROUGH points on the axis, those before and after point k are meant, between which the
    distance has one minimum.
    """
    part = 2.0 * axis.half / (ROUGH - 1)
    low = max(-axis.half, -axis.half + (k - 1) * part)
    high = min(axis.half, -axis.half + (k + 1) * part)
    for _ in range(FINE):
        one, other = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        if distance_of_pipe(start, direction, length, radii, axis, one) < distance_of_pipe(
            start, direction, length, radii, axis, other
        ):
            high = other
        else:
            low = one
    return 0.5 * (low + high)

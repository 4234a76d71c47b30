# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What is near: a uniform grid over x and y of I, with the bounds of what is in its cells.

An item is in all cells that its bounds overlap, and is found once. Work grows with the items that
are near, not with their number.
"""

import math
from typing import NamedTuple

import numpy as np

from snake_sim_ros.contact.shapes import Axis
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.spatial_vectors import Three
from snake_sim_ros.scene.parameters import Array

ITEMS_OF_A_CELL = 8.0  # in the mean, if all were points
ASIDE = 1e-8  # distance from which on a point is clearly beside bounds [m]
SLACK = 1.0000001  # on squares of distances of cells, for their rounding


class Grid(NamedTuple):
    """Items in cells."""

    x: float  # corner of the cells with the least x and y, in I [m]
    y: float  # [m]
    z: float  # the largest z of all items [m]
    per_meter: float  # cells
    columns: int  # along x
    rows: int  # along y
    begin: Array  # (rows * columns + 1,) where the items of a cell begin
    members: Array  # the items of the cells
    low: Array  # (rows * columns,) least z of what is in a cell [m]
    high: Array  # largest z [m]
    level: Array  # whether a cell has nothing but parts of a horizontal plane that goes on
    bounds: Array  # (items, 6) least x, y, z and largest ones [m]
    found: Array  # (items,) scratch: those that were found last
    seen: Array  # (items,) scratch: the search that saw an item last
    search: Array  # (1,) scratch: number of the last search


def own_scratch(grid: Grid) -> Grid:
    """Return a grid with scratch of its own."""
    return grid._replace(found=grid.found.copy(), seen=grid.seen.copy(), search=grid.search.copy())


def make_grid(bounds: Array, goes_on: Array | None = None) -> Grid:
    """
    Return the grid of items; it has no cells if there are no items.

    Parameters
    ----------
    bounds : ndarray, shape (items, 6)
        Least x, y, z and largest ones [m].
    goes_on : ndarray of bool, shape (items,), optional
        Which are triangles whose plane is continued by others on all sides. Default: none.

    """
    if not len(bounds):
        nothing = np.zeros(0, dtype=int)
        return Grid(
            0.0, 0.0, 0.0, 1.0, 0, 0, np.zeros(1, dtype=int), nothing, np.zeros(0), np.zeros(0),
            np.zeros(0, dtype=bool), bounds.reshape(0, 6), nothing, nothing,
            np.zeros(1, dtype=int),
        )  # fmt: skip
    low, high = bounds[:, :2].min(axis=0), bounds[:, 3:5].max(axis=0)
    width, depth = np.maximum(high - low, 1e-3)
    per_meter = math.sqrt(max(len(bounds) / ITEMS_OF_A_CELL, 16.0) / (width * depth))
    per_meter = min(per_meter, 1e4 / max(width, depth))
    columns, rows = (math.floor(size * per_meter) + 1 for size in (width, depth))
    first = _cells(bounds[:, :2], low, per_meter, (columns, rows))
    last = _cells(bounds[:, 3:5], low, per_meter, (columns, rows))
    wide, deep = (last - first + 1).T
    item = np.repeat(np.arange(len(bounds)), wide * deep)
    begin = np.concatenate([[0], np.cumsum(wide * deep)[:-1]])
    place = np.arange(len(item)) - begin[item]
    column = first[item, 0] + place % wide[item]
    row = first[item, 1] + place // wide[item]
    cell = row * columns + column
    order, count = np.argsort(cell, kind='stable'), np.bincount(cell, minlength=rows * columns)
    least, most = np.full(rows * columns, np.inf), np.full(rows * columns, -np.inf)
    np.minimum.at(least, cell, bounds[item, 2])
    np.maximum.at(most, cell, bounds[item, 5])
    level = least == most
    if goes_on is None:
        level[:] = False
    else:
        level[cell[~goes_on[item]]] = False
    return Grid(
        x=float(low[0]),
        y=float(low[1]),
        z=float(bounds[:, 5].max()),
        per_meter=float(per_meter),
        columns=columns,
        rows=rows,
        begin=np.concatenate([[0], np.cumsum(count)]),
        members=item[order],
        low=least,
        high=most,
        level=level,
        bounds=np.ascontiguousarray(bounds),
        found=np.zeros(len(bounds), dtype=int),
        seen=np.zeros(len(bounds), dtype=int),
        search=np.zeros(1, dtype=int),
    )


def _cells(points: Array, low: Array, per_meter: float, shape: tuple[int, int]) -> Array:
    """Return column and row of points (k, 2); the compiled form is `cell_of`."""
    cells = np.floor((points - low) * per_meter).astype(int)
    return np.clip(cells, 0, np.array(shape) - 1)


@inlined
def cell_of(x: float, low: float, per_meter: float, count: int) -> int:
    """Return the column or row of a number, that of an end for numbers beyond."""
    return min(max(math.floor((x - low) * per_meter), 0), count - 1)


@inlined
def find_near_point(grid: Grid, c: Three, reach: float) -> tuple[int, bool]:
    """
    Fill `found` with the items whose bounds are within `reach` of a point [m].

    Returns
    -------
    count : int
        How many they are.
    is_level : bool
        Whether all cells within reach are level. Only items below the point, or above, are found
        then: what is beside it is not as near.

    """
    beside = reach_beside(grid, c[2], reach)
    low_x, high_x, low_y, high_y = c[0] - beside, c[0] + beside, c[1] - beside, c[1] + beside
    if is_beside(grid, low_x, high_x, low_y, high_y, c[2] - reach):
        return 0, False
    columns = (
        cell_of(low_x, grid.x, grid.per_meter, grid.columns),
        cell_of(high_x, grid.x, grid.per_meter, grid.columns),
    )
    rows = (
        cell_of(low_y, grid.y, grid.per_meter, grid.rows),
        cell_of(high_y, grid.y, grid.per_meter, grid.rows),
    )
    count = find_in_cells(grid, c, reach, ASIDE, (columns, rows))
    if count >= 0:
        return count, True
    return find_in_cells(grid, c, reach, math.inf, (columns, rows)), False


@inlined
def find_in_cells(
    grid: Grid, c: Three, reach: float, aside: float, cells: tuple[tuple[int, int], ...]
) -> int:
    """
    Fill the items of `find_near_point` that are beside the point by `aside` at most [m].

    `cells` are the first and last columns and rows. Return how many items they are; -1 if `aside`
    is finite and a cell is not level.
    """
    count, side, square = 0, 1.0 / grid.per_meter, SLACK * reach * reach
    grid.search[0] += 1
    columns, rows = cells
    for row in range(rows[0], rows[1] + 1):
        y = grid.y + row * side
        dy = max(y - c[1], c[1] - y - side, 0.0)
        for column in range(columns[0], columns[1] + 1):
            k = row * grid.columns + column
            x = grid.x + column * side
            dx = max(x - c[0], c[0] - x - side, 0.0)
            dz = max(grid.low[k] - c[2], c[2] - grid.high[k], 0.0)
            if dx * dx + dy * dy + dz * dz > square:
                continue
            if aside < math.inf and not grid.level[k]:
                return -1
            if max(dx, dy) > aside:
                continue
            for m in range(grid.begin[k], grid.begin[k + 1]):
                item = grid.members[m]
                dx2 = max(grid.bounds[item, 0] - c[0], c[0] - grid.bounds[item, 3], 0.0)
                dy2 = max(grid.bounds[item, 1] - c[1], c[1] - grid.bounds[item, 4], 0.0)
                dz2 = max(grid.bounds[item, 2] - c[2], c[2] - grid.bounds[item, 5], 0.0)
                is_near = dx2 * dx2 + dy2 * dy2 + dz2 * dz2 <= reach * reach
                if is_near and max(dx2, dy2) <= aside and is_first_seen(grid, item):
                    grid.found[count] = item
                    count += 1
    return count


@inlined
def reach_beside(grid: Grid, low: float, reach: float) -> float:
    """Return how far beside points from a height on [m] items are that are within `reach` [m]."""
    above = max(low - grid.z, 0.0)
    return math.sqrt(max(SLACK * reach * reach - above * above, 0.0))


@inlined
def is_first_seen(grid: Grid, item: int) -> bool:
    """Note that an item is seen; return whether this search has not seen it before."""
    if grid.seen[item] == grid.search[0]:
        return False
    grid.seen[item] = grid.search[0]
    return True


@inlined
def is_beside(
    grid: Grid, low_x: float, high_x: float, low_y: float, high_y: float, low_z: float
) -> bool:
    """Return whether bounds are above or beside all items [m]."""
    return (
        low_z > grid.z
        or high_x < grid.x
        or high_y < grid.y
        or (low_x - grid.x) * grid.per_meter > grid.columns
        or (low_y - grid.y) * grid.per_meter > grid.rows
    )


@inlined
def from_axis(axis: Axis, dx: float, dy: float, dz: float) -> float:
    """Return the distance of a point, (dx, dy, dz) beside the middle of an axis, from it [m]."""
    ax, ay, az = axis.along
    s = min(max(dx * ax + dy * ay + dz * az, -axis.half), axis.half)
    return math.sqrt((dx - s * ax) ** 2 + (dy - s * ay) ** 2 + (dz - s * az) ** 2)


@inlined
def find_near_axis(grid: Grid, axis: Axis, reach: float) -> int:
    """Fill `found` with the items whose bounds may be within `reach` of an axis [m]; count."""
    count, side = 0, 1.0 / grid.per_meter
    grid.search[0] += 1
    (x, y, z), (ax, ay, az), half = axis
    beside = reach_beside(grid, z - half * abs(az), reach)
    low_z, high_z = z - half * abs(az) - reach, z + half * abs(az) + reach
    low_x, low_y = x - half * abs(ax) - beside, y - half * abs(ay) - beside
    high_x, high_y = x + half * abs(ax) + beside, y + half * abs(ay) + beside
    if is_beside(grid, low_x, high_x, low_y, high_y, low_z):
        return count
    first, last = (
        cell_of(low_x, grid.x, grid.per_meter, grid.columns),
        cell_of(high_x, grid.x, grid.per_meter, grid.columns),
    )
    for row in range(
        cell_of(low_y, grid.y, grid.per_meter, grid.rows),
        cell_of(high_y, grid.y, grid.per_meter, grid.rows) + 1,
    ):
        for column in range(first, last + 1):
            k = row * grid.columns + column
            if grid.low[k] > high_z or grid.high[k] < low_z:
                continue
            height = 0.5 * (grid.high[k] - grid.low[k])
            dx = grid.x + (column + 0.5) * side - x
            dy = grid.y + (row + 0.5) * side - y
            most = reach + math.sqrt(0.5 * side * side + height * height)
            if from_axis(axis, dx, dy, grid.low[k] + height - z) > most:
                continue
            for m in range(grid.begin[k], grid.begin[k + 1]):
                item = grid.members[m]
                if not is_first_seen(grid, item):
                    continue
                b, square = grid.bounds, 0.0
                dx = 0.5 * (b[item, 0] + b[item, 3]) - x
                dy = 0.5 * (b[item, 1] + b[item, 4]) - y
                dz = 0.5 * (b[item, 2] + b[item, 5]) - z
                for j in range(3):
                    square += 0.25 * (b[item, j + 3] - b[item, j]) ** 2
                if from_axis(axis, dx, dy, dz) <= reach + math.sqrt(square):
                    grid.found[count] = item
                    count += 1
    return count

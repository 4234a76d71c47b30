"""
Compiled gaps and contact frames of a robot on ground with cells and among pegs.

`obstacles.py` defines them, and how the contacts are numbered. A frame is (normal, e_x, e_y), in
the order of the components of an impulse; on a flat floor it is e_z and the heading of the link,
and nothing here is called.
"""

import math
from typing import NamedTuple

import numpy as np

from snake_sim_ros.contact.laws import make_disc
from snake_sim_ros.contact.laws import OtherFriction
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.compilation import merged
from snake_sim_ros.dynamics.kinematics import axis_z
from snake_sim_ros.dynamics.kinematics import floor_penetration
from snake_sim_ros.scene.obstacles import first_pair
from snake_sim_ros.scene.obstacles import first_peg
from snake_sim_ros.scene.obstacles import is_flat
from snake_sim_ros.scene.obstacles import pair_contacts
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Scene


class Obstacles(NamedTuple):
    """Ground and pegs of a scene; see `parameters.Ground` and `parameters.Pegs`."""

    heights: Array  # (rows, columns) [m]
    cell: float
    origin_x: float
    origin_y: float
    pegs: Array  # (pegs, 3) x, y, radius [m]
    first_peg: int  # number of the first contact with a peg
    first_pair: int  # and of the first one of two links
    pair_count: int


def make_obstacles(scene: Scene) -> Obstacles | None:
    """Return ground and pegs as the compiled step takes them; None if all is flat."""
    ground = scene.ground
    if is_flat(scene):
        return None
    heights = np.array(ground.heights, dtype=float)
    return Obstacles(
        heights=heights.reshape(len(ground.heights), -1) if ground.heights else np.zeros((0, 0)),
        cell=ground.cell,
        origin_x=ground.origin[0],
        origin_y=ground.origin[1],
        pegs=scene.pegs.axes,
        first_peg=first_peg(scene),
        first_pair=first_pair(scene),
        pair_count=len(pair_contacts(scene)),
    )


def make_other_friction(scene: Scene, proximal: float) -> OtherFriction | None:
    """Return isotropic friction of pegs and of links on links, for a compliance [1/kg]."""
    if is_flat(scene):
        return None
    mu, mu_pair = scene.pegs.friction, scene.self_contact_friction
    return OtherFriction(
        first_peg=first_peg(scene),
        first_pair=first_pair(scene),
        peg=make_disc(1, mu, mu, proximal),
        pair=make_disc(1, mu_pair, mu_pair, proximal),
        rolling=make_disc(3, 0.0, 0.0, proximal),
    )


@inlined
def find_contacts(obstacles, tolerance, model, work, q):
    """Fill the closed contacts, their points and frames; return how many are closed."""
    offset, radius = model.contact_offset, model.contact_radius
    if obstacles is None:
        return find_floor_contacts(
            tolerance, offset, radius, q[:, 2], work.R, work.center, work.closed, work.contacts
        )
    return find_obstacle_contacts(
        obstacles, tolerance, offset, radius, q, work.R, work.center, work.closed, work.contacts,
        work.chain.frame,
    )  # fmt: skip


@merged
def find_floor_contacts(tolerance, offset, radius, height, R, center, closed, contacts):
    """
    Fill closed contacts, their points and frames; return how many are closed.

    Deviation: a contact counts as closed up to a gap of `tolerance` [m], not of 0: gaps at the
    size of rounding do not open and close contacts.

    Deviation: a vertical link has no heading; e_x^I stands in for it, as in `reference.py`.
    """
    n = len(R)
    count = 0
    for i in range(n):
        x, y, z = R[i, 0, 2], R[i, 1, 2], R[i, 2, 2]
        for a, signed in ((i, offset[i]), (n + i, -offset[i])):
            gap = height[i] + signed * z - radius[i]
            if gap <= tolerance:
                closed[count] = a
                count += 1
                contacts.gap[a] = gap
                contacts.shift[a] = 0.0
                c = math.sqrt(x * x + y * y)
                flat = c > 1e-6
                contacts.heading[a, 0] = x / c if flat else 1.0
                contacts.heading[a, 1] = y / c if flat else 0.0
                contacts.point[a, 0] = center[i, 0] + signed * x
                contacts.point[a, 1] = center[i, 1] + signed * y
                contacts.point[a, 2] = center[i, 2] + signed * z - radius[i]
                contacts.radius[a] = radius[i]
    return count


@inlined
def penetration(obstacles, offset, radius, q):
    """Return how deep the robot is in the floor or in an obstacle [m], 0 if it is not."""
    if obstacles is None:
        return floor_penetration(offset, radius, q)
    return obstacle_penetration(obstacles, offset, radius, q)


@merged
def find_obstacle_contacts(
    obstacles, tolerance, offset, radius, q, R, center, closed, contacts, frame
):
    """Fill the contacts with gaps up to `tolerance`; see `find_floor_contacts`."""
    n, count = len(R), 0
    for i in range(n):
        axis = R[i, 0, 2], R[i, 1, 2], R[i, 2, 2]
        for side in range(2):
            arm = offset[i] if side == 0 else -offset[i]
            x, y, z = q[i, 0] + arm * axis[0], q[i, 1] + arm * axis[1], q[i, 2] + arm * axis[2]
            for k in range(4):
                gap, nx, ny, nz = ground_contact(obstacles, x, y, z, radius[i], k)
                if gap <= tolerance:
                    a = (side if k == 0 else 1 + 3 * side + k) * n + i
                    closed[count] = a
                    count += 1
                    place_contact(contacts, a, gap, arm, radius[i], axis, center[i], (nx, ny, nz))
                    contacts.link[a], contacts.other_link[a] = i, -1
                    fill_contact_frame(frame[a], (nx, ny, nz), axis)
        for k in range(len(obstacles.pegs)):
            px, py, peg_radius = obstacles.pegs[k, 0], obstacles.pegs[k, 1], obstacles.pegs[k, 2]
            reach = offset[i] + radius[i] + peg_radius + tolerance
            if (px - q[i, 0]) ** 2 + (py - q[i, 1]) ** 2 > reach * reach:
                continue
            arm, distance, nx, ny = peg_contact(
                q[i, 0], q[i, 1], axis[0], axis[1], offset[i], px, py
            )
            gap = distance - peg_radius - radius[i]
            if gap <= tolerance:
                a = obstacles.first_peg + k * n + i
                closed[count] = a
                count += 1
                place_contact(contacts, a, gap, arm, radius[i], axis, center[i], (nx, ny, 0.0))
                contacts.link[a], contacts.other_link[a] = i, -1
                set_axis(frame[a], 0, (nx, ny, 0.0))
                set_axis(frame[a], 1, (-ny, nx, 0.0))
                set_axis(frame[a], 2, (0.0, 0.0, 1.0))
    if obstacles.pair_count > 0:
        count = find_pair_contacts(
            obstacles.first_pair, tolerance, offset, radius, q, R, center, closed, contacts, frame,
            count,
        )  # fmt: skip
    return count


@merged
def find_pair_contacts(a, tolerance, offset, radius, q, R, center, closed, contacts, frame, count):
    """Fill the contacts of links with each other, from number a on; return how many are closed."""
    n = len(R)
    for i in range(n):
        axis = R[i, 0, 2], R[i, 1, 2], R[i, 2, 2]
        for j in range(i + 2, n):
            x, y, z = q[i, 0] - q[j, 0], q[i, 1] - q[j, 1], q[i, 2] - q[j, 2]
            reach = offset[i] + offset[j] + radius[i] + radius[j] + tolerance
            if x * x + y * y + z * z > reach * reach:
                a += 4
                continue
            for side in range(4):
                arm = offset[i] if side < 2 else -offset[i]
                other = offset[j] if side % 2 == 0 else -offset[j]
                dx = x + arm * axis[0] - other * R[j, 0, 2]
                dy = y + arm * axis[1] - other * R[j, 1, 2]
                dz = z + arm * axis[2] - other * R[j, 2, 2]
                distance = math.sqrt(dx * dx + dy * dy + dz * dz)
                gap = distance - radius[i] - radius[j]
                if gap <= tolerance:
                    closed[count] = a
                    count += 1
                    normal = dx / distance, dy / distance, dz / distance
                    place_contact(contacts, a, gap, arm, radius[i], axis, center[i], normal)
                    contacts.link[a], contacts.other_link[a] = i, j
                    fill_contact_frame(frame[a], normal, axis)
                a += 1
    return count


@merged
def obstacle_penetration(obstacles, offset, radius, q):
    """Return how deep the robot is in the ground or in a peg [m], 0 if it is not."""
    lowest = 0.0
    for i in range(len(q)):
        axis = axis_z(q, i)
        for side in range(2):
            arm = offset[i] if side == 0 else -offset[i]
            x, y, z = q[i, 0] + arm * axis[0], q[i, 1] + arm * axis[1], q[i, 2] + arm * axis[2]
            for k in range(4):
                gap, _, _, _ = ground_contact(obstacles, x, y, z, radius[i], k)
                lowest = min(lowest, gap)
        for k in range(len(obstacles.pegs)):
            _, distance, _, _ = peg_contact(
                q[i, 0], q[i, 1], axis[0], axis[1], offset[i],
                obstacles.pegs[k, 0], obstacles.pegs[k, 1],
            )  # fmt: skip
            lowest = min(lowest, distance - obstacles.pegs[k, 2] - radius[i])
        if obstacles.pair_count > 0:
            for j in range(i + 2, len(q)):
                for side in range(4):
                    arm = offset[i] if side < 2 else -offset[i]
                    other = offset[j] if side % 2 == 0 else -offset[j]
                    square, beyond = 0.0, axis_z(q, j)
                    for k in range(3):
                        square += (q[i, k] + arm * axis[k] - q[j, k] - other * beyond[k]) ** 2
                    lowest = min(lowest, math.sqrt(square) - radius[i] - radius[j])
    return -lowest


@inlined
def peg_contact(x, y, axis_x, axis_y, half, peg_x, peg_y):
    """
    Return where the axis of a link is nearest to the axis of a peg, seen from above.

    Parameters
    ----------
    x, y : float
        Center of the link [m].
    axis_x, axis_y : float
        Unit vector along the link, its horizontal part; 1 long in a plane.
    half : float
        Half the length of the axis [m].
    peg_x, peg_y : float
        [m]

    Returns
    -------
    arm : float
        From the center of the link to the nearest point of its axis [m].
    distance : float
        Of this point from the axis of the peg [m].
    normal_x, normal_y : float
        Direction of this point from the peg.

    """
    apart_x, apart_y = peg_x - x, peg_y - y
    square = axis_x * axis_x + axis_y * axis_y
    along = (apart_x * axis_x + apart_y * axis_y) / square if square > 1e-12 else 0.0
    arm = min(max(along, -half), half)
    dx, dy = arm * axis_x - apart_x, arm * axis_y - apart_y
    distance = math.sqrt(dx * dx + dy * dy)
    if distance > 0.0:
        return arm, distance, dx / distance, dy / distance
    return arm, distance, 1.0, 0.0


@inlined
def ground_contact(obstacles, x, y, z, radius, k):
    """
    Return gap and normal of a sphere at the box below one of four cells; an open gap if none.

    The cells are the one below the sphere, and its neighbors along x, along y and diagonally on
    the side where they are nearer.
    """
    cell = obstacles.cell
    column = math.floor((x - obstacles.origin_x) / cell)
    row = math.floor((y - obstacles.origin_y) / cell)
    own = cell_top(obstacles, column, row)
    if k == 0:
        return z - own - radius, 0.0, 0.0, 1.0
    side_x = -1 if x < obstacles.origin_x + cell * (column + 0.5) else 1
    side_y = -1 if y < obstacles.origin_y + cell * (row + 0.5) else 1
    beyond_x, beyond_y = side_x if k != 2 else 0, side_y if k != 1 else 0
    top = cell_top(obstacles, column + beyond_x, row + beyond_y)
    if top <= own:
        return math.inf, 0.0, 0.0, 1.0
    dx = dy = 0.0
    if k != 2:
        dx = x - (obstacles.origin_x + cell * (column + 0.5) + side_x * cell / 2)
    if k != 1:
        dy = y - (obstacles.origin_y + cell * (row + 0.5) + side_y * cell / 2)
    dz = max(0.0, z - top)
    if k == 3:
        along_x = cell_top(obstacles, column + side_x, row)
        along_y = cell_top(obstacles, column, row + side_y)
        if max(along_x, along_y) >= min(z, top):  # on the box of another neighbor, too
            return math.inf, 0.0, 0.0, 1.0
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    if distance > 0.0:
        return distance - radius, dx / distance, dy / distance, dz / distance
    return -radius, 0.0, 0.0, 1.0


@inlined
def cell_top(obstacles, column, row):
    """Return the height of a cell [m]."""
    heights = obstacles.heights
    if 0 <= row < heights.shape[0] and 0 <= column < heights.shape[1]:
        return heights[row, column]
    return 0.0


@inlined
def place_contact(contacts, a, gap, arm, radius, axis, center, normal):
    """Fill the point of contact a: on the sphere around a point of the link axis."""
    contacts.gap[a] = gap
    contacts.shift[a] = 0.0
    contacts.radius[a] = radius
    for k in range(3):
        contacts.point[a, k] = center[k] + arm * axis[k] - radius * normal[k]


@inlined
def fill_contact_frame(frame, normal, axis):
    """
    Fill a frame with e_x along a link and e_y across it, in the tangent plane.

    Deviation: a link at right angles to the plane has no direction in it; e_x of I, or e_y of I at
    a wall across e_x, stands in for its axis.
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

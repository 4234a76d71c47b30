# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Arrays and scenes from messages: the inverse of `state_messages` and `state_publishers`.

The functions read the attributes of a message, so rclpy or a reader of bags may have made it. They
need nothing of ROS.

In messages, which is called on the wire, a link frame has x along the link toward the next one, y
to the left and z up when the link lies flat (REP 103); its axes are e_z, e_x and e_y of the
paper's frame B. Quaternions on the wire are x y z w.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array, Ground, Pegs, Robot, Scene
from snake_sim_ros.scene.posture import from_own_poses
from snake_sim_ros.scene.robot_description import robot_of
from snake_sim_ros.scene.rotations import B_TO_WIRE, product
from snake_sim_ros.scene.surfaces import Surface

# Euler parameters of B, scalar first, times this matrix are the quaternion x y z w on the wire.
TO_WIRE = product(np.eye(4), B_TO_WIRE)[:, [1, 2, 3, 0]]
FORCE_SCALE = 0.02  # length of the line of a force [m/N]
# Types of visualization_msgs/Marker.
CYLINDER, LINE_LIST, CUBE_LIST, SPHERE_LIST, TRIANGLE_LIST = 3, 5, 6, 7, 11
ADD = 0  # its action
MOST_CELLS = 1000  # of a ground, in a row and in a column


def poses(message: Any, robot: Robot) -> tuple[Array, Array]:
    """
    Return the poses of all links from a geometry_msgs/PoseArray.

    Returns
    -------
    position : ndarray, shape (n, 3)
        [m]
    orientation : ndarray, shape (n, 4)
        Euler parameters of the link frames B, scalar first.

    """
    rows = [(pose.position, pose.orientation) for pose in message.poses]
    numbers = np.array([(r.x, r.y, r.z, p.x, p.y, p.z, p.w) for r, p in rows]).reshape(-1, 7)
    if robot.links and len(numbers) == robot.link_count:
        q = from_own_poses(robot, numbers[:, :3], numbers[:, [6, 3, 4, 5]])
        return q[:, :3], q[:, 3:]
    return numbers[:, :3], numbers[:, 3:] @ TO_WIRE.T


def joint_axes(names: Sequence[str], values: Sequence[float], robot: Robot) -> Array:
    """
    Return values of joints by name, shape (n-1, 2) as yaw and pitch; nan where there is none.

    Parameters
    ----------
    names : sequence of str
    values : sequence of float
        One for each name; empty if the message has none.
    robot : Robot

    """
    given = dict(zip(names, values, strict=False))
    return robot.by_joint(np.array([given.get(name, np.nan) for name in robot.axis_names]))


def contacts(markers: Iterable[Any]) -> tuple[Array, Array] | None:
    """
    Return points [m] and forces [N] of the contacts, shape (k, 3) each; None if markers say none.

    Parameters
    ----------
    markers : iterable of visualization_msgs/Marker

    """
    lines = [item for item in markers if (item.ns, item.type) == ('contacts', LINE_LIST)]
    if not lines:
        return None
    ends = lines[-1].points if lines[-1].action == ADD else []
    ends = np.array([(point.x, point.y, point.z) for point in ends]).reshape(-1, 2, 3)
    return ends[:, 0], (ends[:, 1] - ends[:, 0]) / FORCE_SCALE


def scene_of(urdf: str, markers: Iterable[Any] = ()) -> Scene:
    """
    Return what there is to see: the robot of a description, pegs and ground of markers.

    Friction, gains and gait are not in them: those are defaults.

    Parameters
    ----------
    urdf : str
        As `robot_description` writes it.
    markers : iterable of visualization_msgs/Marker

    Raises
    ------
    ParameterError
        If the description is not that of a chain of links as `robot_description` writes it.

    """
    there = [item for item in markers if item.ns == 'scene' and item.action == ADD]
    pegs = [item for item in there if item.type == CYLINDER]
    ground = [item for item in there if item.type == CUBE_LIST]
    return Scene(
        robot=robot_of(urdf),
        pegs=Pegs(
            x=tuple(peg.pose.position.x for peg in pegs),
            y=tuple(peg.pose.position.y for peg in pegs),
            radius=tuple(peg.scale.x / 2 for peg in pegs) or Pegs().radius,
        ),
        ground=_ground(ground[-1]) if ground else Ground(),
    )


def solids(markers: Iterable[Any]) -> list[Surface]:
    """
    Return the surfaces of the solids of a world, as `surfaces.surfaces_of` does.

    Parameters
    ----------
    markers : iterable of visualization_msgs/Marker

    """
    found = []
    for marker in markers:
        if (marker.ns, marker.type, marker.action) == ('world', TRIANGLE_LIST, ADD):
            points = np.array([(point.x, point.y, point.z) for point in marker.points])
            points = points.reshape(-1, 3)[: len(points) // 3 * 3]
            vertices, corners = np.unique(points, axis=0, return_inverse=True)
            if len(points) and np.isfinite(points).all():
                found.append((vertices, corners.reshape(-1, 3)))
    return found


def _ground(marker: Any) -> Ground:
    """Return the cells of boxes that are all of one size."""
    cell, height = marker.scale.x, marker.scale.z
    points = np.array([(point.x, point.y, point.z) for point in marker.points])
    corner = points.min(axis=0) - cell / 2
    with np.errstate(all='ignore'):
        places = np.round((points[:, :2] - corner[:2]) / cell - 0.5)
    if not (np.isfinite(places).all() and 0 <= places.min() and places.max() < MOST_CELLS):
        raise ParameterError(
            f'the ground in the markers must have at most {MOST_CELLS} by {MOST_CELLS} cells'
        )
    columns, rows = places.astype(int).T
    heights = np.zeros((rows.max() + 1, columns.max() + 1))
    heights[rows, columns] = points[:, 2] + height / 2
    return Ground(
        heights=tuple(map(tuple, heights.tolist())), cell=cell, origin=tuple(corner[:2].tolist())
    )

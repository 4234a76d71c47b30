# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Markers: what viewers draw besides the robot, its contacts and its obstacles.

Namespace `contacts` has the contact points as spheres (id 0) and the forces on the robot as lines
that begin there (id 1), with a length of FORCE_SCALE for each newton. Without contacts both are
deleted. Namespace `scene` has the ground as one list of boxes (id 0) and the pegs as cylinders
(ids from 1). Namespace `patches` has patches of friction as one list of plates (id 0). All markers
are in frame `world` and have no lifetime: they stay until replaced.
"""

from collections.abc import Iterable

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
import numpy as np
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from snake_sim_ros.nodes.state_messages import WORLD
from snake_sim_ros.recording.from_messages import FORCE_SCALE
from snake_sim_ros.scene.obstacles import cell_centers, FOUNDATION, PEG_HEIGHT
from snake_sim_ros.scene.parameters import Array, Ground, Patches, Scene

POINT_SIZE = 0.012  # m
LINE_WIDTH = 0.004  # m
PLATE = 0.002  # m, thickness of patches
MARKER_PERIOD = 1 / 30  # s between two messages at least, which is enough for the eye
COLORS = {
    'point': (1.0, 1.0, 1.0, 1.0),
    'force': (0.1, 0.8, 0.3, 1.0),
    'ground': (0.55, 0.55, 0.58, 1.0),
    'peg': (0.35, 0.45, 0.65, 1.0),
}


class SceneMarkers:
    """
    The markers of one scene, made once and filled again for every state.

    Attributes
    ----------
    message : MarkerArray

    """

    def __init__(self, scene: Scene) -> None:
        self.points = _marker('contacts', 0, Marker.SPHERE_LIST, 'point', [POINT_SIZE] * 3)
        self.forces = _marker('contacts', 1, Marker.LINE_LIST, 'force', [LINE_WIDTH, 0, 0])
        markers = [self.points, self.forces]
        if scene.ground.heights:
            markers.append(_ground(scene.ground))
        if scene.patches.factors:
            markers.append(_patches(scene.patches))
        height = PEG_HEIGHT * scene.robot.per_link('contact_radius').max()
        for k, (x, y, radius) in enumerate(scene.pegs.axes, 1):
            peg = _marker('scene', k, Marker.CYLINDER, 'peg', [2 * radius, 2 * radius, height])
            peg.pose.position = _point((x, y, height / 2))
            markers.append(peg)
        self.message = MarkerArray(markers=markers)

    def fill(self, stamp: Time, points: Array, forces: Array) -> None:
        """
        Fill the message with contacts.

        Parameters
        ----------
        stamp : Time
        points, forces : ndarray, shape (k, 3)
            Contact points [m] and forces on the robot [N], as `contact_forces` returns them.

        """
        action = Marker.ADD if len(points) else Marker.DELETE
        ends = np.stack([points, points + FORCE_SCALE * forces], axis=1).reshape(-1, 3)
        for marker, entries in ((self.points, points), (self.forces, ends)):
            marker.action = action
            marker.points = [_point(entry) for entry in entries.tolist()]
        for marker in self.message.markers:
            marker.header.stamp = stamp


def _ground(ground: Ground) -> Marker:
    """Return the cells of the ground as boxes of one size, as a list of boxes must have."""
    heights = np.array(ground.heights)
    lowest = min(0.0, heights.min()) - FOUNDATION
    size = [ground.cell, ground.cell, heights.max() - lowest]
    marker = _marker('scene', 0, Marker.CUBE_LIST, 'ground', size)
    centers = np.dstack([cell_centers(ground), heights - size[2] / 2]).reshape(-1, 3)
    marker.points = [_point(center) for center in centers.tolist()]
    return marker


def _patches(patches: Patches) -> Marker:
    """Return patches as plates just below the floor, the darker the more friction they have."""
    marker = _marker('patches', 0, Marker.CUBE_LIST, 'ground', [patches.cell, patches.cell, PLATE])
    for (row, column), factor in np.ndenumerate(np.array(patches.factors)):
        x, y = patches.origin + patches.cell * (np.array([column, row]) + 0.5)
        marker.points.append(_point((x, y, -PLATE / 2)))
        shade = 1.0 / (1.0 + float(factor))
        marker.colors.append(ColorRGBA(r=shade, g=shade, b=shade, a=1.0))
    return marker


def _marker(namespace: str, number: int, kind: int, color: str, scale: Iterable[float]) -> Marker:
    """Return a marker without points; its scale is in metres."""
    marker = Marker(ns=namespace, id=number, type=kind, action=Marker.ADD)
    marker.header.frame_id = WORLD
    marker.scale.x, marker.scale.y, marker.scale.z = map(float, scale)
    marker.color.r, marker.color.g, marker.color.b, marker.color.a = COLORS[color]
    return marker


def _point(entry: Iterable[float]) -> Point:
    """Return three numbers as a message."""
    x, y, z = entry
    return Point(x=float(x), y=float(y), z=float(z))

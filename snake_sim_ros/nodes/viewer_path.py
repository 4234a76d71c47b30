# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The path on the viewer's page: the one to follow, and one that a person draws.

Both ways lead over the topic `path`: a drawn path is published, and whatever comes is shown, as
the node `follow` takes it.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path as PathMessage
import numpy as np
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import QoSProfile

from snake_sim_ros.controllers.paths import PlanarPath
from snake_sim_ros.nodes.follow_node import path_from
from snake_sim_ros.nodes.messages import LATCHED, WORLD
from snake_sim_ros.nodes.viewer_controls import Controls
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.following import Following
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.view.page import NO_PATH, SECONDARY

APART = 0.05  # m; a click that is nearer to the point before is the second half of a double one
OWN_READERS = 2  # subscriptions of the viewer itself
HINT = 'Click on the floor, point by point, then press Follow.'
TOO_FEW = 'A path needs two points or more: press *Draw a path* and click on the floor.'
UNHEARD = 'Nobody hears the path: start the node `follow`.'


class PathDrawing:
    """
    Shows the path that the robot is to follow, and publishes one that is drawn by clicks.

    Parameters
    ----------
    node
        A Node that has `warn`, as the viewer.
    controls : Controls
    following : Following
        The path at the start, if there is one, and whether paths are closed.
    place : callable
        Returns where the robot is, x and y [m], or None; a path that is drawn begins there.

    """

    def __init__(
        self,
        node: Any,
        controls: Controls,
        following: Following,
        place: Callable[[], Array | None],
    ) -> None:
        self.page, self.controls, self.warn = controls.page, controls, node.warn
        self.closed, self.place = following.closed, place
        self.path = PlanarPath.of(following) if following else None
        self.is_drawing, self.clicked = False, list[Array]()
        self.paths = node.create_publisher(PathMessage, 'path', LATCHED)
        # A path that is kept for late readers may have come before this node.
        node.create_subscription(PathMessage, 'path', self._on_path, QoSProfile(depth=1))
        silent = SubscriptionEventCallbacks(use_default_callbacks=False)
        node.create_subscription(
            PathMessage, 'path', self._on_path, LATCHED, event_callbacks=silent
        )
        self._add_controls()
        self._show()

    def add(self, point: Array) -> None:
        """Add a point that was clicked, (2,) [m]."""
        if not self.is_drawing:  # it was under way meanwhile
            return
        if not self.clicked or np.hypot(*(point - self.clicked[-1])) > APART:
            self.clicked.append(point)
            self._show()
            self._tell(f'{HINT} Points: {len(self.clicked)}.')

    @property
    def points(self) -> Array:
        """Points of the path that is drawn, (k, 2) [m]: where the robot is, and the clicks."""
        place = self.place()
        if place is None or not self.clicked or np.hypot(*(self.clicked[0] - place)) <= APART:
            return np.reshape(self.clicked, (-1, 2))
        return np.vstack([place, *self.clicked])

    # ---- on the page ----------------------------------------------------------------------------

    def _add_controls(self) -> None:
        gui = self.page.gui
        with gui.add_folder('Path', order=self.page.controls.order + 0.5):  # right after them
            self._remark = gui.add_markdown('', visible=False)
            for name, action in (
                ('Draw a path', self.draw),
                ('Follow', self.follow),
                ('Clear', self.clear),
            ):
                self.controls.when(gui.add_button(name, color=SECONDARY).on_click, action)

    def _tell(self, sentence: str) -> None:
        self._remark.visible, self._remark.content = bool(sentence), sentence

    def _show(self) -> None:
        points = self.points
        drawn = PlanarPath.spline(points, closed=self.closed).points if len(points) > 1 else points
        clicked = np.reshape(self.clicked, (-1, 2))
        self.page.show_guide(self.path.points if self.path else NO_PATH, drawn, clicked)

    def _begin(self, *, drawing: bool) -> None:
        """Forget the points, and listen for clicks or not."""
        self.is_drawing, self.clicked = drawing, []
        self.page.pick(self._note if drawing else None)
        self._show()

    def _note(self, point: Array) -> None:
        """Queue a point that was clicked; viser calls in another thread."""
        self.controls.actions.put(partial(self.add, point))

    # ---- what a person does ---------------------------------------------------------------------

    def draw(self) -> None:
        """Begin a new path; the one that is followed stays."""
        self._begin(drawing=True)
        self._tell(HINT)

    def follow(self) -> None:
        """Publish the path that is drawn."""
        points = self.points
        if len(points) < 2:
            self._tell(TOO_FEW)
            return
        self._begin(drawing=False)
        self.paths.publish(path_message(points))
        self._tell('' if self.paths.get_subscription_count() > OWN_READERS else UNHEARD)

    def clear(self) -> None:
        """Drop what is drawn, and the path that is followed: the robot stops."""
        self._begin(drawing=False)
        self._tell('')
        if self.path:
            self.paths.publish(path_message(NO_PATH))

    def _on_path(self, message: PathMessage) -> None:
        try:
            self.path = path_from(message, self.closed)
        except ParameterError as error:
            self.warn('path', f'path: {error}')
            return
        self._show()


def path_message(points: Array) -> PathMessage:
    """Return a path through points (k, 2) [m, frame I]."""
    message = PathMessage()
    message.header.frame_id = WORLD
    for x, y in points.tolist():
        message.poses.append(PoseStamped())
        at = message.poses[-1].pose.position
        at.x, at.y = x, y
    return message

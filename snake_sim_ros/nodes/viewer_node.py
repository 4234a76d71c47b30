# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The `viewer` node: it shows a robot in a browser, from the public topics.

It knows no simulator: the joint_states of any robot with our joint names are enough. The posture
comes from link_poses or else from the joint angles, the place from odom or else it is the origin.

Messages come up to a thousand times a second. The node looks for them thirty times a second, or
ten times if no browser is connected; of each topic only the last message waits.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
import math
import sys
from threading import Event
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from nav_msgs.msg import Odometry
import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from snake_sim_ros.nodes.diagnostics import is_paused, shown
from snake_sim_ros.nodes.executors import CountingExecutor, Server, ThrottledWarnings
from snake_sim_ros.nodes.messages import EPOCH, LATCHED, seconds_from
from snake_sim_ros.nodes.node_parameters import ParameterRequests, settle
from snake_sim_ros.nodes.node_process import run_node
from snake_sim_ros.nodes.viewer_controls import Controls
from snake_sim_ros.nodes.viewer_path import PathDrawing
from snake_sim_ros.recording import from_messages
from snake_sim_ros.scene.checked_records import CheckedRecord, ParameterError, quantity
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.surfaces import Surface
from snake_sim_ros.view.frames import Frame, placed, TraceBuffer
from snake_sim_ros.view.page import announce, Page, PLOT_PERIOD, SHOW_PERIOD

UNWATCHED_PERIOD = 0.1  # s between two looks for messages if no browser is connected
SERVING = 0.01  # s for which requests are served before the page is brought up to date
STALE = 1.0  # s by which a pose may be older or newer than the joint angles
LAST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
NO_POINTS = np.zeros((0, 3))


@dataclass(frozen=True, kw_only=True)
class Settings(CheckedRecord):
    """Parameters of the node."""

    host: str = quantity('127.0.0.1', '', 'address of this machine to serve the page at')
    port: int = quantity(
        8080, '1', 'port of the page; 0 = any free port', minimum=0, maximum=65535
    )
    scene: str = quantity(
        'lateral_undulation',
        '',
        'scene: its path, and its robot until a robot_description arrives',
    )
    open_browser: bool = quantity(False, '', 'open the page in a browser')


class ViewerNode(Node):
    """Subscribes to the topics of a robot and keeps a page up to date with them."""

    def __init__(self) -> None:
        super().__init__(
            'viewer',
            automatically_declare_parameters_from_overrides=True,
            start_parameter_services=False,
        )
        ParameterRequests(self)
        settings, scene = settle(self, Settings, ())
        self.page = Page('snake robot', settings.host, settings.port)
        self.warn = ThrottledWarnings(self)
        self.physics = f'{self.get_namespace()}/sim: physics'.lstrip('/')
        self.latest: dict[str, Any] = {}  # topic -> last message
        self.messages = 0  # that came on the topics of a robot
        self.status: dict[str, str] = {}
        self.obstacles: list[Any] = []
        self.world: list[Any] = []
        self.solids: list[Surface] = []
        self.origin: float | None = None  # stamp at which time begins [s]
        self.plotted = -math.inf  # wall time [s]
        self.frame: Frame | None = None
        self.was_watched = False
        self.new = False  # whether joint_states or link_poses came since the last update
        self._build(Scene(robot=scene.robot))
        for kind, topic in (
            (JointState, 'joint_states'),
            (PoseArray, 'link_poses'),
            (Odometry, 'odom'),
            (JointState, 'joint_command'),
        ):
            self._listen(kind, topic, LAST)
        self._listen(MarkerArray, 'markers', QoSProfile(depth=1), self._on_markers)
        self._listen(String, 'robot_description', LATCHED, self._on_description)
        self._listen(DiagnosticArray, '/diagnostics', QoSProfile(depth=10), self._on_diagnostics)
        self.controls = Controls(self, self.page, self._begin_again)
        self.drawing = PathDrawing(self, self.controls, scene.follow, self._place)
        announce(self.page, settings.open_browser)

    def update(self) -> None:
        """Bring the page up to date with the messages that came."""
        changed, now = self.page.changed(), time.monotonic()
        if self.new:
            self.new = False
            self.frame = self._frame()
            self.trace_buffer.add(self.frame)
            changed = True
        frame = self.frame if self.page.watched else None
        if frame is not None and (changed or not self.was_watched):
            self.page.show(frame)
        self.was_watched = frame is not None
        if now - self.plotted >= PLOT_PERIOD:
            self.plotted = now
            self.controls.act()
            if frame is not None:
                distance = f'{self.trace_buffer.distance(frame):.3f} m'
                self.page.tell(frame, {'distance': distance, **self.status})
                self.page.plot(self.trace_buffer.trace)

    def _listen(
        self,
        kind: Any,
        topic: str,
        qos: QoSProfile,
        then: Callable[[Any], None] = lambda message: None,
    ) -> None:
        def keep_latest(message: Any) -> None:
            self.messages += 1
            self.new = self.new or topic in ('joint_states', 'link_poses')
            self.latest[topic] = message
            then(message)

        self.create_subscription(kind, topic, keep_latest, qos)

    # ---- what there is to see -------------------------------------------------------------------

    def _build(self, scene: Scene) -> None:
        self.scene = scene
        self.page.build(scene, self.solids)
        self._begin_again()

    def _begin_again(self) -> None:
        """Forget the past of the robot."""
        self.trace_buffer = TraceBuffer(self.scene.robot)
        self.frame = None
        self.was_watched = False

    def _on_description(self, _: String) -> None:
        """Forget the world, which may be that of another `sim`, and show the robot."""
        had_solids = bool(self.solids)
        self.world, self.solids = [], []
        self._show_scene(is_new=had_solids)

    def _show_scene(self, *, is_new: bool) -> None:
        """Build the page again if there is something new to see, or the scene is another one."""
        markers = self.latest['markers'].markers if 'markers' in self.latest else ()
        try:
            scene = from_messages.scene_of(self.latest['robot_description'].data, markers)
        except ParameterError as error:
            self.warn('description', f'robot_description: {error}')
            return
        if is_new or scene != self.scene:
            self._build(scene)

    def _on_markers(self, message: MarkerArray) -> None:
        obstacles, world = looks(message.markers, 'scene'), looks(message.markers, 'world')
        is_new = bool(world) and world != self.world  # which is in few messages
        if is_new:
            self.world, self.solids = world, from_messages.solids(message.markers)
        if (is_new or obstacles != self.obstacles) and 'robot_description' in self.latest:
            self.obstacles = obstacles
            self._show_scene(is_new=is_new)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == self.physics:
                self.status = shown(status)
                self.controls.paused = is_paused(status)

    # ---- what the robot does --------------------------------------------------------------------

    def _frame(self) -> Frame:
        """Return the robot as the last messages describe it."""
        robot, joints, commands = (
            self.scene.robot,
            self.latest.get('joint_states'),
            self.latest.get('joint_command'),
        )
        count = robot.link_count - 1
        unknown = np.full((count, 2), math.nan)
        angle = torque = reference = unknown
        if joints is not None:
            angle = from_messages.joint_axes(joints.name, joints.position, robot)
            torque = from_messages.joint_axes(joints.name, joints.effort, robot)
        if commands is not None:
            reference = from_messages.joint_axes(commands.name, commands.position, robot)
        position, orientation = self._poses(angle)
        markers = self.latest.get('markers')
        touched = from_messages.contacts(markers.markers) if markers is not None else None
        points, forces = touched or (NO_POINTS, NO_POINTS)
        return Frame(self._time(), position, orientation, angle, torque, reference, points, forces)

    def _place(self) -> Array | None:
        """Return the center of the links, x and y [m]; None before the robot is known."""
        return None if self.frame is None else self.frame.position[:, :2].mean(axis=0)

    def _poses(self, angle: Array) -> tuple[Array, Array]:
        """Return position [m] and Euler parameters of all links, shape (n, 3) and (n, 4)."""
        robot, poses, odom = self.scene.robot, self._fresh('link_poses'), self._fresh('odom')
        if poses is not None and len(poses.poses) == robot.link_count:
            return from_messages.poses(poses, robot)
        if poses is not None:
            self.warn(
                'links',
                f'link_poses has {len(poses.poses)} links, the robot that is shown '
                f'{robot.link_count}: set it with robot_description or the parameter scene',
            )
        q = placed(robot, np.nan_to_num(angle), None if odom is None else base_of(odom))
        return q[:, :3], q[:, 3:]

    def _stamp(self, topic: str) -> float:
        """Return the stamp of the last message of a topic [s], -inf if there is none."""
        message = self.latest.get(topic)
        return -math.inf if message is None else seconds_from(message.header.stamp)

    def _fresh(self, topic: str) -> Any:
        """Return the last message of a topic, unless joint_states have another time."""
        joints = self._stamp('joint_states')
        old = abs(self._stamp(topic) - joints) > STALE and joints > -math.inf
        return None if old else self.latest.get(topic)

    def _time(self) -> float:
        """Return the time of the robot [s]; that of a wall clock counts from the first message."""
        stamp = self._stamp('joint_states')
        if stamp == -math.inf:
            stamp = self._stamp('link_poses')
        if self.origin is None or not 0.0 <= stamp - self.origin < EPOCH:
            self.origin = stamp if stamp > EPOCH else 0.0
        return stamp - self.origin


def looks(markers: Iterable[Any], namespace: str) -> list[Any]:
    """Return what tells the markers of a namespace from others, without all of their points."""
    return [
        (item.type, item.action, item.pose, item.scale, len(item.points), item.points[:1])
        for item in markers
        if item.ns == namespace
    ]


def base_of(odom: Odometry) -> tuple[Array, Array]:
    """Return position [m] and Euler parameters, scalar first, of the frame `base_link`."""
    place, turn = odom.pose.pose.position, odom.pose.pose.orientation
    return np.array([place.x, place.y, place.z]), np.array([turn.w, turn.x, turn.y, turn.z])


def serve_rounds(node: ViewerNode, executor: CountingExecutor, server: Server) -> None:
    """
    Serve what waits in rounds, which take one message of a topic and one request of a service.

    Another round follows only after a request, since of a topic the last message is enough.
    """
    end, requests = time.monotonic() + SERVING, True
    while requests and time.monotonic() < end:
        node.messages, executor.served, before = 0, 0, -1
        while executor.served > before:  # The last look of a round finds nothing.
            before = executor.served
            server.spin_once(timeout_sec=0)
        requests = executor.served > node.messages


def run_viewer(node: ViewerNode, stop: Event) -> None:
    """Look for messages and bring the page up to date, again and again."""
    executor = CountingExecutor()
    executor.add_node(node)
    server = Server(executor, node.warn)
    try:
        while not stop.is_set():
            begin = time.monotonic()
            serve_rounds(node, executor, server)
            node.update()
            period = SHOW_PERIOD if node.page.watched else UNWATCHED_PERIOD
            stop.wait(max(period - (time.monotonic() - begin), 0.0))
    finally:
        node.page.close()


def main(args: list[str] | None = None) -> int:
    """Run the node until a signal ends it."""
    return run_node(ViewerNode, run_viewer, args)


if __name__ == '__main__':
    sys.exit(main())

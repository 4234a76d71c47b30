# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The `follow` node: steers a robot along a path by `cmd_vel`, which the node `gait` follows.

The node hears `path` and the poses of all links on `link_poses`, from the simulator or from motion
capture, and knows nothing else of the robot. A path on the topic takes the place of that of the
scene; an empty one, the end of an open path, and poses that do not come stop the robot.
"""

from dataclasses import dataclass
import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseArray, Twist, TwistStamped
from nav_msgs.msg import Path as PathMessage
import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64

from snake_sim_ros.controllers.following import LineOfSight, speed_along
from snake_sim_ros.controllers.paths import PlanarPath
from snake_sim_ros.gaits.steering import Steering, Stride
from snake_sim_ros.nodes.executors import serve, ThrottledWarnings
from snake_sim_ros.nodes.gait_inputs import link_poses
from snake_sim_ros.nodes.messages import LATCHED, ODOM, WORLD
from snake_sim_ros.nodes.node_parameters import parameter_fields, ParameterRequests, settle
from snake_sim_ros.nodes.node_process import run_node
from snake_sim_ros.scene.checked_records import CheckedRecord, ParameterError, quantity, quoted
from snake_sim_ros.scene.following import Following, points_of
from snake_sim_ros.scene.parameters import Array, Scene, with_settings

STOPPED = Steering(0.0, 0.0)
FIXED = ('points', 'closed', 'center', 'radius', 'period')  # as long as the node runs
GAINS = tuple(
    name
    for name in parameter_fields(Following(), 'follow.')
    if name.partition('.')[2] not in FIXED
)


@dataclass(frozen=True, kw_only=True)
class Settings(CheckedRecord):
    """Parameters of the node besides those of `follow` in the scene."""

    scene: str = quantity(
        'lateral_undulation', '', 'scene with gait, robot and, maybe, path: a YAML file or a name'
    )
    robot_description: str = quantity(
        '', '', 'robot in place of that of the scene: a URDF, or the name of its file',
        longest=10**6,
    )  # fmt: skip
    tolerance: float = quantity(
        0.1, 'm', 'distance from the end of an open path at which the robot stops', minimum=0
    )
    pose_timeout: float = quantity(
        1.0, 's', 'the robot stops if no poses arrive for this long', above=0, maximum=3600
    )
    use_stamped_vel: bool = quantity(False, '', 'publish TwistStamped instead of Twist')


def path_from(message: PathMessage, closed: bool) -> PlanarPath | None:
    """
    Return the path of a message, a spline through its positions; None if it is empty.

    Raises
    ------
    ParameterError
        If its frame is not the world's, or its points are not those of a path.

    """
    frame = message.header.frame_id.lstrip('/')
    if frame not in ('', WORLD, ODOM):
        raise ParameterError(f'the frame must be {WORLD} or {ODOM}, got {quoted(frame)}')
    places = [item.pose.position for item in message.poses]
    if not places:
        return None
    return PlanarPath.spline(points_of('poses', [(at.x, at.y) for at in places]), closed=closed)


class FollowNode(Node):
    """Publishes the velocity that leads the robot along its path."""

    def __init__(self) -> None:
        super().__init__(
            'follow',
            automatically_declare_parameters_from_overrides=True,
            start_parameter_services=False,
        )
        ParameterRequests(self)
        self.settings, self.scene = settle(self, Settings, ('follow.',), GAINS)
        self.add_on_set_parameters_callback(self._on_set_parameters)
        self.add_post_set_parameters_callback(self._on_parameters_set)
        self.warn = ThrottledWarnings(self)
        self.path: PlanarPath | None = None
        self.guidance: LineOfSight | None = None
        self.places: Array | None = None
        self.heard = self.latest = 0  # time of the last poses, and of the last period [ns]
        self.why = 'waiting for a path'  # the robot stands
        self.is_moving = False
        stamped = self.settings.use_stamped_vel
        self.commands = self.create_publisher(TwistStamped if stamped else Twist, 'cmd_vel', 1)
        self.error = self.create_publisher(Float64, 'cross_track_error', 10)
        self.diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        # A path that is kept for late readers may have come before this node.
        self.create_subscription(PathMessage, 'path', self._on_path, QoSProfile(depth=1))
        silent = SubscriptionEventCallbacks(use_default_callbacks=False)
        self.create_subscription(
            PathMessage, 'path', self._on_path, LATCHED, event_callbacks=silent
        )
        sensor = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.create_subscription(PoseArray, 'link_poses', self._on_poses, sensor)
        following = self.scene.follow
        self._follow(PlanarPath.of(following) if following else None)
        self.create_timer(following.period, self.control)
        self.create_timer(1.0, self.report)

    def _follow(self, path: PlanarPath | None) -> None:
        """Follow another path from here on, or none."""
        following, gait = self.scene.follow, self.scene.gait
        stride = Stride.of(gait, self.scene.friction)
        speed = speed_along(following, gait, stride)
        self.path = path
        self.guidance = LineOfSight(following, path, stride, speed) if path else None
        self.why = '' if path else 'waiting for a path'
        self.get_logger().info(
            f'following a path of {path.length:.4g} m' if path else 'waiting for a path'
        )

    def control(self) -> None:
        """Publish the velocity of this period, or once that the robot stops."""
        now, guidance = self.get_clock().now().nanoseconds, self.guidance
        if now < self.latest:  # a simulation that was reset
            self.heard, self.places = 0, None
            self._follow(self.path)
            guidance = self.guidance
        self.latest = now
        if not guidance or now == 0 or self.places is None:
            self._stop()
            return
        silence = 1e-9 * (now - self.heard)
        if silence > self.settings.pose_timeout:
            self.warn('silent', f'no link_poses for {silence:.2g} s: the robot stops')
            self._stop()
            return
        steering = guidance.steer(self.places)
        path, place = guidance.path, guidance.place
        assert place
        self.error.publish(Float64(data=place.cross_track))
        if not path.closed and place.arc > path.length - self.settings.tolerance:
            self.get_logger().info(f'at the end of the path, {place.cross_track:.3g} m beside it')
            self.guidance, self.why = None, 'at the end of the path'
            self._publish(STOPPED)  # also a robot that goes with its gait since before
            self.is_moving = False
            return
        self.is_moving = True
        self._publish(steering)

    def report(self) -> None:
        """Publish what the node does on /diagnostics."""
        guidance, values = self.guidance, dict[str, str]()
        if guidance and guidance.place:
            arc, length = guidance.place.arc, guidance.path.length
            values = {
                'cross_track_error': f'{guidance.place.cross_track:.6g}',
                'arc_length': f'{arc:.6g}',
                'remaining': 'inf' if guidance.path.closed else f'{max(0.0, length - arc):.6g}',
            }
        state = self.why or ('following' if self.is_moving else 'waiting for link_poses')
        name = f'{self.get_fully_qualified_name().lstrip("/")}: path'
        pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
        message = DiagnosticArray(
            status=[DiagnosticStatus(name=name, message=state, values=pairs)]
        )
        message.header.stamp = self.get_clock().now().to_msg()
        self.diagnostics.publish(message)

    def _stop(self) -> None:
        if self.is_moving:
            self._publish(STOPPED)
        self.is_moving = False

    def _publish(self, steering: Steering) -> None:
        message = Twist()
        message.linear.x, message.angular.z = steering.speed, steering.turning
        if self.settings.use_stamped_vel:
            message = TwistStamped(twist=message)
            message.header.stamp = self.get_clock().now().to_msg()
        self.commands.publish(message)

    def _on_path(self, message: PathMessage) -> None:
        try:
            path = path_from(message, self.scene.follow.closed)
        except ParameterError as error:
            kind = str(error).partition(', got')[0]
            self.warn(f'path {kind}', f'path: {error}; the last good path holds')
            return
        before = self.guidance.path if self.guidance else None
        if path and before:
            is_known = np.array_equal(path.points, before.points)
        else:
            is_known = not (path or self.path)
        if not is_known:  # one that is latched comes twice
            self._follow(path)
        if not path:
            self._publish(STOPPED)
            self.is_moving = False

    def _on_poses(self, message: PoseArray) -> None:
        try:
            self.places, _ = link_poses(message, self.scene.robot)
        except ParameterError as error:
            self.warn('poses', f'link_poses: {error}')
            return
        self.heard = self.get_clock().now().nanoseconds

    # ---- parameters -----------------------------------------------------------------------------

    def _changed(self, parameters: list[Parameter]) -> Scene:
        values: dict[str, Any] = {item.name: item.value for item in parameters}
        return with_settings(self.scene, {k: v for k, v in values.items() if k in GAINS})

    def _on_set_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            self._changed(parameters)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _on_parameters_set(self, parameters: list[Parameter]) -> None:
        self.scene = self._changed(parameters)
        if self.guidance:
            following, stride = self.scene.follow, self.guidance.stride
            speed = speed_along(following, self.scene.gait, stride)
            self.guidance.change(following, speed)


def main(args: list[str] | None = None) -> int:
    """Run the node until a signal ends it."""
    return run_node(FollowNode, serve, args)


if __name__ == '__main__':
    sys.exit(main())

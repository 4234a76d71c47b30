# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The topics on which the node `sim` publishes its state, its robot and its clock."""

import time

from geometry_msgs.msg import PoseArray
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from snake_sim_ros.gaits.joint_reference import JointReference
from snake_sim_ros.nodes.markers import MARKER_PERIOD, SceneMarkers
from snake_sim_ros.nodes.sensor_publishers import SensorPublishers
from snake_sim_ros.nodes.sim_parameters import Settings
from snake_sim_ros.nodes.stamps import stamp_from
from snake_sim_ros.nodes.state_messages import StateMessages
from snake_sim_ros.nodes.transforms import LATCHED, TransformMessages, Transforms
from snake_sim_ros.scene.robot_description import robot_description
from snake_sim_ros.stepping.contact_forces import contact_forces
from snake_sim_ros.stepping.simulation import Simulation

LATEST = QoSProfile(depth=1)  # A newer time replaces one that waits.


class StatePublishers:
    """
    Publishes the state of a simulation, and at once the robot description, which stays.

    Attributes
    ----------
    sensors : SensorPublishers

    """

    def __init__(self, node: Node, simulation: Simulation, settings: Settings) -> None:
        self._simulation = simulation
        scene, prefix = simulation.scene, settings.frame_prefix
        if prefix == 'auto':
            prefix = f'{node.get_namespace()}/'.lstrip('/')
        self._messages = StateMessages(scene.robot, prefix)
        self.sensors = SensorPublishers(node, simulation, settings, prefix)
        self._joint_states = node.create_publisher(
            JointState,
            'joint_states',
            10,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )
        self._link_poses = node.create_publisher(PoseArray, 'link_poses', 10)
        self._odom = node.create_publisher(Odometry, 'odom', 10)
        self._markers = node.create_publisher(MarkerArray, 'markers', 10)
        self._scene_markers = SceneMarkers(scene)
        self._marked = 0.0  # wall time of the last markers [s]
        clock = settings.publish_clock
        self._clock = node.create_publisher(Clock, '/clock', LATEST) if clock else None
        if settings.publish_robot_description:
            self._description = node.create_publisher(String, 'robot_description', LATCHED)
            self._description.publish(String(data=robot_description(scene.robot)))
        self._transforms = None
        if settings.publish_tf and TransformMessages.available:
            self._transforms = Transforms(node, prefix)
        elif settings.publish_tf:
            node.get_logger().info('no /tf: the package tf2_msgs is not installed')

    def publish(self, nanoseconds: int, held: JointReference | None = None) -> None:
        """
        Publish the state at a simulated time, then the clock.

        Parameters
        ----------
        nanoseconds : int
        held : JointReference, optional
            Angles and rates of the joints where they are known. Default: from the state, by
            compiled functions.

        """
        messages, simulation = self._messages, self._simulation
        motion = (held.angle, held.rate) if held else None
        messages.fill(nanoseconds, simulation.state, simulation.last.joint_torque, motion)
        self.sensors.reader.add_noise(messages.angle, messages.rate, messages.torque)
        self._joint_states.publish(bytes(messages.joint_states))
        self._link_poses.publish(bytes(messages.link_poses))
        self._odom.publish(bytes(messages.odom))
        if self._transforms:
            self._transforms.publish(stamp_from(nanoseconds), messages.base.tolist())
        self.sensors.publish(nanoseconds, contacts=held is None)
        if not held:
            self.publish_markers(nanoseconds)
        if self._clock:
            self._clock.publish(bytes(messages.clock))

    def publish_markers(self, nanoseconds: int) -> None:
        """Publish contacts and obstacles, if somebody subscribed and the last ones are old."""
        if not self._markers.get_subscription_count():
            return
        now, simulation = time.monotonic(), self._simulation
        if now - self._marked >= MARKER_PERIOD:
            self._marked = now
            touched = contact_forces(simulation.scene, simulation.state, simulation.history)
            self._scene_markers.fill(stamp_from(nanoseconds), *touched)
            self._markers.publish(self._scene_markers.message)

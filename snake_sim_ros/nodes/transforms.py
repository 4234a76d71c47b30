# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The place of the robot, but not of its links, as frames on /tf if tf2_msgs is installed."""

from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from snake_sim_ros.nodes.state_messages import BASE, ODOM, WORLD

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # The ROS 2 packages on PyPI do not have it.
    TFMessage = None

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class TransformMessages:
    """
    The transforms from world to odom, which is fixed, and from odom to base_link.

    They are as tf2_ros.StaticTransformBroadcaster and tf2_ros.TransformBroadcaster publish them. A
    robot_state_publisher makes the frames of the links, from ``robot_description`` and
    ``joint_states``.

    Attributes
    ----------
    fixed, moving : TFMessage
        For /tf_static and /tf.

    """

    kind = TFMessage
    available = TFMessage is not None

    def __init__(self, frame_prefix: str = '') -> None:
        identity = TransformStamped(child_frame_id=frame_prefix + ODOM)
        identity.header.frame_id = WORLD
        self.fixed = TFMessage(transforms=[identity])
        self._transform = TransformStamped(child_frame_id=frame_prefix + BASE)
        self._transform.header.frame_id = frame_prefix + ODOM
        self.moving = TFMessage(transforms=[self._transform])

    def fill(self, stamp: Time, pose: list[float]) -> None:
        """Fill the moving one with the pose of the base: position [m], quaternion x y z w."""
        transform = self._transform.transform
        self._transform.header.stamp = stamp
        moved, turned = transform.translation, transform.rotation
        moved.x, moved.y, moved.z, turned.x, turned.y, turned.z, turned.w = pose


class Transforms:
    """Publishes the transforms."""

    def __init__(self, node: Node, frame_prefix: str) -> None:
        self.messages = TransformMessages(frame_prefix)
        self.publisher = node.create_publisher(TFMessage, '/tf', QoSProfile(depth=100))
        self.static = node.create_publisher(TFMessage, '/tf_static', LATCHED)
        self.static.publish(self.messages.fixed)

    def publish(self, stamp: Time, pose: list[float]) -> None:
        """Publish the pose of the base: position [m], quaternion x y z w."""
        self.messages.fill(stamp, pose)
        self.publisher.publish(self.messages.moving)

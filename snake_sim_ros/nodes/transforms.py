"""Frames on /tf, where tf2_msgs is installed: where the robot is, not its links."""

from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy
from rclpy.qos import QoSProfile

from snake_sim_ros.nodes.messages import BASE
from snake_sim_ros.nodes.messages import ODOM
from snake_sim_ros.nodes.messages import WORLD

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # not among the packages of ROS 2 on PyPI
    TFMessage = None


class Transforms:
    """
    What tf2_ros.TransformBroadcaster and its static sister publish: world, odom, base_link.

    The frames of the links are left to a robot_state_publisher, which makes them from
    ``robot_description`` and ``joint_states``.
    """

    available = TFMessage is not None

    def __init__(self, node: Node, frame_prefix: str) -> None:
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.publisher = node.create_publisher(TFMessage, '/tf', 100)
        self.static = node.create_publisher(TFMessage, '/tf_static', latched)
        identity = TransformStamped(child_frame_id=frame_prefix + ODOM)
        identity.header.frame_id = WORLD
        self.static.publish(TFMessage(transforms=[identity]))
        self.transform = TransformStamped(child_frame_id=frame_prefix + BASE)
        self.transform.header.frame_id = frame_prefix + ODOM
        self.message = TFMessage(transforms=[self.transform])

    def publish(self, stamp: Time, pose: list[float]) -> None:
        """Publish where the base of the robot is: position, quaternion x y z w."""
        self.transform.header.stamp = stamp
        moved, turned = self.transform.transform.translation, self.transform.transform.rotation
        moved.x, moved.y, moved.z, turned.x, turned.y, turned.z, turned.w = pose
        self.publisher.publish(self.message)

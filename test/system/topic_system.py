# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What ros2_control's plugin JointStateTopicSystem does over ROS, message for message.

It follows the source of joint_state_topic_hardware_interface at commit d115f23 (July 2026): the
names and defaults of its parameters, its qualities of service, the fields that it fills for the
command interfaces of each joint, and when it sends. Interfaces are NaN until a controller or a
message sets them. It has no joints that mimic others, and no sums of wrapped angles.
"""

from array import array
import math
from xml.etree import ElementTree

from rclpy.qos import qos_profile_sensor_data, QoSProfile
from sensor_msgs.msg import JointState

FIELDS = ('position', 'velocity', 'effort')


class JointStateTopicSystem:
    """
    The hardware of a controller manager.

    Parameters
    ----------
    node : Node
    description : str
        A URDF with an element ``<ros2_control>``.

    Attributes
    ----------
    threshold : float
        Difference of commands and states up to which nothing is sent.
    state, command : dict
        (joint, interface) -> value; controllers read one and write the other.
    sent : int
        Number of messages that were sent.
    publisher : Publisher

    """

    def __init__(self, node, description):
        system = ElementTree.fromstring(description).find('ros2_control')
        given = {item.get('name'): item.text for item in system.findall('hardware/param')}
        self.plugin = system.find('hardware/plugin').text
        self.joints = {
            joint.get('name'): [item.get('name') for item in joint.findall('command_interface')]
            for joint in system.findall('joint')
        }
        self.state = {
            (joint.get('name'), item.get('name')): math.nan
            for joint in system.findall('joint')
            for item in joint.findall('state_interface')
        }
        self.command = {
            (name, item): math.nan for name, items in self.joints.items() for item in items
        }
        self.threshold = float(given.get('trigger_joint_command_threshold', 1e-5))
        self.sent, self._node, self._latest = 0, node, JointState()
        self.publisher = node.create_publisher(
            JointState,
            given.get('joint_commands_topic', '/robot_joint_commands'),
            QoSProfile(depth=1),
        )
        node.create_subscription(
            JointState,
            given.get('joint_states_topic', '/robot_joint_states'),
            self.take,
            qos_profile_sensor_data,
        )

    def take(self, message):
        """Keep a message with states."""
        self._latest = message

    def read(self):
        """Take the states of the last message."""
        for k, name in enumerate(self._latest.name):
            if name in self.joints:
                for field in FIELDS:
                    values = getattr(self._latest, field)
                    if len(values) and math.isfinite(values[k]):
                        self.state[name, field] = values[k]

    def write(self):
        """Send all commands, unless their difference to the states is small."""
        difference = sum(abs(self.state[key] - value) for key, value in self.command.items())
        if difference <= self.threshold:
            return
        message = JointState(name=list(self.joints))
        message.header.stamp = self._node.get_clock().now().to_msg()
        for field in FIELDS:
            values = [self.command[n, field] for n, items in self.joints.items() if field in items]
            setattr(message, field, array('d', values))
        self.publisher.publish(message)
        self.sent += 1

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A clock that a test advances by hand, and the commands of a gait node that follows it."""

from geometry_msgs.msg import Twist
from offline import nanoseconds, PERIOD
from rclpy.duration import Duration
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from snake_sim_ros.nodes.messages import stamp_from


class HandClock:
    """
    The clock of a gait node, by default from 10 s on, and all commands of the node.

    Attributes
    ----------
    now : int
        Time [ns].
    messages : list of JointState
        All commands.

    """

    def __init__(self, graph, kind=Twist):
        self.graph, (self.process,) = graph, graph.processes
        self.messages = graph.record(JointState, 'joint_command')
        self.clock = graph.node.create_publisher(Clock, '/clock', QoSProfile(depth=1))
        self.twists = graph.node.create_publisher(kind, 'cmd_vel', QoSProfile(depth=1))
        self.now = 10_000_000_000
        graph.until(self.clock.get_subscription_count, 'a reader of /clock')
        graph.until(self.twists.get_subscription_count, 'a reader of cmd_vel')
        graph.until(lambda: graph.node.count_publishers('joint_command'), 'joint_command')

    def tell(self):
        """Publish the time."""
        self.clock.publish(Clock(clock=stamp_from(self.now)))

    def tick(self):
        """Let a period pass, and do not wait for its command."""
        self.now += PERIOD
        self.tell()

    def step(self):
        """Let a period pass; return its command."""
        self.now += PERIOD
        count = len(self.messages)

        def arrived():
            self.tell()  # again, should it get lost
            return any(nanoseconds(m) == self.now for m in self.messages[count:])

        self.graph.until(arrived, f'the command of {1e-9 * self.now} s')
        return self.messages[-1]

    def send(self, publisher, message):
        """Publish a message; return when the node has it, which is before the next time."""
        publisher.publish(message)
        assert publisher.wait_for_all_acked(Duration(seconds=10)), 'no one took the message'

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A client that only listens: when messages of robots came last."""

from collections.abc import Callable, Sequence
import time
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

from snake_sim_ros.nodes.executors import served_until

SLICE = 0.05  # s between two looks


class GraphWatch:
    """
    Counts the messages of some topics of JointState.

    Parameters
    ----------
    topics : sequence of str

    Attributes
    ----------
    counts : dict
        Topic -> messages so far.

    """

    def __init__(self, topics: Sequence[str]) -> None:
        self.counts = dict.fromkeys(topics, 0)
        self.context = Context()
        rclpy.init(context=self.context)
        self.node = Node('watch', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        for topic in topics:
            self.node.create_subscription(
                JointState, topic, self._counter(topic), QoSProfile(depth=5), raw=True
            )

    def _counter(self, topic: str) -> Callable[[Any], None]:
        def count(_: Any) -> None:
            self.counts[topic] += 1

        return count

    def close(self) -> None:
        """Leave the graph."""
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def publisher(self, topic: str) -> Publisher:
        """Return a publisher of JointState."""
        return self.node.create_publisher(JointState, topic, QoSProfile(depth=1))

    def spin(self, seconds: float) -> None:
        """Listen for some time."""
        self._until(lambda: False, seconds)

    def flow(self, topics: Sequence[str], seconds: float) -> float | None:
        """Return after which time [s] all topics had new messages, None if one had none."""
        before, begin = dict(self.counts), time.monotonic()
        if self._until(lambda: all(self.counts[t] > before[t] for t in topics), seconds):
            return time.monotonic() - begin
        return None

    def _until(self, condition: Callable[[], bool], seconds: float) -> bool:
        return served_until(self.executor, condition, seconds, SLICE)


def large_command(size: int) -> JointState:
    """Return a command for a joint whose name has so many characters."""
    return JointState(name=['x' * size], position=[0.0])


def crowd(count: int) -> list[Context]:
    """Return contexts that are participants of the domain each; shut them down afterwards."""
    contexts = []
    for _ in range(count):
        contexts.append(Context())
        rclpy.init(context=contexts[-1])
        Node('one_of_many', context=contexts[-1])
    return contexts


def leave(contexts: Sequence[Context]) -> None:
    """Shut contexts down."""
    for context in contexts:
        rclpy.shutdown(context=context)

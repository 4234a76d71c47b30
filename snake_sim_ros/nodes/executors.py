"""Executors of rclpy, and how long a node serves messages with them before it goes on."""

import time

from rclpy.executors import Executor
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

try:
    from rclpy.experimental import EventsExecutor
except ImportError:  # It costs a third per message, but not every rclpy has it.
    EventsExecutor = SingleThreadedExecutor

# Seconds for which messages are served before the caller goes on. A newer message replaces those
# that wait, so some twenty calls find nothing and one or two take a message. The limit is the same
# if no message waits.
SERVING = 2e-4


def make_executor(node: Node) -> Executor:
    """Return an executor that serves the node through `spin_once`."""
    executor = EventsExecutor()
    executor.add_node(node)
    return executor


def serve_some(executor: Executor) -> None:
    """Serve messages that wait, but not so many or so large ones that the caller would starve."""
    end = time.perf_counter() + SERVING
    while time.perf_counter() < end:
        executor.spin_once(timeout_sec=0)

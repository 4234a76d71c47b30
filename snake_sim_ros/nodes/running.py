"""How a node starts, waits for messages and ends."""

from collections.abc import Callable
import os
import sys
import tempfile
from typing import TypeVar

import rclpy
from rclpy.executors import Executor
from rclpy.executors import ExternalShutdownException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from snake_sim_ros.parameters import ParameterError

try:
    from rclpy.experimental import EventsExecutor
except ImportError:  # a third of the cost per message, but not in every rclpy
    EventsExecutor = SingleThreadedExecutor

N = TypeVar('N', bound=Node)


def make_executor(node: Node) -> Executor:
    """Return an executor that serves the node through `spin_once`."""
    executor = EventsExecutor()
    executor.add_node(node)
    return executor


def run_node(
    make: Callable[[], N], run: Callable[[N], None], args: list[str] | None = None
) -> int:
    """
    Start rclpy, make a node, run it, and end cleanly on SIGINT and SIGTERM.

    Returns
    -------
    int
        Exit status: 0, or 2 if a parameter is not usable; then one sentence says which and why.

    """
    if not os.access(os.path.expanduser('~'), os.W_OK):
        os.environ.setdefault('ROS_LOG_DIR', tempfile.gettempdir())
    try:
        rclpy.init(args=args)
        node = make()
        try:
            run(node)
        finally:
            node.destroy_node()
    except ParameterError as error:
        print(f'error: {error}', file=sys.stderr)
        return 2
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()
    return 0

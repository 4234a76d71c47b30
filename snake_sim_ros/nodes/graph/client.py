# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A node for the time of one command: it looks at the graph, waits, and is interrupted."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import os
from threading import Event
import time
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from snake_sim_ros.nodes.executors import make_executor
from snake_sim_ros.nodes.tools.child_nodes import interruptible

QUIET = 0.5  # s without news after which no more are expected
DISCOVERY = 3.5  # s in which all nodes are found: they announce themselves every 3 s
ANSWER_TIMEOUT = 10.0  # s for a node to answer; that of `ros2` waits for ever
LOOK_PERIOD = 0.05  # s between two looks at a condition, at most


class GraphError(Exception):
    """One sentence on what cannot be done."""


class Client:
    """
    A hidden node, with what the commands ask of the graph.

    Parameters
    ----------
    node : Node
    stop : Event
        Set when the command is to end.
    patience : float
        Time to wait for what is not there [s].

    """

    def __init__(self, node: Node, stop: Event, patience: float) -> None:
        self.node, self.patience, self._stop = node, patience, stop
        self._executor = make_executor(node)

    def spin(self, seconds: float) -> None:
        """
        Serve messages for some time, or until the first one.

        Raises
        ------
        KeyboardInterrupt
            If the command is to end.

        """
        self._executor.spin_once(timeout_sec=min(seconds, LOOK_PERIOD))
        if self._stop.is_set():
            raise KeyboardInterrupt

    def until(self, condition: Callable[[], Any], seconds: float) -> Any:
        """Return the value of a condition as soon as it is true, or when the time is up."""
        end = time.monotonic() + seconds
        while not (value := condition()) and (left := end - time.monotonic()) > 0:
            self.spin(left)
        return value

    def answer(self, future: Future, who: str) -> Any:
        """
        Return the answer to a request.

        Raises
        ------
        GraphError
            If there is none in time.

        """
        if not self.until(future.done, ANSWER_TIMEOUT):
            raise GraphError(f'{who} did not answer in {ANSWER_TIMEOUT:g} s')
        return future.result()

    def look_around(self) -> None:
        """Wait until all nodes should have been found, and there is no more news."""
        begin, seen, since = time.monotonic(), None, 0.0
        while (now := time.monotonic()) < begin + max(self.patience, DISCOVERY):
            news = self.nodes(), self.topics(hidden=True), self.services(hidden=True)
            if news != seen:
                seen, since = news, now
            elif now > max(begin + DISCOVERY, since + QUIET) and news[0]:
                return
            self.spin(LOOK_PERIOD)

    def nodes(self) -> list[str]:
        """Return the full names of all nodes that are not hidden."""
        found = self.node.get_node_names_and_namespaces()
        names = {f'{space.rstrip("/")}/{name}' for name, space in found if name[:1] != '_'}
        return sorted(names)

    def topics(self, hidden: bool) -> list[tuple[str, list[str]]]:
        """Return names and types of topics."""
        return listed(self.node.get_topic_names_and_types(), hidden)

    def services(self, hidden: bool) -> list[tuple[str, list[str]]]:
        """Return names and types of services."""
        return listed(self.node.get_service_names_and_types(), hidden)

    def types_of(self, topic: str) -> list[str]:
        """Return the types of a topic, or none if it does not exist."""
        return dict(self.topics(hidden=True)).get(topic, [])


def listed(found: list[tuple[str, list[str]]], hidden: bool) -> list[tuple[str, list[str]]]:
    """Return names and types; a part of a hidden name begins with an underscore."""
    return sorted((name, list(types)) for name, types in found if hidden or '/_' not in name)


def absolute(name: str) -> str:
    """Return a name with a slash before it."""
    return name if name.startswith('/') else f'/{name}'


@contextmanager
def client(patience: float) -> Iterator[Client]:
    """
    Yield the client of a command.

    Parameters
    ----------
    patience : float
        Time to wait for what is not there [s].

    """
    with interruptible() as stop:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        try:
            node = Node(
                f'_snake_sim_{os.getpid()}',
                start_parameter_services=False,
                enable_rosout=False,
                parameter_overrides=[Parameter('start_type_description_service', value=False)],
            )
            yield Client(node, stop, patience)
            node.destroy_node()
        finally:
            rclpy.try_shutdown()

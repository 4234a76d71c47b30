# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""How a node serves messages and requests, and what it says of those that it cannot use."""

from collections.abc import Callable
import math
from threading import Event
import time
from typing import Any

from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node

from snake_sim_ros.nodes.node_parameters import NOT_USABLE

try:
    from rclpy.experimental import EventsExecutor
except ImportError:  # It costs a third per message, but not every rclpy has it.
    EventsExecutor = SingleThreadedExecutor

WARN_PERIOD = 5.0  # s between two warnings of one kind


class ThrottledWarnings:
    """Logs warnings of a node, of each kind at most one every `WARN_PERIOD`."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._last: dict[str, float] = {}

    def __call__(self, kind: str, sentence: str) -> None:
        """Log a warning, unless one of its kind was logged within the last `WARN_PERIOD`."""
        now = time.monotonic()
        if now - self._last.get(kind, -WARN_PERIOD) >= WARN_PERIOD:
            self._last[kind] = now
            self._node.get_logger().warning(sentence)


REMEMBERED = 10.0  # s of wall time for which a refusal is in the diagnostics


class Refusals:
    """
    The refused messages of some topics.

    Attributes
    ----------
    count : int

    """

    def __init__(self, warn: ThrottledWarnings) -> None:
        self._warn = warn
        self._last, self._time = '', -math.inf
        self.count = 0

    def add(self, kind: str, sentence: str) -> None:
        """Note and log that a message was refused; warnings of one kind are throttled."""
        self._last, self._time = sentence, time.monotonic()
        self.count += 1
        self._warn(kind, sentence)

    def remarks(self) -> list[str]:
        """Return a sentence on the last one if it is not old."""
        return [self._last] if time.monotonic() - self._time < REMEMBERED else []


# ---- executors ----------------------------------------------------------------------------------

# Seconds for which messages are served before the caller continues. A newer message replaces those
# that wait, so some twenty calls find nothing and one or two take a message. The limit is the same
# if no message waits.
SERVING = 2e-4


def make_executor(node: Node) -> Executor:
    """Return an executor that serves the node through `spin_once`."""
    executor = EventsExecutor()
    executor.add_node(node)
    return executor


def served_until(
    executor: Executor, condition: Callable[[], object], seconds: float, between: float
) -> bool:
    """
    Serve until a condition holds; return whether it did in time.

    `between` is the longest time between two looks [s].
    """
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        executor.spin_once(timeout_sec=between)
    return True


class CountingExecutor(SingleThreadedExecutor):
    """
    An executor that counts what it serves.

    Attributes
    ----------
    served : int
        Messages, requests, responses and timers.

    """

    def __init__(self) -> None:
        super().__init__()
        self.served = 0

    def wait_for_ready_callbacks(self, *args: Any, **kwargs: Any) -> Any:
        """Return what is ready next; `spin_once` calls it, which ends with an error of rclpy."""
        found: Any = super().wait_for_ready_callbacks(*args, **kwargs)
        self.served += 1
        return found


class Server:
    """
    Serves a node, which keeps running if rclpy itself cannot take a message or a request.

    A time before 0 on /clock is one: its error comes out of a callback of rclpy, and would end the
    node.

    Parameters
    ----------
    executor : Executor
    warn : ThrottledWarnings

    """

    def __init__(self, executor: Executor, warn: ThrottledWarnings) -> None:
        self._executor, self._warn = executor, warn

    def spin_once(self, timeout_sec: float) -> None:
        """Serve what comes first, within some time [s]."""
        try:
            self._executor.spin_once(timeout_sec=timeout_sec)
        except NOT_USABLE as error:
            words = str(error).partition('\n')[0]
            self._warn('dropped', f'a message or request was dropped: {words}')

    def serve_some(self) -> None:
        """Serve what waits, but not so much or so large that the caller would starve."""
        end = time.perf_counter() + SERVING
        while time.perf_counter() < end:
            self.spin_once(timeout_sec=0)


def serve(node: Any, stop: Event) -> None:
    """Serve clock, timers, messages and services of a node with `warn` until an event is set."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    server = Server(executor, node.warn)
    while not stop.is_set():
        server.spin_once(timeout_sec=0.1)

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A ROS domain of its own for a test: real node processes, and one client node."""

from collections.abc import Callable
from contextlib import redirect_stderr
import signal
import subprocess
import sys
import time
from typing import Any

from forks import node
from programs import next_domain, node_command, Process, TIMEOUT
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile

from snake_sim_ros.nodes.executors import EventsExecutor

START_TIMEOUT = 120.0  # s for a node to start, which may have to compile the physics
LOOK = 5e-3  # s between two looks for what no message tells
QUIET = 0.2  # s without messages after which none is under way


class Graph:
    """
    Node processes in one ROS domain, and a client node in the process of the test.

    Parameters
    ----------
    is_forked : bool, optional
        Whether nodes are forked from a process that has their modules loaded; else each is a
        program of its own, as a user starts it.
    takes_all : bool, optional
        Whether the client takes all messages in their order. Otherwise a flood of messages, of
        which it takes the last ones of each topic, delays no answer; that costs twice the time.

    """

    def __init__(self, is_forked: bool = True, takes_all: bool = True) -> None:
        self.is_forked = is_forked
        self.domain = next_domain()
        self.processes: list[Process] = []
        self.context = Context()
        rclpy.init(context=self.context, domain_id=self.domain)
        self.node = Node(f'client_{self.domain}', context=self.context)
        kind = EventsExecutor if takes_all else SingleThreadedExecutor
        with redirect_stderr(sys.__stderr__):  # It wants a file, and a test may capture its own.
            self.executor = kind(context=self.context)
        self.executor.add_node(self.node)
        self._clients: dict[str, Any] = {}

    def start(
        self, name: str, *parameters: str, constants: dict[str, float] | None = None
    ) -> Process:
        """Start a `node` with parameters ``name:=value``, or with other ROS arguments."""
        arguments = [part for item in parameters for part in _as_arguments(item)]
        if self.is_forked:
            process = node(name, *arguments, domain=self.domain, constants=constants)
            self.processes.append(process)
        else:
            self.processes.append(Process(node_command(name, *arguments), self.domain))
        return self.processes[-1]

    def end(self, process: Process) -> None:
        """End a process by force before its graph ends; it takes time of other tests."""
        self.processes.remove(process)
        process.kill()

    def until(
        self, condition: Callable[[], Any], what: str, timeout: float = START_TIMEOUT
    ) -> None:
        """Spin the client until a condition holds; fail if a node dies before or time is up."""
        end = time.monotonic() + timeout
        while not condition():
            dead = [item for item in self.processes if item.popen.poll() is not None]
            if dead or time.monotonic() > end:
                for item in dead:
                    item.wait()
                said = '\n'.join(f'--- {item.name}\n{item.output}' for item in self.processes)
                why = 'a node ended' if dead else f'{timeout} s are over'
                raise AssertionError(f'waited for {what}, but {why}\n{said}')
            self.executor.spin_once(timeout_sec=LOOK)

    def spin(self, seconds: float) -> None:
        """Serve the client for some time."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.executor.spin_once(timeout_sec=left)

    def drain(self, messages: list[Any]) -> None:
        """Serve the client until no more messages come for a while."""
        end = time.monotonic() + TIMEOUT
        count = -1
        while len(messages) > count:
            assert time.monotonic() < end, 'messages do not end'
            count = len(messages)
            self.spin(QUIET)

    def record(self, kind: Any, topic: str, depth: int = 1000) -> list[Any]:
        """Return a list to which all messages of a topic are appended."""
        messages: list[Any] = []
        self.node.create_subscription(kind, topic, messages.append, QoSProfile(depth=depth))
        return messages

    def call(self, kind: Any, service: str, request: Any = None) -> Any:
        """Return the response of a service."""
        if service not in self._clients:
            self._clients[service] = self.node.create_client(kind, service)
        client = self._clients[service]
        self.until(client.service_is_ready, f'service {service}')
        future = client.call_async(request or kind.Request())
        self.until(future.done, f'the response of {service}', TIMEOUT)
        return future.result()

    def close(self) -> None:
        """End all processes and the client."""
        for item in self.processes:
            if item.popen.poll() is None:
                item.popen.send_signal(signal.SIGINT)
        for item in self.processes:
            try:
                item.popen.wait(5.0)
            except subprocess.TimeoutExpired:
                item.kill()
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


def _as_arguments(item: str) -> list[str]:
    return item.split() if item.startswith('-') else ['-p', item]

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A ROS domain of its own for a test: real node processes, and one client node."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import itertools
import os
from pathlib import Path
import signal
import subprocess
import sys
import threading
import time
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile

ROOT = Path(__file__).parents[2]
START_TIMEOUT = 120.0  # s for a node to start, which may have to compile the physics
TIMEOUT = 20.0  # s for everything else; discovery takes up to 3.3 s on an idle machine
_counter = itertools.count()


def next_domain() -> int:
    """
    Return a ROS domain that no other test of this run has, and hardly any of another run.

    Processes that test at the same time (pytest-xdist) have a range of domains each.
    """
    worker = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0')[2:]) % 2
    start = os.getppid() if 'PYTEST_XDIST_WORKER' in os.environ else os.getpid()
    return 1 + 50 * worker + (7 * start + next(_counter)) % 50


def environment(domain: int) -> dict[str, str]:
    """Return the environment of a process of the checkout in a domain of this machine."""
    path = os.pathsep.join(item for item in (str(ROOT), os.environ.get('PYTHONPATH')) if item)
    return {
        **os.environ,
        'PYTHONPATH': path,
        'PYTHONUNBUFFERED': '1',
        'ROS_DOMAIN_ID': str(domain),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    }


class Process:
    """A process, with its whole output."""

    def __init__(self, command: list[str], domain: int, cwd: Path = ROOT) -> None:
        self.name = ' '.join(command[1:])
        self.lines: list[str] = []
        self.popen = subprocess.Popen(
            command,
            cwd=cwd,
            env=environment(domain),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.popen.stdout is not None
        for line in self.popen.stdout:
            self.lines.append(line.rstrip('\n'))

    @property
    def output(self) -> str:
        """All lines so far."""
        return '\n'.join(self.lines)

    def count(self, text: str) -> int:
        """Return the number of lines with a text in them."""
        return sum(text in line for line in list(self.lines))

    def wait(self, timeout: float = TIMEOUT) -> int:
        """Return the exit status of a process that ends by itself."""
        try:
            status = self.popen.wait(timeout)
        except subprocess.TimeoutExpired:
            self.kill()
            raise AssertionError(f'{self.name}: no end in {timeout} s\n{self.output}') from None
        self._reader.join(1.0)
        return status

    def wait_for(self, text: str, timeout: float = TIMEOUT) -> None:
        """Wait until a line has a text in it."""
        end = time.monotonic() + timeout
        while not self.count(text):
            if time.monotonic() > end or self.popen.poll() is not None:
                self._reader.join(0.2)
                if not self.count(text):
                    raise AssertionError(
                        f'{self.name} (status {self.popen.poll()}) did not say '
                        f'{text!r}:\n{self.output}'
                    )
            time.sleep(0.01)

    def stop(self, number: int = signal.SIGINT) -> int:
        """Ask the process to end and return its exit status."""
        if self.popen.poll() is None:
            self.popen.send_signal(number)
        return self.wait()

    def kill(self) -> None:
        """End the process by force."""
        if self.popen.poll() is None:
            self.popen.kill()
        self.popen.wait()


@contextmanager
def background() -> Iterator[None]:
    """Have processes that start meanwhile ignore SIGINT at first, as those of a script with &."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def node_command(name: str, *arguments: str) -> list[str]:
    """Return the command that starts node `sim` or `gait` with ROS arguments."""
    command = [sys.executable, '-m', 'snake_sim_ros.nodes', name]
    return [*command, *(['--ros-args', *arguments] if arguments else [])]


class Graph:
    """Node processes in one ROS domain, and a client node in the process of the test."""

    def __init__(self) -> None:
        self.domain = next_domain()
        self.processes: list[Process] = []
        self.context = Context()
        rclpy.init(context=self.context, domain_id=self.domain)
        self.node = Node(f'client_{self.domain}', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self._clients: dict[str, Any] = {}

    def start(self, name: str, *parameters: str) -> Process:
        """Start a node with parameters ``name:=value``, or with other ROS arguments."""
        arguments = [part for item in parameters for part in _as_arguments(item)]
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
            self.executor.spin_once(timeout_sec=0.05)

    def spin(self, seconds: float) -> None:
        """Serve the client for some time."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.executor.spin_once(timeout_sec=left)

    def drain(self, messages: list[Any]) -> None:
        """Serve the client until no more messages come for 0.2 s."""
        end = time.monotonic() + TIMEOUT
        count = -1
        while len(messages) > count:
            assert time.monotonic() < end, 'messages do not end'
            count = len(messages)
            self.spin(0.2)

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

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A node that is attacked, in a process of its own, and a client that only listens to it."""

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
from threading import Thread
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

# ---- the node: its memory, and how much it prints -----------------------------------------------


LINES = 50  # of the output that are kept
END = 5.0  # s for a process to end when it is asked to
LOOK = 0.02  # s between two looks at what a process said

# What Fast DDS and rcutils print of a damaged message, below the node.
OF_MIDDLEWARE = re.compile(
    rb"$|sequence size exceeds|  'Fast CDR exception|>>> \[rcutils|This error state is being"
    rb'|with this new error message|rcutils_reset_error\(\) should|<<<'
)


class AttackedNode:
    """
    A process, and what it prints.

    Parameters
    ----------
    command : list of str
        Arguments of Python.
    environment : mapping, optional
        Variables besides those of this process.
    prefix : list of str, optional
        A program that starts it.

    Attributes
    ----------
    printed : int
        Bytes of its output so far, without what the middleware says of damaged messages.
    lines : deque of str
        The last lines of that.

    """

    def __init__(
        self,
        command: list[str],
        environment: Mapping[str, str] | None = None,
        prefix: list[str] | None = None,
    ) -> None:
        self.printed, self.lines = 0, deque[str](maxlen=LINES)
        self.process = subprocess.Popen(
            [*(prefix or []), sys.executable, *command],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
            env={**os.environ, 'PYTHONUNBUFFERED': '1', **(environment or {})},
        )  # fmt: skip
        self._reader = Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if not OF_MIDDLEWARE.match(line):
                self.printed += len(line)
                self.lines.append(line.decode(errors='replace').rstrip())

    @property
    def is_alive(self) -> bool:
        """Whether it runs."""
        return self.process.poll() is None

    @property
    def memory(self) -> float:
        """Resident memory [MB]; 0 after its end."""
        try:
            pages = Path(f'/proc/{self.process.pid}/statm').read_text(encoding='ascii').split()[1]
        except (OSError, IndexError):
            return 0.0
        return int(pages) * os.sysconf('SC_PAGE_SIZE') / 1e6

    def found(self, pattern: str) -> str:
        """Return what a pattern matches in one of the last lines, else an empty text."""
        matches = (re.search(pattern, line) for line in list(self.lines))
        return next((match[0] for match in matches if match), '')

    def said(self, pattern: str) -> bool:
        """Return whether one of the last lines has a pattern in it."""
        return bool(self.found(pattern))

    def wait_until_said(self, pattern: str, seconds: float) -> bool:
        """Wait for a pattern; return whether it came before the process or the time ended."""
        end = time.monotonic() + seconds
        while not self.said(pattern):
            if not self.is_alive or time.monotonic() > end:
                self._reader.join(0.2)
                return self.said(pattern)
            time.sleep(LOOK)
        return True

    def send(self, number: int) -> None:
        """Send a signal to it, if it runs."""
        if self.is_alive:
            self.process.send_signal(number)

    def wait(self, seconds: float) -> int | None:
        """Return its exit status, None if it does not end in time."""
        try:
            status = self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            return None
        self._reader.join(1.0)
        return status

    def end(self) -> int | None:
        """Ask it to end, kill it if it does not; return its exit status if it did."""
        self.send(signal.SIGCONT)
        self.send(signal.SIGINT)
        status = self.wait(END)
        if status is None:
            self.process.kill()
            self.process.wait()
        return status


def node(name: str, *parameters: str, **options: Mapping[str, str] | list[str]) -> AttackedNode:
    """Start a node with parameters as ``name:=value``, or other ROS arguments with a dash."""
    arguments = [
        part for item in parameters for part in (item.split() if item[0] == '-' else ('-p', item))
    ]
    command = ['-m', 'snake_sim_ros.nodes', name, '--ros-args', *arguments]
    return AttackedNode(command, **options)  # type: ignore[arg-type]


@contextmanager
def on_own_domain(domain: int) -> Iterator[None]:
    """Keep this process and those that it starts to a domain of this machine."""
    wanted = {'ROS_DOMAIN_ID': str(domain), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    before = {name: os.environ.get(name) for name in wanted}
    os.environ.update(wanted)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


# ---- the client: when messages came last --------------------------------------------------------


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

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nodes in processes of their own, which a command starts, watches and ends."""

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
import re
import signal
import subprocess
import sys
from threading import Thread
import time

from snake_sim_ros.gaits.blending import check_reach
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import load_scene, Scene

LINES = 100  # of the output of a node that are kept
LAST_WORDS = 5  # lines of its output that the report of a node's death shows
END_TIMEOUT = 5.0  # s, for a node to end after SIGINT


class Interrupted(Exception):
    """The user or the system asked the command to end."""


class NodeDied(Exception):
    """A node ended or fell silent without being asked to."""


@dataclass
class Child:
    """A node in a process of its own, with the last lines that it printed."""

    name: str
    process: subprocess.Popen[str]
    echo: bool = False  # whether the user sees all that it prints
    lines: deque[str] = field(default_factory=lambda: deque(maxlen=LINES))

    def said(self, pattern: str) -> re.Match[str] | None:
        """Return the first match of a pattern in what the node printed."""
        matches = (re.search(pattern, line) for line in list(self.lines))
        return next((match for match in matches if match), None)

    def check(self) -> None:
        """
        Raise if the process has ended.

        Raises
        ------
        NodeDied

        """
        status = self.process.poll()
        if status is not None:
            time.sleep(0.1)  # It may still print its last words.
            words = '' if self.echo else ': ' + ' / '.join(list(self.lines)[-LAST_WORDS:])
            raise NodeDied(f'{self.name} ended with status {status}{words}')

    def end(self) -> None:
        """Ask the process to end; kill it if it does not."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        try:
            self.process.wait(END_TIMEOUT)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


def scene_to_run(source: str) -> Scene:
    """
    Return a scene that the nodes take.

    Raises
    ------
    ParameterError
        If there is no such scene, or its gait is beyond the joint limit.

    """
    scene = load_scene(source)
    try:
        check_reach(scene.gait, scene.robot)
    except ParameterError as error:
        raise ParameterError(f'{Path(source).name}: {error}') from None
    return scene


def start(name: str, *parameters: str, echo: bool = False) -> Child:
    """
    Start a node in a session of its own, so that Ctrl-C does not reach it.

    Parameters
    ----------
    name : str
        The node: sim, gait or viewer.
    *parameters : str
        Parameters of the node as ``name:=value``.
    echo : bool
        Print what the node prints.

    """
    command = [sys.executable, '-m', 'snake_sim_ros.nodes', name, '--ros-args']
    for parameter in parameters:
        command += ['-p', parameter]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    node = Child(name, process, echo)
    Thread(target=_listen, args=(node,), daemon=True).start()
    print(f'started {name}, process {process.pid}')
    return node


def _listen(node: Child) -> None:
    assert node.process.stdout is not None
    for line in node.process.stdout:
        node.lines.append(line.rstrip())
        if node.echo:
            print(line, end='', flush=True)


@contextmanager
def children() -> Iterator[list[Child]]:
    """Yield a list for the nodes that are started; end them afterwards."""
    nodes: list[Child] = []
    try:
        yield nodes
    finally:
        for node in nodes:
            node.end()

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A node in a process of its own that is to be attacked: its memory, and how much it prints."""

from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
from threading import Thread
import time

LINES = 50  # of the output that are kept
END = 5.0  # s for a process to end when it is asked to
LOOK = 0.02  # s between two looks at what a process said


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
        Bytes of its output so far.
    lines : deque of str
        The last lines of it.

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

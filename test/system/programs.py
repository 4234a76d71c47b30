# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Programs of the checkout as processes in a ROS domain, with their whole output."""

from collections.abc import Iterator
from contextlib import contextmanager
import itertools
import os
from pathlib import Path
import signal
import subprocess
import sys
import threading
import time

ROOT = Path(__file__).parents[2]
TIMEOUT = 20.0  # s for all but the start of a node; discovery takes up to 3.3 s on an idle machine
_counter = itertools.count()


def next_domain() -> int:
    """
    Return a ROS domain that no other test of this run has, and hardly any of another run.

    Processes that test at the same time (pytest-xdist) have a range of domains each.
    """
    worker = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0')[2:])
    size = 100 // int(os.environ.get('PYTEST_XDIST_WORKER_COUNT', '1'))
    start = os.getppid() if 'PYTEST_XDIST_WORKER' in os.environ else os.getpid()
    return 1 + size * worker + (7 * start + next(_counter)) % size


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

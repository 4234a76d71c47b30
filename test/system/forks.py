# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Processes that are forked from one which has all modules loaded already.

A command of snake-sim imports modules for most of its time, and a node for two seconds. Where
their work is tested and not their start, they run in processes that are forked from a server of
`multiprocessing`, which does nothing else, so that it has neither threads nor a middleware.
"""

from collections.abc import Callable
from importlib import import_module
import multiprocessing
from multiprocessing import forkserver
from multiprocessing.connection import Connection
import os
from pathlib import Path
import runpy
import signal
import subprocess
import sys
import threading
from typing import Any

from programs import environment, Process, ROOT
import pytest

SERVER = multiprocessing.get_context('forkserver')
SERVER.set_forkserver_preload(
    [
        'snake_sim_ros.commands.main', 'snake_sim_ros.nodes.graph',
        *(f'snake_sim_ros.nodes.{name}_node' for name in ('sim', 'gait', 'control', 'follow')),
        'snake_sim_ros.nodes.viewer_node',
        'geometry_msgs.msg', 'nav_msgs.msg', 'sensor_msgs.msg', 'std_msgs.msg', 'std_srvs.srv',
        'viser', 'pytest', 'loaded_physics',
    ]
)  # fmt: skip


def start_server() -> None:
    """Start the server, once all that it loads is compiled."""
    with pytest.MonkeyPatch.context() as patch:
        # A server imports with the path of a new interpreter.
        folder, path = str(Path(__file__).parent), os.environ.get('PYTHONPATH')
        patch.setenv('PYTHONPATH', os.pathsep.join(filter(None, [folder, str(ROOT), path])))
        forkserver.ensure_running()


class Forked(Process):
    """A process that calls a function; its exit status is what the function returns."""

    def __init__(self, act: Callable[..., int], *arguments: Any, domain: int) -> None:
        self.name, self.lines = ' '.join(map(str, arguments)), []
        self.popen: Any = _Fork(_call, act, arguments, environment(domain))
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()


class _Fork:
    """What a `Process` uses of `subprocess.Popen`."""

    def __init__(self, target: Callable[..., None], *arguments: Any) -> None:
        reader, writer = SERVER.Pipe(duplex=False)
        self._process = SERVER.Process(target=target, args=(writer, *arguments), daemon=True)
        self._process.start()
        writer.close()
        self.stdout = os.fdopen(os.dup(reader.fileno()), errors='replace')
        reader.close()
        self.pid = self._process.pid

    def poll(self) -> int | None:
        return self._process.exitcode

    def wait(self, timeout: float | None = None) -> int:
        self._process.join(timeout)
        if self._process.exitcode is None:
            raise subprocess.TimeoutExpired(str(self.pid), timeout or 0.0)
        return self._process.exitcode

    def send_signal(self, number: int) -> None:
        os.kill(self.pid, number)

    def kill(self) -> None:
        self._process.kill()


def _call(
    output: Connection, act: Callable[..., int], arguments: Any, variables: dict[str, str]
) -> None:
    """Call a function in this process as if it were a program."""
    os.setsid()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # which nohup may have the server ignore
    os.dup2(output.fileno(), 1)
    os.dup2(output.fileno(), 2)
    output.close()
    sys.stdout.reconfigure(line_buffering=True)
    os.chdir(ROOT)
    os.environ.clear()
    os.environ.update(variables)
    raise SystemExit(act(*arguments))


def run_command(*words: str) -> int:
    """Return the exit status of a command of snake-sim."""
    from snake_sim_ros.commands.main import main  # in this process only

    return main(list(words))


def command(words: list[str], domain: int) -> Forked:
    """Start a command of snake-sim."""
    return Forked(run_command, *words, domain=domain)


def run_script(path: str, folder: str, is_background: bool, *words: str) -> int:
    """Run a script in a folder; in the background it ignores SIGINT at first."""
    os.chdir(folder)
    if is_background:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.argv = [path, *words]
    sys.path.insert(0, str(Path(path).parent))  # as the interpreter does
    runpy.run_path(path, run_name='__main__')
    return 0


def script(
    path: Path, *words: str, folder: Path, domain: int, is_background: bool = False
) -> Forked:
    """Start a script in Python."""
    return Forked(run_script, str(path), str(folder), is_background, *words, domain=domain)


def run_node(name: str, constants: dict[str, float], *arguments: str) -> int:
    """Return the exit status of a node that does not end by itself."""
    from snake_sim_ros.nodes import __main__ as programs  # in this process only

    for path, value in constants.items():
        module, _, constant = path.partition('.')
        setattr(import_module(f'snake_sim_ros.nodes.{module}'), constant, value)
    sys.argv = [name, *arguments]
    status: int = getattr(programs, name)()
    return status


def node(
    name: str, *arguments: str, domain: int, constants: dict[str, float] | None = None
) -> Forked:
    """Start a node with ROS arguments, and with other values of constants, ``module.NAME``."""
    words = ['--ros-args', *arguments] if arguments else []
    return Forked(run_node, name, constants or {}, *words, domain=domain)

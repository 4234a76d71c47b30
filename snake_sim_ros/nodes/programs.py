# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What a program of the nodes does before ROS 2 is imported, or says where it is missing.

Nothing here takes time to import, so that a program heeds signals from its first moment on.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
import signal
from threading import Event
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)  # the last one: the terminal closes


def on_signals(handler: Callable[[int, FrameType | None], None]) -> None:
    """Let a function handle the signals, but for the last one where nohup has it ignored."""
    for number in SIGNALS:
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, handler)


@contextmanager
def handled(handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Let a function handle the signals for a while."""
    before = {number: signal.signal(number, handler) for number in SIGNALS}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)


@contextmanager
def interruptible() -> Iterator[Event]:
    """Yield an event that the signals set; an exception would disrupt the middleware."""
    stop = Event()
    with handled(lambda *_: stop.set()):
        yield stop


def missing_ros(what: str, command: str, error: ImportError) -> Exception:
    """Return the ParameterError to raise where ROS 2 is missing."""
    records = import_module('snake_sim_ros.scene.checked_records')  # NumPy takes its time
    missing: Exception = records.ParameterError(
        f'{what} needs ROS 2 ({error}): source a ROS 2 installation, or ./run {command}'
    )
    return missing

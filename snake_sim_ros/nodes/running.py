"""How a node starts, waits for messages and ends."""

import argparse
from collections.abc import Callable
import gc
import os
import signal
import sys
import tempfile
from threading import Event
import time
from types import FrameType
from typing import Any
from typing import NoReturn
from typing import TypeVar

import rclpy
from rclpy.executors import Executor
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from snake_sim_ros.scene.quantities import ParameterError

try:
    from rclpy.experimental import EventsExecutor
except ImportError:  # a third of the cost per message, but not in every rclpy
    EventsExecutor = SingleThreadedExecutor

N = TypeVar('N', bound=Node)
SIGNALS = (signal.SIGINT, signal.SIGTERM)
WARN_PERIOD = 5.0  # s between two warnings of one kind
# s that messages are served before the caller goes on: some twenty that wait in vain, for nothing
# is left of what newer ones replaced, one or two that are taken, and as much if there are none.
SERVING = 2e-4


class Warnings:
    """Warnings of a node, of which one of a kind is logged at most every few seconds."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._last: dict[str, float] = {}

    def __call__(self, kind: str, sentence: str) -> None:
        """Log a warning, unless one of its kind was logged just before."""
        now = time.monotonic()
        if now - self._last.get(kind, -WARN_PERIOD) >= WARN_PERIOD:
            self._last[kind] = now
            self._node.get_logger().warning(sentence)


def make_executor(node: Node) -> Executor:
    """Return an executor that serves the node through `spin_once`."""
    executor = EventsExecutor()
    executor.add_node(node)
    return executor


def serve_some(executor: Executor) -> None:
    """Serve messages that wait, but not so many or so large ones that the caller would starve."""
    end = time.perf_counter() + SERVING
    while time.perf_counter() < end:
        executor.spin_once(timeout_sec=0)


def run_node(
    make: Callable[[], N], run: Callable[[N, Event], None], args: list[str] | None = None
) -> int:
    """
    Start rclpy, make a node, run it, and end cleanly on SIGINT and SIGTERM.

    A signal ends the making of the node at once. Once it runs, a signal sets the event that `run`
    takes: the handlers of rclpy would shut the context down while the node still publishes.

    Returns
    -------
    int
        2 if a parameter is not usable; one sentence says which and why. Otherwise the process ends
        here, with exit status 0.

    """
    if not os.access(os.path.expanduser('~'), os.W_OK):
        os.environ.setdefault('ROS_LOG_DIR', tempfile.gettempdir())
    stop = Event()

    def interrupt(number: int, frame: FrameType | None) -> None:
        stop.set()
        raise KeyboardInterrupt

    def ignore_interrupt(ignored: Any) -> None:
        # In a callback of the compiler the interruption is lost; `run` ends at once then.
        if not (stop.is_set() and ignored.exc_type is KeyboardInterrupt):
            sys.__unraisablehook__(ignored)

    try:
        sys.unraisablehook = ignore_interrupt
        _on_signals(interrupt)
        _initialize(args)
        _refuse_arguments(remove_ros_args(sys.argv if args is None else args)[1:])
        try:
            node = make()
        except ValueError as error:
            if 'PARAMETER_NOT_SET' not in str(error):
                raise
            raise ParameterError('a parameter is an empty list; write it as text: "[]"') from None
        _on_signals(lambda number, frame: stop.set())
        gc.freeze()  # what the compiler made stays; to look through it takes 50 ms every time
        run(node, stop)
        node.destroy_node()
        del node
    except ParameterError as error:
        print(f'error: {error}', file=sys.stderr, flush=True)
        return 2
    except (KeyboardInterrupt, RuntimeError):  # the middleware turns the one into the other
        if not stop.is_set():
            raise
    finally:
        rclpy.try_shutdown()
    end_at_once()


def end_at_once() -> NoReturn:
    """
    End the process with exit status 0, once the middleware is released.

    To take itself and the compiled code apart the interpreter needs 0.3 s, on a busy machine
    seconds, and a node is to end within two.
    """
    gc.collect()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)


def _on_signals(handler: Callable[[int, FrameType | None], None]) -> None:
    for number in SIGNALS:
        signal.signal(number, handler)


def _initialize(args: list[str] | None) -> None:
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        reason, _, _ = str(error).partition(', at ')  # a line in the source of rcl
        raise ParameterError(reason) from None


def _refuse_arguments(arguments: list[str]) -> None:
    """End with a usage message if there is anything but arguments of ROS."""
    argparse.ArgumentParser(
        prog=os.path.basename(sys.argv[0]),
        usage='%(prog)s [--ros-args [-p NAME:=VALUE ...] [--params-file FILE] [-r FROM:=TO ...]]',
        epilog='ros2 param list shows the parameters of a node that runs.',
    ).parse_args(arguments)

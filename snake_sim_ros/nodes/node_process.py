# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""How the process of a node or of a command starts and ends."""

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
import ctypes
import faulthandler
import gc
from importlib.metadata import version
import os
import sys
import tempfile
from threading import Event
import time
from types import FrameType
from typing import Any, NoReturn, TypeVar

import rclpy
from rclpy.exceptions import (
    InvalidParameterException,
    InvalidParameterValueException,
    NameValidationException,
)
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from snake_sim_ros.nodes.programs import interruptible, on_signals
from snake_sim_ros.scene.checked_records import cut, LONGEST_REASON, ParameterError
from snake_sim_ros.scene.files import CONFIG

PROFILES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
USE_PROFILES = 'RMW_FASTRTPS_USE_QOS_FROM_XML'
# With profiles, the last one of these would be ignored.
OF_USER = (*PROFILES, USE_PROFILES, 'RMW_FASTRTPS_PUBLICATION_MODE')
# Each of the many buffers of a subscription keeps the size of the largest message it ever held,
# unless Fast DDS is configured otherwise. Its variable has the second name from kilted on, which
# warns of the first one.
NO_BUFFERS = {
    USE_PROFILES: '1',
    PROFILES[int(version('rclpy').partition('.')[0]) >= 9]: str(CONFIG / 'fastdds_no_buffers.xml'),
}


def keep_no_buffers() -> None:
    """Have this process keep no buffers of messages; settings of the user come first."""
    if not any(name in os.environ for name in OF_USER):
        os.environ.update(NO_BUFFERS)


N = TypeVar('N', bound=Node)
LONGEST_END = 1.5  # s from a signal to the end of the process, whatever the middleware does
SIGEV_THREAD = 2  # of the C library: a thread calls the function of an event


def run_node(
    make: Callable[[], N], run: Callable[[N, Event], None], args: list[str] | None = None
) -> int:
    """
    Start rclpy, make a node, run it, and end cleanly on SIGINT, SIGTERM and SIGHUP.

    While the node is being made, a signal ends the process at once. Once the node runs, a signal
    sets the event that `run` takes. The handlers of rclpy would shut down the context while the
    node still publishes, so they are not used.

    Fast DDS may wait forever while it is destroyed. If it has not ended `LONGEST_END` after the
    signal, the process ends with exit status 1, and standard error says `Timeout` and where each
    thread is.

    Parameters
    ----------
    make : callable
        Returns the node.
    run : callable
        Takes the node and the event, and returns soon after the event is set.
    args : list of str, optional
        Command line with the name of the program; default: that of the process.

    Returns
    -------
    int
        2 if a parameter is not usable, or if memory does not suffice; one sentence on standard
        error says which and why. In all other cases the process ends here, with exit status 0.

    """
    if not os.access(os.path.expanduser('~'), os.W_OK):
        os.environ.setdefault('ROS_LOG_DIR', tempfile.gettempdir())
    stop = Event()
    try:
        _interrupt_on_signals(stop)
        keep_no_buffers()
        initialize(args)
        _refuse_arguments(remove_ros_args(sys.argv if args is None else args)[1:])
        node = made(make)
        on_signals(lambda number, frame: end_soon(stop))
        gc.freeze()  # The objects of the compiler stay, and each look through them takes 50 ms.
        run(node, stop)
        node.destroy_node()
        del node
    except ParameterError as error:
        print(f'error: {error}', file=sys.stderr, flush=True)
        return 2
    except MemoryError as error:
        print(f'error: not enough memory: {error}'.removesuffix(': '), file=sys.stderr, flush=True)
        return 2
    except (KeyboardInterrupt, RuntimeError):  # The middleware turns one into the other.
        if not stop.is_set():
            raise
    finally:
        end_soon(stop)
        rclpy.try_shutdown()
        gc.collect()  # which releases what is left of the middleware
        faulthandler.cancel_dump_traceback_later()
    end_at_once()


def run_client(act: Callable[[Node, Callable[[], bool]], None]) -> int:
    """
    Start rclpy and a hidden node for one command, run it, and return its exit status.

    Fast DDS may wait forever while it is destroyed, above all if it has just started. The work of
    the command is done by then: if the destruction takes longer than `LONGEST_END`, the process
    ends with the status that it would have had.

    Parameters
    ----------
    act : callable
        Takes the node, and a function that returns whether a signal has come.

    Returns
    -------
    int
        0; 1 after a sentence on what cannot be done; 130 after a signal.

    """
    status = 1
    with interruptible() as stop:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        node = Node(
            f'_snake_sim_{os.getpid()}',
            start_parameter_services=False,
            enable_rosout=False,
            parameter_overrides=[Parameter('start_type_description_service', value=False)],
        )
        try:
            act(node, stop.is_set)
            status = 0
        except (ParameterError, NameValidationException) as error:
            print(' '.join(str(error).split()), file=sys.stderr)
        except KeyboardInterrupt:
            status = 130
        except BrokenPipeError:  # as of `| head`
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            status = 0
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            with end_within(LONGEST_END, status):
                node.destroy_node()
                rclpy.try_shutdown()
                del node
                gc.collect()  # which releases what is left of the middleware
    return status


@contextmanager
def end_within(seconds: float, status: int) -> Iterator[None]:
    """
    Have the process end with an exit status unless the context is left in time.

    The middleware may hang with the lock of the interpreter, so that neither a thread nor a signal
    handler of Python would run. A timer of the C library starts a thread that calls ``_exit``.
    """
    library = ctypes.CDLL(None, use_errno=True)
    end = ctypes.cast(library._exit, ctypes.c_void_p)
    event, timer = _Event(status, 0, SIGEV_THREAD, end), ctypes.c_void_p()
    when = (ctypes.c_long * 4)(0, 0, *(int(x) for x in divmod(seconds * 1e9, 1e9)))
    if library.timer_create(time.CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)):
        raise OSError(ctypes.get_errno(), 'timer_create')
    library.timer_settime(timer, 0, ctypes.byref(when), None)
    try:
        yield
    finally:
        library.timer_delete(timer)


class _Event(ctypes.Structure):
    """The beginning of a ``sigevent`` of the C library: what happens when a timer is up."""

    _fields_ = (
        ('argument', ctypes.c_void_p),
        ('signal', ctypes.c_int),
        ('notify', ctypes.c_int),
        ('function', ctypes.c_void_p),
        ('rest', ctypes.c_char * 40),
    )


def made(make: Callable[[], N]) -> N:
    """
    Return a node that is made with the parameters that the user gave.

    Raises
    ------
    ParameterError
        If one of them is not usable, for the node or for rclpy, or if security is asked for that
        the middleware does not have.

    """
    try:
        return make()
    except (InvalidParameterException, InvalidParameterValueException) as error:
        raise ParameterError(one_line(error)) from None
    except rclpy_implementation.RCLError as error:
        if 'security' not in str(error).lower():
            raise
        raise ParameterError(one_line(error)) from None
    except ValueError as error:
        if 'PARAMETER_NOT_SET' not in str(error):
            raise
        raise ParameterError('a parameter is an empty list; write it as text: "[]"') from None


def end_soon(stop: Event) -> None:
    """
    Set the event, and have the process end `LONGEST_END` after it was first set.

    Only a thread in C that needs no lock of the interpreter ends a process whose main thread waits
    in the middleware with that lock; a thread of Python or a handler of signals would wait, too.
    """
    if not stop.is_set():
        faulthandler.dump_traceback_later(LONGEST_END, exit=True, file=2)
        stop.set()


def end_at_once() -> NoReturn:
    """
    End the process with exit status 0 when the middleware is released.

    A regular exit frees the interpreter and the compiled code, which takes 0.3 s, and seconds on a
    busy machine. A node must end within two seconds.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)


def _interrupt_on_signals(stop: Event) -> None:
    """Let a signal set the event and interrupt whatever runs."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        end_soon(stop)
        raise KeyboardInterrupt

    def ignore_interrupt(ignored: Any) -> None:
        # A callback of the compiler swallows the interruption, but `run` then ends at once.
        if not (stop.is_set() and ignored.exc_type is KeyboardInterrupt):
            sys.__unraisablehook__(ignored)

    sys.unraisablehook = ignore_interrupt
    on_signals(interrupt)


def one_line(error: Exception) -> str:
    """Return what a library says, in one line and without a line of its source."""
    reason, _, _ = str(error).partition(', at ')
    return cut(' '.join(reason.split()), LONGEST_REASON)


def initialize(args: list[str] | None) -> None:
    """
    Start rclpy.

    Raises
    ------
    ParameterError
        If the arguments, or files of parameters that they name, are not usable.

    """
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        raise ParameterError(one_line(error)) from None


def _refuse_arguments(arguments: list[str]) -> None:
    """End the process with a usage message if arguments are left that ROS does not know."""
    argparse.ArgumentParser(
        prog=os.path.basename(sys.argv[0]),
        usage='%(prog)s [--ros-args [-p NAME:=VALUE ...] [--params-file FILE] [-r FROM:=TO ...]]',
        epilog='ros2 param list shows the parameters of a node that runs.',
    ).parse_args(arguments)

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The recorder of `snake-sim record`: all topics as an MCAP bag, until a signal ends it."""

from functools import partial
import gc
from importlib import import_module
from pathlib import Path
import sys
from threading import Event
import time

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from snake_sim_ros.nodes.bag_writer import BagWriter
from snake_sim_ros.nodes.executors import make_executor
from snake_sim_ros.nodes.node_process import end_within, LONGEST_END
from snake_sim_ros.nodes.programs import interruptible
from snake_sim_ros.scene.checked_records import ParameterError

QUEUE = 10_000  # messages of a topic that may wait, about ten seconds of the fastest topic
LOOK_PERIOD = 0.2  # s between two looks for new topics
DRAIN = 0.2  # s to wait at the end for messages that are still on their way


class TopicRecorder(Node):
    """A node that subscribes to all topics and writes the bytes of their messages."""

    def __init__(self, bag: BagWriter) -> None:
        super().__init__('recorder')
        self._bag = bag
        self.failure: OSError | None = None  # to write
        self._refused: set[tuple[str, str]] = set()

    def look(self) -> None:
        """Subscribe to the topics that are new."""
        for topic, kinds in self.get_topic_names_and_types():
            # Hidden ones, such as those of actions, are left out as by `ros2 bag record --all`.
            if '/_' in topic or topic in self._bag.counts or not self.count_publishers(topic):
                continue
            if len(kinds) == 1:
                self._subscribe(topic, kinds[0])
            else:
                self._refuse(topic, f'it has several types: {", ".join(sorted(kinds))}')

    def _subscribe(self, topic: str, kind: str) -> None:
        """Subscribe with the quality of service that all publishers offer."""
        profiles = [info.qos_profile for info in self.get_publishers_info_by_topic(topic)]
        reliable = all(each.reliability == ReliabilityPolicy.RELIABLE for each in profiles)
        latched = all(each.durability == DurabilityPolicy.TRANSIENT_LOCAL for each in profiles)
        qos = QoSProfile(
            depth=QUEUE,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=(
                DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
            ),
        )
        package, _, name = kind.split('/')
        try:
            message = getattr(import_module(f'{package}.msg'), name)
            self._bag.add_topic(topic, message, qos)
        except (ImportError, AttributeError, FileNotFoundError):
            self._refuse(topic, f'its type {kind} is not installed')
            return
        self.create_subscription(message, topic, partial(self._take, topic), qos, raw=True)

    def _take(self, topic: str, data: bytes) -> None:
        try:
            self._bag.write(topic, time.time_ns(), data)
        except OSError as error:  # An executor prints errors of callbacks with their traceback.
            self.failure = self.failure or error

    def _refuse(self, topic: str, why: str) -> None:
        """Print once why a topic is not recorded."""
        if (topic, why) not in self._refused:
            self._refused.add((topic, why))
            print(f'{topic} is not recorded: {why}', file=sys.stderr)


def record_topics(path: Path) -> int:
    """
    Record all topics until SIGINT or SIGTERM; the bag has the times at which messages arrive.

    Returns
    -------
    int
        0

    Raises
    ------
    ParameterError
        If the file exists already, or its folder does not.

    """
    if path.exists():
        raise ParameterError(f'{path} exists; remove it, or choose another name')
    if not path.absolute().parent.is_dir():
        raise ParameterError(f'{path}: no folder {path.absolute().parent}')
    with interruptible() as stop:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        status = 2
        try:
            with BagWriter(path) as bag:
                _record(bag, path, stop)
            status = 0
        finally:
            sys.stdout.flush()
            with end_within(LONGEST_END, status):  # The bag is complete by now.
                rclpy.try_shutdown()
                gc.collect()  # which releases the node
    return 0


def _record(bag: BagWriter, path: Path, stop: Event) -> None:
    node = TopicRecorder(bag)
    executor = make_executor(node)
    print(f'recording all topics in {path}; Ctrl-C ends it', flush=True)
    looked = shown = 0.0
    end: float | None = None
    while end is None or time.monotonic() < end:
        executor.spin_once(timeout_sec=0.05)
        now = time.monotonic()
        if node.failure:
            print()
            raise node.failure
        if stop.is_set() and end is None:
            end = now + DRAIN
        if now - looked > LOOK_PERIOD:
            looked = now
            node.look()
        if now - shown > 1.0:
            shown = now
            print(f'\r{_summary(bag)}', end='', flush=True)
    print(f'\r{_summary(bag)} in {path}')


def _summary(bag: BagWriter) -> str:
    return f'{sum(bag.counts.values())} messages of {len(bag.counts)} topics'

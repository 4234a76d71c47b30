# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A node ends within two seconds of a signal, whatever the middleware does."""

import ctypes
import signal
import time

from forks import Forked
from programs import next_domain
import rclpy
from rclpy.node import Node

from snake_sim_ros.nodes import node_process

TIME_TO_END = 2.0  # s
SOON = {'node_process.LONGEST_END': 0.5}  # s, else 1.5 s
NODES = 20  # that end together


def hang_with_the_lock_of_the_interpreter(*_):
    while True:  # a signal ends a call
        ctypes.PyDLL(None).sleep(60)


def hang_without_it(*_):
    time.sleep(60)  # goes on after a signal


def fail(*_):
    raise ZeroDivisionError


def run(node, stop):
    print('runs', flush=True)
    while not stop.is_set():
        rclpy.spin_once(node, timeout_sec=0.05)


def run_a_node(changes):
    """Run a node with other values in place of some, such as a function that hangs."""
    owners = {'Node': Node, 'rclpy': rclpy, 'node_process': node_process}
    for name, value in changes.items():
        owner, _, attribute = name.partition('.')
        setattr(owners[owner], attribute, value)
    return node_process.run_node(lambda: Node('node'), run, ['node'])


LOCKED, FREE = hang_with_the_lock_of_the_interpreter, hang_without_it


def start(changes=None, domain=0):
    return Forked(run_a_node, changes or {}, domain=domain or next_domain())


def test_a_node_whose_middleware_hangs_ends_and_says_where():
    cases = [
        (start({what: how}), how, number)
        for what in ('Node.destroy_node', 'rclpy.try_shutdown')
        for how, number in ((LOCKED, signal.SIGINT), (FREE, signal.SIGTERM))
    ]
    for process, *_ in cases:
        process.wait_for('runs')
    begin = time.monotonic()
    for process, _, number in cases:
        process.popen.send_signal(number)
    for process, how, _ in cases:
        assert process.wait() == 1
        assert time.monotonic() - begin < TIME_TO_END
        assert process.count('Timeout (0:00:01.5') == 1, process.output
        assert process.count(f' in {how.__name__}') == 1, process.output


def test_more_signals_do_not_put_off_the_end():
    process = start({'Node.destroy_node': LOCKED, **SOON})
    process.wait_for('runs')
    begin = time.monotonic()
    while process.popen.poll() is None and time.monotonic() < begin + 2 * TIME_TO_END:
        process.popen.send_signal(signal.SIGINT)
        time.sleep(0.1)
    assert process.wait() == 1
    assert time.monotonic() - begin < TIME_TO_END


def test_a_node_that_cannot_be_made_ends_if_its_middleware_hangs():
    process = start({'rclpy.try_shutdown': LOCKED, 'Node.__init__': fail, **SOON})
    assert process.wait() == 1
    assert process.count('Timeout (0:00:00.5') == 1, process.output


def test_nodes_that_end_together_end_in_time():
    domain = next_domain()
    processes = [start(domain=domain) for _ in range(NODES)]
    for process in processes:
        process.wait_for('runs', 60.0)
    begin = time.monotonic()
    for process in processes:
        process.popen.send_signal(signal.SIGINT)
    statuses = [process.wait() for process in processes]
    assert time.monotonic() - begin < TIME_TO_END
    assert statuses == [0] * NODES, [process.output for process in processes]
    assert not any('Timeout' in process.output for process in processes)

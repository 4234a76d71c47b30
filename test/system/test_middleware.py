# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Processes of nodes give back the memory of large messages, unless the user has other wishes."""

import os
import subprocess
import sys

from programs import environment, next_domain
import pytest

from snake_sim_ros.nodes.node_process import keep_no_buffers, NO_BUFFERS, OF_USER, USE_PROFILES

# The GNU C library gives blocks of this size [B] back as soon as they are free: memory is then
# what the node uses, and not that of a heap with holes.
GIVEN_BACK = {'MALLOC_MMAP_THRESHOLD_': '131072'}
MEGABYTES, MESSAGES = 4, 25  # of messages that a node sends to itself
# Prints how much the memory of such a node grows [MB].
NODE = f"""
from pathlib import Path
from rclpy.node import Node
from std_msgs.msg import String
from snake_sim_ros.nodes.executors import make_executor, served_until
from snake_sim_ros.nodes.node_process import run_node

def resident():
    return int(Path('/proc/self/statm').read_text().split()[1]) * 4096e-6

def run(node, stop):
    seen, executor = [], make_executor(node)
    node.create_subscription(String, 'own', lambda data: seen.append(len(data)), 30, raw=True)
    own = node.create_publisher(String, 'own', 1)
    assert served_until(executor, own.get_subscription_count, 10.0, 0.01)
    before = resident()
    for _ in range({MESSAGES}):
        own.publish(String(data='x' * {MEGABYTES * 10**6}))
    assert served_until(executor, lambda: len(seen) == {MESSAGES}, 10.0, 0.01)
    print(resident() - before)

run_node(lambda: Node('large'), run, ['large'])
"""


@pytest.fixture
def growth():
    """Return by how much the memory of a node grew [MB], with some variables set."""

    def measure(**variables):
        own = environment(next_domain()) | GIVEN_BACK
        own = {name: text for name, text in own.items() if name not in OF_USER} | variables
        done = subprocess.run(
            [sys.executable, '-c', NODE], env=own, capture_output=True, text=True, timeout=60.0
        )
        assert done.returncode == 0, done.stderr
        return float(done.stdout)

    return measure


def test_a_node_keeps_no_buffers(growth):
    assert growth() < 5 * MEGABYTES


def test_settings_of_the_user_come_first(growth):
    assert growth(**{USE_PROFILES: '0'}) > 0.8 * MEGABYTES * MESSAGES


@pytest.mark.parametrize('name', OF_USER)
def test_each_setting_of_the_user_comes_first(name, monkeypatch):
    monkeypatch.setattr(os, 'environ', {name: 'of the user'})
    keep_no_buffers()
    assert os.environ == {name: 'of the user'}


def test_the_profile_is_a_file_of_the_package(monkeypatch):
    monkeypatch.setattr(os, 'environ', {})
    keep_no_buffers()
    assert os.environ == NO_BUFFERS
    assert [path for path in NO_BUFFERS.values() if os.path.isfile(path)]

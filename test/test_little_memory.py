# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nodes with little memory, and clocks that are set: what they say, and what is read of a bag."""

import subprocess
import sys
import tracemalloc

import pytest
from rclpy.serialization import serialize_message
from std_msgs.msg import Header

pytest.importorskip('mcap_ros2')  # bag_writer needs it
from snake_sim_ros.nodes.bag_writer import BagWriter, STATES
from snake_sim_ros.nodes.received_commands import axes_of, RejectedCommand
from snake_sim_ros.nodes.tools.bag_without_end import what_is_wrong_with_stamps
from snake_sim_ros.reliability.clock_steps import WallClock
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.quoting import cut


def test_a_node_with_too_little_memory_names_the_limit():
    limited = (
        'import resource, runpy, sys; '
        'resource.setrlimit(resource.RLIMIT_AS, (5 * 10**8, 5 * 10**8)); '
        'sys.argv[1:] = ["gait"]; '
        'runpy.run_module("snake_sim_ros.nodes", run_name="__main__", alter_sys=True)'
    )
    ended = subprocess.run(
        [sys.executable, '-c', limited], capture_output=True, text=True, timeout=60, check=False
    )
    assert ended.returncode == 2
    assert ended.stderr == (
        'error: gait needs 600 MB of memory addresses, and the limit (ulimit -v) is 500 MB\n'
    )


def test_a_very_long_name_of_a_joint_takes_little_memory():
    name = 'x' * 10**7
    tracemalloc.start()
    try:
        with pytest.raises(RejectedCommand, match='unknown joint') as caught:
            axes_of('joint_command', [name], Scene().robot)
        assert tracemalloc.get_traced_memory()[1] < 1e6
    finally:
        tracemalloc.stop()
    assert len(str(caught.value)) < 250
    assert cut('a' + name + 'b') == f'a{"x" * 37}...{"x" * 37}b'


def test_stamps_of_a_bag_that_go_back_are_told(tmp_path):
    for name, seconds, told in (
        ('good', (1, 2, 3), ''),
        ('bad', (1, 2, 2, 1), '2 of 4 stamps of a do not grow'),
        ('empty', (), 'empty has no a'),
    ):
        with BagWriter(tmp_path / name) as bag:
            bag.add_topic('a', Header, STATES)
            for k, sec in enumerate(seconds):
                header = Header(frame_id='world')
                header.stamp.sec = sec
                bag.write('a', 10 - k, serialize_message(header))
        assert what_is_wrong_with_stamps(tmp_path / name, 'a') == told
    assert 'cannot be read' in what_is_wrong_with_stamps(tmp_path / 'none', 'a')


def test_a_wall_clock_is_set_through_its_file(tmp_path):
    clock = WallClock(tmp_path)
    path = tmp_path / 'offset'
    assert clock.environment['FAKETIME_TIMESTAMP_FILE'] == str(path)
    for seconds, text in ((0.0, '+0s\n'), (-3600.0, '-3600s\n'), (0.1, '+0.1s\n')):
        clock.step(seconds)
        assert path.read_text() == text

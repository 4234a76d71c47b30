# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the faults are made of: a wall clock that is set, and what is read of a damaged bag."""

import pytest
from rclpy.serialization import serialize_message
from std_msgs.msg import Header

pytest.importorskip('mcap_ros2')  # bag_writer needs it
from snake_sim_benchmarks.reliability.failing_resources import what_is_wrong_with_stamps
from snake_sim_benchmarks.reliability.faults import WallClock
from snake_sim_ros.nodes.bag_writer import BagWriter, STATES


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

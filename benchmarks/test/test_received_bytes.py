# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Damaged messages: one error each, and nothing that the middleware prints by itself."""

import random

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from snake_sim_benchmarks.reliability.hostile_messages import (
    damaged,
    good_message,
    hostile_message,
)
from snake_sim_ros import Robot
from snake_sim_ros.nodes.received_bytes import DamagedMessage, message_from
from snake_sim_ros.nodes.received_commands import RejectedCommand
from snake_sim_ros.nodes.received_trajectories import read_trajectory

KINDS = (DiagnosticArray, Float64MultiArray, JointState, MarkerArray, PoseStamped, String)


@pytest.mark.parametrize('kind', KINDS, ids=lambda kind: kind.__name__)
def test_damaged_bytes_are_one_error_and_print_nothing(kind, capfd):
    rng, refused = random.Random(1), 0
    good = good_message(kind, rng)
    assert message_from(serialize_message(good), kind) == good
    for _ in range(150):
        data = damaged(serialize_message(good), rng)
        try:
            message_from(data, kind)
        except DamagedMessage as error:
            refused += 1
            assert str(error).startswith(f'a message of {len(data)} bytes is damaged')
    assert refused > 20
    assert capfd.readouterr().err == ''


def test_bytes_in_the_other_order_are_read_too():
    message = String(data='abc')
    data = b'\x00\x00\x00\x00\x00\x00\x00\x04abc\x00'
    assert message_from(data, String) == message
    with pytest.raises(DamagedMessage):
        message_from(b'\x07' + data[1:], String)


def test_hostile_trajectories_are_taken_or_rejected():
    rng = random.Random(2)
    for _ in range(150):
        data = hostile_message(JointTrajectory, rng)
        try:
            read_trajectory(data, Robot())
        except RejectedCommand as error:
            assert str(error).startswith('joint_trajectory')

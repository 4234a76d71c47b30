# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Messages from and to YAML, as the commands topic and service read and print them."""

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseArray, PoseWithCovariance, Twist
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import ByteMultiArray, Int8, String, UInt8MultiArray
from std_srvs.srv import SetBool
import yaml

from snake_sim_ros.nodes.graph.client import GraphError
from snake_sim_ros.nodes.graph.message_fields import as_yaml, filled, interface

# Every kind of field that the interfaces of the robot have.
MESSAGES = [
    (Twist, '{linear: {x: 1, y: 1e-3, z: .inf}, angular: {z: -2.5}}'),
    (JointState, '{header: {stamp: {sec: 3}, frame_id: a}, name: [b, 4], position: [0.5, 1]}'),
    (PoseArray, '{poses: [{position: {x: 1}}, {orientation: {w: 0}}]}'),
    (PoseWithCovariance, f'{{covariance: {[0.5] * 36}}}'),
    (DiagnosticStatus, '{level: 2, message: äöü, values: [{key: a, value: "1"}]}'),
    (UInt8MultiArray, '{layout: {dim: [{label: a, size: 2}]}, data: [0, 255]}'),
    (ByteMultiArray, '{data: [0, 255]}'),
    (SetBool.Request, '{data: true}'),
    (String, '{}'),
]


@pytest.mark.parametrize(('kind', 'text'), MESSAGES, ids=[kind.__name__ for kind, _ in MESSAGES])
def test_what_is_written_is_read(kind, text, monkeypatch):
    monkeypatch.setenv('ROS_PYTHON_CHECK_FIELDS', '1')
    message = filled(kind(), text)
    shown = as_yaml(message, None, False)
    if kind not in (ByteMultiArray, DiagnosticStatus):  # bytes are shown as characters, as by ros2
        assert filled(kind(), shown) == message
    assert yaml.safe_load(as_yaml(message, None, True)) == yaml.safe_load(shown)


def test_numbers_are_of_their_types():
    twist = filled(Twist(), '{linear: {x: 1, y: 1e-3}}')
    assert (type(twist.linear.x), twist.linear.y) == (float, 1e-3)
    status = filled(DiagnosticStatus(), '{level: 2, values: [{key: a}]}')
    assert status.level == DiagnosticStatus.ERROR and status.values == [KeyValue(key='a')]
    covariance = filled(PoseWithCovariance(), f'{{covariance: {[1] * 36}}}').covariance
    assert covariance.dtype == np.float64 and covariance.sum() == 36.0


def test_long_arrays_and_texts_are_cut_off():
    message = JointState(name=['a'] * 4, position=[1.0] * 5)
    shown = yaml.safe_load(as_yaml(message, 4, False))
    assert shown['name'] == ['a'] * 4 and shown['position'] == [1.0] * 4 + ['...']
    assert as_yaml(String(data='abcdef'), 4, False) == 'data: abcd...\n'


@pytest.mark.parametrize(
    ('kind', 'text', 'sentence'),
    [
        (Twist, '3', 'needs to be a dictionary in YAML format, such as "{linear: {}}", got \'3\''),
        (String, 'a', 'needs to be a dictionary in YAML format, such as "{data: \'\'}", got'),
        (Twist, '{linear: ', 'The passed value is no YAML: while parsing'),
        (Twist, '{linear: 1}', 'linear must be a mapping, such as {x: 0.0}, got 1'),
        (Twist, '{linear: {q: 1}}', 'no field q, the fields that linear has are: x, y, z'),
        (Twist, '{linear: {x: fast}}', "linear.x must be a number, got 'fast'"),
        (Twist, '{linear: {x: true}}', 'linear.x must be a number, got True'),
        (Twist, '{linear: {x: null}}', 'linear.x must be a number, got None'),
        (JointState, '{position: 1}', 'position must be a list, got 1'),
        (JointState, '{position: [1, a]}', "position[1] must be a number, got 'a'"),
        (JointState, '{header: {stamp: {sec: 1.5}}}', 'header.stamp.sec must be a whole number'),
        (JointState, '{header: {stamp: {nanosec: -1}}}', 'must be 0 to 4294967295, got -1'),
        (PoseArray, '{poses: [1]}', 'poses[0] must be a mapping, such as {position: {}}, got 1'),
        (PoseWithCovariance, '{covariance: [1]}', 'covariance must have 36 elements, got 1'),
        (UInt8MultiArray, '{data: [256]}', 'data[0] must be 0 to 255, got 256'),
        (Int8, '{data: -129}', 'data must be -128 to 127, got -129'),
        (SetBool.Request, '{data: maybe}', "data must be true or false, got 'maybe'"),
    ],
)
def test_values_that_do_not_fit_are_one_sentence(kind, text, sentence):
    with pytest.raises(GraphError) as refused:
        filled(kind(), text)
    assert sentence in str(refused.value) and '\n' not in str(refused.value)


@pytest.mark.parametrize('name', ['std_msgs/msg/String', 'std_msgs/String'])
def test_names_of_types(name):
    assert interface(name, 'msg') is String


@pytest.mark.parametrize(
    ('name', 'kind', 'sentence'),
    [
        ('std_msgs/msg/Strin', 'msg', 'The passed message type is invalid: std_msgs/msg/Strin is'),
        ('String', 'msg', 'The passed message type is invalid: String is not installed, or not'),
        ('no_msgs/msg/String', 'msg', 'The passed message type is invalid'),
        ('std_msgs.msg/a b', 'msg', 'The passed message type is invalid'),
        ('std_srvs/srv/Bool', 'srv', 'The passed service type is invalid: std_srvs/srv/Bool is'),
        ('std_msgs/msg/String', 'srv', 'The passed type is not a service: std_msgs/msg/String'),
        ('std_srvs/srv/SetBool', 'msg', 'The passed type is not a message: std_srvs/srv/SetBool'),
    ],
)
def test_types_that_are_not_there(name, kind, sentence):
    with pytest.raises(GraphError, match=sentence):
        interface(name, kind)

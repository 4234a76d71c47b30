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

from snake_sim_ros import ParameterError
from snake_sim_ros.nodes.graph import as_yaml, filled, interface
from snake_sim_ros.scene.files import parse_yaml

pytestmark = pytest.mark.fast

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


def read(kind, text):
    return filled(kind, parse_yaml(text))


@pytest.mark.parametrize(('kind', 'text'), MESSAGES, ids=[kind.__name__ for kind, _ in MESSAGES])
def test_what_is_written_is_read(kind, text):
    message = read(kind, text)
    if kind not in (ByteMultiArray, DiagnosticStatus):  # bytes are shown as characters, as by ros2
        assert read(kind, as_yaml(message)) == message
    assert list(yaml.safe_load(as_yaml(message))) == list(message.get_fields_and_field_types())


def test_numbers_are_of_their_types():
    twist = read(Twist, '{linear: {x: 1, y: 1e-3}}')
    assert (type(twist.linear.x), twist.linear.y) == (float, 1e-3)
    status = read(DiagnosticStatus, '{level: 2, values: [{key: a}]}')
    assert status.level == DiagnosticStatus.ERROR and status.values == [KeyValue(key='a')]
    covariance = read(PoseWithCovariance, f'{{covariance: {[1] * 36}}}').covariance
    assert covariance.dtype == np.float64 and covariance.sum() == 36.0


@pytest.mark.parametrize(
    ('kind', 'text', 'sentence'),
    [
        (Twist, '3', 'The passed value must be a mapping in YAML, with some of the fields linear'),
        (String, 'a', "with some of the fields data; got 'a'"),
        (Twist, '{linear: ', 'not readable as YAML: while parsing'),
        (Twist, '{linear: 1}', 'linear must be a mapping in YAML, with some of the fields x, y'),
        (Twist, '{linear: {q: 1}}', 'there is no field linear.q; the fields there are: x, y, z'),
        (Twist, '{linear: {x: fast}}', "'x' field must be of type 'float', got 'fast'"),
        (
            Twist,
            '{linear: {x: true}}',
            "linear.x: The 'x' field must be of type 'float'",
        ),
        (Twist, '{linear: {x: null}}', "'x' field must be of type 'float', got None"),
        (JointState, '{position: 1}', "position: The 'position' field must be a set or sequence"),
        (JointState, '{position: [1, a]}', "each value of type 'float', got [1, 'a']"),
        (JointState, '{header: {stamp: {sec: 1.5}}}', "header.stamp.sec: The 'sec' field must be"),
        (JointState, '{header: {stamp: {nanosec: -1}}}', 'an unsigned integer in [0, 4294967295]'),
        (PoseArray, '{poses: [1]}', 'poses[0] must be a mapping in YAML, with some of the fields'),
        (PoseWithCovariance, '{covariance: [1]}', 'must be a set or sequence with length 36'),
        (UInt8MultiArray, '{data: [256]}', 'each unsigned integer in [0, 255], got [256]'),
        (Int8, '{data: -129}', 'must be an integer in [-128, 127], got -129'),
        (SetBool.Request, '{data: maybe}', "'data' field must be of type 'bool', got 'maybe'"),
    ],
)
def test_values_that_do_not_fit_are_one_sentence(kind, text, sentence):
    with pytest.raises(ParameterError) as refused:
        read(kind, text)
    assert sentence in str(refused.value) and '\n' not in str(refused.value)


@pytest.mark.parametrize('name', ['std_msgs/msg/String', 'std_msgs/String'])
def test_names_of_types(name):
    assert interface(name, 'msg') is String


@pytest.mark.parametrize(
    ('name', 'kind', 'sentence'),
    [
        ('std_msgs/msg/Strin', 'msg', "'std_msgs/msg/Strin' is not the type of a message that is"),
        ('String', 'msg', 'installed; write it as in sensor_msgs/msg/JointState'),
        ('no_msgs/msg/String', 'msg', 'is not the type of a message'),
        ('std_msgs.msg/a b', 'msg', 'is not the type of a message'),
        ('std_srvs/srv/Bool', 'srv', "'std_srvs/srv/Bool' is not the type of a service"),
        ('std_msgs/msg/String', 'srv', 'installed; write it as in std_srvs/srv/Trigger'),
        ('std_srvs/srv/SetBool', 'msg', "'std_srvs/srv/SetBool' is not the type of a message"),
    ],
)
def test_types_that_are_not_there(name, kind, sentence):
    with pytest.raises(ParameterError, match=sentence):
        interface(name, kind)

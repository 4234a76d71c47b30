# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Hostile parameters and their files: a node refuses them in one sentence, and stays."""

from forks import node
from geometry_msgs.msg import Twist, Vector3
import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

from snake_sim_ros.gaits.steering import SLOWEST

SCENES = ('soft_start: 2001-99-99', 'dt: !!int abc', 'self_contact: !!bool maybe', '[' * 3000)


@pytest.fixture(scope='module')
def gait(make_graph):
    """A gait node with a robot that listens."""
    graph = make_graph()
    process = graph.start('gait')
    commands = graph.record(JointState, 'joint_command', depth=1)
    graph.until(lambda: commands, 'a command')
    return graph, process, commands


def set_parameter(graph, name, value):
    """Return what the node answers."""
    kind = {str: 'string', float: 'double'}[type(value)]
    given = ParameterValue(type=getattr(ParameterType, f'PARAMETER_{kind.upper()}'))
    setattr(given, f'{kind}_value', value)
    request = SetParameters.Request(parameters=[Parameter(name=name, value=given)])
    return graph.call(SetParameters, 'gait/set_parameters', request).results[0]


def test_hostile_scenes_are_refused(gait, tmp_path):
    graph, process, _ = gait
    names = ['a' * 300, 'robot\0', *(str(tmp_path / f'{k}.yaml') for k in range(len(SCENES)))]
    for k, text in enumerate(SCENES):
        (tmp_path / f'{k}.yaml').write_text(text)
    for name in names:
        answer = set_parameter(graph, 'scene', name)
        assert not answer.successful
        assert answer.reason.isprintable() and 0 < len(answer.reason) < 1000
    assert process.popen.poll() is None


def test_a_gait_that_hardly_moves_is_steered(gait):
    graph, process, commands = gait
    assert set_parameter(graph, 'gait.yaw.angular_frequency', 1e-310).successful
    publisher = graph.node.create_publisher(Twist, 'cmd_vel', QoSProfile(depth=1))
    graph.until(publisher.get_subscription_count, 'the node')
    publisher.publish(Twist(linear=Vector3(x=0.1)))
    graph.until(lambda: 'frequencies are 0' in process.output, 'the warning')
    heard = len(commands)
    graph.until(lambda: len(commands) > heard + 5, 'commands')
    assert set_parameter(graph, 'gait.yaw.angular_frequency', 2 * SLOWEST).successful
    heard = len(commands)
    graph.until(lambda: len(commands) > heard + 5, 'commands')
    assert process.popen.poll() is None


def assert_ends_in_a_sentence(process):
    assert process.wait() == 2
    sentences = [line for line in process.lines if line.startswith('error: ')]
    assert len(sentences) == 1 and 'Traceback' not in process.output


@pytest.mark.parametrize(
    'text',
    ['/**:\n  ros__parameters: {"": 1}', '/**:\n  ros__parameters: {a: &b [*b]}', '[' * 500],
)
def test_a_file_of_parameters_that_is_none_ends_the_start_in_a_sentence(text, gait, tmp_path):
    path = tmp_path / 'parameters.yaml'
    path.write_text(text)
    assert_ends_in_a_sentence(node('gait', '--params-file', str(path), domain=gait[0].domain))


def test_security_that_is_not_there_ends_the_start_in_a_sentence(gait, tmp_path, monkeypatch):
    enclave = tmp_path / 'enclaves' / 'snake'
    enclave.mkdir(parents=True)
    (enclave / 'key.pem').write_text('no key')
    monkeypatch.setenv('ROS_SECURITY_KEYSTORE', str(tmp_path))
    monkeypatch.setenv('ROS_SECURITY_ENABLE', 'true')
    monkeypatch.setenv('ROS_SECURITY_STRATEGY', 'Enforce')
    for name in ('/snake', '/nobody'):
        assert_ends_in_a_sentence(node('gait', '--enclave', name, domain=gait[0].domain))

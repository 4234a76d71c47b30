# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nodes with scenes that hold a table of joint angles, a start posture and pushes."""

import json
import re

from nav_msgs.msg import Odometry
import numpy as np
from offline import nanoseconds
import pytest
from rcl_interfaces.srv import GetParameters, ListParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from snake_sim_ros.scene.gait import reference
from snake_sim_ros.scene.parameters import load_scene

SCENE = """
gait: {table: {file: gait.csv, repeat: true}}
start: {yaw_deg: [1, 2, 3, 4, 5, 6, 7, 8, 9, 10], heading_deg: 90}
pushes: [{link: 6, force: [30, 0, 0], start: 0.1}]
"""
YAW = np.radians(np.arange(1, 11))
ROWS = [(0.0, 0.1), (0.1, 0.2), (0.2, 0.15), (0.3, 0.1)]


@pytest.fixture(scope='module')
def scene_file(tmp_path_factory):
    folder = tmp_path_factory.mktemp('scene')
    rows = [f'{time},{angle},{-angle}' for time, angle in ROWS]
    (folder / 'gait.csv').write_text('\n'.join(['time,joint_1_yaw,joint_9_yaw', *rows]))
    (folder / 'scene.yaml').write_text(SCENE)
    return folder / 'scene.yaml'


@pytest.fixture(scope='module')
def started(make_graph, scene_file):
    """A gait node and a sim node, each in a domain of its own."""
    alone, robot = make_graph(), make_graph()
    gait = alone.start('gait', f'scene:={scene_file}', 'start_from:=now')
    robot.states = robot.record(JointState, 'joint_states')
    robot.odom = robot.record(Odometry, 'odom')
    robot.start('sim', f'scene:={scene_file}')
    return alone, gait, robot


def test_the_gait_node_commands_a_table(started, scene_file):
    graph, gait, _ = started
    commands = graph.record(JointState, 'joint_command')
    graph.until(lambda: len(commands) > 100, 'commands')
    (begin,) = re.findall(r'begins at t = (\d+)\.(\d+) s', gait.output)
    wanted = load_scene(scene_file).gait
    assert wanted.table.repeat
    for message in commands[:100]:
        t = 1e-9 * (nanoseconds(message) - int(''.join(begin)))
        angle, rate = reference(wanted, t, 10)
        # A wall time as a float in the log is rounded by 0.2 us: 1 rad/s, 40 rad/s^2.
        assert np.abs(np.array(message.position) - angle.ravel()).max() < 1e-6
        assert np.abs(np.array(message.velocity) - rate.ravel()).max() < 4e-5
    names = graph.call(ListParameters, 'gait/list_parameters').result.names
    assert 'gait.yaw.amplitude' in names
    assert not [name for name in names if name.startswith('gait.table')]


def test_the_gait_node_goes_on_with_waves(started):
    graph, _, _ = started
    request = SetParametersAtomically.Request()
    request.parameters = [Parameter('scene', value='lateral_undulation').to_parameter_msg()]
    result = graph.call(SetParametersAtomically, 'gait/set_parameters_atomically', request).result
    assert result.successful, result.reason
    commands = graph.record(JointState, 'joint_command')
    graph.until(lambda: commands and np.abs(commands[-1].position).max() > 0.4, 'waves')
    angles = np.array([message.position for message in commands])
    times = 1e-9 * np.diff([nanoseconds(message) for message in commands])
    most = 5.0 * np.maximum(times, 0.02)  # 5 rad/s
    assert (np.abs(np.diff(angles, axis=0)) < most[:, None]).all()


def test_the_sim_node_starts_and_pushes_as_its_scene_says(started):
    _, _, graph = started
    graph.until(lambda: graph.states and graph.odom, 'states')
    assert np.array(graph.states[0].position)[::2] == pytest.approx(YAW, abs=0.02)
    request = GetParameters.Request(names=['pushes', 'start.yaw', 'start.heading'])
    values = graph.call(GetParameters, 'sim/get_parameters', request).values
    (push,) = json.loads(values[0].string_value)
    assert (push['link'], push['force'], push['start']) == (6, [30.0, 0.0, 0.0], 0.1)
    assert list(values[1].double_array_value) == pytest.approx(YAW)
    assert values[2].double_value == pytest.approx(np.pi / 2)
    graph.until(lambda: nanoseconds(graph.odom[-1]) > 400_000_000, 'time to pass')
    place = graph.odom[-1].pose.pose.position
    # 3 N s on 7.5 kg: half a meter a second, which friction stops.
    assert place.x > 0.01

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A robot from a URDF as real nodes: its names, its frames, its own joints commanded."""

import re
from xml.etree import ElementTree

from modular import modular_robot
import numpy as np
from offline import nanoseconds
from programs import ROOT
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from sim_client import SimClient
from std_msgs.msg import String

from snake_sim_ros import load_scene
from snake_sim_ros.scene.files import parse_yaml
from snake_sim_ros.scene.robot_description import robot_description

NAMES = [f'servo_{j}' for j in range(5)]


@pytest.fixture(scope='module')
def urdf(tmp_path_factory):
    path = tmp_path_factory.mktemp('urdf') / 'modules.urdf'
    path.write_text(robot_description(modular_robot(6)), encoding='utf-8')
    return path


@pytest.fixture(scope='module')
def sim(make_graph, urdf):
    """A sim of the robot in place of Aiko."""
    client = SimClient(
        make_graph(), f'robot_description:={urdf}', 'imu_links:=module_2', 'publish_rate:=50.0'
    )
    client.wait_until_connected()
    return client


def test_topics_have_the_names_of_the_robot(sim, urdf):
    stamps = lambda: [nanoseconds(messages[-1]) for messages in (sim.odom, sim.link_poses)]  # noqa: E731
    sim.graph.until(lambda: len({*stamps()}) == 1, 'a pose of the links and one of the base')
    states, odom = sim.joint_states[-1], sim.odom[-1]
    assert list(states.name) == NAMES
    assert len(states.position) == len(states.velocity) == len(states.effort) == 5
    assert len(sim.link_poses[-1].poses) == 6
    assert odom.child_frame_id == 'module_0'
    base = sim.link_poses[-1].poses[0]
    assert odom.pose.pose.position == base.position
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    found = []
    sim.graph.node.create_subscription(String, 'robot_description', found.append, latched)
    sim.graph.until(lambda: found, 'robot_description')
    tree = ElementTree.fromstring(found[0].data)
    joints = [item.get('name') for item in tree.iter('joint') if item.get('type') == 'revolute']
    assert joints == NAMES
    # The modules are 6 cm apart, whatever the joints do.
    places = [(p.position.x, p.position.y, p.position.z) for p in sim.link_poses[-1].poses]
    apart = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert apart == pytest.approx(np.full(5, 0.06), abs=1e-6)


def test_joints_are_commanded_by_their_names(sim):
    # The third one is mounted upside down: its angle has its own sign all the same.
    sim.send({'servo_2': 0.3, 'servo_1': -0.2})

    def reached():
        angle = dict(zip(NAMES, sim.joint_states[-1].position, strict=True))
        return abs(angle['servo_2'] - 0.3) < 0.05 and abs(angle['servo_1'] + 0.2) < 0.05

    sim.graph.until(reached, 'the commanded angles', 10)
    sim.send({'joint_1_yaw': 0.1})
    said = "joint_command: unknown joint 'joint_1_yaw'; joints are servo_0 to servo_4"
    sim.graph.until(lambda: sim.process.count(said), said)


def test_gait_commands_the_same_names(sim, urdf):
    heard = sim.graph.record(JointState, 'joint_command')
    sim.graph.start('gait', f'robot_description:={urdf}', 'start_from:=now')
    sim.graph.until(lambda: len(heard) > 100, 'commands of the gait')
    assert list(heard[-1].name) == NAMES
    angle = np.array([item.position for item in heard])
    # Lateral undulation of the default scene: joints that turn upright move, the others do not.
    assert np.ptp(angle[:, ::2], axis=0).min() > 0.01
    assert not angle[:, 1::2].any()
    for process in sim.graph.processes:
        assert process.stop() == 0, process.output
    sim.graph.processes.clear()


def test_the_ros_lines_of_the_page(make_graph, tmp_path):
    """The walk with REU: its scene in sim and gait, then a joint commanded by its own name."""
    walk = (ROOT / 'docs/scenes.md').read_text(encoding='utf-8').partition('## Your own robot')[2]
    blocks = re.findall(r'```(\w+)\n(.*?)```', walk, re.DOTALL)
    (scene,) = (text for kind, text in blocks if kind == 'yaml')
    lines = [line for kind, text in blocks if kind == 'sh' for line in text.splitlines()]
    nodes = dict(re.findall(r'ros2 run snake_sim_ros (\w+) .*-p (scene:=\S+)', '\n'.join(lines)))
    assert nodes == {'sim': 'scene:=my_scene.yaml', 'gait': 'scene:=my_scene.yaml'}
    (message,) = re.findall(r'topic pub --once /joint_command sensor_msgs/JointState "(.*)"', walk)
    (tmp_path / 'my_scene.yaml').write_text(re.sub('(?m)^   ', '', scene), encoding='utf-8')
    reu = robot_description(load_scene('reu_sidewinding').robot)
    (tmp_path / 'my_snake.urdf').write_text(reu, encoding='utf-8')

    where = f'scene:={tmp_path / "my_scene.yaml"}'
    client = SimClient(make_graph(), where, 'publish_rate:=50.0')
    client.wait_until_connected()
    gait = client.graph.start('gait', where)
    begin = client.link_poses[-1]

    def way():
        places = [[(p.position.x, p.position.y) for p in poses.poses]
                  for poses in (begin, client.link_poses[-1])]  # fmt: skip
        return np.hypot(*np.subtract(*(np.mean(each, axis=0) for each in places)))

    # Sidewinding makes 0.05 m/s after its soft start of 2 s.
    client.graph.until(lambda: way() > 0.05, 'a robot that sidewinds', 20)
    client.graph.end(gait)
    given = parse_yaml(message)
    client.send(dict(zip(given['name'], given['position'], strict=True)))

    def reached():
        states = client.joint_states[-1]
        place = list(states.name).index(given['name'][0])
        return abs(states.position[place] - given['position'][0]) < 0.05

    client.graph.until(reached, 'the commanded angle', 10)


def test_what_is_no_robot_is_refused(make_graph, tmp_path):
    path = tmp_path / 'tree.urdf'
    path.write_text('<robot name="x"><link name="a"/></robot>', encoding='utf-8')
    process = make_graph().start('sim', f'robot_description:={path}')
    process.wait_for('tree.urdf')
    assert process.popen.wait(20) != 0
    assert 'Traceback' not in process.output

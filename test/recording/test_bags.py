# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bags: those of a run, read by another reader and by ours, and those of other robots."""

from contextlib import contextmanager
from dataclasses import replace
import shutil

from geometry_msgs.msg import PoseArray
import numpy as np
import pytest
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from snake_sim_ros import ParameterError, Robot
from snake_sim_ros.nodes.messages import stamp_from
from snake_sim_ros.nodes.state_messages import StateMessages
from snake_sim_ros.nodes.state_publishers import SceneMarkers
from snake_sim_ros.recording.bag_reader import read_bag
from snake_sim_ros.recording.sensors import recorded_sensors, Sensors
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.posture import gaps, joint_angles
from snake_sim_ros.scene.robot_description import robot_description
from snake_sim_ros.stepping.simulation import simulate
from snake_sim_ros.stepping.state import initial_state

pytest.importorskip('mcap_ros2')  # bag_writer needs it
from snake_sim_ros.nodes.bag_writer import BagWriter, RunTopics, schema_text
from snake_sim_ros.nodes.sensor_topics import SensorTopics
from snake_sim_ros.nodes.state_publishers import TransformMessages

Reader = pytest.importorskip('rosbags.rosbag2').Reader
typesys = pytest.importorskip('rosbags.typesys')

TYPES = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
STATES = QoSProfile(depth=10)
LATCHED = ('/robot_description', '/tf_static')  # topics


@pytest.fixture(scope='module')
def scene():
    return replace(load_scene('lateral_undulation'), duration=1.2)


@pytest.fixture(scope='module')
def recorded(scene, tmp_path_factory):
    """Return a bag of a run and the run itself."""
    path = tmp_path_factory.mktemp('bags') / 'run.mcap'
    with BagWriter(path, scene) as bag:
        trajectory = simulate(scene, rate=200.0, observe=RunTopics(bag, scene).observe)
    return path, trajectory


def test_another_reader_finds_all_topics(recorded):
    path, trajectory = recorded
    found = {}
    with Reader(path) as reader:
        for connection in reader.connections:
            # The reader checks sizes as well: surplus bytes are an error.
            found[connection.topic] = [
                (stamp, TYPES.deserialize_cdr(data, connection.msgtype))
                for _, stamp, data in reader.messages([connection])
            ]
            latched = connection.ext.offered_qos_profiles[0].durability.name
            assert (latched == 'TRANSIENT_LOCAL') == (connection.topic in LATCHED)
    samples = len(trajectory.time)
    assert samples == 241
    transforms = {'/tf': samples, '/tf_static': 1} if TransformMessages.available else {}
    assert {topic: len(messages) for topic, messages in found.items()} == {
        '/robot_description': 1,
        **dict.fromkeys(['/joint_command', '/joint_states', '/link_poses'], samples),
        **dict.fromkeys(['/odom', '/clock'], samples),
        '/markers': 36 + 1,
        '/diagnostics': 1,
        **transforms,
    }
    # The stamps and the times of the bag have 200 states a second of simulated time.
    for topic in ('/joint_command', '/joint_states', '/link_poses', '/odom', '/clock'):
        stamps = [getattr(message, 'header', message) for _, message in found[topic]]
        stamps = [getattr(item, 'stamp', None) or item.clock for item in stamps]
        times = [item.sec * 10**9 + item.nanosec for item in stamps]
        assert times == [5_000_000 * k for k in range(samples)] == [t for t, _ in found[topic]]
    last = found['/joint_states'][-1][1]
    assert last.name == list(Robot().axis_names)
    assert np.array_equal(last.position, trajectory.joint_angle[-1])
    command = found['/joint_command'][-1][1]
    # 30 degrees sin(80 degrees/s t) of the first joint
    assert command.position[0] == pytest.approx(
        np.pi / 6 * np.sin(np.radians(80) * 1.2), abs=1e-12
    )
    assert command.velocity[0] != 0.0


def test_a_run_is_read_back(recorded):
    path, trajectory = recorded
    found = read_bag(path)
    assert found.scene == trajectory.scene
    assert found.time == pytest.approx(trajectory.time, abs=1e-9)
    for name in ('position', 'joint_angle', 'joint_velocity', 'joint_torque'):
        assert np.array_equal(getattr(found, name), getattr(trajectory, name)), name
    # Products of numbers up to 1
    assert np.abs(found.orientation - trajectory.orientation).max() < 1e-15
    assert (found.level[:200] == '').all()  # unknown before the first diagnostics
    assert (found.level[200:] == 'planar').all()
    # The last markers are at most one third of a tenth of a second older than the last sample.
    point, force = found.contacts(240)
    assert point == pytest.approx(trajectory.contacts(240)[0], abs=1e-15)
    assert force == pytest.approx(trajectory.contacts(240)[1], abs=1e-11)


def test_a_schema_defines_everything_that_is_in_a_type():
    text = schema_text(PoseArray)
    parts = text.split('=' * 80 + '\nMSG: ')
    names = {part.splitlines()[0] for part in parts[1:]}
    assert names == {'std_msgs/Header', 'builtin_interfaces/Time', 'geometry_msgs/Pose',
                     'geometry_msgs/Point', 'geometry_msgs/Quaternion'}  # fmt: skip
    assert 'Pose[] poses' in parts[0]


# ---- bags of others -----------------------------------------------------------------------------


@contextmanager
def other_bag(path, topics):
    """Yield a function that writes a message to a topic: topic, time [s], message."""
    with BagWriter(path) as bag:
        for topic, kind in topics.items():
            bag.add_topic(topic, kind, STATES)
        yield lambda topic, time, message: bag.write(
            topic, round(time * 1e9), serialize_message(message)
        )


def joint_state(time, names, position, **more):
    message = JointState(name=names, position=position, **more)
    message.header.stamp = stamp_from(round(time * 1e9))
    return message


def test_a_real_robot_has_joint_states_only(tmp_path):
    path, wall = tmp_path / 'real.mcap', 1_700_000_000.0
    yaw = np.linspace(-0.3, 0.3, 10)
    with other_bag(path, {'/aiko/joint_states': JointState, '/tick': String}) as write:
        write('/tick', wall, String(data='x'))
        for k in range(5):
            names = list(Robot().axis_names[::2])  # no pitch joints
            state = joint_state(wall + 0.1 * k, names, (yaw * k).tolist(), effort=[1.0] * 10)
            write('/aiko/joint_states', wall + 0.1 * k + 0.02, state)
    found = read_bag(path)
    assert found.time - wall == pytest.approx(0.1 * np.arange(5), abs=1e-6)  # doubles of 1.7e9
    assert found.scene.robot == Robot()
    q = np.concatenate([found.position, found.orientation], axis=-1)
    assert joint_angles(q)[:, :, 0] == pytest.approx(yaw * np.arange(5)[:, None], abs=1e-12)
    assert gaps(Robot(), q).min(axis=-1) == pytest.approx(0.0, abs=1e-15)
    assert np.isnan(found.joint_angle[:, 1::2]).all()
    assert (found.joint_torque[:, ::2] == 1.0).all()
    assert np.isnan(found.joint_velocity).all()
    assert not len(found.contact_sample)


def test_robot_and_obstacles_come_from_topics(tmp_path):
    scene = load_scene('obstacle_aided')
    path = tmp_path / 'live.mcap'
    markers = SceneMarkers(scene)
    messages, state = StateMessages(scene.robot), initial_state(scene)
    kinds = {'/robot_description': String, '/markers': MarkerArray, '/link_poses': PoseArray}
    with BagWriter(path) as bag:
        for topic, kind in kinds.items():
            bag.add_topic(topic, kind, STATES)
        text = String(data=robot_description(scene.robot))
        bag.write('/robot_description', 0, serialize_message(text))
        for k in range(3):
            # This is a fraction of a second after a reset of time.
            messages.fill(10**9 * (5 if k == 0 else k), state, np.zeros((10, 2)))
            bag.write('/link_poses', k, bytes(messages.link_poses))
        markers.fill(stamp_from(10**9), np.zeros((1, 3)), np.ones((1, 3)))
        bag.write('/markers', 3, serialize_message(markers.message))
    found = read_bag(path)
    assert found.scene.pegs.axes == pytest.approx(scene.pegs.axes, abs=1e-15)
    assert found.time.tolist() == [5.0, 5.0, 6.0]  # time stands still, then goes on
    assert np.isnan(found.joint_angle).all()


def test_names_of_topics_are_quoted_in_one_printable_line(tmp_path):
    path, name = tmp_path / 'odd.mcap', 'a\x1b[2J\n\x00' + 'b' * 1000
    with other_bag(path, {name: JointState}) as write:
        write(name, 1.0, joint_state(1.0, ['joint_1_yaw'], [0.1]))
    with pytest.raises(ParameterError, match='has neither') as caught:
        read_bag(path)
    assert str(caught.value).isprintable() and len(str(caught.value)) < 600 + len(str(path))
    topics = {f'/{name}{k}/joint_states': JointState for k in 'ab'}
    with other_bag(path, topics) as write:
        for topic in topics:
            write(topic, 1.0, joint_state(1.0, ['joint_1_yaw'], [0.1]))
    with pytest.raises(ParameterError, match='has several robots') as caught:
        read_bag(path)
    assert str(caught.value).isprintable() and len(str(caught.value)) < 600 + len(str(path))


def test_one_of_several_robots(tmp_path):
    path = tmp_path / 'two.mcap'
    with other_bag(path, {'/a/joint_states': JointState, '/b/joint_states': JointState}) as write:
        for name, angle in (('a', 0.1), ('b', 0.2)):
            write(f'/{name}/joint_states', 1.0, joint_state(1.0, ['joint_1_yaw'], [angle]))
    with pytest.raises(
        ParameterError, match=r'has several robots; choose one with --name.*: /a, /b'
    ):
        read_bag(path)
    assert read_bag(path, 'b').joint_angle[0, 0] == 0.2
    assert read_bag(path, '/a/').joint_angle[0, 0] == 0.1
    with pytest.raises(ParameterError, match=r'neither link_poses .* nor joint_states .* of /c'):
        read_bag(path, '/c')


def test_folder_of_ros2_bag(recorded, tmp_path):
    (tmp_path / 'metadata.yaml').write_text('rosbag2_bagfile_information: {}\n')
    with pytest.raises(ParameterError, match=r'has no \.mcap file; record with ros2 bag record'):
        read_bag(tmp_path)
    shutil.copy(recorded[0], tmp_path / 'run_0.mcap')
    assert len(read_bag(tmp_path).time) == 241


def test_bags_that_are_not_usable(recorded, tmp_path):
    path, data = tmp_path / 'bad.mcap', recorded[0].read_bytes()
    with pytest.raises(ParameterError, match=r'no file .*bad\.mcap'):
        read_bag(path)
    broken = bytearray(data)
    broken[len(data) // 3] ^= 0xFF
    for content, sentence in (
        (b'', 'is not an MCAP file; snake-sim run --bag and ros2 bag record -s mcap write one'),
        (b'SQLite format 3\0' * 9, 'is not an MCAP file'),
        (data[:8], 'is truncated; `mcap recover`'),
        (data[: len(data) // 2], 'is truncated'),
        (data[:-1], 'is truncated'),
        (data[:100] + data[-100:], 'cannot be read as a bag of ROS 2: '),
        (broken, 'cannot be read as a bag of ROS 2: '),
    ):
        path.write_bytes(content)
        with pytest.raises(ParameterError) as error:
            read_bag(path)
        assert str(error.value).startswith(f'{path} {sentence}'), content[:20]


@pytest.mark.parametrize(
    ('topics', 'sentence'),
    [
        ({}, 'it has no messages'),
        ({'/chatter': String}, r'it has /chatter \(std_msgs/msg/String\)'),
        ({'/joint_states': String}, r'it has /joint_states \(std_msgs/msg/String\)'),
    ],
)
def test_bags_without_a_robot(tmp_path, topics, sentence):
    path = tmp_path / 'other.mcap'
    with other_bag(path, topics) as write:
        for topic in topics:
            write(topic, 0.0, String(data='hello'))
    with pytest.raises(ParameterError, match=sentence):
        read_bag(path)


def test_other_number_of_links(tmp_path):
    path = tmp_path / 'mixed.mcap'
    messages = StateMessages(Robot())
    messages.fill(0, initial_state(load_scene('lateral_undulation')), np.zeros((10, 2)))
    with BagWriter(path) as bag:
        bag.add_topic('/robot_description', String, STATES)
        bag.add_topic('/link_poses', PoseArray, STATES)
        text = String(data=robot_description(Robot(link_count=7)))
        bag.write('/robot_description', 0, serialize_message(text))
        bag.write('/link_poses', 0, bytes(messages.link_poses))
    with pytest.raises(
        ParameterError, match='link_poses must have the 7 links of the robot, got 11'
    ):
        read_bag(path)


def test_sensors_in_a_bag_are_those_of_the_run(scene, tmp_path):
    sensors = Sensors(
        imu_links=(6,), contact_force_links=(1, 11), sensor_rate=100.0, sensor_seed=2,
        imu_acceleration_noise=0.1, joint_position_noise=1e-3,
    )  # fmt: skip
    path, shorter = tmp_path / 'run.mcap', replace(scene, duration=0.2)
    with BagWriter(path, shorter) as bag:
        topics = RunTopics(bag, shorter, SensorTopics(bag, sensors, 200.0).measure)
        found = recorded_sensors(simulate(shorter, rate=200.0, observe=topics.observe), sensors)
    heard = {}
    with Reader(path) as reader:
        for connection in reader.connections:
            heard[connection.topic] = [
                TYPES.deserialize_cdr(data, connection.msgtype)
                for _, _, data in reader.messages([connection])
            ]
    imus = heard['/imu/link_6']
    assert [item.header.stamp.nanosec for item in imus] == [10_000_000 * k for k in range(21)]
    accelerations = [item.linear_acceleration for item in imus]
    expected = found['imu_linear_acceleration'][:, 0]
    assert [(a.x, a.y, a.z) for a in accelerations] == [tuple(row) for row in expected.tolist()]
    for k, link in enumerate((1, 11)):
        wrenches = [item.wrench for item in heard[f'/contact_forces/link_{link}']]
        forces = [(w.force.x, w.force.y, w.force.z) for w in wrenches]
        torques = [(w.torque.x, w.torque.y, w.torque.z) for w in wrenches]
        assert (np.hstack([forces, torques]) == found['contact_wrench'][:, k]).all()
    angles = np.array([item.position for item in heard['/joint_states']]).reshape(41, 20)
    assert (angles == found['measured_joint_angle']).all()
    # It is still a run for those who know nothing of sensors.
    assert len(read_bag(path).time) == 41

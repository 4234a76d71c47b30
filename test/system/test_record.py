# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""`snake-sim record` and `snake-sim run --bag`: bags of live nodes and of a run without ROS."""

from pathlib import Path
import re
import signal
import sys
import time

from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
from offline import nanoseconds
from programs import background, next_domain, Process, TIMEOUT
import pytest
from sensor_msgs.msg import JointState

from snake_sim_ros.commands.main import main
from snake_sim_ros.recording.bag_reader import read_bag

Reader = pytest.importorskip('rosbags.rosbag2').Reader
typesys = pytest.importorskip('rosbags.typesys')
pytest.importorskip('mcap_ros2')

TYPES = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
OF_ALL_NODES = {'/parameter_events', '/rosout'}
OF_TF = {'/tf', '/tf_static'}  # only where tf2_msgs is installed
DURATION = 2.0  # s
RECORD = [sys.executable, '-m', 'snake_sim_ros.commands', 'record']


def messages_of(path):
    """Return topic -> (type, messages); bytes that are left over in a message are an error."""
    with Reader(path) as reader:
        return {
            connection.topic: (
                connection.msgtype,
                [
                    TYPES.deserialize_cdr(data, connection.msgtype)
                    for _, _, data in reader.messages([connection])
                ],
            )
            for connection in reader.connections
        }


def level(report):
    """Return the model level that diagnostics of the sim say."""
    return {item.key: item.value for item in report.status[0].values}.get('level')


@pytest.fixture(scope='module')
def recorded(make_graph, tmp_path_factory):
    """Record sim and gait for a while; Ctrl-C goes to all three at once, as from a keyboard."""
    path = tmp_path_factory.mktemp('bags') / 'live.mcap'
    graph = make_graph()
    with background():
        recorder = Process([*RECORD, str(path)], graph.domain)
    recorder.wait_for('recording all topics')
    graph.start('sim')
    graph.start('gait', '-p use_sim_time:=true')
    graph.node.create_publisher(JointState, '/sim/_hidden/states', 1)
    states = graph.record(JointState, 'joint_states')
    reports = graph.record(DiagnosticArray, '/diagnostics')
    graph.until(lambda: states and states[-1].header.stamp.sec >= DURATION, 'three seconds')
    # Until its first step a robot is spatial: so are one report or, on a busy machine, more.
    graph.until(lambda: reports and level(reports[-1]) == 'planar', 'a robot that lies flat')
    known = nanoseconds(reports[-1])
    graph.until(lambda: nanoseconds(states[-1]) > known, 'a state after this report')
    for process in (*graph.processes, recorder):
        process.popen.send_signal(signal.SIGINT)
    assert recorder.wait() == 0, recorder.output
    for process in graph.processes:
        process.wait()
    graph.drain(states)
    graph.processes.clear()
    return path, recorder, states


def test_nothing_is_lost(recorded):
    path, recorder, states = recorded
    found = messages_of(path)
    total = sum(len(messages) for _, messages in found.values())
    assert recorder.count(f'{total} messages of {len(found)} topics in {path}') == 1
    assert not recorder.count('is not recorded')
    stamps = {
        topic: [item.header.stamp.sec * 10**9 + item.header.stamp.nanosec for item in messages]
        for topic, (_, messages) in found.items()
        if topic in ('/joint_states', '/link_poses', '/odom')
    }
    # It has every state from the first one to the last one that another reader has.
    last = states[-1].header.stamp
    for topic, times in stamps.items():
        assert (np.diff(times) == 5_000_000).all(), topic
        assert times[0] < 2_000_000_000, topic
        assert times[-1] >= last.sec * 10**9 + last.nanosec - 5_000_000, topic


def test_it_is_a_run(recorded):
    trajectory = read_bag(recorded[0])
    assert trajectory.scene.robot.link_count == 11
    assert trajectory.level[-1] == 'planar'
    # The angles of the first poses may have arrived later.
    moved = np.nanmax(trajectory.joint_angle, axis=0) - np.nanmin(trajectory.joint_angle, axis=0)
    assert moved[::2].min() > 0.1
    _, force = trajectory.contacts(len(trajectory.time) - 1)
    assert force[:, 2].sum() == pytest.approx(73.575, rel=1e-6)


def test_a_run_that_nobody_watched_has_the_same_topics(recorded, tmp_path):
    path = tmp_path / 'run.mcap'
    assert main(['run', 'lateral_undulation', '--duration', '1', '--bag', str(path)]) == 0
    live, offline = messages_of(recorded[0]), messages_of(path)
    ours = {topic: kind for topic, (kind, _) in offline.items()}
    theirs = {topic: kind for topic, (kind, _) in live.items()}
    assert ours.keys() - OF_TF == theirs.keys() - OF_ALL_NODES - OF_TF
    assert all(theirs[topic] == kind for topic, kind in ours.items())
    for topic in ('/joint_states', '/joint_command', '/link_poses', '/odom'):
        one, other = (found[topic][1][-1] for found in (live, offline))
        assert one.header.frame_id == other.header.frame_id
        assert getattr(one, 'name', None) == getattr(other, 'name', None)
    urdf = [found['/robot_description'][1][0].data for found in (live, offline)]
    assert urdf[0] == urdf[1]


def test_a_signal_before_it_records_ends_it(tmp_path):
    with background():
        process = Process([*RECORD, str(tmp_path / 'early.mcap')], next_domain())
    status, deadline = Path(f'/proc/{process.popen.pid}/status'), time.monotonic() + TIMEOUT
    interrupt = 1 << (signal.SIGINT - 1)
    while not int(re.search(r'SigCgt:\s*(\w+)', status.read_text())[1], 16) & interrupt:
        assert time.monotonic() < deadline
        time.sleep(0.001)
    assert process.stop(signal.SIGINT) in (0, 130), process.output
    assert 'Traceback' not in process.output


@pytest.mark.parametrize(
    ('name', 'sentence'),
    [
        ('run.bag', 'the file of a bag must end in .mcap, got'),
        ('there.mcap', 'exists; remove it, or choose another name'),
        ('nowhere/run.mcap', 'no folder'),
    ],
)
def test_files_that_cannot_be_recorded_to(name, sentence, tmp_path, capsys):
    (tmp_path / 'there.mcap').write_bytes(b'something of value')
    assert main(['record', str(tmp_path / name)]) == 2
    assert sentence in capsys.readouterr().err
    assert (tmp_path / 'there.mcap').read_bytes() == b'something of value'

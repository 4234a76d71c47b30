# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a fit reads of a bag, and that it follows the commands in it as the simulator did."""

import copy
from dataclasses import replace

from modular import modular_robot
from nav_msgs.msg import Odometry
import numpy as np
import pytest
from recorded_messages import gait_commands, state_messages, write_messages
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from urdf_texts import written_from

from snake_sim_ros import load_robot, ParameterError, Scene, Simulation
from snake_sim_ros.gaits.joint_reference import start_posture
from snake_sim_ros.nodes.messages import stamp_from, trajectory_message
from snake_sim_ros.nodes.received_commands import (
    joint_command,
    joint_trajectory,
    position_commands,
)
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.scene.posture import chain_coordinates, joint_angles, own_poses
from snake_sim_ros.stepping.samples import make_samples
from snake_sim_ros.studies.recorded_motion import read_recording, Recording
from snake_sim_ros.studies.replay import Replay, ReplaySettings

PERIOD = 0.01  # of the simulated node, and between the states of a replay [s]
DURATION = 3.3  # s
EXACT = ReplaySettings(noise_position=1.0, noise_angle=1.0, segment=0.5, burn_in=2.0)
# The start is off by the third derivative of the waves over half a window of 0.12 s, 2e-4 rad,
# which 2 s reduce by exp(-2 s/0.3 s) to 2e-7 rad. In the first segment, which is left
# out, the robot starts from rest with a jump. In space, jumps of commands would tilt the robot by
# some 1e-5 rad, which is not forgotten.
SAME = 1e-6  # m, rad
READ = {
    'joint_command': lambda message, last, robot, now: joint_command(
        message, last, robot, now, 0.05
    ),
    'position_commands': lambda message, last, robot, now: position_commands(
        message, last, robot, now
    ),
    'joint_trajectory': lambda message, last, robot, now: joint_trajectory(
        message, last, robot, now, 0.05
    ),
}


def whole_robot():
    """Return the scene of Aiko, which jumps of commands do not roll over."""
    return replace(load_scene('lateral_undulation'), duration=DURATION, level='planar')


@pytest.fixture(scope='module')
def scene():
    return with_settings(whole_robot(), {'robot.link_count': 7})


def commands_of(scene, form):
    """Return commands in a form that robots take, each with the time at which it comes [s]."""
    times = np.arange(0.0, DURATION, PERIOD)
    names, count = list(scene.robot.axis_names), scene.robot.link_count - 1
    if form in ('joint_command', 'velocities'):
        commands = gait_commands(scene, times)
        for _, _, message in commands if form == 'velocities' else ():
            message.position = []
        return commands
    ahead = PERIOD if form == 'joint_trajectory' else 0.0
    angle, rate = gait.reference(scene.gait, times + ahead, count)
    found = []
    for t, a, r in zip(times, angle, rate, strict=True):
        if form == 'position_commands':
            message = Float64MultiArray(data=a.ravel().tolist())
        else:
            message = trajectory_message(names, None, a, r, round(PERIOD * 1e9))
        found.append((form, t, message))
    return found


def simulated(scene, commands):
    """Return what a node measures that takes a command before each of its periods."""
    steps = round(PERIOD / scene.dt)
    simulation, reference = Simulation(scene), start_posture(scene)
    rows = [(0.0, simulation.state.q)]
    for topic, t, message in commands:
        reference = READ[topic](message, reference, scene.robot, simulation.time).reference
        assert t == pytest.approx(simulation.time)
        reference = reference.settled(simulation.time)
        sampled = reference.sample(simulation.midpoints(steps), 0.05, scene.robot.limits)
        simulation.advance(*sampled, make_samples(scene, steps, 1))
        rows.append((simulation.time, simulation.state.q))
    time, q = (np.array(part) for part in zip(*rows, strict=True))
    return Recording(
        scene, False, (), time, joint_angles(q), time, np.arange(q.shape[1]), q[..., :3],
        q[..., 3:],
    )  # fmt: skip


@pytest.fixture(scope='module')
def measured(scene):
    return simulated(scene, commands_of(scene, 'joint_command'))


@pytest.mark.parametrize('form', [*READ, 'velocities'])
def test_references_are_those_of_the_simulator(form, tmp_path):
    scene = whole_robot()
    commands = commands_of(scene, form)
    motion = simulated(scene, commands)
    path = write_messages(tmp_path / 'run.mcap', [*commands, *state_messages(motion)])
    replay = Replay(read_recording(path, scene), scene, EXACT, 'held')
    assert replay.is_flat and len(replay.segments) >= 2
    for item in replay.residuals(scene)[1:]:
        assert np.abs(item.flat()).max() < SAME


@pytest.mark.parametrize('pose', ['link_poses', 'odom', 'head'])
def test_poses_of_any_topic_and_link(scene, measured, pose, tmp_path):
    messages = [*commands_of(scene, 'joint_command'), *state_messages(measured, pose)]
    path = write_messages(tmp_path / 'run.mcap', messages, prefix='/aiko/')
    options = {'head': {'pose': 'aiko/head', 'link': 1}}.get(pose, {})
    found = read_recording(path, scene, namespace='aiko', **options)
    links = {'link_poses': range(7), 'odom': [3], 'head': [0]}[pose]
    assert found.links.tolist() == list(links)
    assert found.position == pytest.approx(measured.position[:, found.links], abs=1e-12)
    cosine = np.abs((found.orientation * measured.orientation[:, found.links]).sum(axis=-1))
    assert cosine == pytest.approx(1.0, abs=1e-12)
    assert found.joint_angle == pytest.approx(measured.joint_angle, abs=1e-15)
    replay = Replay(found, scene, EXACT, 'held')
    assert max(np.abs(item.flat()).max() for item in replay.residuals(scene)[1:]) < SAME


def test_odometry_is_that_of_the_root_of_a_urdf(tmp_path):
    text = written_from(modular_robot(4), 1).replace('module_1', 'base_link')
    robot = load_robot({'urdf': text, 'head': 'module_0'})
    scene, times = Scene(robot=robot), np.arange(0.0, 2.0, PERIOD)
    rng = np.random.default_rng(1)
    q = chain_coordinates(robot, rng.uniform(-0.5, 0.5, (3, 2)))
    position, orientation = own_poses(robot, q)
    odom = Odometry(child_frame_id='base_link')
    place, turn = odom.pose.pose.position, odom.pose.pose.orientation
    place.x, place.y, place.z = position[1].tolist()
    turn.w, turn.x, turn.y, turn.z = orientation[1].tolist()
    angle = robot.by_axis(joint_angles(q, robot)).tolist()
    states = JointState(name=list(robot.axis_names), position=angle)
    messages = []
    for t in times:
        for name, message in (('odom', odom), ('joint_states', states)):
            message.header.stamp = stamp_from(round(t * 1e9))
            messages.append((name, t, copy.deepcopy(message)))
    found = read_recording(
        write_messages(tmp_path / 'run.mcap', [*gait_commands(scene, times), *messages]), scene
    )
    assert found.links.tolist() == [1]
    assert found.position[-1, 0] == pytest.approx(q[1, :3], abs=1e-14)
    assert abs(found.orientation[-1, 0] @ q[1, 3:]) == pytest.approx(1.0, abs=1e-14)


def test_missing_and_repeated_samples_are_left_out(scene, measured, tmp_path):
    motion = replace(measured, joint_angle=measured.joint_angle.copy(),
                     position=measured.position.copy())  # fmt: skip
    motion.joint_angle[7] = np.nan
    motion.joint_angle[8, 3] = np.nan
    motion.position[9, 2, 1] = np.nan
    states = state_messages(motion)
    again = [item for item in states if item[1] == 0.05]
    path = write_messages(
        tmp_path / 'run.mcap', [*commands_of(scene, 'joint_command'), *states, *again]
    )
    found = read_recording(path, scene)
    assert found.dropped == 4
    count = len(measured.joint_time)
    assert (len(found.joint_time), len(found.pose_time)) == (count - 1, count - 1)
    assert np.isnan(found.joint_angle).sum() == 2
    residuals = Replay(found, scene, EXACT, 'held').residuals(scene)[1:]
    assert max(np.abs(item.flat()).max() for item in residuals) < SAME


def test_a_message_without_stamp_has_the_time_of_its_recording(scene, measured, tmp_path):
    # The recorder has a clock of its own, which is 1000 s ahead.
    messages = [
        *(
            (topic, t + 1000.0, message)
            for topic, t, message in commands_of(scene, 'position_commands')
        ),
        *state_messages(measured, lag=1000.0),
    ]
    found = read_recording(write_messages(tmp_path / 'run.mcap', messages), scene)
    times = [command.time for command in found.commands]
    assert times == pytest.approx(np.arange(0.0, DURATION, PERIOD), abs=1e-6)


# ---- bags that are not usable -------------------------------------------------------------------


def test_torques_alone_are_refused(scene, measured, tmp_path):
    command = JointState(name=['joint_1_yaw'], position=[np.nan], effort=[0.1])
    command.header.stamp = stamp_from(2_500_000_000)
    messages = [*commands_of(scene, 'joint_command'), ('joint_command', 2.5, command)]
    path = write_messages(tmp_path / 'run.mcap', [*messages, *state_messages(measured)])
    with pytest.raises(ParameterError, match=r'at 2\.500 s has efforts alone, which a fit'):
        read_recording(path, scene)


def test_what_a_bag_lacks_is_one_sentence(scene, measured, tmp_path):
    few = slice(40)  # samples
    measured = replace(measured, **{
        name: getattr(measured, name)[few]
        for name in ('joint_time', 'joint_angle', 'pose_time', 'position', 'orientation')
    })  # fmt: skip
    commands, states = commands_of(scene, 'joint_command')[few], state_messages(measured)
    angles = [item for item in states if item[0] == 'joint_states']

    def refusal(messages, **options):
        path = tmp_path / 'run.mcap'
        write_messages(path, messages)
        with pytest.raises(ParameterError) as error:
            read_recording(path, scene, **options)
        return str(error.value)

    text = refusal(states)
    assert 'needs commands (/joint_command, /joint_trajectory, /position_commands)' in text
    assert 'the bag has /joint_states, /link_poses' in text
    assert 'a pose of a link (/link_poses, /odom, /tf, or another' in refusal(commands + angles)
    assert 'joint angles (/joint_states' in refusal(commands)
    assert 'poses on /head' in refusal(commands + states, pose='head')
    assert 'commands (/aiko/joint_command' in refusal(commands + states, namespace='/aiko')
    assert '--link must be 1 to 7, got 8' in refusal(commands + states, link=8)
    with pytest.raises(ParameterError, match='no file'):
        read_recording(tmp_path / 'nowhere.mcap')
    for topic, sentence in (
        ('joint_states', 'joint_states must have finite positions of joint_1_yaw'),
        ('link_poses', '/link_poses has no pose with finite numbers'),
    ):
        lost = replace(measured, **{
            'joint_states': {'joint_angle': np.full_like(measured.joint_angle, np.nan)},
            'link_poses': {'position': np.full_like(measured.position, np.nan)},
        }[topic])  # fmt: skip
        assert sentence in refusal(commands + state_messages(lost))
    small = with_settings(scene, {'robot.link_count': 6})
    with pytest.raises(ParameterError, match='must have the 6 links of the robot, got 7 poses'):
        read_recording(write_messages(tmp_path / 'run.mcap', commands + states), small)


def test_time_must_not_go_back(scene, measured, tmp_path):
    states = state_messages(measured)
    late = [
        (topic, t + DURATION, message)
        for topic, t, message in state_messages(measured)
        if topic == 'joint_states'
    ]
    path = write_messages(
        tmp_path / 'run.mcap', [*commands_of(scene, 'joint_command'), *states, *late]
    )
    with pytest.raises(ParameterError, match='time goes back from 3'):
        read_recording(path, scene)


def test_a_recording_must_be_long_enough(scene, measured, tmp_path):
    path = write_messages(
        tmp_path / 'run.mcap', [*commands_of(scene, 'joint_command'), *state_messages(measured)]
    )
    recording = read_recording(path, scene)
    with pytest.raises(ParameterError, match=r'at least 10\.12 s with commands'):
        Replay(recording, scene, ReplaySettings(), 'held')
    rare = replace(recording, pose_time=recording.pose_time[::110],
                   position=recording.position[::110],
                   orientation=recording.orientation[::110])  # fmt: skip
    with pytest.raises(ParameterError, match='the recording has 0 segments of'):
        Replay(rare, scene, EXACT, 'held')


def test_a_stamp_that_is_far_off_is_of_another_clock(scene, measured, tmp_path):
    commands = commands_of(scene, 'joint_command')
    for _, _, message in commands:
        message.header.stamp = stamp_from(1_700_000_000_000_000_000)
    path = write_messages(tmp_path / 'run.mcap', [*commands, *state_messages(measured)])
    times = [command.time for command in read_recording(path, scene).commands]
    assert times == pytest.approx(np.arange(0.0, DURATION, PERIOD), abs=1e-6)

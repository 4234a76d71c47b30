# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Messages of the state of the physics, and of commands, without any node."""

from dataclasses import replace
import math
from types import SimpleNamespace

from geometry_msgs.msg import PoseArray, WrenchStamped
from modular import modular_robot
from nav_msgs.msg import Odometry
import numpy as np
import pytest
from random_states import random_parameters
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState
from urdf_texts import written_from

from snake_sim_ros import load_robot, Robot, Scene, Simulation, State
from snake_sim_ros.nodes.diagnostics import shown, status_of
from snake_sim_ros.nodes.messages import command_message, seconds_from, stamp_from
from snake_sim_ros.nodes.state_messages import StateMessages
from snake_sim_ros.nodes.state_publishers import SensorMessages
from snake_sim_ros.recording.sensors import SensorReader, Sensors
from snake_sim_ros.scene.chain import FixedFrame
from snake_sim_ros.scene.checked_records import flat_fields
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.posture import own_poses
from snake_sim_ros.scene.rotations import FLAT, rotation_matrices
from snake_sim_ros.stepping.sampling import joint_motion

pytestmark = pytest.mark.fast

ROBOT = Robot()
NAMES = list(Robot().axis_names)
# Sums of a few products of numbers up to 1, each with one rounding.
ROUNDING = 1e-14


def wire_matrix(orientation):
    o = orientation
    return rotation_matrices(np.array([o.w, o.x, o.y, o.z]))


def filled(state, robot=ROBOT, frame_prefix=''):
    messages = StateMessages(robot, frame_prefix)
    torque = np.arange(2.0 * (robot.link_count - 1)).reshape(-1, 2)
    messages.fill(5_000_000, state, torque)
    return received(messages)


def received(messages):
    """Return the messages as a subscriber gets them."""
    return SimpleNamespace(
        joint_states=deserialize_message(bytes(messages.joint_states), JointState),
        link_poses=deserialize_message(bytes(messages.link_poses), PoseArray),
        odom=deserialize_message(bytes(messages.odom), Odometry),
        clock=deserialize_message(bytes(messages.clock), Clock),
    )


@pytest.mark.parametrize('root', [0, 2])
def test_the_base_of_a_robot_of_ones_own_is_the_root_of_its_urdf(root):
    robot = load_robot({'urdf': written_from(modular_robot(4), root), 'head': 'module_0'})
    rng = np.random.default_rng(root)
    q = np.hstack([rng.uniform(-1, 1, (4, 3)), random_parameters(rng, 4)])
    state = State(q, rng.uniform(-1, 1, (4, 6)))
    odom = filled(state, robot).odom
    assert odom.child_frame_id == f'module_{root}'
    place, p = odom.pose.pose.position, odom.pose.pose.orientation
    position, orientation = own_poses(robot, q)
    assert [place.x, place.y, place.z] == pytest.approx(position[root], abs=ROUNDING)
    axes = rotation_matrices(orientation[root])
    assert wire_matrix(p) == pytest.approx(axes, abs=ROUNDING)
    # Velocities of the origin of the frame, in its axes.
    R, u = rotation_matrices(q[root, 3:]), state.u[root]
    v, w = odom.twist.twist.linear, odom.twist.twist.angular
    lever = position[root] - q[root, :3]
    expected = u[:3] + np.cross(R @ u[3:], lever)
    assert axes @ [v.x, v.y, v.z] == pytest.approx(expected, abs=4 * ROUNDING)
    assert axes @ [w.x, w.y, w.z] == pytest.approx(R @ u[3:], abs=4 * ROUNDING)


def test_an_imu_at_a_frame_has_its_name_and_its_frame():
    robot = modular_robot(3)
    first, *others = robot.links
    first = replace(first, frames=(FixedFrame(name='imu'),))
    robot = replace(robot, links=(first, *others))
    sensors = Sensors(imu_links=('imu', 'module_0'), contact_force_links=1)
    reader = SensorReader(Simulation(Scene(robot=robot)), sensors, 1, 200.0)
    messages = SensorMessages(reader, sensors, 'snake/')
    messages.fill_imus(0)
    found = {topic: deserialize_message(bytes(each), Imu) for topic, each in messages.imus.items()}
    frames = {topic: message.header.frame_id for topic, message in found.items()}
    assert frames == {'imu/module_0': 'snake/module_0_center', 'imu/imu': 'snake/imu'}
    # Frame `imu` is that of the module, whose x is along it too; it lies still.
    for message in found.values():
        force = message.linear_acceleration
        assert [force.x, force.y, force.z] == pytest.approx([0, 0, 9.81], abs=1e-12)
    (wrench,) = messages.wrenches.values()
    assert deserialize_message(bytes(wrench), WrenchStamped).header.frame_id == (
        'snake/module_0_center'
    )


@pytest.fixture
def state():
    rng = np.random.default_rng(3)
    q = np.hstack([rng.uniform(-1, 1, (11, 3)), random_parameters(rng, 11)])
    return State(q, rng.uniform(-1, 1, (11, 6)))


def test_joint_names_run_along_the_robot_yaw_first():
    names = ('joint_1_yaw', 'joint_1_pitch', 'joint_2_yaw', 'joint_2_pitch')
    assert Robot(link_count=3).axis_names == names
    assert len(NAMES) == 20
    assert NAMES[-1] == 'joint_10_pitch'
    assert Robot(link_count=1).axis_names == ()


@pytest.mark.parametrize('count', [0, 1, 200, 4_000_000, 200 * 86_400 * 365 * 10])
def test_stamps_are_exact_over_long_times(count):
    # Periods of 5 ms, up to ten years
    stamp = stamp_from(5_000_000 * count)
    assert stamp.sec * 10**9 + stamp.nanosec == 5_000_000 * count
    assert 0 <= stamp.nanosec < 10**9
    assert seconds_from(stamp) == pytest.approx(0.005 * count, rel=1e-15)


def test_frame_of_a_flat_link_is_that_of_the_world():
    q = np.tile([0.0, 0.0, 0.05, *FLAT], (11, 1))
    messages = filled(State(q, np.zeros((11, 6))))
    for pose in messages.link_poses.poses:
        o = pose.orientation
        assert [o.w, o.x, o.y, o.z] == pytest.approx([1, 0, 0, 0], abs=ROUNDING)


def test_frames_have_x_along_the_link_and_z_up(state):
    messages = filled(state)
    for pose, R in zip(messages.link_poses.poses, rotation_matrices(state.q[:, 3:]), strict=True):
        o = pose.orientation
        assert o.w >= 0
        assert o.w**2 + o.x**2 + o.y**2 + o.z**2 == pytest.approx(1, abs=ROUNDING)
        # x, y, z on the wire are e_z, e_x, e_y of frame B.
        assert wire_matrix(o) == pytest.approx(R[:, [2, 0, 1]], abs=ROUNDING)


def test_twist_is_that_of_the_middle_link_in_its_frame(state):
    odom = filled(state).odom
    R = rotation_matrices(state.q[5, 3:])
    axes = wire_matrix(odom.pose.pose.orientation)
    v, w = odom.twist.twist.linear, odom.twist.twist.angular
    assert axes @ [v.x, v.y, v.z] == pytest.approx(state.u[5, :3], abs=4 * ROUNDING)
    # The angular velocity of physics is in frame B.
    assert axes @ [w.x, w.y, w.z] == pytest.approx(R @ state.u[5, 3:], abs=4 * ROUNDING)
    # The x axis points forward, toward link 1, against that of the link, e_z of frame B.
    assert axes == pytest.approx(R[:, [2, 0, 1]] * [-1, -1, 1], abs=4 * ROUNDING)
    assert odom.pose.pose.orientation.w >= 0
    assert odom.child_frame_id == 'base_link'
    assert odom.header.frame_id == 'odom'


def test_messages_hold_floats_and_one_stamp(state):
    messages = filled(state)
    assert list(messages.joint_states.name) == NAMES
    angle, rate = joint_motion(Robot(), state.q[None], state.u[None])
    for numbers, wanted in (
        (messages.joint_states.position, angle),
        (messages.joint_states.velocity, rate),
        (messages.joint_states.effort, np.arange(20.0)),
    ):
        assert list(numbers) == wanted.ravel().tolist()
        assert all(type(number) is float for number in numbers)
    parts = [part for p in messages.link_poses.poses for part in (p.position, p.orientation)]
    parts += [messages.odom.twist.twist.linear, messages.odom.twist.twist.angular]
    for part in parts:
        for name in part.get_fields_and_field_types():
            assert type(getattr(part, name)) is float
    for message in (messages.joint_states, messages.link_poses, messages.odom):
        assert message.header.stamp == stamp_from(5_000_000)
    assert messages.clock.clock == stamp_from(5_000_000)
    assert messages.link_poses.header.frame_id == 'world'
    positions = [[p.position.x, p.position.y, p.position.z] for p in messages.link_poses.poses]
    assert (np.array(positions) == state.q[:, :3]).all()


def test_an_encoder_gives_the_nearest_of_its_angles(state):
    # In units of its resolution; halves are rounded up, as the control loop reads them.
    told = np.array([0.0, 0.4, 0.6, 1.4, -0.4, -0.6, -1.4, 0.5, -0.5, -1.5])
    nearest = [0.0, 0.0, 1.0, 1.0, 0.0, -1.0, -1.0, 1.0, 0.0, -1.0]
    step = 2.0**-10  # rad, so that products are exact
    messages = StateMessages(Robot(encoder_resolution=step))
    angle, rate = step * np.column_stack([told, told[::-1]]), np.ones((10, 2))
    messages.fill(0, state, np.zeros((10, 2)), (angle, rate))
    read = np.reshape(received(messages).joint_states.position, (10, 2))
    assert (read == step * np.column_stack([nearest, nearest[::-1]])).all()


def test_frames_of_one_robot_of_several_have_a_prefix(state):
    messages = filled(state, frame_prefix='aiko/')
    assert messages.odom.header.frame_id == 'aiko/odom'
    assert messages.odom.child_frame_id == 'aiko/base_link'
    assert messages.link_poses.header.frame_id == 'world'


def test_messages_of_a_robot_with_other_links():
    robot = load_scene('slender_undulation').robot
    state = State(np.tile([0.0, 0.0, 0.03, *FLAT], (20, 1)), np.zeros((20, 6)))
    messages = filled(state, robot)
    assert list(messages.joint_states.name) == list(Robot(link_count=20).axis_names)
    assert len(messages.link_poses.poses) == 20
    assert messages.odom.pose.pose.position == messages.link_poses.poses[10].position


def test_values_of_links_and_joints_are_lists_to_ros():
    robot = Robot(link_count=3, link_mass=(1, 2, 3), yaw_stiffness=(10, 20))
    kinds = {
        name: Parameter(name, value=list(value) if isinstance(value, tuple) else value).type_
        for name, (value, _) in flat_fields(robot).items()
    }
    assert kinds['link_mass'] == kinds['yaw_stiffness'] == Parameter.Type.DOUBLE_ARRAY
    assert kinds['yaw_damping'] == Parameter.Type.DOUBLE
    assert kinds['inertia'] == Parameter.Type.STRING


def test_messages_are_filled_anew(state):
    kept = StateMessages(ROBOT)
    kept.fill(5_000_000, state, np.ones((10, 2)))
    other = State(np.tile([1.0, 2.0, 3.0, *FLAT], (11, 1)), np.zeros((11, 6)))
    kept.fill(7, other, np.zeros((10, 2)))
    messages = received(kept)
    assert messages.joint_states.header.stamp == stamp_from(7)
    assert messages.link_poses.poses[5].position.y == 2.0
    assert messages.odom.pose.pose.position.z == 3.0
    assert messages.odom.twist.twist.linear.x == 0.0
    assert not any(messages.joint_states.velocity)
    assert not any(messages.joint_states.effort)


def test_messages_of_a_single_link():
    state = State(np.array([[0.0, 0.0, 0.03, *FLAT]]), np.zeros((1, 6)))
    messages = filled(state, Robot(link_count=1))
    assert len(messages.link_poses.poses) == 1
    assert list(messages.joint_states.position) == list(messages.joint_states.name) == []


@pytest.mark.parametrize(
    ('told', 'text'),
    [
        ({'real_time_factor': '0.998'}, '1.00'),
        ({'real_time_factor': 'as fast as possible'}, 'as fast as possible'),
        ({'real_time_factor': ''}, ''),
        ({}, '-'),
    ],
)
def test_diagnostics_of_anyone_are_shown(told, text):
    status = status_of('sim', '', '', 'running', {'level': 'planar', **told})
    assert shown(status) == {'level': 'planar', 'real-time factor': text, 'sim': 'running'}


@pytest.mark.parametrize(
    ('warning', 'factor', 'state'),
    [
        ('real-time factor 0.88 of 1', '0.87 of 1', 'running slowly'),
        ('real-time factor 0.88 of 1.5; no commands', '0.87 of 1.5', 'no commands'),
        ('no commands', '0.87', 'no commands'),
    ],
)
def test_a_slow_simulation_is_shown_in_one_place(warning, factor, state):
    status = status_of('sim', '', warning, 'running', {'level': '-', 'real_time_factor': '0.874'})
    assert shown(status) == {'level': '-', 'real-time factor': factor, 'sim': state}


@pytest.mark.parametrize(
    ('value', 'number'),
    [(0.5, 0.5), (2, 2), (True, None), ('much', None), ([0.1], None), (math.nan, None)],
)
def test_parameters_of_anyone_are_numbers_or_not_shown(value, number):
    pytest.importorskip('viser')
    from snake_sim_ros.nodes.viewer_controls import number_in

    assert number_in({'friction.longitudinal': value}, 'friction.longitudinal') == number
    assert number_in({}, 'friction.longitudinal') is None


def test_command_has_all_joints():
    angle = np.arange(40.0).reshape(10, 4)[:, ::2]  # not contiguous
    message = command_message(NAMES, stamp_from(3), angle, -angle)
    assert list(message.name) == NAMES
    assert list(message.position) == angle.ravel().tolist()
    assert list(message.velocity) == (-angle).ravel().tolist()
    assert message.header.stamp == stamp_from(3)

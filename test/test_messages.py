"""Messages from and to physics, without any node."""

from array import array
import math

from builtin_interfaces.msg import Time
import numpy as np
import pytest
from random_states import random_parameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from snake_sim_ros.joint_reference import JointReference
from snake_sim_ros.nodes.messages import command_message
from snake_sim_ros.nodes.messages import joint_names
from snake_sim_ros.nodes.messages import reference_from
from snake_sim_ros.nodes.messages import RejectedCommand
from snake_sim_ros.nodes.messages import seconds_from
from snake_sim_ros.nodes.messages import stamp_from
from snake_sim_ros.nodes.messages import StateMessages
from snake_sim_ros.parameters import load_scene
from snake_sim_ros.parameters import Robot
from snake_sim_ros.records import flat_fields
from snake_sim_ros.rotations import FLAT
from snake_sim_ros.rotations import rotation_matrices
from snake_sim_ros.stepping import State

ROBOT = Robot()
NAMES = joint_names(11)
# Products of numbers up to 1 with a rounding each; of a sum of a few of them.
ROUNDING = 1e-14


def wire_matrix(orientation):
    o = orientation
    return rotation_matrices(np.array([o.w, o.x, o.y, o.z]))


def filled(state, robot=ROBOT):
    messages = StateMessages(robot)
    axes = np.arange(2.0 * (robot.link_count - 1)).reshape(-1, 2)
    messages.fill(stamp_from(5_000_000), state, axes, axes + 100, axes + 200)
    return messages


@pytest.fixture
def state():
    rng = np.random.default_rng(3)
    q = np.hstack([rng.uniform(-1, 1, (11, 3)), random_parameters(rng, 11)])
    return State(q, rng.uniform(-1, 1, (11, 6)))


def test_joint_names_run_along_the_robot_yaw_first():
    assert joint_names(3) == ['joint_1_yaw', 'joint_1_pitch', 'joint_2_yaw', 'joint_2_pitch']
    assert len(NAMES) == 20
    assert NAMES[-1] == 'joint_10_pitch'
    assert joint_names(1) == []


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
    assert odom.child_frame_id == 'link_6'
    assert odom.header.frame_id == 'world'


def test_messages_hold_floats_and_one_stamp(state):
    messages = filled(state)
    assert list(messages.joint_states.name) == NAMES
    for values, first in (('position', 0), ('velocity', 100), ('effort', 200)):
        numbers = getattr(messages.joint_states, values)
        assert list(numbers) == list(range(first, first + 20))
        assert all(type(number) is float for number in numbers)
    parts = [part for p in messages.link_poses.poses for part in (p.position, p.orientation)]
    parts += [messages.odom.twist.twist.linear, messages.odom.twist.twist.angular]
    for part in parts:
        for name in part.get_fields_and_field_types():
            assert type(getattr(part, name)) is float
    for message in (messages.joint_states, messages.link_poses, messages.odom):
        assert message.header.stamp == stamp_from(5_000_000)
    assert messages.link_poses.header.frame_id == 'world'
    positions = [[p.position.x, p.position.y, p.position.z] for p in messages.link_poses.poses]
    assert (np.array(positions) == state.q[:, :3]).all()


def test_messages_of_a_robot_with_other_links():
    robot = load_scene('slender_undulation').robot
    state = State(np.tile([0.0, 0.0, 0.03, *FLAT], (20, 1)), np.zeros((20, 6)))
    messages = filled(state, robot)
    assert list(messages.joint_states.name) == joint_names(20)
    assert len(messages.link_poses.poses) == 20
    assert messages.odom.child_frame_id == 'link_11'


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
    messages = filled(state)
    other = State(np.tile([1.0, 2.0, 3.0, *FLAT], (11, 1)), np.zeros((11, 6)))
    zero = np.zeros((10, 2))
    messages.fill(stamp_from(7), other, zero, zero, zero)
    assert messages.link_poses.poses[5].position.y == 2.0
    assert messages.odom.pose.pose.position.z == 3.0
    assert messages.odom.twist.twist.linear.x == 0.0
    assert not any(messages.joint_states.velocity)


def test_command_has_all_joints():
    angle = np.arange(40.0).reshape(10, 4)[:, ::2]  # not contiguous
    message = command_message(NAMES, stamp_from(3), angle, -angle)
    assert list(message.name) == NAMES
    assert list(message.position) == angle.ravel().tolist()
    assert list(message.velocity) == (-angle).ravel().tolist()
    assert message.header.stamp == stamp_from(3)


@pytest.fixture
def last():
    axes = (10, 2)
    return JointReference(np.full(axes, 4.9), np.full(axes, 0.1), np.full(axes, 0.5))


NOW = 5.0  # s


def command(names=NAMES, position=None, velocity=None, stamp=0.0):
    position = [0.2] * len(names) if position is None else position
    message = JointState(
        name=list(names), position=array('d', position), velocity=array('d', velocity or [])
    )
    message.header.stamp = stamp_from(round(stamp * 1e9))
    return message


def test_command_replaces_only_the_joints_that_it_names(last):
    names = ['joint_7_pitch', 'joint_2_yaw']
    taken = reference_from(command(names, [0.3, -0.4], [1.0, -2.0]), last, ROBOT, NOW)
    expected = np.full((10, 2), 0.1)
    expected[6, 1], expected[1, 0] = 0.3, -0.4
    rates = np.full((10, 2), 0.5)
    rates[6, 1], rates[1, 0] = 1.0, -2.0
    stamps = np.full((10, 2), 4.9)
    stamps[6, 1] = stamps[1, 0] = NOW
    assert (taken.angle == expected).all()
    assert (taken.rate == rates).all()
    assert (taken.stamp == stamps).all()
    # What was there before is another object, as it was.
    assert (last.angle == 0.1).all()


def test_command_without_velocity_stands_still(last):
    taken = reference_from(command(), last, ROBOT, NOW)
    assert not taken.rate.any()
    assert (taken.angle == 0.2).all()


@pytest.mark.parametrize(
    ('stamp', 'meant'),
    [
        (0.0, NOW),
        (4.95, 4.95),
        (5.0, NOW),
        (5.2, NOW),  # of the future
        (1.8e9, NOW),  # of the wall clock
    ],
)
def test_time_of_a_command(last, stamp, meant):
    taken = reference_from(command(stamp=stamp), last, ROBOT, NOW)
    assert taken.stamp == pytest.approx(np.full((10, 2), meant), abs=1e-12)


def test_negative_stamp_is_of_another_clock(last):
    message = command()
    message.header.stamp = Time(sec=-3)
    assert (reference_from(message, last, ROBOT, NOW).stamp == NOW).all()


def test_limits_themselves_are_taken(last):
    limit, rate = ROBOT.joint_limit, ROBOT.joint_rate_limit
    taken = reference_from(command(position=[-limit] * 20, velocity=[rate] * 20), last, ROBOT, NOW)
    assert (taken.angle == -limit).all()
    assert (taken.rate == rate).all()


TWENTY = [0.1] * 20
REJECTED = {
    'no names': (
        command([], TWENTY),
        'no names',
        'joint_command names no joints; name some of joint_1_yaw to joint_10_pitch',
    ),
    'unknown name': (
        command(['joint_1_yaw', 'joint_11_yaw']),
        'name',
        "joint_command: unknown joint 'joint_11_yaw'; did you mean joint_1_yaw?",
    ),
    'strange name': (
        command(['?']),
        'name',
        "joint_command: unknown joint '?'; joints are joint_1_yaw to joint_10_pitch",
    ),
    'twice': (
        command(['joint_3_yaw', 'joint_1_yaw', 'joint_3_yaw']),
        'twice',
        'joint_command names joint joint_3_yaw more than once',
    ),
    'no positions': (
        command(position=[], velocity=TWENTY),
        'length',
        'joint_command must have one position a name: got 0 positions for 20 names',
    ),
    'too many positions': (
        command(['joint_1_yaw'], TWENTY),
        'length',
        'joint_command must have one position a name: got 20 positions for 1 names',
    ),
    'too few velocities': (
        command(velocity=TWENTY[:3]),
        'length',
        'joint_command must have no velocity or one a name: got 3 velocities for 20 names',
    ),
    'position not a number': (
        command(position=[*TWENTY[:19], math.nan]),
        'not finite',
        'joint_command: position of joint_10_pitch must be finite, got nan',
    ),
    'velocity infinite': (
        command(velocity=[math.inf, *TWENTY[:19]]),
        'not finite',
        'joint_command: velocity of joint_1_yaw must be finite, got inf',
    ),
    'position out of range': (
        command(['joint_5_yaw'], [-0.8]),
        'position range',
        'joint_command: position of joint_5_yaw must be within +-0.7854 rad, got -0.8 rad',
    ),
    'velocity out of range': (
        command(['joint_5_pitch'], [0.0], [10.5]),
        'velocity range',
        'joint_command: velocity of joint_5_pitch must be within +-10 rad/s, got 10.5 rad/s',
    ),
    'late': (
        command(stamp=4.5),
        'late',
        'joint_command is late: stamped 4.5000 s, after one of 4.9000 s was taken',
    ),
}


@pytest.mark.parametrize('title', REJECTED)
def test_rejected_commands(last, title):
    message, kind, sentence = REJECTED[title]
    before = [part.copy() for part in (last.stamp, last.angle, last.rate)]
    with pytest.raises(RejectedCommand) as error:
        reference_from(message, last, ROBOT, NOW)
    assert (error.value.kind, str(error.value)) == (kind, sentence)
    for part, old in zip((last.stamp, last.angle, last.rate), before, strict=True):
        assert (part == old).all()


def test_late_is_a_matter_of_the_named_joints(last):
    last.stamp[0] = 4.0
    taken = reference_from(command(['joint_1_yaw'], stamp=4.5), last, ROBOT, NOW)
    assert taken.stamp[0, 0] == pytest.approx(4.5, abs=1e-12)

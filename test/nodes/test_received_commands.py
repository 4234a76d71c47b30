# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The joint reference after a command or a trajectory was received, without any node."""

from array import array
import math

from builtin_interfaces.msg import Duration, Time
import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from snake_sim_ros import Robot, Scene
from snake_sim_ros.gaits.joint_reference import (
    compile_sampling,
    hold_at_limit,
    JointReference,
    sample_command,
    sample_motion,
    start_posture,
)
from snake_sim_ros.nodes.messages import stamp_from
from snake_sim_ros.nodes.received_commands import (
    extrapolated,
    joint_command,
    joint_trajectory,
    jump_between,
    position_commands,
    RejectedCommand,
)

ROBOT = Robot()
NAMES = list(Robot().axis_names)
LIMIT = ROBOT.joint_limit
HORIZON = 0.05  # s


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
    taken = joint_command(
        command(names, [0.3, -0.4], [1.0, -2.0]), last, ROBOT, NOW, HORIZON
    ).reference
    expected = np.full((10, 2), 0.1)
    expected[6, 1], expected[1, 0] = 0.3, -0.4
    rates = np.full((10, 2), 0.5)
    rates[6, 1], rates[1, 0] = 1.0, -2.0
    stamps = np.full((10, 2), 4.9)
    stamps[6, 1] = stamps[1, 0] = NOW
    assert (taken.angle == expected).all()
    assert (taken.rate == rates).all()
    assert (taken.stamp == stamps).all()
    # The reference before the command is another object and did not change.
    assert (last.angle == 0.1).all()


def test_command_without_velocity_stands_still(last):
    taken = joint_command(command(), last, ROBOT, NOW, HORIZON).reference
    assert not taken.rate.any()
    assert (taken.angle == 0.2).all()


def test_velocities_alone_move_joints_on_from_where_their_references_are(last):
    message = command(['joint_7_pitch', 'joint_2_yaw'], [], [1.0, -2.0])
    taken = joint_command(message, last, ROBOT, NOW, HORIZON).reference
    # The reference before is 0.1 rad at 4.9 s and goes on with 0.5 rad/s for the horizon.
    assert taken.angle[6, 1] == taken.angle[1, 0] == pytest.approx(0.1 + 0.5 * HORIZON)
    assert (taken.rate[6, 1], taken.rate[1, 0]) == (1.0, -2.0)
    for time in (5.02, 5.04):  # a stream of them
        taken = joint_command(message, taken, ROBOT, time, HORIZON).reference
    assert taken.angle[1, 0] == pytest.approx(0.1 + 0.5 * HORIZON - 2.0 * 0.04)
    # At the limit they stay there.
    for time in np.arange(5.06, 6.0, 0.02):
        taken = joint_command(message, taken, ROBOT, float(time), HORIZON).reference
    assert taken.angle[1, 0] == -LIMIT


@pytest.mark.parametrize(
    ('stamp', 'meant'),
    [
        (0.0, NOW),
        (4.95, 4.95),
        (5.0, NOW),
        (5.2, NOW),  # in the future
        (1.8e9, NOW),  # from the wall clock
    ],
)
def test_time_of_a_command(last, stamp, meant):
    taken = joint_command(command(stamp=stamp), last, ROBOT, NOW, HORIZON).reference
    assert taken.stamp == pytest.approx(np.full((10, 2), meant), abs=1e-12)


def test_negative_stamp_is_of_another_clock(last):
    message = command()
    message.header.stamp = Time(sec=-3)
    assert (joint_command(message, last, ROBOT, NOW, HORIZON).reference.stamp == NOW).all()


def test_limits_themselves_are_taken(last):
    limit, rate = ROBOT.joint_limit, ROBOT.joint_rate_limit
    taken = joint_command(
        command(position=[-limit] * 20, velocity=[rate] * 20), last, ROBOT, NOW, HORIZON
    ).reference
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
        command(position=[]),
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
        joint_command(message, last, ROBOT, NOW, HORIZON)
    assert (error.value.kind, str(error.value)) == (kind, sentence)
    for part, old in zip((last.stamp, last.angle, last.rate), before, strict=True):
        assert (part == old).all()


def test_late_is_a_matter_of_the_named_joints(last):
    last.stamp[0] = 4.0
    taken = joint_command(command(['joint_1_yaw'], stamp=4.5), last, ROBOT, NOW, HORIZON).reference
    assert taken.stamp[0, 0] == pytest.approx(4.5, abs=1e-12)


def test_position_beyond_the_joint_limit_is_clamped_and_said(last):
    message = command(['joint_5_yaw', 'joint_6_yaw'], [-0.8, 0.79], [-1.0, 0.0])
    taken = joint_command(message, last, ROBOT, NOW, HORIZON)
    assert taken.reference.angle[4:6, 0].tolist() == [-LIMIT, LIMIT]
    assert taken.clamped == (
        'joint_command: position of joint_5_yaw is clamped to the joint limit, +-0.7854 rad; '
        'got -0.8 rad'
    )
    assert not joint_command(command(), last, ROBOT, NOW, HORIZON).clamped


# ---- position_commands --------------------------------------------------------------------------


def test_position_commands_are_of_all_joints_in_order(last):
    taken = position_commands(Float64MultiArray(data=np.arange(20) / 30), last, ROBOT, NOW)
    assert (taken.reference.angle.ravel() == np.arange(20) / 30).all()
    assert not taken.reference.rate.any()
    assert (taken.reference.stamp == NOW).all()
    clamped = position_commands(Float64MultiArray(data=[1.0] * 20), last, ROBOT, NOW)
    assert (clamped.reference.angle == LIMIT).all()
    assert clamped.clamped.startswith('position_commands: position of joint_1_yaw is clamped')


@pytest.mark.parametrize(
    ('data', 'sentence'),
    [
        (TWENTY[:19], 'must have 20 numbers, joint_1_yaw to joint_10_pitch; got 19'),
        ([], 'must have 20 numbers, joint_1_yaw to joint_10_pitch; got 0'),
        ([*TWENTY[:19], math.inf], ': position of joint_10_pitch must be finite, got inf'),
    ],
)
def test_rejected_position_commands(last, data, sentence):
    with pytest.raises(RejectedCommand, match='position_commands') as error:
        position_commands(Float64MultiArray(data=data), last, ROBOT, NOW)
    assert sentence in str(error.value)


# ---- joint_trajectory ---------------------------------------------------------------------------


def trajectory(names, *points, stamp=0.0):
    """Return a trajectory of points (time from start, positions, velocities or nothing)."""
    message = JointTrajectory(joint_names=names)
    message.header.stamp = stamp_from(round(stamp * 1e9))
    for time, positions, *velocities in points:
        point = JointTrajectoryPoint(
            positions=positions, velocities=velocities[0] if velocities else []
        )
        whole = math.floor(time)
        point.time_from_start = Duration(sec=whole, nanosec=round((time - whole) * 1e9))
        message.points.append(point)
    return message


def taken_trajectory(*arguments, last, now=NOW, stamp=0.0):
    message = trajectory(*arguments, stamp=stamp)
    return joint_trajectory(message, last, ROBOT, now, HORIZON).reference


YAW = ['joint_1_yaw', 'joint_3_yaw']
JOINTS = ([0, 2], [0, 0])  # which joints these are, and which axes of them


@pytest.fixture
def still():
    axes = (10, 2)
    return JointReference(np.full(axes, 4.9), np.full(axes, 0.1), np.zeros(axes))


def sampled(reference, times):
    return [
        part[:, JOINTS[0], JOINTS[1]]
        for part in reference.sample(np.array(times), HORIZON, ROBOT.limits)
    ]


def test_points_without_velocities_are_joined_by_lines(still):
    points = (1.0, [0.3, -0.1]), (2.0, [0.3, 0.5])
    reference = taken_trajectory(YAW, *points, last=still)
    angle, rate = sampled(reference, [NOW, NOW + 0.5, NOW + 1.0, NOW + 1.25, NOW + 2.0, NOW + 9])
    expected = [[0.1, 0.1], [0.2, 0.0], [0.3, -0.1], [0.3, 0.05], [0.3, 0.5], [0.3, 0.5]]
    assert angle == pytest.approx(np.array(expected), abs=1e-12)
    assert rate[[1, 3, 5]] == pytest.approx(np.array([[0.2, -0.2], [0, 0.6], [0, 0]]), abs=1e-12)
    # The other joints keep their reference.
    assert (reference.sample(np.array([NOW + 1.0]), HORIZON, ROBOT.limits)[0][0, 4] == 0.1).all()


def test_points_with_velocities_are_joined_by_cubics(last):
    # It begins with the angle and the rate of the reference at that time: 0.1 + 0.05 * 0.5 and,
    # after the horizon, 0.
    points = (0.5, [0.3, 0.0], [0.4, -0.3]), (1.5, [-0.2, 0.2], [0.0, 0.0])
    reference = taken_trajectory(YAW, *points, last=last, stamp=NOW + 0.2)
    knots = NOW + 0.2 + np.array([0.0, 0.5, 1.5])
    curve = CubicHermiteSpline(
        knots,
        [[0.125, 0.125], [0.3, 0.0], [-0.2, 0.2]],
        [[0, 0], [0.4, -0.3], [0, 0]],
    )
    times = np.linspace(knots[0], knots[-1], 61)
    angle, rate = sampled(reference, times)
    assert angle == pytest.approx(curve(times), abs=1e-12)
    assert rate == pytest.approx(curve(times, 1), abs=1e-12)
    # Until it begins the joints follow their previous reference.
    before, _ = sampled(reference, [NOW, NOW + 0.19])
    assert before == pytest.approx(np.array([[0.125] * 2, [0.125] * 2]), abs=1e-12)


def test_new_trajectory_replaces_from_its_begin_on_and_only_its_joints(still):
    first = taken_trajectory(YAW, (2.0, [0.5, 0.5]), last=still)
    # One second later: the first one goes on until then, and for joint_3_yaw to its end.
    second = taken_trajectory(['joint_1_yaw'], (1.0, [0.0]), last=first, stamp=NOW + 1.0)
    times = NOW + np.array([0.5, 1.0, 1.5, 2.0, 3.0])
    angle, _ = sampled(second, times)
    assert angle[:, 0] == pytest.approx([0.2, 0.3, 0.15, 0.0, 0.0], abs=1e-12)
    assert angle[:, 1] == pytest.approx([0.2, 0.3, 0.4, 0.5, 0.5], abs=1e-12)
    # A third one that begins before the second makes that one void.
    third = taken_trajectory(['joint_1_yaw'], (1.0, [0.6]), last=second, now=NOW + 0.5)
    angle, _ = sampled(third, times)
    assert angle[:, 0] == pytest.approx([0.2, 0.4, 0.6, 0.6, 0.6], abs=1e-12)


def test_points_in_the_past_are_dropped(still):
    # The stamp is 0.5 s old: from 0.1 now, not through 0.9, to -0.3 at its time.
    points = (0.2, [0.9, 0.9]), (1.0, [-0.3, 0.5])
    reference = taken_trajectory(YAW, *points, last=still, stamp=NOW - 0.5)
    angle, _ = sampled(reference, [NOW, NOW + 0.25, NOW + 0.5])
    assert angle == pytest.approx(np.array([[0.1, 0.1], [-0.1, 0.3], [-0.3, 0.5]]), abs=1e-12)


def test_first_point_at_the_start_is_a_step(still):
    reference = taken_trajectory(YAW, (0.0, [0.4, 0.3]), last=still)
    angle, rate = sampled(reference, [NOW, NOW + 0.0005, NOW + 1.0])
    assert angle == pytest.approx(np.array([[0.4, 0.3]] * 3), abs=1e-12)
    assert not rate.any()


def test_joint_command_takes_its_joints_from_a_trajectory(still):
    moving = taken_trajectory(YAW, (2.0, [0.5, 0.5]), last=still)
    message = command(['joint_1_yaw'], [-0.2])
    reference = joint_command(message, moving, ROBOT, NOW + 1.0, HORIZON).reference
    angle, _ = sampled(reference, [NOW + 1.5])
    assert angle[0] == pytest.approx([-0.2, 0.4], abs=1e-12)


def test_trajectory_beyond_the_joint_limit_is_clamped(still):
    message = trajectory(YAW, (1.0, [0.2, -1.5]))
    taken = joint_trajectory(message, still, ROBOT, NOW, HORIZON)
    assert taken.clamped == (
        'joint_trajectory: position of joint_3_yaw is clamped to the joint limit, +-0.7854 rad; '
        'got -1.5 rad'
    )
    assert sampled(taken.reference, [NOW + 2])[0][0] == pytest.approx([0.2, -LIMIT], abs=1e-12)


def test_swing_beyond_the_joint_limit_between_points_is_said(still):
    # From 0.7 rad at 1 rad/s back to 0.7 rad in 1 s: s (1 - s)^2 more, 4/27 at s = 1/3.
    message = trajectory(
        YAW,
        (1.0, [0.7, 0.1], [1.0, 0.0]),
        (2.0, [0.7, LIMIT], [0.0, 0.0]),
        (3.0, [0.7, LIMIT], [0.0, 0.0]),
    )
    taken = joint_trajectory(message, still, ROBOT, NOW, HORIZON)
    assert taken.clamped == (
        'joint_trajectory: joint_1_yaw is clamped to the joint limit, +-0.7854 rad; it would '
        'swing to 0.8481 rad until t = 7.0000 s'
    )
    angle, rate = sampled(taken.reference, [NOW + 4 / 3, NOW + 2.5])
    assert angle[0, 0] == LIMIT
    assert rate[0, 0] == 0.0


def test_what_is_beyond_the_joint_limit_stands_still_there(last):
    message = command(['joint_1_yaw', 'joint_3_yaw'], [0.75, -0.75], [2.0, -2.0])
    reference = joint_command(message, last, ROBOT, NOW, HORIZON).reference
    angle, rate = sampled(reference, [NOW + 0.01, NOW + 0.03])
    assert angle == pytest.approx(np.array([[0.77, -0.77], [LIMIT, -LIMIT]]), abs=1e-12)
    assert rate.tolist() == [[2.0, -2.0], [0.0, 0.0]]


REJECTED_TRAJECTORIES = {
    'no points': (trajectory(YAW), 'joint_trajectory has no points'),
    'no names': (trajectory([], (1.0, [])), 'joint_trajectory names no joints; name some of '),
    'unknown': (
        trajectory(['joint_1'], (1.0, [0.1])),
        "joint_trajectory: unknown joint 'joint_1'; did you mean joint_1_yaw?",
    ),
    'too few positions': (
        trajectory(YAW, (1.0, [0.1, 0.2]), (2.0, [0.1])),
        'joint_trajectory: point 2 must have 2 positions, got 1',
    ),
    'velocities missing': (
        trajectory(YAW, (1.0, [0.1, 0.2], [0.0, 0.0]), (2.0, [0.1, 0.1])),
        'joint_trajectory: point 2 must have 2 velocities, got 0',
    ),
    'velocities too many': (
        trajectory(YAW, (1.0, [0.1, 0.2]), (2.0, [0.1, 0.1], [0.0, 0.0])),
        'joint_trajectory: point 2 must have 0 velocities, got 2',
    ),
    'not increasing': (
        trajectory(YAW, (1.0, [0.1, 0.2]), (1.0, [0.1, 0.1])),
        'increase from point to point, got 1 s after 1 s at point 2',
    ),
    'negative time': (
        trajectory(YAW, (-1.0, [0.1, 0.2])),
        'must be at least 0 s and increase from point to point, got -1 s after 0 s at point 1',
    ),
    'not finite': (
        trajectory(YAW, (1.0, [0.1, math.nan])),
        'joint_trajectory: position of joint_3_yaw must be finite, got nan',
    ),
    'moving at the end': (
        trajectory(YAW, (1.0, [0.1, 0.2], [0.0, 0.5])),
        'velocities of the last point must be 0 rad/s, got 0.5 rad/s for joint_3_yaw',
    ),
    'velocity out of range': (
        trajectory(YAW, (1.0, [0.1, 0.2], [20.0, 0.0]), (2.0, [0.1, 0.2], [0.0, 0.0])),
        'velocity of joint_1_yaw must be within +-10 rad/s, got 20 rad/s',
    ),
    'too fast': (
        trajectory(YAW, (0.5, [0.1, 0.1]), (0.51, [0.1, 0.4])),
        'joint_trajectory: joint_3_yaw would move at 30 rad/s until t = 5.5100 s; at most 10',
    ),
    'too fast between points': (
        trajectory(YAW, (0.5, [0.0, 0.1], [-9.0, 0.0]), (0.6, [0.5, 0.1], [0.0, 0.0])),
        # -9 rad/s + 330^2/(3 1900) rad/s, at -9 + 2 330 s - 3 1900 s^2; 5 rad/s in the mean
        'joint_trajectory: joint_1_yaw would move at 10.11 rad/s until t = 5.6000 s; at most 10',
    ),
    'late': (
        trajectory(YAW, (1.0, [0.1, 0.1]), stamp=3.0),
        'joint_trajectory is late: its last point is at 4.0000 s, it is 5.0000 s',
    ),
    'far ahead': (
        trajectory(YAW, (1.0, [0.1, 0.1]), stamp=1e6),
        'joint_trajectory must begin within an hour of simulated time 5.0000 s, got a stamp of ',
    ),
}


@pytest.mark.parametrize('title', REJECTED_TRAJECTORIES)
def test_rejected_trajectories(still, title):
    message, sentence = REJECTED_TRAJECTORIES[title]
    with pytest.raises(RejectedCommand) as error:
        joint_trajectory(message, still, ROBOT, NOW, HORIZON)
    assert sentence in str(error.value)


@pytest.mark.parametrize('moving', [False, True])
def test_too_fast_a_way_to_the_first_point_is_a_jump(still, moving):
    points = [(0.02, [0.4, 0.1]), (1.0, [0.5, 0.2])]
    if moving:
        points = [(*points[0], [0.5, -0.5]), (*points[1], [0.0, 0.0])]
    message = trajectory(YAW, *points)
    taken = joint_trajectory(message, still, ROBOT, NOW, HORIZON)
    start = float(still.angle[JOINTS][0])
    assert taken.jump.startswith(
        f'joint_trajectory: joint_1_yaw jumps from {start:.4g} rad to its first point, 0.4 rad; '
    )
    times = np.linspace(NOW, NOW + 1.0, 101)
    angle, rate = taken.reference.sample(times, HORIZON, ROBOT.limits)
    assert np.abs(rate).max() <= ROBOT.joint_rate_limit
    # The first joint is at its first point at once, or on a short swing that ends there.
    assert np.abs(angle[:3, 0, 0] - 0.4).max() < 4 / 27 * 0.5 * 0.02 + 1e-9
    assert angle[[2, -1]][:, JOINTS[0], JOINTS[1]] == pytest.approx(
        np.array([[0.4, 0.1], [0.5, 0.2]]), abs=1e-9
    )
    # The second joint is near enough to move there from its present angle.
    assert angle[0][JOINTS][1] == pytest.approx(still.angle[JOINTS][1], abs=1e-9)


def test_late_is_what_was_said_before_a_trajectory_began(still):
    reference = taken_trajectory(YAW, (1.0, [0.3, 0.3]), last=still)
    late = command(['joint_1_yaw'], [0.0], stamp=NOW - 0.1)
    with pytest.raises(RejectedCommand, match='is late'):
        joint_command(late, reference, ROBOT, NOW + 0.5, HORIZON)
    other = command(['joint_5_pitch'], [0.0], stamp=NOW + 0.1)
    assert joint_command(other, reference, ROBOT, NOW + 0.5, HORIZON).reference.motions


def test_command_that_goes_beyond_the_limit_with_its_velocity_is_told(last):
    message = command(['joint_2_yaw'], [0.75], [2.0])
    reference = joint_command(message, last, ROBOT, NOW, HORIZON).reference
    assert not extrapolated(reference, ROBOT, NOW + 0.01, HORIZON)
    assert extrapolated(reference, ROBOT, NOW + 1.0, HORIZON) == (
        'joint_command: joint_2_yaw is clamped to the joint limit, +-0.7854 rad; '
        f'with its velocity it would reach {0.75 + 2.0 * HORIZON:.4g} rad'
    )


@pytest.mark.parametrize('stamp', [1.8e9, -3.0])
def test_trajectory_with_a_stamp_of_another_clock_begins_now(still, stamp):
    points = (1.0, [0.3, -0.1]), (2.0, [0.3, 0.5])
    reference = taken_trajectory(YAW, *points, last=still, stamp=stamp)
    expected = taken_trajectory(YAW, *points, last=still)
    moments = NOW + np.arange(3)
    assert np.array_equal(sampled(reference, moments), sampled(expected, moments))


@pytest.mark.parametrize(
    ('angle', 'since', 'needed'),
    [
        (0.149, 1.0, None),  # 0.05 rad in a period of 5 ms from 0.1 rad on
        (0.16, 1.0, 12),  # alone: it has one period
        (0.29, 0.02, None),  # in a stream of 50 Hz
        (0.31, 0.02, 10.5),
        (-0.3, 0.0, 80),  # two in the same period
    ],
)
def test_command_that_jumps_is_told(still, angle, since, needed):
    now = 4.9 + since
    new = joint_command(command(['joint_2_yaw'], [angle]), still, ROBOT, now, HORIZON).reference
    told = jump_between('joint_command', still, new, ROBOT, now, horizon=HORIZON, period=0.005)
    expected = (
        f'joint_command: joint_2_yaw jumps from 0.1 rad to {angle:g} rad; {needed} rad/s would '
        f'be needed, at most 10 rad/s; it is led there at that rate'
    )
    assert told == (expected if needed else '')


def test_command_out_of_a_trajectory_jumps_from_where_that_is(still):
    moving = taken_trajectory(YAW, (2.0, [0.5, 0.5]), last=still)
    now = NOW + 1.0
    for angle, jumps in ((0.31, False), (0.1, True)):
        new = joint_command(
            command(['joint_1_yaw'], [angle]), moving, ROBOT, now, HORIZON
        ).reference
        told = jump_between('x', moving, new, ROBOT, now, horizon=HORIZON, period=0.005)
        assert told.startswith('x: joint_1_yaw jumps from 0.3 rad to 0.1 rad; 40 rad/s' * jumps)
        assert bool(told) == jumps


def test_streamed_trajectories_do_not_pile_up(still):
    reference = still
    for k in range(50):
        now = NOW + 0.01 * k
        reference = taken_trajectory(YAW, (1.0, [0.3, 0.3]), last=reference, now=now).settled(now)
    assert len(reference.motions) == 1
    over = reference.settled(NOW + 2.0)
    assert not over.motions
    assert over.angle[JOINTS] == pytest.approx([0.3, 0.3], abs=1e-12)


def test_trajectories_that_wait_are_not_without_number(still):
    reference = still
    for k in range(20):
        reference = taken_trajectory(YAW, (1.0, [0.2, 0.2]), last=reference, stamp=NOW + 1 + k)
    with pytest.raises(RejectedCommand, match='20 trajectories that begin earlier still wait'):
        taken_trajectory(YAW, (1.0, [0.2, 0.2]), last=reference, stamp=NOW + 30)
    # A trajectory that makes others void is taken, and so is one after the first has begun.
    assert len(taken_trajectory(YAW, (1.0, [0.2, 0.2]), last=reference).motions) == 1
    later = reference.settled(NOW + 1)
    taken_trajectory(YAW, (1.0, [0.2, 0.2]), last=later, now=NOW + 1, stamp=NOW + 30)


def test_sampling_is_compiled_once_for_commands_of_all_kinds(still):
    compile_sampling(Scene())
    reference = taken_trajectory(YAW, (0.4, [0.5, 0.5]), (0.8, [0.2, 0.6]), last=still)
    reference = taken_trajectory(YAW, (1.0, [0.0, 0.0], [0.0, 0.0]), last=reference)
    reference = joint_command(command(['joint_1_yaw']), reference, ROBOT, NOW, HORIZON).reference
    reference.settled(NOW + 0.1).settled(NOW + 2.0)
    reference.sample(NOW + np.arange(5.0), HORIZON, ROBOT.limits)
    for kernel in (sample_command, hold_at_limit, sample_motion):
        assert len(kernel.codes) == 1


def test_settling_changes_nothing(still):
    reference = taken_trajectory(YAW, (0.4, [0.5, 0.5]), (0.8, [0.2, 0.6]), last=still)
    reference = taken_trajectory(['joint_3_yaw'], (0.3, [0.0]), last=reference, stamp=NOW + 0.2)
    reference = taken_trajectory(['joint_5_pitch'], (0.1, [0.0]), last=reference, stamp=NOW + 0.6)
    settled = reference
    for now in NOW + np.arange(0.0, 1.0, 0.05):
        settled = settled.settled(now)
        times = now + np.linspace(0.0, 0.05, 5)
        for part, expected in zip(
            settled.sample(times, HORIZON, ROBOT.limits),
            reference.sample(times, HORIZON, ROBOT.limits),
            strict=True,
        ):
            assert (part == expected).all()
    assert not settled.motions


# ---- efforts ------------------------------------------------------------------------------------


def test_efforts_are_taken_by_a_robot_that_takes_them():
    robot, last = Robot(effort_commands=True), start_posture(Scene())
    message = JointState(name=NAMES[:2], position=[0.1, 0.0], effort=[1.0, -2.0])
    taken = joint_command(message, last, robot, 1.0, HORIZON)
    axes, torques = taken.effort
    assert axes.tolist() == [0, 1] and torques.tolist() == [1.0, -2.0]
    assert taken.reference.angle.flat[0] == 0.1
    alone = joint_command(JointState(name=NAMES[3:4], effort=[0.5]), last, robot, 1.0, HORIZON)
    assert alone.reference is last and alone.effort[1].tolist() == [0.5]
    # A robot with position control only follows the positions, as of a joint_states message.
    assert joint_command(message, last, ROBOT, 1.0, HORIZON).effort is None


@pytest.mark.parametrize(
    ('effort', 'said'),
    [([1.0], 'got 1 efforts for 2 names'), ([1.0, math.nan], 'effort of joint_1_pitch must be')],
)
def test_efforts_that_are_not_usable_are_rejected(effort, said):
    message = JointState(name=NAMES[:2], position=[0.0, 0.0], effort=effort)
    with pytest.raises(RejectedCommand, match=said):
        joint_command(message, start_posture(Scene()), Robot(effort_commands=True), 1.0, HORIZON)


def test_efforts_alone_need_a_robot_that_takes_them():
    message = JointState(name=NAMES[:2], effort=[1.0, 2.0])
    with pytest.raises(RejectedCommand, match='efforts alone need a robot that takes them'):
        joint_command(message, start_posture(Scene()), ROBOT, 1.0, HORIZON)


# ---- interfaces that no controller has claimed --------------------------------------------------


def test_interface_without_a_controller_has_no_command(last):
    robot, unclaimed = Robot(effort_commands=True), np.ones((3, 20), dtype=bool)
    nan = math.nan
    message = JointState(
        name=NAMES[:4],
        position=[0.2, nan, nan, nan],
        velocity=[nan, 1.0, nan, nan],
        effort=[nan, nan, 0.5, nan],
    )
    taken = joint_command(message, last, robot, NOW, HORIZON, unclaimed)
    axes, given = taken.given
    assert axes.tolist() == [0, 1, 2, 3]
    assert given.tolist() == np.eye(3, 4, dtype=bool).tolist()
    reference = taken.reference
    assert reference.angle.flat[0] == 0.2 and reference.rate.flat[0] == 0.0
    # The second joint goes on from where its reference was: 0.1 rad, for 0.05 s at 0.5 rad/s.
    assert reference.angle.flat[1] == pytest.approx(0.125) and reference.rate.flat[1] == 1.0
    assert reference.stamp.ravel()[:4].tolist() == [NOW, NOW, 4.9, 4.9]
    assert (taken.effort[0].tolist(), taken.effort[1].tolist()) == ([2], [0.5])


@pytest.mark.parametrize('value', [math.nan, math.inf])
def test_joint_that_had_numbers_needs_them(last, value):
    unclaimed = np.ones((3, 20), dtype=bool)
    unclaimed[0, 1] = False
    message = command(position=[0.0, value, *TWENTY[2:]])
    with pytest.raises(RejectedCommand, match='position of joint_1_pitch must be finite'):
        joint_command(message, last, ROBOT, NOW, HORIZON, unclaimed)
    message = command(position=[math.inf, *TWENTY[1:]])
    with pytest.raises(RejectedCommand, match='position of joint_1_yaw must be finite'):
        joint_command(message, last, ROBOT, NOW, HORIZON, unclaimed)

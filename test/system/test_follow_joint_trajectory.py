# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The action follow_joint_trajectory of a real sim node, with the messages of control_msgs."""

import math

from action_msgs.msg import GoalStatus
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTolerance
import pytest
from rclpy.action import ActionClient
from rclpy.duration import Duration
from sim_client import SimClient
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

JOINT = 'joint_1_yaw'


@pytest.fixture(scope='module')
def sim(make_graph):
    client = SimClient(make_graph())
    client.wait_until_connected()
    client.action = ActionClient(
        client.graph.node, FollowJointTrajectory, '/sim/follow_joint_trajectory'
    )
    client.graph.until(client.action.server_is_ready, 'the action')
    return client


def done(sim, future, what):
    sim.graph.until(future.done, what)
    return future.result()


def send(sim, seconds, angle, name=JOINT, tolerance=0.0, feedback=None):
    """Send a goal of one point, with a tolerance on the path [rad]; return its handle."""
    point = JointTrajectoryPoint(positions=[angle])
    point.time_from_start = Duration(seconds=seconds).to_msg()
    goal = FollowJointTrajectory.Goal()
    goal.trajectory = JointTrajectory(joint_names=[name], points=[point])
    goal.path_tolerance = [JointTolerance(name=name, position=tolerance)]
    return done(sim, sim.action.send_goal_async(goal, feedback), 'the answer to a goal')


def result(sim, handle):
    answer = done(sim, handle.get_result_async(), 'the result of a goal')
    return answer.status, answer.result.error_code, answer.result.error_string


def test_goal_succeeds_at_the_end_of_its_trajectory(sim):
    begin = sim.now
    handle = send(sim, 0.6, 0.4)
    assert handle.accepted
    assert result(sim, handle) == (GoalStatus.STATUS_SUCCEEDED, 0, '')
    assert sim.now >= begin + 0.55  # a result may overtake the last states
    assert sim.joint_states[-1].position[0] == pytest.approx(0.4, abs=0.05)


def test_goal_gives_feedback_and_ends_where_a_joint_leaves_the_path(sim):
    heard = []
    handle = send(sim, 0.5, 0.1, feedback=heard.append)
    assert result(sim, handle)[0] == GoalStatus.STATUS_SUCCEEDED
    assert heard[-1].feedback.joint_names == [JOINT]
    assert abs(heard[-1].feedback.error.positions[0]) < 0.1
    status, code, sentence = result(sim, send(sim, 0.2, -0.5, tolerance=1e-4))
    assert (status, code) == (GoalStatus.STATUS_ABORTED, -4)
    assert sentence.startswith(f'the angle of {JOINT} is off by ')


def test_goal_that_is_not_usable_is_rejected_with_the_sentence(sim):
    handle = send(sim, 0.5, 0.2, name='joint_1_jaw')
    assert not handle.accepted
    sim.process.wait_for("joint_trajectory: unknown joint 'joint_1_jaw'; did you mean joint_1_yaw")


BAD = {  # what is wrong with a goal -> its joints, points as (time, positions), and the sentence
    'no joints': ([], [(0.5, [])], 'joint_trajectory names no joints'),
    'no points': ([JOINT], [], 'joint_trajectory has no points'),
    'length': ([JOINT], [(0.5, [0.1, 0.2])], 'point 1 must have 1 positions, got 2'),
    'not finite': ([JOINT], [(0.5, [math.nan])], f'position of {JOINT} must be finite, got nan'),
    'order': ([JOINT], [(0.5, [0.1]), (0.4, [0.2])], 'must be at least 0 s and increase'),
    'twice': ([JOINT, JOINT], [(0.5, [0.1, 0.1])], f'names joint {JOINT} more than once'),
    'too fast': ([JOINT], [(0.5, [0.7]), (0.51, [-0.7])], f'{JOINT} would move at 140 rad/s'),
}


@pytest.mark.parametrize('what', BAD)
def test_bad_goal_is_answered_with_a_rejection_and_leaves_the_one_before(sim, what):
    names, points, sentence = BAD[what]
    first = send(sim, 0.3, 0.05)
    goal = FollowJointTrajectory.Goal()
    goal.trajectory.joint_names = names
    for seconds, positions in points:
        point = JointTrajectoryPoint(positions=positions)
        point.time_from_start = Duration(seconds=seconds).to_msg()
        goal.trajectory.points.append(point)
    answer = done(sim, sim.action.send_goal_async(goal), 'the answer to a goal')
    assert not answer.accepted
    sim.process.wait_for(sentence)
    assert result(sim, first) == (GoalStatus.STATUS_SUCCEEDED, 0, '')


def test_goal_with_a_tolerance_of_another_joint_is_rejected(sim):
    goal = FollowJointTrajectory.Goal()
    point = JointTrajectoryPoint(positions=[0.1], time_from_start=Duration(seconds=0.5).to_msg())
    goal.trajectory = JointTrajectory(joint_names=[JOINT], points=[point])
    goal.goal_tolerance = [JointTolerance(name='joint_2_yaw', position=0.1)]
    assert not done(sim, sim.action.send_goal_async(goal), 'the answer to a goal').accepted
    sim.process.wait_for("goal_tolerance names joint 'joint_2_yaw', which is not one of the traj")


def test_canceled_goal_holds_the_joints(sim):
    handle = send(sim, 4.0, -0.4)
    begin = sim.now
    sim.advance_to(begin + 0.5)
    answer = done(sim, handle.cancel_goal_async(), 'the answer to a cancellation')
    assert len(answer.goals_canceling) == 1
    assert result(sim, handle) == (GoalStatus.STATUS_CANCELED, 0, 'canceled')
    sim.advance_to(sim.now + 0.5)
    held = sim.joint_states[-1].position[0]
    assert held > -0.2
    sim.advance_to(sim.now + 0.3)
    assert sim.joint_states[-1].position[0] == pytest.approx(held, abs=1e-3)


def test_new_goal_takes_the_place_of_the_old_one(sim):
    first = send(sim, 3.0, 0.3)
    second = send(sim, 0.5, 0.1)
    assert result(sim, first)[0] == GoalStatus.STATUS_ABORTED
    assert result(sim, second) == (GoalStatus.STATUS_SUCCEEDED, 0, '')


@pytest.mark.parametrize('how', ['command', 'reset'])
def test_goal_whose_joints_follow_another_command_is_aborted(sim, how):
    handle = send(sim, 5.0, 0.3)
    sim.send({'joint_9_yaw': 0.1})  # of another joint
    sim.advance_to(sim.now + 0.1)
    if how == 'command':
        sim.send({JOINT: 0.1})
    else:
        assert sim.reset().success
    told = (GoalStatus.STATUS_ABORTED, -1, 'another command took over its joints')
    assert result(sim, handle) == told

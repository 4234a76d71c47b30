# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The action follow_joint_trajectory of a real sim node, with the messages of control_msgs."""

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

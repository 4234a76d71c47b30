# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The goals of follow_joint_trajectory, with a stand-in for the package control_msgs.

Where that package is installed, test/system/test_follow_joint_trajectory.py runs as well.
"""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from rclpy.action import CancelResponse, GoalResponse
from rclpy.duration import Duration

from snake_sim_ros.gaits.joint_reference import Motion
from snake_sim_ros.nodes.command_inbox import Tracked
from snake_sim_ros.nodes.received_commands import RejectedCommand
from snake_sim_ros.nodes.trajectory_action import TrajectoryAction

NAMES = ['joint_1_yaw', 'joint_2_yaw']
KIND = SimpleNamespace(
    Result=SimpleNamespace, Feedback=lambda: SimpleNamespace(header=SimpleNamespace())
)


class Inbox:
    """Takes every trajectory that ends after 0 s, and notes what is stopped and rejected."""

    def __init__(self):
        self.watch, self.motions, self.stopped, self.rejected = None, [], [], []
        self.told, self.there = np.array([0.5, 0.0]), np.array([0.5, 0.0])

    def take_trajectory(self, trajectory):
        if trajectory.end <= 0.0:
            raise RejectedCommand('late', 'it is late')
        times = np.array([0.0, trajectory.end])
        self.motions = [Motion(np.arange(2), times, np.zeros((1, 4, 2)))]
        return self.motions[0]

    def reject(self, error):
        self.rejected.append(str(error))

    def follows(self, motion):
        return any(motion is item for item in self.motions)

    def tracked(self, motion):
        return Tracked(self.told.copy(), np.zeros(2), self.there.copy(), np.array([0.0, 0.2]))

    def stop(self, motion):
        self.stopped.append(motion)


class Goal:
    """Notes how it ends."""

    def __init__(self, number):
        self.goal_id, self.end, self.result, self.feedback = number, None, None, []

    def execute(self, finish):
        self.result = finish(self)

    def publish_feedback(self, feedback):
        self.feedback.append(feedback)

    def succeed(self):
        self.end = 'succeeded'

    def canceled(self):
        self.end = 'canceled'

    def abort(self):
        self.end = 'aborted'


@pytest.fixture
def action():
    return TrajectoryAction(Inbox(), KIND)


def request(end=2.0, *, path=(), goal=(), patience=0.0):
    """Return a goal; tolerances are tuples of name, position and velocity."""
    path, goal = (
        [SimpleNamespace(name=n, position=x, velocity=v) for n, x, v in told]
        for told in (path, goal)
    )
    return SimpleNamespace(
        trajectory=SimpleNamespace(joint_names=NAMES, end=end),
        path_tolerance=path,
        goal_tolerance=goal,
        goal_time_tolerance=Duration(seconds=patience).to_msg(),
    )


def start(action, number, end=2.0, **tolerances):
    assert action.on_goal(request(end, **tolerances)) == GoalResponse.ACCEPT
    goal = Goal(number)
    action.on_accepted(goal)
    return goal


def test_goal_ends_with_its_trajectory_and_nothing_is_watched_then(action):
    inbox = action._inbox
    assert inbox.watch is None
    goal = start(action, 1)
    inbox.watch(1.99)
    assert goal.end is None
    inbox.watch(2.0)
    assert (goal.end, goal.result.error_code) == ('succeeded', 0)
    assert inbox.watch is None


def test_rejected_goal_leaves_the_one_before(action):
    goal = start(action, 1)
    assert action.on_goal(request(-1.0)) == GoalResponse.REJECT
    assert goal.end is None and action._inbox.watch
    second = start(action, 2)
    assert (goal.end, goal.result.error_code) == ('aborted', -1)
    action._inbox.motions = []
    action._inbox.watch(0.5)
    assert second.end == 'aborted'
    assert second.result.error_string == 'another command took over its joints'


def test_canceled_goal_is_stopped(action):
    goal = start(action, 1)
    assert action.on_cancel(Goal(7)) == CancelResponse.REJECT
    assert action.on_cancel(goal) == CancelResponse.ACCEPT
    assert (goal.end, len(action._inbox.stopped)) == ('canceled', 1)
    assert action.on_cancel(goal) == CancelResponse.REJECT


def test_goal_of_a_robot_that_is_gone_ends(action):
    goal = start(action, 1)
    action.drop()
    assert (goal.end, goal.result.error_string) == ('aborted', 'its robot is gone')
    assert action._inbox.watch is None


def test_feedback_comes_twenty_times_a_second(action):
    goal = start(action, 1)
    action._inbox.there[0] = 0.4
    for k in range(101):
        action._inbox.watch(0.005 * k)
    assert 10 <= len(goal.feedback) <= 11
    feedback = goal.feedback[2]
    assert feedback.header.stamp.nanosec == pytest.approx(1e8, abs=6e6)
    assert feedback.joint_names == NAMES
    assert list(feedback.desired.positions) == [0.5, 0.0]
    assert list(feedback.actual.positions) == [0.4, 0.0]
    assert feedback.error.positions[0] == pytest.approx(0.1)
    assert feedback.error.velocities[1] == pytest.approx(-0.2)


@pytest.mark.parametrize(
    ('path', 'sentence'),
    [
        (('joint_1_yaw', 0.05, 0.0), 'the angle of joint_1_yaw is off by -0.1 rad, more than'),
        (('joint_2_yaw', 0.0, 0.1), 'the rate of joint_2_yaw is off by 0.2 rad/s, more than'),
    ],
)
def test_joint_that_leaves_the_path_ends_the_goal_and_is_held(action, path, sentence):
    goal = start(action, 1, path=[path])
    action._inbox.there[0] = 0.4
    action._inbox.watch(0.5)
    assert (goal.end, goal.result.error_code) == ('aborted', -4)
    assert sentence in goal.result.error_string
    assert len(action._inbox.stopped) == 1


def test_goal_waits_for_joints_that_are_late_as_long_as_it_is_told(action):
    late = {'goal': [('joint_1_yaw', 0.05, -1.0)]}
    first = start(action, 1, **late)
    action._inbox.there[0] = 0.4
    for now in (1.0, 2.0, 2.1, 9.0):
        action._inbox.watch(now)
        action._inbox.motions = action._inbox.motions if now < 2.0 else []  # it has ended
    assert first.end is None  # without a time it waits as long as it takes
    action._inbox.there[0] = 0.46
    action._inbox.watch(9.1)
    assert (first.end, first.result.error_code) == ('succeeded', 0)
    action._inbox.there[0] = 0.4
    second = start(action, 2, patience=0.5, **late)
    for now in (2.0, 2.4):
        action._inbox.watch(now)
        assert second.end is None
    action._inbox.watch(2.6)
    assert (second.end, second.result.error_code) == ('aborted', -5)
    third = start(action, 3, **late)
    action._inbox.watch(2.0)
    action._inbox.told[0] = 0.3  # by another command
    action._inbox.watch(2.1)
    assert (third.end, third.result.error_code) == ('aborted', -1)


@pytest.mark.parametrize(
    ('told', 'sentence'),
    [
        (('joint_9_yaw', 0.1, 0.0), "names joint 'joint_9_yaw', which is not one of the traj"),
        (('joint_1_yaw', math.nan, 0.0), 'position of joint_1_yaw must be finite, got nan'),
        (('joint_1_yaw', 0.1, math.inf), 'velocity of joint_1_yaw must be finite, got inf'),
    ],
)
@pytest.mark.parametrize('field', ['path', 'goal'])
def test_useless_tolerances_are_rejected_with_a_sentence(action, field, told, sentence):
    assert action.on_goal(request(**{field: [told]})) == GoalResponse.REJECT
    assert f'{field}_tolerance' in action._inbox.rejected[0]
    assert sentence in action._inbox.rejected[0]
    assert not action._inbox.motions

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The goals of follow_joint_trajectory, with a stand-in for the package control_msgs.

Where that package is installed, test/system/test_follow_joint_trajectory.py runs as well.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from rclpy.action import CancelResponse
from rclpy.action import GoalResponse

from snake_sim_ros.gaits.joint_reference import Motion
from snake_sim_ros.nodes.received_commands import RejectedCommand
from snake_sim_ros.nodes.trajectory_action import TrajectoryAction


class Inbox:
    """Takes every trajectory that ends after 0 s, and notes what is stopped."""

    def __init__(self):
        self.watch, self.motions, self.stopped = None, [], []

    def take_trajectory(self, end):
        if end <= 0.0:
            raise RejectedCommand('late', 'it is late')
        self.motions = [Motion(np.array([0]), np.array([0.0, end]), np.zeros((1, 4, 1)))]
        return self.motions[0]

    def follows(self, motion):
        return any(motion is item for item in self.motions)

    def stop(self, motion):
        self.stopped.append(motion)


class Goal:
    """Notes how it ends."""

    def __init__(self, number):
        self.goal_id, self.end, self.result = number, None, None

    def execute(self, finish):
        self.result = finish(self)

    def succeed(self):
        self.end = 'succeeded'

    def canceled(self):
        self.end = 'canceled'

    def abort(self):
        self.end = 'aborted'


@pytest.fixture
def action():
    return TrajectoryAction(Inbox(), SimpleNamespace)


def start(action, number, end=2.0):
    assert action.on_goal(SimpleNamespace(trajectory=end)) == GoalResponse.ACCEPT
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
    assert action.on_goal(SimpleNamespace(trajectory=-1.0)) == GoalResponse.REJECT
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

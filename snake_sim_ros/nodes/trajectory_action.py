# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The action ``~/follow_joint_trajectory``, as a joint_trajectory_controller has it.

It is served where the package control_msgs is installed. A goal goes the way of a message on
`joint_trajectory`, and is refused for the same reasons.
"""

from typing import Any
from typing import Protocol

from rclpy.action import ActionServer
from rclpy.action import CancelResponse
from rclpy.action import GoalResponse
from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectory

from snake_sim_ros.gaits.joint_reference import Motion
from snake_sim_ros.nodes.received_commands import RejectedCommand

try:
    from control_msgs.action import FollowJointTrajectory
except ImportError:  # The ROS 2 packages on PyPI do not have it.
    FollowJointTrajectory = None

REACHED, INVALID_GOAL = 0, -1  # the numbers of FollowJointTrajectory
CANCELED, REPLACED = 'canceled', 'another command took over its joints'


class Inbox(Protocol):
    """What takes the trajectories."""

    watch: Any

    def take_trajectory(self, message: JointTrajectory) -> Motion:
        """Take a trajectory, or raise RejectedCommand."""

    def follows(self, motion: Motion) -> bool:
        """Return whether the joints still follow a trajectory that was taken."""

    def stop(self, motion: Motion) -> None:
        """Hold the joints of a trajectory where they are told to be."""


class TrajectoryAction:
    """
    The goals of the action: one is followed at a time, and a new one takes its place.

    A goal is executed when its end is there: an executor that waits for the end of a coroutine
    takes all the time of a processor.

    Parameters
    ----------
    inbox : Inbox
        Its attribute `watch` is called with the simulated time [s] while there is a goal.
    result : type
        The type of results.

    """

    def __init__(self, inbox: Inbox, result: Any) -> None:
        self._inbox, self._result = inbox, result
        self._goal: Any = None
        self._motion: Motion | None = None

    def on_goal(self, request: Any) -> GoalResponse:
        """Take the trajectory of a goal or reject it; the log says why."""
        try:
            motion = self._inbox.take_trajectory(request.trajectory)
        except RejectedCommand:
            return GoalResponse.REJECT
        self._end(INVALID_GOAL, REPLACED)
        self._motion = motion
        return GoalResponse.ACCEPT

    def on_accepted(self, goal: Any) -> None:
        """Follow the goal whose trajectory was taken last."""
        self._goal, self._inbox.watch = goal, self._on_time

    def on_cancel(self, goal: Any) -> CancelResponse:
        """Hold the joints of a goal."""
        if self._goal is None or self._goal.goal_id != goal.goal_id or self._motion is None:
            return CancelResponse.REJECT
        self._inbox.stop(self._motion)
        self._end(REACHED, CANCELED)
        return CancelResponse.ACCEPT

    def _on_time(self, now: float) -> None:
        """End the goal if its trajectory ended, or if its joints follow another command."""
        if self._motion is None:
            return
        if not self._inbox.follows(self._motion):
            self._end(INVALID_GOAL, REPLACED)
        elif now >= self._motion.end:
            self._end(REACHED, '')

    def _end(self, code: int, error: str) -> None:
        """End the goal with a result."""
        goal, self._goal, self._motion, self._inbox.watch = self._goal, None, None, None

        def finish(goal: Any) -> Any:
            ends = {'': goal.succeed, CANCELED: goal.canceled}
            ends.get(error, goal.abort)()
            return self._result(error_code=code, error_string=error)

        if goal is not None:
            goal.execute(finish)


def serve_trajectories(node: Node, inbox: Inbox) -> None:
    """Serve the action of a node if its package is installed."""
    if FollowJointTrajectory is None:
        return
    action = TrajectoryAction(inbox, FollowJointTrajectory.Result)
    ActionServer(
        node,
        FollowJointTrajectory,
        '~/follow_joint_trajectory',
        execute_callback=lambda goal: None,  # Each goal gets one of its own.
        goal_callback=action.on_goal,
        handle_accepted_callback=action.on_accepted,
        cancel_callback=action.on_cancel,
    )

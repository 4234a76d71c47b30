# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The action ``~/follow_joint_trajectory``, as a joint_trajectory_controller has it.

It is served where the package control_msgs is installed. A goal is handled like a message on
`joint_trajectory`, and is refused for the same reasons.
"""

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any

import numpy as np
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectoryPoint

from snake_sim_ros.gaits.joint_reference import Motion
from snake_sim_ros.nodes.command_inbox import CommandInbox, Tracked
from snake_sim_ros.nodes.messages import seconds_from, stamp_from
from snake_sim_ros.nodes.received_commands import RejectedCommand
from snake_sim_ros.scene.checked_records import quoted
from snake_sim_ros.scene.parameters import Array

try:
    from control_msgs.action import FollowJointTrajectory
except ImportError:  # The ROS 2 packages on PyPI do not have it.
    FollowJointTrajectory = None

# ---- tolerances ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Tolerance:
    """
    Largest distances of some joints from what they are commanded.

    Attributes
    ----------
    names : sequence of str
        Of the joints.
    angle, rate : ndarray, shape (k,)
        [rad], [rad/s]; infinite where there is none.

    """

    names: Sequence[str]
    angle: Array
    rate: Array

    def violation(self, tracked: Tracked) -> str:
        """Return a sentence on the first joint that is too far off, empty if none is."""
        for what, unit, most, off in (
            ('angle', 'rad', self.angle, tracked.angle - tracked.commanded_angle),
            ('rate', 'rad/s', self.rate, tracked.rate - tracked.commanded_rate),
        ):
            (beyond,) = np.nonzero(~(np.abs(off) <= most))
            if len(beyond):
                k = beyond[0]
                return (
                    f'the {what} of {self.names[k]} is off by {off[k]:.3g} {unit}, '
                    f'more than {most[k]:g} {unit}'
                )
        return ''


def tolerance_from(field: str, given: Sequence[Any], names: Sequence[str]) -> Tolerance:
    """
    Return the tolerances of a goal.

    Parameters
    ----------
    field : str
        Name of the field of the goal, for messages.
    given : sequence of control_msgs/JointTolerance
        Values that are 0 or negative demand nothing. Accelerations are not measured.
    names : sequence of str
        Joints of the trajectory.

    Raises
    ------
    RejectedCommand
        If a joint is not one of the trajectory, or a value is not finite.

    """
    found = Tolerance(names, *np.full((2, len(names)), math.inf))
    for item in given:
        if item.name not in names:
            raise RejectedCommand(
                'tolerance',
                f'{field} names joint {quoted(item.name)}, which is not one of the trajectory',
            )
        for what, value, most in (
            ('position', item.position, found.angle),
            ('velocity', item.velocity, found.rate),
        ):
            if not math.isfinite(value):
                raise RejectedCommand(
                    'tolerance', f'{field}: {what} of {item.name} must be finite, got {value}'
                )
            if value > 0.0:
                most[names.index(item.name)] = value
    return found


# ---- the action ---------------------------------------------------------------------------------

REACHED, INVALID_GOAL, OFF_PATH, GOAL_MISSED = 0, -1, -4, -5  # numbers of FollowJointTrajectory
FEEDBACK_PERIOD = 0.05  # s of simulated time, as that of a joint_trajectory_controller
CANCELED, REPLACED = 'canceled', 'another command took over its joints'
GONE = 'its robot is gone'


@dataclass
class Followed:
    """
    The trajectory of a goal, and what was found on the way.

    Attributes
    ----------
    motion : Motion
    path, goal : Tolerance
        On the way, and at its end.
    patience : float
        Time after the end up to which the joints may reach it [s]; 0: any.
    final : ndarray, shape (k,), optional
        What the joints were commanded at the end [rad], once it is reached.
    told_at : float
        Simulated time of the last feedback [s].

    """

    motion: Motion
    path: Tolerance
    goal: Tolerance
    patience: float
    final: Array | None = None
    told_at: float = -math.inf


class TrajectoryAction:
    """
    The goals of the action: one is followed at a time, and a new one takes its place.

    A goal is executed when its end is there: an executor that waits for the end of a coroutine
    takes all the time of a processor.

    Parameters
    ----------
    inbox : CommandInbox
        Its attribute `watch` is called with the simulated time [s] while there is a goal.
    kind : type
        The type of the action, with those of its results and feedback.

    """

    def __init__(self, inbox: CommandInbox, kind: Any) -> None:
        self._inbox, self._kind = inbox, kind
        self._server: Any = None
        self._goal: Any = None
        self._followed: Followed | None = None

    def serve(self, node: Node) -> None:
        """Serve the action by a node."""
        self._server = ActionServer(
            node,
            self._kind,
            '~/follow_joint_trajectory',
            execute_callback=lambda goal: None,  # Each goal gets one of its own.
            goal_callback=self.on_goal,
            handle_accepted_callback=self.on_accepted,
            cancel_callback=self.on_cancel,
        )

    def close(self) -> None:
        """Serve no more, which a node that was destroyed waits for."""
        if self._server:
            self._server.destroy()

    def on_goal(self, request: Any) -> GoalResponse:
        """Take the trajectory of a goal or reject it; the log says why."""
        try:
            followed = self._taken(request)
        except RejectedCommand:
            return GoalResponse.REJECT
        self._end(INVALID_GOAL, REPLACED)
        self._followed = followed
        return GoalResponse.ACCEPT

    def _taken(self, request: Any) -> Followed:
        names = list(request.trajectory.joint_names)
        try:
            path, goal = (
                tolerance_from(field, getattr(request, field), names)
                for field in ('path_tolerance', 'goal_tolerance')
            )
        except RejectedCommand as error:
            self._inbox.reject(error)
            raise
        motion = self._inbox.take_trajectory(request.trajectory)
        return Followed(motion, path, goal, seconds_from(request.goal_time_tolerance))

    def on_accepted(self, goal: Any) -> None:
        """Follow the goal whose trajectory was taken last."""
        self._goal, self._inbox.watch = goal, self._on_time

    def on_cancel(self, goal: Any) -> CancelResponse:
        """Hold the joints of a goal."""
        if self._goal is None or self._goal.goal_id != goal.goal_id or self._followed is None:
            return CancelResponse.REJECT
        self._inbox.stop(self._followed.motion)
        self._end(REACHED, CANCELED)
        return CancelResponse.ACCEPT

    def drop(self) -> None:
        """End the goal, since the robot that follows it is gone."""
        self._end(INVALID_GOAL, GONE)

    def _on_time(self, now: float) -> None:
        """Give feedback; end the goal where its trajectory, a tolerance or a command does."""
        if self._followed is None:
            return
        followed, motion = self._followed, self._followed.motion
        tracked = self._inbox.tracked(motion)
        if self._is_replaced(tracked):
            self._end(INVALID_GOAL, REPLACED)
            return
        if now >= followed.told_at + FEEDBACK_PERIOD:
            followed.told_at = now
            self._goal.publish_feedback(self._feedback(now, tracked))
        if now < motion.begin:
            return
        if now < motion.end:
            if violation := followed.path.violation(tracked):
                self._inbox.stop(motion)
                self._end(OFF_PATH, violation)
            return
        followed.final = tracked.commanded_angle
        violation = followed.goal.violation(tracked)
        if not violation:
            self._end(REACHED, '')
        elif 0.0 < followed.patience <= now - motion.end:
            self._end(GOAL_MISSED, violation)

    def _is_replaced(self, tracked: Tracked) -> bool:
        """Return whether the joints follow another command, after their trajectory, too."""
        followed = self._followed
        if followed is None or followed.final is None:
            return followed is not None and not self._inbox.follows(followed.motion)
        return not np.array_equal(tracked.commanded_angle, followed.final)

    def _feedback(self, now: float, tracked: Tracked) -> Any:
        """Return where the joints are commanded to be, where they are, and the difference."""
        feedback, followed = self._kind.Feedback(), self._followed
        feedback.header.stamp = stamp_from(round(1e9 * now))
        feedback.joint_names = list(followed.path.names) if followed else []
        commanded, there = tracked[:2], tracked[2:]
        off = [one - other for one, other in zip(commanded, there, strict=True)]
        for name, (angle, rate) in (('desired', commanded), ('actual', there), ('error', off)):
            point = JointTrajectoryPoint(positions=angle.tolist(), velocities=rate.tolist())
            setattr(feedback, name, point)
        return feedback

    def _end(self, code: int, error: str) -> None:
        """End the goal with a result."""
        goal, self._goal, self._followed, self._inbox.watch = self._goal, None, None, None

        def finish(goal: Any) -> Any:
            ends = {'': goal.succeed, CANCELED: goal.canceled}
            ends.get(error, goal.abort)()
            return self._kind.Result(error_code=code, error_string=error)

        if goal is not None:
            goal.execute(finish)


def serve_trajectories(node: Node, inbox: CommandInbox) -> TrajectoryAction:
    """Return the action of a node; it is served if its package is installed."""
    action = TrajectoryAction(inbox, FollowJointTrajectory)
    if FollowJointTrajectory is not None:
        action.serve(node)
    return action

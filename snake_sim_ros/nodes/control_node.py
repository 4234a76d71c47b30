# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The `control` node: moves a robot by a controller, the same object that `run` takes.

The controller is the one that the scene names; a path without a name has a `PathFollower`. It sees
what the robot says on `joint_states`, and on `link_poses`, `contact_forces` and `imu` if it asks
for them, and its reference is published on `joint_command`. The node knows nothing of the
simulator.

Control begins where the robot is, and blends into the references of the controller. It begins anew
when time goes back or the robot is put back. Without measurements, and after an error of the
controller, the joints hold their last commanded angles.
"""

from collections.abc import Callable
from dataclasses import dataclass
import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseArray, WrenchStamped
import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu

from snake_sim_ros.controllers.controller import going_on, Measured, Reference, sees
from snake_sim_ros.controllers.named import controller_of
from snake_sim_ros.nodes.executors import serve, ThrottledWarnings
from snake_sim_ros.nodes.gait_inputs import ClockWatch, Jumps, link_poses, MeasuredStart
from snake_sim_ros.nodes.messages import COMMAND_FORMS
from snake_sim_ros.nodes.node_parameters import ParameterRequests, settle
from snake_sim_ros.nodes.node_process import run_node
from snake_sim_ros.scene.checked_records import (
    CheckedRecord,
    cut,
    LONGEST_REASON,
    ParameterError,
    quantity,
)
from snake_sim_ros.scene.gait import soft_start
from snake_sim_ros.scene.parameters import Array

EARLY = 0.25  # of a period: a timer may be so much early, and a control call is due all the same


@dataclass(frozen=True, kw_only=True)
class Settings(CheckedRecord):
    """Parameters of the node besides those of the scene."""

    scene: str = quantity(
        'lateral_undulation', '', 'scene with controller, robot and gait: a YAML file or a name'
    )
    robot_description: str = quantity(
        '', '', 'robot in place of that of the scene: a URDF, or the name of its file',
        longest=10**6,
    )  # fmt: skip
    publish_rate: float = quantity(200.0, 'Hz', 'commands per second', minimum=1, maximum=1000)
    command_type: str = quantity(
        'joint_state', '', 'message type of the commands', choices=tuple(COMMAND_FORMS)
    )
    blend_time: float = quantity(
        1.0, 's', 'time in which the measured angles blend into the references of the controller',
        minimum=0, maximum=60,
    )  # fmt: skip
    state_timeout: float = quantity(
        0.5, 's', 'the joints hold if no joint_states or link_poses arrive for this long', above=0,
        maximum=3600,
    )  # fmt: skip


class ControlNode(Node):
    """Publishes the commands of a controller, which begins when the first robot subscribes."""

    def __init__(self) -> None:
        super().__init__(
            'control',
            automatically_declare_parameters_from_overrides=True,
            start_parameter_services=False,
        )
        ParameterRequests(self)
        of_scene = 'controller.', 'follow.', 'gait.', 'robot.'
        self.settings, self.scene = settle(self, Settings, of_scene)
        controller = controller_of(self.scene)
        if not controller:
            raise ParameterError(
                f'scene {cut(self.settings.scene)} has no controller: give one by '
                f'controller.name, or a path; a gait alone is what the node gait commands'
            )
        controller.start(self.scene)
        self.controller, self.robot = controller, self.scene.robot
        self.warn = ThrottledWarnings(self)
        self.begin: int | None = None  # time of the clock [ns]
        self.why = ''  # why control begins anew
        self.posture = np.zeros((self.robot.link_count - 1, 2))
        self.reference: Reference | None = None
        self.due = self.until = 0.0  # of the next call, and end of the references [s]
        self.poses: tuple[Array, Array] | None = None
        self.heard = 0  # time of the last poses [ns]
        self.contacts = self.imus = None
        if sees(controller, 'contacts'):
            self.contacts = LinkSensors(self, 'contact_forces', WrenchStamped, wrench_of)
        if sees(controller, 'imus'):
            self.imus = LinkSensors(self, 'imu', Imu, reading_of)
        self.calls, self.state = 0, 'waiting for a robot'
        self.form = COMMAND_FORMS[self.settings.command_type]
        self.commands = self.create_publisher(self.form.kind, self.form.topic, QoSProfile(depth=1))
        self.diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self.jumps = Jumps(self.warn)
        self.watch = ClockWatch(self, self.jumps, self.warn)
        self.joints = MeasuredStart(self, self.robot, self.watch, self.jumps, used=True)
        if sees(controller, 'poses'):
            sensor = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
            self.create_subscription(PoseArray, 'link_poses', self._on_poses, sensor)
        self.period = min(controller.period, 1.0 / self.settings.publish_rate)
        self.create_timer(self.period, self.publish)
        self.create_timer(1.0, self.report)
        name = self.scene.controller.name or 'the path of the scene'
        self.get_logger().info(
            f'controller {name}, every {controller.period:g} s; waiting for a robot that '
            f'subscribes to {self.form.topic}'
        )

    def publish(self) -> None:
        """Publish the present command, once there are a clock, a robot and what it measures."""
        now = self.get_clock().now()
        if now.nanoseconds == 0 or not self._goes_on(now.nanoseconds):
            return
        if self.begin is None:
            self._begin(now.nanoseconds)
        assert self.begin is not None
        seconds = 1e-9 * (now.nanoseconds - self.begin)
        if seconds >= self.due - EARLY * self.period:
            self._control(now.nanoseconds, seconds)
        angle, rate = map(self.robot.by_axis, self._commanded(seconds))
        period = round(1e9 * self.period)
        names = list(self.robot.axis_names)
        self.commands.publish(self.form.message(names, now.to_msg(), angle, rate, period))

    def _goes_on(self, now: int) -> bool:
        """Return whether to command the robot now [ns]; if control begins anew, begin is None."""
        back, put_back = self.watch.went_back(now), self.joints.was_put_back()
        if back:
            self.joints.forget(now)
            self.poses = None
            for sensors in filter(None, (self.contacts, self.imus)):
                sensors.forget()
        if back or put_back:
            self.begin, self.why = None, f', since {back or "the robot was put back"}'
        if self.jumps.many:
            return False
        if self.begin is not None:
            return True
        if self.commands.get_subscription_count() == 0:
            self.state = 'waiting for a robot'
        elif missing := self._missing(now):
            self.state = f'waiting for {missing}'
        else:
            return True
        return False

    def _missing(self, now: int) -> str:
        """Return the topic on which nothing has come for a while, if any."""
        last, longest = self.joints.last, round(1e9 * self.settings.state_timeout)
        if last is None or (last.stamp and now - last.stamp > longest):
            return 'joint_states'
        if sees(self.controller, 'poses') and (self.poses is None or now - self.heard > longest):
            return 'link_poses'
        silent = (each.silent(now - longest) for each in (self.contacts, self.imus) if each)
        return next(filter(None, silent), '')

    def _begin(self, now: int) -> None:
        """Begin anew at the measured angles."""
        self.begin, self.due, last = now, 0.0, self.joints.last
        assert last
        self.posture = self.robot.by_joint(last.angle, 0.0)
        self.controller.start(self.scene)
        self.reference, self.calls = None, 0
        self.get_logger().info(f'control begins at t = {1e-9 * now:.9f} s{self.why}')
        self.why = ''

    def _control(self, now: int, seconds: float) -> None:
        """Ask the controller for the references of its next period."""
        period = self.controller.period
        self.due += period * max(1, round((seconds - self.due) / period))
        if missing := self._missing(now):
            self._hold(seconds, f'no {missing} for {self.settings.state_timeout:g} s')
            return
        last = self.joints.last
        assert last
        place, orientation = self.poses or (None, None)
        measured = Measured(
            last.angle,
            last.rate,
            last.torque,
            place,
            orientation,
            contact_wrench=self.contacts.values.copy() if self.contacts else None,
            imu=self.imus.values.copy() if self.imus else None,
        )
        shape = (1, self.robot.link_count - 1, 2)
        try:
            reference = self.controller.control(measured, seconds)
            found = reference(np.array([seconds]))
            if any(np.shape(each) != shape or not np.isfinite(each).all() for each in found):
                raise ValueError(f'angles and rates must be finite and of shape (m, *{shape[1:]})')
        except Exception as error:  # the code of the user raises whatever it likes
            text = cut(f'{type(error).__name__}: {error}', LONGEST_REASON)
            self._hold(seconds, f'the controller failed ({text})')
            return
        self.reference, self.until, self.state = reference, seconds + period, 'in control'
        self.calls += 1

    def _hold(self, seconds: float, why: str) -> None:
        """Hold the last commanded angles."""
        self.warn(why.partition(' ')[0], f'{why}: the joints hold')
        self.state = f'holding, {why}'
        angle = self.posture if self.reference is None else self._wanted(seconds)[0]
        self.reference, self.until = going_on(seconds, angle, np.zeros_like(angle)), np.inf

    def _wanted(self, seconds: float) -> tuple[Array, Array]:
        """Return angles and rates of the controller, (n-1, 2); it has none beyond its period."""
        assert self.reference
        angle, rate = self.reference(np.array([min(seconds, self.until)]))
        return angle[0], rate[0]

    def _commanded(self, seconds: float) -> tuple[Array, Array]:
        """Return angles and rates, (n-1, 2), blended from the posture at the begin."""
        angle, rate = self._wanted(seconds + self.form.ahead * self.period)
        s, s_dot = soft_start(np.array(seconds), self.settings.blend_time)
        off = angle - self.posture
        return self.posture + s * off, s * rate + s_dot * off

    def report(self) -> None:
        """Publish what the node does on /diagnostics."""
        name = f'{self.get_fully_qualified_name().lstrip("/")}: control'
        level = DiagnosticStatus.WARN if self.state.startswith('holding') else DiagnosticStatus.OK
        pairs = [KeyValue(key='calls', value=str(self.calls))]
        status = DiagnosticStatus(level=level, name=name, message=self.state, values=pairs)
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self.diagnostics.publish(message)

    def _on_poses(self, message: PoseArray) -> None:
        try:
            self.poses = link_poses(message, self.robot)
        except ParameterError as error:
            self.warn('poses', f'link_poses: {error}')
            return
        self.heard = self.get_clock().now().nanoseconds


class LinkSensors:
    """
    What a sensor in each link says.

    Attributes
    ----------
    values : ndarray, shape (n, k)
        The last reading of each.

    """

    def __init__(
        self, node: ControlNode, topic: str, kind: Any, read: Callable[[Any], list[float]]
    ) -> None:
        names, sensor = node.robot.link_names, QoSProfile(depth=1)
        sensor.reliability = ReliabilityPolicy.BEST_EFFORT
        self._node, self._read = node, read
        self._topics = [f'{topic}/{name}' for name in names]
        self.forget()
        self.values = np.zeros((len(names), len(read(kind()))))
        for link, name in enumerate(self._topics):
            node.create_subscription(kind, name, self._listener(link), sensor)

    def forget(self) -> None:
        """Take what was said before as never said, since time goes back."""
        self._heard = [-np.inf] * len(self._topics)  # when each was heard last [ns]

    def silent(self, since: int) -> str:
        """Return a topic on which nothing has come since a time [ns], if any."""
        quiet = (t for t, heard in zip(self._topics, self._heard, strict=True) if heard <= since)
        return next(quiet, '')

    def _listener(self, link: int) -> Callable[[Any], None]:
        def listen(message: Any) -> None:
            values = self._read(message)
            if not np.isfinite(values).all():
                self._node.warn(
                    self._topics[link], f'{self._topics[link]}: must be finite, got {values}'
                )
                return
            self.values[link] = values
            self._heard[link] = self._node.get_clock().now().nanoseconds

        return listen


def wrench_of(message: WrenchStamped) -> list[float]:
    """Return force [N] and torque [N m]."""
    force, torque = message.wrench.force, message.wrench.torque
    return [force.x, force.y, force.z, torque.x, torque.y, torque.z]


def reading_of(message: Imu) -> list[float]:
    """Return orientation x y z w, angular velocity [rad/s] and specific force [m/s^2]."""
    p, rate, force = message.orientation, message.angular_velocity, message.linear_acceleration
    return [p.x, p.y, p.z, p.w, rate.x, rate.y, rate.z, force.x, force.y, force.z]


def main(args: list[str] | None = None) -> int:
    """Run the node until a signal ends it."""
    return run_node(ControlNode, serve, args)


if __name__ == '__main__':
    sys.exit(main())

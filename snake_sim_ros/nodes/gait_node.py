# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The `gait` node: generates joint references and publishes them as commands.

The node knows joint names, limits of the joints and a clock, but nothing of the simulator. Any
robot that takes `joint_command`, or one of the other forms of `sent_commands`, can follow it.

Every number of the gait may change while the node runs, and `cmd_vel` steers it, without a jump in
the commands. A change of the soft start takes effect when the gait begins again. From the first
cmd_vel until ~/restart, `steering` determines the frequency and the yaw offset; of a cmd_vel only
linear.x and angular.z count. The table of a gait is no parameter: it comes with the scene.

The gait begins where the robot is: it blends from the joint angles that joint_states report. It
does so too after ~/restart, when time went back, and when the robot was put back.
"""

from dataclasses import dataclass, replace
import sys

from geometry_msgs.msg import Twist, TwistStamped
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from std_srvs.srv import Trigger

from snake_sim_ros.gaits.blending import (
    Blend,
    check_limits,
    largest_values,
    shortest_blend,
    usual_blend,
)
from snake_sim_ros.gaits.steering import Steering, Stride
from snake_sim_ros.nodes.executors import serve, ThrottledWarnings
from snake_sim_ros.nodes.gait_inputs import (
    ClockWatch,
    Jumps,
    MeasuredStart,
    steering_from,
    time_of,
)
from snake_sim_ros.nodes.messages import COMMAND_FORMS
from snake_sim_ros.nodes.node_parameters import (
    declare,
    parameter_fields,
    ParameterRequests,
    settle,
)
from snake_sim_ros.nodes.node_process import run_node
from snake_sim_ros.scene.checked_records import (
    CheckedRecord,
    flat_fields,
    ParameterError,
    quantity,
)
from snake_sim_ros.scene.gait import AXES
from snake_sim_ros.scene.parameters import Array, load_scene, Scene, with_settings

# The node takes the gait of a scene, and these parameters of its robot.
ROBOT = ('link_count', 'link_length', 'joint_limit', 'joint_rate_limit')
OF_SCENE = ('gait.', *(f'robot.{name}' for name in ROBOT))
GAIT = tuple(parameter_fields(Scene().gait, 'gait.'))
CHANGEABLE = ('scene', 'stride', 'cmd_vel_timeout')


@dataclass(frozen=True, kw_only=True)
class Settings(CheckedRecord):
    """Parameters of the node besides those of the gait."""

    scene: str = quantity(
        'lateral_undulation',
        '',
        'scene that the gait, and at the start the robot, is taken from: a YAML file or a name',
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
        0.0,
        's',
        'duration of a blend to a changed gait; 0 = 1 s, or what the limits of the joints need',
        minimum=0,
        maximum=60,
    )
    start_from: str = quantity(
        'measured',
        '',
        'where the gait starts: at the measured angles of joint_states, blended over '
        'blend_time, or in its own posture at once',
        choices=('measured', 'now'),
    )
    stride: float = quantity(
        0.0,
        'm',
        'distance the robot travels in a gait cycle, used to follow cmd_vel; 0 = that of Aiko, '
        '0.546 m in lateral undulation, 0.473 m to the side in sidewinding',
        minimum=0,
        maximum=100,
    )
    cmd_vel_timeout: float = quantity(
        0.0, 's', 'stop if no cmd_vel arrives for this long; 0 = never', minimum=0, maximum=3600
    )
    use_stamped_vel: bool = quantity(False, '', 'expect TwistStamped instead of Twist on cmd_vel')


class GaitNode(Node):
    """Publishes the commands of a gait, which begins when the first robot subscribes."""

    def __init__(self) -> None:
        super().__init__(
            'gait',
            automatically_declare_parameters_from_overrides=True,
            start_parameter_services=False,
        )
        ParameterRequests(self)
        self.settings, scene = settle(self, Settings, OF_SCENE, (*CHANGEABLE, *GAIT))
        self.gait, self.robot, self.friction = scene.gait, scene.robot, scene.friction
        self._check_start()
        self._describe_ranges()
        self.add_pre_set_parameters_callback(self._with_gait_of_scene)
        self.add_on_set_parameters_callback(self._on_set_parameters)
        self.add_post_set_parameters_callback(self._on_parameters_set)

        self.names = list(self.robot.axis_names)
        self.period = 1.0 / self.settings.publish_rate
        self.begin: int | None = None  # time of the clock [ns]
        self.why = ''  # why the gait starts over
        self.target = self.gait
        self.blend = self._beginning()
        self.steering: Steering | None = None
        self.heard = 0
        self.warn = ThrottledWarnings(self)
        self.form = COMMAND_FORMS[self.settings.command_type]
        self.commands = self.create_publisher(self.form.kind, self.form.topic, QoSProfile(depth=1))
        if self.settings.use_stamped_vel:
            kind, take = TwistStamped, self._on_twist_stamped
        else:
            kind, take = Twist, self._on_twist
        self.create_subscription(kind, 'cmd_vel', take, QoSProfile(depth=1))
        self.jumps = Jumps(self.warn)
        self.watch = ClockWatch(self, self.jumps, self.warn)
        measured = self.settings.start_from == 'measured'
        self.start = MeasuredStart(self, self.robot, self.watch, self.jumps, used=measured)
        self.create_service(Trigger, '~/restart', self._on_restart)
        self.create_timer(self.period, self.publish)
        self.get_logger().info(f'waiting for a robot that subscribes to {self.form.topic}')

    def publish(self) -> None:
        """Publish the present command, once there is a clock and a robot that subscribed."""
        now = self.get_clock().now()
        if now.nanoseconds == 0 or not self._goes_on(now.nanoseconds):
            return
        if self.begin is None:
            self._begin(now.nanoseconds)
        assert self.begin is not None
        self._stop_unsteered(now.nanoseconds)
        seconds = 1e-9 * (now.nanoseconds - self.begin)
        if self.target != self.blend.gait:
            self.blend = self.blend.changed(seconds, self.target)
        reference = self.blend.reference(seconds + self.form.ahead * self.period)
        angle, rate = map(self.robot.by_axis, reference)
        period = round(1e9 * self.period)
        self.commands.publish(self.form.message(self.names, now.to_msg(), angle, rate, period))

    def _goes_on(self, now: int) -> bool:
        """Return whether to command the robot now [ns]; if the gait starts over, begin is None."""
        back, put_back = self.watch.went_back(now), self.start.was_put_back()
        if back:
            self.start.forget(now)
        if back or put_back:
            self.begin, self.why = None, f', since {back or "the robot was put back"}'
        if self.jumps.many:
            return False
        if self.begin is not None:
            return True
        return self.commands.get_subscription_count() > 0 and self.start.settled(now)

    def _begin(self, now: int) -> None:
        self.begin = now
        self.heard = min(self.heard, now)
        self.blend = self._beginning()
        start, _ = self.blend.reference(0.0)
        posture = self.start.posture(now, start)
        if posture is not None:
            self.blend = self._beginning(posture)
        where = '' if posture is None else ', from the measured angles'
        self.get_logger().info(f'the gait begins at t = {1e-9 * now:.9f} s{where}{self.why}')
        self.why = ''

    def _beginning(self, posture: Array | None = None) -> Blend:
        joint_count = self.robot.link_count - 1
        duration = self.settings.blend_time or usual_blend(self.robot)
        return Blend.of(self.target, joint_count, duration, posture)

    def _stop_unsteered(self, now: int) -> None:
        timeout = self.settings.cmd_vel_timeout
        silence, stopped = 1e-9 * (now - self.heard), Steering(0.0, 0.0)
        if self.steering in (None, stopped) or not 0.0 < timeout < silence:
            return
        self.warn('silent', f'no cmd_vel for {timeout:g} s: the gait stops')
        self.steering = stopped
        self._aim()

    def _aim(self) -> None:
        """Set the gait that follows from the parameters and the last cmd_vel as the target."""
        self.target = self.gait
        if self.steering:
            stride = Stride.of(self.gait, self.friction)
            stride = replace(stride, length=self.settings.stride or stride.length)
            self.target, remarks = self.steering.gait(self.gait, self.robot, stride)
            for kind, sentence in remarks.items():
                self.warn(kind, sentence)

    def _on_twist(self, message: Twist) -> None:
        self._steer(message, self.get_clock().now().nanoseconds)

    def _on_twist_stamped(self, message: TwistStamped) -> None:
        now = self.get_clock().now().nanoseconds
        time = time_of(message, now, self.settings.cmd_vel_timeout, self.warn)
        if time is not None:
            self._steer(message.twist, time)

    def _steer(self, message: Twist, time: int) -> None:
        """Follow a cmd_vel of some time [ns]."""
        steering = steering_from(message, self.warn)
        if steering is None:
            return
        self.heard = time
        if steering != self.steering:
            self.steering = steering
            self._aim()

    def _on_restart(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.begin = self.steering = None
        self._aim()
        response.success = True
        response.message = 'the gait begins again'
        return response

    # ---- parameters -----------------------------------------------------------------------------

    def _check_start(self) -> None:
        check_limits(self.gait, self.robot)
        shortest = shortest_blend(self.robot)
        if 0.0 < self.settings.blend_time < shortest:
            raise ParameterError(
                f'blend_time must be at least {shortest:.4g} s, which the joint limit and the '
                f'joint rate limit allow, got {self.settings.blend_time:g} s'
            )

    def _describe_ranges(self) -> None:
        """Declare the numbers of the waves again, with the ranges that this robot allows."""
        ranges = {axis: largest_values(self.robot, axis) for axis in AXES}
        for name, (value, limits) in flat_fields(self.gait, 'gait.').items():
            _, axis, key = f'{name}.'.split('.')[:3]
            largest = ranges[axis].get(key) if axis in AXES else None
            if largest is not None:
                symmetric = {**limits, 'minimum': -largest, 'maximum': largest}
                declare(self, name, value, symmetric, read_only=False)

    def _with_gait_of_scene(self, parameters: list[Parameter]) -> list[Parameter]:
        """Add the gait of a new scene to the parameters that are set together with the scene."""
        given = {item.name: item.value for item in parameters}
        if not isinstance(given.get('scene'), str):
            return parameters
        try:
            fields = parameter_fields(load_scene(given['scene']).gait, 'gait.')
        except ParameterError:
            return parameters  # `_on_set_parameters` reports the error.
        own = [Parameter(name, value=value) for name, (value, _) in fields.items()]
        return [*parameters, *(item for item in own if item.name not in given)]

    def _changed(self, parameters: list[Parameter]) -> tuple[Settings, Scene]:
        """Return settings, and a scene with the gait, with the values of some parameters."""
        values = {item.name: item.value for item in parameters}
        own = {name: value for name, value in values.items() if name in CHANGEABLE}
        waves = {name: value for name, value in values.items() if name in GAIT}
        settings = replace(self.settings, **own)
        scene = Scene(robot=self.robot, gait=self.gait)
        if 'scene' in own:
            scene = replace(scene, gait=load_scene(settings.scene).gait)
        return settings, with_settings(scene, waves)

    def _on_set_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            _, scene = self._changed(parameters)
            check_limits(scene.gait, self.robot)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _on_parameters_set(self, parameters: list[Parameter]) -> None:
        self.settings, scene = self._changed(parameters)
        self.gait = scene.gait
        self._aim()


def main(args: list[str] | None = None) -> int:
    """Run the node until a signal ends it."""
    return run_node(GaitNode, serve, args)


if __name__ == '__main__':
    sys.exit(main())

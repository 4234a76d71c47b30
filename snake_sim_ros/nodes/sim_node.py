"""The `sim` node: a virtual Aiko that takes joint commands and publishes its state."""

from array import array
from collections.abc import Callable
from dataclasses import dataclass
from dataclasses import replace
import sys
from threading import Event
import time
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from nav_msgs.msg import Odometry
import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from snake_sim_ros.gaits.joint_reference import compile_sampling
from snake_sim_ros.gaits.joint_reference import JointReference
from snake_sim_ros.gaits.joint_reference import start_posture
from snake_sim_ros.nodes.commands import Command
from snake_sim_ros.nodes.commands import extrapolated
from snake_sim_ros.nodes.commands import joint_command
from snake_sim_ros.nodes.commands import joint_trajectory
from snake_sim_ros.nodes.commands import position_commands
from snake_sim_ros.nodes.commands import RejectedCommand
from snake_sim_ros.nodes.diagnostics import status_of
from snake_sim_ros.nodes.diagnostics import values_of
from snake_sim_ros.nodes.markers import MARKER_PERIOD
from snake_sim_ros.nodes.markers import SceneMarkers
from snake_sim_ros.nodes.messages import stamp_from
from snake_sim_ros.nodes.messages import StateMessages
from snake_sim_ros.nodes.node_parameters import settle
from snake_sim_ros.nodes.other_publishers import Rivals
from snake_sim_ros.nodes.running import make_executor
from snake_sim_ros.nodes.running import run_node
from snake_sim_ros.nodes.running import serve_some
from snake_sim_ros.nodes.running import Warnings
from snake_sim_ros.nodes.simulation_services import serve
from snake_sim_ros.nodes.transforms import LATCHED
from snake_sim_ros.nodes.transforms import TransformMessages
from snake_sim_ros.nodes.transforms import Transforms
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.parameters import with_settings
from snake_sim_ros.scene.quantities import flat_fields
from snake_sim_ros.scene.quantities import ParameterError
from snake_sim_ros.scene.quantities import quantity
from snake_sim_ros.scene.quantities import Record
from snake_sim_ros.scene.robot_description import robot_description
from snake_sim_ros.stepping.contact_forces import contact_forces
from snake_sim_ros.stepping.levels import is_vertical
from snake_sim_ros.stepping.levels import what_is_told
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.stepping.simulation import steps_in

BACKLOG = 0.2  # s of wall time that the node may be behind before it gives up catching up
WAIT = 0.1  # s, the longest wait for a message before the node looks up
SERVICE = 5e-3  # s of wall time between two looks at the messages, as fast as possible
LATEST = QoSProfile(depth=1)  # of commands and the clock: nothing waits in a queue
CHANGEABLE = (
    *('real_time_factor', 'command_horizon', 'command_timeout'),
    *('friction.longitudinal', 'friction.transversal', 'friction.rolling', 'pegs.friction'),
    *('robot.yaw_stiffness', 'robot.yaw_damping', 'robot.pitch_stiffness', 'robot.pitch_damping'),
    *('self_contact_friction', 'gravity'),
)


@dataclass(frozen=True, kw_only=True)
class Settings(Record):
    """Parameters of the node besides those of the scene."""

    scene: str = quantity(
        'lateral_undulation', '', 'scene: a YAML file or the name of one in config/'
    )
    publish_rate: float = quantity(
        200.0, 'Hz', 'state messages a second of simulated time', minimum=10, maximum=1000
    )
    real_time_factor: float = quantity(
        1.0, '1', 'simulated time per wall time; 0 is as fast as possible', minimum=0, maximum=1000
    )
    command_horizon: float = quantity(
        0.05, 's', 'how long a command is extrapolated with its velocity', minimum=0, maximum=1
    )
    command_timeout: float = quantity(
        0.5, 's', 'when a stream of commands that stops is reported; 0 is never', minimum=0
    )
    publish_clock: bool = quantity(True, '', 'publish /clock; one node of a graph may')
    publish_robot_description: bool = quantity(True, '', 'publish robot_description')
    publish_tf: bool = quantity(True, '', 'publish /tf and /tf_static where tf2_msgs is installed')
    frame_prefix: str = quantity(
        'auto', '', 'what the frames odom and base_link begin with; auto: namespace and a slash'
    )
    start_paused: bool = quantity(False, '', 'wait for ~/pause or ~/step')


class SimNode(Node):
    """Physics under its own clock, between command and state topics."""

    def __init__(self) -> None:
        super().__init__('sim', automatically_declare_parameters_from_overrides=True)
        self.settings, scene = settle(self, Settings, changeable=CHANGEABLE)
        self.add_on_set_parameters_callback(self._on_set_parameters)
        self.add_post_set_parameters_callback(self._on_parameters_set)
        if self.get_parameter('use_sim_time').value:
            self.get_logger().warning('use_sim_time is ignored: this node makes simulated time')

        self.period = 1.0 / self.settings.publish_rate
        self.steps = steps_in(self.period, scene.dt, 'publish period')
        self.simulation = Simulation(scene)
        self.get_logger().info('compiling the physics (half a minute at the first start ever) ...')
        compile_sampling(scene)
        self.get_logger().info(f'physics ready after {self.simulation.compile():.1f} s')
        self.reference = start_posture(scene)
        self.paused = self.settings.start_paused
        self.stop = Event()
        self.rejected = self.clamped = self.overruns = 0
        self.refused = ''  # the last sentence about a command since the last diagnostics
        self.reached_factor = self.processor = 0.0
        self.heard: float | None = None  # simulated time of the last command [s]
        self.stream = ''  # topic on which commands follow each other
        self.silent = ''  # topic of a stream that stopped
        self._limited: JointReference | None = None  # the last one said to be beyond the limit
        self.warn = Warnings(self)
        self._rivals = Rivals(self)
        self._spoken: set[str] = set()  # command topics since the last diagnostics
        overrides = self.get_parameters_by_prefix('qos_overrides')
        try:
            self._make_publishers(scene)
            self._make_subscriptions()
        except (AssertionError, RuntimeError) as error:
            if not overrides:
                raise
            reason = str(error).partition(', at ')[0] or 'a value is of the wrong type'
            raise ParameterError(f'qos_overrides of {", ".join(overrides)}: {reason}') from None
        serve(self)

    def _make_publishers(self, scene: Scene) -> None:
        prefix = self.settings.frame_prefix
        if prefix == 'auto':
            prefix = f'{self.get_namespace()}/'.lstrip('/')
        self.messages = StateMessages(scene.robot, prefix)
        self.joint_states = self.create_publisher(
            JointState,
            'joint_states',
            10,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )
        self.link_poses = self.create_publisher(PoseArray, 'link_poses', 10)
        self.odom = self.create_publisher(Odometry, 'odom', 10)
        self.markers = self.create_publisher(MarkerArray, 'markers', 10)
        self.scene_markers, self._marked = SceneMarkers(scene), 0.0
        self.diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        clock = self.settings.publish_clock
        self.clock = self.create_publisher(Clock, '/clock', LATEST) if clock else None
        if self.settings.publish_robot_description:
            self.description = self.create_publisher(String, 'robot_description', LATCHED)
            self.description.publish(String(data=robot_description(scene.robot)))
        self.transforms = None
        if self.settings.publish_tf and TransformMessages.available:
            self.transforms = Transforms(self, prefix)
        elif self.settings.publish_tf:
            self.get_logger().info('no /tf: the package tf2_msgs is not installed')

    def _make_subscriptions(self) -> None:
        self.create_subscription(
            JointState,
            'joint_command',
            lambda message: self._take('joint_command', joint_command, message),
            LATEST,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )
        self.create_subscription(
            Float64MultiArray,
            'position_commands',
            lambda message: self._take('position_commands', position_commands, message),
            LATEST,
        )
        self.create_subscription(
            JointTrajectory,
            'joint_trajectory',
            lambda message: self._take(
                'joint_trajectory', joint_trajectory, message, self.settings.command_horizon
            ),
            LATEST,
        )

    @property
    def failure(self) -> str:
        """Why the simulation diverged; empty while it has not."""
        return self.simulation.report.failure

    @property
    def halted(self) -> bool:
        """Whether simulated time stands still."""
        return self.paused or bool(self.failure)

    @property
    def seconds(self) -> float:
        """Simulated time [s]."""
        return self.simulation.time

    @property
    def nanoseconds(self) -> int:
        """Simulated time [ns]."""
        return round(self.simulation.step_count * self.simulation.scene.dt * 1e9)

    def advance(self) -> None:
        """Advance by one publish period and publish the state, then the clock."""
        simulation, limit = self.simulation, self.simulation.scene.robot.joint_limit
        level = simulation.last.level
        self.reference = self.reference.settled(simulation.time)
        self._watch_commands()
        times, horizon = simulation.midpoints(self.steps), self.settings.command_horizon
        report = simulation.advance(*self.reference.sample(times, horizon, limit))
        self._watch_limit(times[-1])
        if report.level != level:
            why = f': {report.left}' if report.left else ': the robot lies flat'
            self.get_logger().info(f'level {report.level} from t = {simulation.time:g} s on{why}')
        if report.failure:
            self.get_logger().error(
                f'diverged, paused at the last good state; call ~/reset: {report.failure}'
            )
        self.publish_state()

    def step(self, count: int = 1) -> None:
        """Advance by some publish periods, fewer if a step diverges or the node is to end."""
        for _ in range(count):
            if self.failure or self.stop.is_set():
                break
            self.advance()

    def reset(self, *, state: bool = True, time: bool = False) -> None:
        """Put the robot back to the start of the scene, or time, or both; commands are void."""
        simulation = self.simulation
        angle, _ = self.reference.sample(
            np.array([simulation.time]), 0.0, simulation.scene.robot.joint_limit
        )
        # After a divergence the clock is between two publish periods.
        simulation.step_count += -simulation.step_count % self.steps
        if time:
            simulation.step_count = 0
        if state:
            simulation.reset()
            self.reference = start_posture(simulation.scene, simulation.time)
        else:
            stamp = np.full(angle[0].shape, simulation.time)
            self.reference = JointReference(stamp, angle[0], np.zeros_like(angle[0]))
        self.heard, self.stream, self.silent = None, '', ''
        self.publish_state()

    def publish_state(self) -> None:
        """Publish the state, then the clock."""
        messages, simulation = self.messages, self.simulation
        messages.fill(self.nanoseconds, simulation.state, simulation.last.joint_torque)
        self.joint_states.publish(bytes(messages.joint_states))
        self.link_poses.publish(bytes(messages.link_poses))
        self.odom.publish(bytes(messages.odom))
        if self.transforms:
            self.transforms.publish(stamp_from(self.nanoseconds), messages.base.tolist())
        if self.markers.get_subscription_count():
            self._publish_markers(stamp_from(self.nanoseconds))
        if self.clock:
            self.clock.publish(bytes(messages.clock))

    def _publish_markers(self, stamp: Time) -> None:
        """Publish contacts and obstacles, for whoever looks."""
        now, simulation = time.monotonic(), self.simulation
        if now - self._marked >= MARKER_PERIOD:
            self._marked = now
            touched = contact_forces(simulation.scene, simulation.state, simulation.history)
            self.scene_markers.fill(stamp, *touched)
            self.markers.publish(self.scene_markers.message)

    def publish_diagnostics(self) -> None:
        """Publish how the simulation is doing."""
        factor, warnings = self.settings.real_time_factor, []
        # What is reached is a whole number of periods.
        if not self.halted and self.reached_factor + self.period < 0.95 * factor:
            warnings.append(f'real-time factor {self.reached_factor:.2f} of {factor:g}')
        if self.refused:
            warnings.append(self.refused)
        if self.silent:
            warnings.append(f'no {self.silent} any more; the last one is held')
        values = {
            'real_time_factor': f'{self.reached_factor:.4g}',
            'processor': f'{self.processor:.3f}',
            'overruns': self.overruns,
            'rejected_commands': self.rejected,
            'clamped_commands': self.clamped,
            **values_of(self.simulation),
        }
        state = 'paused' if self.paused else 'running'
        name = self.get_fully_qualified_name().lstrip('/')
        status = status_of(name, self.failure, '; '.join(warnings), state, values)
        message = DiagnosticArray(status=[status])
        message.header.stamp = stamp_from(self.nanoseconds)
        self.diagnostics.publish(message)
        if self.halted and self.markers.get_subscription_count():
            self._publish_markers(message.header.stamp)
        self._rivals.look(self._spoken, clock=self.clock is not None)
        self._spoken.clear()
        self.refused = ''

    def _take(self, topic: str, take: Callable[..., Command], message: Any, *more: float) -> None:
        """Take a command, or say why not."""
        scene, now = self.simulation.scene, self.simulation.time
        self._spoken.add(topic)
        if self.clock is None and hasattr(message, 'header'):
            message.header.stamp = Time()  # of a clock that another node makes: it means now
        try:
            command = take(message, self.reference, scene.robot, now, *more)
            if scene.level == 'planar':
                _refuse_vertical(topic, command.reference)
        except RejectedCommand as error:
            self.rejected += 1
            self.refused = f'{error}; the last good command is held'
            self.warn(error.kind, self.refused)
            return
        self.reference = command.reference
        if command.clamped:
            self.clamped += 1
            self.warn('clamped', command.clamped)
        if command.jump:
            self.warn('jump', command.jump)
        follows = self.heard is not None and now - self.heard <= self.settings.command_timeout
        self.stream = topic if follows else ''
        self.heard, self.silent = now, ''

    def _watch_commands(self) -> None:
        """Say so when a stream of commands stops; what it told last is held anyway."""
        timeout = self.settings.command_timeout
        if not self.stream or not timeout or self.reference.motions:
            return
        if self.heard is not None and self.seconds - self.heard > timeout:
            self.warn('silent', f'no {self.stream} for {timeout:g} s; the last one is held')
            self.stream, self.silent = '', self.stream

    def _watch_limit(self, now: float) -> None:
        """Say so when a command goes beyond the joint limit with its velocity."""
        reference = self.reference
        if reference is self._limited or reference.motions:
            return
        clamped = extrapolated(
            reference, self.simulation.scene.robot, now, self.settings.command_horizon
        )
        if clamped:
            self._limited = reference
            self.clamped += 1
            self.warn('clamped', clamped)

    def _changed(self, parameters: list[Parameter]) -> tuple[Settings, Scene]:
        """Return settings and scene with some parameters of other values."""
        given = {
            item.name: item.value.tolist() if isinstance(item.value, array) else item.value
            for item in parameters
            if item.name in CHANGEABLE
        }
        own: dict[str, Any] = {n: given.pop(n) for n in flat_fields(self.settings) if n in given}
        return replace(self.settings, **own), with_settings(self.simulation.scene, given)

    def _on_set_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            _, scene = self._changed(parameters)
            make_stepper(scene)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _on_parameters_set(self, parameters: list[Parameter]) -> None:
        self.settings, scene = self._changed(parameters)
        if scene != self.simulation.scene:
            self.simulation.change(scene)


def _refuse_vertical(topic: str, reference: JointReference) -> None:
    """Raise if a reference moves pitch joints, for the planar level."""
    told = ''
    if any(motion.coefficients[..., motion.axes % 2 == 1].any() for motion in reference.motions):
        told = 'a pitch joint is told to move'
    if is_vertical(reference.angle, reference.rate):
        told = what_is_told(reference.angle, reference.rate)
    if told:
        raise RejectedCommand('pitch', f'{topic}: {told}, but level is planar')


def run(node: SimNode, stop: Event) -> None:
    """Advance physics against the wall clock; serve messages in the slack."""
    executor = make_executor(node)
    node.stop = stop
    node.publish_state()
    due = mark = served = time.perf_counter()
    busy, factor = time.process_time(), node.settings.real_time_factor
    advanced = halted = 0.0  # simulated and idle time since the mark
    while not stop.is_set():
        now = time.perf_counter()
        if now - mark >= 1.0:
            if now - mark - halted > WAIT:
                node.reached_factor = advanced / (now - mark - halted)
            used = time.process_time()
            node.processor, busy = (used - busy) / (now - mark), used
            mark, advanced, halted = now, 0.0, 0.0
            node.publish_diagnostics()
        if node.halted:
            executor.spin_once(timeout_sec=WAIT)
            due = time.perf_counter()
            halted += due - now
            continue
        if factor != node.settings.real_time_factor:  # what is left to wait is of another pace
            factor, due = node.settings.real_time_factor, now
            mark, busy, advanced, halted = now, time.process_time(), 0.0, 0.0
        if now < due:
            executor.spin_once(timeout_sec=min(due - now, WAIT))
            continue
        node.advance()
        advanced += node.period
        if factor == 0.0:
            if now - served >= SERVICE:
                served = now
                serve_some(executor)
            continue
        due += node.period / factor
        late = time.perf_counter() - due
        if late >= 0.0:  # a late node still hears its commands
            serve_some(executor)
        if late > BACKLOG:
            node.overruns += 1
            node.warn('overrun', f'cannot keep up with real-time factor {factor:g}; time slips')
            due = time.perf_counter()


def main(args: list[str] | None = None) -> int:
    """Run the node until it is told to stop."""
    return run_node(SimNode, run, args)


if __name__ == '__main__':
    sys.exit(main())

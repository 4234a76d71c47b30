"""The `sim` node: a virtual Aiko that takes joint commands and publishes its state."""

from dataclasses import dataclass
from dataclasses import replace
import sys
from threading import Event
import time

from diagnostic_msgs.msg import DiagnosticArray
from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_msgs.msg import KeyValue
from geometry_msgs.msg import PoseArray
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool
from std_srvs.srv import Trigger

from snake_sim_ros.levels import is_vertical
from snake_sim_ros.levels import what_is_told
from snake_sim_ros.nodes.messages import reference_from
from snake_sim_ros.nodes.messages import RejectedCommand
from snake_sim_ros.nodes.messages import stamp_from
from snake_sim_ros.nodes.messages import StateMessages
from snake_sim_ros.nodes.node_parameters import settle
from snake_sim_ros.nodes.running import make_executor
from snake_sim_ros.nodes.running import run_node
from snake_sim_ros.posture import joint_angles
from snake_sim_ros.posture import joint_rates
from snake_sim_ros.records import ParameterError
from snake_sim_ros.records import quantity
from snake_sim_ros.records import Record
from snake_sim_ros.simulation import Simulation
from snake_sim_ros.simulation import start_posture
from snake_sim_ros.simulation import steps_in
from snake_sim_ros.stepping import method_of

BACKLOG = 0.2  # s of wall time that the node may be behind before it gives up catching up
WAIT = 0.1  # s, the longest wait for a message before the node looks up
WARN_PERIOD = 5.0  # s between two warnings of one kind


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
    publish_clock: bool = quantity(True, '', 'publish /clock')
    start_paused: bool = quantity(False, '', 'wait for ~/pause or ~/step')


class SimNode(Node):
    """Physics under its own clock, between command and state topics."""

    def __init__(self) -> None:
        super().__init__('sim', automatically_declare_parameters_from_overrides=True)
        self.settings, scene = settle(self, Settings, changeable=('real_time_factor',))
        self.add_on_set_parameters_callback(self._on_set_parameters)
        if self.get_parameter('use_sim_time').value:
            self.get_logger().warning('use_sim_time is ignored: this node makes simulated time')

        self.period = 1.0 / self.settings.publish_rate
        self.steps = steps_in(self.period, scene.dt, 'publish period')
        self.simulation = Simulation(scene)
        self.get_logger().info('compiling the physics (half a minute at the first start ever) ...')
        self.get_logger().info(f'physics ready after {self.simulation.compile():.1f} s')
        self.reference = start_posture(scene)
        self.paused = self.settings.start_paused
        self.rejected = self.overruns = 0
        self.reached_factor = 0.0
        self._warned: dict[str, float] = {}

        self.messages = StateMessages(scene.robot)
        self.joint_states = self.create_publisher(JointState, 'joint_states', 10)
        self.link_poses = self.create_publisher(PoseArray, 'link_poses', 10)
        self.odom = self.create_publisher(Odometry, 'odom', 10)
        self.diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        clock = self.settings.publish_clock
        self.clock = self.create_publisher(Clock, '/clock', QoSProfile(depth=1)) if clock else None
        self.create_subscription(
            JointState, 'joint_command', self._on_command, QoSProfile(depth=1)
        )
        self.create_service(Trigger, '~/reset', self._on_reset)
        self.create_service(SetBool, '~/pause', self._on_pause)
        self.create_service(Trigger, '~/step', self._on_step)

    @property
    def halted(self) -> bool:
        """Whether simulated time stands still."""
        return self.paused or bool(self.simulation.report.failure)

    @property
    def nanoseconds(self) -> int:
        """Simulated time [ns]."""
        return round(self.simulation.step_count * self.simulation.scene.dt * 1e9)

    def advance(self) -> None:
        """Advance by one publish period and publish the state, then the clock."""
        simulation, limit = self.simulation, self.simulation.scene.robot.joint_limit
        level = simulation.last.level
        report = simulation.advance(
            *self.reference.sample(
                simulation.midpoints(self.steps), self.settings.command_horizon, limit
            )
        )
        if report.level != level:
            why = f': {report.left}' if report.left else ': the robot lies flat'
            self.get_logger().info(f'level {report.level} from t = {simulation.time:g} s on{why}')
        if report.failure:
            self.get_logger().error(
                f'diverged, paused at the last good state; call ~/reset: {report.failure}'
            )
            return
        self.publish_state()

    def publish_state(self) -> None:
        """Publish the state, then the clock."""
        state, stamp = self.simulation.state, stamp_from(self.nanoseconds)
        angle, rate = joint_angles(state.q), joint_rates(state.q, state.u)
        self.messages.fill(stamp, state, angle, rate, self.simulation.last.joint_torque)
        self.joint_states.publish(self.messages.joint_states)
        self.link_poses.publish(self.messages.link_poses)
        self.odom.publish(self.messages.odom)
        if self.clock:
            self.clock.publish(Clock(clock=stamp))

    def publish_diagnostics(self) -> None:
        """Publish how the simulation is doing."""
        report, scene = self.simulation.report, self.simulation.scene
        status = DiagnosticStatus(name='sim: physics', hardware_id='simulated')
        factor = self.settings.real_time_factor
        if report.failure:
            status.level, status.message = DiagnosticStatus.ERROR, report.failure
        elif not self.halted and self.reached_factor < 0.95 * factor:
            status.level = DiagnosticStatus.WARN
            status.message = f'real-time factor {self.reached_factor:.2f} of {factor:g}'
        else:
            status.level = DiagnosticStatus.OK
            status.message = 'paused' if self.paused else 'running'
        values = {
            'real_time_factor': f'{self.reached_factor:.4g}',
            'level': self.simulation.last.level,
            'planar_steps': report.planar_steps,
            'method': method_of(scene),
            'steps': report.steps,
            'residual': f'{self.simulation.last.residual_max:.3g}',
            'residual_max': f'{report.residual_max:.3g}',
            'printed_residual_max': f'{report.printed_residual_max:.3g}',
            'fallbacks': report.fallbacks,
            'iterations_per_step': f'{report.iterations / max(report.steps, 1):.3g}',
            'iterations_max': report.iterations_max,
            'unconverged_steps': report.unconverged,
            'penetration_max': f'{report.penetration_max:.3g}',
            'contacts': self.simulation.last.contacts,
            'rejected_commands': self.rejected,
            'overruns': self.overruns,
        }
        status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        message = DiagnosticArray(status=[status])
        message.header.stamp = stamp_from(self.nanoseconds)
        self.diagnostics.publish(message)

    def warn(self, kind: str, sentence: str) -> None:
        """Log a warning, but one of a kind at most every few seconds."""
        now = time.monotonic()
        if now - self._warned.get(kind, -WARN_PERIOD) >= WARN_PERIOD:
            self._warned[kind] = now
            self.get_logger().warning(sentence)

    def _on_command(self, message: JointState) -> None:
        scene = self.simulation.scene
        try:
            reference = reference_from(message, self.reference, scene.robot, self.simulation.time)
            if scene.level == 'planar' and is_vertical(reference.angle, reference.rate):
                told = what_is_told(reference.angle, reference.rate)
                raise RejectedCommand('pitch', f'joint_command: {told}, but level is planar')
            self.reference = reference
        except RejectedCommand as error:
            self.rejected += 1
            self.warn(error.kind, f'{error}; the last good command is held')

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.simulation.reset()
        self.reference = start_posture(self.simulation.scene, self.simulation.time)
        self.publish_state()
        response.success = True
        response.message = f'robot is at the start of the scene at t = {self.simulation.time:g} s'
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.paused = request.data
        response.success = not self.simulation.report.failure
        response.message = 'paused' if self.paused else 'running'
        if not response.success:
            response.message = 'diverged: call ~/reset first'
        return response

    def _on_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self.paused:
            response.message = 'not paused: call ~/pause with true first'
            return response
        self.advance()
        response.success = not self.simulation.report.failure
        response.message = self.simulation.report.failure or f't = {self.simulation.time:g} s'
        return response

    def _on_set_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        changes = {item.name: item.value for item in parameters if item.name == 'real_time_factor'}
        try:
            self.settings = replace(self.settings, **changes)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)


def run(node: SimNode, stop: Event) -> None:
    """Advance physics against the wall clock; serve messages in the slack."""
    executor = make_executor(node)
    node.publish_state()
    due = mark = time.perf_counter()
    advanced = halted = 0.0  # simulated and idle time since the mark
    while not stop.is_set():
        now = time.perf_counter()
        if now - mark >= 1.0:
            if advanced > 0.0:
                node.reached_factor = advanced / (now - mark - halted)
            mark, advanced, halted = now, 0.0, 0.0
            node.publish_diagnostics()
        if node.halted:
            executor.spin_once(timeout_sec=WAIT)
            due = time.perf_counter()
            halted += due - now
            continue
        node.advance()
        advanced += node.period
        factor = node.settings.real_time_factor
        if factor == 0.0:
            executor.spin_once(timeout_sec=0)
            due = time.perf_counter()
            continue
        due += node.period / factor
        while (left := due - time.perf_counter()) > 0 and not stop.is_set():
            executor.spin_once(timeout_sec=min(left, WAIT))
        for _ in range(4):  # a late node still hears its commands
            executor.spin_once(timeout_sec=0)
        if left < -BACKLOG:
            node.overruns += 1
            node.warn('late', f'cannot keep up with real-time factor {factor:g}; time slips')
            due = time.perf_counter()


def main(args: list[str] | None = None) -> int:
    """Run the node until it is told to stop."""
    return run_node(SimNode, run, args)


if __name__ == '__main__':
    sys.exit(main())

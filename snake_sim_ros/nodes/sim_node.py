"""The `sim` node: a virtual Aiko that follows joint commands and publishes its state."""

import gc
import sys
from threading import Event
import time

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from snake_sim_ros.gaits.joint_reference import compile_sampling
from snake_sim_ros.gaits.joint_reference import start_posture
from snake_sim_ros.nodes.command_inbox import CommandInbox
from snake_sim_ros.nodes.compiling import Compiler
from snake_sim_ros.nodes.compiling import is_loaded
from snake_sim_ros.nodes.diagnostics import status_of
from snake_sim_ros.nodes.diagnostics import values_of
from snake_sim_ros.nodes.executors import make_executor
from snake_sim_ros.nodes.executors import serve_some
from snake_sim_ros.nodes.load_meter import LoadMeter
from snake_sim_ros.nodes.node_parameters import settle
from snake_sim_ros.nodes.node_process import run_node
from snake_sim_ros.nodes.sim_parameters import CHANGEABLE
from snake_sim_ros.nodes.sim_parameters import changed
from snake_sim_ros.nodes.sim_parameters import Settings
from snake_sim_ros.nodes.sim_parameters import within_publish_period
from snake_sim_ros.nodes.simulation_services import serve
from snake_sim_ros.nodes.stamps import stamp_from
from snake_sim_ros.nodes.state_publishers import StatePublishers
from snake_sim_ros.nodes.throttled_warnings import ThrottledWarnings
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.stepping.simulation import steps_in

BACKLOG = 0.2  # s of wall time that the node may lag before it stops trying to catch up
WAIT = 0.1  # s, the longest wait for a message in one go
LOOK, TOLD = 1.0, 5.0  # s between two diagnostics, and two lines in the log, while it compiles
SERVICE = 5e-3  # s of wall time between two looks for messages if it runs as fast as possible


class SimNode(Node):
    """
    A simulated robot between the topics of its commands and those of its state.

    Simulated time is counted here; `run` makes it follow the wall clock.

    Attributes
    ----------
    simulation : Simulation
        The physics.
    inbox : CommandInbox
        The joint reference that it follows.
    state_publishers : StatePublishers
        The topics of its state.
    load : LoadMeter
        Real-time factor and processor time.
    paused : bool
        Set by the services.
    level_changes : int
        How often the model level changed.
    compiler : Compiler, optional
        What compiles the physics beside the node; None when that is ready.

    """

    def __init__(self) -> None:
        super().__init__('sim', automatically_declare_parameters_from_overrides=True)
        self.settings, scene = settle(
            self, Settings, changeable=CHANGEABLE, complete=within_publish_period
        )
        if self.get_parameter('use_sim_time').value:
            self.get_logger().warning('use_sim_time is ignored: this node makes simulated time')

        self.period = 1.0 / self.settings.publish_rate
        self.steps = steps_in(self.period, scene.dt, 'publish period')
        self.simulation = Simulation(scene)
        self.paused = self.settings.start_paused
        self.stop = Event()
        self.level_changes = 0
        self.warn = ThrottledWarnings(self)
        self.load = LoadMeter()
        overrides = self.get_parameters_by_prefix('qos_overrides')
        try:
            self.state_publishers = StatePublishers(self, self.simulation, self.settings)
            self.diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
            self.inbox = CommandInbox(self, self.simulation, self.settings, self.warn)
        except (AssertionError, RuntimeError) as error:
            if not overrides:
                raise
            reason = str(error).partition(', at ')[0] or 'a value is of the wrong type'
            raise ParameterError(f'qos_overrides of {", ".join(overrides)}: {reason}') from None
        self.add_on_set_parameters_callback(self._on_set_parameters)
        self.add_post_set_parameters_callback(self._on_parameters_set)
        begin = time.perf_counter()
        self.compiler: Compiler | None = None
        if is_loaded(self._load):
            self._begin(time.perf_counter() - begin)
        else:
            self.compiler = Compiler(scene, self._load)
        serve(self)

    def _load(self) -> None:
        compile_sampling(self.simulation.scene)
        self.simulation.compile()

    def _begin(self, seconds: float) -> None:
        self.get_logger().info(f'physics ready after {seconds:.1f} s')
        self.inbox.open()

    def look_at_compiler(self) -> None:
        """Begin if the compiler is done; publish diagnostics and the state, which stands still."""
        assert self.compiler
        if self.compiler.is_done:
            compiler, self.compiler = self.compiler, None
            if compiler.error:
                raise compiler.error
            self._begin(compiler.seconds)
        else:
            self.publish_diagnostics()
            self.publish_state()

    @property
    def compiling(self) -> str:
        """A sentence on what the compiler does; empty if the physics is ready."""
        return str(self.compiler) if self.compiler else ''

    @property
    def failure(self) -> str:
        """A sentence on why the simulation diverged; empty if it has not."""
        return self.simulation.report.failure

    @property
    def halted(self) -> bool:
        """Whether simulated time stands still."""
        return self.paused or bool(self.failure or self.compiling)

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
        simulation, level = self.simulation, self.simulation.last.level
        report = simulation.advance(*self.inbox.sample(simulation.midpoints(self.steps)))
        if report.level != level:
            why = f': {report.left}' if report.left else ': the robot lies flat'
            self.get_logger().debug(f'level {report.level} from t = {simulation.time:g} s on{why}')
            self.level_changes += 1
        if report.failure:
            self.get_logger().error(
                f'diverged, paused at the last good state; call ~/reset: {report.failure}'
            )
        self.publish_state()

    def step(self, count: int = 1) -> None:
        """Advance by some publish periods, or fewer if a step diverges or the node must end."""
        for _ in range(count):
            if self.failure or self.stop.is_set():
                break
            self.advance()

    def reset(self, *, state: bool = True, time: bool = False) -> None:
        """Put the robot back to its start, or set time to zero, or both; make commands void."""
        simulation, angle = self.simulation, None if state else self.inbox.commanded_angle()
        # A divergence leaves the clock between two publish periods.
        simulation.step_count += -simulation.step_count % self.steps
        if time:
            simulation.step_count = 0
        if state:
            simulation.reset()
        self.inbox.hold(angle)
        self.publish_state()

    def publish_state(self) -> None:
        """Publish the state, then the clock."""
        start = start_posture(self.simulation.scene) if self.compiler else None
        self.state_publishers.publish(self.nanoseconds, start)

    def publish_diagnostics(self) -> None:
        """Publish the state of the simulation and of its commands on /diagnostics."""
        factor, warnings = self.settings.real_time_factor, []
        # The node advances by whole periods, so it may reach one of them less.
        if self.compiling:
            warnings.append(self.compiling)
        if not self.halted and self.load.real_time_factor + self.period < 0.95 * factor:
            warnings.append(f'real-time factor {self.load.real_time_factor:.2f} of {factor:g}')
        warnings += self.inbox.remarks()
        values = {
            'real_time_factor': f'{self.load.real_time_factor:.4g}',
            'processor': f'{self.load.processor:.3f}',
            'overruns': self.load.overruns,
            'level_changes': self.level_changes,
            'rejected_commands': self.inbox.rejected,
            'clamped_commands': self.inbox.clamped,
            **values_of(self.simulation),
        }
        state = 'paused' if self.paused else 'running'
        name = self.get_fully_qualified_name().lstrip('/')
        status = status_of(name, self.failure, '; '.join(warnings), state, values)
        message = DiagnosticArray(status=[status])
        message.header.stamp = stamp_from(self.nanoseconds)
        self.diagnostics.publish(message)
        if self.halted and not self.compiling:
            self.state_publishers.publish_markers(self.nanoseconds)
        self.inbox.end_interval()

    def _on_set_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            _, scene = changed(self.settings, self.simulation.scene, parameters)
            make_stepper(scene)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _on_parameters_set(self, parameters: list[Parameter]) -> None:
        self.settings, scene = changed(self.settings, self.simulation.scene, parameters)
        self.inbox.settings = self.settings
        if scene != self.simulation.scene:
            self.simulation.change(scene)


def wait_for_compiler(node: SimNode, compiler: Compiler, executor: SingleThreadedExecutor) -> None:
    """Serve messages until the physics is compiled or the node must end; tell about it."""
    compiler.start()
    node.get_logger().info(
        'compiling the physics, which takes up to a minute at the first start ever; '
        'commands are kept, and services answer'
    )
    looked, told = 0.0, TOLD
    try:
        while node.compiler and not node.stop.is_set():
            executor.spin_once(timeout_sec=WAIT)
            if compiler.is_done or compiler.seconds >= looked + LOOK:
                looked = compiler.seconds
                node.look_at_compiler()
            if compiler.seconds >= told:
                told += TOLD
                node.get_logger().info(f'{compiler}, {compiler.functions} functions')
    finally:
        compiler.end()
    gc.freeze()


def run(node: SimNode, stop: Event) -> None:
    """Make simulated time follow the wall clock; serve messages in the time that is left."""
    executor, load = make_executor(node), node.load
    node.stop = stop
    node.publish_state()
    if node.compiler:
        wait_for_compiler(node, node.compiler, executor)
    due = served = time.perf_counter()
    load.restart(due)
    factor = node.settings.real_time_factor
    while not stop.is_set():
        now = time.perf_counter()
        if load.complete(now):
            node.publish_diagnostics()
        if node.halted:
            executor.spin_once(timeout_sec=WAIT)
            due = time.perf_counter()
            load.halted += due - now
            continue
        if factor != node.settings.real_time_factor:  # The rest of the wait has another pace.
            factor, due = node.settings.real_time_factor, now
            load.restart(now)
        if now < due:
            executor.spin_once(timeout_sec=min(due - now, WAIT))
            continue
        node.advance()
        load.advanced += node.period
        if factor == 0.0:
            if now - served >= SERVICE:
                served = now
                serve_some(executor)
            continue
        due += node.period / factor
        late = time.perf_counter() - due
        if late >= 0.0:  # A node that is late still takes its commands.
            serve_some(executor)
        if late > BACKLOG:
            load.overruns += 1
            node.warn('overrun', f'cannot keep up with real-time factor {factor:g}; time slips')
            due = time.perf_counter()


def main(args: list[str] | None = None) -> int:
    """Run the node until a signal ends it."""
    return run_node(SimNode, run, args)


if __name__ == '__main__':
    sys.exit(main())

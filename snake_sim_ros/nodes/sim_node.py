# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The `sim` node: a virtual Aiko that follows joint commands and publishes its state."""

from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
import gc
import math
import sys
from threading import Event
import time

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from snake_sim_ros.dynamics.code_cache import why_compile
from snake_sim_ros.dynamics.compilation import watched
from snake_sim_ros.gaits.joint_reference import compile_sampling, start_posture
from snake_sim_ros.nodes.command_inbox import CommandInbox
from snake_sim_ros.nodes.compiling import Compiler, is_loaded, levels_of, NotCompiledError, refuse
from snake_sim_ros.nodes.diagnostics import LoadMeter, SlowSteps, status_of, values_of
from snake_sim_ros.nodes.entity_services import serve_entities
from snake_sim_ros.nodes.executors import make_executor, Refusals, Server, ThrottledWarnings
from snake_sim_ros.nodes.messages import stamp_from
from snake_sim_ros.nodes.node_parameters import ParameterRequests, settle
from snake_sim_ros.nodes.node_process import run_node
from snake_sim_ros.nodes.sim_parameters import as_it_runs, CHANGEABLE, changed, Settings
from snake_sim_ros.nodes.sim_services import Handling, serve_simulation
from snake_sim_ros.nodes.spawning import SpawnedPegs
from snake_sim_ros.nodes.state_publishers import StatePublishers
from snake_sim_ros.nodes.trajectory_action import serve_trajectories
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.obstacles import OF_CAPSULE, OF_SPHERE
from snake_sim_ros.scene.parameters import Scene, steps_in
from snake_sim_ros.stepping.methods import make_stepper, what_is_not_planar
from snake_sim_ros.stepping.simulation import Simulation

BACKLOG = 0.2  # s of wall time that the node may lag before it stops trying to catch up
WAIT = 0.1  # s, the longest wait for a message in one go
REPORT_PERIOD = 5.0  # s between two lines in the log while the node waits for the compiler
OVERFLOW = (
    f'links touch the world in more places than the {OF_SPHERE} contacts of a sphere and the '
    f'{OF_CAPSULE} of a capsule: those with the smallest gaps count; /diagnostics counts such '
    f'steps as overflows'
)
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
    handling : Handling
        Pushes, and where the robot is put.
    load : LoadMeter
        Real-time factor and processor time.
    slow_steps : SlowSteps
        The longest step, and the periods that were too short.
    paused : bool
        Set by the services.
    level_changes : int
        How often the model level changed.
    between : callable, optional
        What is done between messages while simulated time stands still.
    compiler : Compiler, optional
        What compiles the physics beside the node; None when all of it is ready.

    """

    def __init__(self) -> None:
        super().__init__(
            'sim',
            automatically_declare_parameters_from_overrides=True,
            start_parameter_services=False,
        )
        self.settings, scene = settle(self, Settings, changeable=CHANGEABLE, complete=as_it_runs)
        self.settings.check(scene)
        if self.get_parameter('use_sim_time').value:
            self.get_logger().warning('use_sim_time is ignored: this node makes simulated time')

        self.period = 1.0 / self.settings.publish_rate
        self.steps = steps_in(self.period, scene.dt, 'publish period')
        self.simulation = Simulation(scene)
        self._share_iterations()
        self.paused = self.settings.start_paused
        self.stop = Event()
        self.level_changes = 0
        self.between: Callable[[], None] | None = None
        self.warn = ThrottledWarnings(self)
        self.load, self.slow_steps = LoadMeter(), SlowSteps()
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
        self.handling = Handling(
            self, self.simulation, self.settings, Refusals(self.warn), self._on_moved
        )
        self.add_on_set_parameters_callback(self._on_set_parameters)
        self.add_post_set_parameters_callback(self._on_parameters_set)
        self.compiler: Compiler | None = None
        begin = time.perf_counter()
        levels = levels_of(scene)
        missing = [level for level in levels if not is_loaded(partial(self._load, level))]
        if missing:
            self.compiler = Compiler(scene, self._load, missing)
            if reason := why_compile():
                self.get_logger().info(reason)
        if self.compiler and levels[0] in missing:
            self.compiler.needed = 1
        else:
            self.begin(time.perf_counter() - begin)
        # Loading takes half a second, in which no service could answer.
        ParameterRequests(self)
        pegs = SpawnedPegs(self.simulation, lambda: self.inbox.modes.scene, self._change_obstacles)
        serve_simulation(self, pegs.despawn)
        serve_entities(self, self.simulation, self.handling.placing, pegs)
        serve_trajectories(self, self.inbox)

    def _load(self, level: str) -> None:
        compile_sampling(self.simulation.scene)
        self.simulation.compile(levels=[level])

    def begin(self, seconds: float) -> None:
        """Take commands, since the physics is ready after some time [s]."""
        rest = f': {self.compiler.outlook}' if self.compiler and not self.compiler.is_done else ''
        self.get_logger().info(f'physics ready after {seconds:.1f} s{rest}')
        self.inbox.open()

    @property
    def compiling(self) -> str:
        """A sentence on the compiler while the node waits for it, else empty."""
        if not (self.compiler and (level := self.compiler.awaited)):
            return ''
        if not self.inbox.is_open:
            return str(self.compiler)
        reason = getattr(self.simulation.stepper, 'reason', '')
        why = f', since {reason}' if level == 'spatial' and reason else ''
        return f'{self.compiler}: simulated time waits for the {level} level{why}'

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

    def advance(self) -> bool:
        """
        Advance by one publish period and publish the state, then the clock.

        Returns
        -------
        bool
            False if nothing happened, because the level of the next step is still to be compiled.

        """
        simulation, level = self.simulation, self.simulation.last.level
        reference = self.inbox.sample(simulation.midpoints(self.steps))
        self.handling.limit()
        begin, used, cut = time.perf_counter(), time.thread_time(), simulation.budget.cut
        try:
            with watched(refuse) if self.compiler else nullcontext():
                report = simulation.advance(*reference)
        except NotCompiledError:
            assert self.compiler
            self.compiler.needed = len(self.compiler.levels)
            return False
        factor = self.settings.real_time_factor
        most = self.period / factor if factor > 0.0 else math.inf
        seconds, used = time.perf_counter() - begin, time.thread_time() - used
        self.slow_steps.look(simulation, seconds, used, most)
        if cut := simulation.budget.cut - cut:
            self.warn(
                'cut steps',
                f'{cut} of the {report.steps} steps before t = {simulation.time:g} s were cut, '
                f'since they share {self.settings.iteration_budget} iterations: residual '
                f'{report.residual_max:.3g} m/s at most',
            )
        if report.overflows:
            self.get_logger().warning(OVERFLOW, once=True)
        if report.level != level:
            why = report.left or what_is_not_planar(simulation.scene) or 'the robot lies flat'
            self.get_logger().debug(
                f'level {report.level} from t = {simulation.time:g} s on: {why}'
            )
            self.level_changes += 1
        if report.failure:
            self.get_logger().error(
                f'diverged, paused at the last good state; call ~/reset: {report.failure}'
            )
        self.publish_state()
        return True

    def step(self, count: int = 1) -> None:
        """Advance by some publish periods, or fewer if a step diverges or the node must end."""
        for _ in range(count):
            if self.failure or self.stop.is_set() or not self.advance():
                break

    def reset(self, *, state: bool = True, time: bool = False) -> None:
        """Put the robot back to its start, or set time to zero, or both; make commands void."""
        simulation, angle = self.simulation, None if state else self.inbox.commanded_angle()
        # A divergence leaves the clock between two publish periods.
        simulation.step_count += -simulation.step_count % self.steps
        if time:
            simulation.step_count = 0
        if state:
            simulation.reset()
        self.inbox.hold(angle, runs=state and not (time or self.paused))
        simulation.pushes.clear()
        self.state_publishers.sensors.reader.restart()
        self.publish_state()

    def _on_moved(self) -> None:
        self.state_publishers.sensors.reader.rest()
        if self.halted:
            self.publish_state()

    def publish_state(self) -> None:
        """Publish the state, then the clock."""
        start = None if self.inbox.is_open else start_posture(self.simulation.scene)
        self.state_publishers.publish(self.nanoseconds, start)

    def publish_diagnostics(self) -> None:
        """Publish the state of the simulation and of its commands on /diagnostics."""
        factor, warnings = self.settings.real_time_factor, []
        # The node advances by whole periods, so it may reach one of them less.
        if self.compiling:
            warnings.append(self.compiling)
        if not self.halted and self.load.real_time_factor + self.period < 0.95 * factor:
            warnings.append(f'real-time factor {self.load.real_time_factor:.2f} of {factor:g}')
        warnings += self.inbox.remarks() + self.handling.refusals.remarks()
        values = {
            **(self.compiler.values if self.compiler else {}),
            'real_time_factor': f'{self.load.real_time_factor:.4g}',
            'processor': f'{self.load.processor:.3f}',
            'overruns': self.load.overruns,
            **self.slow_steps.values(),
            'level_changes': self.level_changes,
            'rejected_commands': self.inbox.rejected,
            'clamped_commands': self.inbox.clamped,
            'limited_references': self.inbox.limiter.count,
            'rejected_pushes_and_poses': self.handling.refusals.count,
            'cut_steps': self.simulation.budget.cut,
            **values_of(self.simulation),
        }
        state = 'paused' if self.paused else 'running'
        name = self.get_fully_qualified_name().lstrip('/')
        status = status_of(name, self.failure, '; '.join(warnings), state, values)
        message = DiagnosticArray(status=[status])
        message.header.stamp = stamp_from(self.nanoseconds)
        self.diagnostics.publish(message)
        if self.compiling:
            self.publish_state()
        elif self.halted:
            self.state_publishers.publish_markers(self.nanoseconds)
        self.inbox.end_interval()

    def _on_set_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            _, scene = changed(self.settings, self.inbox.modes.scene, parameters)
            make_stepper(scene)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _on_parameters_set(self, parameters: list[Parameter]) -> None:
        self.settings, scene = changed(self.settings, self.inbox.modes.scene, parameters)
        self.inbox.settings = self.handling.settings = self.settings
        self.inbox.modes.change(scene)
        self._share_iterations()

    def _change_obstacles(self, scene: Scene) -> None:
        """Continue with other obstacles; if their machine code is missing, time waits for it."""
        self.inbox.modes.change(scene)
        self.state_publishers.show_obstacles(scene)
        levels = levels_of(scene)
        missing = [level for level in levels if not is_loaded(partial(self._load, level))]
        if self.compiler:
            self.compiler.end()
            self.compiler = None
        if missing:
            self.compiler = Compiler(self.simulation.scene, self._load, missing)
            self.compiler.needed = len(missing)
            self.compiler.start()

    def _share_iterations(self) -> None:
        self.simulation.budget.share = self.settings.iteration_budget / self.steps


def look_at_compiler(node: SimNode, compiler: Compiler, reported: float) -> float:
    """Let the node begin when it can; report on the compiler, and return when that was [s]."""
    log = node.get_logger()
    if compiler.error:
        raise compiler.error
    if compiler.loaded and not node.inbox.is_open:
        node.begin(compiler.seconds)
    if compiler.is_done:
        compiler.end()
        node.compiler = None
        gc.freeze()  # as `run_node` does where nothing is to be compiled
        log.info(f'compiled {", ".join(compiler.levels)} level in {compiler.seconds:.1f} s')
    elif not node.compiling:
        return -math.inf  # The next wait is reported at once.
    elif compiler.seconds >= reported + REPORT_PERIOD:
        log.info(node.compiling)
        return compiler.seconds
    return reported


def run_sim(node: SimNode, stop: Event) -> None:
    """Run the node until the event is set; the compiler does not outlive it."""
    node.stop = stop
    try:
        keep_time(node, stop)
    finally:
        if node.compiler:
            node.compiler.end()


def keep_time(node: SimNode, stop: Event) -> None:
    """Make simulated time follow the wall clock; serve messages in the time that is left."""
    executor, load = Server(make_executor(node), node.warn), node.load
    node.publish_state()
    reported = 0.0
    if node.compiler:
        node.compiler.start()
        if node.compiling:
            node.get_logger().info(
                'compiling the physics, which takes up to a minute at the first start ever; '
                'commands are kept, and services answer'
            )
    due = served = time.perf_counter()
    load.restart(due)
    factor = node.settings.real_time_factor
    while not stop.is_set():
        if node.compiler:
            reported = look_at_compiler(node, node.compiler, reported)
        now = time.perf_counter()
        if load.complete(now):
            node.publish_diagnostics()
        if node.halted:
            if node.between:
                node.between()
                executor.serve_some()
            else:
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
        if not node.advance():
            continue
        load.advanced += node.period
        if factor == 0.0:
            if now - served >= SERVICE:
                served = now
                executor.serve_some()
            continue
        due += node.period / factor
        late = time.perf_counter() - due
        if late >= 0.0:  # A node that is late still takes its commands.
            executor.serve_some()
        if late > BACKLOG:
            due = time.perf_counter()
            load.slip(due)
        if node.slow_steps.sentence or late > BACKLOG:
            slips = f'cannot keep up with real-time factor {factor:g}, time slips: '
            sentence = node.slow_steps.sentence or 'messages or other programs take the time'
            node.warn('slow', (slips if load.slips(now) else '') + sentence)


def main(args: list[str] | None = None) -> int:
    """Run the node until a signal ends it."""
    return run_node(SimNode, run_sim, args)


if __name__ == '__main__':
    sys.exit(main())

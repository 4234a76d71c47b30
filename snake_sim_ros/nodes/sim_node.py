# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The `sim` node: virtual snakes that follow joint commands and publish their state."""

from collections.abc import Callable, Iterable
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
import gc
import math
from pathlib import Path
import sys
from threading import Event
import time

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from snake_sim_ros.dynamics.code_cache import why_compile
from snake_sim_ros.dynamics.compilation import watched
from snake_sim_ros.gaits.joint_reference import compile_sampling
from snake_sim_ros.nodes.compiling import Compiler, is_loaded, levels_of, NotCompiledError, refuse
from snake_sim_ros.nodes.diagnostics import LoadMeter, status_of
from snake_sim_ros.nodes.entity_services import serve_entities
from snake_sim_ros.nodes.executors import make_executor, Server, ThrottledWarnings
from snake_sim_ros.nodes.live_robot import LiveRobot
from snake_sim_ros.nodes.messages import stamp_from
from snake_sim_ros.nodes.node_parameters import (
    ParameterRequests,
    settle,
    settle_anew,
    with_own_robot,
)
from snake_sim_ros.nodes.node_process import run_node
from snake_sim_ros.nodes.placing import Placing
from snake_sim_ros.nodes.sim_parameters import as_it_runs, CHANGEABLE, changed, Settings
from snake_sim_ros.nodes.sim_services import serve_simulation
from snake_sim_ros.nodes.spawning import Spawning
from snake_sim_ros.nodes.standard import NO_WORLD
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.files import find_file
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.robot_description import ROBOT_NAME
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.simulation import Simulation

BACKLOG = 0.2  # s of wall time that the node may lag before it stops trying to catch up
WAIT = 0.1  # s, the longest wait for a message in one go
REPORT_PERIOD = 5.0  # s between two lines in the log while the node waits for the compiler
LINGER = 1.0  # s of wall time in which the result of a goal of a deleted robot is delivered
SERVICE = 5e-3  # s of wall time between two looks for messages if it runs as fast as possible


class SimNode(Node):
    """
    Simulated robots between the topics of their commands and those of their state.

    Simulated time is counted here; `run_sim` makes it follow the wall clock.

    Attributes
    ----------
    settings : Settings
    robots : dict
        Name -> LiveRobot: that of the scene, with the topics of this node, and then those that
        were spawned, each with a node of its own. They touch the obstacles, not each other.
    load : LoadMeter
        Real-time factor and processor time.
    world : str
        The file of the scene; empty while none is loaded.
    paused : bool
        Set by the services.
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
        self.world = str(find_file(self.settings.scene, Path()).resolve())
        if self.get_parameter('use_sim_time').value:
            self.get_logger().warning('use_sim_time is ignored: this node makes simulated time')

        self.period = 1.0 / self.settings.publish_rate
        self.paused = self.settings.start_paused
        self.stop = Event()
        self.between: Callable[[], None] | None = None
        self.warn = ThrottledWarnings(self)
        self.load = LoadMeter()
        overrides = self.get_parameters_by_prefix('qos_overrides')
        try:
            self.diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
            robot = LiveRobot(self, Simulation(scene), self.settings, self._on_moved)
        except (AssertionError, RuntimeError) as error:
            if not overrides:
                raise
            reason = str(error).partition(', at ')[0] or 'a value is of the wrong type'
            raise ParameterError(f'qos_overrides of {", ".join(overrides)}: {reason}') from None
        self.robots = {ROBOT_NAME: robot}
        self._leaving: list[tuple[LiveRobot, float]] = []
        self._take_parameters()
        self.compiler: Compiler | None = None
        self._load_code()
        # Loading takes half a second, in which no service could answer.
        ParameterRequests(self)
        self.spawning = Spawning(self)
        serve_simulation(self, self.spawning.despawn)
        serve_entities(self, self.robots, self.spawning)

    @property
    def robot(self) -> LiveRobot:
        """The robot of the scene."""
        return self.robots[ROBOT_NAME]

    @property
    def simulation(self) -> Simulation:
        """The physics of the robot of the scene."""
        return self.robot.simulation

    # ---- scenes and their machine code ----------------------------------------------------------

    def load_world(self, source: str, scene: Scene) -> None:
        """
        Continue with another scene, paused at its start at time 0.

        Parameters
        ----------
        source : str
            Its name or file.
        scene : Scene

        Raises
        ------
        ParameterError
            If the node cannot run the scene with its settings. Nothing has changed then.

        """
        settings = replace(self.settings, scene=source)
        scene = as_it_runs(settings, with_own_robot(scene, settings.robot_description), ())
        settings.check(scene)
        self.robot.begin(Simulation(scene), settings)
        self.unload_world()
        self.settings = settings
        self.spawning.begin()
        self.remove_on_set_parameters_callback(self._on_set_parameters)
        self.remove_post_set_parameters_callback(self._on_parameters_set)
        settle_anew(self, settings, scene, CHANGEABLE)
        self._take_parameters()
        self.world = str(find_file(source, Path()).resolve())
        self._load_code()
        if self.compiler:
            self.compiler.start()
        self.publish_state()

    def unload_world(self) -> None:
        """Let simulated time wait for another scene."""
        self.spawning.delete_robots()
        self.robot.stop()
        self.world, self.paused = '', True
        self._end_compiler()

    def _load_code(self) -> None:
        """Load the machine code of the scene; what is missing is compiled beside the node."""
        begin, scene = time.perf_counter(), self.simulation.scene
        levels = levels_of(scene)
        missing = self._missing(levels)
        if missing:
            self.compiler = Compiler(scene, self._load, missing)
            if reason := why_compile():
                self.get_logger().info(reason)
        if self.compiler and levels[0] in missing:
            self.compiler.needed = 1
        else:
            self.begin(time.perf_counter() - begin)

    def _missing(self, levels: Iterable[str]) -> list[str]:
        """Load the machine code of some levels; return those that are not compiled."""
        return [level for level in levels if not is_loaded(partial(self._load, level))]

    def _load(self, level: str) -> None:
        compile_sampling(self.simulation.scene)
        self.simulation.compile(levels=[level])

    def _end_compiler(self) -> None:
        if self.compiler:
            self.compiler.end()
            self.compiler = None

    def change_obstacles(self, scene: Scene) -> None:
        """Continue with other obstacles; if their machine code is missing, time waits for it."""
        for robot in self.robots.values():
            robot.inbox.modes.change(scene)
            robot.show_obstacles()
        missing = self._missing(levels_of(scene))
        self._end_compiler()
        if missing:
            self.compiler = Compiler(self.simulation.scene, self._load, missing)
            self.compiler.needed = len(missing)
            self.compiler.start()

    def begin(self, seconds: float) -> None:
        """Take commands, since the physics is ready after some time [s]."""
        rest = f': {self.compiler.outlook}' if self.compiler and not self.compiler.is_done else ''
        self.get_logger().info(f'physics ready after {seconds:.1f} s{rest}')
        self.robot.inbox.open()

    @property
    def compiling(self) -> str:
        """A sentence on the compiler while the node waits for it, else empty."""
        if not (self.compiler and (level := self.compiler.awaited)):
            return ''
        if not self.robot.inbox.is_open:
            return str(self.compiler)
        reason = getattr(self.simulation.stepper, 'reason', '')
        why = f', since {reason}' if level == 'spatial' and reason else ''
        return f'{self.compiler}: simulated time waits for the {level} level{why}'

    @property
    def waiting(self) -> str:
        """A sentence on what simulated time waits for, a world or the compiler; else empty."""
        return self.compiling if self.world else NO_WORLD

    # ---- robots ---------------------------------------------------------------------------------

    def spawn_robot(self, name: str, namespace: str, stamped: PoseStamped) -> None:
        """
        Add a robot like that of the scene, at rest, with topics in a namespace of its own.

        Parameters
        ----------
        name, namespace : str
        stamped : PoseStamped
            Pose of its ``base_link``.

        Raises
        ------
        ParameterError
            If it cannot be there. Nothing has changed then.

        """
        simulation = Simulation(self.robot.scene)
        Placing(simulation, lambda: None).rest_at(stamped.header.frame_id, stamped.pose)
        simulation.step_count = self.simulation.step_count
        self._release_robots(time.monotonic())
        node = Node(
            self.get_name(),
            namespace=namespace,
            context=self.context,
            use_global_arguments=False,
            start_parameter_services=False,
            parameter_overrides=[Parameter('start_type_description_service', value=False)],
        )
        seed = self.settings.sensor_seed + len(self.robots)
        settings = replace(self.settings, frame_prefix='auto', sensor_seed=seed)
        robot = LiveRobot(node, simulation, settings, self._on_moved, has_clock=False)
        robot.start = simulation.state
        robot.inbox.open()
        self.robots[name] = robot
        if self.executor:
            self.executor.add_node(node)
        self._on_moved()

    def delete_robot(self, name: str) -> None:
        """Remove a robot that was spawned."""
        robot = self.robots.pop(name)
        robot.close()
        self._leaving.append((robot, time.monotonic()))

    def _release_robots(self, before: float) -> None:
        """Give up the nodes of robots that were deleted before a time [s]."""
        for robot, end in self._leaving:
            if end <= before:
                robot.release()
        self._leaving = [item for item in self._leaving if item[1] > before]

    # ---- time and state -------------------------------------------------------------------------

    @property
    def failure(self) -> str:
        """A sentence on why a simulation diverged; empty if none has."""
        return next(filter(None, (robot.failure for robot in self.robots.values())), '')

    @property
    def halted(self) -> bool:
        """Whether simulated time stands still."""
        return self.paused or bool(self.failure or self.waiting)

    @property
    def seconds(self) -> float:
        """Simulated time [s]."""
        return self.simulation.time

    def advance(self) -> bool:
        """
        Advance by one publish period and publish the state, then the clock.

        Returns
        -------
        bool
            False if nothing happened, because the level of the next step is still to be compiled.

        """
        factor, robots = self.settings.real_time_factor, self.robots.values()
        most = self.period / factor if factor > 0.0 else math.inf
        begin = min(robot.simulation.step_count for robot in robots)
        try:
            with watched(refuse) if self.compiler else nullcontext():
                for robot in robots:
                    # After an attempt that the compiler stopped some are ahead.
                    if robot.simulation.step_count == begin:
                        robot.advance(most)
        except NotCompiledError:
            assert self.compiler
            self.compiler.needed = len(self.compiler.levels)
            return False
        self.publish_state()
        return True

    def step(self, count: int = 1) -> None:
        """Advance by some publish periods, or fewer if a step diverges or the node must end."""
        for _ in range(count):
            if self.failure or self.stop.is_set() or not self.advance():
                break

    def reset(self, *, state: bool = True, time: bool = False) -> None:
        """Put all robots back to their start, or set time to zero, or both; void commands."""
        # A divergence leaves a robot between two publish periods.
        most = max(robot.simulation.step_count for robot in self.robots.values())
        count = 0 if time else most + -most % self.robot.steps
        for robot in self.robots.values():
            robot.reset(count, state=state, runs=state and not (time or self.paused))
        self.publish_state()

    def _on_moved(self) -> None:
        if self.halted:
            self.publish_state()

    def publish_state(self) -> None:
        """Publish the state of all robots, then the clock; nothing without a world."""
        if self.world:
            for robot in reversed(self.robots.values()):
                robot.publish()

    @property
    def late(self) -> str:
        """A sentence on steps that took too long in the last publish period; empty if none did."""
        sentences = (robot.slow_steps.sentence for robot in self.robots.values())
        return next(filter(None, sentences), '')

    def publish_diagnostics(self) -> None:
        """Publish the state of the simulation and of its commands on /diagnostics."""
        factor, warnings = self.settings.real_time_factor, []
        self._release_robots(time.monotonic() - LINGER)
        # The node advances by whole periods, so it may reach one of them less.
        if self.waiting:
            warnings.append(self.waiting)
        if not self.halted and self.load.real_time_factor + self.period < 0.95 * factor:
            warnings.append(f'real-time factor {self.load.real_time_factor:.2f} of {factor:g}')
        values = {
            'real_time_factor': f'{self.load.real_time_factor:.4g}',
            'processor': f'{self.load.processor:.3f}',
            'overruns': self.load.overruns,
        }
        state = 'paused' if self.paused else 'running'
        message = DiagnosticArray()
        for robot in self.robots.values():
            name = robot.node.get_fully_qualified_name().lstrip('/')
            sentences = '; '.join(warnings + robot.remarks())
            told = {**values, **robot.values()}
            message.status.append(status_of(name, robot.failure, sentences, state, told))
        message.header.stamp = stamp_from(self.robot.nanoseconds)
        self.diagnostics.publish(message)
        if self.waiting:
            self.publish_state()
        elif self.halted:
            for robot in self.robots.values():
                robot.publish_markers()
        for robot in self.robots.values():
            robot.inbox.end_interval()

    # ---- parameters -----------------------------------------------------------------------------

    def _take_parameters(self) -> None:
        self.add_on_set_parameters_callback(self._on_set_parameters)
        self.add_post_set_parameters_callback(self._on_parameters_set)

    def _on_set_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            _, scene = changed(self.settings, self.robot.scene, parameters)
            make_stepper(scene)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _on_parameters_set(self, parameters: list[Parameter]) -> None:
        self.settings, scene = changed(self.settings, self.robot.scene, parameters)
        for robot in self.robots.values():
            robot.change(self.settings, scene)


def look_at_compiler(node: SimNode, compiler: Compiler, reported: float) -> float:
    """Let the node begin when it can; report on the compiler, and return when that was [s]."""
    log = node.get_logger()
    if compiler.error:
        raise compiler.error
    if compiler.loaded and not node.robot.inbox.is_open:
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
        if node.late or late > BACKLOG:
            slips = f'cannot keep up with real-time factor {factor:g}, time slips: '
            sentence = node.late or 'messages or other programs take the time'
            node.warn('slow', (slips if load.slips(now) else '') + sentence)


def main(args: list[str] | None = None) -> int:
    """Run the node until a signal ends it."""
    return run_node(SimNode, run_sim, args)


if __name__ == '__main__':
    sys.exit(main())

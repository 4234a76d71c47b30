# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A simulated robot between the topics of its commands and those of its state."""

from collections.abc import Callable
import time
from typing import Any

from rclpy.node import Node

from snake_sim_ros.gaits.joint_reference import start_posture
from snake_sim_ros.nodes.command_inbox import CommandInbox
from snake_sim_ros.nodes.diagnostics import SlowSteps, values_of
from snake_sim_ros.nodes.executors import Refusals, ThrottledWarnings
from snake_sim_ros.nodes.sim_parameters import Settings
from snake_sim_ros.nodes.sim_services import Handling
from snake_sim_ros.nodes.state_publishers import StatePublishers
from snake_sim_ros.nodes.trajectory_action import serve_trajectories
from snake_sim_ros.scene.obstacles import OF_CAPSULE, OF_SPHERE
from snake_sim_ros.scene.parameters import Scene, steps_in
from snake_sim_ros.stepping.methods import what_is_not_planar
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.stepping.state import State

OVERFLOW = (
    f'links touch the world in more places than the {OF_SPHERE} contacts of a sphere and the '
    f'{OF_CAPSULE} of a capsule: those with the smallest gaps count; /diagnostics counts such '
    f'steps as overflows'
)


class LiveRobot:
    """
    A simulation with all that `sim` offers for its robot, besides the services of time.

    Parameters
    ----------
    node : Node
        Its namespace is that of the topics.
    simulation : Simulation
    settings : Settings
    moved : callable
        Called when a message or a request has put the robot elsewhere.
    has_clock : bool
        Whether the clock is published after the state, if the settings say so.

    Attributes
    ----------
    inbox : CommandInbox
        The joint reference that it follows.
    handling : Handling
        Pushes, and where the robot is put.
    slow_steps : SlowSteps
        The longest step, and the periods that were too short.
    steps : int
        Steps of a publish period.
    start : State, optional
        Where a reset puts the robot; default: to the start of the scene.

    """

    def __init__(
        self,
        node: Node,
        simulation: Simulation,
        settings: Settings,
        moved: Callable[[], Any],
        *,
        has_clock: bool = True,
    ) -> None:
        self.node, self._moved = node, moved
        self.warn = warn = ThrottledWarnings(node)
        self._publishers = StatePublishers(node, simulation, settings, has_clock=has_clock)
        self.inbox = CommandInbox(node, simulation, settings, warn)
        self.handling = Handling(node, simulation, settings, Refusals(warn), self._on_moved)
        self._trajectories = serve_trajectories(node, self.inbox)
        self._renew(simulation, settings)

    def begin(self, simulation: Simulation, settings: Settings) -> None:
        """
        Go on with another simulation; commands are taken after ``inbox.open()``.

        Raises
        ------
        ParameterError
            If its robot does not have the sensors of the settings. Nothing has changed then.

        """
        self._publishers.begin(simulation, settings)
        self.stop()
        self.inbox.begin(simulation)
        self.handling.begin(simulation)
        self._renew(simulation, settings)

    def _renew(self, simulation: Simulation, settings: Settings) -> None:
        self.simulation, self._settings = simulation, settings
        self.steps = steps_in(1.0 / settings.publish_rate, simulation.scene.dt, 'publish period')
        self.start: State | None = None
        self.slow_steps, self._level_changes = SlowSteps(), 0
        self.change(settings, self.scene)

    def stop(self) -> None:
        """Take no more commands, and end the goal of the action."""
        self.inbox.is_open = False
        self._trajectories.drop()

    def close(self) -> None:
        """Take the robot out of the graph, but for the result of a goal that ends with it."""
        self.stop()
        self.inbox.close()
        if self.node.executor:
            self.node.executor.remove_node(self.node)
        self.node.destroy_node()

    def release(self) -> None:
        """Give up the node of a closed robot, so that another one may have its name."""
        self._trajectories.close()

    @property
    def scene(self) -> Scene:
        """The scene, with the gains of controllers that are off, too."""
        return self.inbox.modes.scene

    def change(self, settings: Settings, scene: Scene) -> None:
        """Continue with other settings and another scene, which may change while it runs."""
        self._settings = self.inbox.settings = self.handling.settings = settings
        self.inbox.modes.change(scene)
        self.simulation.budget.share = settings.iteration_budget / self.steps

    def show_obstacles(self) -> None:
        """Show the obstacles of the scene from now on."""
        self._publishers.show_obstacles(self.scene)

    # ---- time and state -------------------------------------------------------------------------

    @property
    def failure(self) -> str:
        """A sentence on why the simulation diverged; empty if it has not."""
        return self.simulation.report.failure

    @property
    def nanoseconds(self) -> int:
        """Simulated time [ns]."""
        return round(self.simulation.step_count * self.simulation.scene.dt * 1e9)

    def advance(self, most: float) -> None:
        """
        Advance by a publish period, or less if a step diverges.

        Parameters
        ----------
        most : float
            Wall time that a publish period has [s].

        Raises
        ------
        NotCompiledError
            If the steps would have to be compiled, where that is refused. Nothing has happened.

        """
        simulation, level = self.simulation, self.simulation.last.level
        reference = self.inbox.sample(simulation.midpoints(self.steps))
        self.handling.limit()
        begin, used, cut = time.perf_counter(), time.thread_time(), simulation.budget.cut
        report = simulation.advance(*reference)
        seconds, used = time.perf_counter() - begin, time.thread_time() - used
        self.slow_steps.look(simulation, seconds, used, most)
        if cut := simulation.budget.cut - cut:
            self.warn(
                'cut steps',
                f'{cut} of the {report.steps} steps before t = {simulation.time:g} s were cut, '
                f'since they share {self._settings.iteration_budget} iterations: residual '
                f'{report.residual_max:.3g} m/s at most',
            )
        log = self.node.get_logger()
        if report.overflows:
            log.warning(OVERFLOW, once=True)
        if report.level != level:
            why = report.left or what_is_not_planar(simulation.scene) or 'the robot lies flat'
            log.debug(f'level {report.level} from t = {simulation.time:g} s on: {why}')
            self._level_changes += 1
        if report.failure:
            log.error(f'diverged, paused at the last good state; call ~/reset: {report.failure}')

    def reset(self, step_count: int, *, state: bool, runs: bool) -> None:
        """
        Make commands void at a time, and, if `state` is given, put the robot back to its start.

        Parameters
        ----------
        step_count : int
            Number of steps at that time.
        state : bool
        runs : bool
            Whether time runs by itself, see `CommandInbox.hold`.

        """
        simulation, angle = self.simulation, None if state else self.inbox.commanded_angle()
        simulation.step_count = step_count
        if state:
            simulation.reset()
            if self.start:
                simulation.state = self.start
        self.inbox.hold(angle, runs=runs)
        simulation.pushes.clear()
        self._publishers.sensors.reader.restart()

    def _on_moved(self) -> None:
        self._publishers.sensors.reader.rest()
        self._moved()

    # ---- what is told ---------------------------------------------------------------------------

    def publish(self) -> None:
        """Publish the state, then the clock."""
        start = None if self.inbox.is_open else start_posture(self.simulation.scene)
        self._publishers.publish(self.nanoseconds, start)

    def publish_markers(self) -> None:
        """Publish contacts and obstacles of the last state, if somebody subscribed."""
        self._publishers.publish_markers(self.nanoseconds)

    def values(self) -> dict[str, object]:
        """Return name -> value for /diagnostics."""
        return {
            **self.slow_steps.values(),
            'level_changes': self._level_changes,
            'rejected_commands': self.inbox.rejected,
            'clamped_commands': self.inbox.clamped,
            'limited_references': self.inbox.limiter.count,
            'rejected_pushes_and_poses': self.handling.refusals.count,
            'cut_steps': self.simulation.budget.cut,
            **values_of(self.simulation),
        }

    def remarks(self) -> list[str]:
        """Return a sentence each on what was refused lately, and on commands that stopped."""
        return self.inbox.remarks() + self.handling.refusals.remarks()

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What can be done to the robot of the node `sim` besides commands: services, pushes and placing.

A message on ``~/push`` (geometry_msgs/WrenchStamped) pushes a link for `push_duration`. Its frame
is that of a link, which is pushed, and whose axes the force keeps; or `world`, and the link is
`push_link`. A message on ``~/set_pose`` (geometry_msgs/PoseStamped) puts ``base_link``, as
``odom`` has it, into a pose, with the joint angles that the robot has, at rest.
"""

from collections.abc import Callable
from typing import Any, Protocol

from geometry_msgs.msg import PoseStamped, WrenchStamped
import numpy as np
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_srvs.srv import SetBool, Trigger

from snake_sim_ros.nodes import standard
from snake_sim_ros.nodes.executors import Refusals
from snake_sim_ros.nodes.messages import BASE, ODOM, WORLD
from snake_sim_ros.nodes.placing import FASTEST, FASTEST_TURN, numbers_of, Placing, too_fast
from snake_sim_ros.nodes.sim_parameters import Settings
from snake_sim_ros.nodes.worlds import Loadable, Worlds
from snake_sim_ros.recording.sensors import link_index
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.simulation import Simulation

# ---- reset, pause and step ----------------------------------------------------------------------

# Services that control simulated time: ``~/reset``, ``~/pause`` and ``~/step``.
#
# The services of the standard, simulation_interfaces, are offered as well if that package is
# installed.


DIVERGED = 'diverged: call ~/reset first'
STILL_RUNNING = 'not paused: call ~/pause with true first'
ABOUT = (
    'snake_sim_ros: a step is one publish period; a URDF that is spawned must be of one link that '
    'is a cylinder; further robots have the uri snake_robot; worlds are scenes, by name or file'
)
FEATURES = {  # what serves it -> features
    'GetEntities': ('ENTITY_BOUNDS_BOX', 'ENTITY_CATEGORIES'),
    'GetEntityBounds': ('ENTITY_BOUNDS',),
    'GetEntityInfo': ('ENTITY_INFO_GETTING',),
    'GetEntityState': ('ENTITY_STATE_GETTING',),
    'SetEntityState': ('ENTITY_STATE_SETTING',),
    'SpawnEntity': ('SPAWNING', 'SPAWNING_RESOURCE_STRING'),
    'SpawnEntities': ('SPAWNING_ENTITIES',),
    'GetSpawnables': ('SPAWNABLES',),
    'DeleteEntity': ('DELETING', 'SIMULATION_RESET_SPAWNED'),
    'ResetSimulation': ('SIMULATION_RESET', 'SIMULATION_RESET_TIME', 'SIMULATION_RESET_STATE'),
    'GetSimulationState': ('SIMULATION_STATE_GETTING',),
    'SetSimulationState': ('SIMULATION_STATE_SETTING', 'SIMULATION_STATE_PAUSE'),
    'StepSimulation': ('STEP_SIMULATION_SINGLE', 'STEP_SIMULATION_MULTIPLE'),
    'SimulateSteps': ('STEP_SIMULATION_ACTION',),
    'GetCurrentWorld': ('WORLD_INFO_GETTING',),
    'GetAvailableWorlds': ('AVAILABLE_WORLDS',),
    'LoadWorld': ('WORLD_LOADING',),
    'UnloadWorld': ('WORLD_UNLOADING',),
}


class Controllable(Loadable, Protocol):
    """A node whose simulated time the services control."""

    paused: bool

    @property
    def failure(self) -> str:
        """A sentence on why the simulation diverged; empty if it has not."""

    @property
    def waiting(self) -> str:
        """A sentence on what simulated time waits for; empty: nothing."""

    @property
    def seconds(self) -> float:
        """Simulated time [s]."""

    def create_service(self, kind: Any, name: str, callback: Any) -> Any:
        """Offer a service, as every node can."""

    def reset(self, *, state: bool = True, time: bool = False) -> None:
        """Put the robot back to its start, or set time to zero, or both."""

    def step(self, count: int = 1) -> None:
        """Advance by some publish periods."""


class SimulationServices:
    """The services whose types every ROS 2 installation has."""

    def __init__(self, node: Controllable) -> None:
        self.node = node
        node.create_service(Trigger, '~/reset', self._on_reset)
        node.create_service(SetBool, '~/pause', self._on_pause)
        node.create_service(Trigger, '~/step', self._on_step)

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self.node.waiting:
            response.message = self.node.waiting
            return response
        self.node.reset()
        response.success = True
        response.message = f'robot is at the start of the scene at t = {self.node.seconds:g} s'
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if not request.data and (self.node.failure or not self.node.world):
            response.message = DIVERGED if self.node.world else standard.NO_WORLD
            return response
        self.node.paused, response.success = request.data, True
        response.message = 'paused' if request.data else 'running'
        return response

    def _on_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self.node.waiting or not self.node.paused:
            why = DIVERGED if self.node.failure else STILL_RUNNING
            response.message = self.node.waiting or why
            return response
        self.node.step()
        why = self.node.failure or self.node.waiting
        response.success = not why
        response.message = why or f't = {self.node.seconds:g} s'
        return response


class StandardServices:
    """The services of simulation_interfaces; a step is one publish period."""

    def __init__(self, node: Controllable, despawn: Callable[[], None] | None) -> None:
        self.node, self.stopped, self.despawn = node, False, despawn
        answers = {
            'GetSimulatorFeatures': self._on_features,
            'GetSimulationState': self._on_get_state,
            'SetSimulationState': self._on_set_state,
            'ResetSimulation': self._on_reset,
            'StepSimulation': self._on_step,
        }
        standard.offer(node, {**answers, **Worlds(node, self._on_loaded).answers})

    @property
    def state(self) -> int:
        """State in the numbers of the standard; stopped until played, paused or stepped."""
        states = standard.messages.SimulationState
        if not self.node.world:
            return int(states.STATE_NO_WORLD)
        if not self.node.paused and not self.node.failure:
            return int(states.STATE_PLAYING)
        stopped = self.stopped and self.node.seconds == 0.0
        return int(states.STATE_STOPPED if stopped else states.STATE_PAUSED)

    def _on_loaded(self) -> None:
        self.stopped = True

    def _on_features(self, _: Any, response: Any) -> Any:
        features = standard.messages.SimulatorFeatures
        # An older version of the package does not have all of them.
        known = [
            getattr(features, name)
            for served, names in FEATURES.items()
            if hasattr(standard.services, served) or hasattr(standard.actions, served)
            for name in names
            if hasattr(features, name)
        ]
        response.features.features = sorted(known)
        response.features.spawn_formats = ['urdf'] if self.despawn else []
        response.features.custom_info = ABOUT
        return response

    def _on_get_state(self, _: Any, response: Any) -> Any:
        response.state.state = self.state
        response.result.result = standard.messages.Result.RESULT_OK
        return response

    def _on_set_state(self, request: Any, response: Any) -> Any:
        states, wanted = standard.messages.SimulationState, request.state.state
        result = response.result
        result.result = standard.messages.Result.RESULT_OK
        if wanted == self.state:
            result.result = type(response).ALREADY_IN_TARGET_STATE
        elif not self.node.world:
            result.result = type(response).STATE_TRANSITION_ERROR
            result.error_message = standard.NO_WORLD
        elif wanted == states.STATE_PLAYING and self.node.failure:
            result.result = type(response).STATE_TRANSITION_ERROR
            result.error_message = f'diverged, reset first: {self.node.failure}'
        elif wanted == states.STATE_STOPPED and self.node.waiting:
            result.result = type(response).STATE_TRANSITION_ERROR
            result.error_message = self.node.waiting
        elif wanted in (states.STATE_PLAYING, states.STATE_PAUSED):
            self.node.paused, self.stopped = wanted == states.STATE_PAUSED, False
        elif wanted == states.STATE_STOPPED:
            self.node.paused = self.stopped = True
            if self.despawn:
                self.despawn()
            self.node.reset(state=True, time=True)
        else:
            result.result = standard.messages.Result.RESULT_FEATURE_UNSUPPORTED
            result.error_message = f'state must be 0 (stopped), 1 (playing) or 2, got {wanted}'
        return response

    def _on_reset(self, request: Any, response: Any) -> Any:
        kind = type(request)
        scope = request.scope or kind.SCOPE_ALL
        time, state = bool(scope & kind.SCOPE_TIME), bool(scope & kind.SCOPE_STATE)
        despawn = self.despawn if scope & kind.SCOPE_SPAWNED else None
        response.result.result = standard.messages.Result.RESULT_OK
        if not (time or state or despawn):
            response.result.result = standard.messages.Result.RESULT_FEATURE_UNSUPPORTED
            response.result.error_message = f'scope must have bit 1, 2 or 4, got {scope}'
        elif self.node.waiting:
            response.result.result = standard.messages.Result.RESULT_OPERATION_FAILED
            response.result.error_message = self.node.waiting
        else:
            if despawn:
                despawn()
            if time or state:
                self.node.reset(state=state, time=time)
        return response

    def _on_step(self, request: Any, response: Any) -> Any:
        result = standard.messages.Result
        response.result.result = result.RESULT_OK
        if self.node.waiting or not self.node.paused:
            response.result.result = result.RESULT_OPERATION_FAILED
            response.result.error_message = self.node.waiting or STILL_RUNNING
            return response
        self.node.step(request.steps)
        if why := self.node.failure or self.node.waiting:
            response.result.result = result.RESULT_OPERATION_FAILED
            response.result.error_message = why
        return response


class ServedSteps:
    """
    The goals of the action ``~/simulate_steps``: steps of a paused simulation, one after another.

    Between two of them the node serves messages, so that a goal can be canceled.

    Parameters
    ----------
    node : SimNode
    kind : type
        The type of the action.

    """

    def __init__(self, node: Controllable, kind: Any) -> None:
        self._node, self._kind = node, kind
        self._goal: Any = None
        self._done = self._wanted = 0
        self._is_canceled = False

    def serve(self) -> None:
        """Serve the action."""
        ActionServer(
            self._node,
            self._kind,
            '~/simulate_steps',
            execute_callback=lambda goal: None,  # Each goal gets one of its own.
            goal_callback=lambda request: GoalResponse.ACCEPT,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
        )

    def _on_accepted(self, goal: Any) -> None:
        if self._goal is not None:
            self._end(goal, 'another goal takes steps')
        elif self._node.waiting or not self._node.paused:
            self._end(goal, self._node.waiting or STILL_RUNNING)
        else:
            self._goal, self._done, self._wanted = goal, 0, goal.request.steps
            self._is_canceled, self._node.between = False, self._advance

    def _on_cancel(self, goal: Any) -> CancelResponse:
        if self._goal is None or self._goal.goal_id != goal.goal_id:
            return CancelResponse.REJECT
        self._is_canceled = True
        return CancelResponse.ACCEPT

    def _advance(self) -> None:
        """Take a step, or end the goal."""
        node, goal = self._node, self._goal
        why = node.failure or node.waiting or ('' if node.paused else 'no longer paused')
        if not (why or self._is_canceled) and self._done < self._wanted:
            node.step()
            why = node.failure or node.waiting
            if not why:
                self._done += 1
                feedback = self._kind.Feedback(
                    completed_steps=self._done, remaining_steps=self._wanted - self._done
                )
                goal.publish_feedback(feedback)
        if why or self._is_canceled or self._done >= self._wanted:
            self._goal, node.between = None, None
            self._end(goal, why, canceled=self._is_canceled and not why)

    def _end(self, goal: Any, why: str, *, canceled: bool = False) -> None:
        """End a goal with a result: an error, if there is a sentence on one."""
        codes = standard.messages.Result

        def finish(goal: Any) -> Any:
            result = self._kind.Result()
            failed = codes.RESULT_OPERATION_FAILED
            result.result.result = failed if why else codes.RESULT_OK
            result.result.error_message = why
            (goal.abort if why else goal.canceled if canceled else goal.succeed)()
            return result

        goal.execute(finish)


def serve_simulation(node: Controllable, despawn: Callable[[], None] | None = None) -> None:
    """Offer the services of a node whose packages are installed; it may despawn entities."""
    SimulationServices(node)
    if standard.services is not None:
        StandardServices(node, despawn)
    if kind := getattr(standard.actions, 'SimulateSteps', None):
        ServedSteps(node, kind).serve()


# ---- pushes and placing -------------------------------------------------------------------------

LATEST = QoSProfile(depth=1)
SEVERAL = QoSProfile(depth=10)  # pushes on several links at once


class Handling:
    """
    Takes pushes and poses.

    Parameters
    ----------
    node : Node
    simulation : Simulation
    settings : Settings
    refusals : Refusals
    moved : callable
        Called when the robot was put elsewhere.

    Attributes
    ----------
    settings : Settings
        The node replaces them when its parameters change.
    refusals : Refusals
    simulation : Simulation
    placing : Placing

    """

    def __init__(
        self,
        node: Node,
        simulation: Simulation,
        settings: Settings,
        refusals: Refusals,
        moved: Callable[[], Any],
    ) -> None:
        self.settings, self.refusals, self._moved = settings, refusals, moved
        self.begin(simulation)
        node.create_subscription(WrenchStamped, '~/push', self._on_push, SEVERAL)
        node.create_subscription(PoseStamped, '~/set_pose', self._on_pose, LATEST)

    def begin(self, simulation: Simulation) -> None:
        """Push and place the robot of a simulation from now on."""
        self.simulation, self.placing = simulation, Placing(simulation, self._moved)

    def limit(self) -> None:
        """End the pushes of messages if the robot moves too fast."""
        if not self.simulation.pushes:
            return
        u = self.simulation.state.u
        speed, spin = (float(np.abs(part).max()) for part in np.split(u, 2, axis=1))
        if not (speed <= FASTEST and spin <= FASTEST_TURN):
            self.simulation.pushes.clear()
            self.refusals.add('push', f'push: ended, since a link moves {too_fast(speed, spin)}')

    def _on_pose(self, message: PoseStamped) -> None:
        pose = message.pose
        try:
            self.placing.rest_at(message.header.frame_id, pose)
        except ParameterError as error:
            self.refusals.add('set_pose', f'set_pose: {error}')

    def _on_push(self, message: WrenchStamped) -> None:
        try:
            self._begin(message)
        except ParameterError as error:
            self.refusals.add('push', f'push: {error}')

    def _begin(self, message: WrenchStamped) -> None:
        robot, frame = self.simulation.scene.robot, message.header.frame_id.rpartition('/')[2]
        force = numbers_of(message.wrench.force, 'xyz', 'force')
        torque = numbers_of(message.wrench.torque, 'xyz', 'torque')
        turns = False
        if frame == BASE and BASE not in robot.link_names:
            raise ParameterError(
                f'the frame {BASE} is not that of a link; link_{robot.middle_link + 1} is there'
            )
        if frame in ('', WORLD, ODOM):
            link = self.settings.pushed_link(robot)
        else:
            link, turns = link_index(frame, robot, 'header.frame_id'), True
            frame_of_link = robot.chain.frame[link]
            force, torque = frame_of_link @ force, frame_of_link @ torque
        self._check(link, force, torque)
        duration = self.settings.push_duration
        self.simulation.pushes.begin(link, force, torque, duration=duration, turns=turns)

    def _check(self, link: int, force: Array, torque: Array) -> None:
        """Raise an error if the link alone would become too fast in a publish period."""
        robot, period = self.simulation.scene.robot, 1.0 / self.settings.publish_rate
        inertia = robot.per_link('inertia_transversal')[link]
        speed = float(np.abs(force).max() / robot.per_link('link_mass')[link]) * period
        spin = float(np.abs(torque).max() / inertia) * period
        if not (speed <= FASTEST and spin <= FASTEST_TURN):
            raise ParameterError(
                f'link {link + 1} alone would, after {period:g} s, move {too_fast(speed, spin)}'
            )

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
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_srvs.srv import SetBool, Trigger

from snake_sim_ros.nodes.executors import Refusals
from snake_sim_ros.nodes.messages import BASE, ODOM, WORLD
from snake_sim_ros.nodes.sim_parameters import Settings
from snake_sim_ros.recording.sensors import link_index
from snake_sim_ros.scene.checked_records import ParameterError, quoted
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.posture import own_poses, pose_of_middle
from snake_sim_ros.scene.robot_description import ROBOT_NAME
from snake_sim_ros.scene.rotations import FLAT, product, rotation_matrices
from snake_sim_ros.stepping.controlled import place
from snake_sim_ros.stepping.simulation import Simulation

try:
    from simulation_interfaces import msg as standard, srv as standard_services
except ImportError:  # The ROS 2 packages on PyPI do not have it.
    standard = standard_services = None

# ---- reset, pause and step ----------------------------------------------------------------------

# Services that control simulated time: ``~/reset``, ``~/pause`` and ``~/step``.
#
# The services of the standard, simulation_interfaces, are offered as well if that package is
# installed.


DIVERGED = 'diverged: call ~/reset first'
STILL_RUNNING = 'not paused: call ~/pause with true first'
FEATURES = (
    *('ENTITY_STATE_GETTING', 'ENTITY_STATE_SETTING'),
    *('SIMULATION_RESET', 'SIMULATION_RESET_TIME', 'SIMULATION_RESET_STATE'),
    *('SIMULATION_STATE_GETTING', 'SIMULATION_STATE_SETTING', 'SIMULATION_STATE_PAUSE'),
    *('STEP_SIMULATION_SINGLE', 'STEP_SIMULATION_MULTIPLE'),
)


class Controllable(Protocol):
    """A node whose simulated time the services control."""

    paused: bool
    failure: str
    compiling: str
    seconds: float

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
        if self.node.compiling:
            response.message = self.node.compiling
            return response
        self.node.reset()
        response.success = True
        response.message = f'robot is at the start of the scene at t = {self.node.seconds:g} s'
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if self.node.failure and not request.data:
            response.message = DIVERGED
            return response
        self.node.paused, response.success = request.data, True
        response.message = 'paused' if request.data else 'running'
        return response

    def _on_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self.node.compiling or not self.node.paused:
            why = DIVERGED if self.node.failure else STILL_RUNNING
            response.message = self.node.compiling or why
            return response
        self.node.step()
        why = self.node.failure or self.node.compiling
        response.success = not why
        response.message = why or f't = {self.node.seconds:g} s'
        return response


class StandardServices:
    """The services of simulation_interfaces; a step is one publish period."""

    def __init__(self, node: Controllable) -> None:
        self.node, self.stopped = node, False
        for name, callback in (
            ('GetSimulatorFeatures', self._on_features),
            ('GetSimulationState', self._on_get_state),
            ('SetSimulationState', self._on_set_state),
            ('ResetSimulation', self._on_reset),
            ('StepSimulation', self._on_step),
        ):
            topic = ''.join('_' + c.lower() if c.isupper() else c for c in name)[1:]
            node.create_service(getattr(standard_services, name), f'~/{topic}', callback)

    @property
    def state(self) -> int:
        """State in the numbers of the standard; stopped until played, paused or stepped."""
        states = standard.SimulationState
        if not self.node.paused and not self.node.failure:
            return int(states.STATE_PLAYING)
        stopped = self.stopped and self.node.seconds == 0.0
        return int(states.STATE_STOPPED if stopped else states.STATE_PAUSED)

    def _on_features(self, _: Any, response: Any) -> Any:
        features = standard.SimulatorFeatures
        # An older version of the package does not have all of them.
        known = [name for name in FEATURES if hasattr(features, name)]
        response.features.features = [getattr(features, name) for name in known]
        response.features.custom_info = 'snake_sim_ros: a step is one publish period'
        return response

    def _on_get_state(self, _: Any, response: Any) -> Any:
        response.state.state = self.state
        response.result.result = standard.Result.RESULT_OK
        return response

    def _on_set_state(self, request: Any, response: Any) -> Any:
        states, wanted, result = standard.SimulationState, request.state.state, response.result
        result.result = standard.Result.RESULT_OK
        if wanted == self.state:
            result.result = type(response).ALREADY_IN_TARGET_STATE
        elif wanted == states.STATE_PLAYING and self.node.failure:
            result.result = type(response).STATE_TRANSITION_ERROR
            result.error_message = f'diverged, reset first: {self.node.failure}'
        elif wanted == states.STATE_STOPPED and self.node.compiling:
            result.result = type(response).STATE_TRANSITION_ERROR
            result.error_message = self.node.compiling
        elif wanted in (states.STATE_PLAYING, states.STATE_PAUSED):
            self.node.paused, self.stopped = wanted == states.STATE_PAUSED, False
        elif wanted == states.STATE_STOPPED:
            self.node.paused = self.stopped = True
            self.node.reset(state=True, time=True)
        else:
            result.result = standard.Result.RESULT_FEATURE_UNSUPPORTED
            result.error_message = f'state must be 0 (stopped), 1 (playing) or 2, got {wanted}'
        return response

    def _on_reset(self, request: Any, response: Any) -> Any:
        kind = type(request)
        scope = request.scope or kind.SCOPE_ALL
        time, state = bool(scope & kind.SCOPE_TIME), bool(scope & kind.SCOPE_STATE)
        response.result.result = standard.Result.RESULT_OK
        if not time and not state:
            response.result.result = standard.Result.RESULT_FEATURE_UNSUPPORTED
            response.result.error_message = f'scope must have bit 1 or 2, got {scope}'
        elif self.node.compiling:
            response.result.result = standard.Result.RESULT_OPERATION_FAILED
            response.result.error_message = self.node.compiling
        else:
            self.node.reset(state=state, time=time)
        return response

    def _on_step(self, request: Any, response: Any) -> Any:
        result = standard.Result
        response.result.result = result.RESULT_OK
        if self.node.compiling or not self.node.paused:
            response.result.result = result.RESULT_OPERATION_FAILED
            response.result.error_message = self.node.compiling or STILL_RUNNING
            return response
        self.node.step(request.steps)
        if why := self.node.failure or self.node.compiling:
            response.result.result = result.RESULT_OPERATION_FAILED
            response.result.error_message = why
        return response


def serve_simulation(node: Controllable) -> None:
    """Offer the services of a node whose packages are installed."""
    SimulationServices(node)
    if standard is not None:
        StandardServices(node)


# ---- pushes and placing -------------------------------------------------------------------------

TURN = np.array([0.0, 0.0, 0.0, 1.0])  # half a turn about z, from the middle link to the base
FASTEST, FASTEST_TURN = 100.0, 50.0  # m/s, rad/s of a link beyond which nothing pushes
FARTHEST = 1e4  # m from the origin where a robot may be put
UNIT_ERROR = 1e-3  # by which the norm of a quaternion may be off 1
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

    """

    def __init__(
        self,
        node: Node,
        simulation: Simulation,
        settings: Settings,
        refusals: Refusals,
        moved: Callable[[], Any],
    ) -> None:
        self.settings, self.refusals = settings, refusals
        self._simulation, self._moved = simulation, moved
        settings.pushed_link(simulation.scene.robot)
        node.create_subscription(WrenchStamped, '~/push', self._on_push, SEVERAL)
        node.create_subscription(PoseStamped, '~/set_pose', self._on_pose, LATEST)

    def limit(self) -> None:
        """End the pushes of messages if the robot moves too fast."""
        if not self._simulation.pushes:
            return
        u = self._simulation.state.u
        speed, spin = (float(np.abs(part).max()) for part in np.split(u, 2, axis=1))
        if not (speed <= FASTEST and spin <= FASTEST_TURN):
            self._simulation.pushes.clear()
            self.refusals.add('push', f'push: ended, since a link moves {too_fast(speed, spin)}')

    def place(self, frame: str, position: Any, orientation: Any) -> None:
        """
        Put the robot where ``base_link`` has a pose.

        Parameters
        ----------
        frame : str
            Name of the frame of the pose.
        position, orientation : Point, Quaternion
            Of geometry_msgs.

        Raises
        ------
        ParameterError
            If the pose is not usable.

        """
        if frame.rpartition('/')[2] not in ('', WORLD, ODOM):
            raise ParameterError(f'the frame must be {WORLD} or {ODOM}, got {quoted(frame)}')
        r = numbers_of(position, 'xyz', 'position')
        if np.abs(r).max() > FARTHEST:
            raise ParameterError(
                f'position must be within {FARTHEST:g} m, got ({", ".join(f"{x:g}" for x in r)}) m'
            )
        x, y, z, w = numbers_of(orientation, 'xyzw', 'orientation')
        norm = float(np.linalg.norm((x, y, z, w)))
        if not abs(norm - 1.0) <= UNIT_ERROR:
            raise ParameterError(
                f'orientation must be a unit quaternion, got a norm of {norm:.4g}'
            )
        p, robot = np.array([w, x, y, z]) / norm, self._simulation.scene.robot
        if robot.links:
            middle = pose_of_middle(robot, self._simulation.state.q, r, p)
            place(self._simulation, *middle)
        else:
            place(self._simulation, r, product(product(p, -TURN), FLAT))
        self._moved()

    def _on_pose(self, message: PoseStamped) -> None:
        pose = message.pose
        try:
            self.place(message.header.frame_id, pose.position, pose.orientation)
        except ParameterError as error:
            self.refusals.add('set_pose', f'set_pose: {error}')

    def _on_push(self, message: WrenchStamped) -> None:
        try:
            self._begin(message)
        except ParameterError as error:
            self.refusals.add('push', f'push: {error}')

    def _begin(self, message: WrenchStamped) -> None:
        robot, frame = self._simulation.scene.robot, message.header.frame_id.rpartition('/')[2]
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
        self._simulation.pushes.begin(link, force, torque, duration=duration, turns=turns)

    def _check(self, link: int, force: Array, torque: Array) -> None:
        """Raise an error if the link alone would become too fast in a publish period."""
        robot, period = self._simulation.scene.robot, 1.0 / self.settings.publish_rate
        inertia = robot.per_link('inertia_transversal')[link]
        speed = float(np.abs(force).max() / robot.per_link('link_mass')[link]) * period
        spin = float(np.abs(torque).max() / inertia) * period
        if not (speed <= FASTEST and spin <= FASTEST_TURN):
            raise ParameterError(
                f'link {link + 1} alone would, after {period:g} s, move {too_fast(speed, spin)}'
            )


def too_fast(speed: float, spin: float) -> str:
    """Return a clause on a speed [m/s] and a spin [rad/s] with which nothing is pushed."""
    return (
        f'at {speed:.4g} m/s and turn at {spin:.4g} rad/s; at most {FASTEST:g} m/s and '
        f'{FASTEST_TURN:g} rad/s'
    )


def base_of_link(quaternion: Array) -> Array:
    """Return the orientation x y z w of ``base_link`` from that of the middle link."""
    x, y, z, w = quaternion
    return np.roll(product(np.array([w, x, y, z]), TURN), -1)


def numbers_of(message: Any, names: str, what: str) -> Array:
    """Return fields of a message as numbers; raise an error if one is not finite."""
    found = np.array([getattr(message, name) for name in names])
    if not np.isfinite(found).all():
        raise ParameterError(f'{what} must be finite, got ({", ".join(f"{x:g}" for x in found)})')
    return found


# ---- entities of simulation_interfaces ----------------------------------------------------------

# The state of the robot and of its links, by the services of simulation_interfaces.
#
# They are offered where that package is installed. The entity `snake_robot`, as the URDF calls it,
# has the pose of ``base_link``, which may be set; links, such as `link_6`, can be asked for.


class EntityServices:
    """
    Offers ``~/get_entity_state`` and ``~/set_entity_state``.

    Parameters
    ----------
    node : Node
    simulation : Simulation
    handling : Handling

    """

    def __init__(self, node: Node, simulation: Simulation, handling: Handling) -> None:
        self._simulation, self._handling = simulation, handling
        for name, callback in (
            ('GetEntityState', self._on_get),
            ('SetEntityState', self._on_set),
        ):
            # Another version of the package may not have it.
            if kind := getattr(standard_services, name, None):
                topic = f'~/{name[:3].lower()}_entity_state'
                node.create_service(kind, topic, callback)

    def _on_get(self, request: Any, response: Any) -> Any:
        robot, codes = self._simulation.scene.robot, standard.Result
        try:
            is_robot = request.entity == ROBOT_NAME
            link = robot.base_link if is_robot else link_index(request.entity, robot, 'entity')
        except ParameterError as error:
            return _answered(response, codes.RESULT_NOT_FOUND, f'{error}, the robot {ROBOT_NAME}')
        everywhere, q = self._simulation.state.q, self._simulation.state.q[link]
        state, u = response.state, self._simulation.state.u[link]
        positions, orientations = own_poses(robot, everywhere)
        quaternion = orientations[link, [1, 2, 3, 0]]
        if is_robot and not robot.links:
            quaternion = base_of_link(quaternion)
        lever = positions[link] - q[:3]
        state.header.frame_id = WORLD
        _fill(state.pose.position, 'xyz', positions[link])
        _fill(state.pose.orientation, 'xyzw', quaternion)
        velocity = u[:3] + np.cross(rotation_matrices(q[3:]) @ u[3:], lever)
        _fill(state.twist.linear, 'xyz', velocity)
        _fill(state.twist.angular, 'xyz', rotation_matrices(q[3:]) @ u[3:])
        return _answered(response, codes.RESULT_OK)

    def _on_set(self, request: Any, response: Any) -> Any:
        codes, state = standard.Result, request.state
        if request.entity != ROBOT_NAME:
            why = f'entity must be {ROBOT_NAME}, got {quoted(request.entity)}'
            return _answered(response, codes.RESULT_NOT_FOUND, why)
        parts = (state.twist.linear, state.twist.angular)
        if any(getattr(part, axis) for part in parts for axis in 'xyz'):
            why = 'a robot is put somewhere at rest: its twist must be 0'
            return _answered(response, codes.RESULT_FEATURE_UNSUPPORTED, why)
        try:
            pose = state.pose
            self._handling.place(state.header.frame_id, pose.position, pose.orientation)
        except ParameterError as error:
            return _answered(response, codes.RESULT_OPERATION_FAILED, str(error))
        return _answered(response, codes.RESULT_OK)


def _fill(message: Any, names: str, values: np.ndarray) -> None:
    for name, value in zip(names, values.tolist(), strict=True):
        setattr(message, name, value)


def _answered(response: Any, code: int, why: str = '') -> Any:
    response.result.result, response.result.error_message = code, why
    return response


def serve_entities(node: Node, simulation: Simulation, handling: Handling) -> None:
    """Offer the services of entities where simulation_interfaces is installed."""
    if standard is not None:
        EntityServices(node, simulation, handling)

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The entities of a simulation, by the services of simulation_interfaces.

They are offered where that package is installed. The entity `snake_robot`, as the URDF calls it,
has pose and twist of ``base_link``, which may be set. Pegs of the scene are `peg_1` and so on, and
stay where they are. More robots and pegs may be spawned and deleted, see `spawning`. The state of
a link, such as `link_6`, or `two/link_6` of a robot `two`, can be asked for under its name, too.
"""

from collections.abc import Callable, Mapping
import re
from typing import Any, NamedTuple

from geometry_msgs.msg import Vector3
import numpy as np

from snake_sim_ros.nodes import standard
from snake_sim_ros.nodes.live_robot import LiveRobot
from snake_sim_ros.nodes.messages import stamp_from, WORLD
from snake_sim_ros.nodes.placing import base_pose, base_twist, UnusablePose
from snake_sim_ros.nodes.spawning import Spawning
from snake_sim_ros.nodes.standard import answered, Refused
from snake_sim_ros.recording.sensors import link_index
from snake_sim_ros.scene.checked_records import cut, ParameterError, quoted
from snake_sim_ros.scene.obstacles import PEG_HEIGHT
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.posture import own_poses
from snake_sim_ros.scene.robot_description import ROBOT_NAME
from snake_sim_ros.scene.rotations import rotation_matrices

LONGEST_FILTER = 200  # characters of a regular expression
STILL = np.zeros(3)


class EntityState(NamedTuple):
    """Where an entity is and how it moves, in the world."""

    position: Array  # (3,) [m]
    orientation: Array  # (4,) x y z w
    velocity: Array = STILL  # (3,) [m/s]
    spin: Array = STILL  # (3,) [rad/s]


class EntityServices:
    """
    What is answered to requests on entities.

    Parameters
    ----------
    robots : mapping
        Name -> LiveRobot, first that of the scene.
    spawning : Spawning
        Knows the pegs.

    Attributes
    ----------
    answers : mapping
        Services by the names of their types -> what answers them.

    """

    def __init__(self, robots: Mapping[str, LiveRobot], spawning: Spawning) -> None:
        self._robots, self._spawning = robots, spawning
        self.answers: Mapping[str, standard.Answer] = {
            'GetEntities': self._on_list,
            'GetEntityInfo': self._on_info,
            'GetEntityState': self._on_state,
            'GetEntitiesStates': self._on_states,
            'GetEntityBounds': self._on_bounds,
            'SetEntityState': self._on_set,
        }

    @property
    def names(self) -> list[str]:
        """Names of all entities."""
        return [*self._robots, *self._spawning.pegs]

    # ---- requests -------------------------------------------------------------------------------

    def _on_list(self, request: Any, response: Any) -> Any:
        try:
            response.entities = self._filtered(request.filters)
        except Refused as error:
            return answered(response, error.code, str(error))
        return answered(response, standard.messages.Result.RESULT_OK)

    def _on_states(self, request: Any, response: Any) -> Any:
        self._on_list(request, response)
        for name in response.entities:
            response.states.append(standard.messages.EntityState())
            self._fill(response.states[-1], self._state(name))
        return response

    def _on_info(self, request: Any, response: Any) -> Any:
        if why := self._unknown(request.entity):
            return answered(response, standard.messages.Result.RESULT_NOT_FOUND, why)
        info, kinds = response.info, standard.messages.EntityCategory
        if request.entity in self._robots:
            robot = self._robots[request.entity].simulation.scene.robot
            info.category.category = kinds.CATEGORY_ROBOT
            info.description = (
                f'snake robot of {robot.link_count} links and {len(robot.axis_names)} joint axes'
            )
        else:
            info.category.category = kinds.CATEGORY_STATIC_OBJECT
            info.description = 'round vertical post, fixed to the ground'
        return answered(response, standard.messages.Result.RESULT_OK)

    def _on_state(self, request: Any, response: Any) -> Any:
        codes = standard.messages.Result
        try:
            state = self._state(request.entity)
        except ParameterError as error:
            why = f'{error}, the robot {ROBOT_NAME}'
            return answered(response, codes.RESULT_NOT_FOUND, why)
        self._fill(response.state, state)
        return answered(response, codes.RESULT_OK)

    def _on_bounds(self, request: Any, response: Any) -> Any:
        if why := self._unknown(request.entity):
            return answered(response, standard.messages.Result.RESULT_NOT_FOUND, why)
        low, high = self._box(request.entity, of_entity=True)
        bounds = response.bounds
        bounds.type = standard.messages.Bounds.TYPE_BOX
        bounds.points = [vector(high), vector(low)]
        return answered(response, standard.messages.Result.RESULT_OK)

    def _on_set(self, request: Any, response: Any) -> Any:
        codes, state = standard.messages.Result, request.state
        if request.entity not in self._robots:
            if self._unknown(request.entity):
                why = f'entity must be {ROBOT_NAME}, got {quoted(request.entity)}'
                return answered(response, codes.RESULT_NOT_FOUND, why)
            why = f'{request.entity} is fixed to the ground'
            return answered(response, codes.RESULT_OPERATION_FAILED, why)
        # Version 1 of the package has no flags: all is set.
        pose, twist, acceleration = (
            getattr(request, f'set_{what}', default)
            for what, default in (('pose', True), ('twist', True), ('acceleration', False))
        )
        if acceleration and any(numbers_in(state.acceleration)):
            why = 'accelerations follow from forces, which ~/push gives a link'
            return answered(response, codes.RESULT_FEATURE_UNSUPPORTED, why)
        try:
            self._robots[request.entity].handling.placing.put(
                state.header.frame_id,
                pose=state.pose if pose else None,
                twist=state.twist if twist else None,
            )
        except UnusablePose as error:
            code = getattr(type(response), 'INVALID_POSE', codes.RESULT_OPERATION_FAILED)
            return answered(response, code, str(error))
        except ParameterError as error:
            return answered(response, codes.RESULT_OPERATION_FAILED, str(error))
        return answered(response, codes.RESULT_OK)

    # ---- entities -------------------------------------------------------------------------------

    def _unknown(self, name: str) -> str:
        """Return a sentence if there is no entity with a name, else ''."""
        if name in self.names:
            return ''
        return f'no entity {quoted(name)}; GetEntities lists all {len(self.names)}'

    def _state(self, name: str) -> EntityState:
        """Return the state of an entity or a link."""
        if name in self._spawning.pegs:
            x, y, _ = self._axis(name)
            return EntityState(np.array([x, y, 0.0]), np.array([0.0, 0.0, 0.0, 1.0]))
        owner, _, link_name = name.rpartition('/')
        found = self._robots.get(name) or self._robots.get(owner or ROBOT_NAME)
        if found is None:
            raise ParameterError(f'entity: no robot {quoted(owner)}')
        robot, state = found.simulation.scene.robot, found.simulation.state
        if name in self._robots:
            return EntityState(*base_pose(robot, state), *base_twist(robot, state))
        link = link_index(link_name, robot, 'entity')
        positions, orientations = own_poses(robot, state.q)
        twist = base_twist(robot, state, link)
        return EntityState(positions[link], orientations[link, [1, 2, 3, 0]], *twist)

    def _fill(self, message: Any, state: EntityState) -> None:
        """Fill an EntityState of now."""
        message.header.stamp = stamp_from(self._robots[ROBOT_NAME].nanoseconds)
        message.header.frame_id = WORLD
        fill(message.pose.position, 'xyz', state.position)
        fill(message.pose.orientation, 'xyzw', state.orientation)
        fill(message.twist.linear, 'xyz', state.velocity)
        fill(message.twist.angular, 'xyz', state.spin)

    def _axis(self, peg: str) -> Array:
        """Return x, y and radius of a peg, shape (3,) [m]."""
        axes = self._robots[ROBOT_NAME].simulation.scene.pegs.axes
        return np.asarray(axes[self._spawning.pegs.index(peg)])

    def _box(self, name: str, *, of_entity: bool) -> tuple[Array, Array]:
        """Return the corners of a box around an entity, in its own frame or in the world [m]."""
        if name not in self._robots:
            *place, radius = self._axis(name)
            center = np.zeros(2) if of_entity else np.array(place)
            robot = self._robots[ROBOT_NAME].simulation.scene.robot
            height = PEG_HEIGHT * robot.per_link('contact_radius').max()
            return np.append(center - radius, 0.0), np.append(center + radius, height)
        simulation = self._robots[name].simulation
        scene, state = simulation.scene, simulation.state
        ends, radius = link_ends(scene, state.q)
        if of_entity:
            position, (x, y, z, w) = base_pose(scene.robot, state)
            ends = (ends - position) @ rotation_matrices(np.array([w, x, y, z]))
        reach = radius[:, None]
        return (ends - reach).min(axis=0), (ends + reach).max(axis=0)

    def _filtered(self, filters: Any) -> list[str]:
        """Return the names that pass filters; raise Refused if one is not usable."""
        codes, kinds = standard.messages.Result, standard.messages.EntityCategory
        if len(filters.filter) > LONGEST_FILTER:
            raise Refused(
                codes.RESULT_OPERATION_FAILED,
                f'filter may have {LONGEST_FILTER} characters, got {len(filters.filter)}',
            )
        try:
            wanted = re.compile(filters.filter)
        except re.error as error:
            raise Refused(
                codes.RESULT_OPERATION_FAILED,
                f'filter {quoted(cut(filters.filter))} is no regular expression: {error}',
            ) from None
        if filters.tags.tags:
            raise Refused(codes.RESULT_FEATURE_UNSUPPORTED, 'entities have no tags')
        categories = {item.category for item in filters.categories}
        try:
            overlaps = overlap_of(filters.bounds)
        except ParameterError as error:
            raise Refused(codes.RESULT_FEATURE_UNSUPPORTED, str(error)) from None

        def passes(name: str) -> bool:
            is_robot = name in self._robots
            category = kinds.CATEGORY_ROBOT if is_robot else kinds.CATEGORY_STATIC_OBJECT
            if (categories and category not in categories) or not wanted.search(name):
                return False
            return overlaps is None or overlaps(*self._box(name, of_entity=False))

        return [name for name in self.names if passes(name)]


def overlap_of(bounds: Any) -> Callable[[Array, Array], bool] | None:
    """Return a function that tells whether a box overlaps with bounds; None without bounds."""
    kinds = standard.messages.Bounds
    if bounds.type == kinds.TYPE_EMPTY:
        return None
    points = np.array([numbers_in(point) for point in bounds.points]).reshape(-1, 3)
    if bounds.type not in (kinds.TYPE_BOX, kinds.TYPE_SPHERE):
        raise ParameterError('bounds must be a box or a sphere')
    if len(points) != 2 or not np.isfinite(points).all():
        raise ParameterError(f'bounds must have 2 finite points, got {len(points)}')
    if bounds.type == kinds.TYPE_BOX:
        lower, upper = points.min(axis=0), points.max(axis=0)
        return lambda low, high: bool((low <= upper).all() and (high >= lower).all())
    center, radius = points[0], points[1, 0]
    return lambda low, high: bool(
        np.linalg.norm(np.clip(center, low, high) - center) <= radius  # of the nearest point
    )


def link_ends(scene: Scene, q: Array) -> tuple[Array, Array]:
    """Return the ends of the axes of all capsules [m, frame I], (k, 3), and radii (k,) [m]."""
    capsules = scene.robot.chain.capsules
    R, r = rotation_matrices(q[capsules.link, 3:]), q[capsules.link, :3]
    if not len(r):  # A robot may have no shapes.
        return q[:, :3], np.zeros(len(q))
    half = capsules.half[:, None] * capsules.axis
    ends = [r + np.einsum('kij,kj->ki', R, capsules.center + way) for way in (half, -half)]
    return np.concatenate(ends), np.tile(capsules.radius, 2)


# ---- messages -----------------------------------------------------------------------------------


def fill(message: Any, names: str, values: Array) -> None:
    """Fill fields of a message with numbers."""
    for name, value in zip(names, values.tolist(), strict=True):
        setattr(message, name, value)


def vector(values: Array) -> Vector3:
    """Return a Vector3."""
    return Vector3(**dict(zip('xyz', values.tolist(), strict=True)))


def numbers_in(message: Any) -> list[float]:
    """Return the numbers of a Vector3, or of both in an Accel."""
    if hasattr(message, 'linear'):
        return [*numbers_in(message.linear), *numbers_in(message.angular)]
    return [message.x, message.y, message.z]


def serve_entities(node: Any, robots: Mapping[str, LiveRobot], spawning: Spawning) -> None:
    """Offer the services of entities of a node where simulation_interfaces is installed."""
    answers = EntityServices(robots, spawning).answers
    standard.offer_with_world(node, {**answers, **spawning.answers})

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What is spawned and deleted while `sim` runs, by the services of simulation_interfaces.

A peg is a round vertical post of any height. Its resource is the URI `peg`, or a URDF of one link
that is a cylinder, as text or as a file. The first peg of a scene needs other machine code:
simulated time waits for it.

A robot with the URI `snake_robot` is another one like that of the scene, among the same obstacles,
with the topics of a namespace. Robots do not touch each other.
"""

from collections.abc import Mapping
from dataclasses import replace
from io import StringIO
import math
from pathlib import Path
from typing import Any, NamedTuple, Protocol
from xml.etree import ElementTree

from geometry_msgs.msg import PoseStamped
import numpy as np
from rclpy.exceptions import InvalidNamespaceException
from rclpy.validate_namespace import validate_namespace

from snake_sim_ros.dynamics.force_directions import scene_gaps
from snake_sim_ros.nodes import standard
from snake_sim_ros.nodes.live_robot import LiveRobot
from snake_sim_ros.nodes.placing import check_frame, FARTHEST, numbers_of, UNIT_ERROR
from snake_sim_ros.nodes.standard import Refused
from snake_sim_ros.nodes.worlds import path_of
from snake_sim_ros.scene.checked_records import cut, ParameterError, quoted
from snake_sim_ros.scene.files import is_file, read_text
from snake_sim_ros.scene.parameters import Array, Pegs, Scene
from snake_sim_ros.scene.robot_description import ROBOT_NAME
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.scene.urdf_elements import read

PEG = 'peg_'
URI = 'peg'
RADIUS = 0.05  # m, of a peg without a URDF
UPRIGHT = 0.05  # rad by which a peg may be tilted
INSIDE = 1e-6  # m by which a link may be inside a peg that is spawned
MOST = 200  # pegs
MOST_ROBOTS = 20
KNOWN = f'{URI}, {ROBOT_NAME} or a file that ends with .urdf'
WANTED = 'a peg is a URDF of one link that is a cylinder'
FURTHER = f'further robots are like that of the scene, with the uri {ROBOT_NAME}'


class Post(NamedTuple):
    """A peg as its resource describes it."""

    name: str = ''
    radius: float = RADIUS  # [m]
    pose: Array = np.eye(4)  # of its axis in the frame of the entity


class Inhabited(Protocol):
    """A node in whose world robots and pegs are spawned."""

    robots: dict[str, LiveRobot]

    @property
    def waiting(self) -> str:
        """A sentence on what simulated time waits for; empty: nothing."""

    def get_namespace(self) -> str:
        """Return the namespace, as every node does."""

    def change_obstacles(self, scene: Scene) -> None:
        """Continue with other obstacles."""

    def spawn_robot(self, name: str, namespace: str, stamped: PoseStamped) -> None:
        """Add a robot; raise ParameterError if it cannot be there."""

    def delete_robot(self, name: str) -> None:
        """Remove a robot that was spawned."""


class Spawning:
    """
    Spawns and deletes pegs and robots of a world.

    Parameters
    ----------
    world : Inhabited

    Attributes
    ----------
    pegs : list of str
        Names of all pegs, in the order of the scene.
    answers : mapping
        Services by the names of their types -> what answers them.

    """

    def __init__(self, world: Inhabited) -> None:
        self._world = world
        self.answers: Mapping[str, standard.Answer] = {
            'SpawnEntity': self._on_spawn,
            'SpawnEntities': self._on_spawn_several,
            'DeleteEntity': self._on_delete,
            'GetSpawnables': self._on_spawnables,
        }
        self.begin()

    def begin(self) -> None:
        """Name the pegs of the scene, none of which is spawned."""
        self.pegs = [f'{PEG}{k + 1}' for k in range(len(self._scene.pegs.x))]
        self._own = set(self.pegs)  # those that are not spawned

    @property
    def _scene(self) -> Scene:
        return self._world.robots[ROBOT_NAME].scene

    def despawn(self) -> None:
        """Remove all that was spawned."""
        self.delete_robots()
        kept = [k for k, name in enumerate(self.pegs) if name in self._own]
        if len(kept) < len(self.pegs):
            self._keep(kept)

    def delete_robots(self) -> None:
        """Remove all robots that were spawned."""
        for name in list(self._world.robots):
            if name != ROBOT_NAME:
                self._world.delete_robot(name)

    # ---- requests -------------------------------------------------------------------------------

    def _on_spawn(self, request: Any, response: Any) -> Any:
        self._spawn(request, response, type(response))
        return response

    def _on_spawn_several(self, request: Any, response: Any) -> Any:
        codes = standard.messages.Result
        response.result.result = codes.RESULT_OK
        for item in request.spawn_requests:
            result = standard.messages.SpawnResult()
            self._spawn(item, result, standard.messages.SpawnResult)
            response.results.append(result)
            if result.result.result != codes.RESULT_OK:
                response.result.result = type(response).ENTITIES_SPAWN_FAILED
        return response

    def _on_delete(self, request: Any, response: Any) -> Any:
        codes, result, name = standard.messages.Result, response.result, request.entity
        result.result = codes.RESULT_OK
        if name in self.pegs:
            self._keep([k for k, other in enumerate(self.pegs) if other != name])
        elif name == ROBOT_NAME:
            result.result = codes.RESULT_OPERATION_FAILED
            result.error_message = f'{ROBOT_NAME} stays: it is the robot of the scene'
        elif name in self._world.robots:
            self._world.delete_robot(name)
        else:
            result.result = codes.RESULT_NOT_FOUND
            result.error_message = f'no entity {quoted(name)}'
        return response

    def _on_spawnables(self, request: Any, response: Any) -> Any:
        for uri, what in (
            (URI, f'round vertical post of any height, radius {RADIUS:g} m'),
            (ROBOT_NAME, 'another robot like that of the scene, in a namespace'),
        ):
            response.spawnables.append(standard.messages.Spawnable(description=what))
            response.spawnables[-1].entity_resource.uri = uri
        response.result.result = standard.messages.Result.RESULT_OK
        if request.sources:
            response.result.error_message = f'not looked at: {", ".join(request.sources)}'
        return response

    def _spawn(self, request: Any, response: Any, codes: Any) -> None:
        """Spawn a peg or a robot, or fill the result with the reason why not."""
        result, resource = response.result, request.entity_resource
        try:
            if resource.uri == ROBOT_NAME:
                name = self._free_name(request, ROBOT_NAME, request.name, codes)
                self._add_robot(name, request, codes)
            else:
                post = post_of(resource, codes)
                name = self._free_name(request, URI, request.name or post.name, codes)
                self._add(name, *place_of(request.initial_pose, post, codes), post.radius, codes)
        except Refused as error:
            result.result, result.error_message = error.code, str(error)
            return
        result.result, response.entity_name = standard.messages.Result.RESULT_OK, name

    def _free_name(self, request: Any, kind: str, name: str, codes: Any) -> str:
        """Return the name of what is new, which may be taken or empty, if it may be renamed."""
        taken = {*self._world.robots, *self.pegs}
        if name and name not in taken:
            if not name.replace('_', '').isalnum() or len(name) > 100:
                raise Refused(codes.NAME_INVALID, f'{quoted(name)} must be letters, digits and _')
            return name
        if not request.allow_renaming:
            code = codes.NAME_NOT_UNIQUE if name else codes.NAME_INVALID
            raise Refused(code, f'there is {name} already' if name else f'a {kind} needs a name')
        numbers = (f'{name or kind}_{k}' for k in range(1, len(taken) + 2))
        return next(each for each in numbers if each not in taken)

    def _add_robot(self, name: str, request: Any, codes: Any) -> None:
        """Add a robot in a namespace, by default of its name, below that of the node."""
        robots, below = self._world.robots, request.entity_namespace.strip('/') or name
        namespace = f'{self._world.get_namespace().rstrip("/")}/{below}'
        failed = standard.messages.Result.RESULT_OPERATION_FAILED
        try:
            validate_namespace(namespace)
        except InvalidNamespaceException:
            raise Refused(
                codes.NAMESPACE_INVALID,
                f'{quoted(below)} must be letters, digits and _, or such names with / between '
                f'them; none begins with a digit',
            ) from None
        if any(robot.node.get_namespace() == namespace for robot in robots.values()):
            raise Refused(codes.NAMESPACE_INVALID, f'there is a robot in {namespace} already')
        if self._world.waiting or len(robots) >= MOST_ROBOTS:
            most = f'there may be at most {MOST_ROBOTS} robots'
            raise Refused(failed, self._world.waiting or most)
        try:
            self._world.spawn_robot(name, namespace, request.initial_pose)
        except ParameterError as error:
            raise Refused(codes.INVALID_POSE, str(error)) from None

    def _add(self, name: str, x: float, y: float, radius: float, codes: Any) -> None:
        """Put a peg into the scene."""
        scene, failed = self._scene, standard.messages.Result.RESULT_OPERATION_FAILED
        if len(self.pegs) >= MOST:
            raise Refused(failed, f'there may be at most {MOST} pegs')
        axes = np.vstack([scene.pegs.axes, (x, y, radius)])
        new = replace(scene, pegs=pegs_at(scene.pegs, axes))
        for robot in self._world.robots.values():
            before, after = (scene_gaps(each, robot.simulation.state.q) for each in (scene, new))
            if after.min() < min(-INSIDE, before.min(initial=0.0)):
                raise Refused(codes.INVALID_POSE, f'a robot is {-after.min():.3g} m inside it')
        try:
            self._world.change_obstacles(new)
        except ParameterError as error:
            raise Refused(failed, str(error)) from None
        self.pegs.append(name)

    def _keep(self, kept: list[int]) -> None:
        """Remove all pegs but some."""
        scene = self._scene
        new = replace(scene, pegs=pegs_at(scene.pegs, scene.pegs.axes[kept]))
        self._world.change_obstacles(new)
        self.pegs = [self.pegs[k] for k in kept]


def pegs_at(pegs: Pegs, axes: Any) -> Pegs:
    """Return pegs with other axes and radii (k, 3) [m]."""
    x, y, radius = (tuple(column.tolist()) for column in np.reshape(axes, (-1, 3)).T)
    return replace(pegs, x=x, y=y, radius=radius or RADIUS)


def post_of(resource: Any, codes: Any) -> Post:
    """Return the peg that is a resource; raise Refused if it is none."""
    if resource.uri == URI:
        return Post()
    if not (resource.uri or resource.resource_string):
        raise Refused(codes.NO_RESOURCE, f'uri must be {KNOWN}, or resource_string a URDF')
    text = text_of(resource.uri, codes) if resource.uri else resource.resource_string
    root = root_of(text)
    if root is not None and root.tag != 'robot':
        raise Refused(
            codes.UNSUPPORTED_FORMAT, f'it must be a URDF, <robot>, got <{cut(root.tag)}>'
        )
    try:
        parts, hinges, _ = read(text)
    except ParameterError as error:
        raise Refused(codes.RESOURCE_PARSE_ERROR, f'the URDF: {error}') from None
    solids = [solid for part in parts for solid in part.solids]
    kinds = ', '.join(solid.kind for solid in solids) or 'no shape'
    if any(solid.kind == 'mesh' for solid in solids):
        raise Refused(codes.UNSUPPORTED_ASSETS, f'{WANTED}, got a mesh')
    if hinges or len(parts) > 1 or kinds != 'cylinder':
        unsupported = standard.messages.Result.RESULT_FEATURE_UNSUPPORTED
        got = f'{len(parts)} links' if len(parts) > 1 else kinds
        raise Refused(unsupported, f'{WANTED}, got {got}; {FURTHER}')
    name = '' if root is None else root.get('name', '')
    return Post(name, float(solids[0].size[0]), solids[0].pose)


def text_of(uri: str, codes: Any) -> str:
    """Return the text of the URDF at a URI; raise Refused if there is none."""
    path, missing = Path(path_of(uri)), standard.messages.Result.RESULT_NOT_FOUND
    if path.suffix != '.urdf':
        raise Refused(codes.UNSUPPORTED_FORMAT, f'uri must be {KNOWN}, got {quoted(uri)}')
    try:
        if is_file(path):
            return read_text(path)
    except ParameterError as error:
        raise Refused(missing, str(error)) from None
    raise Refused(missing, f'there is no file {quoted(str(path))}')


def root_of(text: str) -> ElementTree.Element | None:
    """Return the first element of XML, without what is in it; None if it is no XML."""
    try:
        _, root = next(ElementTree.iterparse(StringIO(text), ['start']))
    except (ElementTree.ParseError, StopIteration, ValueError):
        return None
    return root


def place_of(stamped: Any, post: Post, codes: Any) -> tuple[float, float]:
    """Return x and y of the axis of an upright peg in the world [m]."""
    try:
        check_frame(stamped.header.frame_id)
        place = numbers_of(stamped.pose.position, 'xyz', 'position')
        x, y, z, w = numbers_of(stamped.pose.orientation, 'xyzw', 'orientation')
        norm = float(np.linalg.norm((x, y, z, w)))
        if not abs(norm - 1.0) <= UNIT_ERROR:
            raise ParameterError(f'orientation must be a unit quaternion, got norm {norm:.4g}')
        turn = rotation_matrices(np.array([w, x, y, z]) / norm)
        tilt = math.acos(min(1.0, abs((turn @ post.pose[:3, 2])[2])))
        if tilt > UPRIGHT:
            raise ParameterError(f'a peg must stand upright, got a tilt of {tilt:.3g} rad')
        place += turn @ post.pose[:3, 3]
        if np.abs(place[:2]).max() > FARTHEST:
            raise ParameterError(
                f'position must be within {FARTHEST:g} m, got ({place[0]:g}, {place[1]:g}) m'
            )
    except ParameterError as error:
        raise Refused(codes.INVALID_POSE, str(error)) from None
    return float(place[0]), float(place[1])

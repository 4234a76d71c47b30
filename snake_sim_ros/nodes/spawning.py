# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Pegs that are spawned and deleted while `sim` runs, by the services of simulation_interfaces.

A peg is a round vertical post of any height. Its resource is the URI `peg`, or a URDF of one link
that is a cylinder. The first peg of a scene needs other machine code: simulated time waits for it.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from snake_sim_ros.dynamics.force_directions import scene_gaps
from snake_sim_ros.nodes import standard
from snake_sim_ros.nodes.placing import check_frame, FARTHEST, numbers_of, UNIT_ERROR
from snake_sim_ros.nodes.standard import Refused
from snake_sim_ros.scene.checked_records import ParameterError, quoted
from snake_sim_ros.scene.parameters import Pegs, Scene
from snake_sim_ros.scene.robot_description import ROBOT_NAME
from snake_sim_ros.scene.urdf_elements import read
from snake_sim_ros.stepping.simulation import Simulation

PEG = 'peg_'
URI = 'peg'
RADIUS = 0.05  # m, of a peg without a URDF
UPRIGHT = 1e-3  # by which the cosine of the tilt of a peg may be off 1
INSIDE = 1e-6  # m by which a link may be inside a peg that is spawned
MOST = 200  # pegs


class SpawnedPegs:
    """
    The pegs of a simulation by their names.

    Parameters
    ----------
    simulation : Simulation
    scene : callable
        Returns the scene that `change` changes.
    change : callable
        Continues with another scene.

    Attributes
    ----------
    names : list of str
        Of all pegs, in the order of the scene.
    answers : mapping
        Services by the names of their types -> what answers them.

    """

    def __init__(
        self, simulation: Simulation, scene: Callable[[], Scene], change: Callable[[Scene], None]
    ) -> None:
        self._scene, self._change = scene, change
        self.answers: Mapping[str, standard.Answer] = {
            'SpawnEntity': self._on_spawn,
            'SpawnEntities': self._on_spawn_several,
            'DeleteEntity': self._on_delete,
            'GetSpawnables': self._on_spawnables,
        }
        self.begin(simulation)

    def begin(self, simulation: Simulation) -> None:
        """Name the pegs of a simulation, none of which is spawned."""
        self._simulation = simulation
        self.names = [f'{PEG}{k + 1}' for k in range(len(simulation.scene.pegs.x))]
        self._own = set(self.names)  # those that are not spawned

    def despawn(self) -> None:
        """Remove all pegs that were spawned."""
        kept = [k for k, name in enumerate(self.names) if name in self._own]
        if len(kept) < len(self.names):
            self._keep(kept)

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
        if name in self.names:
            self._keep([k for k, other in enumerate(self.names) if other != name])
        elif name == ROBOT_NAME:
            result.result = codes.RESULT_OPERATION_FAILED
            result.error_message = f'{ROBOT_NAME} stays: only pegs can be deleted'
        else:
            result.result = codes.RESULT_NOT_FOUND
            result.error_message = f'no entity {quoted(name)}'
        return response

    def _on_spawnables(self, request: Any, response: Any) -> Any:
        spawnable = standard.messages.Spawnable()
        spawnable.entity_resource.uri = URI
        spawnable.description = f'round vertical post of any height, radius {RADIUS:g} m'
        response.spawnables = [spawnable]
        response.result.result = standard.messages.Result.RESULT_OK
        if request.sources:
            response.result.error_message = f'not looked at: {", ".join(request.sources)}'
        return response

    # ---- pegs -----------------------------------------------------------------------------------

    def _spawn(self, request: Any, response: Any, codes: Any) -> None:
        """Spawn a peg, or fill the result with the reason why not."""
        result = response.result
        try:
            name = self._free_name(request, codes)
            radius = radius_of(request.entity_resource, codes)
            x, y = place_of(request.initial_pose, codes)
            self._add(name, x, y, radius, codes)
        except Refused as error:
            result.result, result.error_message = error.code, str(error)
            return
        result.result, response.entity_name = standard.messages.Result.RESULT_OK, name

    def _free_name(self, request: Any, codes: Any) -> str:
        """Return the name of a new peg."""
        taken, name = {ROBOT_NAME, *self.names}, request.name
        if name and name not in taken:
            if not name.replace('_', '').isalnum() or len(name) > 100:
                raise Refused(codes.NAME_INVALID, f'{quoted(name)} must be letters, digits and _')
            return str(name)
        if not request.allow_renaming:
            code = codes.NAME_NOT_UNIQUE if name else codes.NAME_INVALID
            raise Refused(code, f'there is {name} already' if name else 'a peg needs a name')
        numbers = (f'{name or PEG.rstrip("_")}_{k}' for k in range(1, MOST + 2))
        return next(each for each in numbers if each not in taken)

    def _add(self, name: str, x: float, y: float, radius: float, codes: Any) -> None:
        """Put a peg into the scene."""
        scene, failed = self._scene(), standard.messages.Result.RESULT_OPERATION_FAILED
        if len(self.names) >= MOST:
            raise Refused(failed, f'there may be at most {MOST} pegs')
        axes = np.vstack([scene.pegs.axes, (x, y, radius)])
        new = replace(scene, pegs=pegs_at(scene.pegs, axes))
        before, after = (scene_gaps(each, self._simulation.state.q) for each in (scene, new))
        if after.min() < min(-INSIDE, before.min(initial=0.0)):
            raise Refused(codes.INVALID_POSE, f'the robot is {-after.min():.3g} m inside it')
        try:
            self._change(new)
        except ParameterError as error:
            raise Refused(failed, str(error)) from None
        self.names.append(name)

    def _keep(self, kept: list[int]) -> None:
        """Remove all pegs but some."""
        scene = self._scene()
        self._change(replace(scene, pegs=pegs_at(scene.pegs, scene.pegs.axes[kept])))
        self.names = [self.names[k] for k in kept]


def pegs_at(pegs: Pegs, axes: Any) -> Pegs:
    """Return pegs with other axes and radii (k, 3) [m]."""
    x, y, radius = (tuple(column.tolist()) for column in np.reshape(axes, (-1, 3)).T)
    return replace(pegs, x=x, y=y, radius=radius or RADIUS)


def radius_of(resource: Any, codes: Any) -> float:
    """Return the radius of the peg that is a resource [m]."""
    if not (resource.uri or resource.resource_string):
        raise Refused(codes.NO_RESOURCE, f'uri must be {URI}, or resource_string a URDF')
    if resource.uri:
        if resource.uri != URI:
            raise Refused(codes.UNSUPPORTED_FORMAT, f'uri must be {URI}, got {resource.uri[:100]}')
        return RADIUS
    try:
        parts, hinges, _ = read(resource.resource_string)
    except ParameterError as error:
        raise Refused(codes.RESOURCE_PARSE_ERROR, str(error)) from None
    solids = [solid for part in parts for solid in part.solids]
    if hinges or len(solids) != 1 or solids[0].kind != 'cylinder':
        raise Refused(codes.UNSUPPORTED_FORMAT, 'the URDF must be of one link that is a cylinder')
    return float(solids[0].size[0])


def place_of(stamped: Any, codes: Any) -> tuple[float, float]:
    """Return x and y of an upright pose in the world [m]."""
    try:
        check_frame(stamped.header.frame_id)
        x, y, _ = numbers_of(stamped.pose.position, 'xyz', 'position')
        turned = numbers_of(stamped.pose.orientation, 'xyzw', 'orientation')
        if not abs(np.linalg.norm(turned) - 1.0) <= UNIT_ERROR:
            raise ParameterError('orientation must be a unit quaternion')
        if 1.0 - 2.0 * (turned[0] ** 2 + turned[1] ** 2) < 1.0 - UPRIGHT:
            raise ParameterError('a peg must stand upright')
        if max(abs(x), abs(y)) > FARTHEST:
            raise ParameterError(f'position must be within {FARTHEST:g} m')
    except ParameterError as error:
        raise Refused(codes.INVALID_POSE, str(error)) from None
    return float(x), float(y)

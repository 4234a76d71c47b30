# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The state of the robot and of its links, by the services of simulation_interfaces.

They are offered where that package is installed. The entity `snake_robot`, as the URDF calls it,
has the pose of ``base_link``, which may be set; links, such as `link_6`, can be asked for.
"""

from typing import Any

import numpy as np
from rclpy.node import Node

from snake_sim_ros.nodes.handling import base_of_link, Handling
from snake_sim_ros.nodes.state_messages import WORLD
from snake_sim_ros.recording.from_messages import TO_WIRE
from snake_sim_ros.recording.sensors import link_index
from snake_sim_ros.scene.checked_records import ParameterError, quoted
from snake_sim_ros.scene.robot_description import ROBOT_NAME
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.simulation import Simulation

try:
    from simulation_interfaces import msg as standard, srv as standard_services
except ImportError:  # The ROS 2 packages on PyPI do not have it.
    standard = standard_services = None


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
            link = (
                robot.middle_link
                if is_robot
                else link_index(request.entity, robot.link_count, 'entity')
            )
        except ParameterError as error:
            return _answered(response, codes.RESULT_NOT_FOUND, f'{error}, the robot {ROBOT_NAME}')
        q, u = self._simulation.state.q[link], self._simulation.state.u[link]
        state, quaternion = response.state, q[3:] @ TO_WIRE
        state.header.frame_id = WORLD
        _fill(state.pose.position, 'xyz', q[:3])
        _fill(state.pose.orientation, 'xyzw', base_of_link(quaternion) if is_robot else quaternion)
        _fill(state.twist.linear, 'xyz', u[:3])
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

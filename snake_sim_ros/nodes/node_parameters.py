# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameters of a node, and the requests to set them."""

from collections.abc import Callable, Container, Iterable, Mapping
from dataclasses import replace
import json
import math
from pathlib import Path
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import ParameterException, ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_service import ParameterService

from snake_sim_ros.scene.checked_records import (
    flat_fields,
    from_mapping,
    nearest,
    ParameterError,
    plain,
    quoted,
)
from snake_sim_ros.scene.files import parse_yaml
from snake_sim_ros.scene.parameters import load_robot, load_scene, Scene, with_settings

S = TypeVar('S')

# Parameters that rclpy declares itself.
OF_RCLPY = ('use_sim_time', 'start_type_description_service')
CONTROLLER = 'controller.'  # names of what only a controller knows
TABLE = 'gait.table.'  # names of what is too large for parameters; a scene names its file


def given_parameters(node: Node) -> dict[str, Any]:
    """Return name -> value of all parameters that the user set and the node has thus declared."""
    return {name: item.value for name, item in node.get_parameters_by_prefix('').items()}


def parameter_fields(record: Any, prefix: str = '') -> dict[str, tuple[Any, Mapping[str, Any]]]:
    """Return those of `flat_fields` that are parameters."""
    fields = flat_fields(record, prefix).items()
    return {name: item for name, item in fields if not name.startswith(TABLE)}


def declare(node: Node, name: str, value: Any, limits: Mapping[str, Any], read_only: bool) -> None:
    """Declare a parameter anew, with its descriptor; `limits` are as `quantity` makes them."""
    unit = f' [{limits["unit"]}]' if limits['unit'] not in ('', '1') else ''
    descriptor = ParameterDescriptor(
        name=name,
        description=limits['meaning'] + unit,
        read_only=read_only,
        dynamic_typing=True,
        additional_constraints=', '.join(limits['choices']),
    )
    low, high = max(limits['minimum'], limits['above']), limits['maximum']
    if isinstance(value, float) and (math.isfinite(low) or math.isfinite(high)):
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    elif type(value) is int:
        largest = 2**63 - 1
        descriptor.integer_range = [
            IntegerRange(
                from_value=int(max(low, -largest)), to_value=int(min(high, largest)), step=1
            )
        ]
    if isinstance(value, tuple):
        # A parameter cannot be a list of lists, of mappings or of several types, and an empty list
        # has no type: they become text.
        kinds = {type(entry) for entry in value}
        is_plain = len(kinds) == 1 and kinds <= {bool, int, float, str}
        value = list(value) if is_plain else json.dumps(plain(value))
    if node.has_parameter(name):
        node.undeclare_parameter(name)
    node.declare_parameter(name, value, descriptor, ignore_override=True)


def settle(
    node: Node,
    kind: type[S],
    of_scene: tuple[str, ...] = ('',),
    changeable: tuple[str, ...] = (),
    complete: Callable[[S, Scene, Container[str]], Scene] | None = None,
) -> tuple[S, Scene]:
    """
    Return settings and scene with the values that the user set, and declare them as parameters.

    Parameters
    ----------
    node : Node
        Made with `automatically_declare_parameters_from_overrides`.
    kind : type
        Record of the node's own parameters; its field `scene` names the scene.
    of_scene : tuple of str, optional
        Prefixes of those parameters of the scene that the node has; default: all.
    changeable : tuple of str, optional
        Parameters that may change while the node runs; all others are read-only.
    complete : callable, optional
        Takes settings, scene and the names of parameters that the user set, and returns the scene
        with what follows from them.

    Returns
    -------
    settings : record of `kind`
    scene : Scene

    Raises
    ------
    ParameterError
        If a value is not usable, or if the user set a parameter that the node does not have.

    """
    given = given_parameters(node)
    usual = flat_fields(kind())
    own = {name: _read(given[name], usual[name][0]) for name in usual if name in given}
    settings = from_mapping(kind, own, node.get_name())
    scene = with_own_robot(load_scene(settings.scene), getattr(settings, 'robot_description', ''))
    names = [name for name in parameter_fields(scene) if name.startswith(of_scene)]
    known = {*flat_fields(settings), *names}
    for name in given:
        if name.startswith(CONTROLLER) and CONTROLLER.startswith(of_scene):
            names += [] if name in names else [name]
        elif name not in known and name not in OF_RCLPY and not name.startswith('qos_overrides.'):
            raise ParameterError(
                f'unknown parameter {quoted(name)}; {nearest(name, sorted(known))}'
            )
    fields = flat_fields(scene)
    values = {
        name: _read(given[name], fields.get(name, [''])[0]) for name in names if name in given
    }
    scene = with_settings(scene, values)
    if complete:
        scene = complete(settings, scene, given)
    fields = flat_fields(scene)
    for name, item in {**flat_fields(settings), **{n: fields[n] for n in names}}.items():
        declare(node, name, *item, read_only=name not in changeable)
    node.add_pre_set_parameters_callback(lambda parameters: keep_types(node, parameters))
    return settings, scene


def with_own_robot(scene: Scene, description: str) -> Scene:
    """Return a scene with the robot of a URDF, the text or the name of its file, if not empty."""
    if not description:
        return scene
    return replace(scene, robot=load_robot(description, Path(), 'robot_description', scene.robot))


def settle_anew(node: Node, settings: Any, scene: Scene, changeable: tuple[str, ...]) -> None:
    """Declare settings and another scene as the parameters of a node, see `settle`."""
    for name in given_parameters(node):
        if name not in OF_RCLPY and not name.startswith('qos_overrides.'):
            node.describe_parameter(name).read_only = False  # rclpy keeps those that are
            node.undeclare_parameter(name)
    for name, item in {**flat_fields(settings), **parameter_fields(scene)}.items():
        declare(node, name, *item, read_only=name not in changeable)


def _read(value: Any, usual: Any) -> Any:
    """Return a value that the user gave; text may be a list, see `declare`, or null."""
    if value == 'null' and not isinstance(usual, str):  # A dump has it, and rclpy reads text.
        return None
    is_list = isinstance(value, str) and isinstance(usual, tuple)
    return parse_yaml(value) if is_list else value


class UnknownParameter(ParameterNotDeclaredException):
    """A parameter that the node does not have; the sentence of rclpy does not say which."""

    def __init__(self, name: str, known: Iterable[str]) -> None:
        super().__init__(name)
        self._sentence = f'unknown parameter {quoted(name)}; {nearest(name, sorted(known))}'

    def __str__(self) -> str:
        """Return the sentence that is the reason of the refusal."""
        return self._sentence


def keep_types(node: Node, parameters: list[Parameter]) -> list[Parameter]:
    """
    Return parameters with integers as floating-point numbers where the node declared those.

    Raises
    ------
    UnknownParameter
        If the node does not have one of them.

    """
    kept = []
    for item in parameters:
        if not node.has_parameter(item.name):
            raise UnknownParameter(item.name, node.get_parameters_by_prefix(''))
        wanted = node.get_parameter(item.name).type_
        if (item.type_, wanted) == (Parameter.Type.INTEGER, Parameter.Type.DOUBLE):
            item = Parameter(item.name, wanted, float(item.value))
        elif (item.type_, wanted) == (Parameter.Type.INTEGER_ARRAY, Parameter.Type.DOUBLE_ARRAY):
            item = Parameter(item.name, wanted, [float(value) for value in item.value])
        kept.append(item)
    return kept


# ---- requests -----------------------------------------------------------------------------------

# Errors that a value causes, such as one of a type that does not exist.
NOT_USABLE = (
    *(ValueError, TypeError, ArithmeticError, LookupError, AttributeError, RuntimeError),
    *(OSError, ParameterException),
)


class ParameterRequests(ParameterService):
    """
    The services for parameters of a node, as rclpy offers them, but every request is answered.

    An error out of a callback would end the node, and leave requests that wait in their queue.
    The node is made with ``start_parameter_services=False``.
    """

    def _set_parameters_callback(self, request: Any, response: Any) -> Any:
        try:
            return super()._set_parameters_callback(request, response)
        except NOT_USABLE as error:
            response.results = [_refused(error)] * len(request.parameters)
            return response

    def _set_parameters_atomically_callback(self, request: Any, response: Any) -> Any:
        try:
            return super()._set_parameters_atomically_callback(request, response)
        except NOT_USABLE as error:
            response.result = _refused(error)
            return response


def _refused(error: Exception) -> SetParametersResult:
    reason = str(error).partition('\n')[0]
    return SetParametersResult(successful=False, reason=f'not usable: {reason}')

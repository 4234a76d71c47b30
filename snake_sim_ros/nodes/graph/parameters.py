# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands `param list`, `get`, `set`, `describe` and `dump`."""

from collections.abc import Mapping
import sys
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterType
from rclpy.exceptions import InvalidServiceNameException
from rclpy.parameter import get_parameter_value, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
import yaml

from snake_sim_ros.nodes.graph.client import absolute, Client, GraphError
from snake_sim_ros.scene.checked_records import ParameterError, quoted
from snake_sim_ros.scene.files import NOT_READABLE, parse_yaml

LABELS = {
    ParameterType.PARAMETER_BOOL: 'Boolean value is:',
    ParameterType.PARAMETER_INTEGER: 'Integer value is:',
    ParameterType.PARAMETER_DOUBLE: 'Double value is:',
    ParameterType.PARAMETER_STRING: 'String value is:',
    ParameterType.PARAMETER_BYTE_ARRAY: 'Byte values are:',
    ParameterType.PARAMETER_BOOL_ARRAY: 'Boolean values are:',
    ParameterType.PARAMETER_INTEGER_ARRAY: 'Integer values are:',
    ParameterType.PARAMETER_DOUBLE_ARRAY: 'Double values are:',
    ParameterType.PARAMETER_STRING_ARRAY: 'String values are:',
}
TYPES = {
    kind: label.partition(' value')[0].lower() + (' array' if 'values' in label else '')
    for kind, label in LABELS.items()
}


def list_parameters(client: Client, node: str | None) -> None:
    """Print the parameters of a node, or of all nodes that answer under their names."""
    if node:
        for name in _names(client, node):
            print(f'  {name}')
        return
    client.look_around()
    for each in client.nodes():
        try:
            names = _names(client, each)
        except GraphError as error:
            print(error, file=sys.stderr)
            continue
        if names:
            print('\n'.join([f'{each}:', *(f'  {name}' for name in names)]))


def get_parameter(client: Client, node: str, name: str, hide_type: bool) -> None:
    """Print the value of a parameter."""
    (value,) = _values(client, node, [name]) or [None]
    if value is None or value.type == ParameterType.PARAMETER_NOT_SET:
        raise GraphError(f'Parameter not set: {absolute(node)} has no parameter {name}')
    shown = parameter_value_to_python(value)
    print(*([] if hide_type else [LABELS[value.type]]), shown)


def set_parameter(client: Client, node: str, name: str, text: str) -> int:
    """
    Set a parameter.

    Returns
    -------
    int
        0; 1 if the node refuses the value, with its reason on standard error.

    """
    parameter = Parameter(name=name, value=_value_of(text))
    remote = _remote(client, node)
    answer = client.answer(remote.set_parameters([parameter]), absolute(node))
    (result,) = answer.results
    reason = f': {result.reason}' if result.reason else ''
    if not result.successful:
        print(f'Setting parameter failed{reason}', file=sys.stderr)
        return 1
    print(f'Set parameter successful{reason}')
    return 0


def describe_parameters(client: Client, node: str, names: list[str]) -> None:
    """Print what a node says of some parameters: types, meanings and ranges."""
    remote = _remote(client, node)
    for name in names:
        answer = client.answer(remote.describe_parameters([name]), absolute(node))
        if not answer.descriptors or answer.descriptors[0].type not in TYPES:
            raise GraphError(f'Parameter not set: {absolute(node)} has no parameter {name}')
        (found,) = answer.descriptors
        print(f'Parameter name: {name}\n  Type: {TYPES[found.type]}')
        if found.description:
            print(f'  Description: {found.description}')
        print('  Constraints:')
        if found.read_only:
            print('    Read only: true')
        for limits in [*found.floating_point_range, *found.integer_range]:
            print(f'    Min value: {limits.from_value}\n    Max value: {limits.to_value}')
            if limits.step:
                print(f'    Step: {limits.step}')
        if found.additional_constraints:
            print(f'    Additional constraints: {found.additional_constraints}')


def dump_parameters(client: Client, node: str) -> None:
    """Print all parameters of a node as a file of parameters."""
    names = _names(client, node)
    values = map(parameter_value_to_python, _values(client, node, names))
    print(parameter_file(node, dict(zip(names, values, strict=True))))


def parameter_file(node: str, parameters: Mapping[str, Any]) -> str:
    """Return a file of parameters with the parameters of a node, by dotted names."""
    tree: dict[str, Any] = {}
    for name, value in parameters.items():
        branch = tree
        *folders, last = name.split('.')
        for folder in folders:
            branch = branch.setdefault(folder, {})
        branch[last] = value
    return yaml.dump({absolute(node): {'ros__parameters': tree}}, default_flow_style=False)


def _value_of(text: str) -> Any:
    try:
        value = parse_yaml(text)
    except ParameterError as error:
        reason = str(error).removeprefix(NOT_READABLE)
        raise GraphError(f'The passed value is no YAML: {reason}, got {quoted(text)}') from None
    if not isinstance(value, (bool, int, float, str, list, type(None))):
        raise GraphError(
            f'a parameter must be true, false, a number, a text or a list, got {quoted(text)}'
        )
    try:
        return get_parameter_value(text)
    except (OverflowError, AssertionError):
        raise GraphError(f'a whole number must fit into 64 bits, got {text}') from None


def _remote(client: Client, node: str) -> AsyncParameterClient:
    """Return a client for the parameters of a node, once it is there."""
    try:
        remote = AsyncParameterClient(client.node, absolute(node))
    except InvalidServiceNameException:
        raise GraphError(f'{node!r} cannot be the name of a node') from None
    if not client.until(remote.services_are_ready, client.patience):
        others = ', '.join(client.nodes()) or 'there are none'
        raise GraphError(f'Node not found: {absolute(node)}; the nodes that run: {others}')
    return remote


def _names(client: Client, node: str) -> list[str]:
    answer = client.answer(_remote(client, node).list_parameters(), absolute(node))
    return sorted(answer.result.names)


def _values(client: Client, node: str, names: list[str]) -> list[Any]:
    answer = client.answer(_remote(client, node).get_parameters(names), absolute(node))
    return list(answer.values)

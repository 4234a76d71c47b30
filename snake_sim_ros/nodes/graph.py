# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What the commands `topic`, `param` and `service` do, in the words of `ros2`.

They are for where `ros2` is missing, as on a machine with ROS 2 from PyPI. There is no
rosidl_runtime_py there either, so that messages are read and printed as YAML by functions of ours.
"""

from collections.abc import Callable, Mapping
from importlib import import_module
import re
import sys
import time
from typing import Any

import numpy as np
from rcl_interfaces.msg import Parameter as ParameterMessage, ParameterType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import get_parameter_value, Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, qos_profile_sensor_data, QoSProfile, ReliabilityPolicy
from rclpy.validate_full_topic_name import validate_full_topic_name
from yaml import dump

from snake_sim_ros.nodes.executors import make_executor
from snake_sim_ros.nodes.node_process import run_client
from snake_sim_ros.scene.checked_records import ParameterError, quoted
from snake_sim_ros.scene.files import parse_yaml

QUIET = 0.5  # s after which a command says that it waits
# Nodes of this package announce themselves four times a second, others of Fast DDS every 3 s: a
# look around ends when nothing new was found for a while, at the latest when all should be there.
SETTLED, DISCOVERY = 0.6, 3.5  # s
ANSWER_TIMEOUT = 10.0  # s for a node to answer; `ros2` waits forever
SENT_TIMEOUT = 1.0  # s for readers to confirm the last message


class Client:
    """A hidden node with which a command looks at the graph; it waits at most `patience` [s]."""

    def __init__(self, node: Node, interrupted: Callable[[], bool], patience: float) -> None:
        self.node, self.patience, self._interrupted = node, patience, interrupted
        self._executor = make_executor(node)

    def until(self, condition: Callable[[], Any], seconds: float) -> Any:
        """Serve messages; return a condition's value once it is true, or when time is up."""
        end = time.monotonic() + seconds
        while not (value := condition()) and (left := end - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=min(left, 0.05))
            if self._interrupted():
                raise KeyboardInterrupt
        return value

    def answer(self, future: Any, who: str) -> Any:
        """Return the answer to a request; raise ParameterError if there is none in time."""
        if not self.until(future.done, ANSWER_TIMEOUT):
            raise ParameterError(f'{who} did not answer in {ANSWER_TIMEOUT:g} s')
        return future.result()

    def look_around(self) -> None:
        """Wait until nothing new is found, or all nodes should have been."""
        begin = changed = time.monotonic()
        before: Any = None

        def is_settled() -> bool:
            nonlocal before, changed
            found = self.nodes(), self.node.get_topic_names_and_types()
            if found != before:
                before, changed = found, time.monotonic()
            return bool(found[0]) and time.monotonic() - changed >= SETTLED

        self.until(is_settled, DISCOVERY)
        self.until(self.nodes, self.patience - (time.monotonic() - begin))

    def nodes(self) -> list[str]:
        """Return the full names of all nodes that are not hidden."""
        found = self.node.get_node_names_and_namespaces()
        return sorted({f'{space.rstrip("/")}/{name}' for name, space in found if name[:1] != '_'})

    def types_of(self, topic: str) -> list[str]:
        """Return the types of a topic, none if it does not exist."""
        return dict(self.node.get_topic_names_and_types()).get(topic, [])


def run_verb(verb: str, options: Any) -> int:
    """Run a verb, such as ``topic_echo``, with a node of its own; return its exit status."""
    return run_client(
        lambda node, interrupted: globals()[verb](
            Client(node, interrupted, options.spin_time), options
        )
    )


def absolute(name: str) -> str:
    """Return a name with a slash before it."""
    return name if name.startswith('/') else f'/{name}'


# ---- messages and YAML --------------------------------------------------------------------------


def interface(name: str, kind: str) -> Any:
    """Return the class of ``package/msg/Name`` or ``package/Name``; the kind is msg or srv."""
    package, *middle = name.split('/')
    try:
        if middle[:-1] not in ([], [kind]) or not package.isidentifier():
            raise ImportError
        return getattr(import_module(f'{package}.{kind}'), middle[-1])
    except (AttributeError, ImportError, IndexError):
        what, example = {
            'msg': ('message', 'sensor_msgs/msg/JointState'),
            'srv': ('service', 'std_srvs/srv/Trigger'),
        }[kind]
        raise ParameterError(
            f'{quoted(name)} is not the type of a {what} that is installed; write it as in '
            f'{example}'
        ) from None


def plain(value: Any) -> Any:
    """Return a message as mappings, lists and plain values, which YAML can write."""
    if hasattr(value, 'get_fields_and_field_types'):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if hasattr(value, 'tolist'):
        value = value.tolist()
    if isinstance(value, list):
        return [plain(item) for item in value]
    return value.decode('latin-1') if isinstance(value, bytes) else value


def as_yaml(message: Any) -> str:
    """Return a message as YAML."""
    return dump(plain(message), sort_keys=False, allow_unicode=True, width=sys.maxsize)


def filled(kind: Any, values: Any, path: str = '') -> Any:
    """Return a message of a type, with the values of a mapping in its fields."""
    message = kind(check_fields=True)
    kinds = message.get_fields_and_field_types()
    if not isinstance(values, dict):
        raise ParameterError(
            f'{path or "The passed value"} must be a mapping in YAML, with some of the fields '
            f'{", ".join(kinds) or "(none)"}; got {quoted(values)}'
        )
    for name, value in values.items():
        where = f'{path}.{name}'.lstrip('.')
        if name not in kinds:
            known = ', '.join(kinds) or 'none'
            raise ParameterError(f'there is no field {where}; the fields there are: {known}')
        try:
            setattr(message, name, _converted(kinds[name], value, where))
        except (AssertionError, OverflowError, TypeError, ValueError) as error:
            reason = str(error).partition(' and each double')[0]  # all that a double can be
            raise ParameterError(f'{where}: {reason}, got {quoted(value)}') from None
    return message


def _converted(kind: str, value: Any, path: str) -> Any:
    """Return a value as a field takes it, which YAML does not tell: 1 may be a float."""
    if kind.endswith((']', '>')) and isinstance(value, list):
        item = re.sub(r'^sequence<|[\[,>].*', '', kind)
        return [_converted(item, each, f'{path}[{k}]') for k, each in enumerate(value)]
    elif '/' in kind:
        return filled(interface(kind, 'msg'), value, path)
    elif kind in ('float', 'double') and type(value) is int:
        return float(value)
    elif kind == 'octet' and type(value) is int:
        return bytes([value])
    elif kind.startswith('string'):
        return str(value)
    return value


# ---- topics -------------------------------------------------------------------------------------


def topic_list(client: Client, options: Any) -> None:
    """Print the names of topics."""
    client.look_around()
    _print_names(client.node.get_topic_names_and_types(), options.show_types)


def _print_names(found: list[tuple[str, list[str]]], show_types: bool) -> None:
    for name, types in sorted(found):
        if '/_' not in name:  # a part of a hidden name begins with an underscore
            print(f'{name} [{", ".join(types)}]' if show_types else name)


def topic_echo(client: Client, options: Any) -> None:
    """Print the messages of a topic."""
    topic = _checked(options.topic)
    kind = _kind_of(client, topic, options.type)
    messages: list[Any] = []
    client.until(lambda: client.node.count_publishers(topic), float('inf'))
    client.node.create_subscription(kind, topic, messages.append, _heard_by_all(client, topic))
    while client.until(lambda: messages, float('inf')):
        print(as_yaml(messages.pop(0)), end='---\n')
        if options.once:
            break


def _heard_by_all(client: Client, topic: str) -> QoSProfile:
    """
    Return the best quality of service that all who publish on a topic offer, as `ros2` finds it.

    That of rclpy, qos_profile_best_available, once asked for more liveliness than `sim` offers.
    """
    offered = [info.qos_profile for info in client.node.get_publishers_info_by_topic(topic)]
    reliable = all(qos.reliability == ReliabilityPolicy.RELIABLE for qos in offered)
    latched = all(qos.durability == DurabilityPolicy.TRANSIENT_LOCAL for qos in offered)
    return QoSProfile(
        depth=10,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def topic_hz(client: Client, options: Any) -> None:
    """Print once a second how often messages of a topic come."""
    topic, times = _checked(options.topic), list[float]()
    client.node.create_subscription(
        _kind_of(client, topic, None),
        topic,
        lambda data: times.append(time.monotonic()),
        qos_profile_sensor_data,
        raw=True,
    )
    while True:
        client.until(lambda: False, 1.0)
        if len(times) > 1:
            periods = np.diff(times)
            print(
                f'average rate: {1.0 / periods.mean():.3f}\n'
                f'\tmin: {periods.min():.3f}s max: {periods.max():.3f}s '
                f'std dev: {periods.std():.5f}s window: {len(periods)}'
            )


def topic_pub(client: Client, options: Any) -> None:
    """Publish a message on a topic, once a second or as often as wanted."""
    topic, kind = _checked(options.topic), interface(options.type, 'msg')
    message, times = filled(kind, parse_yaml(options.values)), options.times
    publisher = client.node.create_publisher(kind, topic, 10)
    readers = min(times, 1) if options.wait is None else options.wait

    def heard() -> bool:
        return bool(publisher.get_subscription_count() >= readers)

    if not client.until(heard, QUIET):
        print(f'Waiting for at least {readers} matching subscription(s)...')
        if not client.until(heard, client.patience):
            raise ParameterError(
                f'Timed out waiting for subscribers: expected {readers} of type {options.type} on '
                f'{topic}, but there are {publisher.get_subscription_count()}'
            )
    print('publisher: beginning loop')
    count, due = 0, time.monotonic()
    while not times or count < times:
        client.until(lambda: False, due - time.monotonic())
        count, due = count + 1, due + 1.0 / options.rate
        print(f'publishing #{count}: {message!r}\n')
        publisher.publish(message)
    publisher.wait_for_all_acked(Duration(seconds=SENT_TIMEOUT))


def _kind_of(client: Client, topic: str, name: str | None) -> Any:
    """Return the class of the messages of a topic, once it is there."""
    found = client.until(lambda: client.types_of(topic), client.patience)
    if not name and not found:
        raise ParameterError(f'nobody publishes {topic} or listens to it, so its type is unknown')
    # A topic may be known by its readers before those who publish are found.
    client.until(lambda: client.node.count_publishers(topic), QUIET)
    return interface(name or found[0], 'msg')


def _checked(topic: str) -> str:
    validate_full_topic_name(absolute(topic))
    return absolute(topic)


# ---- parameters ---------------------------------------------------------------------------------


def param_list(client: Client, options: Any) -> None:
    """Print the parameters of a node, or of all nodes that answer under their names."""
    if options.node:
        print('\n'.join(f'  {name}' for name in _names(client, options.node)))
        return
    client.look_around()
    for node in client.nodes():
        try:
            print('\n  '.join([f'{node}:', *_names(client, node)]))
        except ParameterError as error:
            print(error, file=sys.stderr)


def param_get(client: Client, options: Any) -> None:
    """Print the value of a parameter."""
    (value,) = _values(client, options.node, [options.name]) or [None]
    if value is None or value.type == ParameterType.PARAMETER_NOT_SET:
        raise _not_set(options.node, options.name)
    kind, _, several = _type_name(value.type).partition(' ')
    values = 'values are' if several else 'value is'
    print(f'{kind.capitalize()} {values}: {parameter_value_to_python(value)}')


def param_set(client: Client, options: Any) -> None:
    """Set a parameter."""
    parse_yaml(options.value)
    try:
        value = get_parameter_value(options.value)
    except (OverflowError, AssertionError):
        raise ParameterError(
            f'a parameter must be true, false, a text, a list or a number, and a whole number '
            f'must fit into 64 bits; got {quoted(options.value)}'
        ) from None
    parameter = ParameterMessage(name=options.name, value=value)
    request = _remote(client, options.node).set_parameters([parameter])
    (result,) = client.answer(request, absolute(options.node)).results
    if not result.successful:
        raise ParameterError(f'Setting parameter failed: {result.reason}')
    print('Set parameter successful')


def param_describe(client: Client, options: Any) -> None:
    """Print what a node says of some parameters: types, meanings and ranges."""
    remote = _remote(client, options.node)
    for name in options.names:
        found = client.answer(remote.describe_parameters([name]), absolute(options.node))
        if not found.descriptors or not found.descriptors[0].type:
            raise _not_set(options.node, name)
        (about,) = found.descriptors
        print(f'Parameter name: {name}\n  Type: {_type_name(about.type)}')
        print(f'  Description: {about.description}\n  Constraints:')
        if about.read_only:
            print('    Read only: true')
        for limits in [*about.floating_point_range, *about.integer_range]:
            print(f'    Min value: {limits.from_value}\n    Max value: {limits.to_value}')


def param_dump(client: Client, options: Any) -> None:
    """Print all parameters of a node as a file of parameters."""
    names = _names(client, options.node)
    values = map(parameter_value_to_python, _values(client, options.node, names))
    print(parameter_file(options.node, dict(zip(names, values, strict=True))))


def parameter_file(node: str, parameters: Mapping[str, Any]) -> str:
    """Return a file of parameters with the parameters of a node, by dotted names."""
    tree: dict[str, Any] = {}
    for name, value in parameters.items():
        branch = tree
        *folders, last = name.split('.')
        for folder in folders:
            branch = branch.setdefault(folder, {})
        branch[last] = value
    return dump({absolute(node): {'ros__parameters': tree}}, default_flow_style=False)


def _type_name(kind: int) -> str:
    return Parameter.Type(kind).name.lower().replace('_', ' ').replace('bool', 'boolean')


def _not_set(node: str, name: str) -> ParameterError:
    return ParameterError(f'Parameter not set: {absolute(node)} has no parameter {name}')


def _remote(client: Client, node: str) -> AsyncParameterClient:
    """Return a client for the parameters of a node, once it is there."""
    remote = AsyncParameterClient(client.node, absolute(node))
    if not client.until(remote.services_are_ready, client.patience):
        others = ', '.join(client.nodes()) or 'there are none'
        raise ParameterError(f'Node not found: {absolute(node)}; the nodes that run: {others}')
    return remote


def _names(client: Client, node: str) -> list[str]:
    answer = client.answer(_remote(client, node).list_parameters(), absolute(node))
    return sorted(answer.result.names)


def _values(client: Client, node: str, names: list[str]) -> list[Any]:
    answer = client.answer(_remote(client, node).get_parameters(names), absolute(node))
    return list(answer.values)


# ---- services -----------------------------------------------------------------------------------


def service_list(client: Client, options: Any) -> None:
    """Print the names of services."""
    client.look_around()
    _print_names(client.node.get_service_names_and_types(), options.show_types)


def service_call(client: Client, options: Any) -> None:
    """Call a service and print request and response."""
    kind, name = interface(options.type, 'srv'), absolute(options.service)
    request = filled(kind.Request, parse_yaml(options.values))
    remote = client.node.create_client(kind, name)
    if not client.until(remote.service_is_ready, QUIET):
        print('waiting for service to become available...')
        if not client.until(remote.service_is_ready, client.patience):
            raise ParameterError(f'there is no service {name} of type {options.type}')
    print(f'requester: making request: {request!r}\n')
    print(f'response:\n{client.answer(remote.call_async(request), name)!r}\n')

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands `service list` and `service call`."""

from rclpy.exceptions import InvalidServiceNameException

from snake_sim_ros.nodes.graph.client import absolute, Client, GraphError, QUIET
from snake_sim_ros.nodes.graph.message_fields import filled, interface
from snake_sim_ros.nodes.graph.topics import full_name, print_names


def list_services(client: Client, show_types: bool, count: bool, hidden: bool) -> None:
    """Print the names of services."""
    client.look_around()
    print_names(client.services(hidden), show_types, count)


def call(client: Client, service: str, type_name: str, values: str) -> None:
    """
    Call a service and print request and response.

    Parameters
    ----------
    client : Client
    service, type_name : str
    values : str
        YAML.

    """
    kind, name = interface(type_name, 'srv'), absolute(service)
    request = filled(kind.Request(), values)
    try:
        remote = client.node.create_client(kind, name)
    except InvalidServiceNameException as error:
        raise GraphError(' '.join(str(error).split())) from None
    if not client.until(remote.service_is_ready, QUIET):
        print('waiting for service to become available...')
        if not client.until(remote.service_is_ready, client.patience):
            known = dict(client.services(hidden=True)).get(name, [])  # this client's type as well
            if others := [each for each in known if each != full_name(kind)]:
                raise GraphError(f'{name} is of type {", ".join(others)}, not {full_name(kind)}')
            raise GraphError(f'there is no service {name}; service list shows those that are')
    print(f'requester: making request: {request!r}\n')
    print(f'response:\n{client.answer(remote.call_async(request), name)!r}\n')

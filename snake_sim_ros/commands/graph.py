# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands `snake-sim topic`, `param` and `service`, for where there is no `ros2`."""

import argparse
from collections.abc import Callable
import math
import os
import sys
from typing import Any

from snake_sim_ros.nodes.missing_ros import missing_ros

SPIN_TIME = 10.0  # s; nodes find each other in up to 3.3 s, on a busy machine later
SUBSCRIBERS_TIME = 20.0  # s
TRUNCATE_LENGTH, WINDOW = 128, 10_000  # those of ros2


def add_topic(subparsers: Any) -> None:
    """Add the command."""
    verbs = _group(subparsers, 'topic')
    _add_list(verbs, 'topics', lambda: _topics().list_topics)

    echo = _add(verbs, 'echo', 'print the messages of a topic', _echo)
    echo.add_argument('topic')
    echo.add_argument('type', nargs='?', help='default: what the graph says')
    echo.add_argument('--once', action='store_true', help='end after the first message')
    echo.add_argument('--field', default='', metavar='NAME.NAME', help='show only this field')
    echo.add_argument('--timeout', type=_positive, default=math.inf, metavar='S', help='then end')
    echo.add_argument('--flow-style', action='store_true', help='a message on one line')
    echo.add_argument('-f', '--full-length', action='store_true', help='do not cut off arrays')
    echo.add_argument(
        '-l', '--truncate-length', type=_whole, default=TRUNCATE_LENGTH, metavar='N',
        help='elements of an array or text that are shown, default 128',
    )  # fmt: skip

    hz = _add(verbs, 'hz', 'print how often messages of a topic come', _hz)
    hz.add_argument('topic')
    hz.add_argument(
        '-w', '--window', type=_counted, default=WINDOW, metavar='N',
        help='messages to average over, default 10000',
    )  # fmt: skip

    pub = _add(verbs, 'pub', 'publish messages on a topic', _pub)
    pub.add_argument('topic')
    pub.add_argument('type', help='such as std_msgs/msg/String')
    pub.add_argument('values', nargs='?', default='{}', help='YAML, such as "{data: hello}"')
    pub.add_argument('-r', '--rate', type=_positive, default=1.0, metavar='HZ', help='default 1')
    times = pub.add_mutually_exclusive_group()
    times.add_argument('-1', '--once', action='store_true', help='publish one message and end')
    times.add_argument('-t', '--times', type=_whole, default=0, metavar='N', help='then end')
    pub.add_argument(
        '-w', '--wait-matching-subscriptions', type=_whole, metavar='N',
        help='readers to wait for, default 1 with --once and --times, else 0',
    )  # fmt: skip
    pub.add_argument(
        '--max-wait-time-secs', type=_positive, default=SUBSCRIBERS_TIME, metavar='S',
        help='how long to wait for them, default 20',
    )  # fmt: skip
    pub.add_argument(
        '-p', '--print', type=_whole, default=1, metavar='N', help='print every N-th message'
    )


def add_param(subparsers: Any) -> None:
    """Add the command."""
    verbs = _group(subparsers, 'param')
    listing = _add(verbs, 'list', 'print the parameters of a node, or of all', _list_parameters)
    listing.add_argument('node', nargs='?')
    get = _add(verbs, 'get', 'print the value of a parameter', _get)
    get.add_argument('node')
    get.add_argument('name')
    get.add_argument('--hide-type', action='store_true', help='only the value')
    put = _add(verbs, 'set', 'set a parameter', _set)
    put.add_argument('node')
    put.add_argument('name')
    put.add_argument('value', help='YAML, such as 0.5, true or "[1, 2]"')
    describe = _add(verbs, 'describe', 'print types, meanings and ranges of parameters', _describe)
    describe.add_argument('node')
    describe.add_argument('names', nargs='+')
    dump = _add(verbs, 'dump', 'print all parameters of a node as a YAML file', _dump)
    dump.add_argument('node')


def add_service(subparsers: Any) -> None:
    """Add the command."""
    verbs = _group(subparsers, 'service')
    _add_list(verbs, 'services', lambda: _services().list_services)
    call = _add(verbs, 'call', 'call a service', _call)
    call.add_argument('service')
    call.add_argument('type', help='such as std_srvs/srv/Trigger')
    call.add_argument('values', nargs='?', default='{}', help='YAML, such as "{data: true}"')


# ---- arguments ----------------------------------------------------------------------------------


def _group(subparsers: Any, name: str) -> Any:
    command = subparsers.add_parser(name)
    return command.add_subparsers(required=True, metavar='VERB')


def _add(verbs: Any, name: str, text: str, act: Callable[..., int | None]) -> Any:
    """Add a verb; `act` takes a client and the options."""
    verb = verbs.add_parser(name, help=text, description=text)
    verb.set_defaults(command=lambda options: _run(act, options))
    verb.add_argument(
        '--spin-time', type=_positive, default=SPIN_TIME, metavar='S',
        help='how long to wait for what is not there, default 10',
    )  # fmt: skip
    return verb


def _add_list(verbs: Any, what: str, listing: Callable[[], Any]) -> None:
    def act(client: Any, options: argparse.Namespace) -> None:
        listing()(client, options.show_types, options.count, options.hidden)

    verb = _add(verbs, 'list', f'print the names of {what}', act)
    verb.add_argument('-t', '--show-types', action='store_true', help='their types as well')
    verb.add_argument(
        '-c', f'--count-{what}', dest='count', action='store_true', help='only how many there are'
    )
    verb.add_argument(
        f'--include-hidden-{what}', dest='hidden', action='store_true', help='hidden ones as well'
    )


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f'must be above 0, got {text}')
    return value


def _whole(text: str) -> int:
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f'must be at least 0, got {text}')
    return value


def _counted(text: str) -> int:
    value = _whole(text)
    if not value:
        raise argparse.ArgumentTypeError('must be at least 1, got 0')
    return value


# ---- what they do -------------------------------------------------------------------------------


def _run(act: Callable[..., int | None], options: argparse.Namespace) -> int:
    """
    Run a verb with a node of its own.

    Returns
    -------
    int
        0, or 1 after one sentence on standard error.

    """
    try:
        from snake_sim_ros.nodes.graph.client import client, GraphError
    except ImportError as error:
        raise missing_ros('this command', 'topic, ./run param or ./run service', error) from None
    reconfigure = getattr(sys.stdout, 'reconfigure', None)
    if reconfigure:
        reconfigure(line_buffering=True)
    try:
        with client(options.spin_time) as own:
            return act(own, options) or 0
    except GraphError as error:
        print(error, file=sys.stderr)
        return 1
    except BrokenPipeError:  # as of `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def _topics() -> Any:
    from snake_sim_ros.nodes.graph import topics

    return topics


def _parameters() -> Any:
    from snake_sim_ros.nodes.graph import parameters

    return parameters


def _services() -> Any:
    from snake_sim_ros.nodes.graph import services

    return services


def _echo(client: Any, options: argparse.Namespace) -> None:
    _topics().echo(
        client,
        options.topic,
        options.type,
        field=options.field,
        once=options.once,
        timeout=options.timeout,
        longest=None if options.full_length else options.truncate_length,
        flow_style=options.flow_style,
    )


def _hz(client: Any, options: argparse.Namespace) -> None:
    _topics().rate(client, options.topic, options.window)


def _pub(client: Any, options: argparse.Namespace) -> None:
    times = 1 if options.once else options.times
    readers = options.wait_matching_subscriptions
    _topics().publish(
        client,
        options.topic,
        options.type,
        options.values,
        frequency=options.rate,
        times=times,
        readers=min(times, 1) if readers is None else readers,
        patience=options.max_wait_time_secs,
        print_each=options.print,
    )


def _list_parameters(client: Any, options: argparse.Namespace) -> None:
    _parameters().list_parameters(client, options.node)


def _get(client: Any, options: argparse.Namespace) -> None:
    _parameters().get_parameter(client, options.node, options.name, options.hide_type)


def _set(client: Any, options: argparse.Namespace) -> int:
    return int(_parameters().set_parameter(client, options.node, options.name, options.value))


def _describe(client: Any, options: argparse.Namespace) -> None:
    _parameters().describe_parameters(client, options.node, options.names)


def _dump(client: Any, options: argparse.Namespace) -> None:
    _parameters().dump_parameters(client, options.node)


def _call(client: Any, options: argparse.Namespace) -> None:
    _services().call(client, options.service, options.type, options.values)

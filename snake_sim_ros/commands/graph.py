# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands `snake-sim topic`, `param` and `service`, for where there is no `ros2`."""

import math
import sys
from typing import Any

from snake_sim_ros.nodes.programs import missing_ros

SPIN_TIME = 10.0  # s; nodes find each other in up to 3.3 s, on a busy machine later


def add_topic(subparsers: Any) -> None:
    """Add the command."""
    verbs = subparsers.add_parser('topic').add_subparsers(required=True, metavar='VERB')
    listing = _add(verbs, 'topic_list', 'print the names of topics')
    listing.add_argument('-t', '--show-types', action='store_true', help='their types as well')
    echo = _add(verbs, 'topic_echo', 'print the messages of a topic', 'topic')
    echo.add_argument('type', nargs='?', help='default: what the graph says')
    echo.add_argument('--once', action='store_true', help='end after the first message')
    _add(verbs, 'topic_hz', 'print how often messages of a topic come', 'topic')
    pub = _add(verbs, 'topic_pub', 'publish messages on a topic', 'topic')
    pub.add_argument('type', help='such as std_msgs/msg/String')
    pub.add_argument('values', nargs='?', default='{}', help='YAML, such as "{data: hello}"')
    pub.add_argument('-r', '--rate', type=_positive, default=1.0, metavar='HZ', help='default 1')
    once = {'action': 'store_const', 'const': 1, 'default': 0, 'dest': 'times'}
    pub.add_argument('-1', '--once', **once, help='publish one message and end')
    pub.add_argument('-t', '--times', type=int, default=0, metavar='N', help='then end')
    pub.add_argument(
        '-w', '--wait-matching-subscriptions', type=int, metavar='N', dest='wait',
        help='readers to wait for, default 1 with --once and --times, else 0',
    )  # fmt: skip


def add_param(subparsers: Any) -> None:
    """Add the command."""
    verbs = subparsers.add_parser('param').add_subparsers(required=True, metavar='VERB')
    listing = _add(verbs, 'param_list', 'print the parameters of a node, or of all')
    listing.add_argument('node', nargs='?')
    _add(verbs, 'param_get', 'print the value of a parameter', 'node', 'name')
    put = _add(verbs, 'param_set', 'set a parameter', 'node', 'name')
    put.add_argument('value', help='YAML, such as 0.5, true or "[1, 2]"')
    describe = _add(verbs, 'param_describe', 'print types, meanings and ranges', 'node')
    describe.add_argument('names', nargs='+')
    _add(verbs, 'param_dump', 'print all parameters of a node as a YAML file', 'node')


def add_service(subparsers: Any) -> None:
    """Add the command."""
    verbs = subparsers.add_parser('service').add_subparsers(required=True, metavar='VERB')
    listing = _add(verbs, 'service_list', 'print the names of services')
    listing.add_argument('-t', '--show-types', action='store_true', help='their types as well')
    call = _add(verbs, 'service_call', 'call a service', 'service')
    call.add_argument('type', help='such as std_srvs/srv/Trigger')
    call.add_argument('values', nargs='?', default='{}', help='YAML, such as "{data: true}"')


def _add(verbs: Any, name: str, text: str, *arguments: str) -> Any:
    """Add a verb, which a function of `nodes.graph` with that name carries out."""
    verb = verbs.add_parser(name.partition('_')[2], help=text, description=text)
    verb.set_defaults(command=lambda options: _run(name, options))
    for argument in arguments:
        verb.add_argument(argument)
    verb.add_argument(
        '--spin-time', type=_positive, default=SPIN_TIME, metavar='S',
        help='how long to wait for what is not there, default 10',
    )  # fmt: skip
    return verb


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < math.inf:
        raise ValueError
    return value


def _run(name: str, options: Any) -> int:
    try:
        from snake_sim_ros.nodes import graph
    except ImportError as error:
        raise missing_ros('this command', 'topic, ./run param or ./run service', error) from None
    sys.stdout.reconfigure(line_buffering=True)  # type: ignore[union-attr]
    return graph.run_verb(name, options)

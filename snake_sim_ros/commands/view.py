# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `snake-sim view`: a live robot or a recorded run in the browser."""

import argparse
from pathlib import Path
from typing import Any

from snake_sim_ros.commands.namespace_option import add_namespace
from snake_sim_ros.nodes.programs import missing_ros
from snake_sim_ros.recording.recorded_runs import names_a_recorded_run, read_run


def add_view(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('view')
    command.set_defaults(command=_view)
    command.add_argument(
        'source', nargs='?', metavar='RECORDING|SCENE',
        help='npz file, MCAP file, folder of a bag, or a scene that is run live; default: the '
        'robot on the topics',
    )  # fmt: skip
    command.add_argument('--host', default='127.0.0.1', help='default: 127.0.0.1, this machine')
    command.add_argument('--port', type=int, default=8080, help='default: 8080; 0 is any free one')
    command.add_argument('--no-browser', action='store_true', help='only print the address')
    add_namespace(command)


def _view(options: argparse.Namespace) -> int:
    place = options.host, options.port, not options.no_browser
    if options.source and names_a_recorded_run(options.source):
        from snake_sim_ros.view.playback import play

        source = Path(options.source)
        return play(read_run(source, options.namespace), source.name, *place)
    try:
        from snake_sim_ros.nodes.tools.live_view import view_live
    except ImportError as error:
        raise missing_ros('a live view', 'view', error) from None
    return view_live(options.source, *place)

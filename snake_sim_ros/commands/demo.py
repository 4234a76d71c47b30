# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `snake-sim demo`: a scene run live, as the nodes `sim` and `gait`."""

import argparse
from pathlib import Path
from typing import Any

from snake_sim_ros.commands.scene_options import add_scene_or_default
from snake_sim_ros.nodes.programs import missing_ros


def add_demo(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('demo')
    command.set_defaults(command=_demo)
    add_scene_or_default(command)
    command.add_argument(
        '--duration', type=float, default=15.0, help='of the gait [s], default 15'
    )
    command.add_argument(
        '--out', type=Path, default=Path('demo.png'), metavar='FILE.png', help='default: demo.png'
    )


def _demo(options: argparse.Namespace) -> int:
    try:
        from snake_sim_ros.nodes.tools.demo import demo
    except ImportError as error:
        raise missing_ros('the demo', 'demo', error) from None
    return demo(options.scene, options.duration, options.out)

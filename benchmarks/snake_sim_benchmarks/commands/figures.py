# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `snake-sim figures`: the paper's figures, drawn anew."""

import argparse
from pathlib import Path
from typing import Any


def add_figures(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('figures')
    command.set_defaults(command=_figures)
    command.add_argument(
        '--duration', type=float, default=15.0, help="of every case [s], default 15, the paper's"
    )
    command.add_argument(
        '--out', type=Path, default=Path(), metavar='FOLDER', help='default: this folder'
    )


def _figures(options: argparse.Namespace) -> int:
    from snake_sim_benchmarks.paper.figures import draw_figures

    for file in draw_figures(options.out, options.duration):
        print(file)
    return 0

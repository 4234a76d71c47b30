# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `snake-sim plot`: a recorded run as a picture of numbers."""

import argparse
from pathlib import Path
from typing import Any

from snake_sim_ros.commands.namespace_option import add_namespace
from snake_sim_ros.commands.output_files import title_of
from snake_sim_ros.recording.recorded_runs import read_run
from snake_sim_ros.scene.checked_records import ParameterError


def add_plot(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('plot')
    command.set_defaults(command=_plot)
    command.add_argument('run', type=Path, help='npz file, MCAP file, or folder of a bag')
    add_namespace(command)
    command.add_argument(
        '--out', type=Path, metavar='FILE',
        help='a PNG, PDF or SVG file; default: the run with the suffix .png',
    )  # fmt: skip


def _plot(options: argparse.Namespace) -> int:
    try:
        from snake_sim_ros.view.chart import check_plot, draw
    except ImportError as error:
        raise ParameterError(
            f"plots need matplotlib ({error}): pip install 'snake_sim_ros[plots]'"
        ) from None
    path = options.out or options.run.with_suffix('.png')
    check_plot(path)
    draw(read_run(options.run, options.namespace), path, title_of(options.run))
    print(path)
    return 0

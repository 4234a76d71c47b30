# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `snake-sim export`: a recorded run in other formats."""

import argparse
from pathlib import Path
from typing import Any

from snake_sim_ros.commands.namespace_option import add_namespace
from snake_sim_ros.commands.output_files import (
    add_outputs,
    outputs,
    print_outputs,
    title_of,
    write,
)
from snake_sim_ros.recording.recorded_runs import read_run
from snake_sim_ros.scene.checked_records import ParameterError


def add_export(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('export')
    command.set_defaults(command=_export)
    command.add_argument('run', type=Path, help='npz file, MCAP file, or folder of a bag')
    add_namespace(command)
    add_outputs(command, bag=False)


def _export(options: argparse.Namespace) -> int:
    files = outputs(options)
    if not files:
        raise ParameterError('nothing to write: give one of --out, --csv, --gif and --mp4')
    trajectory = read_run(options.run, options.namespace)
    write(trajectory, files, title_of(options.run), options.speed)
    print_outputs(trajectory, files)
    return 0

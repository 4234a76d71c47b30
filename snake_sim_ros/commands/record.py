# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `snake-sim record`: all topics of a live robot as a bag."""

import argparse
from pathlib import Path
from typing import Any

from snake_sim_ros.scene.checked_records import ParameterError


def add_record(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('record')
    command.set_defaults(command=_record)
    command.add_argument('file', type=Path, metavar='FILE.mcap')


def _record(options: argparse.Namespace) -> int:
    if options.file.suffix != '.mcap':
        raise ParameterError(f'the file of a bag must end in .mcap, got {options.file}')
    try:
        from snake_sim_ros.nodes.tools.topic_recorder import record_topics
    except ImportError as error:
        raise ParameterError(
            f'record needs ROS 2 and mcap ({error}): source a ROS 2 installation, or ./run '
            f"record, and pip install 'snake_sim_ros[bags]'"
        ) from None
    return record_topics(options.file)

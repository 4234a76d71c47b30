# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The options of commands whose CSV files grow row by row."""

import argparse
from pathlib import Path


def add_table_file(command: argparse.ArgumentParser, default: str, growth: str) -> None:
    """Add the option that names the file, whose help says how a file with rows grows."""
    command.add_argument(
        '--out', type=Path, default=Path(default), metavar='FILE.csv',
        help=f'default: {default}; {growth}',
    )  # fmt: skip


def add_other_sources(command: argparse.ArgumentParser) -> None:
    """Add the option that lets a file grow with rows of other sources."""
    command.add_argument(
        '--other-sources', action='store_true',
        help='go on with a file whose rows are of other sources; new rows have their own head',
    )  # fmt: skip

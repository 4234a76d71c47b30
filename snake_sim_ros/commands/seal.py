# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `snake-sim seal`: mark CSV files that were changed by hand."""

import argparse
from pathlib import Path
from typing import Any

from snake_sim_ros.comparison.csv_tables import mark_unknown


def add_seal(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('seal')
    command.set_defaults(command=_seal)
    command.add_argument('csv', type=Path, nargs='+', metavar='FILE.csv')


def _seal(options: argparse.Namespace) -> int:
    for path in options.csv:
        changed = mark_unknown(path)
        print(f'{path}: {"sealed, of unknown provenance" if changed else "its seals fit"}')
    return 0

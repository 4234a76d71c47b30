# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `snake-sim limits`: whether methods have one limit in random scenes, as a CSV."""

import argparse
from typing import Any

from tqdm import tqdm

from snake_sim_benchmarks.commands.table_options import add_other_sources, add_table_file
from snake_sim_benchmarks.comparison.csv_tables import plain, read_table, records_of, TableWriter
from snake_sim_ros.scene.checked_records import ParameterError


def add_limits(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('limits')
    command.set_defaults(command=_limits)
    command.add_argument(
        '--scenes', type=int, default=100, metavar='N', help='random scenes; default: 100'
    )
    add_table_file(command, 'limits.csv', 'scenes that it has already are not run again')
    add_other_sources(command)


def _limits(options: argparse.Namespace) -> int:
    from snake_sim_benchmarks.comparison import limits

    if options.scenes < 1:
        raise ParameterError(f'--scenes must be 1 or more, got {options.scenes}')
    writer = TableWriter(
        options.out, 'limits', limits.COLUMNS, other_sources=options.other_sources
    )
    done = {int(row['seed']) for row in writer.rows}
    left = [seed for seed in range(options.scenes) if seed not in done]
    for seed in tqdm(left, unit=' scenes', smoothing=0):
        writer.append([plain(limits.measured(seed))])
    rows = records_of(read_table(options.out), 'limits', limits.Row)
    print(limits.limits_table(rows), end='')
    return 0

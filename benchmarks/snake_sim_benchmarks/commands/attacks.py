# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands `snake-sim fuzz` and `snake-sim soak`: attacks on the program, as CSV files."""

import argparse
from collections.abc import Sequence
from importlib import import_module
from typing import Any, cast

from tqdm import tqdm

from snake_sim_benchmarks.commands.table_options import add_other_sources, add_table_file
from snake_sim_benchmarks.comparison.csv_tables import plain, TableWriter
from snake_sim_benchmarks.reliability.trials import COLUMNS, page, Part
from snake_sim_ros.scene.checked_records import ParameterError

FUZZ = ('files', 'messages', 'pages', 'states', 'physics')  # modules of the room `reliability`
SOAK = ('steps', 'longest', 'faults')


def add_fuzz(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('fuzz')
    command.add_argument('--minutes', type=float, default=3.0, metavar='M', help='default 3')
    _add_options(command, 'fuzz', FUZZ)


def add_soak(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('soak')
    command.add_argument('--hours', type=float, default=0.05, metavar='H', help='default 0.05')
    _add_options(command, 'soak', SOAK)


def _add_options(command: argparse.ArgumentParser, name: str, parts: Sequence[str]) -> None:
    command.set_defaults(command=lambda options: _attack(options, name, parts))
    command.add_argument(
        '--parts', nargs='+', choices=parts, default=parts, metavar='PART',
        help=f'only these, which share the time; of {", ".join(parts)}',
    )  # fmt: skip
    command.add_argument('--seed', type=int, default=0, help='default 0')
    add_table_file(command, f'{name}.csv', 'an existing one grows')
    add_other_sources(command)


def _attack(options: argparse.Namespace, name: str, parts: Sequence[str]) -> int:
    """Return 1 if a promise was broken."""
    seconds = options.minutes * 60 if name == 'fuzz' else options.hours * 3600
    if not 1.0 <= seconds <= 30 * 24 * 3600:
        raise ParameterError(f'{name} takes from a second to 30 days, got {seconds:g} s')
    writer = TableWriter(options.out, name, COLUMNS, other_sources=options.other_sources)
    rows = []
    with tqdm(unit=' trials') as bar:
        for part in options.parts:
            bar.set_description(part)
            module = cast(Part, import_module(f'snake_sim_benchmarks.reliability.{part}'))
            for row in module.trials(seconds / len(options.parts), options.seed):
                writer.append([plain(row)])
                rows.append(row)
                bar.update()
    print('\n'.join(page(rows)))
    for row in rows:
        if row.violations:
            print(f'{row.part}, {row.subject}: {row.first}')
    return int(any(row.violations for row in rows))

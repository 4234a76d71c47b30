# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `snake-sim artefacts`: what methods without set-valued laws make up, as a CSV."""

import argparse
from typing import Any

from tqdm import tqdm

from snake_sim_benchmarks.commands.table_options import add_other_sources, add_table_file
from snake_sim_benchmarks.comparison.csv_tables import plain, read_table, records_of, TableWriter


def add_artefacts(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('artefacts')
    command.set_defaults(command=_artefacts)
    add_table_file(command, 'artefacts.csv', 'rows that it has already are not measured again')
    add_other_sources(command)


def _artefacts(options: argparse.Namespace) -> int:
    from snake_sim_benchmarks.comparison import artefacts

    writer = TableWriter(
        options.out, 'artefacts', artefacts.COLUMNS, other_sources=options.other_sources
    )
    for measure in tqdm(list(artefacts.measurements(writer.rows)), smoothing=0):
        writer.append(map(plain, measure()))
    rows = records_of(read_table(options.out), 'artefacts', artefacts.Row)
    print(artefacts.text_table(rows), end='')
    return 0

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `snake-sim stability`: where methods converge, fail or blow up, as a CSV file."""

import argparse
from typing import Any

from tqdm import tqdm

from snake_sim_benchmarks.commands.table_options import add_other_sources, add_table_file
from snake_sim_benchmarks.comparison.csv_tables import plain, TableWriter
from snake_sim_ros.scene.checked_records import ParameterError


def add_stability(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('stability')
    command.set_defaults(command=_stability)
    command.add_argument(
        '--maps', nargs='+', metavar='MAP', help='only these, such as friction drop_flat'
    )
    command.add_argument('--quick', action='store_true', help='coarse maps, in a minute')
    add_table_file(command, 'stability.csv', 'cells that it has already are not run again')
    add_other_sources(command)


def _stability(options: argparse.Namespace) -> int:
    from snake_sim_benchmarks.comparison.stability import runs
    from snake_sim_benchmarks.comparison.stability.maps import MAPS, run_case

    known = [chart.name for chart in MAPS]
    for name in options.maps or []:
        if name not in known:
            raise ParameterError(f'no map {name!r}; choose from: {", ".join(known)}')
    maps = [chart for chart in MAPS if chart.name in (options.maps or known)]
    if options.quick:
        maps = [runs.coarser(chart) for chart in maps]
    writer = TableWriter(
        options.out, 'stability', runs.COLUMNS, other_sources=options.other_sources
    )
    done = {runs.key(row) for row in writer.rows}
    total = sum(runs.key(place) not in done for chart in maps for place in runs.places(chart))
    counts = dict.fromkeys((*runs.OUTCOMES, 'failed'), 0)
    with tqdm(total=total, unit=' cells', smoothing=0.05) as bar:
        for chart in maps:
            bar.set_description(chart.name)
            for cell in runs.cells(chart, done, run_case):
                writer.append([plain(cell)])
                counts[cell.outcome] += 1
                bar.update()
    print(', '.join(f'{count} {name}' for name, count in counts.items()))
    print(f'{options.out} is complete; snake-sim chart {options.out} draws it')
    return 0

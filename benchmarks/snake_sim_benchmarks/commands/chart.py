# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `snake-sim chart`: pictures of what the measuring commands wrote to CSV files."""

import argparse
from pathlib import Path
from typing import Any

from snake_sim_benchmarks.comparison.csv_tables import read_table
from snake_sim_ros.scene.checked_records import ParameterError


def add_chart(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('chart')
    command.set_defaults(command=_chart)
    command.add_argument('csv', type=Path, nargs='+', metavar='FILE.csv')
    command.add_argument(
        '--out', type=Path, default=Path(), metavar='FOLDER', help='default: this folder'
    )


def _chart(options: argparse.Namespace) -> int:
    from snake_sim_benchmarks.comparison.charts import draw_artefacts, draw_bench
    from snake_sim_benchmarks.comparison.limits import draw_limits
    from snake_sim_benchmarks.comparison.stability.chart import draw_stability
    from snake_sim_benchmarks.reliability.trials import draw_trials

    draw = {
        'bench': draw_bench, 'stability': draw_stability, 'artefacts': draw_artefacts,
        'limits': draw_limits, 'fuzz': draw_trials, 'soak': draw_trials,
    }  # fmt: skip
    if not options.out.is_dir():
        raise ParameterError(f'--out: no folder {options.out}')
    for path in options.csv:
        table = read_table(path)
        kind = table.header['table']
        if kind not in draw:
            raise ParameterError(f'{path}: table must be one of {", ".join(draw)}; got {kind!r}')
        try:
            files = draw[kind](table, options.out)
        except ParameterError as error:
            raise ParameterError(f'{path}: {error}') from None
        for file in files:
            print(file)
    return 0

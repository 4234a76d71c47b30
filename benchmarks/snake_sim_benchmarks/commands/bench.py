# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `snake-sim bench`: error, time and much else of all methods as a CSV file."""

import argparse
from collections.abc import Iterable
from dataclasses import replace
import sys
from typing import Any, TYPE_CHECKING

from tqdm import tqdm

from snake_sim_benchmarks.commands.table_options import add_other_sources, add_table_file
from snake_sim_benchmarks.comparison.csv_tables import plain, TableWriter
from snake_sim_ros.commands.options import add_scene_options, CASES, scene_from
from snake_sim_ros.scene.checked_records import ParameterError

if TYPE_CHECKING:
    from snake_sim_benchmarks.comparison.bench_rows import Entry
    from snake_sim_benchmarks.comparison.contenders import Contender
    from snake_sim_benchmarks.comparison.ensembles import Field

QUICK_CASES = CASES[::2]
PARTS = (
    *('ensemble', 'cycle', 'robust', 'precision', 'links', 'iterations', 'costs', 'start_up'),
    *('accuracy', 'agreement', 'throughput', 'user', 'soak'),
)
QUICK_PARTS = ('ensemble', 'cycle', 'links')
SELECTED_PARTS = ('precision',)


def add_bench(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('bench')
    command.set_defaults(command=_bench)
    command.add_argument('scene', nargs='*', help='default: cases A to D; with --quick A and C')
    add_table_file(command, 'bench.csv', 'rows that it has already are not run again')
    command.add_argument('--quick', action='store_true', help='a small matrix, in two minutes')
    command.add_argument(
        '--methods', nargs='+', metavar='METHOD', help='only these, such as newton mujoco'
    )
    command.add_argument(
        '--dt', nargs='+', type=float, metavar='S', help='instead of the steps of the matrix [s]'
    )
    command.add_argument(
        '--parts', nargs='+', metavar='PART', choices=PARTS,
        help=f'default: {", ".join(PARTS)}; with --quick {", ".join(QUICK_PARTS)}, with scenes, '
        f'--methods or --dt {SELECTED_PARTS[0]}',
    )  # fmt: skip
    command.add_argument(
        '--limit', type=float, default=20.0, metavar='S',
        help='wall time after which a run counts as too slow [s], default 20; a run of ensemble, '
        'cycle or robust is one call and has no limit',
    )  # fmt: skip
    add_other_sources(command)
    add_scene_options(command)


def _bench(options: argparse.Namespace) -> int:
    from snake_sim_benchmarks.comparison import bench, bench_rows
    from snake_sim_benchmarks.comparison.contenders import check_times
    from snake_sim_benchmarks.comparison.timing import note_on_step_times

    names = options.scene or (QUICK_CASES if options.quick else CASES)
    scenes = {source: scene_from(options, source) for source in names}
    contenders = _contenders(options.methods or [], quick=options.quick)
    check_times(scenes.values(), options.dt or (), options.limit)
    if options.dt:
        rates = tuple(1 / dt for dt in dict.fromkeys(options.dt))
        contenders = [c if c.adaptive else replace(c, rates=rates) for c in contenders]
    selected = options.scene or options.methods or options.dt
    usual = SELECTED_PARTS if selected else QUICK_PARTS if options.quick else PARTS
    parts = bench.matrix(scenes, contenders, _field(options), options.limit, quick=options.quick)
    entries = [entry for name in dict.fromkeys(options.parts or usual) for entry in parts[name]]
    writer = TableWriter(
        options.out, 'bench', bench_rows.COLUMNS, options.set, other_sources=options.other_sources
    )
    if note := note_on_step_times():
        print(note, file=sys.stderr)
    _write_rows(writer, entries)
    print(f'{options.out} is complete; snake-sim chart {options.out} draws it')
    return 0


def _field(options: argparse.Namespace) -> 'Field':
    """Return what finds the entrants of a case, with their steps a second or those of --dt."""
    from snake_sim_benchmarks.comparison.entrants import attempts, entrants

    rates = [1 / dt for dt in dict.fromkeys(options.dt or ())]
    return lambda case: attempts(entrants(case, options.methods or (), quick=options.quick), rates)


def _contenders(methods: list[str], *, quick: bool) -> 'list[Contender]':
    """Return the contenders of the matrix, or those of some methods."""
    from snake_sim_benchmarks.comparison.contenders import all_contenders, quick_contenders
    from snake_sim_benchmarks.comparison.entrants import JUDGED_METHODS

    contenders = quick_contenders() if quick else all_contenders()
    known = sorted({contender.method for contender in contenders} | JUDGED_METHODS)
    for method in methods:
        if method not in known:
            raise ParameterError(f'no method {method!r} in the matrix; it has: {", ".join(known)}')
    return [contender for contender in contenders if contender.method in (methods or known)]


def _write_rows(writer: TableWriter, entries: 'Iterable[Entry]') -> None:
    """Run what the table does not have yet, and show the progress."""
    from snake_sim_benchmarks.comparison import bench_rows

    layout = '{percentage:3.0f} %|{bar}| {elapsed}, about {remaining} left'
    done = {bench_rows.key(row) for row in writer.rows}
    entries = [entry for entry in entries if not entry.is_in(done)]
    total = sum(entry.guess for entry in entries)
    with tqdm(total=total, bar_format=layout, smoothing=0) as bar:
        for entry in entries:
            rows = bench_rows.outcome(entry)
            writer.append(map(plain, rows))
            for row in rows:
                bar.write(bench_rows.line(row))
            bar.update(entry.guess)

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The commands: the arguments of each, and what it does.

What computes or draws is imported when its command runs: that takes up to two seconds, which
``./run bench --help`` need not wait for.
"""

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
import sys
from typing import Any, cast, TYPE_CHECKING

from tqdm import tqdm

from snake_sim_benchmarks.comparison.csv_tables import plain, read_table, records_of, TableWriter
from snake_sim_benchmarks.reliability.trials import COLUMNS, page, Part
from snake_sim_ros import ParameterError
from snake_sim_ros.commands.options import add_method, add_scene_options, CASES, scene_from
from snake_sim_ros.nodes.programs import missing_ros

# ---- options of commands whose CSV files grow row by row ----------------------------------------


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
        help='continue a file whose rows are from other sources; new rows get a head of their own',
    )  # fmt: skip


# ---- bench --------------------------------------------------------------------------------------


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
    add_table_file(command, 'bench.csv', 'rows that are already in it are not run again')
    command.add_argument('--quick', action='store_true', help='a small matrix of two minutes')
    command.add_argument(
        '--methods', nargs='+', metavar='METHOD', help='only these, such as newton mujoco'
    )
    command.add_argument(
        '--dt',
        nargs='+',
        type=float,
        metavar='S',
        help='time steps [s], instead of the usual ones',
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
    print(f'{options.out} is complete; ./run chart {options.out} draws it')
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


# ---- artefacts ----------------------------------------------------------------------------------


def add_artefacts(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('artefacts')
    command.set_defaults(command=_artefacts)
    add_table_file(command, 'artefacts.csv', 'rows that are already in it are not measured again')
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


# ---- stability ----------------------------------------------------------------------------------


def add_stability(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('stability')
    command.set_defaults(command=_stability)
    command.add_argument(
        '--maps', nargs='+', metavar='MAP', help='only these, such as friction drop_flat'
    )
    command.add_argument('--quick', action='store_true', help='coarse maps, which take a minute')
    add_table_file(command, 'stability.csv', 'cells that are already in it are not run again')
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
    print(f'{options.out} is complete; ./run chart {options.out} draws it')
    return 0


# ---- limits -------------------------------------------------------------------------------------


def add_limits(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('limits')
    command.set_defaults(command=_limits)
    command.add_argument(
        '--scenes', type=int, default=100, metavar='N', help='random scenes; default: 100'
    )
    add_table_file(command, 'limits.csv', 'scenes that are already in it are not run again')
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


# ---- chart --------------------------------------------------------------------------------------


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


# ---- levels -------------------------------------------------------------------------------------


SCENES = (*CASES, 'slender_undulation', 'obstacle_aided', 'step')


def add_levels(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('levels')
    command.set_defaults(command=_levels)
    command.add_argument(
        'scene', nargs='*', default=list(SCENES), help=f'default: {", ".join(SCENES)}'
    )
    add_method(command)
    add_scene_options(command)


def _levels(options: argparse.Namespace) -> int:
    from snake_sim_benchmarks.comparison import timing

    scenes = {source: scene_from(options, source) for source in options.scene}
    if note := timing.note_on_step_times():
        print(note, file=sys.stderr)
    print(f'{"scene":29} {"level":11} {"step":>8} {"spatial":>8} {"faster":>7} {"error":>9} '
          f'{"spatial":>9} {"converged":>9}')  # fmt: skip
    for source, scene in tqdm(scenes.items(), desc='levels', unit=' scenes', leave=False):
        row = timing.level_row(scene)
        tqdm.write(f'{source:29} {row.level:11} {row.median:5.2f} us {row.spatial_median:5.2f} us '
              f'{row.spatial_median / row.median:5.2f} x {100 * row.error:7.4f} % '
              f'{100 * row.spatial_error:7.4f} % {100 * row.doubt:7.4f} %  {row.why}')  # fmt: skip
    print(
        'step: median at the level that auto takes, and at the spatial one; error: of the path of '
        'the\nmiddle link against the converged path of the spatial level, over the distance '
        'travelled;\nconverged: error of the finer of the two runs that this is extrapolated from'
    )
    return 0


# ---- figures ------------------------------------------------------------------------------------


def add_figures(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('figures')
    command.set_defaults(command=_figures)
    command.add_argument(
        '--duration',
        type=float,
        default=15.0,
        help='of each case [s], default 15',
    )
    command.add_argument(
        '--out', type=Path, default=Path(), metavar='FOLDER', help='default: this folder'
    )


def _figures(options: argparse.Namespace) -> int:
    from snake_sim_benchmarks.paper.figures import draw_figures

    for file in draw_figures(options.out, options.duration):
        print(file)
    return 0


# ---- published ----------------------------------------------------------------------------------


def add_published(subparsers: Any) -> None:
    """Add the command."""
    subparsers.add_parser('published').set_defaults(command=_published)


def _published(options: argparse.Namespace) -> int:
    from snake_sim_benchmarks.published import lines

    for line in lines():
        print(line, flush=True)
    return 0


# ---- pacing -------------------------------------------------------------------------------------


RATES = (50.0, 100.0, 200.0, 500.0)  # publish rates [Hz]


def add_pacing(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('pacing')
    command.set_defaults(command=_pacing)
    command.add_argument('--duration', type=float, default=5.0, help='of each part [s], default 5')
    command.add_argument(
        '--rates', nargs='*', type=float, default=RATES, metavar='HZ',
        help='publish rates for the runs as fast as possible, default 50 100 200 500',
    )  # fmt: skip


def _pacing(options: argparse.Namespace) -> int:
    try:
        from snake_sim_benchmarks.pacing import pacing
    except ImportError as error:
        raise missing_ros('pacing', 'pacing', error) from None
    return pacing(options.duration, options.rates)


# ---- fuzz and soak ------------------------------------------------------------------------------


# Modules of the room `reliability`.
FUZZ = ('files', 'messages', 'pages', 'states', 'physics', 'worlds')
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
        help=f'only these parts, which share the time; one or more of {", ".join(parts)}',
    )  # fmt: skip
    command.add_argument('--seed', type=int, default=0, help='of all random choices, default 0')
    add_table_file(command, f'{name}.csv', 'an existing file is continued')
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

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `snake-sim study`: many runs of a scene with other values, and what they measure."""

import argparse
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
import json
import logging
from pathlib import Path
import sys
import time
from typing import Any, TYPE_CHECKING

from tqdm import tqdm

from snake_sim_ros.scene.checked_records import ParameterError

if TYPE_CHECKING:
    from snake_sim_ros.studies.study import Study

MOST_CASES = 8  # values of the third one that varies, each with maps of its own in a picture


def add_study(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('study')
    command.set_defaults(command=_study)
    command.add_argument('study', type=Path, help='YAML file, see docs/studies.md')
    command.add_argument(
        '--out', type=Path, metavar='FILE',
        help='the table, Parquet or CSV by its suffix, default: the name of the study with '
        '.parquet; the journal beside it has all runs, which are not done again',
    )  # fmt: skip
    command.add_argument(
        '--plot', type=Path, metavar='FILE.png', help='draw the metrics over one or two values'
    )
    command.add_argument(
        '--trajectories', type=Path, metavar='FOLDER', help='keep an npz file of every run'
    )
    add_workers(command)


def add_workers(command: argparse.ArgumentParser) -> None:
    """Add the options that choose who does the runs."""
    group = command.add_mutually_exclusive_group()
    group.add_argument('--threads', type=int, metavar='N', help='default: one for each core')
    group.add_argument('--processes', type=int, metavar='N', help='processes instead of threads')
    group.add_argument(
        '--scheduler', metavar='ADDRESS',
        help='of a Dask cluster, such as tcp://10.0.0.1:8786; local starts one here',
    )  # fmt: skip


def workers_of(options: argparse.Namespace) -> AbstractContextManager[Any]:
    """
    Return the workers that the options choose.

    Raises
    ------
    ParameterError
        If a number is not above 0.

    """
    from snake_sim_ros.studies import table, workers

    for name in ('threads', 'processes'):
        number = getattr(options, name)
        if number is not None and number < 1:
            raise ParameterError(f'--{name} must be at least 1, got {number}')
    if options.scheduler is not None:
        # What happens to a cluster is one sentence of this command, not pages of its log.
        # Dask sets the levels of its own when it is imported.
        table.optional('distributed', 'a cluster needs Dask')
        for name in ('distributed', 'distributed.client', 'tornado.application'):
            logging.getLogger(name).setLevel(logging.CRITICAL)
        return workers.cluster(options.scheduler)
    if options.processes is not None:
        return workers.processes(options.processes)
    return workers.threads(options.threads)


class _Bar:
    """A bar of rows, and what became of them."""

    def __init__(self, total: int) -> None:
        layout = (
            '{percentage:3.0f} %|{bar}| {n} of {total} runs, {rate_noinv_fmt}, {remaining} left'
        )
        self.bar = tqdm(total=total, unit=' runs', bar_format=layout)
        self.statuses: Counter[str] = Counter()
        self.found, self.first_failure, self.begin = 0, '', time.perf_counter()

    def __call__(self, results: Sequence[dict[str, Any]], is_new: bool) -> None:
        """Show that rows are done."""
        self.statuses.update(result['status'] for result in results)
        for result in results:
            self.first_failure = self.first_failure or result['failure']
        if is_new:
            self.bar.update(len(results))
        else:
            self.found = self.bar.n = self.bar.initial = len(results)
            self.bar.refresh()

    def summary(self, out: Path) -> dict[str, Any]:
        """Return how the study went, name -> value as JSON has them."""
        seconds, count = time.perf_counter() - self.begin, sum(self.statuses.values())
        new = count - self.found
        return {
            'rows': self.bar.total, 'done': count, 'found': self.found, **self.statuses,
            'seconds': seconds, 'runs_per_second': new / seconds, 'out': str(out),
        }  # fmt: skip


def chart_module(option: str) -> Any:
    """
    Return the module that draws.

    Parameters
    ----------
    option : str
        What needs it, for the message.

    Raises
    ------
    ParameterError
        If matplotlib is not installed.

    """
    try:
        from snake_sim_ros.studies import chart
    except ImportError as error:
        raise ParameterError(
            f"{option} needs matplotlib ({error}): pip install 'snake_sim_ros[plots]'"
        ) from None
    return chart


def _plotter(path: Path, study: 'Study') -> Callable[[Any], object]:
    """Return what draws the table of a study; raise an error if that is not possible."""
    from snake_sim_ros.studies.table import check_file, PICTURES
    from snake_sim_ros.studies.variations import Range

    chart, names = chart_module('--plot'), list(study.variations.of)
    check_file(path, '--plot', PICTURES)
    third = study.variations.of[names[2]] if len(names) == 3 else None
    values = getattr(third, 'values', None)
    if len(names) > 3 or (third and not 0 < len(values or ()) <= MOST_CASES):
        raise ParameterError(
            f'--plot draws one or two values that vary, for each of at most {MOST_CASES} values '
            f'of a third one, which is the last; this study has {", ".join(names)}'
        )
    of = study.variations.of.items()
    scales = {name: item.scale for name, item in of if isinstance(item, Range)}
    return lambda frame: chart.draw_study(frame, names, scales, study.metrics, path)


def _compile(study: 'Study') -> None:
    """Compile what the first row needs that can be run, and count."""
    from snake_sim_ros.stepping.simulation import Simulation
    from snake_sim_ros.studies.runs import scene_of
    from snake_sim_ros.view.compile_bar import compile_with_bar

    plan = study.plan()
    for row in study.rows():
        try:
            compile_with_bar(Simulation(scene_of(plan, row.values)))
        except ParameterError:
            continue
        return


def _study(options: argparse.Namespace) -> int:
    """Run a study; the last line on standard output is JSON."""
    from snake_sim_ros.studies.study import load_study, run_study
    from snake_sim_ros.studies.table import beside, check_file, library

    study = load_study(options.study)
    out = options.out or Path(f'{options.study.stem}.parquet')
    check_file(out, '--out')
    library()
    folder = options.trajectories
    if folder is None and study.settings.keep == 'trajectories':
        folder = beside(out, 'trajectories')
    plot = _plotter(options.plot, study) if options.plot else None
    workers = workers_of(options)
    if options.scheduler is None and options.processes is None:
        _compile(study)
    bar, interrupted = _Bar(len(study.variations)), False
    with bar.bar:
        try:
            frame = run_study(study, out, folder, workers, bar)
            if plot:
                plot(frame)
        except KeyboardInterrupt:
            interrupted = True
    if bar.first_failure:
        print(f'the first failure: {bar.first_failure}', file=sys.stderr)
    print(f'{bar.summary(out)["done"]} rows in {out}')
    print(json.dumps(bar.summary(out)))
    return 130 if interrupted else 0

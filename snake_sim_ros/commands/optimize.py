# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `snake-sim optimize`: the values of a scene for which something is best."""

import argparse
from collections.abc import Callable
import json
from pathlib import Path
import sys
import time
from typing import Any, TYPE_CHECKING

from tqdm import tqdm

from snake_sim_ros.commands.study import add_workers, chart_module, workers_of
from snake_sim_ros.scene.checked_records import ParameterError

if TYPE_CHECKING:
    from snake_sim_ros.studies.optimization import Evaluation, Outcome
    from snake_sim_ros.studies.problem import Problem

LAYOUT = '{percentage:3.0f} %|{bar}| {n} of {total} evaluations, {rate_noinv_fmt}{postfix}'


def add_optimize(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('optimize')
    command.set_defaults(command=_optimize)
    command.add_argument('study', type=Path, help='YAML file')
    command.add_argument(
        '--out', type=Path, metavar='FILE',
        help='the history, Parquet or CSV by its suffix, default: the name of the study with '
        '.parquet; the best scene is beside it, and the journal of runs that are not run again',
    )  # fmt: skip
    command.add_argument(
        '--plot', type=Path, metavar='FILE.png',
        help='picture of the front, or of the objective, default: the name of the history',
    )  # fmt: skip
    add_workers(command)


class _Bar:
    """A bar of evaluations, with the best objective so far."""

    def __init__(self, problem: 'Problem') -> None:
        self.problem, self.best, self.first_failure = problem, list[float](), ''
        self.bar = tqdm(
            total=problem.stop.evaluations, unit=' evaluations', bar_format=LAYOUT, initial=0
        )

    def __call__(self, evaluation: 'Evaluation') -> None:
        """Show that an evaluation is done."""
        self.first_failure = self.first_failure or evaluation.failure
        if not evaluation.is_new:
            self.bar.initial += 1  # it does not count in evaluations a second
        if evaluation.is_feasible:
            pairs = zip(self.best or evaluation.losses, evaluation.losses, strict=True)
            self.best = [min(pair) for pair in pairs]
            shown = zip(self.problem.objectives, self.best, strict=True)
            numbers = [f'{item.sign * loss:.4g}' for item, loss in shown]
            self.bar.set_postfix_str(f'best {" and ".join(numbers)}', refresh=False)
        self.bar.update(1)


def _plotter(path: Path | None, out: Path) -> 'Callable[[Outcome], Path] | None':
    """Return what draws; None without matplotlib, unless a picture is asked for."""
    from snake_sim_ros.studies.table import beside, check_file, PICTURES

    try:
        chart = chart_module('a picture')
    except ParameterError as error:
        if path:
            raise
        print(error, file=sys.stderr)
        return None
    file = path or beside(out, 'picture')
    check_file(file, '--plot', PICTURES)

    def plot(outcome: 'Outcome') -> Path:
        chart.draw_optimization(outcome, file)
        return file

    return plot


def _compile(problem: 'Problem') -> None:
    """Compile what the scene needs, and its check, and count what is compiled."""
    from snake_sim_ros.stepping.simulation import Simulation
    from snake_sim_ros.studies.runs import scene_of
    from snake_sim_ros.view.compile_bar import compile_with_bar

    for plan in [problem.plan(), problem.check_plan()][: 2 if problem.check else 1]:
        try:
            compile_with_bar(Simulation(scene_of(plan, problem.present()[1])))
        except ParameterError:  # other values may do
            continue


def _optimize(options: argparse.Namespace) -> int:
    """Run an optimization; the last line on standard output is JSON."""
    from snake_sim_ros.studies.optimization import Outcome, run_optimization, summary, write_scenes
    from snake_sim_ros.studies.problem import load_problem
    from snake_sim_ros.studies.table import check_file, library

    problem = load_problem(options.study)
    out = options.out or Path(f'{options.study.stem}.parquet')
    check_file(out, '--out')
    library()
    plot, workers = _plotter(options.plot, out), workers_of(options)
    if options.scheduler is None and options.processes is None:
        _compile(problem)
    outcome, bar, begin = Outcome(problem), _Bar(problem), time.monotonic()
    with bar.bar:
        try:
            run_optimization(outcome, out, workers, bar)
        except KeyboardInterrupt:
            pass
    seconds = time.monotonic() - begin
    files: dict[str, Any] = {'out': str(out)}
    if outcome.evaluations:
        files['scenes'] = [str(path) for path in write_scenes(outcome, out)]
        if plot:
            files['plot'] = str(plot(outcome))
    if bar.first_failure:
        print(f'the first failure: {bar.first_failure}', file=sys.stderr)
    _print_best(outcome)
    found = summary(outcome)
    new = found['evaluations'] - found['found']
    print(json.dumps(
        {**found, 'seconds': seconds, 'evaluations_per_second': new / seconds, **files}
    ))  # fmt: skip
    if outcome.stopped == 'interrupted':
        return 130
    return 0 if outcome.best else 1


def _print_best(outcome: 'Outcome') -> None:
    """Print the best, and what its check says; or that nothing is feasible."""
    texts = [item.expression.text for item in outcome.problem.objectives]
    check = ', '.join(f'{name} {value}' for name, value in outcome.problem.check.items())

    def show(name: str, item: 'Evaluation') -> None:
        pairs = zip(texts, outcome.objectives_of(item), strict=True)
        numbers = ', '.join(f'{text}: {number:.6g}' for text, number in pairs)
        holds = 'hold' if item.is_feasible else 'DO NOT HOLD'
        print(f'{name}: {numbers}' + f'; constraints {holds}' * bool(outcome.problem.constraints))

    if not outcome.best and outcome.evaluations:
        least = min(outcome.evaluations, key=lambda item: item.excess)
        print(
            f'no evaluation holds all constraints; evaluation {least.point.number} is nearest, '
            f'off by {least.excess:.3g} of the bounds', file=sys.stderr,
        )  # fmt: skip
    for item in [*outcome.evaluations[:1], *outcome.best]:
        number = item.point.number
        show('scene as it was' if number == 0 else f'evaluation {number}', item)
        if number in outcome.checks:
            show(f'  checked by {check}', outcome.checks[number])

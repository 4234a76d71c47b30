# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tables in Markdown of the parts of the bench, with fronts of cost and error, and orders."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
import math

import numpy as np

from snake_sim_benchmarks.comparison.bench_rows import Row
from snake_sim_ros.stepping.methods import METHODS

# ---- the fastest method for an accuracy ---------------------------------------------------------


def is_ours(row: Row) -> bool:
    """Return whether a row is of a method of this package."""
    return row.method in METHODS


def fastest(rows: Iterable[Row], target: float) -> Row | None:
    """Return the run with the least wall time whose path error is at most `target`."""
    good = [row for row in rows if row.error_path <= target and row.seconds_per_second > 0.0]
    return min(good, key=lambda row: row.seconds_per_second, default=None)


def fitted_order(rows: Sequence[Row]) -> float:
    """
    Return the order of convergence: the power of dt that the errors of the time step follow.

    Only errors between ten times that of the reference and 0.1 are used. It is nan if there are
    fewer than three.
    """
    points = [
        (row.dt, row.error_limit)
        for row in rows
        if 0.0 < row.error_limit < 0.1 and not row.error_limit < 10 * row.reference_error
    ]
    if len(points) < 3:
        return math.nan
    dt, error = zip(*points, strict=True)
    return fitted_power(dt, error)


def fitted_power(x: Sequence[float], y: Sequence[float]) -> float:
    """Return the exponent of the power law that fits y over x best on logarithmic scales."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def front(points: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """
    Return the (cost, error) that nobody beats in both, cheapest first.

    Points without a cost or an error, or with one that is not finite, are left out.
    """
    found: list[tuple[float, float]] = []
    for cost, error in sorted(points):
        known = 0.0 < cost < math.inf and 0.0 < error < math.inf
        if known and (not found or error < found[-1][1]):
            found.append((cost, error))
    return found


def cost_at(points: Iterable[tuple[float, float]], error: float) -> float:
    """
    Return the cost of an error on the front of some points (cost, error).

    Between two points it is interpolated with logarithms of both. For an error above that of the
    cheapest point it is the cost of that point, and nan below the least error of all.
    """
    best = front(points)
    if not best or error < best[-1][1]:
        return math.nan
    costs, errors = np.log(best).T
    return float(np.exp(np.interp(-math.log(error), -errors, costs)))


# ---- tables -------------------------------------------------------------------------------------


# Settings of the part `user`.
LOOP, RUN, CALL = 'compiled loop', 'run() at 100 Hz', 'run() at 100 Hz, whole call'
ADVANCE, REFERENCE = 'advance() by one step', 'gait_reference() of one step'
CONTROLLED = 'controller in Python at 100 Hz, angles and rates'
COMMAND = 'snake-sim run, everything compiled before'

THREADS = (1, 2)  # of the part `throughput`
THROUGHPUT_BOUNDS = (0.05, 0.01, 0.001)  # of the distance from start to end
ROBUST_BOUNDS = (0.05, 0.02, 0.01, 0.005, 0.001)  # of the distance from start to end
# Part, case and root mean square of the errors at which speeds are compared.
COMPARED = (
    *(('ensemble', 'sidewinding', error) for error in (0.022, 0.013, 0.0105)),
    *(('ensemble', 'sinus_lifting', error) for error in (0.03, 0.008)),
    *(('ensemble', 'lateral_undulation', error) for error in (0.013, 0.005)),
    ('cycle', 'lateral_undulation', 0.001),
    ('cycle', 'lateral_undulation_isotropic', 0.001),
    ('cycle', 'sidewinding', 0.001),
    ('cycle', 'sinus_lifting', 0.001),
)


def of_step(row: Row) -> str:
    """Return method, setting and step of a row as text."""
    setting = '' if row.setting == 'default' and is_ours(row) else f', {row.setting}'
    return f'`{row.method}`{setting}, 1/{1 / row.dt:.4g} s'


def speed(cost: float) -> str:
    """Return how many times faster than real time a cost is, or none."""
    return 'none' if math.isnan(cost) else f'{1 / cost:.0f}'


def point(row: Row) -> tuple[float, float]:
    """Return cost and root mean square of a row with a spread."""
    return row.seconds_per_second, row.error_rms


def sides(rows: Iterable[Row], part: str, case: str) -> tuple[list[Row], list[Row]]:
    """Return the rows of a part and a case that are ours, and those of others."""
    here = [row for row in rows if (row.part, row.case) == (part, case)]
    return [row for row in here if is_ours(row)], [row for row in here if not is_ours(row)]


def spread_table(rows: Sequence[Row], part: str) -> str:
    """
    Return a table of the fronts of `ensemble` or `cycle`: ours, and all others.

    A row is there if no other one of its side is both faster and better.
    """
    lines = ['| case | method | RMS error | 90 % interval | median | 90 % of runs | trials '
             '| times real time |', '|---|---|---|---|---|---|---|---|']  # fmt: skip
    for case in dict.fromkeys(row.case for row in rows if row.part == part):
        for side in sides(rows, part, case):
            best = set(front(map(point, side)))
            for row in sorted((row for row in side if point(row) in best), key=point):
                cells = [
                    f'`{case}`',
                    of_step(row),
                    percent(row.error_rms),
                    f'{percent(row.rms_low)} to {percent(row.rms_high)}',
                    percent(row.error_median),
                    percent(row.error_quantile),
                    f'{row.trials or 0}',
                    speed(row.seconds_per_second),
                ]
                lines.append(f'| {" | ".join(cells)} |')
    return '\n'.join(lines) + '\n'


def accuracy_table(rows: Sequence[Row]) -> str:
    """Return a table of the accuracies that were asked for, and of the errors that were made."""
    lines = ['| case | accuracy | RMS error | 90 % interval | median | 90 % of runs '
             '| error of the reference | trials | times real time |',
             '|---|---|---|---|---|---|---|---|---|']  # fmt: skip
    for row in rows:
        if row.part == 'accuracy':
            errors = (row.error_rms, row.error_median, row.error_quantile, row.reference_error)
            rms, median, quantile, doubt = (f'{error:.1e}' for error in errors)
            cells = [
                f'`{row.case}`',
                f'{row.tolerance:.0e}',
                rms,
                f'{row.rms_low:.1e} to {row.rms_high:.1e}',
                median,
                quantile,
                doubt,
                f'{row.trials or 0}',
                speed(row.seconds_per_second),
            ]
            lines.append(f'| {" | ".join(cells)} |')
    return '\n'.join(lines) + '\n'


def percent(value: float) -> str:
    """Return a share in percent with two digits."""
    return f'{100 * value:.2g} %'


def speeds_table(rows: Sequence[Row]) -> str:
    """
    Return a table of speeds at given errors, ours and those of the best of the others.

    Speeds are on the front of each side, see `pareto.cost_at`.
    """
    lines = ['| judged by | case | RMS error | ours, times real time | MuJoCo, times real time '
             '| ratio |', '|---|---|---|---|---|---|']  # fmt: skip
    for part, case, error in COMPARED:
        ours, others = sides(rows, part, case)
        if not ours and not others:
            continue
        mujoco = [row for row in others if row.method == 'mujoco']
        costs = [cost_at(map(point, side), error) for side in (ours, mujoco)]
        ratio = costs[1] / costs[0]
        cells = [
            part,
            f'`{case}`',
            f'{100 * error:g} %',
            *map(speed, costs),
            '' if math.isnan(ratio) else f'{ratio:.1f}',
        ]
        lines.append(f'| {" | ".join(cells)} |')
    return '\n'.join(lines) + '\n'


def robust_table(rows: Sequence[Row]) -> str:
    """Return a table of the fastest methods whose largest error stays below a bound."""
    lines = ['| case | largest error | fastest method of ours | times real time | its error '
             '| fastest of the others | times real time | its error |',
             '|---|---|---|---|---|---|---|---|']  # fmt: skip
    for case in dict.fromkeys(row.case for row in rows if row.part == 'robust'):
        for bound in ROBUST_BOUNDS:
            cells = [f'`{case}`', f'{100 * bound:g} %']
            for side in sides(rows, 'robust', case):
                best = fastest(side, bound)
                cells += ['none', '', ''] if best is None else [
                    of_step(best), speed(best.seconds_per_second), percent(best.error_path),
                ]  # fmt: skip
            lines.append(f'| {" | ".join(cells)} |')
    return '\n'.join(lines) + '\n'


def on_threads(setting: str, threads: int) -> str:
    """Return the setting of a row of `throughput`."""
    return f'{setting}, {threads} thread{"s" if threads > 1 else ""}'


def throughput_table(rows: Sequence[Row]) -> str:
    """
    Return a table of robot-seconds in a second, of the fastest methods up to some errors.

    The fastest method is the one with the most on all threads.
    """
    most = THREADS[-1]
    lines = ['| case | largest error | ours | 1 thread | 2 threads | its error | robots '
             '| MuJoCo | 1 thread | 2 threads | its error | robots |',
             '|---|---|---|---|---|---|---|---|---|---|---|---|']  # fmt: skip
    for case in dict.fromkeys(row.case for row in rows if row.part == 'throughput'):
        for bound in THROUGHPUT_BOUNDS:
            cells = [f'`{case}`', f'{100 * bound:g} %']
            for side in sides(rows, 'throughput', case):
                ending = on_threads('', most)
                best = fastest([row for row in side if row.setting.endswith(ending)], bound)
                if best is None:
                    cells += ['none', '', '', '', '']
                    continue
                setting = best.setting.removesuffix(ending)
                costs = {
                    row.setting: row.seconds_per_second
                    for row in side
                    if (row.method, row.dt) == (best.method, best.dt)
                }
                cells += [
                    of_step(replace(best, setting=setting)),
                    *(speed(costs[on_threads(setting, threads)]) for threads in THREADS),
                    percent(best.error_path),
                    f'{best.trials or 0}',
                ]
            lines.append(f'| {" | ".join(cells)} |')
    return '\n'.join(lines) + '\n'


def agreement_table(rows: Sequence[Row]) -> str:
    """Return a table of the distances of other solvers from the path of `newton`."""
    lines = ['| case | solver | stops at | difference of paths | steps | unconverged |',
             '|---|---|---|---|---|---|']  # fmt: skip
    for row in rows:
        if row.part == 'agreement':
            setting, _, unit = row.setting.partition(' in ')
            cells = [
                f'`{row.case}`',
                f'`{row.method}`',
                f'`{setting}` {row.tolerance:g} {unit}',
                f'{row.path_difference:.1e}',
                f'{row.steps or 0}',
                f'{row.unconverged or 0}',
            ]
            lines.append(f'| {" | ".join(cells)} |')
    return '\n'.join(lines) + '\n'


def user_table(rows: Sequence[Row]) -> str:
    """Return a table of what is left of the speed of the compiled loop for a user."""
    lines = ['| scene | method | step [s] | compiled loop [x real time] | `run` at 100 Hz | '
             'ratio | `run` with a controller | `advance` by one step [us] '
             '| `gait_reference` of one step [us] '
             '| `snake-sim run` from the shell [s] |',
             '|---|---|---|---|---|---|---|---|---|---|']  # fmt: skip
    found = [row for row in rows if row.part == 'user']
    shells = {row.case: f'{row.seconds:.2f}' for row in found if row.setting == COMMAND}
    for loop in (row for row in found if row.setting == LOOP):
        same = {
            row.setting: row
            for row in found
            if (row.case, row.method, row.dt) == (loop.case, loop.method, loop.dt)
        }
        cells = [
            f'`{loop.case}`',
            f'`{loop.method}`',
            f'1/{1 / loop.dt:.0f}',
            f'{1 / loop.seconds_per_second:.0f}',
            f'{1 / same[RUN].seconds_per_second:.0f}',
            f'{same[RUN].seconds_per_second / loop.seconds_per_second:.2f}',
            f'{1 / same[CONTROLLED].seconds_per_second:.0f}' if CONTROLLED in same else '',
            f'{same[ADVANCE].median_us:.0f}',
            f'{same[REFERENCE].median_us:.0f}',
            shells.pop(loop.case, ''),
        ]
        lines.append(f'| {" | ".join(cells)} |')
    return '\n'.join(lines) + '\n'


def soak_table(rows: Sequence[Row]) -> str:
    """Return a table of penetration, memory and unconverged steps in very long runs."""
    lines = ['| scene | level | steps | unconverged | penetration at the end [m] | largest [m] '
             '| memory, begin to end [MB] | wall time [s] |',
             '|---|---|---|---|---|---|---|---|']  # fmt: skip
    for row in rows:
        if row.part == 'soak':
            memory = [
                'unknown' if size is None else f'{size / 1e6:.1f}'
                for size in (row.memory_begin, row.memory_end)
            ]
            cells = [
                f'`{row.case}`',
                row.level,
                f'{row.steps or 0}',
                f'{row.unconverged or 0}',
                f'{row.penetration_end:.1e}',
                f'{row.penetration_max:.1e}',
                ' to '.join(memory),
                f'{row.seconds:.0f}',
            ]
            lines.append(f'| {" | ".join(cells)} |')
    return '\n'.join(lines) + '\n'

"""The fastest method for an accuracy, and orders of convergence."""

from collections.abc import Iterable
from collections.abc import Sequence
import math

import numpy as np

from snake_sim_ros.comparison.bench_rows import Row
from snake_sim_ros.stepping.methods import METHODS

ERROR_TARGETS = (0.05, 0.01, 0.001)  # of the distance from start to end


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


def pareto_table(rows: Sequence[Row]) -> str:
    """Return a table in Markdown of the fastest methods, ours and others, for each error."""
    rows = [row for row in rows if row.part == 'precision']
    lines = [
        '| case | error | fastest method of ours | times real time | its error '
        '| fastest of the others | times real time | its error |',
        '|---|---|---|---|---|---|---|---|',
    ]
    for case in dict.fromkeys(row.case for row in rows):
        here = [row for row in rows if row.case == case]
        for target in ERROR_TARGETS:
            cells = [f'`{case}`', f'{100 * target:g} %']
            for ours in (True, False):
                best = fastest((row for row in here if is_ours(row) == ours), target)
                cells += ['none', '', ''] if best is None else _cells(best)
            lines.append(f'| {" | ".join(cells)} |')
    return '\n'.join(lines) + '\n'


def _cells(row: Row) -> list[str]:
    step = f'tolerance {row.tolerance:g}' if row.tolerance > 0.0 else f'1/{1 / row.dt:.0f} s'
    level = f'{row.level}, ' if is_ours(row) else ''
    setting = '' if row.setting == 'default' else f', {row.setting}'
    unconverged = f', {row.unconverged} steps unconverged' if row.unconverged else ''
    return [
        f'`{row.method}`, {level}{step}{setting}{unconverged}',
        f'{1 / row.seconds_per_second:.0f}',
        f'{100 * row.error_path:.2g} %',
    ]

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The charts of ensembles and cycles: root mean squares of errors over cost, with error bars."""

from collections.abc import Sequence
import math
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from snake_sim_benchmarks.comparison.bench_rows import Row
from snake_sim_benchmarks.comparison.bench_tables import point
from snake_sim_benchmarks.comparison.chart_style import (
    CASE_TITLES,
    METHOD_STYLES,
    panels,
    plot_line,
)
from snake_sim_benchmarks.comparison.pareto import front

WAYS = {
    'ensemble': 'distance from start to end',
    'cycle': 'distance gone in a period',
}


def spreads_figure(rows: Sequence[Row]) -> Figure:
    """
    Draw root mean squares over cost, a panel for each case; points at the lower left are best.

    Bars are bootstrap intervals. A method with one setting is a line over its steps. Of a method
    with many the thick line is the front, the points that no other setting beats in both.
    """
    rows = [row for row in rows if row.error_rms > 0.0]
    cases = list(dict.fromkeys(row.case for row in rows))
    figure, all_axes = panels(len(cases), min(2, len(cases)), 3.2)
    costs = [row.seconds_per_second for row in rows]
    decades = math.floor(math.log10(min(costs))), math.ceil(math.log10(max(costs)))
    legend: dict[str, Any] = {}
    for axes, case in zip(all_axes, cases, strict=True):
        here = [row for row in rows if row.case == case]
        for method in METHOD_STYLES:
            line = [row for row in here if row.method == method]
            if line:
                legend.setdefault(METHOD_STYLES[method][2], _draw(axes, line))
        doubt = max(row.reference_error for row in here)
        low = min([doubt, *(min(row.rms_low, row.error_rms) for row in here)])
        axes.axhspan(1e-9, max(doubt, 1e-9), color='#dddddd', zorder=0)
        axes.set(xscale='log', yscale='log', title=CASE_TITLES.get(case, case))
        axes.set_xlim(*(10.0**decade for decade in decades))
        axes.set_ylim(low / 2, min(2.0, 2.0 * max(row.error_rms for row in here)))
        axes.set_xlabel('processor time / simulated time')
        axes.set_ylabel(f'RMS error / {WAYS[here[0].part]}')
        axes.grid(alpha=0.3, which='major')
    figure.legend(legend.values(), legend, loc='outside lower center', ncols=4, frameon=False)
    return figure


def _draw(axes: Axes, rows: Sequence[Row]) -> Any:
    """Draw all rows of a method, and return its thick line."""
    method, settings = rows[0].method, list(dict.fromkeys(row.setting for row in rows))
    best = sorted(rows, key=point)
    if len(settings) > 1:
        for setting in settings:
            line = sorted((row for row in rows if row.setting == setting), key=point)
            plot_line(axes, *_columns(line), method, 'spatial', main=False)
        points = set(front(map(point, rows)))
        best = [row for row in best if point(row) in points]
    x, y = _columns(best)
    below = [max(row.error_rms - row.rms_low, 0.0) for row in best]
    above = [max(row.rms_high - row.error_rms, 0.0) for row in best]
    color = METHOD_STYLES[method][0]
    axes.errorbar(x, y, yerr=(below, above), fmt='none', ecolor=color, elinewidth=1.0, capsize=2.0)
    return plot_line(axes, x, y, method, 'spatial', main=True)


def _columns(rows: Sequence[Row]) -> tuple[list[float], list[float]]:
    return [row.seconds_per_second for row in rows], [row.error_rms for row in rows]

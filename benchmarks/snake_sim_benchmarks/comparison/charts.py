# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Charts of the bench."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import groupby
import math
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from snake_sim_benchmarks.comparison import artefacts
from snake_sim_benchmarks.comparison.bench_rows import Row, rows_of
from snake_sim_benchmarks.comparison.bench_tables import (
    accuracy_table,
    agreement_table,
    fitted_order,
    fitted_power,
    front,
    point,
    robust_table,
    soak_table,
    speeds_table,
    spread_table,
    throughput_table,
    user_table,
)
from snake_sim_benchmarks.comparison.chart_style import (
    CASE_TITLES,
    CHART_STYLE,
    METHOD_STYLES,
    panels,
    plot_line,
    save,
)
from snake_sim_benchmarks.comparison.csv_tables import records_of, Table
from snake_sim_ros import ParameterError
from snake_sim_ros.scene.files import write_whole

# ---- ensembles and cycles -----------------------------------------------------------------------


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


# ---- all of a file ------------------------------------------------------------------------------


MAIN_SETTINGS = {  # setting that represents a method; the other settings are drawn thin
    'newton': 'default',
    'bdf2': 'residual 1e-5 m/s',
    'gauss_seidel': 'residual 1e-5 m/s',
    **dict.fromkeys(('rk45', 'lsoda', 'radau', 'bdf'), 'tanh 0.001 m/s, 1e+05 N/m'),
    'paper': 'as printed, 1e-07 N s',
    'semi_implicit_euler': 'tanh 0.001 m/s, 1e+05 N/m',
    'mujoco': 'accurate, spring, discrete',
}
DEFAULT_DT = 1 / 4000
Write = Callable[[Sequence[Row]], str]
# File: parts of the bench, any of which it shows, and what writes it.
TABLES: dict[str, tuple[set[str], Write]] = {
    'ensemble': ({'ensemble'}, partial(spread_table, part='ensemble')),
    'cycle': ({'cycle'}, partial(spread_table, part='cycle')),
    'speeds': ({'ensemble', 'cycle'}, speeds_table),
    'robust': ({'robust'}, robust_table),
    'accuracy': ({'accuracy'}, accuracy_table),
    'agreement': ({'agreement'}, agreement_table),
    'throughput': ({'throughput'}, throughput_table),
    'user': ({'user'}, user_table),
    'soak': ({'soak'}, soak_table),
}


def draw_bench(table: Table, folder: Path) -> list[Path]:
    """
    Draw everything that a bench measured, as SVG and PNG, and write its tables.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    ParameterError
        If the table is not one of a bench, has a method without a style, or nothing to draw.

    """
    rows = rows_of(table)
    for method in {row.method for row in rows} - set(METHOD_STYLES):
        raise ParameterError(f'method must be one of {", ".join(METHOD_STYLES)}; got {method!r}')
    parts = {name: [row for row in rows if row.part == name] for name in {r.part for r in rows}}
    if not cases_with_errors(parts.get('precision', ())):
        parts.pop('precision', None)
    drawn: list[Path] = []
    figures = {
        'ensemble': ('ensemble', spreads_figure),
        'cycle': ('cycle', spreads_figure),
        'work_precision': ('precision', work_precision),
        'error_over_dt': ('precision', error_over_dt),
        'cost_over_links': ('links', cost_over_links),
        'residual_over_iterations': ('iterations', residual_over_iterations),
        'where_time_goes': ('stages', where_time_goes),
    }
    for name, (part, draw) in figures.items():
        if part not in parts:
            continue
        with rc_context(CHART_STYLE):
            figure = draw(parts[part] + parts.get('situations', []) * (part == 'stages'))
            drawn += save(figure, folder / name, table.header)
    for name, (of, write) in TABLES.items():
        if parts.keys() & of:
            path = folder / f'{name}.md'
            write_whole(path, write(rows))
            drawn.append(path)
    if not drawn:
        raise ParameterError('nothing to draw: no run of the file has an error or a time')
    return drawn


def draw_artefacts(table: Table, folder: Path) -> list[Path]:
    """
    Write the table of artefacts in Markdown, and return its file.

    Raises
    ------
    ParameterError
        If the table is not one of artefacts, or has no rows.

    """
    rows = records_of(table, 'artefacts', artefacts.Row)
    if not rows:
        raise ParameterError('no artefact to show: the file has no rows')
    path = folder / 'artefacts.md'
    write_whole(path, artefacts.text_table(rows))
    return [path]


def lines(rows: Iterable[Row]) -> dict[tuple[str, str, str], list[Row]]:
    """Return the rows of every line: (method, level, setting) -> rows, small steps first."""
    found: dict[tuple[str, str, str], list[Row]] = {}
    for row in rows:
        if row.error_path > 0.0:
            found.setdefault((row.method, row.level, row.setting), []).append(row)
    for line in found.values():
        line.sort(key=lambda row: row.dt)
    return dict(sorted(found.items(), key=lambda item: list(METHOD_STYLES).index(item[0][0])))


def is_main(method: str, setting: str, rows: Iterable[Row]) -> bool:
    """Return whether a setting is the main one of its method; any is if that was not run."""
    settings = {row.setting for row in rows if row.method == method}
    return MAIN_SETTINGS.get(method) not in settings - {setting}


def cases_with_errors(rows: Iterable[Row]) -> list[str]:
    """Return the cases with a complete run that has an error."""
    return list(dict.fromkeys(row.case for row in rows if row.error_path > 0.0))


def errors_figure(rows: Sequence[Row], column: str) -> tuple[Figure, list[Axes]]:
    """Draw the path errors of all cases over a column, with fitted orders in the legend."""
    cases = cases_with_errors(rows)
    figure, all_axes = panels(len(cases), min(2, len(cases)), 3.2)
    legend: dict[str, Any] = {}
    orders: dict[str, list[float]] = {}
    for axes, case in zip(all_axes, cases, strict=True):
        here = [row for row in rows if row.case == case]
        for (method, level, setting), line in lines(here).items():
            main = is_main(method, setting, here)
            x = [getattr(row, column) for row in line]
            y = [row.error_path for row in line]
            handle = plot_line(axes, x, y, method, level, main=main)
            if main:
                name = METHOD_STYLES[method][2] + ', planar' * (level == 'planar')
                legend.setdefault(name, handle)
                orders.setdefault(name, []).append(fitted_order(line))
        shown = [row for row in here if row.error_path > 0.0]
        doubt = max(row.reference_error for row in shown)
        axes.axhspan(1e-9, max(doubt, 1e-9), color='#dddddd', zorder=0)
        low = min([doubt, *(row.error_path for row in shown)])
        axes.set(
            xscale='log', yscale='log', title=CASE_TITLES.get(case, case), ylim=(low / 2, 2.0)
        )
        axes.set_ylabel('error / distance from start to end')
        axes.grid(alpha=0.3, which='major')
    names = {
        name: name + ''.join({f' (order {np.nanmedian(fits):.1f})' for fits in [orders[name]]
                              if np.isfinite(fits).any()})
        for name in legend
    }  # fmt: skip
    figure.legend(
        legend.values(), names.values(), loc='outside lower center', ncols=3, frameon=False
    )
    return figure, all_axes


def slope_triangle(axes: Axes, order: int, direction: int, at: tuple[float, float]) -> None:
    """
    Draw a triangle with the slope of an order.

    Parameters
    ----------
    axes : Axes
    order : int
    direction : {1, -1}
        1 if the x axis has time steps, -1 if it has wall times.
    at : tuple of float
        Lower corner, as fractions of the axes.

    """
    (x0, x1), (y0, y1) = np.log10(axes.get_xlim()), np.log10(axes.get_ylim())
    x, y = x0 + at[0] * (x1 - x0), y0 + at[1] * (y1 - y0)
    run = 0.5
    corners = [(x, y), (x + direction * run, y), (x + direction * run, y + order * run)]
    points = 10.0 ** np.array([*corners, corners[0]])
    axes.plot(*points.T, '-', color='#555555', lw=0.8, zorder=1)
    axes.annotate(
        f'{order}', tuple(points[2]), fontsize=7, color='#555555',
        ha='left' if direction > 0 else 'right', va='top',
    )  # fmt: skip


def work_precision(rows: Sequence[Row]) -> Figure:
    """Draw errors over wall time per simulated second; points at the lower left are best."""
    figure, all_axes = errors_figure(rows, 'seconds_per_second')
    cases = cases_with_errors(rows)
    for axes, case in zip(all_axes, cases, strict=True):
        here = [row for row in rows if row.case == case and row.error_path > 0.0]
        default = {row.level: row for row in here if row.dt == DEFAULT_DT
                   and (row.method, row.setting) == ('newton', 'default')}  # fmt: skip
        printed = [row for row in here if row.dt == DEFAULT_DT
                   and (row.method, row.setting) == ('paper', MAIN_SETTINGS['paper'])]  # fmt: skip
        chosen = default.get('planar') or default.get('spatial')
        for row, text in [(chosen, 'default'), (printed[0] if printed else None, 'paper')]:
            if row is not None:
                point = row.seconds_per_second, row.error_path
                axes.plot(*point, 'o', ms=11, mfc='none', mec='black', mew=1.2, zorder=5)
                axes.annotate(text, point, xytext=(7, 7), textcoords='offset points', zorder=5)
        axes.axvline(1.0, color='black', lw=0.8, ls=':')
        axes.annotate('real time', (1.0, 0.99), xycoords=('data', 'axes fraction'), rotation=90,
                      ha='right', va='top', fontsize=7)  # fmt: skip
        axes.set_xlabel('wall time / simulated time')
        for order, at in ((1, (0.14, 0.06)), (2, (0.24, 0.06))):
            slope_triangle(axes, order, -1, at)
    return figure


def error_over_dt(rows: Sequence[Row]) -> Figure:
    """Draw error over time step, with the slopes of first and second order."""
    figure, all_axes = errors_figure(rows, 'dt')
    for axes in all_axes:
        axes.set_xlabel('time step [s]')
        for order, at in ((1, (0.72, 0.06)), (2, (0.84, 0.06))):
            slope_triangle(axes, order, 1, at)
    return figure


def cost_over_links(rows: Sequence[Row]) -> Figure:
    """Draw the median step over the number of links, with the exponents of fitted power laws."""
    figure, (axes,) = panels(1, 1, 3.6)
    rows = [row for row in rows if row.median_us > 0.0]
    found: dict[tuple[str, str, str], list[Row]] = {}
    order = list(METHOD_STYLES)
    for row in sorted(rows, key=lambda row: (order.index(row.method), row.level == 'planar')):
        found.setdefault((row.method, row.level, row.setting), []).append(row)
    for (method, level, setting), line in found.items():
        n, cost = [row.n or 0 for row in line], [row.median_us for row in line]
        main = is_main(method, setting, rows)
        handle = plot_line(axes, n, cost, method, level, main=main)
        exponent = f', n^{fitted_power(n, cost):.2f}' * (len(line) > 1)
        if main:
            handle.set_label(
                METHOD_STYLES[method][2] + ', planar' * (level == 'planar') + exponent
            )
    axes.set(xscale='log', yscale='log', xlabel='number of links', ylabel='median step [us]')
    axes.grid(alpha=0.3, which='both')
    figure.legend(loc='outside right center', frameon=False)
    return figure


def residual_over_iterations(rows: Sequence[Row]) -> Figure:
    """Draw residuals of the contact laws over iterations, for stored hard problems."""
    cases = list(dict.fromkeys(row.case for row in rows))
    figure, all_axes = panels(len(cases), 3, 2.4)
    legend: dict[str, Any] = {}
    for axes, case in zip(all_axes, cases, strict=True):
        here = [row for row in rows if row.case == case]
        for method, line in groupby(here, key=lambda row: row.method):
            steps = list(line)
            x = [row.iterations for row in steps]
            y = [max(row.residual_max, 1e-16) for row in steps]
            legend[method] = plot_line(axes, x, y, method, 'spatial', main=True)
        axes.axhline(1e-9, color='black', lw=0.8, ls=':')
        axes.set(xscale='log', yscale='log', title=case)
        axes.grid(alpha=0.3)
    for axes in all_axes[::3]:
        axes.set_ylabel('residual [m/s]')
    for axes in all_axes[-3:]:
        axes.set_xlabel('iterations (dotted: where newton stops)')
    names = [METHOD_STYLES[method][2] for method in legend]
    figure.legend(legend.values(), names, loc='outside lower center', ncols=3, frameon=False)
    return figure


def where_time_goes(rows: Sequence[Row]) -> Figure:
    """Draw the times of the stages of a step, and its cost in different situations."""
    figure, (left, right) = panels(2, 2, 2.8)
    colors = ('#0072b2', '#56b4e9', '#009e73', '#e69f00')
    for y, level in enumerate(('spatial', 'planar')):
        start = 0.0
        stages = [row for row in rows if (row.part, row.level) == ('stages', level)]
        for row, color in zip(stages[:3], colors, strict=False):
            label = row.setting if level == 'spatial' else None
            left.barh(y, row.median_us, left=start, color=color, label=label)
            start += row.median_us
        for row in stages[3:]:
            begin = stages[0].median_us
            left.barh(y, row.median_us, 0.35, left=begin, color=colors[3], label=row.setting)
    left.set(yticks=[0, 1], yticklabels=['spatial', 'planar'], xlabel='median [us]')
    left.set_title('stages of a step of newton')
    left.legend(loc='upper right', frameon=False, fontsize=7)
    left.set_ylim(-0.6, 2.3)
    found = [row for row in rows if row.part == 'situations']
    right.barh([row.case for row in found], [row.median_us for row in found], color='#0072b2')
    right.invert_yaxis()
    right.set(xlabel='median step [us]', title='what there is to pay for')
    return figure

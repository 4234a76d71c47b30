# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The picture of `stability`: a row of panels for each map, with a panel for each method.

Every outcome has a color of Okabe and Ito and a mark, so that one of them is enough to read the
picture. A line shows the limit that theory gives.
"""

from collections.abc import Sequence
from pathlib import Path

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
import numpy as np

from snake_sim_benchmarks.comparison.chart_style import CHART_STYLE, save
from snake_sim_benchmarks.comparison.csv_tables import Table
from snake_sim_benchmarks.comparison.stability.maps import MAPS
from snake_sim_benchmarks.comparison.stability.runs import Cell, cells_of, StabilityMap
from snake_sim_ros import ParameterError
from snake_sim_ros.scene.parameters import Array

OUTCOME_COLORS = {
    'converged': '#ffffff',
    'inaccurate': '#f0e442',
    'unconverged': '#56b4e9',
    'blown_up': '#d55e00',
    'failed': '#999999',
}
OUTCOME_MARKS = {'inaccurate': '.', 'unconverged': '_', 'blown_up': 'x', 'failed': '$?$'}
OUTCOME_WORDS = {
    'converged': 'converged and accurate',
    'inaccurate': 'inaccurate',
    'unconverged': 'unconverged steps, counted',
    'blown_up': 'blown up',
    'failed': 'not run',
}
PANELS_IN_A_ROW = 7
FEW_VALUES = 5  # at most so many values are all written at the axis
PANEL_HEIGHT = 1.4  # inch of a row of panels


def draw_stability(table: Table, folder: Path) -> list[Path]:
    """
    Draw all maps of a file, as SVG and PNG; return what was written.

    Raises
    ------
    ParameterError
        If the table is not one of `stability`, or has none of its maps.

    """
    cells = cells_of(table)
    there = {cell.map for cell in cells}
    charts = [chart for chart in MAPS if chart.name in there]
    if not charts:
        raise ParameterError('no map to draw: the file has no cells')
    with rc_context({**CHART_STYLE, 'font.size': 6.5, 'axes.linewidth': 0.6}):
        return save(stability_figure(charts, cells), folder / 'stability', table.header)


def stability_figure(charts: Sequence[StabilityMap], cells: Sequence[Cell]) -> Figure:
    """Return the picture of some maps."""
    rows = in_rows(charts)
    figure = Figure(figsize=(9.0, PANEL_HEIGHT * len(rows) + 0.6), layout='constrained')
    *bands, foot = figure.subfigures(
        len(rows) + 1, 1, height_ratios=[PANEL_HEIGHT] * len(rows) + [0.3], squeeze=False
    )[:, 0]
    for band, row in zip(bands, rows, strict=True):
        widths = [len(chart.methods) for chart in row]
        widths += [PANELS_IN_A_ROW - sum(widths)] * (sum(widths) < PANELS_IN_A_ROW)
        parts = band.subfigures(1, len(widths), width_ratios=widths, squeeze=False)[0]
        for part, chart in zip(parts, row, strict=False):
            found = [cell for cell in cells if cell.map == chart.name]
            part.suptitle(chart.title, fontsize=7.5, x=0.02, ha='left')
            panels = part.subplots(1, len(chart.methods), sharey=True, squeeze=False)[0]
            for axes, method in zip(panels, chart.methods, strict=True):
                draw_panel(axes, [cell for cell in found if cell.method == method])
                axes.set_title(method.replace('newton ', 'newton, '), fontsize=6.5, pad=2)
                axes.set_xlabel(labeled(chart.x.name, chart.x.unit), labelpad=1, size=6)
            panels[0].set_ylabel(labeled(chart.y.name, chart.y.unit), labelpad=1, size=6)
    handles: list[Patch | Line2D] = [
        Line2D(
            [], [], marker='s', ls='', ms=8, mfc=OUTCOME_COLORS[name], mec='#999999', label=word
        )
        for name, word in OUTCOME_WORDS.items()
    ]
    line = Line2D([], [], color='black', lw=1.4, label='limit of theory')
    foot.legend(handles=[*handles, line], loc='center', ncols=6, frameon=False, fontsize=7.5)
    return figure


def in_rows(charts: Sequence[StabilityMap]) -> list[list[StabilityMap]]:
    """Return maps in rows of some panels, each in the first row that has room."""
    rows: list[list[StabilityMap]] = []
    for chart in charts:
        for row in rows:
            if sum(len(other.methods) for other in (*row, chart)) <= PANELS_IN_A_ROW:
                row.append(chart)
                break
        else:
            rows.append([chart])
    return rows


def labeled(name: str, unit: str) -> str:
    """Return a quantity with its unit."""
    name = name.rpartition('.')[2].replace('_', ' ')
    return name if unit == '1' else f'{name} [{unit}]'


def edges(values: Array) -> Array:
    """Return the borders of cells around values, on a logarithmic axis."""
    if len(values) == 1:
        return np.array([values[0] / 1.5, values[0] * 1.5])
    middle = np.sqrt(values[1:] * values[:-1])
    ends = values[0] ** 2 / middle[0], values[-1] ** 2 / middle[-1]
    return np.concatenate([ends[:1], middle, ends[1:]])


def draw_panel(axes: Axes, cells: Sequence[Cell]) -> None:
    """Draw the cells of a map and a method, and the limit of theory."""
    xs, ys = (np.unique([getattr(cell, name) for cell in cells]) for name in 'xy')
    axes.set(xscale='log', yscale='log')
    if not cells:
        return
    kinds = list(OUTCOME_COLORS)
    grid = np.full((len(ys), len(xs)), np.nan)
    for cell in cells:
        grid[np.searchsorted(ys, cell.y), np.searchsorted(xs, cell.x)] = kinds.index(cell.outcome)
    colors = ListedColormap(list(OUTCOME_COLORS.values()))
    axes.pcolormesh(
        edges(xs), edges(ys), grid, cmap=colors, vmin=-0.5, vmax=len(kinds) - 0.5,
        edgecolors='#cccccc', linewidth=0.2, rasterized=True,
    )  # fmt: skip
    for name, mark in OUTCOME_MARKS.items():
        found = [cell for cell in cells if cell.outcome == name]
        x, y = ([getattr(cell, name) for cell in found] for name in 'xy')
        axes.plot(x, y, ls='', marker=mark, ms=2.2, color='black', mew=0.5, rasterized=True)
    limits = {cell.y: cell.limit for cell in cells}
    axes.plot([limits[y] for y in ys], ys, color='black', lw=1.4)
    axes.set(xlim=edges(xs)[[0, -1]], ylim=edges(ys)[[0, -1]])
    axes.tick_params(length=2, pad=1, labelsize=5.5, which='both')
    axes.minorticks_off()
    if len(ys) <= FEW_VALUES:
        axes.set_yticks(ys, [f'{y:g}' for y in ys])

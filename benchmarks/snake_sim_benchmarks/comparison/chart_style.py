# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The look of all charts.

Colors are those of Okabe and Ito, which people with any kind of color vision can tell apart. A
method has the same color and the same mark in all charts. The planar level has hollow marks.
"""

from collections.abc import Mapping
import math
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from snake_sim_ros.scene.files import write_figure

PATH_COLOR = '#0072b2'
METHOD_STYLES = {  # method: color, mark, name
    'newton': ('#0072b2', 'o', 'newton'),
    'bdf2': ('#009e73', 's', 'bdf2'),
    'newton_dense': ('#56b4e9', 'v', 'newton_dense'),
    'gauss_seidel': ('#e69f00', '^', 'gauss_seidel'),
    'paper': ('#000000', 'D', "paper's iteration"),
    'pyramid': ('#999999', 'h', 'friction pyramid'),
    'semi_implicit_euler': ('#cc79a7', 'P', 'regularized, semi-implicit Euler'),
    'rk45': ('#cc79a7', '1', 'regularized, RK45'),
    'lsoda': ('#cc79a7', '2', 'regularized, LSODA'),
    'radau': ('#cc79a7', '3', 'regularized, Radau'),
    'bdf': ('#cc79a7', '4', 'regularized, BDF'),
    'mujoco': ('#d55e00', 'X', 'MuJoCo'),
    'drake': ('#f0e442', '*', 'Drake CENIC'),
}
CASE_TITLES = {
    'lateral_undulation': 'A: lateral undulation',
    'lateral_undulation_isotropic': 'B: the same, isotropic friction',
    'sidewinding': 'C: sidewinding',
    'sinus_lifting': 'D: sinus-lifting',
}
CHART_STYLE = {'font.size': 8.5, 'svg.hashsalt': 'snake_sim_ros', 'svg.fonttype': 'none'}


def save(figure: Figure, path: Path, header: Mapping[str, str]) -> list[Path]:
    """Write a figure as SVG and PNG, with processor, date and commit of the data at its top."""
    where = ', '.join(ends(header[key]) for key in ('processor', 'date') if key in header)
    commit = ends(header.get('commit', 'unknown'))
    figure.suptitle(f'commit {commit}, {where}', fontsize=6.5, x=0.99, ha='right', color='#555555')
    FigureCanvasAgg(figure)
    files = [path.with_suffix(suffix) for suffix in ('.svg', '.png')]
    write_figure(figure, files[0], dpi=220, metadata={'Date': None})
    write_figure(figure, files[1], dpi=110)
    return files


def ends(listed: str) -> str:
    """Return an entry of a head as it is if it lists up to two items, else the first and last."""
    items = listed.split(' and ')
    return listed if len(items) <= 2 else f'{items[0]} to {items[-1]}'


def panels(count: int, columns: int, height: float) -> tuple[Figure, list[Axes]]:
    """Return a figure as wide as a page on GitHub, and its axes, each of this height [inch]."""
    rows = math.ceil(count / columns)
    figure = Figure(figsize=(9.0, rows * height + 0.8), layout='constrained')
    return figure, [figure.add_subplot(rows, columns, k + 1) for k in range(count)]


def plot_line(axes: Axes, x: Any, y: Any, method: str, level: str, *, main: bool) -> Any:
    """Draw the line of a method; it is thin if the setting is not the main one."""
    color, mark, _ = METHOD_STYLES[method]
    fill = 'white' if level == 'planar' and mark not in '1234' else color
    look: dict[str, Any] = {'lw': 1.5, 'ms': 5.0} if main else {'lw': 0.6, 'ms': 2.5, 'alpha': 0.5}
    (line,) = axes.plot(x, y, '-', marker=mark, color=color, mfc=fill, zorder=2 + main, **look)
    return line

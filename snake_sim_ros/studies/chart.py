# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The picture of a study: every metric over one value that varies, or as a map over two."""

from collections.abc import Sequence
import math
from pathlib import Path
from typing import Any, TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np

from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.files import write_figure
from snake_sim_ros.studies.metrics import Metric

if TYPE_CHECKING:
    import polars

SUFFIXES = ('.png', '.svg', '.pdf')
COLUMNS = 3  # panels beside each other
COLOR, FAILED_COLOR = '#0072b2', '#d55e00'


def check_plot(path: Path, names: Sequence[str]) -> None:
    """
    Check that the values that vary in a study can be drawn to a file.

    Raises
    ------
    ParameterError
        If they are not one or two, or if the file cannot be written.

    """
    if path.suffix not in SUFFIXES:
        raise ParameterError(f'--plot must end in {", ".join(SUFFIXES)}; got {path}')
    if not path.absolute().parent.is_dir():
        raise ParameterError(f'--plot: no folder {path.absolute().parent}')
    if len(names) > 2:
        raise ParameterError(
            f'--plot draws one or two values that vary, this study has {len(names)}: '
            f'{", ".join(names)}'
        )


def draw(
    frame: 'polars.DataFrame', names: Sequence[str], metrics: Sequence[Metric], path: Path
) -> None:
    """
    Draw the metrics of a table over one or two values.

    Parameters
    ----------
    frame : DataFrame
        The table of a study.
    names : sequence of str
        Of the values, one or two.
    metrics : sequence of Metric
    path : Path
        Where the picture is written.

    """
    rows = math.ceil(len(metrics) / COLUMNS)
    columns = min(COLUMNS, len(metrics))
    figure = Figure(figsize=(3.4 * columns, 2.7 * rows + 0.3), layout='constrained')
    values = [_numbers(frame[name].to_list()) for name in names]
    for k, metric in enumerate(metrics):
        axes = figure.add_subplot(rows, columns, k + 1)
        numbers = np.array(frame[metric.name].to_list(), dtype=float)
        unit = f' [{metric.unit}]' if metric.unit not in ('', '1') else ''
        title = f'{metric.name.replace("_", " ")}{unit}'
        if len(names) == 1:
            _draw_line(axes, values[0], numbers)
            axes.set_ylabel(title)
        else:
            figure.colorbar(_draw_map(axes, values[0], values[1], numbers), ax=axes)
            axes.set_title(title, fontsize=9)
            axes.set_ylabel(names[1])
        axes.set_xlabel(names[0])
    FigureCanvasAgg(figure)
    write_figure(figure, path, dpi=130)


def _numbers(values: Sequence[Any]) -> Any:
    """Return values as an array of numbers, or as texts if they are none."""
    if all(isinstance(value, (int, float)) for value in values):
        return np.array(values, dtype=float)
    return np.array([str(value) for value in values])


def _draw_line(axes: Axes, x: Any, y: Any) -> None:
    """Draw a metric over one value; rows without a number are marks at the lower edge."""
    order, good = np.argsort(x, kind='stable'), np.isfinite(y)
    x, y, good = x[order], y[order], good[order]
    single = len(np.unique(x)) == len(x)
    axes.plot(x, np.where(good, y, np.nan), 'o-' if single else 'o', ms=3, lw=1, color=COLOR)
    if not good.all():
        bottom = axes.get_xaxis_transform()
        axes.plot(x[~good], np.zeros((~good).sum()), 'x', color=FAILED_COLOR, transform=bottom,
                  clip_on=False, ms=4)  # fmt: skip
    axes.grid(alpha=0.3)


def _draw_map(axes: Axes, x: Any, y: Any, z: Any) -> Any:
    """Draw a metric as colors over two values: cells of a grid, or points."""
    along, across = np.unique(x), np.unique(y)
    is_grid = len(along) * len(across) == len(x) == len(set(zip(x, y, strict=True)))
    if is_grid and min(len(along), len(across)) > 1 and 'U' not in x.dtype.kind + y.dtype.kind:
        cells = np.full((len(across), len(along)), np.nan)
        cells[np.searchsorted(across, y), np.searchsorted(along, x)] = z
        finite = np.ma.masked_invalid(cells)
        return axes.pcolormesh(along, across, finite, shading='nearest', cmap='viridis')
    good = np.isfinite(z)
    axes.plot(x[~good], y[~good], 'x', color=FAILED_COLOR, ms=4)
    return axes.scatter(x[good], y[good], c=z[good], s=16, cmap='viridis')

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Pictures of studies, optimizations and fits.

A study is every metric over one value that varies, or as a map over two, for each of a third; an
optimization the front of two objectives, or one objective as it grows; a fit its residuals over
time and as a distribution, and what segments ask for.
"""

from collections.abc import Mapping, Sequence
import math
from pathlib import Path
from typing import Any, TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np

from snake_sim_ros.scene.files import write_figure
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.studies.metrics import Metric

if TYPE_CHECKING:
    import polars

    from snake_sim_ros.studies.fit import Fit
    from snake_sim_ros.studies.optimization import Evaluation, Outcome

COLUMNS = 3  # panels beside each other
COLORS = ('#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9')
GOOD, BAD, CHECKED, OTHER = *COLORS[:3], '#999999'
SPAN = 1.5  # of the axes of a front, in lengths of the front
BINS = np.linspace(-5.0, 5.0, 61)  # in units of the noise
DPI = 130


def _figure(width: float, height: float) -> Figure:
    """Return an empty figure of a size in inches, which needs no display."""
    figure = Figure(figsize=(width, height), layout='constrained')
    FigureCanvasAgg(figure)
    return figure


def _titled(name: str, unit: str) -> str:
    """Return the title of an axis that shows a metric."""
    return name.replace('_', ' ') + (f' [{unit}]' if unit not in ('', '1') else '')


# ---- studies ------------------------------------------------------------------------------------


def draw_study(
    frame: 'polars.DataFrame',
    names: Sequence[str],
    scales: Mapping[str, str],
    metrics: Sequence[Metric],
    path: Path,
) -> None:
    """
    Draw the metrics of a table over one or two values, or over two for each of a third.

    Parameters
    ----------
    frame : DataFrame
        The table of a study.
    names : sequence of str
        Of the values, one to three.
    scales : mapping
        Name of a value -> 'log' for a logarithmic axis.
    metrics : sequence of Metric
    path : Path
        Where the picture is written.

    """
    values = [_numbers(frame[name].to_list()) for name in names]
    cases = [('', np.full(len(frame), True))]
    if len(names) == 3:
        cases = [
            (f'{names[2]} = {each:g}' if values[2].dtype.kind == 'f' else f'{names[2]} = {each}',
             values[2] == each)
            for each in np.unique(values[2])
        ]  # fmt: skip
    panels = [(metric, case) for metric in metrics for case in cases]
    columns = len(cases) if len(cases) > 1 else min(COLUMNS, len(metrics))
    rows = math.ceil(len(panels) / columns)
    figure = _figure(3.4 * columns, 2.7 * rows + 0.3)
    for k, (metric, (case, chosen)) in enumerate(panels):
        axes = figure.add_subplot(rows, columns, k + 1)
        numbers = np.array(frame[metric.name].to_list(), dtype=float)
        title = _titled(metric.name, metric.unit)
        if len(names) == 1:
            _draw_line(axes, values[0], numbers)
            axes.set_ylabel(title)
        else:
            colors = _draw_map(axes, values[0][chosen], values[1][chosen], numbers[chosen])
            finite = numbers[np.isfinite(numbers)]
            if len(finite):  # the same colors in all cases
                colors.set_clim(finite.min(), finite.max())
            figure.colorbar(colors, ax=axes)
            axes.set_title(f'{title}, {case}' if case else title, fontsize=9)
            axes.set_ylabel(names[1])
            axes.set_yscale(scales.get(names[1], 'linear'))
        axes.set_xlabel(names[0])
        axes.set_xscale(scales.get(names[0], 'linear'))
    write_figure(figure, path, dpi=DPI)


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
    axes.plot(x, np.where(good, y, np.nan), 'o-' if single else 'o', ms=3, lw=1, color=GOOD)
    if not good.all():
        bottom = axes.get_xaxis_transform()
        axes.plot(x[~good], np.zeros((~good).sum()), 'x', color=BAD, transform=bottom,
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
    axes.plot(x[~good], y[~good], 'x', color=BAD, ms=4)
    return axes.scatter(x[good], y[good], c=z[good], s=16, cmap='viridis')


# ---- optimizations ------------------------------------------------------------------------------


def draw_optimization(outcome: 'Outcome', path: Path) -> None:
    """Draw what an optimization found, and write it to a file."""
    figure = _figure(6.0, 4.2)
    axes = figure.add_subplot()
    if len(outcome.problem.objectives) == 1:
        _draw_growth(axes, outcome)
    else:
        _draw_front(axes, outcome)
    axes.grid(alpha=0.3)
    if axes.get_legend_handles_labels()[1]:
        axes.legend(fontsize=8)
    write_figure(figure, path, dpi=DPI)


def _draw_growth(axes: Axes, outcome: 'Outcome') -> None:
    """Draw the objective over the number of the evaluation, and the best one so far."""
    numbers = np.array([outcome.objectives_of(item)[0] for item in outcome.evaluations])
    good = np.array([item.is_feasible for item in outcome.evaluations], dtype=bool)
    place, (objective,) = np.arange(len(numbers)), outcome.problem.objectives
    axes.plot(place[good], numbers[good], 'o', ms=3, color=GOOD, label='constraints hold')
    if not good.all():
        axes.plot(place[~good], numbers[~good], 'x', ms=4, color=BAD, label='they do not')
    if good.any():
        worst = objective.sign * np.inf
        grow = np.fmin.accumulate if objective.sign > 0 else np.fmax.accumulate
        best = grow(np.where(good, numbers, worst))
        first = int(np.argmax(good))
        axes.step(place[first:], best[first:], where='post', color=GOOD, lw=1)
        low, high = numbers[good].min(), numbers[good].max()
        if high > low:
            axes.set_ylim(low - 0.1 * (high - low), high + 0.1 * (high - low))
    axes.set_xlabel('evaluation')
    axes.set_ylabel(_titled(objective.expression.text, _unit(outcome, objective.expression.text)))


def _draw_front(axes: Axes, outcome: 'Outcome') -> None:
    """Draw all evaluations by their objectives, the front, and what the check says of it."""
    texts, signs = zip(*(_shown(item.expression.text) for item in outcome.problem.objectives),
                       strict=True)  # fmt: skip

    def points(evaluations: 'Sequence[Evaluation]') -> Array:
        found = [outcome.objectives_of(item) for item in evaluations]
        return np.asarray(np.reshape(found, (-1, 2)) * np.array(signs))

    good = [item for item in outcome.evaluations if item.is_feasible]
    front = points(outcome.best)
    axes.plot(*points(good).T, 'o', ms=3, color=OTHER, label='evaluations')
    axes.plot(*front.T, 'o-', ms=4, lw=1, color=GOOD, ds='steps-pre', label='front')
    checks = points([item for item in outcome.checks.values() if item.excess < math.inf])
    if len(checks):
        axes.plot(*checks.T, 's', ms=5, mfc='none', color=CHECKED, label='checked')
    if good and good[0].point.search < 0:
        axes.plot(*points(good[:1]).T, '*', ms=10, color=BAD, label='scene as it was')
    shown = np.vstack([front, checks, points(good[:1])])
    for k, limit in ((0, axes.set_xlim), (1, axes.set_ylim)):
        length = np.ptp(shown[:, k]) if len(shown) else 0.0
        if length > 0.0:  # what is far from the front is out of sight
            margin = (SPAN - 1.0) / 2.0 * length
            limit(shown[:, k].min() - margin, shown[:, k].max() + margin)
    axes.set_xlabel(_titled(texts[0], _unit(outcome, texts[0])))
    axes.set_ylabel(_titled(texts[1], _unit(outcome, texts[1])))


def _shown(text: str) -> tuple[str, float]:
    """Return what an axis shows: of ``-cost`` the cost, and the sign that makes it so."""
    name = text.strip().removeprefix('-')
    return (name, -1.0) if name != text.strip() and name.isidentifier() else (text, 1.0)


def _unit(outcome: 'Outcome', text: str) -> str:
    """Return the unit of an expression that is the name of a metric; others have none."""
    return {metric.name: metric.unit for metric in outcome.problem.metrics}.get(text, '')


# ---- fits ---------------------------------------------------------------------------------------


def draw_fit(found: 'Fit', path: Path) -> None:
    """Draw the residuals of a fit, and write them to a file."""
    figure = _figure(11.0, 7.5)
    (places, joints), (spread, values) = figure.subplots(2, 2)
    _draw_over_time(found, places, joints)
    _draw_distribution(found, spread)
    _draw_segments(found, values)
    write_figure(figure, path, dpi=DPI)


def _draw_over_time(found: 'Fit', places: Axes, joints: Axes) -> None:
    """Draw root mean squares of all positions and of all angles over time."""
    settings, recording = found.replay.settings, found.replay.recording
    for segment, item in zip(found.replay.segments, found.residuals, strict=True):
        off = settings.noise_position * np.sqrt((item.poses[..., :3] ** 2).mean(axis=(1, 2)))
        places.plot(segment.pose_time, 1e3 * off, '.', ms=2, color=GOOD)
        off = settings.noise_angle * np.sqrt(np.nanmean(item.joints**2, axis=(1, 2)))
        joints.plot(segment.joint_time, np.degrees(off), '.', ms=2, color=GOOD)
    for axes, noise, unit in (
        (places, 1e3 * settings.noise_position, 'mm'),
        (joints, np.degrees(settings.noise_angle), 'deg'),
    ):
        axes.axhline(noise, color=BAD, lw=1, label='stated noise')
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel('time [s]')
        axes.set_ylabel(f'root mean square residual [{unit}]')
        axes.legend(loc='lower right')
    places.set_title(f'positions of {len(recording.links)} links')
    joints.set_title('joint angles')


def _draw_distribution(found: 'Fit', axes: Axes) -> None:
    """Draw how residuals are distributed, and how noise would be."""
    middle = (BINS[1:] + BINS[:-1]) / 2
    kinds: dict[str, list[Array]] = {
        'positions': [item.poses[..., :3].ravel() for item in found.residuals],
        'orientations': [item.poses[..., 3:].ravel() for item in found.residuals],
        'joint angles': [item.joints[~np.isnan(item.joints)] for item in found.residuals],
    }
    for color, (name, parts) in zip(COLORS, kinds.items(), strict=False):
        numbers = np.concatenate(parts)
        share = np.histogram(numbers, BINS)[0] / (len(numbers) * np.diff(BINS))
        axes.plot(middle, share, color=color, label=name)
    normal = np.exp(-(middle**2) / 2) / np.sqrt(2 * np.pi)
    axes.plot(middle, normal, 'k--', lw=1, label='stated noise')
    axes.set_xlabel('residual in units of the stated noise')
    axes.set_ylabel('density')
    axes.legend()


def _draw_segments(found: 'Fit', axes: Axes) -> None:
    """Draw what each segment alone would change of each value, the others held."""
    middle = [item.joint_time.mean() for item in found.replay.segments]
    flat = [item.flat() for item in found.residuals]
    for k, unknown in enumerate(found.unknowns):
        columns = [J[:, k] for J in found.jacobians]
        size = np.array([max(float(J @ J), 1e-300) for J in columns])
        change = -np.array([J @ r for J, r in zip(columns, flat, strict=True)]) / size
        scale = 100.0 if unknown.is_positive else 1.0
        axes.errorbar(
            middle, scale * change, 2 * scale / np.sqrt(size), fmt='o', ms=3, capsize=2,
            color=COLORS[k % len(COLORS)], label=unknown.name,
        )  # fmt: skip
    axes.axhline(0.0, color='k', lw=0.5)
    axes.set_xlabel('time [s]')
    axes.set_ylabel('change that a segment asks for [%]\nwith two standard deviations')
    axes.legend()

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Pictures of an optimization: the front of two objectives, or one objective as it grows."""

from collections.abc import Sequence
import math
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np

from snake_sim_ros.optimization.evaluations import Evaluation
from snake_sim_ros.optimization.optimize import Outcome
from snake_sim_ros.scene.files import write_figure
from snake_sim_ros.scene.parameters import Array

GOOD, BAD, OTHER, CHECKED = '#0072b2', '#d55e00', '#999999', '#009e73'
SPAN = 1.5  # of the axes of a front, in lengths of the front


def draw(outcome: Outcome, path: Path) -> None:
    """Draw what an optimization found, and write it to a file."""
    figure = Figure(figsize=(6.0, 4.2), layout='constrained')
    axes = figure.add_subplot()
    if len(outcome.problem.objectives) == 1:
        _draw_growth(axes, outcome)
    else:
        _draw_front(axes, outcome)
    axes.grid(alpha=0.3)
    if axes.get_legend_handles_labels()[1]:
        axes.legend(fontsize=8)
    FigureCanvasAgg(figure)
    write_figure(figure, path, dpi=130)


def _draw_growth(axes: Axes, outcome: Outcome) -> None:
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
    axes.set_ylabel(_titled(outcome, objective.expression.text))


def _draw_front(axes: Axes, outcome: Outcome) -> None:
    """Draw all evaluations by their objectives, the front, and what the check says of it."""
    texts, signs = zip(*(_shown(item.expression.text) for item in outcome.problem.objectives),
                       strict=True)  # fmt: skip

    def points(evaluations: Sequence[Evaluation]) -> Array:
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
        _set_limit(limit, shown[:, k])
    axes.set_xlabel(_titled(outcome, texts[0]))
    axes.set_ylabel(_titled(outcome, texts[1]))


def _shown(text: str) -> tuple[str, float]:
    """Return what an axis shows: of ``-cost`` the cost, and the sign that makes it so."""
    name = text.strip().removeprefix('-')
    return (name, -1.0) if name != text.strip() and name.isidentifier() else (text, 1.0)


def _titled(outcome: Outcome, text: str) -> str:
    """Return the title of an axis; the unit of a metric is known."""
    units = {metric.name: metric.unit for metric in outcome.problem.metrics}
    unit = units.get(text, '')
    return text.replace('_', ' ') + (f' [{unit}]' if unit not in ('', '1') else '')


def _set_limit(limit: Any, numbers: Array) -> None:
    """Show numbers, and something around them; what is far from the front is out of sight."""
    if len(numbers) and np.ptp(numbers) > 0.0:
        margin = (SPAN - 1.0) / 2.0 * np.ptp(numbers)
        limit(numbers.min() - margin, numbers.max() + margin)

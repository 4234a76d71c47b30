# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Figures of torques, forces, errors and energies over time."""

from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
import numpy as np

from snake_sim_benchmarks.comparison.chart_style import PATH_COLOR
from snake_sim_benchmarks.paper.assumptions import assumed_in_both, assumed_in_c
from snake_sim_benchmarks.paper.experiments import Experiment
from snake_sim_benchmarks.paper.figure_page import LOADED_COLOR, page
from snake_sim_benchmarks.paper.tables import weight
from snake_sim_ros.scene.parameters import Array

CASE_TITLES = ('A, lateral undulation', 'C, sidewinding')
COLOR_MAP = 'viridis'  # from link 1 to link n


def draw_each(axes: Axes, time: Array, values: Array) -> None:
    """Draw a line for each joint or sphere in the color of its link; zeros are gaps."""
    colors = colormaps[COLOR_MAP](np.linspace(0.0, 0.95, values.shape[1]))
    for line, color in zip(np.where(values, values, np.nan).T, colors, strict=True):
        axes.plot(time, line, color=color, lw=0.8)
    axes.grid(alpha=0.3)


def color_key(figure: Figure, axes: Array, what: str, count: int) -> None:
    """Draw the color bar for `draw_each`."""
    key = ScalarMappable(Normalize(1, 1 + (count - 1) / 0.95), COLOR_MAP)
    bar = figure.colorbar(key, ax=axes, label=what, ticks=range(1, count + 1), aspect=40, pad=0.01)
    bar.ax.set_ylim(1, count)


def joint_figure(
    title: str, label: str, cases: tuple[Experiment, Experiment], data: list[Array]
) -> Figure:
    """Return a figure of data (m, n-1, 2) of all joints over time, for cases A and C."""
    figure = page(4.8, title, assumed_in_both(cases[1].scene))
    panels = figure.subplots(2, 2, sharex=True)
    for row, case, values, name in zip(panels, cases, data, CASE_TITLES, strict=True):
        time = case.trajectory.time
        time = time if len(values) == len(time) else case.periods
        for k, axis in enumerate(('yaw', 'pitch')):
            draw_each(row[k], time, values[..., k])
            row[k].set_title(f'{name}: {axis}')
        row[0].set_ylabel(label)
    for axes in panels[1]:
        axes.set_xlabel('t [s]')
    color_key(figure, panels, 'joint', data[0].shape[1])
    return figure


def torque_figure(undulation: Experiment, sidewinding: Experiment) -> Figure:
    """Return a figure of the torques of all joints over time."""
    cases = undulation, sidewinding
    torques = [case.torque for case in cases]
    return joint_figure('Joint torques, means over 10 ms', 'torque [N m]', cases, torques)


def tracking_figure(undulation: Experiment, sidewinding: Experiment) -> Figure:
    """Return the tracking errors of all joints over time."""
    cases = undulation, sidewinding
    errors = [np.degrees(case.tracking_error) for case in cases]
    return joint_figure('Tracking error: reference less angle', 'error [deg]', cases, errors)


def contact_figure(case: Experiment) -> Figure:
    """Return a figure of the spheres that carry load in sidewinding, and of their number."""
    figure = page(
        4.8, 'Contact pattern of sidewinding, means over 10 ms', assumed_in_c(case.scene)
    )
    pattern, number = figure.subplots(2, 1, sharex=True, height_ratios=[2.6, 1])
    n, force = case.scene.robot.link_count, case.force_along_body.T
    picture = pattern.imshow(
        np.where(force > 0.0, force, np.nan), aspect='auto', origin='lower', cmap='viridis_r',
        extent=(0.0, case.trajectory.time[-1], 0.5, n + 0.5), interpolation='nearest', vmin=0.0,
        vmax=float(np.percentile(force, 99.5)),
    )  # fmt: skip
    pattern.set(ylabel='link: rear, then front sphere', yticks=range(1, n + 1))
    pattern.set_facecolor('#f4f4f4')
    figure.colorbar(picture, ax=pattern, label='normal force [N]', extend='max', pad=0.01)
    number.step(case.periods, (force > 0.0).sum(axis=0), where='mid', color=LOADED_COLOR, lw=0.7)
    number.set(xlabel='t [s]', ylabel='loaded spheres', yticks=[0, 2, 4, 6, 8], ylim=(0, 8))
    number.annotate(f'{2 * n} at rest', (0.03, 0.85), xycoords='axes fraction', va='top')
    number.grid(alpha=0.3)
    return figure


def force_figure(undulation: Experiment, sidewinding: Experiment) -> Figure:
    """Return a figure of the normal forces of all contacts and of their sum over time."""
    figure = page(4.8, 'Normal forces, means over 10 ms', assumed_in_both(sidewinding.scene))
    panels = figure.subplots(2, 2, sharex=True)
    for column, (case, name) in enumerate(
        zip((undulation, sidewinding), CASE_TITLES, strict=True)
    ):
        each, total = panels[:, column]
        draw_each(each, case.periods, case.force_along_body)
        sums = case.normal_force.sum(axis=1)
        total.plot(case.periods, sums, color=PATH_COLOR, lw=0.7, label='sum')
        label = f'weight, {weight(case.scene):.3f} N'
        total.axhline(weight(case.scene), color='black', ls='--', lw=1.0, label=label)
        each.set(title=f'{name}: 22 spheres', ylim=(0, None))
        total.set(title=f'sum, mean {sums.mean():.2f} N', ylim=(0, 125), xlabel='t [s]')
        total.grid(alpha=0.3)
    for axes, label in zip(panels[:, 0], ('each [N]', 'sum [N]'), strict=True):
        axes.set_ylabel(label)
    color_key(figure, panels, 'link', undulation.scene.robot.link_count)
    panels[1, 0].legend(loc='lower right', ncols=2, frameon=False)
    return figure


def energy_figure(undulation: Experiment, sidewinding: Experiment) -> Figure:
    """Return a figure of energy and work over time, and of the energy that is left over."""
    figure = page(
        5.2, 'Energy balance, added up over all steps', assumed_in_both(sidewinding.scene)
    )
    panels = figure.subplots(2, 2, sharex=True, height_ratios=[1.8, 1])
    for column, (case, name) in enumerate(
        zip((undulation, sidewinding), CASE_TITLES, strict=True)
    ):
        parts, rest = panels[:, column]
        time = case.trajectory.time
        parts.plot(time, case.joint_work, color=PATH_COLOR, label='work of the joints')
        parts.plot(time, case.contact_work, color=LOADED_COLOR, label='work of the contacts')
        parts.plot(time, case.energy, color='#009e73', label='mechanical energy')
        rest.plot(time, 1e3 * case.left_over, color='black', lw=0.9)
        parts.set_title(name)
        rest.set(xlabel='t [s]', title='left over: energy less both kinds of work')
        for axes in (parts, rest):
            axes.grid(alpha=0.3)
    panels[0, 0].set_ylabel('[J]')
    panels[1, 0].set_ylabel('[mJ]')
    panels[0, 0].legend(loc='upper left', frameon=False)
    return figure

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The simulation figures of the paper, and further figures of its experiments.

`draw_figures` writes all of them. Each picture lists what the paper does not state after the word
"assumed".
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib import colormaps, rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
import numpy as np
from PIL import Image

from snake_sim_benchmarks.comparison.chart_style import CHART_STYLE, PATH_COLOR
from snake_sim_benchmarks.paper.experiments import (
    assumed_in_a,
    assumed_in_b,
    assumed_in_both,
    assumed_in_c,
    case_scene,
    Experiment,
    isotropic_paths,
    mean_velocity,
    PATH_RATE,
    RATE,
    record,
)
from snake_sim_benchmarks.paper.tables import weight, write_tables
from snake_sim_ros import Robot
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.files import whole_file
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.trajectory import Trajectory

WIDTH = 9.0  # inch, as wide as a page on GitHub
GRAY = '#666666'
LOADED_COLOR = '#d55e00'  # of spheres that carry load


def page(height: float, title: str, assumed: str) -> Figure:
    """Return a figure with a title at its top and the assumptions at its foot."""
    figure = Figure(figsize=(WIDTH, height), layout='constrained')
    figure.suptitle(title, x=0.01, ha='left', fontsize=10, fontweight='bold')
    figure.supxlabel(assumed, x=0.01, ha='left', fontsize=7.5, color=GRAY)
    return figure


# ---- figures 6 to 9: paths and postures, from above and in perspective --------------------------


LINK_COLOR = '#cfe3f1'
FRICTION_COLORS = ('#56b4e9', '#0072b2', '#009e73', '#e69f00', '#d55e00')


def outlines(robot: Robot, position: Array, axis: Array) -> Array:
    """Return the links seen from above as rectangles, shape (n, 4, 2) [m]."""
    along = axis[:, :2] * (robot.per_link('contact_offset') + 0.01)[:, None]
    heading = axis[:, :2] / np.linalg.norm(axis[:, :2], axis=1, keepdims=True)
    across = np.stack([-heading[:, 1], heading[:, 0]], axis=1)
    across *= robot.per_link('contact_radius')[:, None]
    corners = [along + across, along - across, -along - across, across - along]
    return np.stack([position[:, :2] + corner for corner in corners], axis=1)


def draw_robot(axes: Axes, case: Experiment, k: int, *, loaded: bool = False) -> None:
    """Draw the robot from above at a sample, with a dark link 1 and dots for loaded spheres."""
    run = case.trajectory
    links = outlines(case.scene.robot, run.position[k], run.axis[k])
    colors = [PATH_COLOR] + [LINK_COLOR] * (len(links) - 1)
    axes.add_collection(PolyCollection(list(links), facecolor=colors, edgecolor=GRAY, lw=0.6))
    axes.plot(*run.position[k, :, :2].T, color=GRAY, lw=0.8)
    if loaded:
        force = case.normal_force[max(k - 1, 0)]
        lever = run.axis[k] * case.scene.robot.per_link('contact_offset')[:, None]
        spheres = np.concatenate([run.position[k] + lever, run.position[k] - lever])
        axes.plot(*spheres[force > 0.0, :2].T, 'o', color=LOADED_COLOR, ms=3.5, zorder=4)


def sample_at(run: Trajectory, time: float) -> int:
    """Return the index of the sample at a time."""
    return int(np.abs(run.time - time).argmin())


def ground_axes(axes: Axes) -> None:
    """Make axes a map of the floor."""
    axes.set(xlabel='x [m]', ylabel='y [m]')
    axes.set_aspect('equal', adjustable='datalim')
    axes.grid(alpha=0.3)


def path_figure(case: Experiment) -> Figure:
    """Return Fig. 6: the path of the middle link in case A."""
    run = case.trajectory
    friction = case.scene.friction
    figure = page(
        3.3,
        f'Fig. 6: path of link 6, lateral undulation, friction {friction.longitudinal:g} along '
        f'and {friction.transversal:g} across the link',
        assumed_in_a(case.scene),
    )
    axes = figure.add_subplot()
    for k in (0, len(run.time) - 1):
        draw_robot(axes, case, k)
    axes.plot(*run.path[:, :2].T, color=LOADED_COLOR, lw=1.8, label='path of link 6', zorder=3)
    marks = [sample_at(run, t) for t in np.linspace(0.0, run.time[-1], 4)]
    axes.plot(*run.path[marks, :2].T, 'o', color=LOADED_COLOR, ms=5, zorder=5)
    for k in marks:
        axes.annotate(
            f'{run.time[k]:g} s', tuple(run.path[k, :2]), xytext=(0, 9), ha='center',
            textcoords='offset points', bbox={'fc': 'white', 'ec': 'none', 'pad': 1}, zorder=6,
        )  # fmt: skip
    ground_axes(axes)
    axes.legend(loc='lower right', frameon=False, title='link 1 is dark')
    return figure


def isotropic_figure(paths: Mapping[float, Array], undulation: Experiment) -> Figure:
    """Return Fig. 7: path and velocity of the middle link with isotropic friction."""
    figure = page(
        4.6, 'Fig. 7: position of link 6, lateral undulation, isotropic friction', assumed_in_b()
    )
    above, far, rate = figure.subplots(1, 3, width_ratios=[1.25, 1.3, 0.85])
    speeds: list[float] = []
    for (mu, path), color in zip(paths.items(), FRICTION_COLORS, strict=True):
        time = np.arange(len(path)) / PATH_RATE
        above.plot(*path[:, :2].T, '--', color=color, lw=1.2, label=f'{mu:g}')
        far.plot(time, path[:, 0] - path[0, 0], '--', color=color, lw=1.2)
        speeds.append(1e3 * mean_velocity(undulation.scene, path, PATH_RATE)[0])
        rate.plot(mu, speeds[-1], 'o', color=color, ms=7)
    ground_axes(above)
    above.set_title('path (colors: friction, right)')
    run = undulation.trajectory
    far.plot(run.time, run.path[:, 0] - run.path[0, 0], color=GRAY, lw=1.2)
    far.annotate('case A (Fig. 6)', (0.5, 0.42), xycoords='axes fraction', color=GRAY, ha='right')
    far.annotate('case B', (0.97, 0.86), xycoords='axes fraction', ha='right')
    far.set(xlabel='t [s]', ylabel='x of link 6 from its start [m]', title='distance')
    far.grid(alpha=0.3)
    a = 1e3 * mean_velocity(run.scene, run.path, RATE)[0]
    rate.set(
        xlabel='friction', ylabel='mean velocity along x [mm/s]', ylim=(0, 1.25 * max(speeds))
    )
    rate.set_title(f'velocity (A: {a:.0f} mm/s)')
    rate.grid(alpha=0.3)
    return figure


def soft_start_figure(case: Experiment) -> Figure:
    """Return Fig. 8: postures from above while the waves of sidewinding fade in."""
    run = case.trajectory
    fade = case.scene.gait.soft_start
    figure = page(
        7.0,
        'Fig. 8: soft start of sidewinding, from above (dots: spheres that carry load)',
        f'{assumed_in_c(case.scene)};\nthe instants shown',
    )
    panels = figure.subplots(4, 2).T.ravel()
    times = np.linspace(0.0, min(fade, run.time[-1]), len(panels) - 1)
    for axes, t in zip(panels, times, strict=False):
        k = sample_at(run, t)
        draw_robot(axes, case, k, loaded=True)
        axes.annotate(
            f't = {run.time[k]:.2f} s',
            (0.02, 0.95),
            xycoords='axes fraction',
            va='top',
        )
        axes.set_aspect('equal', adjustable='box')
        axes.set(xlim=(-0.8, 0.8), ylim=(-0.45, 0.17), ylabel='y [m]')
        axes.grid(alpha=0.3)
    panels[3].set_xlabel('x [m]')
    panels[6].set_xlabel('x [m]')
    axes, t = panels[-1], np.linspace(0.0, 1.25 * fade, 100)
    axes.plot(t, gait.soft_start(t, fade)[0], color=PATH_COLOR)
    axes.plot(times, gait.soft_start(times, fade)[0], 'o', color=LOADED_COLOR, ms=4)
    axes.set(xlabel='t [s]', ylabel='factor s', ylim=(-0.05, 1.1))
    axes.grid(alpha=0.3)
    return figure


def sidewinding_figure(case: Experiment) -> Figure:
    """Return Fig. 9: sidewinding at four instants, from above and from the side."""
    run = case.trajectory
    figure = page(
        4.9,
        'Fig. 9: sidewinding, from above and in perspective (dots: spheres that carry load)',
        assumed_in_c(case.scene),
    )
    times = np.linspace(0.0, run.time[-1], 4)
    grid = figure.add_gridspec(2, 4, height_ratios=[1.35, 1.0])
    shared: Axes | None = None
    for column, t in enumerate(times):
        k = sample_at(run, t)
        axes = figure.add_subplot(grid[0, column], sharex=shared, sharey=shared)
        shared = shared or axes
        draw_robot(axes, case, k, loaded=True)
        axes.plot(*run.path[: k + 1, :2].T, color='#009e73', lw=1.0)
        axes.set(title=f't = {run.time[k]:g} s', xlabel='x [m]')
        axes.set_aspect('equal', adjustable='box')
        axes.grid(alpha=0.3)
        axes.tick_params(labelleft=column == 0)
        draw_in_space(figure.add_subplot(grid[1, column], projection='3d'), case, k)
    assert shared is not None
    shared.set(ylabel='y [m]', xlim=(-0.9, 0.8), ylim=(-1.75, 0.4))
    return figure


def draw_in_space(axes: Any, case: Experiment, k: int) -> None:
    """Draw the robot in perspective, with enlarged heights and its shadow on the floor."""
    run = case.trajectory
    center, robot = run.position[k].mean(axis=0), case.scene.robot
    ends = (robot.per_link('link_length') / 2)[:, None] * run.axis[k]
    line = np.concatenate([run.position[k] - ends, run.position[k][-1:] + ends[-1:]])
    line[:, :2] -= center[:2]
    line[:, 2] = 1e3 * (line[:, 2] - robot.per_link('contact_radius')[0])
    axes.plot(*line[:, :2].T, 0.0, color='#bbbbbb', lw=4)
    axes.plot(*line.T, color=PATH_COLOR, lw=2.0, marker='o', ms=2.5)
    axes.set(xlim=(-0.7, 0.7), ylim=(-0.4, 0.4), zlim=(0.0, 60.0))
    axes.set_box_aspect((1.4, 0.8, 0.45), zoom=1.3)
    axes.view_init(elev=22, azim=-70)
    axes.set(xticks=[-0.5, 0.0, 0.5], yticks=[-0.3, 0.3], zticks=[0, 50])
    axes.tick_params(labelsize=6, pad=-3)
    axes.set_title('x, y [m], height [mm]', fontsize=7, y=0.92)


# ---- torques, forces, errors and energies over time ---------------------------------------------


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


# ---- all of them --------------------------------------------------------------------------------


DPI = 100
PALETTE_SIZE = 96  # number of colors of a picture


def draw_figures(folder: Path, duration: float = 15.0) -> list[Path]:
    """
    Run the cases of the paper, and write all figures as PNG and their numbers as Markdown.

    Parameters
    ----------
    folder : Path
        It is created if it does not exist.
    duration : float, optional
        Duration of every case [s]; that of the paper is 15 s.

    Returns
    -------
    list of Path
        The files that were written.

    Raises
    ------
    ParameterError
        If the duration is not a multiple of 0.05 s.

    """
    folder.mkdir(parents=True, exist_ok=True)
    isotropic = isotropic_paths(duration)
    undulation, sidewinding = (record(case_scene(case, duration)) for case in 'AC')
    drawn = []
    with rc_context(CHART_STYLE):
        for name, figure in all_figures(undulation, isotropic, sidewinding).items():
            drawn.append(folder / f'{name}.png')
            save_small(figure, drawn[-1])
    return [*drawn, *write_tables(folder, undulation, isotropic, sidewinding)]


def save_small(figure: Figure, path: Path) -> None:
    """Write a figure as PNG with a palette, which takes a third of the bytes."""
    figure.set_dpi(DPI)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert('RGB')
    with whole_file(path) as part:
        image.quantize(PALETTE_SIZE, dither=Image.Dither.NONE).save(part, optimize=True)


def all_figures(
    undulation: Experiment, isotropic: Mapping[float, Array], sidewinding: Experiment
) -> dict[str, Figure]:
    """Return all figures by the names of their files, from cases A, B and C."""
    both = undulation, sidewinding
    return {
        'fig6_path': path_figure(undulation),
        'fig7_isotropic': isotropic_figure(isotropic, undulation),
        'fig8_soft_start': soft_start_figure(sidewinding),
        'fig9_sidewinding': sidewinding_figure(sidewinding),
        'joint_torques': torque_figure(*both),
        'tracking_error': tracking_figure(*both),
        'contact_pattern': contact_figure(sidewinding),
        'normal_forces': force_figure(*both),
        'energy_balance': energy_figure(*both),
    }

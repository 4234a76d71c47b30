# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Figures 6 to 9 of the paper: paths and postures, seen from above and in perspective."""

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
import numpy as np

from snake_sim_benchmarks.comparison.chart_style import PATH_COLOR
from snake_sim_benchmarks.paper.assumptions import assumed_in_a, assumed_in_b, assumed_in_c
from snake_sim_benchmarks.paper.experiments import Experiment, mean_velocity, PATH_RATE, RATE
from snake_sim_benchmarks.paper.figure_page import GRAY, LOADED_COLOR, page
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import Array, Robot
from snake_sim_ros.stepping.trajectory import Trajectory

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

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A run as a picture of numbers: path, joint angles, joint torques and contact forces."""

from pathlib import Path

from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np

from snake_sim_ros.controllers.paths import PlanarPath
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.files import write_figure
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.trajectory import Trajectory

SUFFIXES = ('.png', '.pdf', '.svg')
PATH_COLOR = '#0072b2'
POSTURE_COLORS = ('#999999', '#56b4e9', '#009e73', '#e69f00', '#d55e00')
MOST_NAMED = 12  # joints that a legend names; their colors go from the head to the tail


def check_plot(path: Path) -> None:
    """Raise an error if no picture can be written to a file."""
    if path.suffix not in SUFFIXES:
        raise ParameterError(f'a plot must end in {", ".join(SUFFIXES)}; got {path}')
    if not path.absolute().parent.is_dir():
        raise ParameterError(f'no folder {path.absolute().parent} for the plot')


def draw(trajectory: Trajectory, path: Path, title: str = '') -> None:
    """
    Draw path, joint angles, joint torques and contact forces of a run.

    Parameters
    ----------
    trajectory : Trajectory
    path : Path
        A PNG, PDF or SVG file.
    title : str, optional

    Raises
    ------
    ParameterError
        If the file has another suffix, or its folder does not exist.

    """
    check_plot(path)
    figure = Figure(figsize=(11.0, 8.0), layout='constrained')
    FigureCanvasAgg(figure)
    panels = figure.subplots(3, 2)
    _path(panels[0, 0], trajectory)
    _forces(panels[0, 1], trajectory)
    by_joint = trajectory.scene.robot.by_joint
    angles = ('angle', np.degrees(by_joint(trajectory.joint_angle)), 'deg')
    torques = ('torque', by_joint(trajectory.joint_torque), 'N m')
    for row, (what, values, unit) in zip(panels[1:], (angles, torques), strict=True):
        for k, axis in enumerate(('yaw', 'pitch')):
            _joints(row[k], trajectory.time, values[:, :, k])
            row[k].set(ylabel=f'{axis} {what} [{unit}]', xlabel='time [s]')
    figure.suptitle(title)
    write_figure(figure, path, dpi=110)


def _path(axes: Axes, trajectory: Trajectory) -> None:
    """Draw the way of the middle link, and the robot at the start and at the end."""
    if trajectory.scene.follow:
        points = PlanarPath.of(trajectory.scene.follow).points
        axes.plot(*points.T, color='#e69f00', ls='--', label='path')
        axes.plot(*trajectory.position[:, :, :2].mean(axis=1).T, color='#009e73', label='center')
    else:
        axes.plot(*trajectory.path[:, :2].T, color='#0072b2', label='middle link')
    for k, color, name in ((0, '0.7', 'robot at the start'), (-1, '#d55e00', 'at the end')):
        axes.plot(*trajectory.position[k, :, :2].T, color=color, marker='.', label=name)
    axes.set(xlabel='x [m]', ylabel='y [m]')
    axes.set_aspect('equal', adjustable='datalim')
    axes.legend(frameon=False, fontsize=8)
    axes.grid(alpha=0.3)


def _forces(axes: Axes, trajectory: Trajectory) -> None:
    """Draw the sum of the contact forces on the robot, upward and sideways."""
    force = np.zeros((len(trajectory.time), 3))
    np.add.at(force, trajectory.contact_sample, trajectory.contact_force)
    axes.plot(trajectory.time, force[:, 2], label='upward', color='#0072b2')
    for k, color in ((0, '#d55e00'), (1, '#009e73')):
        axes.plot(trajectory.time, force[:, k], label=f'along {"xy"[k]}', color=color, lw=0.8)
    axes.set(xlabel='time [s]', ylabel='sum of contact forces [N]')
    axes.legend(frameon=False, fontsize=8)
    axes.grid(alpha=0.3)


def _joints(axes: Axes, time: Array, values: Array) -> None:
    """Draw a quantity of all joints over time that have it."""
    count, known = values.shape[1], ~np.isnan(values).all(axis=0)
    for j in np.flatnonzero(known):
        shade = colormaps['viridis'](0.9 * j / max(count - 1, 1))
        axes.plot(time, values[:, j], color=shade, lw=0.9, label=f'joint {j + 1}')
    if known.any() and count <= MOST_NAMED and np.nan_to_num(values).any():
        axes.legend(fontsize=6, ncols=2, framealpha=0.6)
    axes.grid(alpha=0.3)


def path_figure(
    file: Path, title: str, time: Array, position: Array, link: int, postures: int = 4
) -> None:
    """
    Draw the path of one link and some postures of the robot from above, as PNG or SVG.

    Parameters
    ----------
    file : Path
    title : str
    time : ndarray, shape (m,)
        [s]
    position : ndarray, shape (m, n, 3)
        Link centers [m, frame I].
    link : int
        Index of the link whose path is drawn.
    postures : int, optional
        Postures to draw, evenly spaced in time from the first to the last.

    """
    figure = Figure(figsize=(8.0, 4.5), layout='constrained')
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    shown = np.unique(np.linspace(0, len(time) - 1, postures).round().astype(int))
    for k, color in zip(shown, POSTURE_COLORS, strict=False):
        label = f't = {time[k] - time[0]:.1f} s'
        axes.plot(position[k, :, 0], position[k, :, 1], 'o-', color=color, lw=3, ms=5, label=label)
    path = position[:, link]
    axes.plot(path[:, 0], path[:, 1], color=PATH_COLOR, lw=1.5, label=f'link {link + 1}', zorder=3)
    axes.set(xlabel='x [m]', ylabel='y [m]', title=title)
    axes.set_aspect('equal', adjustable='datalim')
    axes.grid(alpha=0.3)
    figure.legend(loc='outside lower center', ncols=len(shown) + 1, frameon=False)
    write_figure(figure, file, dpi=120)

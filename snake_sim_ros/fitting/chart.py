# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The picture of a fit: residuals over time, as a distribution, and what segments ask for."""

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np

from snake_sim_ros.fitting.fit import Fit
from snake_sim_ros.scene.files import write_figure
from snake_sim_ros.scene.parameters import Array

COLORS = ('#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9')
BINS = np.linspace(-5.0, 5.0, 61)  # in units of the noise


def draw(found: Fit, path: Path) -> None:
    """
    Draw the residuals of a fit.

    Parameters
    ----------
    found : Fit
    path : Path
        Where the picture is written.

    """
    figure = Figure(figsize=(11.0, 7.5), layout='constrained')
    FigureCanvasAgg(figure)
    (places, joints), (spread, values) = figure.subplots(2, 2)
    _over_time(found, places, joints)
    _distribution(found, spread)
    _of_segments(found, values)
    write_figure(figure, path, dpi=120)


def _over_time(found: Fit, places: Axes, joints: Axes) -> None:
    """Draw root mean squares of all positions and of all angles over time."""
    settings, recording = found.replay.settings, found.replay.recording
    poses, angles = [], []
    for segment, item in zip(found.replay.segments, found.residuals, strict=True):
        off = settings.noise_position * np.sqrt((item.poses[..., :3] ** 2).mean(axis=(1, 2)))
        times = segment.times[segment.poses]
        places.plot(times, 1e3 * off, '.', ms=2, color=COLORS[0])
        poses.append(off)
        off = settings.noise_angle * np.sqrt(np.nanmean(item.joints**2, axis=(1, 2)))
        joints.plot(segment.times[segment.joints], np.degrees(off), '.', ms=2, color=COLORS[0])
        angles.append(off)
    for axes, noise, unit in (
        (places, 1e3 * settings.noise_position, 'mm'),
        (joints, np.degrees(settings.noise_angle), 'deg'),
    ):
        axes.axhline(noise, color=COLORS[1], lw=1, label='stated noise')
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel('time [s]')
        axes.set_ylabel(f'root mean square left [{unit}]')
        axes.legend(loc='lower right')
    places.set_title(f'positions of {len(recording.links)} links')
    joints.set_title('joint angles')


def _distribution(found: Fit, axes: Axes) -> None:
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


def _of_segments(found: Fit, axes: Axes) -> None:
    """Draw what each segment alone would change of each value, the others held."""
    middle = [(item.begin + item.end) / 2 for item in found.replay.segments]
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

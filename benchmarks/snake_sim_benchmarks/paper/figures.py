# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The simulation figures of the paper, and further figures of its experiments.

`draw_figures` writes all of them. Each picture lists what the paper does not state after the word
"assumed".
"""

from collections.abc import Mapping
from pathlib import Path

from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np
from PIL import Image

from snake_sim_benchmarks.comparison.chart_style import CHART_STYLE
from snake_sim_benchmarks.paper.experiments import case_scene, Experiment, isotropic_paths, record
from snake_sim_benchmarks.paper.path_figures import (
    isotropic_figure,
    path_figure,
    sidewinding_figure,
    soft_start_figure,
)
from snake_sim_benchmarks.paper.tables import write_tables
from snake_sim_benchmarks.paper.time_figures import (
    contact_figure,
    energy_figure,
    force_figure,
    torque_figure,
    tracking_figure,
)
from snake_sim_ros.scene.files import whole_file
from snake_sim_ros.scene.parameters import Array

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

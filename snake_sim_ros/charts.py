"""Pictures; the only module that imports matplotlib. The colors are safe for the color-blind."""

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np

from snake_sim_ros.parameters import Array

PATH_COLOR = '#0072b2'
POSTURE_COLORS = ('#999999', '#56b4e9', '#009e73', '#e69f00', '#d55e00')


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
    figure.savefig(file, dpi=120)

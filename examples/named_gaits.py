# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Run the gaits of the literature that have a name, without ROS, and draw where each one goes."""

import argparse
import math

from matplotlib.figure import Figure
import numpy as np

from snake_sim_ros import run

GAITS = (
    'lateral_undulation', 'eel_like', 'concertina', 'linear_progression',
    'sidewinding', 'turn_in_place', 'rolling', 'rolling_helix',
)  # fmt: skip


def main() -> None:
    """Print how far each gait went and turned, and draw the robots every fifth of the time."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--duration', type=float, default=12.0, help='s')
    parser.add_argument('--out', default='gaits.png')
    arguments = parser.parse_args()
    figure = Figure(figsize=(11.0, 5.6), layout='constrained')
    for axes, name in zip(figure.subplots(2, 4).flat, GAITS, strict=True):
        moved = run(name, duration=arguments.duration)
        x, y = moved.position[:, :, 0], moved.position[:, :, 1]
        ahead = np.unwrap(np.arctan2(y[:, 0] - y[:, -1], x[:, 0] - x[:, -1]))
        turn = math.degrees(ahead[-1] - ahead[0])
        print(f'{name}: {moved.distance:.2f} m, turned by {turn:.0f} degrees')
        for share, k in zip(np.linspace(0.2, 1.0, 6), np.linspace(0, len(x) - 1, 6), strict=True):
            axes.plot(x[int(k)], y[int(k)], color='#0072b2', lw=2.5, alpha=share)
        axes.plot(x.mean(axis=1), y.mean(axis=1), color='#009e73')
        axes.set(title=name.replace('_', ' '), xlabel='x [m]', ylabel='y [m]')
        axes.set_aspect('equal', 'datalim')
        axes.grid(alpha=0.3)
    figure.savefig(arguments.out, dpi=110)
    print(arguments.out)


if __name__ == '__main__':
    main()

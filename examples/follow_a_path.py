# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Follow a path by lateral undulation and by sidewinding without ROS, and draw both."""

import argparse
import math

from matplotlib.figure import Figure

from snake_sim_ros import Following, PlanarPath, run

# x and y [m]; the path begins toward -x, where link 1 points, and to the left of it.
POINTS = [(0.0, 0.0), (-1.0, -1.0), (-2.5, -1.2), (-3.5, -0.2), (-5.0, 0.3)]


def main() -> None:
    """Print the cross-track error of each gait from 15 s on, and draw where the robots went."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--duration', type=float, default=45.0, help='s')
    parser.add_argument('--out', default='following.png')
    arguments = parser.parse_args()
    follow = Following(points=POINTS)
    path = PlanarPath.of(follow)
    figure = Figure(figsize=(9.0, 5.6), layout='constrained')
    panels = figure.subplots(2, 1, sharex=True)
    # Sidewinding moves to the left of the heading, which begins a quarter of a turn to the right.
    starts = {'lateral_undulation': 0.0, 'sidewinding': -math.pi / 2}
    for axes, (scene, heading) in zip(panels, starts.items(), strict=True):
        moved = run(scene, follow=follow, start={'heading': heading}, duration=arguments.duration)
        centers = moved.position[:, :, :2].mean(axis=1)
        arcs, errors = path.track(centers)
        late = errors[moved.time >= min(15.0, arguments.duration / 2)]
        print(
            f'{scene}: {arcs[-1] - arcs[0]:.2f} m of the path in {moved.time[-1]:g} s, '
            f'{1e3 * math.sqrt((late**2).mean()):.1f} mm beside it'
        )
        axes.plot(*path.points.T, color='#e69f00', ls='--', label='path')
        axes.plot(*centers.T, color='#009e73', label='center of the robot')
        for k in range(0, len(moved.time), 1100):
            axes.plot(*moved.position[k, :, :2].T, color='#0072b2', lw=2.5, alpha=0.7)
        axes.set(ylabel='y [m]', title=scene.replace('_', ' '))
        axes.set_aspect('equal')
        axes.grid(alpha=0.3)
    panels[0].legend(frameon=False)
    panels[-1].set_xlabel('x [m]')
    figure.savefig(arguments.out, dpi=110)
    print(arguments.out)


if __name__ == '__main__':
    main()

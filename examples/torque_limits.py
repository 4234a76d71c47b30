# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Draw how the four cases of the paper change with weaker servos: paths of link 6 in 15 s."""

import argparse

from matplotlib.figure import Figure

from snake_sim_ros import run

CASES = {
    'A': 'lateral_undulation',
    'B': 'lateral_undulation_isotropic',
    'C': 'sidewinding',
    'D': 'sinus_lifting',
}
LIMITS = (None, 5.0, 2.0, 1.0)  # N m, of all axes


def main() -> None:
    """Run the cases with every limit, print the distances, and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--out', default='torque_limits.png')
    parser.add_argument('--duration', type=float, default=15.0)
    arguments = parser.parse_args()
    figure = Figure(figsize=(9.0, 3.0), layout='constrained')
    for axes, (case, name) in zip(figure.subplots(1, len(CASES)), CASES.items(), strict=True):
        for limit in LIMITS:
            settings = {
                'robot.yaw_torque_limit': limit,
                'robot.pitch_torque_limit': limit,
                'method': 'bdf2',
                'dt': 1 / 200,
                'duration': arguments.duration,
            }
            path = run(name, settings).path
            way = float(((path[-1] - path[0])[:2] ** 2).sum() ** 0.5)
            word = 'no limit' if limit is None else f'{limit:g} N m'
            axes.plot(path[:, 0], path[:, 1], label=word, lw=1.2)
            print(f'case {case}, {word}: {way:.3f} m')
        axes.set(title=f'case {case}', xlabel='x [m]', ylabel='y [m]')
        axes.set_aspect('equal', adjustable='datalim')
        axes.grid(alpha=0.3)
    axes.legend(frameon=False, fontsize=8)
    figure.savefig(arguments.out, dpi=110)
    print(arguments.out)


if __name__ == '__main__':
    main()

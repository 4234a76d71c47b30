# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Simulate a robot of seven links instead of Aiko, and how friction changes its speed."""

import argparse

from snake_sim_ros import load_scene, Robot, Run, run

ROBOT = Robot(
    link_count=7,
    link_length=0.2,  # m
    link_mass=0.5,  # kg
    contact_offset=0.06,  # m, from the center of a link to its contact spheres
    contact_radius=0.05,  # m
    inertia='consistent',  # of a uniform cylinder
)


def draw(crawls: dict[float, Run], file: str) -> None:
    """Draw the way of the middle link for each friction, and where the robot ends."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 2.2), layout='constrained')
    axes = figure.subplots()
    for friction, crawl in crawls.items():
        (line,) = axes.plot(*crawl.path[:, :2].T, label=f'friction {friction:g}', lw=1.2)
        axes.plot(*crawl.position[-1, :, :2].T, color=line.get_color(), lw=4.0, alpha=0.5)
    axes.set(aspect='equal', xlabel='x [m]', ylabel='y [m]')
    axes.legend(frameon=False)
    figure.savefig(file, dpi=110)


def main() -> None:
    """Run the same gait with several coefficients of friction across the links."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--duration', type=float, default=10.0, help='s')
    parser.add_argument('--plot', help='a picture of the ways, such as own_robot.png')
    arguments = parser.parse_args()
    scene = load_scene('lateral_undulation', robot=ROBOT, duration=arguments.duration)
    crawls = {x: run(scene, {'friction.transversal': x}) for x in (0.3, 0.5, 0.7)}
    for friction, crawl in crawls.items():
        print(f'friction {friction:g}: {crawl.speed:.4f} m/s, {crawl.energy:.2f} J')
    if arguments.plot:
        draw(crawls, arguments.plot)


if __name__ == '__main__':
    main()

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Simulate a robot of seven links instead of Aiko, and how friction changes its speed."""

import argparse

from snake_sim_ros import load_scene, Robot, run

ROBOT = Robot(
    link_count=7,
    link_length=0.2,  # m
    link_mass=0.5,  # kg
    contact_offset=0.06,  # m, from the center of a link to its contact spheres
    contact_radius=0.05,  # m
    inertia='consistent',  # of a uniform cylinder
)


def main() -> None:
    """Run the same gait with several coefficients of friction across the links."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--duration', type=float, default=10.0, help='s')
    arguments = parser.parse_args()
    scene = load_scene('lateral_undulation', robot=ROBOT, duration=arguments.duration)
    for friction in (0.3, 0.5, 0.7):
        crawl = run(scene, {'friction.transversal': friction})
        print(f'friction {friction:g}: {crawl.speed:.4f} m/s, {crawl.energy:.2f} J')


if __name__ == '__main__':
    main()

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Run a gait made of two waves without ROS, print how far it goes, and draw the run."""

import argparse
import math

from snake_sim_ros import Gait, run, Wave


def main() -> None:
    """Sidewind with waves of 80 degrees a second, pitch a quarter of a cycle after yaw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--duration', type=float, default=10.0, help='s')
    parser.add_argument('--out', default='first_gait.png')
    arguments = parser.parse_args()
    both = {'angular_frequency': math.radians(80), 'phase_lag': math.radians(-50)}
    gait = Gait(
        yaw=Wave(amplitude=math.radians(30), **both),
        pitch=Wave(amplitude=math.radians(10), phase=math.radians(90), **both),
        soft_start=2.0,
    )
    sidewinding = run('sidewinding', gait=gait, duration=arguments.duration)
    print(f'{sidewinding.distance:.3f} m at {sidewinding.speed:.3f} m/s')
    print(f'cost of transport {sidewinding.cost_of_transport:.3f}')
    sidewinding.plot(arguments.out)
    print(arguments.out)


if __name__ == '__main__':
    main()

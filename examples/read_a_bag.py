# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Print what a robot did in a ROS 2 bag or a recorded run, without ROS."""

import argparse

import numpy as np

from snake_sim_ros import read_run


def main() -> None:
    """Read a run, and print its path, its largest torque and its metrics."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('run', help='MCAP file, folder of a bag, or npz file')
    parser.add_argument('--namespace', help='of the robot, where a bag has several')
    parser.add_argument('--plot', help='a picture of the run, such as run.png')
    arguments = parser.parse_args()
    recorded = read_run(arguments.run, arguments.namespace)
    (x, y, _), samples = recorded.path[-1], len(recorded.time)
    seconds = recorded.time[-1] - recorded.time[0]
    print(f'{samples} samples, {seconds:.2f} s, ends at ({x:.3f}, {y:.3f}) m')
    largest = np.abs(recorded.joint_torque).max(axis=0)
    name = recorded.scene.robot.axis_names[largest.argmax()]
    print(f'largest torque {largest.max():.2f} N m, {name}')
    for name, value in recorded.metrics.items():
        print(f'{name}: {"not known" if value is None else f"{value:.4g}"}')
    if arguments.plot:
        recorded.plot(arguments.plot)


if __name__ == '__main__':
    main()

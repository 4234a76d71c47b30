# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Record the torque of all joints for some seconds, and draw that of the yaw joints.

Start robot and gait, each in a terminal, then this script:

    ros2 run snake_sim_ros sim
    ros2 run snake_sim_ros gait --ros-args -p use_sim_time:=true
    python3 examples/record_torque.py --duration 5 --out torque.csv

Without a ROS 2 installation: ./run sim, ./run gait and ./run python with the same arguments.
The file has a column for the time [s] and one for each joint [N m]; the picture is torque.png.
"""

import argparse
from contextlib import suppress
from pathlib import Path
import sys
import time

from matplotlib.figure import Figure
import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.utilities import remove_ros_args
from sensor_msgs.msg import JointState


class Recorder(Node):
    """Keeps all joint states that it hears, with their times [s]."""

    def __init__(self):
        super().__init__('record_torque')
        self.times, self.torques, self.names = [], [], []
        # 1000 may wait while this process is busy.
        self.create_subscription(JointState, 'joint_states', self.on_state, 1000)

    def on_state(self, message):
        """Keep stamp and torques."""
        self.times.append(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)
        self.torques.append(message.effort)
        self.names = message.name

    def record(self, duration, timeout):
        """Listen for a simulated time [s]; end with one sentence if no message comes."""
        heard = time.monotonic()
        while not self.times or self.times[-1] < self.times[0] + duration:
            count = len(self.times)
            rclpy.spin_once(self, timeout_sec=0.1)
            if len(self.times) > count:
                heard = time.monotonic()
            elif time.monotonic() > heard + timeout:
                sys.exit(f'no joint_states for {timeout:g} s: is snake_sim_ros sim running?')


def draw(names, times, torques, path):
    """Draw torques, shape (steps, joints) [N m], over times [s]."""
    figure = Figure(figsize=(8, 4), layout='constrained')
    axes = figure.subplots()
    axes.plot(times, torques, label=names)
    axes.set(xlabel='time [s]', ylabel='torque [N m]')
    axes.legend(loc='upper left', bbox_to_anchor=(1, 1))
    figure.savefig(path)


def main():
    """Record, save, draw."""
    parser = argparse.ArgumentParser(description='record and draw joint torque')
    parser.add_argument('--duration', type=float, default=5.0, help='simulated time [s]')
    parser.add_argument('--out', type=Path, default=Path('torque.csv'), help='CSV file')
    parser.add_argument('--timeout', type=float, default=10.0, help='longest wait [s]')
    options = parser.parse_args(remove_ros_args()[1:])
    recorder = Recorder()
    recorder.record(options.duration, options.timeout)

    names, torques = recorder.names, np.array(recorder.torques)
    table = np.column_stack([recorder.times, torques])
    header = ','.join(['time', *names])
    np.savetxt(options.out, table, '%.9g', delimiter=',', header=header, comments='')
    picture = options.out.with_suffix('.png')
    draw(names[::2], recorder.times, torques[:, ::2], picture)  # joint_1_yaw, joint_1_pitch, ...
    largest = np.abs(torques[:, ::2]).max()
    print(f'{len(table)} states, largest yaw torque {largest:.2f} N m: {options.out}, {picture}')


if __name__ == '__main__':
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        main()
    rclpy.try_shutdown()

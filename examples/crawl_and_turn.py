# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Crawl ahead, turn left and stop: cmd_vel to a gait that runs.

Start robot and gait, each in a terminal, then this script:

    ros2 run snake_sim_ros sim
    ros2 run snake_sim_ros gait --ros-args -p use_sim_time:=true
    python3 examples/crawl_and_turn.py

Without a ROS 2 installation: ./run sim, ./run gait and ./run python with the same arguments.
Times are those of the robot's messages: it may be slower or faster than real time.
"""

import argparse
from contextlib import suppress
import math
import signal
import sys
import time

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args


class Driver(Node):
    """Tells the gait where to go, and hears where the robot is."""

    def __init__(self, timeout):
        super().__init__('crawl_and_turn')
        self.timeout = timeout  # s, the longest wait for anything
        self.odom = None
        self.way = []  # places of the middle link, x and y [m]
        self.create_subscription(Odometry, 'odom', self.on_odom, 10)
        self.cmd_vel = self.create_publisher(Twist, 'cmd_vel', 1)

    def on_odom(self, message):
        """Keep the newest message, and the way that the robot has gone."""
        self.odom, place = message, message.pose.pose.position
        self.way.append((place.x, place.y))

    def wait_for(self, condition, what, name):
        """Serve messages until a condition holds; end with one sentence if it does not."""
        end = time.monotonic() + self.timeout
        while not condition():
            if time.monotonic() > end:
                sys.exit(f'no {what} for {self.timeout:g} s: is snake_sim_ros {name} running?')
            rclpy.spin_once(self, timeout_sec=0.1)

    def pose(self):
        """Return time [s], x, y [m] and yaw [rad] of the middle link, from a new message."""
        last = self.odom
        self.wait_for(lambda: self.odom is not last, 'odom', 'sim')
        stamp, pose = self.odom.header.stamp, self.odom.pose.pose
        q = pose.orientation
        yaw = math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))
        return stamp.sec + 1e-9 * stamp.nanosec, pose.position.x, pose.position.y, yaw

    def ask(self, speed, turning):
        """Ask for a speed, link 1 ahead [m/s], and a turn to the left [rad/s]."""
        twist = Twist()
        twist.linear.x, twist.angular.z = float(speed), float(turning)
        self.cmd_vel.publish(twist)
        self.cmd_vel.wait_for_all_acked(Duration(seconds=1))

    def drive(self, speed, turning, duration):
        """Drive for a simulated time [s], show and return where that ends."""
        self.ask(speed, turning)
        begin, *_ = pose = self.pose()
        while pose[0] < begin + duration:
            pose = self.pose()
        print('t = {:6.2f} s, x = {:5.2f} m, y = {:5.2f} m, yaw = {:5.2f} rad'.format(*pose))
        return pose


def draw(way, file):
    """Draw the way of the middle link, seen from above."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 3.6), layout='constrained')
    axes = figure.subplots()
    axes.plot(*zip(*way, strict=True))
    axes.plot(*way[-1], 'o')
    axes.set_aspect('equal', adjustable='datalim')
    axes.set(xlabel='x [m]', ylabel='y [m]')
    axes.grid(alpha=0.3)
    figure.savefig(file, dpi=110)


def main():
    """Crawl, turn, stop, say where that led to."""
    parser = argparse.ArgumentParser(description='crawl ahead, turn left and stop')
    parser.add_argument('--timeout', type=float, default=10.0, help='longest wait [s]')
    parser.add_argument('--plot', help='a picture of the way, such as crawl_and_turn.png')
    arguments = parser.parse_args(remove_ros_args()[1:])
    driver = Driver(arguments.timeout)
    driver.wait_for(driver.cmd_vel.get_subscription_count, 'reader of cmd_vel', 'gait')
    try:
        _, x, y, yaw = driver.drive(0.0, 0.0, 2.0)  # straight, so that yaws compare
        driver.drive(0.12, 0.0, 4.0)
        driver.drive(0.12, 0.15, 6.0)
    finally:  # also after Ctrl-C
        driver.ask(0.0, 0.0)
    _, x_end, y_end, yaw_end = driver.drive(0.0, 0.0, 2.0)
    turn = math.degrees(math.remainder(yaw_end - yaw, 2 * math.pi))
    print(f'moved {math.hypot(x_end - x, y_end - y):.2f} m, turned {turn:.0f} degrees to the left')
    if arguments.plot:
        draw(driver.way, arguments.plot)


if __name__ == '__main__':
    # Without the handlers of rclpy the robot can still be stopped after Ctrl-C. It comes also
    # where a script started this with &, which ignores it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    with suppress(KeyboardInterrupt):
        main()
    rclpy.shutdown()

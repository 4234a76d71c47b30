# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Sidewind until the robot is a meter away, then stop: parameters and cmd_vel of a gait that runs.

Start robot and gait, each in a terminal, then this script:

    ros2 run snake_sim_ros sim --ros-args -p scene:=sidewinding
    ros2 run snake_sim_ros gait --ros-args -p use_sim_time:=true
    python3 examples/sidewind_a_metre.py

Without a ROS 2 installation: ./run sim, ./run gait and ./run python with the same arguments.
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
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

# A cycle of this gait moves the robot by the stride [m], to the side.
GAIT = [Parameter('scene', value='sidewinding'), Parameter('stride', value=0.473)]


class Sidewinder(Node):
    """Makes the gait sidewind and hears where the robot is."""

    def __init__(self, timeout):
        super().__init__('sidewind_a_metre')
        self.timeout = timeout  # s, the longest wait for anything
        self.odom = None
        self.way = []  # places of the middle link, x and y [m]
        self.create_subscription(Odometry, 'odom', self.on_odom, 10)
        self.cmd_vel = self.create_publisher(Twist, 'cmd_vel', 1)
        self.gait = AsyncParameterClient(self, 'gait')

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

    def choose_gait(self):
        """Set parameters of the gait; end with the reason if it refuses."""
        self.wait_for(self.gait.services_are_ready, 'gait', 'gait')
        self.wait_for(self.cmd_vel.get_subscription_count, 'reader of cmd_vel', 'gait')
        future = self.gait.set_parameters_atomically(GAIT)
        self.wait_for(future.done, 'answer of the gait', 'gait')
        if not future.result().result.successful:
            sys.exit(f'the gait does not sidewind: {future.result().result.reason}')

    def place(self):
        """Return time [s] and place (x, y) [m] of the middle link, from a new message."""
        last = self.odom
        self.wait_for(lambda: self.odom is not last, 'odom', 'sim')
        stamp, position = self.odom.header.stamp, self.odom.pose.pose.position
        return stamp.sec + 1e-9 * stamp.nanosec, (position.x, position.y)

    def ask(self, speed):
        """Ask for a speed [m/s]."""
        twist = Twist()
        twist.linear.x = float(speed)
        self.cmd_vel.publish(twist)
        self.cmd_vel.wait_for_all_acked(Duration(seconds=1))


def main():
    """Choose the gait, go, watch odom, stop."""
    parser = argparse.ArgumentParser(description='sidewind a meter')
    parser.add_argument('--timeout', type=float, default=10.0, help='longest wait [s]')
    parser.add_argument('--plot', help='a picture of the way, such as sidewind_a_metre.png')
    arguments = parser.parse_args(remove_ros_args()[1:])
    robot = Sidewinder(arguments.timeout)
    robot.choose_gait()
    begin, start = now, place = robot.place()
    try:
        robot.ask(0.2)
        while math.dist(place, start) < 1.0:
            now, place = robot.place()
    finally:  # also after Ctrl-C
        robot.ask(0.0)
    print(f'moved {math.dist(place, start):.3f} m in {now - begin:.2f} s')
    if arguments.plot:
        from crawl_and_turn import draw  # the file beside this one

        draw(robot.way, arguments.plot)


if __name__ == '__main__':
    # Without the handlers of rclpy the robot can still be stopped after Ctrl-C. It comes also
    # where a script started this with &, which ignores it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    with suppress(KeyboardInterrupt):
        main()
    rclpy.shutdown()

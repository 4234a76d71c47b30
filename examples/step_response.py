# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Step response of one joint in lock-step: the robot waits for this script, period by period.

Start the robot alone, without a gait, then this script:

    ros2 run snake_sim_ros sim
    python3 examples/step_response.py --joint joint_10_yaw --angle 10

Without a ROS 2 installation: ./run sim and ./run python with the same arguments. It measures
twice, each time from a reset, and gets the same bits. The picture is step_response.png. Periods
of 5 ms are coarse for the rise: -p publish_rate:=1000.0 gives the robot shorter ones.
"""

import argparse
from contextlib import suppress
import math
import signal
import sys
import time

from matplotlib.figure import Figure
import numpy as np
import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.time import Time
from rclpy.utilities import remove_ros_args
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

DURATION = 500_000_000  # ns of simulated time


class LockStep(Node):
    """Advances the robot by one publish period at a time."""

    def __init__(self, timeout):
        super().__init__('step_response')
        self.timeout = timeout  # s, the longest wait for anything
        self.state = None
        self.create_subscription(JointState, 'joint_states', self.on_state, 1)
        self.command = self.create_publisher(JointState, 'joint_command', 1)
        self.pause = self.create_client(SetBool, 'sim/pause')
        self.reset = self.create_client(Trigger, 'sim/reset')
        self.step = self.create_client(Trigger, 'sim/step')

    def on_state(self, message):
        """Keep the newest message."""
        self.state = message

    def wait_for(self, condition, what):
        """Serve messages until a condition holds; end with one sentence if it does not."""
        end = time.monotonic() + self.timeout
        while not condition():
            if time.monotonic() > end:
                sys.exit(f'no {what} for {self.timeout:g} s: is snake_sim_ros sim running?')
            rclpy.spin_once(self, timeout_sec=0.1)

    def call(self, client, request):
        """Call a service of the robot; end with the reason if it refuses."""
        self.wait_for(client.service_is_ready, client.srv_name)
        future = client.call_async(request)
        self.wait_for(future.done, f'answer of {client.srv_name}')
        if not future.result().success:
            sys.exit(f'{client.srv_name}: {future.result().message}')

    def state_after(self, client):
        """Return time [ns] and all angles [rad] after a call of ~/reset or ~/step."""
        self.state = None
        self.call(client, Trigger.Request())
        self.wait_for(lambda: self.state, 'joint_states')
        return Time.from_msg(self.state.header.stamp).nanoseconds, self.state.position

    def measure(self, joint, turn):
        """Tell a joint to turn [rad]; return times [s] and its angles and those of all [rad]."""
        states = [self.state_after(self.reset)]
        (begin, start), names = states[0], list(self.state.name)
        if joint not in names:
            sys.exit(f'no joint {joint!r}; there are {", ".join(names)}')
        index = names.index(joint)
        self.wait_for(self.command.get_subscription_count, 'reader of joint_command')
        self.command.publish(JointState(name=[joint], position=[float(start[index] + turn)]))
        self.command.wait_for_all_acked(Duration(seconds=self.timeout))
        while states[-1][0] < begin + DURATION:
            states.append(self.state_after(self.step))
        times, angles = map(np.array, zip(*states, strict=True))
        return 1e-9 * (times - begin), angles[:, index], angles


def main():
    """Measure twice, compare, draw."""
    parser = argparse.ArgumentParser(description='step response of one joint in lock-step')
    parser.add_argument('--joint', default='joint_10_yaw')
    parser.add_argument('--angle', type=float, default=10.0, help='size of the step [degrees]')
    parser.add_argument('--timeout', type=float, default=10.0, help='longest wait [s]')
    options = parser.parse_args(remove_ros_args()[1:])
    robot = LockStep(options.timeout)
    robot.call(robot.pause, SetBool.Request(data=True))
    try:
        turn = math.radians(options.angle)
        (times, angle, first), (_, _, second) = (
            robot.measure(options.joint, turn) for _ in range(2)
        )
    finally:  # also after Ctrl-C: the robot goes on
        robot.call(robot.pause, SetBool.Request(data=False))

    print('same bits' if first.tobytes() == second.tobytes() else 'the two runs differ')
    turned = np.degrees(angle - angle[0])
    part = turned / turned[-1]
    rise = times[np.argmax(part > 0.9)] - times[np.argmax(part > 0.1)]
    print(f'{options.joint} turned by {turned[-1]:.2f} degrees of {options.angle:g}')
    print(f'rise time {1e3 * rise:.0f} ms, overshoot {100 * (part.max() - 1):.1f} %')
    figure = Figure(layout='constrained')
    axes = figure.subplots()
    axes.plot(times, turned, '.-', label=options.joint)
    axes.axhline(options.angle, color='gray', label='commanded')
    axes.set(xlabel='time [s]', ylabel='turned [degrees]')
    axes.legend()
    figure.savefig('step_response.png')


if __name__ == '__main__':
    # Without the handlers of rclpy the robot can still be told to go on after Ctrl-C. It comes
    # also where a script started this with &, which ignores it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    with suppress(KeyboardInterrupt):
        main()
    rclpy.shutdown()

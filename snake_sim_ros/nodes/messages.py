# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Messages that nodes send: names of joints, stamps, and joint commands in three forms."""

from array import array
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from builtin_interfaces.msg import Duration, Time
import numpy as np
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from snake_sim_ros.scene.parameters import Array

# Who subscribes later still gets the last message.
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
WORLD, ODOM, BASE = 'world', 'odom', 'base_link'  # frames
EPOCH = 1e8  # s; a later stamp is that of a wall clock: simulated time begins at zero


def stamp_from(nanoseconds: int) -> Time:
    """Return a time [ns] as a stamp."""
    sec, nanosec = divmod(nanoseconds, 1_000_000_000)
    return Time(sec=sec, nanosec=nanosec)


def seconds_from(stamp: Time) -> float:
    """Return a stamp as a time [s]."""
    return float(stamp.sec + 1e-9 * stamp.nanosec)


# ---- commands -----------------------------------------------------------------------------------

# Joint commands that are sent, in the three forms that robots take.
#
# - `joint_state`: sensor_msgs/JointState by name with positions and velocities, as `sim` and
#   joint_state_topic_hardware_interface take it;
# - `multi_array`: std_msgs/Float64MultiArray, the positions of all joints in order, as
#   forward_command_controller takes it;
# - `trajectory`: trajectory_msgs/JointTrajectory, the positions one period ahead, as
#   joint_trajectory_controller takes it. It has no velocities, because that controller refuses a
#   trajectory that does not end at rest. Its stamp is 0, which means now, because the controller
#   refuses a stamp that arrives after the point is due.


@dataclass(frozen=True)
class CommandForm:
    """
    One form of joint commands.

    A message is made of joint names, stamp, angle [rad] and rate [rad/s] of shape (axes,), and
    publish period [ns].
    """

    kind: Any  # type of the message
    topic: str
    ahead: int  # how many publish periods ahead of its time a message commands the joints
    message: Callable[[list[str], Time, Array, Array, int], Any]


def command_message(
    names: list[str], stamp: Time, angle: Array, rate: Array, _: int = 0
) -> JointState:
    """Return a joint command for all joints; angle [rad] and rate [rad/s] have shape (axes,)."""
    message = JointState(name=names)
    message.header.stamp = stamp
    message.position = _doubles(angle)
    message.velocity = _doubles(rate)
    return message


def positions_message(
    _names: list[str], _stamp: Time, angle: Array, _rate: Array, _: int
) -> Float64MultiArray:
    """Return the positions of all joints in their order."""
    return Float64MultiArray(data=_doubles(angle))


def trajectory_message(
    names: list[str], _stamp: Time, angle: Array, _rate: Array, period: int
) -> JointTrajectory:
    """Return a trajectory of one point that is due a period [ns] from now."""
    sec, nanosec = divmod(period, 1_000_000_000)
    point = JointTrajectoryPoint(
        positions=_doubles(angle), time_from_start=Duration(sec=sec, nanosec=nanosec)
    )
    return JointTrajectory(joint_names=names, points=[point])


COMMAND_FORMS = {
    'joint_state': CommandForm(JointState, 'joint_command', 0, command_message),
    'multi_array': CommandForm(Float64MultiArray, 'position_commands', 0, positions_message),
    'trajectory': CommandForm(JointTrajectory, 'joint_trajectory', 1, trajectory_message),
}


def _doubles(values: Array) -> 'array[float]':
    return array('d', np.ascontiguousarray(values, dtype=float).tobytes())

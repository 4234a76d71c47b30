# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What cmd_vel says, as a Twist or a TwistStamped, and when it holds."""

import math

from geometry_msgs.msg import Twist, TwistStamped

from snake_sim_ros.gaits.steering import Steering
from snake_sim_ros.nodes.throttled_warnings import ThrottledWarnings


def steering_from(message: Twist, warn: ThrottledWarnings) -> Steering | None:
    """Return what a Twist asks for, or None and a warning if it is not finite."""
    for part in ('linear', 'angular'):
        for axis in ('x', 'y', 'z'):
            value = getattr(getattr(message, part), axis)
            if not math.isfinite(value):
                warn(
                    'not finite',
                    f'cmd_vel: {part}.{axis} must be finite, got {value}; '
                    f'the last good cmd_vel holds',
                )
                return None
    if any((message.linear.y, message.linear.z, message.angular.x, message.angular.y)):
        warn('unused', 'cmd_vel: only linear.x and angular.z steer; the rest is not used')
    return Steering(message.linear.x, message.angular.z)


def time_of(
    message: TwistStamped, now: int, timeout: float, warn: ThrottledWarnings
) -> int | None:
    """
    Return the time from which a TwistStamped counts [ns], or None and a warning if it is late.

    A stamp of zero means now, and so does a stamp in the future, such as any of a wall clock.

    Parameters
    ----------
    message : TwistStamped
    now : int
        Time of the clock [ns].
    timeout : float
        Time for which a cmd_vel holds [s]; 0 is for ever, and then no message is late.
    warn : ThrottledWarnings

    """
    stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
    if stamp == 0 or stamp > now:
        return now
    if 0.0 < timeout < 1e-9 * (now - stamp):
        warn(
            'late',
            f'cmd_vel is late: stamped {1e-9 * stamp:.4f} s, {1e-9 * (now - stamp):.4g} s ago by '
            f'the clock of this node, more than cmd_vel_timeout, {timeout:g} s; it is not used',
        )
        return None
    return stamp

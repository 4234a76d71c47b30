# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A gait that is steered: forward speed by the frequency, turning by the offset of the yaw wave.

A robot that follows its own path with a stride of D meters a cycle moves at ``v = D omega/2 pi``.
An offset psi of all yaw joints bends the path to the curvature ``psi/L``, L the length of a link,
so the robot turns at ``v psi/L``. It turns right for a positive psi if link 1 goes ahead, because
yaw angles count from the head to the tail.

Contacts slip, so neither relation is exact. In simulated lateral undulation (case A) a robot that
is asked for 0.05 to 0.4 m/s straight ahead reaches this speed within 1.2 %. On a path of curvature
1/m it turns 7 % faster and moves 7 % slower than asked, at 2/m 11 % and 29 %; backward it is
within 10 % at 1/m. The stride belongs to the amplitudes and friction that it was measured with. A
sidewinding robot moves at the requested speed, but sideways, and an offset does not turn it.
"""

from dataclasses import dataclass, replace
import math

from snake_sim_ros.gaits.blending import largest_frequency, narrowest_limits
from snake_sim_ros.scene.gait import AXES, Gait, Table
from snake_sim_ros.scene.parameters import Robot

SLOWEST = 1e-6  # below it a wave counts as one that does not move, a cycle of 73 days [rad/s]


@dataclass(frozen=True)
class Steering:
    """The requested motion of a robot."""

    speed: float  # along its path, positive with link 1 ahead [m/s]
    turning: float  # positive to the left, counterclockwise from above [rad/s]

    def gait(self, gait: Gait, robot: Robot, stride: float) -> tuple[Gait, dict[str, str]]:
        """
        Return the gait that moves the robot as requested.

        Both frequencies keep their ratio. If more is requested than the joints can do, the robot
        moves as fast as they allow and keeps the curvature ``turning/speed`` of the path, up to
        the joint limit. A wave that runs from link 1 to the last one pushes link 1 ahead; gaits
        with a positive phase lag run in the other direction for that.

        Parameters
        ----------
        gait : Gait
            Shape of the waves.
        robot : Robot
        stride : float
            Distance that a cycle of the gait moves the robot [m].

        Returns
        -------
        gait : Gait
        remarks : dict
            Kind -> sentence about what cannot be done as requested.

        """
        yaw, pitch = gait.yaw, gait.pitch
        frequencies = yaw.angular_frequency, pitch.angular_frequency
        cycle = next((each for each in frequencies if abs(each) >= SLOWEST), 0.0)
        remarks = self._reasons_to_stop(cycle)
        if gait.table and self.speed != 0.0:
            remarks = {'table': 'cmd_vel: a gait from a table has no frequency to set; it stops'}
        if self.speed == 0.0 or cycle == 0.0 or gait.table:
            return _still(gait), remarks

        largest = abs(cycle) * min(
            largest_frequency(robot, axis, wave.amplitude) / abs(wave.angular_frequency)
            for axis, wave in zip(AXES, (yaw, pitch), strict=True)
            if wave.angular_frequency
        )
        reachable = largest * stride / (2 * math.pi)
        speed = min(max(self.speed, -reachable), reachable)
        if speed != self.speed:
            remarks['speed'] = (
                f'cmd_vel: linear.x {self.speed:.4g} m/s is more than {reachable:.4g} m/s, which '
                f'the stride and the largest frequency, {largest:.4g} rad/s, make; clamped'
            )
        ahead = -1.0 if yaw.phase_lag > 0.0 else 1.0
        scale = ahead * 2 * math.pi * speed / stride / cycle
        least, most, _ = narrowest_limits(robot, 'yaw')
        least, most = least + abs(yaw.amplitude), most - abs(yaw.amplitude)
        wanted = -float(robot.per_link('link_length').mean()) * self.turning / self.speed
        offset = min(max(wanted, least), most)
        if offset != wanted:
            remarks['offset'] = (
                f'cmd_vel: angular.z {self.turning:.4g} rad/s at linear.x {self.speed:.4g} m/s '
                f'needs a yaw offset of {wanted:.4g} rad; clamped to {offset:.4g} rad, the joint '
                f'limit less the amplitude'
            )
        return replace(
            gait,
            yaw=replace(yaw, angular_frequency=scale * yaw.angular_frequency, offset=offset),
            pitch=replace(pitch, angular_frequency=scale * pitch.angular_frequency),
        ), remarks

    def _reasons_to_stop(self, cycle: float) -> dict[str, str]:
        """Return kind -> sentence about why the robot stops, given its angular frequency."""
        remarks: dict[str, str] = {}
        if self.speed == 0.0 and self.turning != 0.0:
            remarks['turning'] = (
                f'cmd_vel: angular.z {self.turning:.4g} rad/s needs a linear.x that is not 0: '
                f'a robot that follows its own path does not turn in place; it stops'
            )
        if self.speed != 0.0 and cycle == 0.0:
            remarks['cycle'] = 'cmd_vel: a gait whose frequencies are 0 does not move; it stops'
        return remarks


def _still(gait: Gait) -> Gait:
    """Return the gait at rest: straight, except for the offset of its pitch."""
    still = {'amplitude': 0.0, 'angular_frequency': 0.0}
    return replace(
        gait,
        yaw=replace(gait.yaw, **still, offset=0.0),
        pitch=replace(gait.pitch, **still),
        table=Table(),
    )

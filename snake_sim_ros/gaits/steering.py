# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A gait that is steered: speed by the frequency, turning by the shape of the waves.

A gait with a stride of D meters a cycle moves the robot at ``v = D omega/2 pi``. In lateral
undulation the robot follows its own path. An offset psi of all yaw joints bends it to the
curvature ``psi/L``, L the length of a link, so the robot turns at ``v psi/L``. It turns right for
a positive psi if link 1 goes ahead, because yaw angles count from the head to the tail.

A sidewinding robot rolls its track over the floor, like a cylinder; where the amplitude is larger
along the body it rolls farther, like a cone: conical sidewinding of Gong, Hatton, Choset, ICRA
2012. A gradient gamma of both waves turns it by ``Theta gamma`` a cycle; of the gait of case C the
turn is known better, see `sidewinding_turns`.

Contacts slip, so neither relation is exact. In simulated lateral undulation (case A) a robot that
is asked for 0.05 to 0.4 m/s straight ahead reaches this speed within 1.2 %. On a path of curvature
1/m it turns 7 % faster and moves 7 % slower than asked, at 2/m 11 % and 29 %; backward it is
within 10 % at 1/m. A stride belongs to the amplitudes and friction that it was measured with.
"""

from dataclasses import dataclass, replace
import math

from snake_sim_ros.gaits.blending import largest_frequency, narrowest_limits
from snake_sim_ros.gaits.sidewinding_turns import gradient_of_turn, is_measured
from snake_sim_ros.scene.gait import AXES, Gait, Table, Wave
from snake_sim_ros.scene.parameters import Friction, Robot

SLOWEST = 1e-6  # below it a wave counts as one that does not move, a cycle of 73 days [rad/s]
STEEPEST = 0.8  # largest gradient of a steered gait
# Of Aiko, measured in case A, and in case C with coefficients of friction from 0.14 to 0.6, where
# the turn is -0.72 to -0.80 rad.
LATERAL, SIDEWAYS, TURN = 0.546, 0.473, -0.78  # [m], [m], [rad] a cycle


@dataclass(frozen=True)
class Stride:
    """What a cycle of a gait does to a robot, with frequencies above 0."""

    length: float  # distance by which it moves the robot [m]
    bearing: float = 0.0  # direction in which it moves, from the heading to the left [rad]
    turn: float = 0.0  # angle by which a gradient of 1 turns it [rad]; 0: an offset turns it
    friction: float = 0.0  # coefficient with which `sidewinding_turns` is known; 0: it is not

    @classmethod
    def of(cls, gait: Gait, friction: Friction) -> 'Stride':
        """
        Return the stride of a gait of Aiko: lateral undulation or sidewinding of cases A and C.

        Waves of both axes at one frequency are sidewinding.
        """
        yaw, pitch = gait.yaw, gait.pitch
        if not (pitch.amplitude and pitch.angular_frequency == yaw.angular_frequency):
            return cls(LATERAL)
        side = math.copysign(1.0, math.sin(pitch.phase - yaw.phase))
        mirrored = replace(gait, pitch=replace(pitch, phase=side * pitch.phase))
        known = math.sqrt(friction.longitudinal * friction.transversal)
        measured = known if is_measured(mirrored) else 0.0
        return cls(SIDEWAYS, side * math.pi / 2, side * TURN, measured)

    def speed(self, gait: Gait) -> float:
        """Return the speed at which a gait moves the robot [m/s]."""
        return self.length * abs(gait.yaw.angular_frequency) / (2 * math.pi)


@dataclass(frozen=True)
class Steering:
    """The requested motion of a robot."""

    speed: float  # along its path, positive with link 1 ahead [m/s]
    turning: float  # positive to the left, counterclockwise from above [rad/s]

    def gait(self, gait: Gait, robot: Robot, stride: Stride) -> tuple[Gait, dict[str, str]]:
        """
        Return the gait that moves the robot as requested.

        Both frequencies keep their ratio. If more is requested than the joints can do, the robot
        moves as fast as they allow and keeps the curvature ``turning/speed`` of the path, up to
        the joint limit. In lateral undulation, a wave that runs from link 1 to the last one pushes
        link 1 ahead; gaits with a positive phase lag run in the other direction for that.

        Parameters
        ----------
        gait : Gait
            Shape of the waves.
        robot : Robot
        stride : Stride
            What a cycle of the gait does.

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

        turn = self._by_gradient if stride.turn else self._by_offset
        yaw, pitch = turn(gait, robot, stride, remarks)
        largest = abs(cycle) * min(
            largest_frequency(robot, axis, wave.largest) / abs(wave.angular_frequency)
            for axis, wave in zip(AXES, (yaw, pitch), strict=True)
            if wave.angular_frequency
        )
        reachable = largest * stride.length / (2 * math.pi)
        speed = min(max(self.speed, -reachable), reachable)
        if speed != self.speed:
            remarks['speed'] = (
                f'cmd_vel: linear.x {self.speed:.4g} m/s is more than {reachable:.4g} m/s, which '
                f'the stride and the largest frequency, {largest:.4g} rad/s, make; clamped'
            )
        ahead = -1.0 if yaw.phase_lag > 0.0 and not stride.turn else 1.0
        scale = ahead * 2 * math.pi * speed / stride.length / cycle
        return replace(
            gait,
            yaw=replace(yaw, angular_frequency=scale * yaw.angular_frequency),
            pitch=replace(pitch, angular_frequency=scale * pitch.angular_frequency),
        ), remarks

    def _by_offset(
        self, gait: Gait, robot: Robot, stride: Stride, remarks: dict[str, str]
    ) -> tuple[Wave, Wave]:
        """Return the waves of a gait whose path bends by the offset of its yaw."""
        least, most, _ = narrowest_limits(robot, 'yaw')
        least, most = least + gait.yaw.largest, most - gait.yaw.largest
        wanted = -float(robot.per_link('link_length').mean()) * self.turning / self.speed
        offset = min(max(wanted, least), most)
        if offset != wanted:
            remarks['offset'] = (
                f'cmd_vel: angular.z {self.turning:.4g} rad/s at linear.x {self.speed:.4g} m/s '
                f'needs a yaw offset of {wanted:.4g} rad; clamped to {offset:.4g} rad, the joint '
                f'limit less the amplitude'
            )
        return replace(gait.yaw, offset=offset), gait.pitch

    def _by_gradient(
        self, gait: Gait, robot: Robot, stride: Stride, remarks: dict[str, str]
    ) -> tuple[Wave, Wave]:
        """Return the waves of a gait that turns by a gradient, within the limits of the joints."""
        turn = self.turning * stride.length / self.speed  # a cycle
        wanted = turn / stride.turn
        if stride.friction and self.speed > 0.0:
            side = stride.turn / TURN
            wanted = gradient_of_turn(side * turn, self.speed, stride.friction)
        gradient = min(max(wanted, -STEEPEST), STEEPEST)
        if gradient != wanted:
            remarks['gradient'] = (
                f'cmd_vel: angular.z {self.turning:.4g} rad/s at linear.x {self.speed:.4g} m/s '
                f'needs a gradient of {wanted:.4g}; clamped to {gradient:.4g}'
            )
        turned = []
        for axis, wave in zip(AXES, (gait.yaw, gait.pitch), strict=True):
            low, high, _ = narrowest_limits(robot, axis)
            most = min(high - wave.offset, wave.offset - low) / (1.0 + abs(gradient))
            amplitude = min(max(wave.amplitude, -most), most)
            turned.append(replace(wave, amplitude=amplitude, gradient=gradient))
        return turned[0], turned[1]

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

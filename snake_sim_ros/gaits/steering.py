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
from functools import lru_cache
import math
from typing import NamedTuple

import numpy as np

from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.records import entry
from snake_sim_ros.gaits.blending import largest_within, narrowest_limits, Waves
from snake_sim_ros.gaits.sidewinding_turns import GRADIENTS, is_measured, turns_of_gradients
from snake_sim_ros.scene.gait import AXES, Gait, Table, Wave
from snake_sim_ros.scene.parameters import Array, Friction, Robot

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


# ---- compiled -----------------------------------------------------------------------------------


class Steerable(NamedTuple):
    """
    A gait, the robot that it moves, and what a cycle of it does.

    Attributes
    ----------
    waves : Waves
        As they are without steering.
    low, high, rate : ndarray, shape (2,)
        Limits of all yaw and of all pitch joints, see `narrowest_limits` [rad], [rad/s].
    link_length : float
        Mean length of a link [m].
    stride, turn : float
        Length and turn of a `Stride` [m], [rad].
    turns, gradients : ndarray, shape (k,)
        Turns of a gait without a mirror [rad a cycle], rising, and the gradients that make them at
        the speed that is asked for; none if they are not known.

    """

    waves: Waves
    low: Array
    high: Array
    rate: Array
    link_length: float
    stride: float
    turn: float
    turns: Array
    gradients: Array


class Steered(NamedTuple):
    """
    A gait that is steered.

    Attributes
    ----------
    waves : Waves
        Filled.
    wanted : ndarray, shape (1,)
        The offset [rad] or the gradient that the turning rate needs.
    largest : ndarray, shape (1,)
        The largest angular frequency of a cycle [rad/s].

    """

    waves: Waves
    wanted: Array
    largest: Array


frequency_within = compiled(largest_within)


@compiled
def clamped(value: float, low: float, high: float) -> float:
    """Return a value within limits."""
    return min(max(value, low), high)


@compiled
def steer(able: Steerable, speed: float, turning: float, steered: Steered) -> float:
    """
    Fill the gait for a speed [m/s] and a turning rate [rad/s]; see `Steering.gait`.

    It returns the angular frequency of a cycle of the given gait [rad/s]; with 0 the robot stops.
    """
    given, waves = able.waves, steered.waves
    for axis in range(2):
        waves.amplitude[axis] = given.amplitude[axis]
        waves.angular_frequency[axis] = given.angular_frequency[axis]
        waves.phase_lag[axis] = given.phase_lag[axis]
        waves.phase[axis] = given.phase[axis]
        waves.offset[axis] = given.offset[axis]
        waves.gradient[axis] = given.gradient[axis]
    cycle = cycle_of(given)
    if speed == 0.0 or cycle == 0.0:
        # At rest: straight, except for the offset of its pitch.
        for axis in range(2):
            waves.amplitude[axis] = waves.angular_frequency[axis] = 0.0
        waves.offset[0] = 0.0
        return cycle
    if able.turn != 0.0:
        turn_by_gradient(able, speed, turning, steered)
    else:
        reach = abs(given.amplitude[0]) * (1.0 + abs(given.gradient[0]))
        steered.wanted[0] = -able.link_length * turning / speed
        waves.offset[0] = clamped(steered.wanted[0], able.low[0] + reach, able.high[0] - reach)
    share = math.inf
    for axis in range(2):
        omega = abs(waves.angular_frequency[axis])
        if omega > 0.0:
            reach = abs(waves.amplitude[axis]) * (1.0 + abs(waves.gradient[axis]))
            most = frequency_within(able.low[axis], able.high[axis], able.rate[axis], reach)
            share = min(share, most / omega)
    steered.largest[0] = abs(cycle) * share
    reachable = steered.largest[0] * able.stride / (2 * math.pi)
    ahead = -1.0 if given.phase_lag[0] > 0.0 and able.turn == 0.0 else 1.0
    reached = clamped(speed, -reachable, reachable)
    for axis in range(2):
        waves.angular_frequency[axis] *= ahead * 2 * math.pi * reached / able.stride / cycle
    return cycle


@compiled
def cycle_of(waves: Waves) -> float:
    """Return the angular frequency of a cycle, that of the first wave that moves [rad/s]."""
    for axis in range(2):
        if abs(waves.angular_frequency[axis]) >= SLOWEST:
            return float(waves.angular_frequency[axis])
    return 0.0


@compiled
def turn_by_gradient(able: Steerable, speed: float, turning: float, steered: Steered) -> None:
    """Set the gradient of both waves, and amplitudes within the limits of the joints."""
    waves, turn = steered.waves, turning * able.stride / speed  # a cycle
    steered.wanted[0] = turn / able.turn
    if len(able.turns) and speed > 0.0:
        side = able.turn / TURN
        steered.wanted[0] = gradient_of_turn(able, side * turn)
    gradient = clamped(steered.wanted[0], -STEEPEST, STEEPEST)
    for axis in range(2):
        room = min(able.high[axis] - waves.offset[axis], waves.offset[axis] - able.low[axis])
        most = room / (1.0 + abs(gradient))
        waves.amplitude[axis] = clamped(waves.amplitude[axis], -most, most)
        waves.gradient[axis] = gradient


@compiled
def gradient_of_turn(able: Steerable, turn: float) -> float:
    """Return the gradient for a turn [rad a cycle]; beyond the map it goes on as at its ends."""
    turns, gradients, k = able.turns, able.gradients, 0
    while k < len(turns) - 2 and turns[k + 1] < turn:
        k += 1
    share = (turn - turns[k]) / (turns[k + 1] - turns[k])
    return float(gradients[k] + share * (gradients[k + 1] - gradients[k]))


@entry
def steer_gait(able: Steerable, speed: float, turning: float, steered: Steered) -> float:
    """Fill a gait that is steered, see `steer`."""
    return steer(able, speed, turning, steered)


def make_steered(able: Steerable) -> Steered:
    """Return memory for what a gait is steered to."""
    return Steered(able.waves.copied(), np.zeros(1), np.zeros(1))


@lru_cache(maxsize=8)
def steerable(gait: Gait, robot: Robot, stride: Stride, speed: float) -> Steerable:
    """Return what `steer` needs for a gait of a robot, at a speed [m/s] if that counts."""
    limits = np.array([narrowest_limits(robot, axis) for axis in AXES])
    low, high, rate = np.ascontiguousarray(limits.T)
    known = stride.turn and stride.friction and speed > 0.0
    turns = turns_of_gradients(speed, stride.friction)[::-1].copy() if known else np.zeros(0)
    return Steerable(
        waves=Waves.of(gait),
        low=low,
        high=high,
        rate=rate,
        link_length=float(robot.per_link('link_length').mean()),
        stride=float(stride.length),
        turn=float(stride.turn),
        turns=turns,
        gradients=GRADIENTS[::-1].copy() if known else np.zeros(0),
    )


# ---- requested motions --------------------------------------------------------------------------


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
        # The map of turns is that of a speed; others need not be told apart.
        speed = self.speed if stride.friction else 1.0
        able = steerable(gait, robot, stride, speed)
        steered, speed = make_steered(able), 0.0 if gait.table else float(self.speed)
        cycle = steer_gait(able, speed, float(self.turning), steered)
        remarks, moves = self._reasons_to_stop(cycle), speed != 0.0 and cycle != 0.0
        if gait.table and self.speed != 0.0:
            remarks = {'table': 'cmd_vel: a gait from a table has no frequency to set; it stops'}
        waves, wanted = steered.waves, float(steered.wanted[0])
        yaw, pitch = (
            Wave(**{name: float(each[axis]) for name, each in waves._asdict().items()})
            for axis in range(2)
        )
        found = replace(gait, yaw=yaw, pitch=pitch, table=gait.table if moves else Table())
        if not moves:
            return found, remarks
        if stride.turn and found.yaw.gradient != wanted:
            remarks['gradient'] = (
                f'cmd_vel: angular.z {self.turning:.4g} rad/s at linear.x {self.speed:.4g} m/s '
                f'needs a gradient of {wanted:.4g}; clamped to {found.yaw.gradient:.4g}'
            )
        if not stride.turn and found.yaw.offset != wanted:
            remarks['offset'] = (
                f'cmd_vel: angular.z {self.turning:.4g} rad/s at linear.x {self.speed:.4g} m/s '
                f'needs a yaw offset of {wanted:.4g} rad; clamped to {found.yaw.offset:.4g} rad, '
                f'the joint limit less the amplitude'
            )
        largest = float(steered.largest[0])
        reachable = largest * stride.length / (2 * math.pi)
        if abs(self.speed) > reachable:
            remarks['speed'] = (
                f'cmd_vel: linear.x {self.speed:.4g} m/s is more than {reachable:.4g} m/s, which '
                f'the stride and the largest frequency, {largest:.4g} rad/s, make; clamped'
            )
        return found, remarks

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

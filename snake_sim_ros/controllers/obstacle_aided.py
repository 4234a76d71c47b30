# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Obstacle-aided locomotion: a wave that widens until obstacles push the robot forward.

The contact force of each link has a lateral part f_k, positive to the left, in which a force above
a threshold is that of an obstacle, a push point. By it the obstacle pushes the robot forward with
``p_k = f_k sin(psi_k - psi)``, psi_k the direction of link k and psi the mean of all, which the
joint angles give.

1. Push points are found by a wave that widens. Its share x of the way from the wave of the gait to
   the widest one follows ``x' = r (1 - P/P_0)``, P the sum of p_k, filtered over `FILTER`.
2. Push points are used. The body presses against those with p_k > 0, and yields to those with
   p_k < 0, by which it is jammed: ``e' + c (e_i - e_{i-1}) = (d - e)/T``, ``d = -g sum_k sign(p_k)
   n_k f_k``. Vector n_k moves link k alone to the left: by the angles (1, -1, -1, 1) of the joints
   around it. What a joint has turned aside travels along the body with the wave, at c joints a
   second, so that the body follows its head around what was in the way.

Contact forces come from sensors in the links; no torque and no pose is needed.

Sources: Transeth, Leine, Glocker, Pettersen, Liljebaeck, Snake robot obstacle-aided locomotion:
modeling, simulations, and experiments, T-RO 24(1), 2008; Liljeback, Pettersen, Stavdahl, Modelling
and control of obstacle-aided snake robot locomotion based on jam resolution, ICRA 2009, whose
joints at contacts turn so that forward forces grow. Theirs detects a jam and ends it by a mode of
its own; here both are one law.
"""

from dataclasses import replace

import numpy as np

from snake_sim_ros.controllers.controller import check_values, Measured, Reference
from snake_sim_ros.controllers.wide_wave import AMPLITUDE, ENTRY, faded_in, PHASE_LAG, wide
from snake_sim_ros.scene import gait as waves
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.gait import Wave
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.posture import initial_angles

FILTER = 0.5  # of the forward force [s]
DECAY = 0.5  # T, in which joints return to the wave [s]
LARGEST_FORCE = 30.0  # of a link, of which more does not count [N]
LARGEST_TURN = 0.4  # of e [rad]
Y = 1  # of contact wrenches


class ObstacleAided:
    """
    Moves the joints by a wave that looks for push points, and presses against them.

    Parameters
    ----------
    amplitude, phase_lag : float, optional
        Of the widest wave [rad].
    push : float, optional
        Forward force P_0 of all push points at which the wave no longer widens [N].
    growth : float, optional
        Rate r of widening where nothing pushes [1/s].
    press : float, optional
        Angle g by which joints turn against a force, or give way to it [rad/N].
    threshold : float, optional
        Force from which on a link touches an obstacle, above the friction of the floor [N].
    period : float, optional
        Time from one call to the next [s].

    Attributes
    ----------
    share : float
        x, of the way from the wave of the gait to the widest one, at the end of the period.

    """

    sees_poses, sees_contacts = False, True

    def __init__(
        self,
        amplitude: float = AMPLITUDE,
        phase_lag: float = PHASE_LAG,
        push: float = 60.0,
        growth: float = 1.0,
        press: float = 0.01,
        threshold: float = 5.0,
        period: float = 0.05,
    ) -> None:
        positive = {
            'amplitude': amplitude, 'phase_lag': phase_lag, 'push': push, 'growth': growth,
            'period': period,
        }  # fmt: skip
        check_values(positive, lambda value: value > 0.0, 'above 0')
        others = {'press': press, 'threshold': threshold}
        check_values(others, lambda value: value >= 0.0, 'at least 0')
        self.amplitude, self.phase_lag, self.period = amplitude, phase_lag, period
        self.push, self.growth, self.press, self.threshold = push, growth, press, threshold

    def start(self, scene: Scene) -> None:
        """Begin anew, with the wave of a scene."""
        self.robot, yaw = scene.robot, scene.gait.yaw
        self.gait = wide(scene, self.amplitude, self.phase_lag)
        waves_of_yaw = yaw, self.gait.yaw  # narrow and broad
        self._waves = np.array([[wave.amplitude, wave.phase_lag] for wave in waves_of_yaw])
        self._pitch = replace(self.gait, yaw=Wave())
        self._posture, self._fade_in = initial_angles(scene), max(ENTRY, scene.gait.soft_start)
        self._joint = np.arange(len(self._posture))
        self._lateral = lateral_moves(scene.robot.link_count)
        self.share, self._push, self._turned = 0.0, 0.0, np.zeros(len(self._posture))

    def control(self, measured: Measured, time: float) -> Reference:
        """Return the wave of the next period, which widens and turns aside at constant rates."""
        if measured.contact_wrench is None:
            raise ParameterError('the controller needs the contact forces of the links')
        h, begin, aside = self.period, self.share, self._turned
        yaw = self.robot.by_joint(measured.joint_angle, absent=0.0)[:, 0]
        direction = np.append(0.0, np.cumsum(yaw))
        force = measured.contact_wrench[:, Y]
        force = np.where(np.abs(force) > self.threshold, force, 0.0)
        forward = force * np.sin(direction - direction.mean())
        self._push += (forward.sum() - self._push) * h / (h + FILTER)
        share = begin + h * self.growth * (1.0 - self._push / self.push)
        self.share = min(max(share, 0.0), 1.0)

        wave, (narrow, broad) = self.gait.yaw, self._waves
        way = broad - narrow
        signed = np.sign(forward) * np.clip(force, -LARGEST_FORCE, LARGEST_FORCE)
        drive = -self.press * self._lateral @ signed
        before = np.append(0.0, aside[:-1])
        speed = abs(wave.angular_frequency / (narrow[1] or self.phase_lag))
        turned = aside + h * (speed * (before - aside) + (drive - aside) / DECAY)
        self._turned = np.clip(turned, -LARGEST_TURN, LARGEST_TURN)
        slope, turning = (self.share - begin) / h, (self._turned - aside) / h
        low, high, _ = (each[:, 0] for each in self.robot.limits)

        def reference(times: Array) -> tuple[Array, Array]:
            angle, rate = waves.reference(self._pitch, times, len(self._joint))
            age = (times - time)[:, None]
            A, lag = narrow[:, None, None] + (begin + slope * age) * way[:, None, None]
            A_dot, lag_dot = slope * way
            phase = wave.angular_frequency * times[:, None] + wave.phase + lag * self._joint
            omega = wave.angular_frequency + lag_dot * self._joint
            free = A * np.sin(phase) + wave.offset + aside + turning * age
            angle[..., 0] = np.clip(free, low, high)
            moves = A_dot * np.sin(phase) + A * omega * np.cos(phase) + turning
            rate[..., 0] = np.where(free == angle[..., 0], moves, 0.0)
            return angle, rate

        return faded_in(reference, self._posture, self._fade_in)


def lateral_moves(link_count: int) -> Array:
    """Return n_k, angles of the joints that move link k to the left, (n-1, n); ends turn."""
    n = link_count
    moves = np.eye(n - 1, n, 2) - np.eye(n - 1, n, 1) - np.eye(n - 1, n) + np.eye(n - 1, n, -1)
    moves[:, 0] = np.eye(n - 1)[0]
    moves[:, -1] = np.eye(n - 1)[-1]
    return moves

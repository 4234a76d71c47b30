# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A central pattern generator: amplitude-controlled phase oscillators, one for each joint axis.

Oscillator i has a phase theta, an amplitude r, an offset psi and a frequency omega. It is coupled
to its neighbors along the body and, if both waves have one frequency, across the axes:

``theta_i' = omega_i + sum_j w r_j/R sin(theta_j - theta_i - phi_ij)``
``r_i'' = a (a/4 (R_i - r_i) - r_i')``,  ``alpha_i = psi_i + r_i sin theta_i``

Amplitudes R_i, phase differences phi_ij, offsets and frequencies are those of the waves of a gait,
eqs. (70), (71), on which the oscillators converge from whatever state. Offsets, frequencies and
phase differences obey the law of r when the gait changes, so that angles and rates do not jump.

Source: Ijspeert, Crespi, Ryczko, Cabelguen, From swimming to walking with a salamander robot
driven by a spinal cord model, Science 315, 2007. Theirs weighs by r_j in place of r_j/R, R the
largest amplitude of the gait, and its frequencies and phase differences jump.
"""

import math

import numpy as np

from snake_sim_ros.controllers.controller import check_values, Measured, Reference
from snake_sim_ros.gaits.blending import check_limits
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.gait import amplitudes, Gait
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.posture import initial_angles

LONGEST_STEP = 0.02  # of the integration, which then is off by less than 1e-6 rad [s]


class CentralPatternGenerator:
    """
    Moves the joints by coupled oscillators, toward the gait of a scene.

    Parameters
    ----------
    coupling : float, optional
        Weight w of the coupling of neighbors [1/s].
    gain : float, optional
        Gain a: amplitudes, offsets and frequencies converge with exp(-a t/2) [1/s].
    period : float, optional
        Time from one call to the next [s].

    Attributes
    ----------
    gait : Gait
        What the oscillators converge to; `change` sets it.

    """

    sees_poses = False

    def __init__(self, coupling: float = 4.0, gain: float = 8.0, period: float = 0.02) -> None:
        given = {'coupling': coupling, 'gain': gain, 'period': period}
        check_values(given, lambda value: value > 0.0, 'above 0')
        self.coupling, self.gain, self.period = coupling, gain, period

    def start(self, scene: Scene) -> None:
        """Begin anew: at the angles of a scene at its start, with the phases of its gait."""
        self.robot, joints = scene.robot, scene.robot.link_count - 1
        self._state = np.zeros((9, joints, 2))
        self.change(scene.gait)
        self._state[[0, 5, 7]] = self._target[[3, 2, 3]]
        self._state[3] = initial_angles(scene)  # offsets, as amplitudes are 0

    def change(self, gait: Gait) -> None:
        """
        Converge to another gait from now on.

        Raises
        ------
        ParameterError
            If it has a table, or the joints cannot follow it.

        """
        if gait.table:
            raise ParameterError('oscillators have waves, the gait has a table')
        check_limits(gait, self.robot)
        self.gait, joints = gait, self.robot.link_count - 1
        lags = np.arange(joints)
        waves = gait.yaw, gait.pitch
        amplitude = np.stack([amplitudes(wave, joints) for wave in waves], axis=1)
        # A negative amplitude is half a cycle.
        phase = np.stack([wave.phase + lags * wave.phase_lag for wave in waves], axis=1)
        phase += np.where(amplitude < 0.0, math.pi, 0.0)
        offset, frequency = (
            np.broadcast_to([getattr(wave, name) for wave in waves], amplitude.shape)
            for name in ('offset', 'angular_frequency')
        )
        self._target = np.stack([np.abs(amplitude), offset, frequency, phase])
        self._largest = float(np.abs(amplitude).max()) or 1.0
        self._is_one = gait.yaw.angular_frequency == gait.pitch.angular_frequency

    @property
    def phase(self) -> Array:
        """Phases theta of (yaw, pitch) of all joints at the end of the period, (n-1, 2) [rad]."""
        return np.array(self._state[0])

    def control(self, measured: Measured, time: float) -> Reference:
        """Return the angles of the next period."""
        begin, slope = self._state, self._slope(self._state)
        count = math.ceil(self.period / LONGEST_STEP)
        for _ in range(count):
            self._state = self._stepped(self._state, self.period / count)
        return between(time, self.period, (begin, slope), (self._state, self._slope(self._state)))

    def _stepped(self, state: Array, h: float) -> Array:
        """Return the state (9, n-1, 2) after a step of Runge and Kutta of order 4."""
        first = self._slope(state)
        second = self._slope(state + h / 2 * first)
        third = self._slope(state + h / 2 * second)
        last = self._slope(state + h * third)
        return np.asarray(state + h / 6 * (first + 2 * second + 2 * third + last))

    def _slope(self, state: Array) -> Array:
        """Return the derivative of theta, then r, psi, omega, phi and their rates, (9, n-1, 2)."""
        slope, a = np.empty_like(state), self.gain
        off, r = state[0] - state[7], state[1] / self._largest
        pull, ahead = np.zeros(off.shape), np.sin(np.diff(off, axis=0))
        pull[:-1] += r[1:] * ahead
        pull[1:] -= r[:-1] * ahead
        if self._is_one:
            pull += r[:, ::-1] * np.sin(off[:, ::-1] - off)
        slope[0] = state[5] + self.coupling * pull
        for k in (1, 3, 5, 7):
            slope[k] = state[k + 1]
            slope[k + 1] = a * (a / 4 * (self._target[k // 2] - state[k]) - state[k + 1])
        return slope


def between(
    time: float, period: float, begin: tuple[Array, Array], end: tuple[Array, Array]
) -> Reference:
    """
    Return the angles between two states, each with its derivative, shape (9, n-1, 2).

    Phases, amplitudes and offsets are cubic in time: rates are the derivatives of the angles.
    """
    (y0, d0), (y1, d1) = ((value[[0, 1, 3]], slope[[0, 1, 3]]) for value, slope in (begin, end))

    def reference(times: Array) -> tuple[Array, Array]:
        s = ((times - time) / period)[:, None, None, None]
        way = y1 - y0
        value = y0 + s * s * (3 - 2 * s) * way
        value += period * s * (1 - s) * ((1 - s) * d0 - s * d1)
        rate = 6 * s * (1 - s) * way / period
        rate += (1 - s) * (1 - 3 * s) * d0 - s * (2 - 3 * s) * d1
        theta, r, psi = np.moveaxis(value, 1, 0)
        theta_dot, r_dot, psi_dot = np.moveaxis(rate, 1, 0)
        sine, cosine = np.sin(theta), np.cos(theta)
        return psi + r * sine, psi_dot + r_dot * sine + r * theta_dot * cosine

    return reference

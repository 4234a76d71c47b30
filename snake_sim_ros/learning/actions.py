# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What an action of an environment is, and the joint references of the control period it begins.

An action is what references go to, from where they are, at limited rates: stiff joints that jumped
would throw the robot. Its numbers are in physical units here; the environment has them from -1 to
1.
"""

from collections.abc import Callable
import math

import numpy as np

from snake_sim_ros.controllers.controller import going_on, Reference
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array, Scene

WIDEST = math.pi / 2  # of a joint without limits [rad]
FASTEST = 2.0  # rate of an angle at most [rad/s]
RESIDUAL = 0.3  # largest residual of an angle [rad]
TORQUE = 3.0  # largest torque of an axis without a limit [N m]
# Name, least and largest value of the parameters of a gait, and how much they change in a second;
# of its yaw wave, then of its pitch.
YAW = (
    ('amplitude [rad]', 0.0, 1.0, 0.5),
    ('angular frequency [rad/s]', -4.0, 4.0, 4.0),
    ('phase lag [rad]', -1.6, 1.6, 0.8),
    ('offset [rad]', -0.4, 0.4, 0.4),
)
PITCH = (('pitch amplitude [rad]', 0.0, 0.4, 0.2), ('pitch phase [rad]', -math.pi, math.pi, 2.0))


class Actions:
    """
    A kind of action.

    Attributes
    ----------
    labels : tuple of str
        What each number of an action is, with its unit.
    low, high : ndarray, shape (k,)
        Bounds of the numbers.
    state_labels : tuple of str
        What each number of `state` is.

    """

    labels: tuple[str, ...]
    low: Array
    high: Array
    state_labels: tuple[str, ...] = ()

    def start(self, scene: Scene) -> None:
        """Begin an episode."""
        raise NotImplementedError

    def reference(self, action: Array, begin: float, period: float) -> Reference:
        """Take an action at a time [s]; return the joint references of the period after it."""
        raise NotImplementedError

    def state(self) -> Array:
        """Return what an agent cannot measure, but needs to know, of these actions."""
        return np.zeros(0)

    def efforts(self, action: Array) -> Array | None:
        """Return the torques (n-1, 2) that act for the period [N m]; None: those of references."""
        return None


class Angles(Actions):
    """Angles of the joint axes, to which the references go straight."""

    def __init__(self, scene: Scene, places: Array) -> None:
        self.places, self.signs = places, scene.robot.place_signs[places]
        limits = scene.robot.limits_of_axes(places)
        self.low, self.high = np.maximum(limits.low, -WIDEST), np.minimum(limits.high, WIDEST)
        self.rate = np.minimum(limits.rate, FASTEST)
        names = scene.robot.axis_names
        of_place = dict(zip(scene.robot.axis_places.tolist(), names, strict=True))
        self.labels = tuple(f'{of_place[place]} [rad]' for place in places.tolist())

    def start(self, scene: Scene) -> None:
        """Begin at the posture of the scene at time 0."""
        joints = scene.robot.link_count - 1
        self.last = gait.reference(scene.gait, np.zeros(1), joints)[0][0].reshape(-1)

    def reference(self, action: Array, begin: float, period: float) -> Reference:
        """Return straight ways from the last angles to these, within the limits of the rates."""
        first, rate = self.last, np.zeros_like(self.last)
        way = (self.signs * action - first[self.places]) / period
        rate[self.places] = np.clip(way, -self.rate, self.rate)
        self.last = first + period * rate
        return going_on(begin, first.reshape(-1, 2), rate.reshape(-1, 2))


class Residuals(Angles):
    """Angles that are added to those of the gait of the scene."""

    state_labels = ('sine of the gait', 'cosine of the gait')

    def __init__(self, scene: Scene, places: Array) -> None:
        super().__init__(scene, places)
        self.low, self.high = np.full((2, len(places)), RESIDUAL) * [[-1.0], [1.0]]

    def start(self, scene: Scene) -> None:
        """Begin without residuals."""
        self.gait, self.joints, self.now = scene.gait, scene.robot.link_count - 1, 0.0
        self.last = np.zeros(2 * self.joints)

    def reference(self, action: Array, begin: float, period: float) -> Reference:
        """Return the gait and the straight way from the last residuals to these."""
        self.now = begin + period
        added = super().reference(action, begin, period)

        def reference(times: Array) -> tuple[Array, Array]:
            parts = gait.reference(self.gait, times, self.joints), added(times)
            return parts[0][0] + parts[1][0], parts[0][1] + parts[1][1]

        return reference

    def state(self) -> Array:
        """Return sine and cosine of the phase of the yaw wave."""
        phase = self.gait.yaw.angular_frequency * self.now
        return np.array([math.sin(phase), math.cos(phase)])


class GaitParameters(Actions):
    """
    Parameters of the serpenoid curve, eqs. (70), (71), which change at limited rates.

    The phase is the integral of the frequency, so that angles and rates do not jump.
    """

    def __init__(self, scene: Scene, places: Array) -> None:
        wave = scene.gait
        if wave.table or not wave.yaw.amplitude:
            raise ParameterError('actions of a gait need a scene whose gait has a yaw wave')
        self.has_pitch = bool(wave.pitch.amplitude)
        items = (*YAW, *PITCH) if self.has_pitch else YAW
        self.labels = tuple(item[0] for item in items)
        self.low, self.high, self.rate = np.array([item[1:] for item in items]).T
        shares = (f'share of the {label.partition(" [")[0]}' for label in self.labels)
        self.state_labels = ('sine of the phase', 'cosine of the phase', *shares)

    def start(self, scene: Scene) -> None:
        """Begin with the gait of the scene, straight where that fades in."""
        yaw, pitch = scene.gait.yaw, scene.gait.pitch
        lags, share = np.arange(scene.robot.link_count - 1), float(scene.gait.soft_start == 0.0)
        first = share * yaw.amplitude, yaw.angular_frequency, yaw.phase_lag, share * yaw.offset
        more = (share * pitch.amplitude, pitch.phase - yaw.phase) if self.has_pitch else ()
        self.lags, self.phase = lags, yaw.phase
        self.last = np.array([*first, *more])

    def reference(self, action: Array, begin: float, period: float) -> Reference:
        """Return the waves."""
        first, phase_0 = self.last, self.phase
        slope = np.clip((action - first) / period, -self.rate, self.rate)
        self.phase += period * (first[1] + 0.5 * period * slope[1])
        self.last = first + period * slope

        def reference(times: Array) -> tuple[Array, Array]:
            age = (times - begin)[:, None]
            A, omega, lag, offset, *pitch = np.moveaxis(first + age * slope, 1, 0)[..., None]
            phase = phase_0 + age * (first[1] + 0.5 * age * slope[1]) + lag * self.lags
            phase_rate = omega + slope[2] * self.lags
            angle, rate = np.zeros((2, len(times), len(self.lags), 2))
            angle[..., 0] = A * np.sin(phase) + offset
            rate[..., 0] = slope[0] * np.sin(phase) + A * phase_rate * np.cos(phase) + slope[3]
            if self.has_pitch:
                (A, shift), phase_rate = pitch, phase_rate + slope[5]
                angle[..., 1] = A * np.sin(phase + shift)
                rate[..., 1] = slope[4] * np.sin(phase + shift)
                rate[..., 1] += A * phase_rate * np.cos(phase + shift)
            return angle, rate

        return reference

    def state(self) -> Array:
        """Return the phase of the first yaw joint, and where parameters are in their ranges."""
        share = (2.0 * self.last - self.high - self.low) / (self.high - self.low)
        return np.array([math.sin(self.phase), math.cos(self.phase), *share])


class Torques(Angles):
    """Torques of the joint axes, which have no other: `environment.SnakeEnv` sets gains to 0."""

    def __init__(self, scene: Scene, places: Array) -> None:
        super().__init__(scene, places)
        self.labels = tuple(label.replace('[rad]', '[N m]') for label in self.labels)
        limits = scene.robot.per_joint('torque_limit').reshape(-1)[places]
        limits = np.where(np.isinf(limits), TORQUE, limits)
        self.low, self.high = -limits, limits

    def reference(self, action: Array, begin: float, period: float) -> Reference:
        """Return angles of 0, which act on nothing."""
        still = np.zeros((len(self.last) // 2, 2))
        return going_on(begin, still, still)

    def efforts(self, action: Array) -> Array | None:
        """Return the torques."""
        effort = np.zeros_like(self.last)
        effort[self.places] = self.signs * action
        return np.asarray(effort.reshape(-1, 2))


KINDS: dict[str, Callable[[Scene, Array], Actions]] = {
    'angles': Angles, 'residual': Residuals, 'gait': GaitParameters, 'torques': Torques,
}  # fmt: skip

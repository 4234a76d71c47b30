# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What an action of an environment is, and the joint references of the control period it begins.

An action is what references go to, from where they are, at limited rates: stiff joints that jumped
would throw the robot. Its numbers are in physical units here; the environment has them from -1 to
1. Actions are those of several robots, each with an episode of its own; arrays have a row for
each.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
import math

import numpy as np

from snake_sim_ros.controllers.controller import Reference
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array, Scene

# Angles and rates (count, m, n-1, 2) [rad], [rad/s] at m times of each robot, (count, m) [s].
References = Callable[[Array], tuple[Array, Array]]
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


class Actions(ABC):
    """
    A kind of action.

    Parameters
    ----------
    scene : Scene
    places : ndarray of int, shape (axes,)
        Which of the joint axes act, counted along the robot, yaw before pitch.
    count : int
        Number of the robots.

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

    @abstractmethod
    def start(self, row: int, scene: Scene) -> None:
        """Begin an episode of one robot."""

    @abstractmethod
    def references(self, action: Array, begin: Array, period: float) -> References:
        """Take actions (count, k) at times (count,) [s]; return references of the period after."""

    @abstractmethod
    def state(self) -> Array:
        """Return what agents cannot measure, but need to know, of these actions, (count, s)."""

    def efforts(self, action: Array) -> Array | None:
        """Return torques (count, n-1, 2) that act for the period [N m]; None: those of joints."""
        return None


class Angles(Actions):
    """Angles of the joint axes, to which the references go straight."""

    def __init__(self, scene: Scene, places: Array, count: int) -> None:
        self.places, self.signs = places, scene.robot.place_signs[places]
        limits = scene.robot.limits_of_axes(places)
        self.low, self.high = np.maximum(limits.low, -WIDEST), np.minimum(limits.high, WIDEST)
        self.rate = np.minimum(limits.rate, FASTEST)
        names = scene.robot.axis_names
        of_place = dict(zip(scene.robot.axis_places.tolist(), names, strict=True))
        self.labels = tuple(f'{of_place[place]} [rad]' for place in places.tolist())
        self.last = np.zeros((count, 2 * (scene.robot.link_count - 1)))

    def start(self, row: int, scene: Scene) -> None:
        """Begin at the posture of the scene at time 0."""
        joints = scene.robot.link_count - 1
        self.last[row] = gait.reference(scene.gait, np.zeros(1), joints)[0][0].reshape(-1)

    def references(self, action: Array, begin: Array, period: float) -> References:
        """Return straight ways from the last angles to these, within the limits of the rates."""
        first, rate = self.last, np.zeros_like(self.last)
        way = (self.signs * action - first[:, self.places]) / period
        rate[:, self.places] = np.clip(way, -self.rate, self.rate)
        self.last = first + period * rate
        shape = len(first), 1, -1, 2
        angle, rate = first.reshape(shape), rate.reshape(shape)

        def references(times: Array) -> tuple[Array, Array]:
            age = (times - begin[:, None])[..., None, None]
            return angle + age * rate, np.repeat(rate, times.shape[1], axis=1)

        return references

    def state(self) -> Array:
        """Return nothing: the angles are measured."""
        return np.zeros((len(self.last), 0))


class Residuals(Angles):
    """
    Angles that are added to those of the gait of the scene, or of its controller.

    Attributes
    ----------
    leads : list
        References of the controller of each robot for the next period; None: the gait.

    """

    state_labels = ('sine of the gait', 'cosine of the gait')

    def __init__(self, scene: Scene, places: Array, count: int) -> None:
        super().__init__(scene, places, count)
        self.low, self.high = np.full((2, len(places)), RESIDUAL) * [[-1.0], [1.0]]
        self.gait, self.now = scene.gait, np.zeros(count)
        self.leads: list[Reference | None] = [None] * count

    def start(self, row: int, scene: Scene) -> None:
        """Begin without residuals."""
        self.gait, self.now[row], self.last[row] = scene.gait, 0.0, 0.0
        self.leads[row] = None

    def references(self, action: Array, begin: Array, period: float) -> References:
        """Return what leads and the straight ways from the last residuals to these."""
        self.now = begin + period
        added, joints = super().references(action, begin, period), self.last.shape[1] // 2

        def references(times: Array) -> tuple[Array, Array]:
            angle, rate = gait.reference(self.gait, times, joints)
            for row, lead in enumerate(self.leads):
                if lead:
                    angle[row], rate[row] = lead(times[row])
            parts = added(times)
            return angle + parts[0], rate + parts[1]

        return references

    def state(self) -> Array:
        """Return sine and cosine of the phase of the yaw wave."""
        phase = self.gait.yaw.angular_frequency * self.now
        return np.stack([np.sin(phase), np.cos(phase)], axis=-1)


class GaitParameters(Actions):
    """
    Parameters of the serpenoid curve, eqs. (70), (71), which change at limited rates.

    The phase is the integral of the frequency, so that angles and rates do not jump.
    """

    def __init__(self, scene: Scene, places: Array, count: int) -> None:
        wave = scene.gait
        if wave.table or not wave.yaw.amplitude:
            raise ParameterError('actions of a gait need a scene whose gait has a yaw wave')
        self.has_pitch = bool(wave.pitch.amplitude)
        items = (*YAW, *PITCH) if self.has_pitch else YAW
        self.labels = tuple(item[0] for item in items)
        self.low, self.high, self.rate = np.array([item[1:] for item in items]).T
        shares = (f'share of the {label.partition(" [")[0]}' for label in self.labels)
        self.state_labels = ('sine of the phase', 'cosine of the phase', *shares)
        self.lags = np.arange(scene.robot.link_count - 1)
        self.phase, self.last = np.zeros(count), np.zeros((count, len(items)))

    def start(self, row: int, scene: Scene) -> None:
        """Begin with the gait of the scene, straight where that fades in."""
        yaw, pitch = scene.gait.yaw, scene.gait.pitch
        share = float(scene.gait.soft_start == 0.0)
        first = share * yaw.amplitude, yaw.angular_frequency, yaw.phase_lag, share * yaw.offset
        more = (share * pitch.amplitude, pitch.phase - yaw.phase) if self.has_pitch else ()
        self.phase[row], self.last[row] = yaw.phase, [*first, *more]

    def references(self, action: Array, begin: Array, period: float) -> References:
        """Return the waves."""
        first, phase_0 = self.last, self.phase
        slope = np.clip((action - first) / period, -self.rate, self.rate)
        self.phase = phase_0 + period * (first[:, 1] + 0.5 * period * slope[:, 1])
        self.last = first + period * slope

        def references(times: Array) -> tuple[Array, Array]:
            age = (times - begin[:, None])[..., None]
            now = np.moveaxis(first[:, None] + age * slope[:, None], -1, 0)[..., None]
            A, omega, lag, offset, *pitch = now
            rates = slope.T[..., None, None]
            turned = age * (first[:, 1, None, None] + 0.5 * age * rates[1])
            phase = phase_0[:, None, None] + turned + lag * self.lags
            phase_rate, sine = omega + rates[2] * self.lags, np.sin(phase)
            angle, rate = np.zeros((2, *phase.shape, 2))
            angle[..., 0] = A * sine + offset
            rate[..., 0] = rates[0] * sine + A * phase_rate * np.cos(phase) + rates[3]
            if self.has_pitch:
                (A, shift), phase_rate = pitch, phase_rate + rates[5]
                sine = np.sin(phase + shift)
                angle[..., 1] = A * sine
                rate[..., 1] = rates[4] * sine + A * phase_rate * np.cos(phase + shift)
            return angle, rate

        return references

    def state(self) -> Array:
        """Return the phase of the first yaw joint, and where parameters are in their ranges."""
        share = (2.0 * self.last - self.high - self.low) / (self.high - self.low)
        return np.column_stack([np.sin(self.phase), np.cos(self.phase), share])


class Torques(Angles):
    """Torques of the joint axes, which have no other: `snakes.Snakes` sets gains to 0."""

    def __init__(self, scene: Scene, places: Array, count: int) -> None:
        super().__init__(scene, places, count)
        self.labels = tuple(label.replace('[rad]', '[N m]') for label in self.labels)
        limits = scene.robot.per_joint('torque_limit').reshape(-1)[places]
        limits = np.where(np.isinf(limits), TORQUE, limits)
        self.low, self.high = -limits, limits

    def references(self, action: Array, begin: Array, period: float) -> References:
        """Return angles of 0, which act on nothing."""

        def references(times: Array) -> tuple[Array, Array]:
            still = np.zeros((*times.shape, self.last.shape[1] // 2, 2))
            return still, still

        return references

    def efforts(self, action: Array) -> Array | None:
        """Return the torques."""
        effort = np.zeros_like(self.last)
        effort[:, self.places] = self.signs * action
        return np.asarray(effort.reshape(len(effort), -1, 2))


KINDS: dict[str, Callable[[Scene, Array, int], Actions]] = {
    'angles': Angles, 'residual': Residuals, 'gait': GaitParameters, 'torques': Torques,
}  # fmt: skip

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Noise of sensors: bits that depend on the seed, the sensor and the number of the sample alone.

Every sensor has a stream of random numbers of its own, so that what one of them is asked for does
not change another one.
"""

import numpy as np

from snake_sim_ros.recording.sensors import Sensors
from snake_sim_ros.scene.parameters import Array

JOINTS, IMU, CONTACTS = range(3)  # kinds of sensors
PORTION = 10_000  # samples that are drawn in one go


class Noise:
    """
    Constant and random errors of one sensor.

    Parameters
    ----------
    seed, sensor : int
        The stream: that of the child `sensor` of the seed, as `SeedSequence.spawn` makes it.
    deviation, bias : ndarray, shape (k,)
        Standard deviations and constant errors of the k numbers of a sample.

    """

    def __init__(self, seed: int, sensor: int, deviation: Array, bias: Array) -> None:
        self._key, self._deviation, self._bias = (seed, sensor), deviation, bias
        self.is_exact = not (deviation.any() or bias.any())
        self._restart()

    def _restart(self) -> None:
        seed, sensor = self._key
        sequence = np.random.SeedSequence(seed, spawn_key=(sensor,))
        self._numbers = np.random.Generator(np.random.PCG64(sequence))
        self._drawn, self._last = 0, np.zeros(len(self._deviation))

    def added(self, value: Array, row: int) -> Array:
        """Return a sample (k,) with its errors; `row` is its number, from 0."""
        if self.is_exact:
            return value
        if self._drawn > row + 1:
            self._restart()
        while self._drawn <= row:
            drawn = self._draw(min(row + 1 - self._drawn, PORTION))
            self._last = drawn[-1]
        return self._with(value, self._last)

    def added_to_all(self, values: Array) -> Array:
        """Return the samples (m, k) from the first one on with their errors."""
        if self.is_exact:
            return values
        self._restart()
        return self._with(values, self._draw(len(values)))

    def _draw(self, count: int) -> Array:
        self._drawn += count
        return self._numbers.standard_normal((count, len(self._deviation)))

    def _with(self, values: Array, drawn: Array) -> Array:
        return np.asarray(values + self._bias + self._deviation * drawn)


def joint_noise(sensors: Sensors, links: int) -> Noise:
    """Return the errors of angles, rates and torques of all joints, one after the other."""
    deviations = (
        sensors.joint_position_noise,
        sensors.joint_velocity_noise,
        sensors.joint_effort_noise,
    )
    return _noise(sensors, 0, JOINTS, np.repeat(deviations, 2 * (links - 1)))


def imu_noise(sensors: Sensors, link: int) -> Noise:
    """Return the errors of angular velocity and specific force at a link, index from 0."""
    deviation = np.repeat([sensors.imu_angular_velocity_noise, sensors.imu_acceleration_noise], 3)
    bias = np.ravel(
        np.stack(
            [
                np.broadcast_to(sensors.imu_angular_velocity_bias, 3),
                np.broadcast_to(sensors.imu_acceleration_bias, 3),
            ]
        )
    )
    return _noise(sensors, link, IMU, deviation, bias)


def contact_noise(sensors: Sensors, link: int) -> Noise:
    """Return the errors of force and torque of the contacts of a link, index from 0."""
    deviation = np.repeat([sensors.contact_force_noise, sensors.contact_torque_noise], 3)
    return _noise(sensors, link, CONTACTS, deviation)


def _noise(
    sensors: Sensors, link: int, kind: int, deviation: Array, bias: Array | None = None
) -> Noise:
    no_bias = np.zeros(len(deviation)) if bias is None else bias
    return Noise(sensors.sensor_seed, 3 * link + kind, np.asarray(deviation, dtype=float), no_bias)

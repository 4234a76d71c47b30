# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Messages of sensors: IMUs, and the forces of contacts on links."""

from geometry_msgs.msg import WrenchStamped
import numpy as np
from sensor_msgs.msg import Imu

from snake_sim_ros.nodes.state_messages import MARK, SerializedMessage
from snake_sim_ros.recording.sensors import (
    ACCELERATION,
    ANGULAR_VELOCITY,
    ORIENTATION,
    SensorReader,
    Sensors,
)
from snake_sim_ros.scene.parameters import Array


class SensorMessages:
    """
    The messages of the sensors of a robot, made once and filled again for every sample.

    A covariance is that of the noise; where there is none it is zero, which means unknown. The
    orientation is exact.

    Parameters
    ----------
    reader : SensorReader
    sensors : Sensors
    frame_prefix : str, optional
        Prefix of the names of frames, which are those of the links.

    Attributes
    ----------
    imus, wrenches : dict
        Topic -> SerializedMessage, in the order of the links that have sensors.

    """

    def __init__(self, reader: SensorReader, sensors: Sensors, frame_prefix: str = '') -> None:
        self._reader = reader
        self.imus: dict[str, SerializedMessage] = {}
        self.wrenches: dict[str, SerializedMessage] = {}
        self._readings: list[tuple[Array, Array, Array]] = []
        self._loads: list[Array] = []
        for link in reader.imu_links:
            message = _imu(sensors, f'{frame_prefix}link_{link + 1}')
            self.imus[f'imu/link_{link + 1}'] = message
            numbers = message.numbers(MARK, 37)
            self._readings.append((numbers[:4], numbers[13:16], numbers[25:28]))
        for link in reader.contact_links:
            wrench = WrenchStamped()
            wrench.header.frame_id, wrench.wrench.force.x = f'{frame_prefix}link_{link + 1}', MARK
            message = SerializedMessage(wrench)
            self.wrenches[f'contact_forces/link_{link + 1}'] = message
            self._loads.append(message.numbers(MARK, 6))

    def fill_imus(self, nanoseconds: int) -> None:
        """Write the readings of the present state of simulated time [ns]."""
        for message in self.imus.values():
            message.stamp[:] = divmod(nanoseconds, 1_000_000_000)
        for reading, parts in zip(self._reader.imus(), self._readings, strict=True):
            places = (ORIENTATION, ANGULAR_VELOCITY, ACCELERATION)
            for part, place in zip(parts, places, strict=True):
                part[:] = reading[place]

    def fill_wrenches(self, nanoseconds: int) -> None:
        """Write the contact forces of the step before simulated time [ns]."""
        for message in self.wrenches.values():
            message.stamp[:] = divmod(nanoseconds, 1_000_000_000)
        for wrench, load in zip(self._reader.wrenches(), self._loads, strict=True):
            load[:] = wrench


def _imu(sensors: Sensors, frame: str) -> SerializedMessage:
    """Return a message with the covariances of the noise."""
    message = Imu()
    message.header.frame_id, message.orientation.x = frame, MARK
    for covariance, deviation in (
        (message.angular_velocity_covariance, sensors.imu_angular_velocity_noise),
        (message.linear_acceleration_covariance, sensors.imu_acceleration_noise),
    ):
        covariance[:] = np.ravel(deviation**2 * np.eye(3))
    return SerializedMessage(message)

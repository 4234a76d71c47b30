# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The topics of the sensors of the node `sim`."""

import time
from typing import Any

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from sensor_msgs.msg import Imu

from snake_sim_ros.nodes.sensor_messages import SensorMessages
from snake_sim_ros.nodes.sim_parameters import Settings
from snake_sim_ros.recording.sensors import SensorReader
from snake_sim_ros.scene.parameters import steps_in
from snake_sim_ros.stepping.simulation import Simulation

LOOK = 0.03  # s of wall time between two looks for readers of contact forces


class SensorPublishers:
    """
    Publishes what the sensors of a robot measure; nothing if it has none.

    Contact forces are computed only while somebody reads them.

    Attributes
    ----------
    reader : SensorReader

    """

    def __init__(
        self, node: Node, simulation: Simulation, settings: Settings, frame_prefix: str
    ) -> None:
        rate = settings.publish_rate
        steps = steps_in(1.0 / rate, simulation.scene.dt, 'publish period')
        self.reader = SensorReader(simulation, settings, steps, rate)
        self._messages = SensorMessages(self.reader, settings, frame_prefix)
        self._imus = _publishers(node, Imu, self._messages.imus)
        self._wrenches = _publishers(node, WrenchStamped, self._messages.wrenches)
        self._read: list[tuple[Any, Any]] = []  # those of `_wrenches` that somebody reads
        self._looked = 0.0  # wall time of the last look for readers [s]

    def publish(self, nanoseconds: int, *, contacts: bool) -> None:
        """
        Publish a sample if one is due.

        Parameters
        ----------
        nanoseconds : int
            Simulated time [ns].
        contacts : bool
            Whether contact forces can be computed, by compiled functions.

        """
        if not (self._imus or self._wrenches) or not self.reader.is_due():
            return
        if self._imus:
            self._messages.fill_imus(nanoseconds)
            for publisher, message in self._imus:
                publisher.publish(bytes(message))
        if self._wrenches and contacts:
            self._look()
            if self._read:
                self._messages.fill_wrenches(nanoseconds)
            for publisher, message in self._read:
                publisher.publish(bytes(message))

    def _look(self) -> None:
        now = time.monotonic()
        if now - self._looked >= LOOK:
            self._looked = now
            self._read = [item for item in self._wrenches if item[0].get_subscription_count()]


def _publishers(node: Node, kind: Any, messages: dict[str, Any]) -> list[tuple[Any, Any]]:
    return [(node.create_publisher(kind, topic, 10), item) for topic, item in messages.items()]

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The topics of sensors in the bag of a run without ROS, as `sim` would publish them."""

from collections.abc import Callable

from geometry_msgs.msg import WrenchStamped
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Imu

from snake_sim_ros.nodes.bag_writer import BagWriter
from snake_sim_ros.nodes.state_messages import SerializedMessage, StateMessages
from snake_sim_ros.nodes.state_publishers import SensorMessages
from snake_sim_ros.recording.sensors import SensorReader, Sensors
from snake_sim_ros.scene.parameters import steps_in
from snake_sim_ros.stepping.simulation import Simulation


class SensorTopics:
    """
    Writes the sensors of a simulation to a bag.

    Parameters
    ----------
    bag : BagWriter
    sensors : Sensors
    rate : float
        States a second [Hz].

    """

    def __init__(self, bag: BagWriter, sensors: Sensors, rate: float) -> None:
        self._bag, self._sensors, self._rate = bag, sensors, rate
        self._reader: SensorReader | None = None  # made at the first state
        self._parts: list[tuple[dict[str, SerializedMessage], Callable[[int], None]]] = []

    def measure(self, simulation: Simulation, nanoseconds: int, states: StateMessages) -> None:
        """Write a sample if one is due at a simulated time [ns]; add noise to joint_states."""
        reader = self._reader or self._begin(simulation)
        reader.add_noise(states.angle, states.rate, states.torque)
        if not reader.is_due():
            return
        for topics, fill in self._parts:
            if topics:
                fill(nanoseconds)
            for topic, message in topics.items():
                self._bag.write(f'/{topic}', nanoseconds, bytes(message))

    def _begin(self, simulation: Simulation) -> SensorReader:
        steps = steps_in(1.0 / self._rate, simulation.scene.dt, 'sampling period')
        self._reader = SensorReader(simulation, self._sensors, steps, self._rate)
        messages = SensorMessages(self._reader, self._sensors)
        self._parts = [
            (messages.imus, messages.fill_imus),
            (messages.wrenches, messages.fill_wrenches),
        ]
        for (topics, _), kind in zip(self._parts, (Imu, WrenchStamped), strict=True):
            for topic in topics:
                self._bag.add_topic(f'/{topic}', kind, QoSProfile(depth=10))
        return self._reader

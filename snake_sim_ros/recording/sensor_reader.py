# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The sensors of a simulation as it advances, sample by sample."""

import numpy as np

from snake_sim_ros.recording.sensor_noise import contact_noise, imu_noise, joint_noise
from snake_sim_ros.recording.sensors import imu_readings, MEASURED, Sensors, wrenches_on_links
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.contact_forces import last_span, sampled_forces
from snake_sim_ros.stepping.simulation import Simulation


class SensorReader:
    """
    Reads the sensors at the states of a simulation, one after the other.

    Parameters
    ----------
    simulation : Simulation
    sensors : Sensors
    steps : int
        Steps from one state to the next.
    rate : float
        States a second [Hz].

    Attributes
    ----------
    imu_links, contact_links : list of int
        Indices of the links with an IMU, and of those whose contact forces are measured.

    Raises
    ------
    ParameterError
        If there is no such link, or the rate of the sensors does not divide that of the states.

    """

    def __init__(self, simulation: Simulation, sensors: Sensors, steps: int, rate: float) -> None:
        n = simulation.scene.robot.link_count
        self.imu_links = sensors.links('imu_links', n)
        self.contact_links = sensors.links('contact_force_links', n)
        self._simulation, self._steps = simulation, steps
        self._steps_in_sample = steps * sensors.states_in_sample(rate)
        self._joints = joint_noise(sensors, n)
        self._imus = [imu_noise(sensors, link) for link in self.imu_links]
        self._contacts = [contact_noise(sensors, link) for link in self.contact_links]
        self.restart()

    def restart(self) -> None:
        """Make the present state the first sample, from which on all noise begins anew."""
        self._begin, self._row = self._simulation.step_count, 0
        self.rest()

    def rest(self) -> None:
        """Take the present velocities as those before, too: the robot was put here."""
        self._before = self._velocity = self._velocities()

    def _velocities(self) -> Array:
        return np.array(self._simulation.state.u[self.imu_links, :3])

    def is_due(self) -> bool:
        """Return whether the present state is a sample of the IMUs and of the contacts."""
        return (self._simulation.step_count - self._begin) % self._steps_in_sample == 0

    def _row_at(self, steps: int) -> int:
        return int(self._simulation.step_count - self._begin) // steps

    def imus(self) -> Array:
        """Return the readings of the IMUs, shape (links, 10), as `sensors.imu_readings` does."""
        simulation, row = self._simulation, self._row_at(self._steps_in_sample)
        if row != self._row:
            self._row, self._before = row, self._velocity
            self._velocity = self._velocities()
        state, time = simulation.state, self._steps_in_sample * simulation.scene.dt
        found = imu_readings(
            simulation.scene.gravity,
            state.q[self.imu_links],
            state.u[self.imu_links],
            self._before,
            time,
        )
        for reading, noise in zip(found, self._imus, strict=True):
            reading[MEASURED] = noise.added(reading[MEASURED], row)
        return found

    def wrenches(self) -> Array:
        """Return the wrenches of the contacts, (links, 6), as `sensors.wrenches_on_links`."""
        simulation, row = self._simulation, self._row_at(self._steps_in_sample)
        scene, state, history = simulation.scene, simulation.state, simulation.history
        span, q = np.array([last_span(scene, history)]), state.q[None]
        contacts = sampled_forces(scene, q, state.u[None], history.impulse[None], span)
        found: Array = wrenches_on_links(scene, q, *contacts)[0, self.contact_links]
        for wrench, noise in zip(found, self._contacts, strict=True):
            wrench[:] = noise.added(wrench, row)
        return found

    def add_noise(self, angle: Array, rate: Array, torque: Array) -> None:
        """Add the noise of the present state to angles, rates and torques of joints (n-1, 2)."""
        if self._joints.is_exact:
            return
        parts = (angle, rate, torque)
        measured = self._joints.added(np.stack(parts).ravel(), self._row_at(self._steps))
        for part, found in zip(parts, measured.reshape(3, *angle.shape), strict=True):
            part[:] = found

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The sensors of a recorded run, as arrays by their names in npz files."""

import numpy as np

from snake_sim_ros.recording.sensor_noise import contact_noise, imu_noise, joint_noise
from snake_sim_ros.recording.sensors import (
    ACCELERATION,
    ANGULAR_VELOCITY,
    imu_readings,
    MEASURED,
    ORIENTATION,
    Sensors,
    wrenches_on_links,
)
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.trajectory import Trajectory


def recorded_sensors(trajectory: Trajectory, sensors: Sensors) -> dict[str, Array]:
    """
    Return what sensors would have measured in a run, as the node `sim` publishes it.

    Parameters
    ----------
    trajectory : Trajectory
        Of `simulation.run`; its samples are the states of the node. In files there are no
        velocities.
    sensors : Sensors

    Returns
    -------
    dict
        ``sensor_time`` (s,) [s] with an entry for each of s samples. If there are IMUs,
        ``imu_link`` (k,) with numbers from 1, ``imu_orientation`` (s, k, 4) x y z w,
        ``imu_angular_velocity`` (s, k, 3) [rad/s] and ``imu_linear_acceleration`` (s, k, 3), the
        specific force [m/s^2]. If contact forces are measured, ``contact_link`` (c,) with numbers
        from 1, and ``contact_wrench`` (s, c, 6) [N], [N m]. If joints have noise,
        ``measured_joint_angle``, ``measured_joint_velocity`` and ``measured_joint_torque``
        (m, n-1, 2), at all m states.

    Raises
    ------
    ParameterError
        If there is no such link, the rate of the sensors does not divide that of the samples, or
        velocities are asked for and not known.

    """
    scene, m = trajectory.scene, len(trajectory.time)
    n = scene.robot.link_count
    imus, touching = sensors.links('imu_links', n), sensors.links('contact_force_links', n)
    steps = round((trajectory.time[1] - trajectory.time[0]) / scene.dt) if m > 1 else 1
    every = sensors.states_in_sample(1.0 / (steps * scene.dt))
    found: dict[str, Array] = {}
    if imus or touching:
        found['sensor_time'] = trajectory.time[::every]
    if imus:
        readings = _imus(trajectory, sensors, imus, every, every * steps * scene.dt)
        found['imu_link'] = np.array(imus) + 1
        found['imu_orientation'] = readings[..., ORIENTATION]
        found['imu_angular_velocity'] = readings[..., ANGULAR_VELOCITY]
        found['imu_linear_acceleration'] = readings[..., ACCELERATION]
    if touching:
        found['contact_link'] = np.array(touching) + 1
        found['contact_wrench'] = _wrenches(trajectory, sensors, touching, every)
    noise = joint_noise(sensors, n)
    if not noise.is_exact:
        names = ('angle', 'velocity', 'torque')
        true = np.stack([getattr(trajectory, f'joint_{name}') for name in names], axis=1)
        measured = noise.added_to_all(true.reshape(m, -1)).reshape(true.shape)
        found |= {f'measured_joint_{name}': measured[:, k] for k, name in enumerate(names)}
    return found


def _imus(
    trajectory: Trajectory, sensors: Sensors, links: list[int], every: int, time: float
) -> Array:
    """Return the readings of all IMUs at every so many states, which are a time [s] apart."""
    if not trajectory.velocity.size:
        raise ParameterError('an IMU needs the velocities of a run, which are not in its file')
    q, u = trajectory.coordinates[::every, links], trajectory.velocity[::every, links]
    before = np.concatenate([u[:1, :, :3], u[:-1, :, :3]])
    readings = imu_readings(trajectory.scene.gravity, q, u, before, time)
    for k, link in enumerate(links):
        exact = readings[:, k, MEASURED]
        readings[:, k, MEASURED] = imu_noise(sensors, link).added_to_all(exact)
    return readings


def _wrenches(trajectory: Trajectory, sensors: Sensors, links: list[int], every: int) -> Array:
    """Return the wrenches of the contacts on links at every so many states."""
    kept = trajectory.every(every)
    if (kept.contact_number < 0).any():
        raise ParameterError('the run does not say which contacts its forces are those of')
    wrenches = wrenches_on_links(
        kept.scene, kept.coordinates, kept.contact_sample, kept.contact_number,
        kept.contact_point, kept.contact_force,
    )[:, links]  # fmt: skip
    for k, link in enumerate(links):
        wrenches[:, k] = contact_noise(sensors, link).added_to_all(wrenches[:, k])
    return wrenches

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recorded runs as a table for spreadsheets and plotting programs."""

from collections.abc import Mapping
import csv
from pathlib import Path
from typing import Any

import numpy as np

from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.whole_files import whole_file
from snake_sim_ros.stepping.trajectory import Trajectory

LOADS = (('force', 'N'), ('torque', 'N m'))
# Arrays of sensors of links, where the numbers of their links are, and what each column is.
OF_LINKS = (
    ('imu_orientation', 'imu_link', [f'imu orientation {axis}' for axis in 'xyzw']),
    ('imu_angular_velocity', 'imu_link', [f'imu angular velocity {a} [rad/s]' for a in 'xyz']),
    ('imu_linear_acceleration', 'imu_link', [f'imu acceleration {a} [m/s^2]' for a in 'xyz']),
    (
        'contact_wrench',
        'contact_link',
        [
            *(f'contact force {a} [N]' for a in 'xyz'),
            *(f'contact torque {a} [N m]' for a in 'xyz'),
        ],
    ),
)


def write(trajectory: Trajectory, path: Path, sensors: Mapping[str, Array] | None = None) -> None:
    """
    Write a row for each sample: time, links, joints, sum of the contact forces, level, sensors.

    Parameters
    ----------
    trajectory : Trajectory
    path : Path
    sensors : mapping, optional
        As `recorded_sensors` returns them. Cells of samples without a reading are empty.

    """
    m, n, _ = trajectory.position.shape
    links = [f'link_{i + 1}' for i in range(n)]
    joints = [f'joint_{j + 1}_{axis}' for j in range(n - 1) for axis in ('yaw', 'pitch')]
    names = ['time [s]']
    names += [f'{link} {axis} [m]' for link in links for axis in 'xyz']
    names += [f'{link} {part}' for link in links for part in ('e0', 'e1', 'e2', 'e3')]
    for what in ('angle [rad]', 'velocity [rad/s]', 'torque [N m]'):
        names += [f'{joint} {what}' for joint in joints]
    names += [f'contact force {axis} [N]' for axis in 'xyz']
    force = np.zeros((m, 3))
    np.add.at(force, trajectory.contact_sample, trajectory.contact_force)
    columns = [trajectory.position, trajectory.orientation, trajectory.joint_angle]
    columns += [trajectory.joint_velocity, trajectory.joint_torque, force]
    rows = np.column_stack([trajectory.time, *(values.reshape(m, -1) for values in columns)])
    measured = _measured(sensors or {}, trajectory.time, joints)
    with whole_file(path) as part, part.open('w', encoding='utf-8', newline='') as file:
        writer = csv.writer(file)
        writer.writerow([*names, 'level', *measured])
        readings = zip(*measured.values(), strict=True) if measured else iter([()] * m)
        for row, level, more in zip(rows, trajectory.level, readings, strict=True):
            writer.writerow([*row.tolist(), level, *more])


def _measured(
    sensors: Mapping[str, Array], time: Array, joints: list[str]
) -> dict[str, list[Any]]:
    """Return the columns of sensors by their names; samples without a reading are empty."""
    columns: dict[str, list[Any]] = {}
    rows = np.searchsorted(time, sensors.get('sensor_time', time)).tolist()
    for name, of_links, parts in OF_LINKS:
        for k, link in enumerate(sensors.get(of_links, ())):
            for part, readings in zip(parts, sensors[name][:, k].T.tolist(), strict=True):
                cells = dict(zip(rows, readings, strict=True))
                columns[f'link_{link} {part}'] = [cells.get(i, '') for i in range(len(time))]
    for what, unit in (('angle', 'rad'), ('velocity', 'rad/s'), ('torque', 'N m')):
        measured = sensors.get(f'measured_joint_{what}')
        if measured is not None:
            readings = measured.reshape(len(time), -1).T.tolist()
            names = [f'{joint} measured {what} [{unit}]' for joint in joints]
            columns |= dict(zip(names, readings, strict=True))
    return columns

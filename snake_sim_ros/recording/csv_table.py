"""Recorded runs as a table for spreadsheets and plotting programs."""

import csv
from pathlib import Path

import numpy as np

from snake_sim_ros.stepping.trajectory import Trajectory


def write(trajectory: Trajectory, path: Path) -> None:
    """Write a row for each sample: time, links, joints, sum of the contact forces, level."""
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
    with path.open('w', encoding='utf-8', newline='') as file:
        writer = csv.writer(file)
        writer.writerow([*names, 'level'])
        for row, level in zip(rows, trajectory.level, strict=True):
            writer.writerow([*row.tolist(), level])

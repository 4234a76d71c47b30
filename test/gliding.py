# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A recorded run that is known in closed form: a straight robot that glides."""

import numpy as np

from snake_sim_ros import Report, Robot, Scene
from snake_sim_ros.scene.rotations import FLAT
from snake_sim_ros.stepping.trajectory import Trajectory

RADIUS = 0.0525  # m, of a link of Aiko
START = 7.0  # s


def glide(n=3, samples=51, way=0.3, up=0.0, **scene):
    """Return a straight robot along e_x, head first, that glides along -e_x at 50 samples a s."""
    x = 0.122 * np.arange(n) - np.linspace(0.0, way, samples)[:, None]
    lift = RADIUS + np.broadcast_to(up, x.shape)
    joints = np.zeros((samples, 2 * (n - 1)))
    return Trajectory(
        scene=Scene(robot=Robot(link_count=n), **scene),
        time=START + np.arange(samples) / 50,
        position=np.stack([x, np.zeros(x.shape), lift], axis=-1),
        orientation=np.broadcast_to(FLAT, (samples, n, 4)),
        joint_angle=joints,
        joint_velocity=joints,
        joint_torque=joints,
        contact_sample=np.arange(samples),
        contact_number=np.zeros(samples, dtype=int),
        contact_point=np.stack([x[:, 0], np.zeros(samples), np.zeros(samples)], axis=-1),
        contact_force=np.tile([0.0, 3.0, 5.0], (samples, 1)),
        level=np.full(samples, 'spatial'),
        report=Report(),
        seconds=0.0,
        interrupted=False,
    )

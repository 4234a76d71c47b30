# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What sensors without errors measure: inertial units, and the contact forces of the links.

Vectors are in the frame of their link as messages have it: x along the link toward the next one,
y to the left and z up when the link lies flat. `recording.sensors` adds rates, noise and biases.
"""

from collections.abc import Sequence

import numpy as np

from snake_sim_ros.scene.obstacles import contact_links
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.rotations import B_TO_WIRE, product, rotation_matrices, WIRE_AXES
from snake_sim_ros.stepping.contact_forces import last_forces
from snake_sim_ros.stepping.state import History, State

ORIENTATION, ANGULAR_VELOCITY, ACCELERATION = slice(0, 4), slice(4, 7), slice(7, 10)


def imu_readings(
    gravity: Sequence[float], q: Array, u: Array, before: Array, time: float
) -> Array:
    """
    Return what inertial measurement units measure, without errors.

    The specific force is that of the mean acceleration since the sample before: with it and
    gravity, in the frame of the end, one gets the exact change of velocity. At rest it is 9.81
    m/s^2 upward, in free fall 0.

    Parameters
    ----------
    gravity : sequence of float, shape (3,)
        [m/s^2, frame I]
    q : ndarray, shape (..., 7)
    u : ndarray, shape (..., 6)
        Of links with an IMU at the center, or as `Imus.moves` returns them; see `state.State`.
    before : ndarray, shape (..., 3)
        Velocities at the sample before [m/s, frame I].
    time : float
        Time since then [s].

    Returns
    -------
    ndarray, shape (..., 10)
        Orientation in the world, a quaternion x y z w with w >= 0; angular velocity [rad/s];
        specific force [m/s^2].

    """
    # Only sums and products of single numbers: matrix products round as their sizes let them.
    found = np.empty((*q.shape[:-1], 10))
    turned = product(q[..., 3:], B_TO_WIRE)[..., [1, 2, 3, 0]]
    found[..., ORIENTATION] = np.where(turned[..., 3:] < 0.0, -turned, turned)
    found[..., ANGULAR_VELOCITY] = u[..., 3:][..., WIRE_AXES]
    force = (u[..., :3] - before) / time - np.asarray(gravity)
    found[..., ACCELERATION] = in_link_frames(rotation_matrices(q[..., 3:]), force)
    return found


def in_link_frames(R: Array, vector: Array) -> Array:
    """Return world vectors (..., 3) in the frames of links, whose frames B are R (..., 3, 3)."""
    x, y, z = (vector[..., k, None] for k in range(3))
    return np.asarray((R[..., 0, :] * x + R[..., 1, :] * y + R[..., 2, :] * z)[..., WIRE_AXES])


def turned(R: Array, vector: Array) -> Array:
    """Return R v for matrices (..., 3, 3) and vectors (..., 3), by single products as well."""
    x, y, z = (vector[..., k, None] for k in range(3))
    return np.asarray(R[..., :, 0] * x + R[..., :, 1] * y + R[..., :, 2] * z)


def wrenches_on_links(
    scene: Scene, q: Array, sample: Array, number: Array, points: Array, forces: Array
) -> Array:
    """
    Return the forces and torques of the contacts on the links, in the frames of the links.

    Of two links that touch each other, each feels its force. Rolling friction, a torque without a
    force, is not included.

    Parameters
    ----------
    scene : Scene
    q : ndarray, shape (m, n, 7)
        Coordinates at the samples.
    sample, number, points, forces : ndarray
        Contacts as `contact_forces.sampled_forces` returns them.

    Returns
    -------
    ndarray, shape (m, n, 6)
        Force [N], and torque about the center of the link [N m].

    """
    m, n, _ = q.shape
    force, torque = np.zeros((2, m * n, 3))  # frame I
    links = contact_links(scene)[number] if len(number) else np.zeros((0, 2), dtype=int)
    for side, sign in ((0, 1.0), (1, -1.0)):
        here = links[:, side] >= 0
        row, link, acting = sample[here], links[here, side], sign * forces[here]
        np.add.at(force, row * n + link, acting)
        np.add.at(torque, row * n + link, np.cross(points[here] - q[row, link, :3], acting))
    R = rotation_matrices(q[..., 3:]).reshape(m * n, 3, 3)
    found = np.hstack([in_link_frames(R, force), in_link_frames(R, torque)])
    return found.reshape(m, n, 6)


def contact_wrenches(scene: Scene, state: State, history: History) -> Array:
    """Return the wrenches of the contacts of all links in the last step, (n, 6)."""
    found: Array = wrenches_on_links(scene, state.q[None], *last_forces(scene, state, history))[0]
    return found

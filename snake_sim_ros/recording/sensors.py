# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What sensors on the robot measure: its links, its contacts and its joints.

The node `sim` and recorded runs compute it by the same functions, number by number, so that both
have the same bits. Vectors are in the frame of their link as messages have it: x along the link
toward the next one, y to the left and z up when the link lies flat.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from snake_sim_ros.recording.from_messages import B_TO_WIRE, WIRE_AXES
from snake_sim_ros.scene.checked_records import CheckedRecord, ParameterError, quantity
from snake_sim_ros.scene.obstacles import contact_links
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.quoting import cut, quoted
from snake_sim_ros.scene.rotations import product, rotation_matrices

Links = str | int | tuple[str | int, ...]  # names and numbers of links, or all
ORIENTATION, ANGULAR_VELOCITY, ACCELERATION = slice(0, 4), slice(4, 7), slice(7, 10)
MEASURED = slice(4, 10)  # what an IMU measures with errors
MOST_STATES = 10**15  # from one sample of a sensor to the next


@dataclass(frozen=True, kw_only=True)
class Sensors(CheckedRecord):
    """Which sensors there are, and how well they measure; deviations are those of noise."""

    imu_links: Links = quantity(
        (), '', 'links with an IMU: names such as link_6, numbers from 1, or all'
    )
    contact_force_links: Links = quantity(
        (), '', 'links whose contact forces are measured: names, numbers from 1, or all'
    )
    sensor_rate: float = quantity(
        0.0, 'Hz', 'samples a second of imu and contact_forces; 0 is as often as states', minimum=0
    )
    sensor_seed: int = quantity(
        0, '', 'seed of all noise: the same one gives the same bits', minimum=0, maximum=2**63 - 1
    )
    imu_angular_velocity_noise: float = quantity(
        0.0, 'rad/s', 'standard deviation of a component', minimum=0
    )
    imu_angular_velocity_bias: float | tuple[float, ...] = quantity(
        0.0, 'rad/s', 'constant error: one number for x, y and z, or three'
    )
    imu_acceleration_noise: float = quantity(
        0.0, 'm/s^2', 'standard deviation of a component', minimum=0
    )
    imu_acceleration_bias: float | tuple[float, ...] = quantity(
        0.0, 'm/s^2', 'constant error: one number for x, y and z, or three'
    )
    contact_force_noise: float = quantity(0.0, 'N', 'standard deviation of a component', minimum=0)
    contact_torque_noise: float = quantity(
        0.0, 'N m', 'standard deviation of a component', minimum=0
    )
    joint_position_noise: float = quantity(
        0.0, 'rad', 'standard deviation in joint_states', minimum=0
    )
    joint_velocity_noise: float = quantity(
        0.0, 'rad/s', 'standard deviation in joint_states', minimum=0
    )
    joint_effort_noise: float = quantity(
        0.0, 'N m', 'standard deviation in joint_states', minimum=0
    )

    def __post_init__(self) -> None:
        """Check every field, that links can be such, and that biases have three components."""
        for name in ('imu_links', 'contact_force_links'):
            value = getattr(self, name)
            links = value if isinstance(value, (list, tuple)) else [value]
            if not all(isinstance(link, (str, int)) and link is not True for link in links):
                raise ParameterError(
                    f'{name} must be names or numbers of links, got {quoted(value)}'
                )
        super().__post_init__()
        for name in ('imu_angular_velocity_bias', 'imu_acceleration_bias'):
            value = getattr(self, name)
            if isinstance(value, tuple) and len(value) != 3:
                raise ParameterError(f'{name} must be one number or three, got {len(value)}')

    def links(self, name: str, count: int) -> list[int]:
        """
        Return the indices of links, each once and in order.

        Parameters
        ----------
        name : str
            `imu_links` or `contact_force_links`.
        count : int
            Number of links of the robot.

        Raises
        ------
        ParameterError
            If there is no such link.

        """
        given = getattr(self, name)
        if given == 'all':
            return list(range(count))
        given = given if isinstance(given, tuple) else (given,)
        return sorted({link_index(link, count, name) for link in given})

    def states_in_sample(self, rate: float) -> int:
        """
        Return how many states there are to a sample if there are so many a second [Hz].

        Raises
        ------
        ParameterError
            If the rate of the sensors does not divide that of the states.

        """
        if self.sensor_rate == 0.0:
            return 1
        count = round(min(rate / self.sensor_rate, MOST_STATES))
        if count < 1 or abs(count * self.sensor_rate - rate) > 1e-9 * rate:
            raise ParameterError(
                f'sensor_rate must divide the rate of the states, {rate:g} Hz, or be 0; '
                f'got {self.sensor_rate:g} Hz'
            )
        return count


def link_index(name: str | int, count: int, what: str) -> int:
    """
    Return the index from 0 of a link by its name or by its number from 1.

    Parameters
    ----------
    name : str or int
    count : int
        Number of links.
    what : str
        Where the name comes from, for the error.

    Raises
    ------
    ParameterError
        If there is no such link.

    """
    number = cut(str(name)).removeprefix('link_')
    is_number = number.isascii() and number.isdigit() and len(number) < 10
    if is_number and 1 <= int(number) <= count:
        return int(number) - 1
    raise ParameterError(f'{what}: no link {quoted(name)}; the links are link_1 to link_{count}')


def imu_readings(
    gravity: Sequence[float], q: Array, u: Array, before: Array, time: float
) -> Array:
    """
    Return what inertial measurement units at the centers of links measure, without errors.

    The specific force is that of the mean acceleration since the sample before: with it and
    gravity, in the frame of the end, one gets the exact change of velocity. At rest it is 9.81
    m/s^2 upward, in free fall 0.

    Parameters
    ----------
    gravity : sequence of float, shape (3,)
        [m/s^2, frame I]
    q : ndarray, shape (..., 7)
    u : ndarray, shape (..., 6)
        See `state.State`.
    before : ndarray, shape (..., 3)
        Velocities of the centers at the sample before [m/s, frame I].
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

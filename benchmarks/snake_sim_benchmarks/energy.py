# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Mechanical energy, and the work that changes it: a balance that no method solves for.

In exact arithmetic and without time steps, the energy changes by the work of the joint controllers
and of the contacts, and by nothing else. The remainder is energy that a method loses or creates.

Coordinates q of a link are its center [m, frame I] and unit Euler parameters. Velocities u are
that of the center [m/s, frame I] and the angular velocity [rad/s, frame B].
"""

import math

import numpy as np

from snake_sim_ros.dynamics.force_directions import floor_contact_velocities
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.posture import joint_rates

BALANCE_TIME = 1.0  # the balance of a run covers so much of its start [s]


def mechanical_energy(scene: Scene, q: Array, u: Array) -> Array:
    """
    Return the sum of kinetic and potential energy, eqs. (47), (48), shape (...) [J].

    Coordinates have the shape (..., n, 7), velocities (..., n, 6).
    """
    chain = scene.robot.chain
    potential = -chain.mass * (q[..., :3] @ np.array(scene.gravity))
    momentum = np.einsum('ijk,...ik->...ij', chain.inertia, u[..., 3:])
    kinetic = chain.mass[:, None] * u[..., :3] ** 2 + momentum * u[..., 3:]
    return np.asarray(0.5 * kinetic.sum(axis=(-2, -1)) + potential.sum(axis=-1))


def work_of_steps(
    scene: Scene, q: Array, u: Array, impulse: Array, torque: Array
) -> tuple[Array, Array]:
    """
    Return the work of the contacts and of the joints in every step, shape (m,) each [J].

    The work is that of impulses and torques with the mean velocity of a step. With this velocity
    the balance (75) holds exactly in a step without joints.

    Parameters
    ----------
    scene : Scene
        On a flat floor, without rolling friction.
    q : ndarray, shape (m+1, n, 7)
        Coordinates before the first and after every step.
    u : ndarray, shape (m+1, n, 6)
        Velocities at the same times.
    impulse : ndarray, shape (m, 2n, 3)
        Contact impulses P_N, P_Tx, P_Ty of every step [N s].
    torque : ndarray, shape (m, n-1, 2)
        (yaw, pitch) [N m]

    """
    middle, mean = 0.5 * (q[1:] + q[:-1]), 0.5 * (u[1:] + u[:-1])
    middle[..., 3:] /= np.linalg.norm(middle[..., 3:], axis=-1, keepdims=True)
    gamma = floor_contact_velocities(scene.robot, middle, mean)
    contacts = (impulse * gamma).sum(axis=(1, 2))
    joints = scene.dt * (torque * joint_rates(middle, mean, scene.robot)).sum(axis=(1, 2))
    return contacts, joints


def balance_error(scene: Scene, q: Array, u: Array, impulse: Array, torque: Array) -> float:
    """
    Return the largest energy that steps lost or created, relative to the work of the joints.

    Parameters are those of `work_of_steps`, the result that of `imbalance`.
    """
    contacts, joints = work_of_steps(scene, q, u, impulse, torque)
    return imbalance(mechanical_energy(scene, q, u), contacts, joints)


def imbalance(energy: Array, contacts: Array, joints: Array) -> float:
    """
    Return the largest energy that no work accounts for, relative to the work of the joints.

    The work of the joints is the sum of its magnitudes in all steps. The result is nan if it is 0.

    Parameters
    ----------
    energy : ndarray, shape (m+1,)
        Energy before the first and after every step [J].
    contacts, joints : ndarray, shape (m,)
        Work in every step [J].

    """
    work = np.abs(joints).sum()
    left_over = energy[1:] - energy[0] - np.cumsum(contacts + joints)
    return float(np.abs(left_over).max() / work) if work else math.nan

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Euler parameters, rotation matrices and the kinematic map, section II of the paper.

Euler parameters p = (e0, e1, e2, e3) are unit quaternions, scalar first. Link frames B have e_z
along the link toward the next one. If the link lies flat along e_x of I, e_y points up and e_x to
the left.
"""

import math
from typing import Any

import numpy as np

from snake_sim_ros.scene.parameters import Array

CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])  # of p, times it: the inverse rotation
FLAT = np.array([0.5, 0.5, 0.5, 0.5])  # e_x^B = e_y^I, e_y^B = e_z^I, e_z^B = e_x^I
# Axes of a link in messages: x along it, y to the left and z up if it lies flat (REP 103).
B_TO_WIRE = CONJUGATE * FLAT  # columns e_z, e_x, e_y of B
WIRE_AXES = [2, 0, 1]  # components of a vector in B that are those along x, y, z in messages


def tilde(a: Array) -> Array:
    """Return the skew matrix of a, shape (3,), such that tilde(a) b = a x b."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def cross(a: Array, b: Array) -> Array:
    """Return a x b of two vectors (3,); `np.cross`, for many of them, takes 20 times as long."""
    (a0, a1, a2), (b0, b1, b2) = a.tolist(), b.tolist()
    return np.array([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0])


def H(p: Array) -> Array:
    """Return H = [-e, tilde(e) + e0 I] of Euler parameters (4,), eq. (7), shape (3, 4)."""
    return np.column_stack([-p[1:], tilde(p[1:]) + p[0] * np.eye(3)])


def H_bar(p: Array) -> Array:
    """Return H_bar = [-e, -tilde(e) + e0 I] of Euler parameters (4,), eq. (7), shape (3, 4)."""
    return np.column_stack([-p[1:], -tilde(p[1:]) + p[0] * np.eye(3)])


def rotation_matrix(p: Array) -> Array:
    """Return R^I_B = H H_bar^T of unit Euler parameters (4,), eq. (6), shape (3, 3)."""
    return H(p) @ H_bar(p).T


def rotation_matrices(p: Array) -> Array:
    """Return R^I_B of many unit Euler parameters (..., 4), shape (..., 3, 3)."""
    e0, e1, e2, e3 = p[..., 0], p[..., 1], p[..., 2], p[..., 3]
    e00, e11, e22, e33 = e0 * e0, e1 * e1, e2 * e2, e3 * e3
    e01, e02, e03, e12, e13, e23 = e0 * e1, e0 * e2, e0 * e3, e1 * e2, e1 * e3, e2 * e3
    R = np.empty((*p.shape[:-1], 3, 3))
    R[..., 0, 0], R[..., 0, 1], R[..., 0, 2] = (
        e00 + e11 - e22 - e33, 2 * (e12 - e03), 2 * (e13 + e02)
    )  # fmt: skip
    R[..., 1, 0], R[..., 1, 1], R[..., 1, 2] = (
        2 * (e12 + e03), e00 - e11 + e22 - e33, 2 * (e23 - e01)
    )  # fmt: skip
    R[..., 2, 0], R[..., 2, 1], R[..., 2, 2] = (
        2 * (e13 - e02), 2 * (e23 + e01), e00 - e11 - e22 + e33
    )  # fmt: skip
    return R


def product(a: Array, b: Array) -> Array:
    """Return the Euler parameters a o b of the rotation R(a) R(b), shapes (..., 4)."""
    a, b = a.transpose(-1, *range(a.ndim - 1)), b.transpose(-1, *range(b.ndim - 1))
    return np.stack(product_of_numbers(a, b), axis=-1)


def product_of_numbers(a: Any, b: Any) -> tuple[Any, Any, Any, Any]:
    """Return the same of four numbers each, which takes a twentieth of the time for one turn."""
    (a0, a1, a2, a3), (b0, b1, b2, b3) = a, b
    return (
        a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
        a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
        a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
        a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0,
    )


def along_link(p: Any) -> tuple[Any, Any, Any]:
    """Return e_z^B of Euler parameters as numbers, the last column of `rotation_matrices`."""
    e0, e1, e2, e3 = p
    return (
        2 * (e1 * e3 + e0 * e2),
        2 * (e2 * e3 - e0 * e1),
        e0 * e0 - e1 * e1 - e2 * e2 + e3 * e3,
    )


def about(axis: int, angle: float) -> Array:
    """Return the Euler parameters of a turn by `angle` [rad] about coordinate axis 0, 1 or 2."""
    p = np.zeros(4)
    p[0] = math.cos(angle / 2)
    p[1 + axis] = math.sin(angle / 2)
    return p

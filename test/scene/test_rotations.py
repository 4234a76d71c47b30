# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Euler parameters, rotation matrices and the kinematic map against their definitions."""

import math

import numpy as np
from oracle.moreau import end_coordinates, middle_coordinates
import pytest
from random_states import EPS, random_parameters

from snake_sim_ros import State
from snake_sim_ros.dynamics import kinematics
from snake_sim_ros.scene.rotations import (
    about,
    FLAT,
    H,
    H_bar,
    product,
    rotation_matrices,
    rotation_matrix,
    tilde,
)

pytestmark = pytest.mark.fast

# Entries of the matrices are at most 1 and come from at most a dozen operations on numbers up to 1
# that are themselves rounded, |p|^2 = 1 +- 4 eps: 32 roundings are enough for every product below.
ROUNDING = 32 * EPS
DT = 1 / 4000


@pytest.fixture
def p():
    return random_parameters(np.random.default_rng(1), 200)


def turned(p, omega, time):
    """Return p after turning with constant omega [rad/s, frame B], exactly."""
    speed = np.linalg.norm(omega)
    half = speed * time / 2
    return product(p, np.array([math.cos(half), *(math.sin(half) * omega / speed)]))


def test_tilde_is_the_cross_product():
    rng = np.random.default_rng(2)
    for a, b in rng.uniform(-1, 1, (100, 2, 3)):
        # a x b: two products and one difference of numbers up to 1 in each component.
        assert np.abs(tilde(a) @ b - np.cross(a, b)).max() < 4 * EPS
        assert (tilde(a) == -tilde(a).T).all()


def test_rotation_matrices_are_proper_rotations(p):
    R = rotation_matrices(p)
    assert np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max() < ROUNDING
    # det R = +1 tells a rotation from a reflection.
    assert np.abs(np.linalg.det(R) - 1).max() < ROUNDING


def test_H_products(p):
    for p_i, R_i in zip(p, rotation_matrices(p), strict=True):
        # Eq. (6), R = H H_bar^T, against the entries written out.
        assert np.abs(H(p_i) @ H_bar(p_i).T - R_i).max() < ROUNDING
        assert np.abs(rotation_matrix(p_i) - R_i).max() < ROUNDING
        # The rows of H and of H_bar are orthonormal and orthogonal to p.
        for matrix in (H(p_i), H_bar(p_i)):
            assert np.abs(matrix @ matrix.T - np.eye(3)).max() < ROUNDING
            assert np.abs(matrix @ p_i).max() < ROUNDING


def test_p_and_minus_p_are_the_same_rotation(p):
    # Every entry is a sum of products of two e's: exactly even.
    assert (rotation_matrices(-p) == rotation_matrices(p)).all()


def test_product_composes_rotations(p):
    a, b = p[:100], p[100:]
    expected = rotation_matrices(a) @ rotation_matrices(b)
    assert np.abs(rotation_matrices(product(a, b)) - expected).max() < ROUNDING
    # |a o b| = |a| |b|
    assert np.abs(np.linalg.norm(product(a, b), axis=1) - 1).max() < ROUNDING


def test_product_with_the_conjugate_is_no_rotation(p):
    conjugate = p * [1, -1, -1, -1]
    assert np.abs(product(p, conjugate) - [1, 0, 0, 0]).max() < ROUNDING


@pytest.mark.parametrize('angle', [0.0, 0.3, -1.2, math.pi])
def test_about_turns_right_handed(angle):
    c, s = math.cos(angle), math.sin(angle)
    elementary = [
        [[1, 0, 0], [0, c, -s], [0, s, c]],
        [[c, 0, s], [0, 1, 0], [-s, 0, c]],
        [[c, -s, 0], [s, c, 0], [0, 0, 1]],
    ]
    for axis, R in enumerate(elementary):
        assert np.abs(rotation_matrices(about(axis, angle)) - R).max() < ROUNDING


def test_a_flat_link_points_along_x_with_e_y_up():
    # Columns of R are e_x^B = e_y^I, e_y^B = e_z^I, e_z^B = e_x^I; all products are 1/4: exact.
    assert (rotation_matrices(FLAT) == [[0, 0, 1], [1, 0, 0], [0, 1, 0]]).all()


def test_rotation_matrices_keep_leading_axes(p):
    R = rotation_matrices(p.reshape(4, 50, 4))
    assert R.shape == (4, 50, 3, 3)
    assert (R.reshape(200, 3, 3) == rotation_matrices(p)).all()


def test_kinematic_map(p):
    rng = np.random.default_rng(3)
    h = 1e-5
    for p_i, omega in zip(p, rng.uniform(-3, 3, (200, 3)), strict=True):
        speed = np.linalg.norm(omega)
        ends = turned(p_i, omega, h), turned(p_i, omega, -h)
        p_dot = (ends[0] - ends[1]) / (2 * h)
        # pdot = 1/2 H_bar^T omega. Central difference of cos, sin of |omega| t/2: h^2/6 times the
        # third derivative (|omega|/2)^3, plus the rounding of p, 4 eps, over h.
        bound = h**2 / 6 * (speed / 2) ** 3 + 4 * EPS / h
        assert np.abs(p_dot - H_bar(p_i).T @ omega / 2).max() < bound

        R, (R_later, R_sooner) = rotation_matrix(p_i), rotation_matrices(np.array(ends))
        R_dot = (R_later - R_sooner) / (2 * h)
        # Rdot = R tilde(omega_B) = tilde(omega_I) R, eq. (8); the third derivative is |omega|^3.
        bound = h**2 / 6 * speed**3 + 16 * EPS / h
        assert np.abs(R_dot - R @ tilde(omega)).max() < bound
        assert np.abs(R_dot - tilde(R @ omega) @ R).max() < bound


@pytest.mark.parametrize('speed', [1.0, 30.0, 1000.0])
@pytest.mark.parametrize('length', [1.0, 1.5])
def test_a_step_with_constant_rates_is_a_cayley_map(p, speed, length):
    rng = np.random.default_rng(4)
    omega = rng.standard_normal((200, 3))
    omega *= speed / np.linalg.norm(omega, axis=1)[:, None]
    q = np.hstack([rng.uniform(-1, 1, (200, 3)), length * p])
    u = np.hstack([rng.uniform(-1, 1, (200, 3)), omega])
    q_M = middle_coordinates(State(q, u), DT)
    q_E = end_coordinates(q, q_M, u, u, DT)
    # |p_E| = |p_A| for omega_E = omega_A. Two half steps of a few operations each, and a norm.
    assert np.abs(np.linalg.norm(q_E[:, 3:], axis=1) - length).max() < length * ROUNDING
    # p turns by 2 atan(s |omega|), s = dt/4, in the plane of p and H_bar^T omega, so the link by
    # twice as much about omega: p_E = p_A o (cos a, sin a omega/|omega|).
    a = 2 * math.atan(DT / 4 * speed)
    turn = np.hstack([np.full((200, 1), math.cos(a)), math.sin(a) * omega / speed])
    assert np.abs(q_E[:, 3:] - length * product(p, turn)).max() < length * ROUNDING
    # r_E = r_A + dt v
    assert np.abs(q_E[:, :3] - q[:, :3] - DT * u[:, :3]).max() < 4 * EPS


def test_middle_coordinates_satisfy_their_implicit_equation(p):
    rng = np.random.default_rng(5)
    u = rng.uniform(-30, 30, (200, 6))
    q = np.hstack([rng.uniform(-1, 1, (200, 3)), p])
    q_M = np.empty_like(q)
    kinematics.middle_coordinates(DT, q, u, q_M)
    for p_A, p_M, omega in zip(p, q_M[:, 3:], u[:, 3:], strict=True):
        # Eq. (72): p_M = p_A + dt/2 1/2 H_bar(p_M)^T omega, exact up to rounding.
        assert np.abs(p_M - p_A - DT / 4 * H_bar(p_M).T @ omega).max() < ROUNDING
    # The dense version has the same direction and length 1.
    normalized = q_M[:, 3:] / np.linalg.norm(q_M[:, 3:], axis=1)[:, None]
    dense = middle_coordinates(State(q, u), DT)
    assert np.abs(dense[:, 3:] - normalized).max() < ROUNDING
    assert np.abs(dense[:, :3] - q_M[:, :3]).max() < 4 * EPS

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Sweeps of the articulated-body algorithm against a dense solve, without the compiler."""

from dataclasses import replace

import numpy as np
import pytest
from random_states import EPS, random_chain, random_parameters, random_robot

from snake_sim_ros import Scene
from snake_sim_ros.dynamics.articulated_body import (
    articulated_velocity,
    factor,
    factor_chain,
    solve,
)
from snake_sim_ros.dynamics.kinematics import chain_geometry, make_joint_frames
from snake_sim_ros.scene import posture
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.model import make_workspace


def random_inertia(rng):
    """Return a symmetric positive definite matrix with eigenvalues between 0.1 and 2."""
    Q, _ = np.linalg.qr(rng.standard_normal((6, 6)))
    return Q @ np.diag(rng.uniform(0.1, 2.0, 6)) @ Q.T


@pytest.mark.parametrize('link_count', [1, 2, 3, 5, 6, 11, 20])
def test_sweeps_solve_the_constrained_chain(link_count):
    n, root = link_count, link_count // 2
    for seed in range(8):
        rng = np.random.default_rng([seed, n])
        R = rotation_matrices(random_parameters(rng, n))
        center, axis = np.empty((n, 3)), np.empty((n - 1, 2, 6))
        robot = random_chain(rng, n, two_axes=1.0) if seed % 2 else random_robot(rng, n)
        places, links = robot.chain.places, make_joint_frames(robot.chain.places, R)
        if not places.aligned:
            links.inner[:], links.outer[:] = posture.joint_frames(R, robot)
        chain_geometry(places, R, links, center, axis)
        inertia = np.array([random_inertia(rng) for _ in range(n)])
        if seed >= 4:  # a symmetric part that is positive definite, and any other
            other = rng.uniform(-2, 2, inertia.shape)
            inertia += other - np.swapaxes(other, 1, 2)
        wrench = rng.uniform(-1, 1, (n, 6))
        torque = rng.uniform(-1, 1, (n - 1, 2))
        damping = rng.uniform(0, 0.5, (n - 1, 2, 2)) * (seed % 2)
        damping = damping @ np.swapaxes(damping, 1, 2)
        entries = damping[:, [0, 0, 1], [0, 1, 1]]

        chain = make_workspace(replace(Scene(), robot=robot)).chain._replace(
            axis=axis, damping=entries, inertia=inertia.copy(), wrench=wrench
        )
        rates, twist = np.empty((n - 1, 2)), np.empty((n, 6))
        factor_chain(chain)
        articulated_velocity(chain, torque, rates, twist)

        # One system for the twists V of all links and the impulses of all joints, split into
        # N lambda (a constraint: what S does not span) and S (S^T S)^-1 (torque - D q'):
        # A_i V_i - sum of joint impulses = wrench; N^T (V_outer - V_parent) = 0; with
        # q' = (S^T S)^-1 S^T (V_outer - V_parent).
        K = np.zeros((6 * n + 4 * (n - 1), 6 * n + 4 * (n - 1)))
        known = np.concatenate([wrench.ravel(), np.zeros(4 * (n - 1))])
        for i in range(n):
            K[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = inertia[i]
        for j in range(n - 1):
            outer, parent = (j + 1, j) if j >= root else (j, j + 1)
            difference = np.zeros((6, 6 * n))
            difference[:, 6 * outer : 6 * outer + 6] = np.eye(6)
            difference[:, 6 * parent : 6 * parent + 6] = -np.eye(6)
            S = axis[j].T
            dual = S @ np.linalg.inv(S.T @ S)
            N = np.linalg.svd(S.T)[2][2:].T
            rows = slice(6 * n + 4 * j, 6 * n + 4 * j + 4)
            K[: 6 * n, : 6 * n] += difference.T @ dual @ damping[j] @ dual.T @ difference
            K[: 6 * n, rows] = -difference.T @ N
            K[rows, : 6 * n] = N.T @ difference
            known[: 6 * n] += difference.T @ dual @ torque[j]
        expected = np.linalg.solve(K, known)[: 6 * n].reshape(n, 6)
        # Rounding times size and condition of the system: the bound of Gaussian elimination.
        bound = len(K) * EPS * np.linalg.cond(K) * np.abs(expected).max()
        assert np.abs(twist - expected).max() < bound


@pytest.mark.parametrize('skew', [0.0, 1.0, 30.0])
def test_root_is_solved(skew):
    rng = np.random.default_rng(6)
    for _ in range(20):
        Q, _ = np.linalg.qr(rng.standard_normal((6, 6)))
        eigenvalues = 10 ** rng.uniform(-1, 1, 6)
        other = skew * rng.uniform(-1, 1, (6, 6))
        A = Q @ np.diag(eigenvalues) @ Q.T + other - other.T
        factors, w = A.copy(), rng.uniform(-1, 1, 6)
        factor(factors)
        x = np.array(solve(factors, tuple(w)))
        # Elimination without pivoting: size times rounding in the products of |L| |U|, which a
        # positive definite symmetric part H and the skew part T keep below |H + T^T H^-1 T|.
        growth = np.linalg.norm(A, 2) + np.linalg.norm(other - other.T, 2) ** 2 / eigenvalues.min()
        bound = 6 * 6 * EPS * growth * np.linalg.norm(x) * np.linalg.norm(np.linalg.inv(A), 2)
        assert np.abs(x - np.linalg.solve(A, w)).max() < bound

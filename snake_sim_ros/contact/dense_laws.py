"""
The contact laws of a step solved on a dense Delassus operator in NumPy, for `bdf2_reference`.

Impulses of a contact are scaled with its coefficients of friction, P = (P_N, P_T/mu, P_V/mu_V), so
that the admissible sets are a half line and two discs of radius P_N, section V of the paper.
"""

import math

import numpy as np

from snake_sim_ros.scene.parameters import Array

EPS = float(np.finfo(float).eps)
ROUNDS, SWEEPS, ITERATIONS = 40, 25, 30
# Share of 1/r by which an iteration is compliant about the one before. It changes no solution.
PROXIMAL = 1e-8


def solve_laws(G: Array, c: Array) -> Array:
    """
    Return impulses P (5k,) with ``P = prox_C(P - r (G P + c))`` for all contacts, section V.

    Gauss-Seidel sweeps come near the solution, Newton's method goes on. G is singular where
    friction is not unique; there the iterations are proximal.
    """
    r = 1.0 / np.maximum(np.diag(G).reshape(-1, 5), 1e-3 * np.diag(G).max(initial=1e-300))
    r[:, 1:3], r[:, 3:] = r[:, 1:3].min(1, keepdims=True), r[:, 3:].min(1, keepdims=True)
    P, best, least = np.zeros(len(c)), np.zeros(len(c)), np.inf
    enough = 4 * EPS * np.abs(c).max(initial=0.0)
    for _ in range(ROUNDS if len(c) else 0):
        P = swept(G, c, r, P)
        trial = P
        for _ in range(ITERATIONS):
            x = trial.reshape(-1, 5) - r * (G @ trial + c).reshape(-1, 5)
            change = trial - np.concatenate([prox(row) for row in x])
            error = float(np.abs(change / r.ravel()).max())
            if error < least:
                best, least = trial - change, error
            if not error > enough:
                break
            slope = block_diagonal([prox_slope(row) for row in x])
            J = np.eye(len(c)) - slope @ ((1.0 - PROXIMAL) * np.eye(len(c)) - r.reshape(-1, 1) * G)
            trial = trial - np.linalg.solve(J, change)
        if least <= 1e3 * enough:
            break
    return best


def swept(G: Array, c: Array, r: Array, P: Array) -> Array:
    """Return impulses after some sweeps of projections, one contact after the other."""
    P = P.copy()
    for _ in range(SWEEPS):
        for a in range(len(r)):
            rows = slice(5 * a, 5 * a + 5)
            P[rows] = prox(P[rows] - r[a] / 2 * (G[rows] @ P + c[rows]))
    return P


def prox(x: Array) -> Array:
    """Return the projection of scaled impulses (5,) on a half line and two discs, section V."""
    P = x.copy()
    P[0] = max(0.0, x[0])
    for part in (slice(1, 3), slice(3, 5)):
        length = math.hypot(*x[part])
        if length > P[0]:
            P[part] *= P[0] / length
    return P


def prox_slope(x: Array) -> Array:
    """Return the derivative of `prox` at x, shape (5, 5)."""
    slope = np.zeros((5, 5))
    if x[0] <= 0.0:
        return slope
    slope[0, 0] = 1.0
    for part in (slice(1, 3), slice(3, 5)):
        length = float(np.linalg.norm(x[part]))
        slope[part, part] = np.eye(2)
        if length > x[0]:
            e = x[part] / length
            slope[part, part] = x[0] / length * (np.eye(2) - np.outer(e, e))
            slope[part, 0] = e
    return slope


def block_diagonal(squares: list[Array]) -> Array:
    """Return a matrix with the given squares on its diagonal."""
    size = len(squares[0])
    matrix = np.zeros((size * len(squares), size * len(squares)))
    for a, square in enumerate(squares):
        matrix[size * a : size * a + size, size * a : size * a + size] = square
    return matrix

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The contact laws of a step solved on a dense Delassus operator in NumPy, for `bdf2_reference`.

Impulses of a contact are scaled with its coefficients of friction, P = (P_N, P_T/mu, P_V/mu_V), so
that the admissible sets are a half line and two discs of radius P_N, section V of the paper. Where
friction differs forward and backward, mu is the larger of both coefficients along the link, and
the disc of sliding is flattened on the side of the smaller one, to a `share` of its radius.
"""

from collections.abc import Callable
from functools import cache
from importlib import import_module
import math
from typing import Any

import numpy as np

from snake_sim_ros import Scene
from snake_sim_ros.contact.laws import IMPACT_WEIGHTS, PRESS_SPEED, prox_ellipse, REST_SPEED
from snake_sim_ros.dynamics.compilation import COMPILER, Function
from snake_sim_ros.scene.obstacles import first_peg
from snake_sim_ros.scene.parameters import Array

EPS = float(np.finfo(float).eps)
ROUNDS, SWEEPS, ITERATIONS = 40, 25, 30
# Share of 1/r by which an iteration is compliant about the one before. It changes no solution.
PROXIMAL = 1e-8
TINY = 1e-100  # half axes up to it count as zero
WHOLE = np.ones(2)  # share of the disc on both sides: all of it


@cache
def called_often(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function; a compiled one as Numba calls it, in a third of the time."""
    if isinstance(function, Function):
        return import_module(COMPILER).python_dispatcher_of(function)
    return function


def solve_laws(G: Array, c: Array, share: Array) -> Array:
    """
    Return impulses P (5k,) with ``P = prox_C(P - r (G P + c))`` for all contacts, section V.

    `share`, shape (k, 2), is that of the disc on its sides of negative and of positive x.
    Gauss-Seidel sweeps come near the solution, Newton's method goes on. G is singular where
    friction is not unique; there the iterations are proximal.
    """
    r = 1.0 / np.maximum(np.diag(G).reshape(-1, 5), 1e-3 * np.diag(G).max(initial=1e-300))
    r[:, 1:3], r[:, 3:] = r[:, 1:3].min(1, keepdims=True), r[:, 3:].min(1, keepdims=True)
    P, best, least = np.zeros(len(c)), np.zeros(len(c)), np.inf
    enough = 4 * EPS * np.abs(c).max(initial=0.0)
    for _ in range(ROUNDS if len(c) else 0):
        P = swept(G, c, r, P, share)
        trial = P
        for _ in range(ITERATIONS):
            x = trial.reshape(-1, 5) - r * (G @ trial + c).reshape(-1, 5)
            change = trial - np.concatenate([prox(*row) for row in zip(x, share, strict=True)])
            error = float(np.abs(change / r.ravel()).max())
            if error < least:
                best, least = trial - change, error
            if not error > enough:
                break
            slope = block_diagonal([prox_slope(*row) for row in zip(x, share, strict=True)])
            J = np.eye(len(c)) - slope @ ((1.0 - PROXIMAL) * np.eye(len(c)) - r.reshape(-1, 1) * G)
            trial = trial - np.linalg.solve(J, change)
        if least <= 1e3 * enough:
            break
    return best


def swept(G: Array, c: Array, r: Array, P: Array, share: Array) -> Array:
    """Return impulses after some sweeps of projections, one contact after the other."""
    P = P.copy()
    for _ in range(SWEEPS):
        for a in range(len(r)):
            rows = slice(5 * a, 5 * a + 5)
            P[rows] = prox(P[rows] - r[a] / 2 * (G[rows] @ P + c[rows]), share[a])
    return P


def prox(x: Array, share: Array = WHOLE) -> Array:
    """Return the projection of scaled impulses (5,) on a half line and two discs, section V."""
    P = x.copy()
    P[0] = max(0.0, x[0])
    for part in (slice(1, 3), slice(3, 5)):
        length = math.hypot(*x[part])
        if length > P[0]:
            P[part] *= P[0] / length
    side = share[int(x[1] > 0.0)]
    if side < 1.0:
        P[1:3] = prox_ellipse(x[1], x[2], side * P[0], P[0])
    return P


def prox_slope(x: Array, share: Array = WHOLE) -> Array:
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
    side = share[int(x[1] > 0.0)]
    if side < 1.0:
        slope[1:3, :3] = ellipse_slope(x, side)
    return slope


def ellipse_slope(x: Array, side: float) -> Array:
    """
    Return the derivative of ``prox(x)[1:3]`` by x[:3] where the half axes are (side, 1) x[0].

    The nearest point is ``e = a^2 x/(a^2 + t)``. It moves along the ellipse in proportion to
    ``T = a^2/(a^2 + t)`` less its part along the normal n of the ellipse, and out with the radius.
    """
    slope, radius = np.zeros((2, 3)), x[0]
    e = np.array(prox_ellipse(x[1], x[2], side * radius, radius))
    if np.array_equal(e, x[1:3]):
        slope[:, 1:] = np.eye(2)
        return slope
    if side * radius <= TINY:  # flat: only the other component is free, up to the radius
        slope[1, 2], slope[1, 0] = float(abs(x[2]) <= radius), np.sign(x[2]) * (abs(x[2]) > radius)
        return slope
    square = radius**2 * np.array([side**2, 1.0])
    n = e / square
    t = float((x[1:3] - e) @ n / (n @ n))
    T = square / (square + t)
    push = T * n / float(n @ (T * n))  # how e moves if the ellipse grows
    slope[:, 1:] = np.diag(T) - np.outer(push, T * n)
    slope[:, 0] = (e - slope[:, 1:] @ x[1:3]) / radius  # of degree 1 in x and the radius
    return slope


def block_diagonal(squares: list[Array]) -> Array:
    """Return a matrix with the given squares on its diagonal."""
    size = len(squares[0])
    matrix = np.zeros((size * len(squares), size * len(squares)))
    for a, square in enumerate(squares):
        matrix[size * a : size * a + size, size * a : size * a + size] = square
    return matrix


def prox_half_ellipses(
    x: float, y: float, forward: float, backward: float, b: float
) -> tuple[float, float]:
    """
    Return the nearest point of two half ellipses: Coulomb friction that differs along a line.

    The half axis along x is `forward` where x is negative, against sliding forward, and `backward`
    where x is positive; both halves have the half axis b along y. The set is convex. The nearest
    point lies on the side of x, and is that of the whole ellipse of this side, which is symmetric.
    """
    return called_often(prox_ellipse)(x, y, backward if x > 0.0 else forward, b)


def viscosity(scene: Scene, active: Array, factor: Array, shift: Array | float) -> Array:
    """Return the viscous friction of active contacts along and across, shape (2k,) [N s/m]."""
    floor = scene.friction
    acts = (active < first_peg(scene)) & (shift <= 0.0)
    per_contact = np.array([floor.viscous_longitudinal, floor.viscous_transversal]) / 2
    return np.asarray(np.outer(np.where(acts, factor, 0.0), per_contact).ravel())


def falling(scene: Scene, active: Array, gamma: Array) -> Array:
    """Return friction of active contacts that slide (k, 5) over that at rest, shape (k, 1)."""
    floor, on_ground = scene.friction, active < first_peg(scene)
    share = 1.0 / (1.0 + (np.hypot(gamma[:, 1], gamma[:, 2]) / floor.stribeck_speed) ** 2)
    factor = floor.kinetic_ratio + (1.0 - floor.kinetic_ratio) * share
    return np.where(on_ground, factor, 1.0)[:, None]


def selection_compliance(
    compliance: float, least: float, most: float, press_speed: float = PRESS_SPEED
) -> float:
    """
    Return the compliance of the selection rule in a step [1/kg]; see `apply_selection_rule`.

    Parameters
    ----------
    compliance, least : float
        Compliance of the scene, and the one that it is not reduced below [1/kg].
    most : float
        Largest normal impulse to be expected [N s].
    press_speed : float
        Velocity at which the rule may press a contact into the floor [m/s].

    """
    return min(compliance, max(least, press_speed / most)) if most > 0.0 else compliance


def selection_center(P_N: Array, gamma: Array, weight: float) -> Array:
    """
    Return the normal impulses about which the selection rule is compliant in a step.

    Parameters
    ----------
    P_N : ndarray, shape (m,)
        Last normal impulses [N s].
    gamma : ndarray, shape (m, 3)
        Normal and sliding velocities at the start of the step [m/s].
    weight : float
        Weight of the robot times the step [N s]; one that points upward, below 0, counts as 0.

    Returns
    -------
    ndarray, shape (m,)
        [N s]

    """
    if np.abs(gamma[P_N > 0.0]).max(initial=0.0) > REST_SPEED:
        return np.zeros(len(P_N))
    return np.minimum(P_N, IMPACT_WEIGHTS * max(0.0, weight))

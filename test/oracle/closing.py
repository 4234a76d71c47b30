# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""How gaps are closed by a move of the configuration, as in `closing`, in dense NumPy."""

import math
from typing import NamedTuple

import numpy as np

from oracle.joint_drift import without_drift
from snake_sim_ros import Robot, Scene
from snake_sim_ros.contact.closing import (
    closed_gap,
    FAR,
    GAP_GROWTH,
    left_gap,
    most_closed,
    MOST_MOVES,
    MOST_RELEASES,
)
from snake_sim_ros.dynamics.force_directions import scene_gaps
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.rotations import product


class Closing(NamedTuple):
    """How links move under fictitious normal impulses, at the middle of a step."""

    W_N: Array  # (6n, k) of the active contacts
    W_J: Array  # (6n, 4(n-1))
    M_inv: Array  # (6n, 6n)
    R: Array  # (n, 3, 3) link frames in I
    compliance: float  # [1/kg]
    lever: Array  # (n,) largest distance of the joints of each link from its center [m]
    is_flat: bool  # whether there is nothing but a flat floor

    def moves(self, closes: Array, gap: Array, loaded: Array) -> tuple[Array, Array]:
        """
        Return the moves (n, 3) [m] and turns in I (n, 3) [rad] that close gaps of a mask.

        Contacts that they would pull are left out if they have no load, or if the moves are FAR,
        unless the floor is flat.
        """
        largest = np.abs(gap[closes]).max()
        for _ in range(1 if self.is_flat else MOST_RELEASES + 1):
            move, P = self._move(closes, gap)
            far = goes_far(self.lever, move[:, :3], move[:, 3:], largest)
            pulls = np.zeros_like(closes)
            pulls[closes] = P < 0.0
            closes = closes & ((loaded & ~far) | ~pulls)
        return move[:, :3], np.einsum('ijk,ik->ij', self.R, move[:, 3:])

    def _move(self, closes: Array, gap: Array) -> tuple[Array, Array]:
        """Return the moves (n, 6) that close gaps, and their impulses."""
        response = self.M_inv @ self.W_N[:, closes]
        P_J = np.linalg.solve(self.W_J.T @ self.M_inv @ self.W_J, -self.W_J.T @ response)
        response += self.M_inv @ self.W_J @ P_J
        G = self.W_N[:, closes].T @ response + self.compliance * np.eye(closes.sum())
        P = np.linalg.solve(G, -gap[closes])
        return (response @ P).reshape(-1, 6), P


def goes_far(lever: Array, move: Array, turn: Array, gap: float) -> np.bool_:
    """Return whether moves and turns (n, 3) of links are FAR for the largest gap they close."""
    way = np.linalg.norm(move, axis=1) + lever * np.linalg.norm(turn, axis=1)
    return np.bool_(way.max() > FAR * gap)


def levers(robot: Robot) -> Array:
    """Return the largest distance of the joints of each link from its center, (n,) [m]."""
    places = robot.chain.places
    return np.linalg.norm([places.distal, places.proximal], axis=2).max(axis=0)


def with_closed_gaps(
    scene: Scene, closing: Closing, active: Array, start: tuple[Array, Array], loaded: Array,
    q: Array, furthest: Array,
) -> Array:  # fmt: skip
    """
    Return the coordinates at the end of a step of the paper, without gaps of loaded contacts.

    Parameters
    ----------
    scene : Scene
    closing : Closing
    active : ndarray, shape (k,)
        Numbers of the contacts of the step.
    start : tuple of ndarray, shape (k,)
        Gaps of contacts that are deep at the start, else 0 [m], and normal velocities there [m/s].
    loaded : ndarray, shape (k,)
        Mask of those that carry load. Others are closed if they are inside.
    q : ndarray, shape (n, 7)
    furthest : ndarray, shape (n-1, 2, 2)
        Largest joint angles to either side.

    """
    q, closed = q.copy(), closed_gap(scene.solver.activation_tolerance, scene.dt)
    (start_gap, approach), before, q_before = start, math.inf, q
    most = np.maximum(most_closed(scene.dt), -scene.dt * approach)
    for move_number in range(MOST_MOVES + 1 if closed > 0.0 else 0):
        all_gaps = scene_gaps(scene, q)
        gap = all_gaps[active] - start_gap
        closes = (np.abs(gap) <= most) & ((gap < 0.0) | loaded)
        worst = np.abs(gap[loaded]).max(initial=-all_gaps.min(initial=0.0))
        if worst > GAP_GROWTH * before:
            return q_before
        to_close = np.abs(gap[closes]).max(initial=0.0)
        if move_number == MOST_MOVES or not to_close > left_gap(closed):
            break
        before, q_before = worst, q.copy()
        move, turn = closing.moves(closes, gap, loaded)
        p = np.hstack([np.ones((len(q), 1)), turn / 2])
        q[:, :3] += move
        q[:, 3:] = product(p / np.linalg.norm(p, axis=1, keepdims=True), q[:, 3:])
        q = without_drift(scene.robot, q, scene.drift_correction, furthest)
    return q

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Order among evaluations, and the front of those that none beats in both objectives."""

from collections.abc import Sequence

import numpy as np

from snake_sim_ros.scene.parameters import Array

SHARE_OF_SUM = 0.05  # of the other objective: of two that are as good in one, the better counts


def scalar_losses(losses: Array, feasible: Array, weight: float) -> Array:
    """
    Return one loss for two, so that the least of it is on the front.

    It is that of Chebyshev with a share of the sum: ``max_i(w_i l_i) + SHARE_OF_SUM sum_i l_i``,
    where l_i is 0 at the best and 1 at the worst point of the front.

    Parameters
    ----------
    losses : ndarray, shape (evaluations, 1 or 2)
        Those of one objective are returned as they are.
    feasible : ndarray of bool, shape (evaluations,)
        The others have no influence on the scale.
    weight : float
        That of the first objective, 0 to 1; the second one has the rest.

    """
    if losses.shape[1] == 1 or not feasible.any():
        return losses[:, 0]
    front = losses[front_of(losses, feasible)]
    least, span = front.min(axis=0), np.ptp(front, axis=0)
    scaled = (losses - least) / np.where(span > 0.0, span, 1.0)
    worst = (scaled * np.array([weight, 1.0 - weight])).max(axis=1)
    return np.asarray(worst + SHARE_OF_SUM * scaled.sum(axis=1))


def front_of(losses: Array, feasible: Array) -> list[int]:
    """
    Return which evaluations no other one beats, the best in the first loss first.

    With one loss it is the first of the best ones.

    Parameters
    ----------
    losses : ndarray, shape (evaluations, 1 or 2)
    feasible : ndarray of bool, shape (evaluations,)

    """
    found: list[int] = []
    order = sorted(np.flatnonzero(feasible).tolist(), key=lambda k: (*losses[k], k))
    for k in order[:1] if losses.shape[1] == 1 else order:
        if not found or losses[k, 1] < losses[found[-1], 1]:
            found.append(k)
    return found


def ordered(losses: Sequence[float], excess: Sequence[float]) -> list[tuple[float, float]]:
    """
    Return what sorts evaluations: the feasible ones by their loss, then the others by excess.

    Parameters
    ----------
    losses : sequence of float
    excess : sequence of float
        By how much constraints do not hold; 0 is feasible.

    """
    return [
        (0.0, loss) if over == 0.0 else (1.0, over)
        for loss, over in zip(losses, excess, strict=True)
    ]

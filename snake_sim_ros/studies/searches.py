# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Searches by CMA-ES, the order among evaluations, and the front of those that none beats.

CMA-ES is the evolution strategy that adapts the covariance of its samples. A search sees its
values as shares of their bounds, in the unit cube, and of what they achieve only the order. It has
random numbers of its own: it is the same whatever else happens.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.studies.table import optional

SHARE_OF_SUM = 0.05  # of the other objective: of two that are as good in one, the better counts
SPREAD = 0.2  # standard deviation of the first samples, as a share of the bounds
# A search is ended here; by CMA-ES only if it cannot continue. Ranks have no tolerance.
ENDLESS = {
    'tolfun': 0, 'tolfunhist': 0, 'tolflatfitness': np.inf, 'tolstagnation': np.inf, 'tolx': 0,
    'tolxstagnation': False, 'maxiter': np.inf, 'verbose': -10, 'verb_log': 0, 'seed': np.nan,
}  # fmt: skip


def library() -> Any:
    """Return cma; see `table.optional`."""
    return optional('cma', 'an optimization needs cma')


class Search:
    """
    One search.

    Parameters
    ----------
    start : ndarray, shape (values,)
        The first mean, shares of the bounds.
    seed : sequence of int
    population : int
        Samples of a generation; 0: the usual number for so many values.

    """

    def __init__(self, start: Array, seed: Sequence[int], population: int) -> None:
        # The library needs two values at least: the second one then has no effect.
        self.count = len(start)
        random = np.random.default_rng(seed)
        options: dict[str, Any] = {
            **ENDLESS,
            'bounds': [0.0, 1.0],
            'randn': lambda *shape: random.standard_normal(shape),
        }
        if population:
            options['popsize'] = population
        self.strategy = library().CMAEvolutionStrategy(self._padded(start), SPREAD, options)
        self.asked: list[Array] = []
        self.generation = 0

    def ask(self) -> list[Array]:
        """Return the samples of the next generation, shares of the bounds."""
        self.asked = self.strategy.ask()
        return [shares[: self.count] for shares in self.asked]

    def tell(self, order: Sequence[tuple[float, ...]], better: Array | None = None) -> None:
        """
        Continue from what the samples achieved.

        Parameters
        ----------
        order : sequence of tuple
            What sorts the samples, least first.
        better : ndarray, shape (values,), optional
            Shares of the bounds that are better than all of them, and take the place of the worst.

        """
        places = {key: place for place, key in enumerate(sorted(set(order)))}
        samples, losses = list(self.asked), [float(places[key]) for key in order]
        if better is not None:
            worst = losses.index(max(losses))
            samples[worst], losses[worst] = self._padded(better), -1.0
        self.strategy.tell(samples, losses)
        self.generation += 1

    @property
    def spread(self) -> float:
        """The largest standard deviation of the samples to come, as a share of the bounds."""
        return float(np.max(self.strategy.stds[: self.count]))

    @property
    def is_at_its_end(self) -> bool:
        """Whether numbers are not exact enough to continue."""
        return bool(self.strategy.stop())

    def _padded(self, shares: Array) -> Array:
        return shares if len(shares) > 1 else np.append(shares, 0.5)


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

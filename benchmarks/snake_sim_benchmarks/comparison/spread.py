# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The spread of errors over many runs: no single run, lucky or not, decides."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import bootstrap

from snake_sim_ros.scene.parameters import Array

CONFIDENCE = 0.9  # of the interval of the root mean square
RESAMPLES = 4000
SEED = 17  # of the resamples, so that a table repeats


class Spread(NamedTuple):
    """
    Root mean square, its bootstrap interval, median and 90 % quantile of some errors.

    The interval has the probability CONFIDENCE. With one error it is that error alone.
    """

    rms: float
    low: float
    high: float
    median: float
    quantile: float


def root_mean_square(values: Array, axis: int = -1) -> Array:
    """Return the root of the mean of squares along an axis."""
    return np.asarray(np.sqrt(np.mean(np.square(values), axis=axis)))


def spread(errors: Sequence[float]) -> Spread:
    """
    Return the spread of errors.

    Runs that failed have infinite errors. Then the root mean square is infinite and has no
    interval (nan).
    """
    values = np.asarray(errors, dtype=float)
    rms = float(root_mean_square(values))
    low, high = (np.nan, np.nan) if np.isinf(rms) else (rms, rms)
    if len(values) > 1 and np.isfinite(rms):
        found = bootstrap(
            (values,), root_mean_square, confidence_level=CONFIDENCE, n_resamples=RESAMPLES,
            method='percentile', random_state=np.random.default_rng(SEED),
        )  # fmt: skip
        low, high = found.confidence_interval
    ordered = np.sort(values)
    return Spread(rms, float(low), float(high), _quantile(ordered, 0.5), _quantile(ordered, 0.9))


def _quantile(ordered: Array, share: float) -> float:
    """Return a quantile of ordered values, linear between two of them; infinity stays infinite."""
    place = share * (len(ordered) - 1)
    below, above = int(np.floor(place)), int(np.ceil(place))
    if below == above or np.isinf(ordered[above]):
        return float(ordered[above])
    return float(ordered[below] + (place - below) * (ordered[above] - ordered[below]))

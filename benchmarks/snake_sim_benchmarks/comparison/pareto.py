# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The fastest method for an accuracy, fronts of cost and error, and orders of convergence."""

from collections.abc import Iterable, Sequence
import math

import numpy as np

from snake_sim_benchmarks.comparison.bench_rows import Row
from snake_sim_ros.stepping.methods import METHODS


def is_ours(row: Row) -> bool:
    """Return whether a row is of a method of this package."""
    return row.method in METHODS


def fastest(rows: Iterable[Row], target: float) -> Row | None:
    """Return the run with the least wall time whose path error is at most `target`."""
    good = [row for row in rows if row.error_path <= target and row.seconds_per_second > 0.0]
    return min(good, key=lambda row: row.seconds_per_second, default=None)


def fitted_order(rows: Sequence[Row]) -> float:
    """
    Return the order of convergence: the power of dt that the errors of the time step follow.

    Only errors between ten times that of the reference and 0.1 are used. It is nan if there are
    fewer than three.
    """
    points = [
        (row.dt, row.error_limit)
        for row in rows
        if 0.0 < row.error_limit < 0.1 and not row.error_limit < 10 * row.reference_error
    ]
    if len(points) < 3:
        return math.nan
    dt, error = zip(*points, strict=True)
    return fitted_power(dt, error)


def fitted_power(x: Sequence[float], y: Sequence[float]) -> float:
    """Return the exponent of the power law that fits y over x best on logarithmic scales."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def front(points: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """
    Return the (cost, error) that nobody beats in both, cheapest first.

    Points without a cost or an error, or with one that is not finite, are left out.
    """
    found: list[tuple[float, float]] = []
    for cost, error in sorted(points):
        known = 0.0 < cost < math.inf and 0.0 < error < math.inf
        if known and (not found or error < found[-1][1]):
            found.append((cost, error))
    return found


def cost_at(points: Iterable[tuple[float, float]], error: float) -> float:
    """
    Return the cost of an error on the front of some points (cost, error).

    Between two points it is interpolated with logarithms of both. For an error above that of the
    cheapest point it is the cost of that point, and nan below the least error of all.
    """
    best = front(points)
    if not best or error < best[-1][1]:
        return math.nan
    costs, errors = np.log(best).T
    return float(np.exp(np.interp(-math.log(error), -errors, costs)))

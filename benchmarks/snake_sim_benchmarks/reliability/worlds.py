# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Random worlds: solids of all kinds, on which robots are dropped and driven, judged as in `physics`.

A world has one to ten boxes, stairs, ramps, poles, pipes, height fields, egg crates and meshes in
any place, also in each other and flush with each other.
"""

from collections.abc import Iterator

from snake_sim_benchmarks.reliability.physics import attack, METHODS
from snake_sim_benchmarks.reliability.random_scenes import WORLDS
from snake_sim_benchmarks.reliability.trials import Trial


def trials(seconds: float, seed: int) -> Iterator[Trial]:
    """Attack worlds with each method for its share of the time."""
    for number, method in enumerate(METHODS):
        yield attack('worlds', (WORLDS, method), seconds / len(METHODS), (seed, number))

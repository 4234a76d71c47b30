# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The key of a row: a digest of all that its result depends on."""

from collections.abc import Sequence
from functools import cache
import hashlib

from snake_sim_ros.dynamics import code_cache
from snake_sim_ros.scene.parameters import Scene

# What computes the results of a run, besides the compiler and NumPy.
SOURCES = ('scene', 'dynamics', 'gaits', 'contact', 'stepping', 'studies/metrics.py')
LENGTH = 32  # hexadecimal digits


@cache
def physics_version() -> str:
    """Return a name for the contents of the physics, its compiler and the metrics."""
    return code_cache.identity(SOURCES)


def key_of(scene: Scene, rate: float, own_metrics: Sequence[str]) -> str:
    """
    Return the key of a run.

    Parameters
    ----------
    scene : Scene
        With the steps in which it is run. Its values are exact in its `repr`.
    rate : float
        Samples a second [Hz].
    own_metrics : sequence of str
        Digests of metrics that are not of `metrics.METRICS`.

    """
    text = '\n'.join([physics_version(), repr(rate), repr(scene), *own_metrics])
    return hashlib.sha256(text.encode()).hexdigest()[:LENGTH]

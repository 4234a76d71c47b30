# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Pushes in dense NumPy: the parts of a step in which they are constant, and their forces."""

from collections.abc import Callable
from functools import partial
from itertools import pairwise

import numpy as np

from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.pushes import NO_PUSHES, PushTable, STEP, Stretch


def step_of(pushes: PushTable, k: int = 0) -> Stretch:
    """Return step k of a call."""
    end = (int(pushes.clock[0]) + k + 1) * STEP
    return Stretch(end - STEP, end, end)


def stretches_of(pushes: PushTable) -> list[Stretch]:
    """Return the parts of the first step in which pushes are constant."""
    begin, end, _ = step_of(pushes)
    changes = {int(tick) for tick in (*pushes.begin, *pushes.end) if begin < tick < end}
    ticks = [begin, *sorted(changes), end]
    return [Stretch(*pair, end) for pair in pairwise(ticks)]


def generalized(pushes: PushTable, stretch: Stretch, R: Array) -> Array:
    """Return the mean generalized force (6n,) in a stretch, for link frames R (n, 3, 3)."""
    found = np.zeros((len(R), 6))
    for p, i in enumerate(pushes.link):
        axes = R[i] if pushes.turns[p] else np.eye(3)
        time = min(stretch.end, pushes.end[p]) - max(stretch.begin, pushes.begin[p])
        part = max(0, time) / (stretch.end - stretch.begin)
        found[i, :3] += part * axes @ pushes.force[p]
        found[i, 3:] += part * R[i].T @ axes @ pushes.torque[p]
    return found.ravel()


# What a dense step takes: a function that returns forces (6n,) for link frames R (n, 3, 3).
Pushed = Callable[[Array], Array]
not_pushed: Pushed = partial(generalized, NO_PUSHES, Stretch(0, STEP, STEP))

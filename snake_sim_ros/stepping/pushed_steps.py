# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The pushes of a scene while it advances, as impulses between its steps."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.stepping.pushes import pushed
from snake_sim_ros.stepping.state import State


class PushedSteps:
    """
    The pushes of a scene, and the steps before which they act.

    The impulse before a step is that of the force over the half of a step before and after it,
    which is of second order in the time step, and has the impulse of the whole push.

    Parameters
    ----------
    scene : Scene

    """

    def __init__(self, scene: Scene) -> None:
        self.robot, self.dt, self.pushes = scene.robot, scene.dt, scene.pushes

    def durations(self, step: int) -> list[float]:
        """Return the time of every push that counts for the impulse before a step [s]."""
        begin, end = (step - 0.5) * self.dt, (step + 0.5) * self.dt
        return [
            max(0.0, min(item.start + item.duration, end) - max(item.start, begin))
            for item in self.pushes
        ]

    def parts(self, step: int, count: int) -> Iterator[tuple[slice, bool]]:
        """
        Yield parts of some steps that are taken in one call, and whether a push acts before them.

        Parameters
        ----------
        step : int
            Number of the first of the steps, from 0.
        count : int

        """
        acts = np.zeros(count + 1, dtype=bool)
        for item in self.pushes:
            first = item.start / self.dt - 0.5
            last = first + item.duration / self.dt + 1.0
            near = np.ceil([first - step, last - step + 1]).astype(int).clip(0, count)
            acts[slice(*near)] = True
        begins = np.flatnonzero(acts[:count])
        edges = sorted({0, count, *begins.tolist(), *(begins + 1).tolist()})
        if count == 0:
            yield slice(0, 0), False
        for first, last in pairwise(edges):
            yield slice(first, last), bool(acts[first])

    def act(self, state: State, step: int) -> State:
        """Return a state with the impulses before a step."""
        for item, time in zip(self.pushes, self.durations(step), strict=True):
            if time > 0.0:
                link = self.robot.middle_link if item.link is None else item.link - 1
                force, torque = np.array(item.force), np.array(item.torque)
                state = pushed(self.robot, state, link, time * force, time * torque)
        return state

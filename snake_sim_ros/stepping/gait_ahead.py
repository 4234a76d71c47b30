# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The joint references of a scene's gait for a few steps at a time."""

import numpy as np

from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import Array, Scene

AHEAD = 64  # steps whose references are computed at once, since one costs as much as all of them


class GaitAhead:
    """
    The gait of a scene at the middle of its steps, computed for some steps ahead.

    Parameters
    ----------
    scene : Scene

    """

    def __init__(self, scene: Scene) -> None:
        self.scene, self.first = scene, 0
        self.angle, self.rate = np.zeros((2, 0, scene.robot.link_count - 1, 2))

    def reference(self, step: int, count: int) -> tuple[Array, Array]:
        """
        Return the references of some steps.

        Parameters
        ----------
        step : int
            Number of the first one, from 0.
        count : int

        Returns
        -------
        angle, rate : ndarray, shape (count, n-1, 2)
            (yaw, pitch) [rad], [rad/s].

        """
        if count > AHEAD:
            return self.computed(step, count)
        if not self.first <= step <= step + count <= self.first + len(self.angle):
            self.first, (self.angle, self.rate) = step, self.computed(step, AHEAD)
        part = slice(step - self.first, step - self.first + count)
        return self.angle[part].copy(), self.rate[part].copy()

    def computed(self, step: int, count: int) -> tuple[Array, Array]:
        """Return the references of some steps, see `gait.reference`."""
        axes = self.scene.robot.link_count - 1
        return gait.reference(self.scene.gait, self.midpoints(step, count), axes)

    def midpoints(self, step: int, count: int) -> Array:
        """Return the times at the middle of some steps, shape (count,) [s]."""
        return (step + 0.5 + np.arange(count)) * self.scene.dt

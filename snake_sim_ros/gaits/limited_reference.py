# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""References that move no faster than joints may: a limit of their rates, whatever is told."""

import numpy as np

from snake_sim_ros.scene.parameters import Array

ROUNDING = 1e-9  # rad by which a reference may be further than it may go


class LimitedReference:
    """
    Holds references back that would move faster than a limit.

    Within a publish period a reference may go as far as the limit allows in that time, at once if
    it is told so: commands without rates come in steps. It is left as it is, to the bit. One that
    goes further is led to what it is told at the limit.

    Parameters
    ----------
    angle : ndarray, shape (n-1, 2)
        Angles (yaw, pitch) at the start [rad].
    now : float
        Simulated time [s].

    Attributes
    ----------
    count : int
        How often a reference of a joint began to be held back.

    """

    def __init__(self, angle: Array, now: float = 0.0) -> None:
        self.count = 0
        self.start(angle, now)

    def start(self, angle: Array, now: float) -> None:
        """Start anew from some angles (n-1, 2) at a time."""
        self._angle, self._time = np.array(angle), now
        self._late = np.zeros(angle.shape, dtype=bool)

    def limited(
        self, times: Array, angle: Array, rate: Array, *, period: float, limit: float
    ) -> tuple[Array, Array]:
        """
        Return references that the joints may follow.

        Parameters
        ----------
        times : ndarray, shape (m,)
            Increasing, after the last ones [s].
        angle, rate : ndarray, shape (m, n-1, 2)
            What is told [rad], [rad/s].
        period : float
            Publish period [s].
        limit : float
            Largest rate [rad/s].

        Returns
        -------
        angle, rate : ndarray, shape (m, n-1, 2)
            The same arrays if nothing is held back.

        """
        too_far = np.abs(angle - self._angle).max(axis=0) > limit * period + ROUNDING
        self.count += int((too_far & ~self._late).sum())
        led = too_far | self._late
        if led.any():
            way = angle - self._angle
            # In whole nanoseconds, as stamps are: a run has the same bits whenever it begins.
            most = limit * np.round(times - self._time, 9)[:, None, None]
            behind = led & (np.abs(way) > most)
            angle = np.where(behind, self._angle + np.sign(way) * most, angle)
            rate = np.where(behind, np.sign(way) * limit, rate)
            self._late = behind[-1]
        self._angle, self._time = angle[-1], float(times[-1])
        return angle, rate

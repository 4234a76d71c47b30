# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Samples of a motion: arrays that steppers fill as they go, made before the first step."""

from typing import NamedTuple

import numpy as np

from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.obstacles import contact_count
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.stepping.state import History, State


def row_after(step: int, every: int, first: int, count: int) -> int:
    """
    Return the row of the sample after a step, counted from 0; -1 if there is none.

    There are `count` samples, the first one after `first` steps, and none if `every` is 0.
    """
    since = step + 1 - first
    if every == 0 or since < 0 or since % every != 0:
        return -1
    row = since // every
    return row if row < count else -1


class Samples(NamedTuple):
    """
    Arrays for m samples, one after every so many steps.

    A stepper fills those that its steps reach. Torques and impulses are those of the step before
    a sample.
    """

    every: int  # steps from one sample to the next
    first: int  # steps up to the first one
    q: Array  # (m, n, 7) as in `state.State`
    u: Array  # (m, n, 6) as in `state.State`
    torque: Array  # (m, n-1, 2) (yaw, pitch) [N m]
    impulse: Array  # (m, contacts, 5) [N s]
    span: Array  # (m,) time for which impulses acted [s]
    is_planar: Array  # (m,) whether the step was taken in the plane

    def reached_by(self, steps: int) -> int:
        """Return the number of samples in the next steps."""
        if steps < self.first or not len(self.q):
            return 0
        return min(len(self.q), 1 + (steps - self.first) // self.every)

    def after(self, steps: int) -> 'Samples':
        """Return the samples that follow after some steps, in the same memory."""
        done = self.reached_by(steps)
        arrays = (array[done:] for array in self[2:])
        return Samples(self.every, self.first + done * self.every - steps, *arrays)

    def until(self, steps: int) -> 'Samples':
        """Return the samples that are reached by some steps, in the same memory."""
        count = self.reached_by(steps)
        return Samples(self.every, self.first, *(array[:count] for array in self[2:]))

    def take(self, every: 'Samples') -> None:
        """Fill those that are reached by steps with samples after each of them."""
        count, last = self.reached_by(len(every.q)), len(every.q)
        for own, array in zip(self[2:], every[2:], strict=True):
            own[:count] = array[self.first - 1 : last : self.every][:count]

    def add(self, step: int, state: State, history: History, torque: Array, span: float) -> None:
        """Fill the sample after a step, counted from 0, if there is one."""
        row = row_after(step, self.every, self.first, len(self.q))
        if row >= 0:
            self.q[row], self.u[row], self.torque[row] = state.q, state.u, torque
            self.impulse[row], self.span[row] = history.impulse, span


def checked(samples: Samples | None, none: Samples) -> Samples:
    """
    Return samples that a compiled loop may fill, or `none`, which has no rows, in place of None.

    Raises
    ------
    ParameterError
        If their arrays are not those of `make_samples` for the scene of `none`.

    """
    if samples is None or (samples.every == 0 and not len(samples.span)):
        return none
    count = len(samples.span)
    for name, array, wanted in zip(samples._fields[2:], samples[2:], none[2:], strict=True):
        shape = (count, *wanted.shape[1:])
        usable = array.dtype == wanted.dtype and array.flags.c_contiguous and array.flags.writeable
        if array.shape != shape or not usable:
            raise ParameterError(
                f'samples.{name} must be an array {shape} of make_samples for this scene, got '
                f'{array.shape} of {array.dtype}'
            )
    if samples.every < 1 or samples.first < 0:
        raise ParameterError(
            f'samples must be one step apart or more, got every={samples.every}, '
            f'first={samples.first}'
        )
    return samples


def make_samples(scene: Scene, every: int, count: int) -> Samples:
    """
    Return arrays for a number of samples of a scene, one after every so many steps.

    Raises
    ------
    ParameterError
        If there is not enough memory for them.

    """
    n = scene.robot.link_count
    try:
        return Samples(
            every=every,
            first=every,
            q=np.zeros((count, n, 7)),
            u=np.zeros((count, n, 6)),
            torque=np.zeros((count, n - 1, 2)),
            impulse=np.zeros((count, contact_count(scene), 5)),
            span=np.zeros(count),
            is_planar=np.zeros(count, dtype=bool),
        )
    except (MemoryError, ValueError):  # more than there is, or than can be counted
        raise ParameterError(
            f'{count} samples need more memory than there is: run for a shorter time, or take '
            f'fewer samples a second'
        ) from None

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Compiled reading of the points of a joint trajectory from the bytes of a message.

A point is four lists of doubles, positions, velocities, accelerations and effort, each behind the
count of its entries, and a duration. Places count from the begin of the body of the message. Whole
numbers are aligned to four bytes there, doubles to eight.
"""

import numpy as np

from snake_sim_ros.dynamics.compilation import compiled

LISTS = ('positions', 'velocities', 'accelerations', 'effort')
SHORTEST = 24  # bytes of a point whose lists are empty


@compiled
def read_points(words, numbers, place, times, angle, rate):
    """
    Read points up to the first one that has a wrong count of positions or of velocities.

    Parameters
    ----------
    words : ndarray of int32
        The body of the message.
    numbers : ndarray of float64
        The same bytes.
    place : int
        Where the first point begins.
    times : ndarray, shape (points,)
        Filled [s].
    angle : ndarray, shape (points, joints)
        Filled with the positions.
    rate : ndarray, shape (points, joints) or (points, 0)
        Filled with the velocities.

    Returns
    -------
    read : int
        How many points are as they should be.
    kind, count : int
        If one is not: which of its lists has a wrong count, and the count. It is -1 where the
        message ends too early.

    """
    for k in range(len(times)):
        for kind in range(4):
            word = place // 4
            count = np.int64(words[word]) if word < len(words) else np.int64(-1)
            place += 4
            if count > 0:
                place = (place + 7) // 8 * 8
            if count < 0 or place // 8 + count > len(numbers):
                return k, kind, np.int64(-1)
            first = place // 8
            if kind < 2:
                values = angle if kind == 0 else rate
                if count != values.shape[1]:
                    return k, kind, count
                for j in range(count):
                    values[k, j] = numbers[first + j]
            place += 8 * count
        word = place // 4
        if word + 1 >= len(words):
            return k, 0, np.int64(-1)
        nanoseconds = np.int64(words[word + 1]) & 0xFFFFFFFF
        times[k] = words[word] + 1e-9 * nanoseconds
        place += 8
    return len(times), 0, np.int64(0)


def compile_reading() -> None:
    """Compile the function, or load it from the cache."""
    body, nothing = np.zeros(6, np.int32), np.empty((1, 0))
    read_points(body, body.view(np.float64), 0, np.empty(1), nothing, nothing)

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Gaits of any shape: functions of time as tables."""

from collections.abc import Callable
import math
from typing import Any

import numpy as np

from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.gait_table import Table
from snake_sim_ros.scene.parameters import Array

ROWS = 200.0  # rows of a table a second; a spline between them is good to 1e-7 rad for waves [Hz]


def table_of(function: Callable[[float], Any], duration: float, joint_count: int = 10) -> Table:
    """
    Return a function of time as a table, with 200 rows a second and a cubic spline between them.

    Parameters
    ----------
    function : callable
        ``function(t)`` returns joint angles at a time t since the gait began [s], shape
        (n-1, 2), (yaw, pitch) of every joint [rad]; or a tuple of angles and their rates [rad/s].
        It is called once for each row, in the order of time.
    duration : float
        Time up to which the table goes [s]; after that the joints hold their angles.
    joint_count : int, optional
        Number of joints n-1. Default: 10, as Aiko has.

    Raises
    ------
    ParameterError
        If the function returns something else.

    """
    if not 0.0 < duration < math.inf:
        raise ParameterError(f'duration must be above 0 s and finite, got {duration} s')
    time = np.linspace(0.0, duration, max(2, math.ceil(duration * ROWS - 1e-9) + 1))
    told = [references_of(function(t), joint_count, 'gait(t)') for t in time.tolist()]
    rates = [rate for _, rate in told if rate is not None]
    angles = np.array([angle for angle, _ in told])
    return Table.of(time, angles, np.array(rates) if len(rates) == len(time) else None)


def references_of(told: Any, joint_count: int, name: str) -> tuple[Array, Array | None]:
    """
    Return angles and rates that a function of the user returned, shape (n-1, 2).

    Parameters
    ----------
    told : array_like, shape (n-1, 2), or tuple of two such
        Angles [rad], or angles and rates [rad/s].
    joint_count : int
    name : str
        Name of the function, for the error.

    Raises
    ------
    ParameterError
        If it is neither.

    """
    shape = joint_count, 2
    shapes = [_shape(part) for part in told] if isinstance(told, tuple) else []
    if shapes == [shape, shape]:
        return np.asarray(told[0], dtype=float), np.asarray(told[1], dtype=float)
    if _shape(told) == shape:
        return np.asarray(told, dtype=float), None
    got = ' and '.join(map(str, shapes)) if len(shapes) == 2 else _shape(told)
    raise ParameterError(
        f'{name} must return angles of shape {shape}, (yaw, pitch) of every joint [rad], or a '
        f'tuple of angles and rates of that shape, got {got or type(told).__name__}'
    )


def _shape(values: Any) -> tuple[int, ...] | None:
    """Return the shape of an array of numbers; None if it is something else."""
    try:
        return np.asarray(values, dtype=float).shape
    except (TypeError, ValueError):
        return None

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How far sidewinding turns in a cycle: a map that was measured, and its inverse.

Sidewinding turns by a gradient of its amplitudes along the body, and by itself: the loads of its
contacts depend on how fast it moves, and on friction. TURNS is what ``snake-sim study
examples/sidewinding_turning.yaml`` finds for Aiko in case C. Between its values and for gradients
of up to 0.6, the turn of other runs is within 0.015 rad a cycle of it, see test_steering.py; the
coefficients of friction are those of 0.2 with 30 % more or less.
"""

import numpy as np

from snake_sim_ros.scene.gait import Gait, Wave
from snake_sim_ros.scene.parameters import Array

WAVES = (  # that the map belongs to, at any frequency
    Wave(amplitude=np.pi / 6, phase_lag=np.radians(-50)),
    Wave(amplitude=np.pi / 18, phase_lag=np.radians(-50), phase=np.pi / 2),
)
FRICTIONS = np.array([0.14, 0.17, 0.2, 0.23, 0.26])
SPEEDS = np.array([0.05, 0.075, 0.1, 0.125, 0.15])  # m/s
GRADIENTS = np.array([-0.6, -0.4, -0.2, 0.0, 0.2, 0.4, 0.6])
TURNS = np.array(  # for each of FRICTIONS, SPEEDS and GRADIENTS [rad a cycle]
    [
        [
            [0.400, 0.281, 0.126, -0.027, -0.185, -0.362, -0.454],
            [0.395, 0.301, 0.180, 0.013, -0.163, -0.326, -0.423],
            [0.385, 0.336, 0.177, 0.036, -0.162, -0.304, -0.439],
            [0.394, 0.308, 0.159, 0.015, -0.115, -0.287, -0.468],
            [0.422, 0.305, 0.159, 0.018, -0.134, -0.323, -0.465],
        ],
        [
            [0.387, 0.271, 0.119, -0.033, -0.199, -0.363, -0.461],
            [0.401, 0.283, 0.158, -0.014, -0.174, -0.342, -0.422],
            [0.375, 0.326, 0.158, 0.000, -0.177, -0.323, -0.451],
            [0.395, 0.299, 0.153, -0.002, -0.137, -0.301, -0.464],
            [0.433, 0.294, 0.153, 0.007, -0.146, -0.345, -0.474],
        ],
        [
            [0.375, 0.256, 0.112, -0.041, -0.215, -0.368, -0.463],
            [0.390, 0.272, 0.144, -0.028, -0.189, -0.354, -0.433],
            [0.369, 0.289, 0.125, -0.026, -0.189, -0.330, -0.463],
            [0.360, 0.288, 0.145, -0.015, -0.163, -0.303, -0.471],
            [0.417, 0.283, 0.151, 0.005, -0.154, -0.333, -0.478],
        ],
        [
            [0.363, 0.242, 0.105, -0.049, -0.224, -0.374, -0.469],
            [0.376, 0.256, 0.100, -0.046, -0.202, -0.366, -0.453],
            [0.372, 0.246, 0.086, -0.046, -0.204, -0.335, -0.475],
            [0.355, 0.272, 0.127, -0.021, -0.172, -0.335, -0.486],
            [0.410, 0.279, 0.141, -0.001, -0.164, -0.338, -0.470],
        ],
        [
            [0.352, 0.234, 0.100, -0.056, -0.228, -0.381, -0.475],
            [0.375, 0.238, 0.092, -0.054, -0.217, -0.383, -0.467],
            [0.359, 0.237, 0.075, -0.060, -0.205, -0.350, -0.474],
            [0.354, 0.255, 0.111, -0.029, -0.181, -0.335, -0.484],
            [0.396, 0.274, 0.132, -0.016, -0.170, -0.349, -0.472],
        ],
    ]
)


def is_measured(gait: Gait) -> bool:
    """Return whether the waves of a gait are those that the map belongs to."""
    return all(
        abs(getattr(wave, name) - getattr(measured, name)) < 1e-6
        for wave, measured in zip((gait.yaw, gait.pitch), WAVES, strict=True)
        for name in ('amplitude', 'phase_lag', 'phase', 'offset', 'gradient')
    )


def turns_of_gradients(speed: float, friction: float) -> Array:
    """Return the turn of each of GRADIENTS [rad a cycle]; outside of the map that of its edge."""
    (i, s), (j, t) = _place(FRICTIONS, friction), _place(SPEEDS, speed)
    low, high = ((1.0 - t) * TURNS[k, j] + t * TURNS[k, j + 1] for k in (i, i + 1))
    return np.asarray((1.0 - s) * low + s * high)


def gradient_of_turn(turn: float, speed: float, friction: float) -> float:
    """
    Return the gradient that turns the robot by an angle a cycle [rad].

    It goes on beyond GRADIENTS as steeply as at their ends.
    """
    turns = turns_of_gradients(speed, friction)[::-1]  # rises
    k = int(np.clip(np.searchsorted(turns, turn) - 1, 0, len(turns) - 2))
    share = (turn - turns[k]) / (turns[k + 1] - turns[k])
    begin, end = GRADIENTS[::-1][k : k + 2]
    return float(begin + share * (end - begin))


def _place(values: Array, value: float) -> tuple[int, float]:
    """Return the interval of rising values that a value is in, and its share of it."""
    value = float(np.clip(value, values[0], values[-1]))
    k = min(int(np.searchsorted(values, value, 'right')) - 1, len(values) - 2)
    return k, float((value - values[k]) / (values[k + 1] - values[k]))

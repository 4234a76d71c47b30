# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How far sidewinding turns in a cycle: a map that was measured, and its inverse.

Sidewinding turns by a gradient of its amplitudes along the body, and by itself: the loads of its
contacts depend on how fast it moves, and on friction. TURNS is what ``snake-sim study
examples/sidewinding_turning.yaml`` finds for Aiko in case C, with 30 % less to 30 % more friction.
Turns of 24 other runs between its values, of 0.17 to 0.38 rad a cycle, were off by up to 0.03 rad
and 10 %.
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
GRADIENTS = np.array([-0.5, -0.375, -0.25, -0.125, 0.0, 0.125, 0.25, 0.375, 0.5])
TURNS = np.array(  # for each of FRICTIONS, SPEEDS and GRADIENTS [rad a cycle]
    [
        [
            [0.352, 0.262, 0.170, 0.067, -0.027, -0.131, -0.229, -0.341, -0.437],
            [0.361, 0.290, 0.197, 0.120, 0.013, -0.097, -0.199, -0.303, -0.405],
            [0.398, 0.310, 0.205, 0.122, 0.037, -0.090, -0.201, -0.292, -0.378],
            [0.373, 0.292, 0.199, 0.114, 0.015, -0.068, -0.157, -0.265, -0.412],
            [0.383, 0.280, 0.197, 0.107, 0.019, -0.069, -0.180, -0.278, -0.431],
        ],
        [
            [0.350, 0.253, 0.163, 0.056, -0.033, -0.136, -0.245, -0.344, -0.445],
            [0.344, 0.271, 0.186, 0.105, -0.014, -0.117, -0.210, -0.320, -0.421],
            [0.398, 0.299, 0.194, 0.100, 0.004, -0.110, -0.216, -0.309, -0.390],
            [0.362, 0.281, 0.193, 0.101, -0.002, -0.082, -0.180, -0.281, -0.411],
            [0.373, 0.268, 0.187, 0.104, 0.006, -0.086, -0.191, -0.319, -0.423],
        ],
        [
            [0.339, 0.242, 0.158, 0.046, -0.041, -0.147, -0.260, -0.350, -0.449],
            [0.331, 0.257, 0.161, 0.086, -0.028, -0.129, -0.224, -0.333, -0.435],
            [0.370, 0.267, 0.164, 0.058, -0.026, -0.129, -0.231, -0.317, -0.394],
            [0.355, 0.266, 0.179, 0.080, -0.015, -0.109, -0.192, -0.279, -0.419],
            [0.367, 0.265, 0.184, 0.101, 0.005, -0.092, -0.227, -0.327, -0.413],
        ],
        [
            [0.319, 0.231, 0.147, 0.043, -0.049, -0.160, -0.263, -0.354, -0.457],
            [0.319, 0.235, 0.147, 0.064, -0.046, -0.136, -0.240, -0.343, -0.444],
            [0.322, 0.230, 0.126, 0.033, -0.047, -0.146, -0.237, -0.320, -0.400],
            [0.344, 0.253, 0.167, 0.070, -0.021, -0.119, -0.201, -0.290, -0.417],
            [0.366, 0.266, 0.179, 0.085, -0.001, -0.097, -0.209, -0.316, -0.426],
        ],
        [
            [0.304, 0.221, 0.139, 0.043, -0.055, -0.172, -0.269, -0.360, -0.461],
            [0.309, 0.220, 0.126, 0.048, -0.054, -0.153, -0.258, -0.361, -0.448],
            [0.295, 0.208, 0.112, 0.024, -0.060, -0.148, -0.245, -0.334, -0.412],
            [0.343, 0.241, 0.160, 0.058, -0.029, -0.136, -0.215, -0.310, -0.416],
            [0.357, 0.256, 0.172, 0.072, -0.016, -0.102, -0.211, -0.323, -0.432],
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


def _place(values: Array, value: float) -> tuple[int, float]:
    """Return the interval of rising values that a value is in, and its share of it."""
    value = float(np.clip(value, values[0], values[-1]))
    k = min(int(np.searchsorted(values, value, 'right')) - 1, len(values) - 2)
    return k, float((value - values[k]) / (values[k + 1] - values[k]))

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What controllers among obstacles share: a wider wave of yaw, and the way into it."""

from dataclasses import replace
import math

from snake_sim_ros.controllers.controller import Reference
from snake_sim_ros.gaits.blending import check_limits
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.gait import Gait, soft_start
from snake_sim_ros.scene.parameters import Array, Scene

AMPLITUDE, PHASE_LAG = 0.77, 0.63  # of the wide wave, by default [rad]
ENTRY = 1.5  # time in which a wave fades in from the posture at the start, at least [s]


def wide(scene: Scene, amplitude: float, phase_lag: float) -> Gait:
    """
    Return the gait of a scene with another amplitude and phase lag of yaw [rad].

    Raises
    ------
    ParameterError
        If the gait has a table or the joints cannot follow.

    """
    if scene.gait.table:
        raise ParameterError('the controller shapes a wave, the gait has a table')
    yaw = scene.gait.yaw
    lag = math.copysign(phase_lag, yaw.phase_lag)
    yaw = replace(yaw, amplitude=amplitude, phase_lag=lag, gradient=0.0)
    gait = replace(scene.gait, yaw=yaw, soft_start=0.0)
    check_limits(gait, scene.robot)
    return gait


def faded_in(reference: Reference, posture: Array, fade_in: float) -> Reference:
    """Return a reference that begins at rest in a posture (n-1, 2) [rad] and fades in [s]."""

    def faded(times: Array) -> tuple[Array, Array]:
        angle, rate = reference(times)
        if times[0] >= fade_in:
            return angle, rate
        share, growth = (each[:, None, None] for each in soft_start(times, fade_in))
        away = angle - posture
        return posture + share * away, share * rate + growth * away

    return faded

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""How many steps there are in periods of time."""

from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Scene

MOST_STEPS = 2**53  # in any period


def steps_in(period: float, dt: float, name: str) -> int:
    """
    Return the number of steps in a period [s]; `name` is that of the period in the message.

    Raises
    ------
    ParameterError
        If the time step dt [s] does not divide the period.

    """
    if not period / dt <= MOST_STEPS:
        raise ParameterError(
            f'{name} must be at most {MOST_STEPS} steps of {dt:g} s, got {period:g} s'
        )
    steps = round(period / dt)
    if steps < 1 or abs(steps * dt - period) > 1e-9 * period:
        raise ParameterError(f'dt must divide the {name}: got dt={dt:g} s, period={period:g} s')
    return steps


def samples_of(scene: Scene, rate: float) -> tuple[int, int]:
    """
    Return the steps between two samples of a run at a rate [Hz], and the samples after the first.

    Raises
    ------
    ParameterError
        If dt does not divide the sampling period, or the sampling period the duration.

    """
    if not rate > 0:
        raise ParameterError(f'rate must be above 0 Hz, got {rate:g} Hz')
    steps = steps_in(1.0 / rate, scene.dt, 'sampling period')
    samples, rest = divmod(steps_in(scene.duration, scene.dt, 'duration'), steps)
    if rest:
        raise ParameterError(
            f'duration must be a multiple of the sampling period, 1/{rate:g} s; '
            f'got {scene.duration:g} s'
        )
    return steps, samples

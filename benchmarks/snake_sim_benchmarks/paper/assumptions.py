# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Assumptions where the paper does not state its cases, in words for the figures."""

import numpy as np

from snake_sim_ros.scene.gait import Wave
from snake_sim_ros.scene.parameters import Scene

SOLVER_WORDS = (
    'of several possible normal forces those of least norm; '
    'contacts solved to 1e-9 m/s, not to the unknown tolerance of (93)'
)


def degrees(value: float) -> str:
    """Return an angle in words."""
    return f'{np.degrees(value):.3g} deg'


def wave_words(wave: Wave) -> str:
    """Return the parameters of a wave that are not zero, in words."""
    return (
        f'A = {degrees(wave.amplitude)}, omega = {degrees(wave.angular_frequency)}/s, '
        f'delta = {degrees(wave.phase_lag)}'
        + f', delta_0 = {degrees(wave.phase)}'
        * bool(wave.phase)
    )


def assumed_in_a(scene: Scene) -> str:
    """Return the assumptions of case A."""
    return f'assumed: rolling friction {scene.friction.rolling:g}; {SOLVER_WORDS}'


def assumed_in_b() -> str:
    """Return the assumptions of case B."""
    return (
        'assumed: the coefficient, isotropic (0.2 stands for it elsewhere); gait, curved start '
        f'and 15 s as in case A;\nrolling friction 0; {SOLVER_WORDS}'
    )


def assumed_in_c(scene: Scene) -> str:
    """Return the assumptions of case C."""
    yaw, pitch = scene.gait.yaw, scene.gait.pitch
    return (
        f'assumed: isotropic friction {scene.friction.longitudinal:g}; yaw wave '
        f'{wave_words(yaw)}; pitch wave {wave_words(pitch)};\nsoft start '
        f's = 3x² - 2x³, x = t/{scene.gait.soft_start:g} s; rolling friction '
        f'{scene.friction.rolling:g}; {SOLVER_WORDS}'
    )


def assumed_in_both(sidewinding: Scene) -> str:
    """Return the assumptions of a figure with case A and case C."""
    in_c = assumed_in_c(sidewinding).removeprefix('assumed: ')
    return f'A assumed: rolling friction 0; normal forces and tolerance as in C\nC assumed: {in_c}'

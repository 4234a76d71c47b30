# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Families of scenes: perturbed ones for statistics, and neighbors for bounds that hold around.

An error over 15 s of a gait with landings depends on chance. A family asks for the error of scenes
that are as good as the given one, and the neighbors for the worst of small changes.
"""

from collections.abc import Mapping
from dataclasses import replace
import math

import numpy as np

from snake_sim_ros.scene.parameters import Scene

FRICTION_SPREAD = 0.1  # both coefficients are multiplied by 0.9 to 1.1, by the same number
SOFT_STARTS = (4.0, 5.0)  # s, of scenes with a soft start
SEED = 17
NEARBY_STEPS = 0.2  # neighbors have time steps that are 20 % shorter and longer,
NEARBY_SCENES = 0.02  # and friction and yaw amplitude that are 2 % smaller and larger


def family(scene: Scene, count: int) -> list[Scene]:
    """
    Return perturbed scenes, always the same ones.

    Friction, the phase of the gait and the time of the soft start are drawn uniformly. The phases
    of yaw and pitch change together, so that the gait is the same one at another time. A larger
    family begins with the scenes of a smaller one.

    A scene without a soft start gets none. With one, the forces of case A, whose links all stick
    to the floor while the gait fades in, are not unique, and runs of `newton` at 1/8000 and
    1/16000 s come to end 0.3 to 0.7 % of the way apart: there is nothing to judge errors by.
    """
    random = np.random.default_rng(SEED)
    return [
        perturbed(
            scene,
            friction=random.uniform(1 - FRICTION_SPREAD, 1 + FRICTION_SPREAD),
            phase=random.uniform(0.0, 1.0),
            soft_start=random.uniform(*SOFT_STARTS),
        )
        for _ in range(count)
    ]


def perturbed(scene: Scene, friction: float, phase: float, soft_start: float) -> Scene:
    """Return a scene with friction times a factor, at a phase of its gait, 0 to 1."""
    gait, first = scene.gait, frequency(scene)
    waves = {
        name: replace(
            wave, phase=wave.phase + 2 * math.pi * phase * wave.angular_frequency / first
        )
        for name, wave in (('yaw', gait.yaw), ('pitch', gait.pitch))
    }
    gait = replace(gait, yaw=waves['yaw'], pitch=waves['pitch'])
    gait = replace(gait, soft_start=soft_start if gait.soft_start else 0.0)
    return with_friction(replace(scene, gait=gait), friction)


def frequency(scene: Scene) -> float:
    """Return the angular frequency of the gait, that of yaw if there is yaw [rad/s]."""
    yaw, pitch = scene.gait.yaw, scene.gait.pitch
    return (yaw if yaw.amplitude else pitch).angular_frequency


def with_friction(scene: Scene, factor: float) -> Scene:
    """Return a scene with all coefficients of sliding friction times a factor."""
    friction = scene.friction
    return replace(
        scene,
        friction=replace(
            friction,
            longitudinal=factor * friction.longitudinal,
            backward=None if friction.backward is None else factor * friction.backward,
            transversal=factor * friction.transversal,
        ),
    )


def neighbors(scene: Scene) -> Mapping[str, tuple[Scene, float]]:
    """
    Return the scenes over which a robust bound is the largest error, with factors of the step.

    Returns
    -------
    dict
        What is changed -> the scene, and what its time step is multiplied by.

    """
    yaw = scene.gait.yaw
    found = {
        'as given': (scene, 1.0),
        'shorter steps': (scene, 1 - NEARBY_STEPS),
        'longer steps': (scene, 1 + NEARBY_STEPS),
    }
    for side in (-1, 1):
        factor = 1 + side * NEARBY_SCENES
        wave = replace(yaw, amplitude=factor * yaw.amplitude)
        change = 'more' if side > 0 else 'less'
        found[f'{change} friction'] = with_friction(scene, factor), 1.0
        found[f'{change} amplitude'] = replace(scene, gait=replace(scene.gait, yaw=wave)), 1.0
    return found

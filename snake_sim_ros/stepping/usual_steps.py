# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The steps of a scene where nobody says how it is stepped: those of the usual accuracy."""

from collections.abc import Container

from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.stepping import bdf2
from snake_sim_ros.stepping.accuracy import USUAL_ACCURACY, with_accuracy

STEPPING = ('dt', 'method', 'level')  # with one of these, a user decides how a scene is run
USUAL_SCENE = Scene()


def with_usual_steps(scene: Scene, given: Container[str], period: float) -> Scene:
    """
    Return a scene with the steps that its accuracy asks for, if it has one.

    It has the usual accuracy if neither an accuracy nor one of STEPPING is given or differs from
    its default, and if the method for it can run the scene.

    Parameters
    ----------
    scene : Scene
    given : container of str
        Dotted names of the values that a user gave beside the file of the scene.
    period : float
        Time between two samples [s].

    Raises
    ------
    ParameterError
        If the accuracy or the period is not usable.

    """
    accuracy = scene.accuracy
    is_free = all(
        name not in given and getattr(scene, name) == getattr(USUAL_SCENE, name)
        for name in STEPPING
    )
    if 'accuracy' not in given and is_free and not bdf2.what_is_not_possible(scene):
        accuracy = accuracy or USUAL_ACCURACY
    return with_accuracy(scene, accuracy, period, given) if accuracy else scene

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The accuracy of a scene: the relative error of the path that one can expect over a gait cycle.

It chooses the method `bdf2`, and by an error estimate the parts in which its steps are taken; see
`bdf2.formula`. A part may be off the path by

    tolerance = PATH_SHARE L accuracy^(3/2),

with the mean length L of a link. Parts of length dt that are off by dt^3 each make an error of the
path of dt^2 over a time, which falls with the power 2/3 of the tolerance. No contact counts as
closed with a larger gap than that: stiff pitch joints would carry what the floor should.

What is promised: from rest, with references that begin smoothly (`soft_start` of 0.5 s or more),
the middle link stays over a cycle of the gait within ``accuracy max(l, L)`` of where the limit of
small steps has it, with the length l of its path, wherever that limit is known to a quarter of
this. It is no bound: the constants below are calibrated in 200 random scenes, of which 1 in 100
misses; `comparison.limits` judges others, and docs/speed_accuracy.md has the numbers.
"""

from collections.abc import Container, Mapping
from fractions import Fraction
import math

from snake_sim_ros.controllers.named import controller_of
from snake_sim_ros.dynamics.joint_control import control_periods
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Scene, with_settings

USUAL_ACCURACY = 1e-3
# A step has one joint reference. It is 1/20 s at most, in which the waves of the gait turn by this
# angle [rad] at accuracies of TURNING_ACCURACY or more; below, it falls with the square root.
LONGEST_STEP, LONGEST_TURN, TURNING_ACCURACY = 1 / 20, 0.047, 1e-2
PATH_SHARE = 2e-3  # tolerance of the path at accuracy 1, in lengths of a link
LEAST_SHARE = 1e-9  # least tolerance: below it rounding and events decide, in lengths of a link
LEAST_STEP = 1 / 40000  # that is chosen; periods with a lesser common divisor are refused [s]
DIVIDES = 1e-9  # steps in a period that are this much more than an integer are that integer
FINEST = 10**6  # largest denominator of a period [1/s]
RESIDUAL = 1e-8  # residual tolerance of the contacts; a larger one saves next to nothing [m/s]


def path_tolerance(scene: Scene) -> float:
    """Return the path error that a part of a step may make [m]; 0: steps are not divided."""
    if scene.accuracy == 0.0:
        return 0.0
    length = float(scene.robot.per_link('link_length').mean())
    return length * max(PATH_SHARE * math.pow(scene.accuracy, 1.5), LEAST_SHARE)


def longest_step(scene: Scene, accuracy: float) -> float:
    """Return the longest time for which one joint reference of the gait is enough [s]."""
    yaw, pitch = scene.gait.yaw.angular_frequency, scene.gait.pitch.angular_frequency
    fastest = max(abs(yaw), abs(pitch))
    if scene.gait.table:
        fastest = max(fastest, scene.gait.table.angular_frequency())
    turn = LONGEST_TURN * min(1.0, math.sqrt(accuracy / TURNING_ACCURACY))
    return min(LONGEST_STEP, turn / max(fastest, turn / LONGEST_STEP))


def common_divisor(scene: Scene, periods: Mapping[str, float]) -> float:
    """
    Return the longest time that divides some periods and those of the joint controllers [s].

    Raises
    ------
    ParameterError
        If it is below LEAST_STEP.

    """
    named: dict[str, float] = {**periods, **control_periods(scene.robot)}
    if scene.controller or scene.follow:
        controller = controller_of(scene)
        if controller:
            named['period of the controller'] = controller.period
    if len(named) == 1:
        return next(iter(periods.values()))
    parts = [Fraction(time).limit_denominator(FINEST) for time in named.values()]
    unit = math.lcm(*(part.denominator for part in parts))
    divisor = math.gcd(*(int(part * unit) for part in parts)) / unit
    if divisor < LEAST_STEP:
        listed = ', '.join(f'{name} {time:g} s' for name, time in named.items())
        raise ParameterError(
            f'periods must have a common divisor of at least {LEAST_STEP:g} s, or dt must be '
            f'given, got {listed}'
        )
    return divisor


def with_accuracy(
    scene: Scene, accuracy: float, period: float | Mapping[str, float],
    given: Container[str] = (),
) -> Scene:  # fmt: skip
    """
    Return a scene that is run with an accuracy.

    Parameters
    ----------
    scene : Scene
    accuracy : float
        Relative error of the path over a gait cycle, above 0.
    period : float or mapping
        Time between two samples [s], or name -> period of more that steps divide. The steps of the
        scene are the longest that divide them and the periods of the joint controllers,
        `longest_step` at most. Each is taken in as many parts as the accuracy needs.
    given : container of str, optional
        Names of values that stay as they are in the scene, of `dt`, `method` and
        `solver.residual_tolerance`.

    Raises
    ------
    ParameterError
        If the accuracy or a period is not usable.

    """
    if not accuracy > 0.0:
        scene = with_settings(scene, {'accuracy': accuracy})  # which says what it must be
    periods = period if isinstance(period, Mapping) else {'sampling period': period}
    divides = min(periods.values()) if 'dt' in given else common_divisor(scene, periods)
    settings = {
        'dt': divides / max(1, math.ceil(divides / longest_step(scene, accuracy) - DIVIDES)),
        'method': 'bdf2',
        'solver.residual_tolerance': RESIDUAL,
    }
    free = {name: value for name, value in settings.items() if name not in given}
    return with_settings(scene, free | {'accuracy': accuracy})

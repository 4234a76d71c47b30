# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Sliding friction that falls with speed (Stribeck), in closed form."""

from dataclasses import replace
import math

import numpy as np
from obstacle_scenes import COARSE
import pytest
from scenes import course, G, slope
from test_friction import (
    agreeing_at_both_levels,
    block_scene,
    border,
    each_level,
    heading,
    left_over,
    sliding,
)
from test_viscous_friction import first_or_second, order

from snake_sim_ros import Friction, ParameterError, Scene
from snake_sim_ros.scene.obstacles import is_flat
from snake_sim_ros.scene.parameters import scene_from_text, scene_to_text, with_settings
from snake_sim_ros.stepping.methods import METHODS

pytestmark = pytest.mark.fast

STATIC, RATIO, SPEED = 0.4, 0.25, 0.1  # m/s
FALLING = Friction(
    longitudinal=STATIC, transversal=STATIC, kinetic_ratio=RATIO, stribeck_speed=SPEED
)


def coefficient(v):
    """Return the coefficient of friction at a speed [m/s]."""
    return STATIC * (RATIO + (1 - RATIO) / (1 + (v / SPEED) ** 2))


def time_to_slow_down(v0, v):
    """
    Return the time from a speed v0 to v [s].

    v' = -(a + b/(1 + s^2)) with s = v/SPEED, a = mu_k g and b = (mu_s - mu_k) g, so that
    dt = -SPEED (1 + s^2)/(a s^2 + a + b) ds = -SPEED/a (1 - b/(a s^2 + a + b)) ds.
    """
    a, b = STATIC * RATIO * G, STATIC * (1 - RATIO) * G

    def integral(s):
        return s - b / math.sqrt(a * (a + b)) * math.atan(s * math.sqrt(a / (a + b)))

    return SPEED / a * (integral(v0 / SPEED) - integral(v / SPEED))


@each_level
@pytest.mark.parametrize('angle', [0.0, 2.5])
def test_a_block_slows_down(method, level, angle):
    v0, v = 0.5, 0.03
    time, errors = time_to_slow_down(v0, v), []
    for steps in (50, 100, 200):
        scene = block_scene(method, level, friction=FALLING, dt=time / steps)
        states, impulses, report = course(scene, sliding(angle, (0.0, v0)), steps)
        assert not report.unconverged and not report.failure
        speed = (states.u[:, 0, :2] @ heading(angle).T)[:, 1]
        if method != 'bdf2':  # implicitly v' = v - mu(v') g dt, to a residual in each step
            left = speed[1:] - (speed[:-1] - coefficient(speed[1:]) * G * scene.dt)
            assert np.abs(left).max() < left_over(1)
        used = np.hypot(*impulses[1:, :, 1:3].sum(axis=1).T) / impulses[1:, :, 0].sum(axis=1)
        assert np.abs(used - coefficient(speed[1:])).max() < 1e-8
        errors.append(abs(speed[-1] - v))
    assert (order(errors) > first_or_second(method) - 0.1).all()


@each_level
def test_it_comes_to_rest(method, level):
    v0, dt = 0.4, 1 / 500
    stop = time_to_slow_down(v0, 0.0)
    scene = block_scene(method, level, friction=FALLING, dt=dt)
    states, _, report = course(scene, sliding(0.7, (v0, 0.0)), math.ceil(stop / dt) + 20)
    assert not report.unconverged and not report.failure
    speed = np.hypot(*states.u[:, 0, :2].T)
    # A few steps later at most, since the decrease of the last ones is largest.
    assert speed[math.ceil(stop / dt) + 5 :].max() < 1e-4
    assert speed[math.floor(0.95 * stop / dt)] > 0.0


@pytest.mark.parametrize('method', METHODS)
def test_rest_and_sliding_are_both_possible_on_a_slope(method):
    # mu_kinetic < tan b < mu_static: what rests stays, what is fast enough gets faster. The speed
    # between is that with mu(v) = tan b.
    tan = 0.5 * (STATIC + RATIO * STATIC)
    between = SPEED * math.sqrt((1 - RATIO) / (tan / STATIC - RATIO) - 1)
    gravity = slope(math.atan(tan))
    scene = block_scene(method, 'spatial', friction=FALLING, gravity=gravity, dt=COARSE)
    for start in (0.0, 0.9 * between, 1.1 * between):
        states, _, report = course(scene, sliding(0.0, (start, 0.0)), 400, 50)
        assert not report.unconverged
        speed = states.u[:, 0, 0]
        if start > between:
            assert (np.diff(speed) > 0.0).all()
        else:
            assert abs(speed[-1]) < left_over(400)


@pytest.mark.parametrize('method', METHODS)
def test_it_does_not_creep_below_the_threshold(method):
    # A block at rest on a slope: at 0.99 mu_static it holds, at 1.01 it goes.
    for load in (0.99, 1.01):
        gravity = slope(math.atan(load * STATIC), 0.4)
        scene = block_scene(method, 'spatial', friction=FALLING, gravity=gravity, dt=COARSE)
        states, _, report = course(scene, sliding(0.0, (0.0, 0.0)), 40, 40)
        assert not report.unconverged
        speed = np.hypot(*states.u[-1, 0, :2])
        assert speed < left_over(40) if load < 1.0 else speed > 1e-3


@each_level
def test_the_direction_is_that_of_the_ellipse(method, level):
    # The force is the point of the ellipse against v, times the factor at |v|; see test_friction.
    friction = replace(FALLING, longitudinal=0.1)
    scene = block_scene(method, level, friction=friction, dt=1 / 1000)
    states, impulses, report = course(scene, sliding(0.7, (0.2, 0.1)), 6)
    assert not report.unconverged
    v = states.u[-1, 0, :2] @ heading(0.7).T
    D = np.array([0.1, STATIC])
    P = impulses[-1, :, 1:3].sum(axis=0) / impulses[-1, :, 0].sum()
    factor = coefficient(np.hypot(*v)) / STATIC
    assert P == pytest.approx(-factor * D**2 * v / np.hypot(*(D * v)), rel=1e-6)


@each_level
def test_patches_scale_it(method, level):
    scene = block_scene(method, level, friction=FALLING, patches=border(2.0, -20.0), dt=1 / 2000)
    states, _, report = course(scene, sliding(0.0, (0.3, 0.0)), 20)
    assert not report.unconverged
    before, after = states.u[-2:, 0, 0]
    here = coefficient((before + after) / 2 if method == 'bdf2' else after)
    assert (before - after) / scene.dt == pytest.approx(2 * here * G, rel=1e-4)


@pytest.mark.parametrize('ratio', [0.9, 0.3])
def test_all_methods_take_the_dense_step(ratio):
    # A step of 1/1000 s, in which friction falls by less than it takes to change the speed.
    friction = Friction(
        longitudinal=0.02, transversal=0.1, kinetic_ratio=ratio, stribeck_speed=0.02
    )
    taken = agreeing_at_both_levels(friction, 8, 0.05)
    assert taken >= 4 * (len(METHODS) - 1)


def test_without_a_fall_nothing_changes():
    assert is_flat(replace(Scene(), friction=Friction(stribeck_speed=0.5)))
    assert not is_flat(replace(Scene(), friction=FALLING))


def test_a_scene_keeps_it_as_text():
    scene = replace(Scene(), friction=FALLING)
    assert scene_from_text(scene_to_text(scene)) == scene


@pytest.mark.parametrize(
    ('settings', 'sentence'),
    [
        ({'kinetic_ratio': 1.5}, 'kinetic_ratio must be at most 1, got 1.5'),
        ({'kinetic_ratio': -0.5}, 'kinetic_ratio must be at least 0, got -0.5'),
        ({'kinetic_ratio': math.nan}, 'kinetic_ratio must be finite, got nan'),
        ({'stribeck_speed': 0.0}, 'stribeck_speed must be above 0 m/s, got 0 m/s'),
        ({'stribeck_speed': 'slow'}, "stribeck_speed must be a number, got 'slow'"),
        (
            {'kinetic_ratio': 0.5, 'rolling': 0.1},
            'kinetic_ratio 0.5 needs rolling 0, got 0.1: rolling friction does not fall with '
            'speed',
        ),
    ],
)
def test_bad_values_get_one_sentence(settings, sentence):
    named = {f'friction.{name}': value for name, value in settings.items()}
    with pytest.raises(ParameterError) as raised:
        with_settings(Scene(), named)
    assert str(raised.value).replace('friction: ', '').replace('friction.', '') == sentence

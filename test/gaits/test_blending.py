# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Gaits that change while they run: no jumps, exact rates, limits kept, phases kept."""

from dataclasses import replace
from itertools import pairwise
import math

import numpy as np
import pytest
from random_states import EPS

from snake_sim_ros import Gait, ParameterError, Robot, Wave
from snake_sim_ros.gaits.blending import (
    Blend,
    check_limits,
    largest_frequency,
    largest_values,
    shortest_blend,
)
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import load_scene

pytestmark = pytest.mark.fast

ROBOT = Robot()
JOINTS = 10
LARGEST = largest_values(ROBOT, 'yaw')
# Angles up to 1 rad from phases up to 200 rad, whose rounding the sine passes on.
ROUNDING = 400 * EPS
SCENES = [
    *('hyper_redundant', 'lateral_undulation', 'lateral_undulation_isotropic', 'obstacle_aided'),
    *('sidewinding', 'sinus_lifting', 'slender_undulation', 'step', 'concertina', 'eel_like'),
    *('linear_progression', 'rolling', 'rolling_helix', 'turn_in_place'),
]
UNDULATION, SIDEWINDING, SINUS_LIFTING = (
    load_scene(name).gait for name in ('lateral_undulation', 'sidewinding', 'sinus_lifting')
)


def random_gait(rng):
    """Return a gait within the limits, often at their edge."""

    def wave():
        values = {name: rng.uniform(-1, 1) * largest for name, largest in LARGEST.items()}
        values['amplitude'] = LARGEST['amplitude'] * rng.choice([-1, 0, 0.1, 0.5, 1])
        values['gradient'] *= rng.choice([0, 1])
        largest = values['amplitude']
        if values['gradient']:
            values['amplitude'] *= (1 - 8 * EPS) / (1 + abs(values['gradient']))
        fastest = largest_frequency(ROBOT, 'yaw', largest)
        values['angular_frequency'] = fastest * rng.choice([-1, 0, 0.3, 1])
        values['offset'] *= 1 - abs(largest) / ROBOT.joint_limit
        return Wave(**values)

    made = Gait(yaw=wave(), pitch=wave())
    check_limits(made, ROBOT)
    return made


def random_posture(rng):
    """Return angles within the limits, often at their edge."""
    return ROBOT.joint_limit * np.clip(rng.uniform(-1.5, 1.5, (JOINTS, 2)), -1.0, 1.0)


def random_changes(seed):
    """
    Return the blends of some changes at random times, as [(time it holds from, blend)].

    Every other one starts from a posture, and half of these gaits have a soft start.
    """
    rng = np.random.default_rng(seed)
    duration = shortest_blend(ROBOT) * rng.choice([1.0, 2.0])
    first, posture = random_gait(rng), None
    if seed % 2:
        posture = random_posture(rng)
        first = replace(first, soft_start=duration * rng.choice([0.0, 0.0, 0.1, 1.0]))
    blends = [(0.0, Blend.of(first, JOINTS, duration, posture))]
    for _ in range(8):
        time = blends[-1][0] + duration * rng.choice([0.0, 0.05, 0.4, 1.0, 1.7])
        blends.append((time, blends[-1][1].changed(time, random_gait(rng))))
    return blends


@pytest.mark.parametrize('name', SCENES)
def test_without_a_change_it_is_the_gait(name):
    scene = load_scene(name)
    check_limits(scene.gait, scene.robot)
    times = np.linspace(0.0, 60.0, 500)
    for values, expected in zip(
        Blend.of(scene.gait, JOINTS, 1.0).reference(times),
        gait.reference(scene.gait, times, JOINTS),
        strict=True,
    ):
        assert np.abs(values - expected).max() < ROUNDING


@pytest.mark.parametrize('seed', range(20))
def test_no_change_makes_a_jump(seed):
    blends = random_changes(seed)
    for (_, before), (time, after) in pairwise(blends):
        for old, new in zip(before.reference(time), after.reference(time), strict=True):
            # Rates up to 10 rad/s, with phases that are added up in another order.
            assert np.abs(new - old).max() < 10 * ROUNDING


@pytest.mark.parametrize('seed', range(20))
def test_rates_are_the_derivatives_of_the_angles(seed):
    h, Omega, L = 1e-5, LARGEST['angular_frequency'], ROBOT.joint_limit
    blends = random_changes(seed)
    ends = [time for time, _ in blends[1:]] + [blends[-1][0] + 3.0]
    for (begin, blend), end in zip(blends, ends, strict=True):
        if end == begin:
            continue
        times = np.linspace(begin + h, end - h, 200)
        mixed = blend.mixture
        T, fade_in, begins = mixed.duration, mixed.fade_in, mixed.begin[1 : int(mixed.present[0])]
        m = len(begins) + bool(mixed.entry)
        # The second derivative jumps where a blend ends.
        kinks = np.concatenate([[T, fade_in], begins + T, begins])
        times = times[(np.abs(times[:, None] - kinks) > 2 * h).all(axis=1)]
        (later, _), (sooner, _) = (blend.reference(times + sign * h) for sign in (1, -1))
        _, rate = blend.reference(times)
        # Central difference: h^2/6 |alpha'''|, with alpha = Im(z c) + psi, c = exp(i phi). Here
        # |z| + |psi| <= L w, and |w'|, |w''|, |w'''| <= 2m times those of s: 3/2T, 6/T^2, 12/T^3;
        # the frequency w Omega likewise.
        w = [1.0, 3 * m / T, 12 * m / T**2, 24 * m / T**3]
        omega = [Omega * value for value in w]
        c = [
            1.0,
            omega[0],
            omega[0] ** 2 + omega[1],
            omega[0] ** 3 + 3 * omega[0] * omega[1] + omega[2],
        ]
        if 0.0 < fade_in and begin < fade_in:  # a factor with the derivatives of s
            f = [1.0, *(value / fade_in**k for k, value in ((1, 1.5), (2, 6), (3, 12)))]
            w = [sum(math.comb(k, i) * f[i] * w[k - i] for i in range(k + 1)) for k in range(4)]
        third = L * sum(math.comb(3, i) * w[i] * c[3 - i] for i in range(4))
        bound = h**2 / 6 * third + ROUNDING / h
        assert np.abs(rate - (later - sooner) / (2 * h)).max(initial=0.0) < bound


@pytest.mark.parametrize('seed', range(20))
def test_blends_stay_within_the_limits_of_the_joints(seed):
    for begin, blend in random_changes(seed):
        angle, rate = blend.reference(np.linspace(begin, begin + 3.0, 500))
        assert np.abs(angle).max() < ROBOT.joint_limit + ROUNDING
        assert np.abs(rate).max() < ROBOT.joint_rate_limit + 10 * ROUNDING


@pytest.mark.parametrize('name', SCENES)
def test_a_posture_blends_into_the_gait(name):
    posture, T = random_posture(np.random.default_rng(1)), 1.5
    target = load_scene(name).gait
    blend, full = Blend.of(target, JOINTS, T, posture), Blend.of(target, JOINTS, T)
    # It starts there, at rest.
    angle, rate = blend.reference(0.0)
    assert (angle == posture).all()
    assert not rate.any()
    # In between, both count with their weights.
    times = np.linspace(0.0, T, 100)
    s, s_dot = (value[:, None, None] for value in gait.soft_start(times, T))
    (angle, rate), (g, g_dot) = blend.reference(times), full.reference(times)
    assert np.abs(angle - ((1 - s) * posture + s * g)).max() < ROUNDING
    assert np.abs(rate - (s * g_dot + s_dot * (g - posture))).max() < 4 * ROUNDING
    # From its end on, it is the gait to the bit.
    for time in (T, 1.1 * T, 60.0):
        for value, expected in zip(blend.reference(time), full.reference(time), strict=True):
            assert value.tobytes() == expected.tobytes()


@pytest.mark.parametrize('seed', range(20))
def test_a_posture_is_left_within_the_limits_of_the_joints(seed):
    rng = np.random.default_rng(seed)
    T = shortest_blend(ROBOT)
    target = replace(random_gait(rng), soft_start=T * rng.choice([0.0, 0.01, 0.3, 1.0, 3.0]))
    blend = Blend.of(target, JOINTS, T, random_posture(rng))
    angle, rate = blend.reference(np.linspace(0.0, 2 * T, 2000))
    assert np.abs(angle).max() < ROBOT.joint_limit + ROUNDING
    assert np.abs(rate).max() < ROBOT.joint_rate_limit + 10 * ROUNDING


def test_a_posture_goes_on_through_a_change():
    posture, T, time = random_posture(np.random.default_rng(2)), 1.0, 0.7
    later = Gait(yaw=replace(UNDULATION.yaw, offset=0.2))
    blend = Blend.of(UNDULATION, JOINTS, T, posture).changed(0.4, later)
    s, s_dot = gait.soft_start(np.array(time), T)
    w, w_dot = gait.soft_start(np.array(time - 0.4), T)
    offset = np.array([0.2, 0.0])
    angle, rate = gait.reference(UNDULATION, time, JOINTS)
    expected = (1 - s) * posture + s * angle + w * offset
    assert np.abs(blend.reference(time)[0] - expected).max() < ROUNDING
    expected = s_dot * (angle - posture) + s * rate + w_dot * offset
    assert np.abs(blend.reference(time)[1] - expected).max() < 4 * ROUNDING


@pytest.mark.parametrize(
    'change', [{'amplitude': 0.2}, {'phase_lag': 0.4}, {'phase': 1.0}, {'offset': -0.2}]
)
def test_a_change_ends_at_the_gait_of_the_new_numbers(change):
    later = replace(UNDULATION, yaw=replace(UNDULATION.yaw, **change))
    blend = Blend.of(UNDULATION, JOINTS, 1.5).changed(4.2, later)
    times = np.linspace(5.7, 30.0, 100)
    for values, expected in zip(
        blend.reference(times), gait.reference(later, times, JOINTS), strict=True
    ):
        assert np.abs(values - expected).max() < ROUNDING


@pytest.mark.parametrize('axis', ['yaw', 'pitch'])
def test_another_frequency_keeps_the_phase(axis):
    old, new, T, begin = 1.4, -3.1, 1.5, 40.0
    wave = Wave(amplitude=0.4, angular_frequency=old, phase=0.3)
    blend = Blend.of(Gait(**{axis: wave}), 1, T).changed(
        begin, Gait(**{axis: replace(wave, angular_frequency=new)})
    )
    column = ('yaw', 'pitch').index(axis)
    for time in (begin + T, begin + T + 7.0):
        # The frequency is symmetric about its mean in the blend, then the new one.
        phase = 0.3 + old * begin + (old + new) / 2 * T + new * (time - begin - T)
        angle, rate = blend.reference(time)
        assert abs(angle[0, column] - 0.4 * math.sin(phase)) < ROUNDING
        assert abs(rate[0, column] - 0.4 * new * math.cos(phase)) < 4 * ROUNDING


@pytest.mark.parametrize('begin', [0.7, 13.37, 21.0])
def test_waves_of_another_gait_lie_on_each_other_as_its_phases_say(begin):
    # Pitch stood still before, and runs at twice the frequency of yaw afterward.
    blend = Blend.of(SIDEWINDING, JOINTS, 1.0).changed(begin, UNDULATION)
    blend = blend.changed(begin + 0.4, SINUS_LIFTING).changed(begin + 0.4, SINUS_LIFTING)
    times = begin + np.linspace(1.4, 9.0, 50)
    full = replace(SINUS_LIFTING, soft_start=0.0)
    fade, _ = gait.soft_start(times[:, None, None], SIDEWINDING.soft_start)
    # Yaw keeps its frequency, hence its time; pitch has joined it.
    expected, _ = gait.reference(full, times, JOINTS)
    assert np.abs(blend.reference(times)[0] - fade * expected).max() < ROUNDING


@pytest.mark.parametrize('multiple', [-4, -1, 0, 2, 3])
def test_a_pitch_wave_joins_a_yaw_wave_whose_frequency_changed(multiple):
    old, new, begin, T = 1.4, 0.9, 7.3, 1.5
    yaw, pitch = (replace(wave, angular_frequency=old) for wave in (SINUS_LIFTING.yaw,) * 2)
    pitch = replace(SINUS_LIFTING.pitch, angular_frequency=0.37)
    later = Gait(
        yaw=replace(yaw, angular_frequency=new),
        pitch=replace(pitch, angular_frequency=multiple * new),
    )
    blend = Blend.of(Gait(yaw=yaw, pitch=pitch), JOINTS, T).changed(begin, later)
    times = begin + T + np.linspace(0.0, 9.0, 50)
    # The yaw phase is that of the new gait at another time, new t = old begin + (old + new) T/2 +
    # new (t - begin - T); at this time the new gait is what both waves are.
    since = (old * begin + (old + new) / 2 * T) / new + times - begin - T
    expected, _ = gait.reference(later, since, JOINTS)
    assert np.abs(blend.reference(times)[0] - expected).max() < ROUNDING


def test_frequencies_changed_one_after_the_other_end_as_one_motion():
    yaw, pitch = (
        replace(wave, angular_frequency=2.0) for wave in (SIDEWINDING.yaw, SIDEWINDING.pitch)
    )
    both = Gait(yaw=yaw, pitch=pitch)
    blend = Blend.of(replace(SIDEWINDING, soft_start=0.0), JOINTS, 1.0)
    blend = blend.changed(3.0, replace(SIDEWINDING, yaw=yaw)).changed(7.0, both)
    times = np.linspace(8.0, 12.0, 50)
    # 2 t = the yaw phase, which has been running at 2 rad/s since the middle of its blend.
    late = 3.5 * (1 - SIDEWINDING.yaw.angular_frequency / 2.0)
    expected, _ = gait.reference(both, times - late, JOINTS)
    assert np.abs(blend.reference(times)[0] - expected).max() < ROUNDING


def test_a_wave_that_stood_still_goes_on_where_it_was():
    still = Gait(yaw=replace(UNDULATION.yaw, amplitude=0.0, angular_frequency=0.0))
    blend = Blend.of(UNDULATION, JOINTS, 1.0).changed(5.0, still)
    angle, rate = blend.reference(6.0)
    assert np.abs(angle).max() == np.abs(rate).max() == 0.0
    blend = blend.changed(50.0, UNDULATION)
    # Half a blend of either kind counts: 5.5 s, and from 50.5 s on.
    expected, _ = gait.reference(UNDULATION, 60.0 - 50.5 + 5.5, JOINTS)
    assert np.abs(blend.reference(60.0)[0] - expected).max() < ROUNDING


def test_a_robot_stands_still_after_many_changes():
    still = Gait(yaw=replace(UNDULATION.yaw, amplitude=0.0, angular_frequency=0.0))
    blend = Blend.of(UNDULATION, JOINTS, 1.0)
    for k in range(7):
        bent = replace(UNDULATION, yaw=replace(UNDULATION.yaw, offset=0.013 * k))
        blend = blend.changed(5.0 + 0.1 * k, bent)
    angle, rate = blend.changed(5.9, still).reference(np.linspace(6.9, 8.0, 30))
    assert not angle.any() and not rate.any()


def test_a_soft_start_goes_on_through_a_change():
    blend = Blend.of(SIDEWINDING, JOINTS, 1.0).changed(1.0, UNDULATION)
    s, s_dot = gait.soft_start(np.array(3.0), SIDEWINDING.soft_start)
    angle, rate = gait.reference(UNDULATION, 3.0, JOINTS)
    expected = s * rate + s_dot * angle
    assert np.abs(blend.reference(3.0)[0] - s * angle).max() < ROUNDING
    assert np.abs(blend.reference(3.0)[1] - expected).max() < ROUNDING


def test_arrays_and_single_times_agree_and_the_past_is_forgotten():
    blend = Blend.of(UNDULATION, JOINTS, 1.0)
    for k in range(1000):
        blend = blend.changed(0.02 * k, [SIDEWINDING, SINUS_LIFTING][k % 2])
    assert int(blend.mixture.present[0]) - 1 <= 51
    times = np.array([20.0, 20.4, 33.0])
    angles, rates = blend.reference(times)
    assert angles.shape == rates.shape == (3, JOINTS, 2)
    for k, time in enumerate(times):
        angle, rate = blend.reference(float(time))
        assert np.abs(angle - angles[k]).max() < ROUNDING
        assert np.abs(rate - rates[k]).max() < 4 * ROUNDING


@pytest.mark.parametrize(
    ('axis', 'wave', 'sentence'),
    [
        ('yaw', {'amplitude': 0.8}, 'gait.yaw.amplitude must be within +-0.7854 rad, got 0.8 rad'),
        (
            'pitch',
            {'amplitude': 0.4, 'angular_frequency': -10.0},
            'gait.pitch.angular_frequency must be within +-9.49 rad/s with an amplitude of '
            '0.4 rad, got -10 rad/s',
        ),
        (
            'yaw',
            {'amplitude': -0.5, 'offset': 0.3},
            'amplitude plus offset of gait.yaw must be within the joint limit, +-0.7854 rad, '
            'got 0.8 rad',
        ),
    ],
)
def test_gaits_that_joints_cannot_follow_are_refused(axis, wave, sentence):
    with pytest.raises(ParameterError) as refused:
        check_limits(Gait(**{axis: Wave(**wave)}), ROBOT)
    assert str(refused.value) == sentence

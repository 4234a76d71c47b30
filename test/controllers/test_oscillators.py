# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Oscillators in closed form: amplitudes, phase differences, and gaits that change."""

from dataclasses import replace
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from snake_sim_ros import (
    CentralPatternGenerator,
    Gait,
    load_scene,
    ParameterError,
    Robot,
    Rolling,
    run,
    Scene,
    Sidewinding,
    Start,
    Wave,
)
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.posture import initial_angles

GAIN, COUPLING, PERIOD = 6.0, 3.0, 0.02
YAW = Wave(amplitude=0.4, angular_frequency=2.0, phase_lag=-0.8, phase=0.3)


def generator(scene, **values):
    made = CentralPatternGenerator(**{'coupling': COUPLING, 'gain': GAIN, **values})
    made.start(scene)
    return made


def angles(made, seconds, begin=0.0, places=5):
    """Return times (m,) and what the generator commands, (m, n-1, 2) [rad], [rad/s]."""
    parts = []
    for k in range(round(seconds / PERIOD)):
        time = begin + k * PERIOD
        times = time + PERIOD * np.arange(places) / places
        parts.append((times, *made.control(None, time)(times)))
    return tuple(map(np.concatenate, zip(*parts, strict=True)))


def test_amplitudes_are_critically_damped():
    waves = Gait(yaw=YAW, pitch=replace(YAW, amplitude=-0.1, offset=0.05))
    straight = Start(yaw=0.0, pitch=0.0)
    times, angle, rate = angles(generator(Scene(gait=waves, start=straight)), 3.0)
    # r = R (1 - (1 + a t/2) exp(-a t/2)): the phases are those of the gait from the beginning.
    decay, slope = np.exp(-GAIN * times / 2), (GAIN / 2) ** 2 * times * np.exp(-GAIN * times / 2)
    share = (1 - (1 + GAIN * times / 2) * decay)[:, None, None]
    full, fast = gait.reference(waves, times, 10)
    # Runge and Kutta with 20 ms: (a h/2)^5/120 a step; cubic between: 1e-6 and, in rates, 1e-4.
    assert np.abs(angle - share * full).max() < 1e-6
    assert np.abs(rate - share * fast - slope[:, None, None] * full).max() < 1e-4


def test_it_begins_at_rest_where_the_robot_is():
    for start in (Start(), Start(yaw=0.2)):
        scene = Scene(gait=Gait(yaw=YAW), start=start)
        _, angle, rate = angles(generator(scene), PERIOD)
        assert np.abs(angle[0] - initial_angles(scene)).max() < 1e-15
        assert np.abs(rate[0]).max() < 1e-12


def test_a_phase_difference_decays_as_that_of_two_oscillators():
    two = Robot(link_count=3)
    made = generator(Scene(robot=two, gait=Gait(yaw=YAW)))
    angles(made, 6.0)  # r is R to 1e-7
    made.change(Gait(yaw=replace(YAW, phase_lag=0.9)))
    difference = np.diff(made.phase[:, 0])[0]
    angles(made, 0.4)

    def slope(t, psi):
        # psi' = -2 w sin(psi - phi), as phi goes from -0.8 to 0.9 like an amplitude.
        phi = 0.9 - 1.7 * (1 + GAIN * t / 2) * math.exp(-GAIN * t / 2)
        return -2 * COUPLING * np.sin(psi - phi)

    wanted = solve_ivp(slope, (0.0, 0.4), [difference], rtol=1e-10, atol=1e-12).y[0, -1]
    assert np.diff(made.phase[:, 0])[0] == pytest.approx(wanted, abs=1e-6)


def test_it_converges_to_the_gait_from_any_gait():
    made = generator(Scene(gait=Rolling().gait(10)))
    times, angle, rate = angles(made, 4.0)
    target = Sidewinding().gait(10)
    made.change(target)
    later, after, rate_after = angles(made, 60.0, begin=4.0)
    # No jump, and rates that are the derivatives.
    angle, rate = np.concatenate([angle, after]), np.concatenate([rate, rate_after])
    times = np.concatenate([times, later])
    h = times[1] - times[0]
    slope = (angle[2:] - angle[:-2]) / (2 * h)
    assert np.abs(slope - rate[1:-1]).max() < 2e-3  # h^2/6 of a third derivative below 700 rad/s^3
    assert np.abs(np.diff(rate, axis=0)).max() < 0.1
    # But for a common phase, which the shape does not fix, the motion is that of the gait. Its
    # slowest part is that of ten pitch oscillators, w r/R 2 (1 - cos(pi/10)) = 0.1/s: exp(-6).
    off = made.phase - gait_phase(target)
    assert np.abs(np.angle(np.exp(1j * (off - off[0, 0])))).max() < 5e-3
    assert np.abs(after[-1200:]).max(axis=0) == pytest.approx(
        np.broadcast_to([math.radians(30), math.radians(10)], (10, 2)), rel=0.02
    )


def gait_phase(given):
    joints = np.arange(10)
    waves = given.yaw, given.pitch
    return np.stack([wave.phase + wave.phase_lag * joints for wave in waves], axis=1)


def test_a_robot_undulates_by_oscillators():
    free = run('lateral_undulation', duration=6.0)
    driven = run('lateral_undulation', controller=CentralPatternGenerator(), duration=6.0)
    # The amplitude grows from 0 in a second.
    assert driven.distance == pytest.approx(free.distance, rel=0.15)
    again = run('lateral_undulation', controller=CentralPatternGenerator(), duration=6.0)
    assert (driven.position == again.position).all()


@pytest.mark.parametrize(
    ('values', 'sentence'),
    [
        ({'gain': 0.0}, 'gain must be above 0 and finite, got 0.0'),
        ({'coupling': math.nan}, 'coupling must be above 0 and finite, got nan'),
        ({'period': -1}, 'period must be above 0 and finite, got -1'),
    ],
)
def test_numbers_that_cannot_be_are_refused(values, sentence):
    with pytest.raises(ParameterError) as caught:
        CentralPatternGenerator(**values)
    assert str(caught.value) == sentence


def test_gaits_without_waves_are_refused():
    with pytest.raises(ParameterError, match='oscillators have waves, the gait has a table'):
        generator(load_scene('concertina'))
    fast = Gait(yaw=Wave(amplitude=0.7, angular_frequency=9.0))
    with pytest.raises(ParameterError, match=r'gait\.yaw\.angular_frequency must be within'):
        generator(Scene(gait=fast))

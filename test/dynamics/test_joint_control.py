# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The PD law at the four places in the time step where it may act, and at a predicted end."""

import numpy as np
import pytest
from random_states import EPS

from snake_sim_ros.dynamics.joint_control import (
    AVERAGE,
    END,
    implicit_pd_law,
    MIDPOINT,
    pd_law,
    START,
)
from snake_sim_ros.scene.parameters import PD_SCHEMES

# Torques up to 800 N m from a dozen operations, each wrong by eps/2.
ROUNDING = 800 * 6 * EPS


def law(K_p, K_d, angle, rate, angle_reference, rate_reference):
    """Return T = -K_p (alpha - alpha_ref) - K_d (alphadot - alphadot_ref) [N m]."""
    return -K_p * (angle - angle_reference) - K_d * (rate - rate_reference)


@pytest.fixture(params=range(20))
def case(request):
    """Random time step, coordinates at start and middle, reference at the middle, and gains."""
    rng = np.random.default_rng(request.param)
    dt = rng.uniform(1e-4, 1e-2)
    start, mid, reference = (tuple(rng.uniform(-1, 1, 2) * [0.7, 5.0]) for _ in range(3))
    return dt, start, mid, reference, rng.uniform(10, 800), rng.uniform(0, 2)


def test_names_are_in_the_order_of_the_numbers():
    assert [PD_SCHEMES[number] for number in (START, MIDPOINT, AVERAGE, END)] == [
        'start',
        'midpoint',
        'average',
        'end',
    ]


def test_start(case):
    dt, start, mid, (angle, rate), K_p, K_d = case
    # All at t_A, where the reference still was dt/2 rate less.
    expected = law(K_p, K_d, *start, angle - dt / 2 * rate, rate)
    torque, damping = pd_law(START, dt, start, mid, (angle, rate), (K_p, K_d))
    assert abs(torque - expected) < ROUNDING
    assert damping == 0.0


def test_midpoint(case):
    dt, start, mid, reference, K_p, K_d = case
    # Angle in q_M, rate with u_A, reference at t_M.
    torque, damping = pd_law(MIDPOINT, dt, start, mid, reference, (K_p, K_d))
    assert abs(torque - law(K_p, K_d, *mid, *reference)) < ROUNDING
    assert damping == 0.0


def test_average(case):
    dt, start, mid, reference, K_p, K_d = case
    # The mean of start and end, linear in the rate at the end; the reference is at t_M:
    # alpha_A = alpha_M - dt/2 alphadot_A, alpha_E = alpha_M + dt/2 alphadot_E.
    for rate_end in (-3.0, 0.0, 2.0):
        angle_mean = (mid[0] - dt / 2 * mid[1] + mid[0] + dt / 2 * rate_end) / 2
        expected = law(K_p, K_d, angle_mean, (mid[1] + rate_end) / 2, *reference)
        torque, damping = pd_law(AVERAGE, dt, start, mid, reference, (K_p, K_d))
        assert abs(torque - damping * rate_end - expected) < ROUNDING
    # The configuration at the start has no part in it, but for the rate.
    assert pd_law(AVERAGE, dt, (99.0, 99.0), mid, reference, (K_p, K_d)) == (torque, damping)


@pytest.mark.parametrize(('scheme', 'share'), [(AVERAGE, 0.5), (END, 1.0)])
def test_implicit_schemes_take_a_joint_to_where_it_should_be(scheme, share):
    # A joint without anything else, J (w_E - w_A)/dt = torque - damping w_E: its momentum changes
    # by the mean of the forces at start and end for `average`, the trapezoidal rule, and by that
    # at the end for `end`. Angles move with the mean rate of the step.
    J, K_p, K_d, dt, angle, rate = 5e-4, 40.0, 0.2, 1e-3, 0.1, 2.0
    mid = angle + dt / 2 * rate
    torque, damping = pd_law(scheme, dt, (angle, rate), (mid, rate), (0.0, 0.0), (K_p, K_d))
    rate_end = (J * rate + dt * torque) / (J + dt * damping)
    angle_end = mid + dt / 2 * rate_end
    force = -K_p * (share * angle_end + (1 - share) * angle)
    force -= K_d * (share * rate_end + (1 - share) * rate)
    # Both are sums of a dozen numbers up to 5 N m, each wrong by eps/2.
    assert abs(J * (rate_end - rate) / dt - force) < 5 * 12 * EPS


def test_the_law_at_a_predicted_end(case):
    dt, (angle, rate), _, reference, K_p, K_d = case
    # All at the end, of which the angle moves with the rate: alpha = alpha* + h (w - w*). For the
    # predicted rate itself it is the law as it stands.
    for held in (0.0, 0.7):
        torque, damping = implicit_pd_law(dt, angle - dt * rate, reference, (K_p, K_d), held)
        for rate_end in (-3.0, 0.0, 2.0, rate):
            expected = held + law(K_p, K_d, angle + dt * (rate_end - rate), rate_end, *reference)
            assert abs(torque - damping * rate_end - expected) < ROUNDING


def test_end(case):
    dt, start, mid, (angle, rate), K_p, K_d = case
    torque, damping = pd_law(END, dt, start, mid, (angle, rate), (K_p, K_d))
    # All at t_E, linear in the rate there: alpha_E = alpha_M + dt/2 alphadot_E.
    for rate_end in (-3.0, 0.0, 2.0):
        angle_end = mid[0] + dt / 2 * rate_end
        expected = law(K_p, K_d, angle_end, rate_end, angle + dt / 2 * rate, rate)
        assert abs(torque - damping * rate_end - expected) < ROUNDING
    # The rate at the start has no part in it.
    other = pd_law(END, dt, start, (mid[0], 99.0), (angle, rate), (K_p, K_d))
    assert other == (torque, damping)


@pytest.mark.parametrize('scheme', [START, MIDPOINT])
def test_a_joint_on_its_reference_feels_nothing(scheme):
    # alpha = alpha_ref and alphadot = alphadot_ref at the instant that counts.
    dt, angle, rate = 2.0**-12, 0.25, 0.5
    start, mid = (angle - dt / 2 * rate, rate), (angle, rate)
    assert pd_law(scheme, dt, start, mid, (angle, rate), (800.0, 0.2)) == (0.0, 0.0)


@pytest.mark.parametrize('scheme', [AVERAGE, END])
def test_a_joint_that_stays_on_its_reference_feels_nothing(scheme):
    # The rate at the end, too, is that of the reference.
    dt, angle, rate = 2.0**-12, 0.25, 0.5
    start, mid = (angle - dt / 2 * rate, rate), (angle, rate)
    torque, damping = pd_law(scheme, dt, start, mid, (angle, rate), (800.0, 0.2))
    assert abs(torque - damping * rate) < ROUNDING

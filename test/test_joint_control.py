"""The PD law at the three places in the time step where it may act."""

import numpy as np
import pytest
from random_states import EPS

from snake_sim_ros.joint_control import END
from snake_sim_ros.joint_control import MIDPOINT
from snake_sim_ros.joint_control import pd_law
from snake_sim_ros.joint_control import START
from snake_sim_ros.parameters import PD_SCHEMES

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
    assert [PD_SCHEMES[number] for number in (START, MIDPOINT, END)] == [
        'start',
        'midpoint',
        'end',
    ]


def test_start(case):
    dt, start, mid, (angle, rate), K_p, K_d = case
    # All at t_A, where the reference still was dt/2 rate less.
    expected = law(K_p, K_d, *start, angle - dt / 2 * rate, rate)
    torque, damping = pd_law(START, dt, start, mid, (angle, rate), K_p, K_d)
    assert abs(torque - expected) < ROUNDING
    assert damping == 0.0


def test_midpoint(case):
    dt, start, mid, reference, K_p, K_d = case
    # Angle in q_M, rate with u_A, reference at t_M.
    torque, damping = pd_law(MIDPOINT, dt, start, mid, reference, K_p, K_d)
    assert abs(torque - law(K_p, K_d, *mid, *reference)) < ROUNDING
    assert damping == 0.0


def test_end(case):
    dt, start, mid, (angle, rate), K_p, K_d = case
    torque, damping = pd_law(END, dt, start, mid, (angle, rate), K_p, K_d)
    # All at t_E, linear in the rate there: alpha_E = alpha_M + dt/2 alphadot_E.
    for rate_end in (-3.0, 0.0, 2.0):
        angle_end = mid[0] + dt / 2 * rate_end
        expected = law(K_p, K_d, angle_end, rate_end, angle + dt / 2 * rate, rate)
        assert abs(torque - damping * rate_end - expected) < ROUNDING
    # The rate at the start has no part in it.
    other = pd_law(END, dt, start, (mid[0], 99.0), (angle, rate), K_p, K_d)
    assert other == (torque, damping)


@pytest.mark.parametrize('scheme', [START, MIDPOINT])
def test_a_joint_on_its_reference_feels_nothing(scheme):
    # alpha = alpha_ref and alphadot = alphadot_ref at the instant that counts.
    dt, angle, rate = 2.0**-12, 0.25, 0.5
    start, mid = (angle - dt / 2 * rate, rate), (angle, rate)
    assert pd_law(scheme, dt, start, mid, (angle, rate), 800.0, 0.2) == (0.0, 0.0)

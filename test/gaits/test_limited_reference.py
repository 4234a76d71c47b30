# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""References that move no faster than joints may, and joints that stay within their limits."""

import numpy as np
import pytest

from snake_sim_ros import Simulation
from snake_sim_ros.gaits.joint_reference import LimitedReference, start_posture
from snake_sim_ros.nodes.sim_parameters import as_it_runs, Settings
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.stepping.sampling import joint_motion

PERIOD, STEPS, LIMIT = 0.005, 20, 10.0
TIMES = PERIOD / STEPS * (np.arange(STEPS) + 0.5)


def held(angle):
    """Return references of a period that hold angles, shape (n-1, 2)."""
    return np.repeat(np.asarray(angle)[None], STEPS, axis=0), np.zeros((STEPS, 1, 2))


def limited(limiter, k, angle):
    """Return the references of period k that hold an angle of yaw, with a limit."""
    told = held([[angle, 0.0]])
    return limiter.limited(k * PERIOD + TIMES, *told, period=PERIOD, limit=LIMIT), told


def test_references_within_the_limit_are_left_as_they_are():
    limiter = LimitedReference(np.zeros((1, 2)))
    for k in range(20):  # as a gait without rates steps: 9 rad/s
        found, told = limited(limiter, k, 0.045 * (k % 2))
        assert found[0] is told[0] and found[1] is told[1]
    assert limiter.count == 0


def test_a_jump_is_led_at_the_limit_and_ends_where_it_was_told():
    limiter = LimitedReference(np.zeros((1, 2)))
    found = [limited(limiter, k, 0.7)[0] for k in range(20)]
    angle, rate = (np.concatenate(part)[:, 0, 0] for part in zip(*found, strict=True))
    assert np.diff(angle).max() <= LIMIT * PERIOD / STEPS * (1 + 1e-9)
    on_the_way = angle < 0.7 - 1e-9
    assert (rate[on_the_way] == LIMIT).all() and not rate[~on_the_way].any()
    # 0.7 rad at 10 rad/s
    assert on_the_way.sum() == pytest.approx(0.07 / PERIOD * STEPS, abs=1)
    assert limiter.count == 1


def test_a_start_elsewhere_is_no_jump():
    limiter = LimitedReference(np.zeros((1, 2)))
    limiter.start(np.array([[0.7, 0.0]]), 0.0)
    found, told = limited(limiter, 0, 0.7)
    assert found[0] is told[0]


@pytest.mark.parametrize('method', ['newton', 'bdf2'])
@pytest.mark.parametrize('half', [1, 28])  # periods; 28 is a whole swing at the limit
def test_commands_alone_keep_joints_within_their_limits(method, half):
    scene = as_it_runs(Settings(), load_scene('lateral_undulation'), ())
    given = {'method': method, 'level': 'spatial'}
    if method == 'bdf2':
        given['dt'] = PERIOD
    scene = with_settings(scene, given)
    simulation, count = Simulation(scene), round(PERIOD / scene.dt)
    limiter, robot = LimitedReference(start_posture(scene).angle), scene.robot
    angles, rates, turns = [], [], []
    for k in range(80):
        # All axes to one side and then to the other, as far as they go.
        told = np.full((count, 10, 2), 0.7 * (-1) ** (k // half))
        reference = limiter.limited(
            simulation.midpoints(count), told, np.zeros_like(told),
            period=PERIOD, limit=robot.joint_rate_limit,
        )  # fmt: skip
        report = simulation.advance(*reference)
        assert not report.failure
        angle, rate = joint_motion(
            simulation.scene.robot, simulation.state.q[None], simulation.state.u[None]
        )
        angles.append(np.abs(angle).max())
        rates.append(np.abs(rate).max())
        turns.append(scene.dt * np.linalg.norm(simulation.state.u[:, 3:], axis=1).max())
    # A stop ends a motion at the end of a step. Rates are held in axes of before the step, which
    # turn with both links of a joint.
    assert max(angles) <= robot.joint_limit + robot.joint_rate_limit * scene.dt
    bound = robot.joint_rate_limit * (1 + 2 * np.maximum(turns, np.roll(turns, 1)))
    assert (rates <= bound).all()
    assert simulation.report.penetration_max < 1e-3 or half > 1

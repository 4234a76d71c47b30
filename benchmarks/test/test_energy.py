# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The balance of energy: closed forms, and that a step leaves over what its order says."""

from dataclasses import replace

import numpy as np
import pytest

from snake_sim_benchmarks.energy import balance_error, BALANCE_TIME, mechanical_energy
from snake_sim_ros import Scene, Simulation
from snake_sim_ros.scene.parameters import load_scene, steps_in
from snake_sim_ros.stepping.sampling import Keep
from snake_sim_ros.stepping.simulation import sample
from snake_sim_ros.stepping.state import initial_state


def test_energy_of_a_falling_robot():
    scene, state = Scene(), initial_state(Scene())
    u = np.tile([0.0, 0.0, -2.0, 0.0, 0.0, 0.0], (11, 1))
    rest = mechanical_energy(scene, state.q, 0 * u)
    # All centers are a radius above the floor; 7.5 kg.
    assert rest == pytest.approx(7.5 * 9.81 * 0.0525)
    assert mechanical_energy(scene, state.q, u) - rest == pytest.approx(7.5 * 2.0)


def test_work_of_a_torque_is_no_error():
    # A robot that hangs in the air without gravity and takes up what its joint does.
    scene = replace(Scene(), gravity=(0.0, 0.0, 0.0))
    state = initial_state(scene)
    torque = np.zeros((1, 10, 2))
    q, u = np.array([state.q] * 2), np.array([state.u] * 2)
    u[1, 1:, 5] = 0.2
    u[1, 0, 4], u[1, 1:, 4] = -0.1, 0.1
    rates = 0.5 * 0.2
    torque[0, 0, 0] = (mechanical_energy(scene, q[1], u[1]) - 0.0) / (scene.dt * rates)
    assert balance_error(scene, q, u, np.zeros((1, 22, 3)), torque) == pytest.approx(0, abs=1e-12)


def energy_error(scene):
    """Return `balance_error` of the first BALANCE_TIME seconds of a scene."""
    steps = steps_in(BALANCE_TIME, scene.dt, 'duration')
    run = sample(Simulation(scene), 1, steps, keep=Keep(impulses=True))
    assert not run.report.failure
    impulse, torque = run.impulse[1:, :, :3], scene.robot.by_joint(run.joint_torque[1:])
    return balance_error(scene, run.coordinates, run.velocity, impulse, torque)


@pytest.mark.parametrize('case', ['lateral_undulation', 'sidewinding'])
def test_energy_left_over_is_of_first_order(case):
    # Fitted over four halvings of the step; a fifth is left to impacts, which come at other times,
    # and to contacts that are moved to the floor then.
    scene, steps = replace(load_scene(case), level='spatial'), 1 / (1000 * 2.0 ** np.arange(5))
    errors = [energy_error(replace(scene, dt=dt)) for dt in steps]
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(1.0, abs=0.2)

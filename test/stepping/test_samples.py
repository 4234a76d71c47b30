# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Samples that loops keep are those of calls from one sample to the next, bit for bit."""

from dataclasses import replace

import numpy as np
import pytest

from snake_sim_ros import ParameterError, Pegs, Scene, Simulation, Solver
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.stepping.contact_forces import contact_forces
from snake_sim_ros.stepping.methods import METHODS
from snake_sim_ros.stepping.samples import make_samples, Samples
from snake_sim_ros.stepping.simulation import sample, simulate
from snake_sim_ros.stepping.trajectory import OF_CONTACTS, OF_SAMPLES

CASE_A, CASE_C = load_scene('lateral_undulation'), load_scene('sidewinding')
# Flat, lifting, rolling and among obstacles; a gait of pitch joints changes level `auto`.
SCENES = {
    'flat': CASE_A,
    'lifting': CASE_C,
    'changing levels': with_settings(CASE_A, {'settling_time': 0.01}),
    'rolling': with_settings(CASE_A, {'friction.rolling': 0.02}),
    'pegs': replace(CASE_A, pegs=Pegs(x=(0.05,), y=(0.09,), radius=0.02, friction=0.3)),
}
# Which samples are kept is not a matter of how far sweeps got.
FEW_SWEEPS = Solver(iteration_limit=100)


def assert_same(one, other):
    for name in (*OF_SAMPLES, *OF_CONTACTS):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), name)


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('name', ['flat', 'lifting'])
def test_a_run_in_one_call_has_the_samples_of_a_run_in_many(method, name):
    few = method == 'paper'
    dt = 1 / 200 if method == 'bdf2' else 1 / 4000
    scene = replace(SCENES[name], method=method, dt=dt, duration=0.01 if few else 0.1)
    scene = replace(scene, solver=FEW_SWEEPS)
    seen = []
    rate = 200.0 if few else 40.0
    whole = simulate(scene, rate=rate)
    single = simulate(scene, rate=rate, observe=lambda simulation: seen.append(simulation.time))
    assert_same(whole, single)
    assert seen == pytest.approx(whole.time.tolist())
    assert len(whole.time) == round(scene.duration * rate) + 1


@pytest.mark.parametrize('method', ['newton', 'bdf2'])
@pytest.mark.parametrize('name', SCENES)
def test_samples_and_forces_are_those_of_the_states(method, name):
    steps, count = 3, 20
    scene = replace(SCENES[name], method=method, dt=1 / 1000)
    simulation, other = Simulation(scene), Simulation(scene)
    angle, rate = simulation.gait_reference(steps * count)
    if name == 'changing levels':
        angle[25:27, 0, 1] = 0.003
    samples = make_samples(scene, steps, count)
    simulation.advance(angle, rate, samples)
    levels = set()
    for k in range(count):
        part = slice(steps * k, steps * (k + 1))
        other.advance(angle[part], rate[part])
        assert (samples.q[k] == other.state.q).all() and (samples.u[k] == other.state.u).all()
        assert (samples.impulse[k] == other.history.impulse).all()
        assert (samples.torque[k] == other.last.joint_torque).all()
        assert samples.is_planar[k] == (other.last.level == 'planar')
        levels.add(other.last.level)
    assert name != 'changing levels' or levels == {'planar', 'spatial'}
    start = sample(Simulation(scene), steps, 0)
    assert len(start.time) == 1


def test_forces_of_all_samples_are_those_of_each():
    scene = with_settings(load_scene('obstacle_aided'), {'dt': 1 / 1000, 'duration': 4.0})
    found = []

    def note(simulation):
        found.append(contact_forces(simulation.scene, simulation.state, simulation.history))

    trajectory = simulate(scene, rate=50.0, observe=note)
    assert (trajectory.contact_number >= 22).any()
    for k, (points, forces) in enumerate(found):
        here, loads = trajectory.contacts(k)
        np.testing.assert_array_equal(here, points)
        np.testing.assert_array_equal(loads, forces)


def test_samples_after_some_steps_are_the_rest_in_the_same_memory():
    samples = make_samples(Scene(), 4, 5)
    assert [samples.reached_by(steps) for steps in (0, 3, 4, 7, 8, 19, 20, 100)] == [
        0, 0, 1, 1, 2, 4, 5, 5,
    ]  # fmt: skip
    rest = samples.after(6)
    assert (rest.first, len(rest.q)) == (2, 4)
    rest.q[0] = 1.0
    assert (samples.q[1] == 1.0).all()
    assert len(samples.after(20).q) == 0


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('level', ['planar', 'spatial'])
def test_steps_beyond_the_last_sample_write_nowhere(method, level):
    scene = replace(CASE_A, method=method, level=level, dt=1 / 1000, solver=FEW_SWEEPS)
    simulation = Simulation(scene)
    behind = make_samples(scene, 2, 5)
    samples = Samples(2, 2, *(array[:2] for array in behind[2:]))
    simulation.advance(*simulation.gait_reference(12), samples)
    assert (samples.span > 0.0).all() and samples.q[:, :, 3:].any(axis=-1).all()
    for array in behind[2:]:
        assert not array[2:].any()


def test_samples_of_another_scene_are_refused():
    simulation = Simulation(CASE_A)
    reference = simulation.gait_reference(2)
    wrong = make_samples(with_settings(CASE_A, {'robot.link_count': 5}), 1, 2)
    with pytest.raises(ParameterError, match=r'samples\.q must be an array \(2, 11, 7\)'):
        simulation.advance(*reference, wrong)
    with pytest.raises(ParameterError, match='samples must be one step apart or more'):
        simulation.advance(*reference, make_samples(CASE_A, 0, 2))


def test_a_run_that_diverges_keeps_the_samples_before():
    scene = with_settings(CASE_C, {'method': 'newton', 'pd_scheme': 'start', 'dt': 1 / 500})
    whole = simulate(scene, rate=50.0)
    single = simulate(scene, rate=50.0, observe=lambda simulation: None)
    assert whole.report.failure == single.report.failure
    assert whole.report.failure.startswith('t = ')
    assert_same(whole, single)

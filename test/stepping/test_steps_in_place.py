# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Calls of a few steps in memory that stays: the same bits as by any other call."""

from dataclasses import astuple, replace

import numpy as np
import pytest
from scenes import references, same_bits

from snake_sim_ros import ParameterError, Simulation, State
from snake_sim_ros.dynamics.compilation import watched
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.stepping.methods import make_stepper, METHODS
from snake_sim_ros.stepping.samples import make_samples
from snake_sim_ros.stepping.simulation import GaitAhead

CASE_A, CASE_C = load_scene('lateral_undulation'), load_scene('sidewinding')
SAMPLES = make_samples(CASE_A, 2, 1)
each_method = pytest.mark.parametrize('method', METHODS)


def some_by_some(simulation, angle, rate, count=1, samples=None):
    """Take steps, some in a call, in slices that are views; return how many went on in place."""
    in_place = 0
    for k in range(0, len(angle), count):
        before = simulation._in_place
        kept = samples if samples and k < samples.every * len(samples.span) else None
        simulation.advance(angle[k : k + count], rate[k : k + count], kept, k)
        in_place += count if before is not None and simulation._in_place is before else 0
        if simulation.last.failure:
            break
    return in_place


def are_same(one, other):
    """Check that two simulations are in the same state, and have had the same steps."""
    assert (one.state.q == other.state.q).all() and (one.state.u == other.state.u).all()
    assert same_bits(one.history, other.history)
    reports = [astuple(replace(found.report, left='')) for found in (one, other)]
    assert all(map(np.array_equal, *reports))


def both(scene, angle, rate, count=1):
    """Return simulations after the same steps, some by some and all at once, and the share."""
    single, whole = Simulation(scene), Simulation(scene)
    in_place = some_by_some(single, angle, rate, count)
    whole.advance(angle, rate)
    return single, whole, in_place / len(angle)


def lifted(scene, steps, lifts):
    """Return joint references in which a pitch joint is commanded to lift in some steps."""
    angle, rate = references(scene, steps)
    for first, last in lifts:
        angle[first:last, 4, 1] = 0.003
    return angle, rate


@pytest.mark.parametrize('count', [1, 5])
@each_method
@pytest.mark.parametrize('level', ['planar', 'spatial', 'auto'])
def test_some_steps_in_each_call_are_the_steps_of_one_call(method, level, count):
    steps = 60 * count
    settings = {'method': method, 'level': level, 'dt': 1e-3, 'solver.iteration_limit': 50}
    scene = with_settings(CASE_A, settings)
    single, whole, share = both(scene, *references(scene, steps), count)
    are_same(single, whole)
    if method in ('newton', 'bdf2') or level == 'spatial':
        assert share > 0.9


@pytest.mark.parametrize(('count', 'every'), [(1, 1), (6, 2), (5, 5)])
@each_method
@pytest.mark.parametrize('level', ['planar', 'spatial', 'auto'])
def test_samples_are_those_of_one_call(method, level, count, every):
    settings = {'level': level, 'settling_time': 0.02, 'solver.iteration_limit': 50}
    scene = with_settings(CASE_A, {'method': method, 'dt': 1e-3, **settings})
    lifts = [(50, 56)] if level == 'auto' else []
    angle, rate = lifted(scene, 120, lifts)
    single, whole = Simulation(scene), Simulation(scene)
    # The last steps have no samples any more.
    found, wanted = (make_samples(scene, every, 110 // every) for _ in range(2))
    share = some_by_some(single, angle, rate, count, found) / 120
    whole.advance(angle, rate, wanted)
    are_same(single, whole)
    assert all(map(np.array_equal, found, wanted))
    assert found.is_planar.any() == (level != 'spatial' and METHODS[method].planar is not None)
    if method in ('newton', 'bdf2') or level == 'spatial':
        assert share > 0.5


def test_samples_and_none_of_them_take_turns():
    scene = with_settings(CASE_A, {'dt': 1e-3})
    angle, rate = references(scene, 60)
    mixed, whole = Simulation(scene), Simulation(scene)
    for k in range(0, 60, 2):
        samples = SAMPLES if k // 8 % 2 else None
        some_by_some(mixed, angle[k : k + 2], rate[k : k + 2], 2, samples)
    whole.advance(angle, rate)
    are_same(mixed, whole)
    assert (SAMPLES.u[0] == whole.state.u).all()


def test_samples_of_another_scene_are_refused_without_a_step():
    simulation = Simulation(CASE_A)
    angle, rate = references(CASE_A, 5)
    some_by_some(simulation, angle, rate, 1, make_samples(CASE_A, 1, 5))
    other = make_samples(with_settings(CASE_A, {'robot.link_count': 5}), 1, 1)
    with pytest.raises(ParameterError, match=r'samples\.q must be an array \(1, 11, 7\)'):
        simulation.advance(angle[:1], rate[:1], other)
    assert simulation.step_count == 5


@pytest.mark.parametrize('count', [1, 4])
@pytest.mark.parametrize('method', ['newton', 'bdf2'])
def test_the_level_changes_in_the_same_steps(method, count):
    scene = with_settings(CASE_A, {'method': method, 'dt': 1e-3, 'settling_time': 0.03})
    lifts = [(40, 43), (130, 160), (200, 201), (203, 204)]
    single, whole, share = both(scene, *lifted(scene, 300, lifts), count)
    are_same(single, whole)
    assert 50 < single.report.planar_steps < 230
    assert share > (0.8 if count == 1 else 0.5)  # calls in which the level changes are not
    assert bool(single.last.left) == (single.last.level == 'spatial')


@pytest.mark.parametrize('method', METHODS)
def test_a_robot_that_lifts_itself_goes_on_in_place(method):
    scene = with_settings(CASE_C, {'method': method, 'dt': 1e-3, 'solver.iteration_limit': 20})
    single, whole, share = both(scene, *references(scene, 60))
    are_same(single, whole)
    assert share > 0.9


@pytest.mark.parametrize('count', [1, 8])
@pytest.mark.parametrize('method', ['newton', 'bdf2'])
def test_a_roll_that_leaves_the_plane_is_the_same(method, count):
    # The gait turns so fast that the contacts slip by rolling, and the robot goes to space.
    wild = {'gait.yaw.amplitude': 0.9, 'gait.yaw.angular_frequency': 12.0, 'gait.soft_start': 0.1}
    scene = with_settings(CASE_A, {'method': method, 'dt': 1e-3, **wild})
    single, whole, share = both(scene, *references(scene, 400), count)
    are_same(single, whole)
    assert 0 < single.report.planar_steps < 400
    assert share > 0.8  # also in the pause at the spatial level


@pytest.mark.parametrize('level', ['spatial', 'auto'])
@pytest.mark.parametrize('method', ['newton', 'bdf2'])
def test_a_step_that_diverges_keeps_the_last_good_state(method, level):
    scene = with_settings(CASE_A, {'method': method, 'level': level, 'dt': 1e-3})
    angle, rate = references(scene, 20)
    rate[12] = 1e9
    single, whole, _ = both(scene, angle, rate)
    assert (single.last.steps, single.last.contacts) == (0, 0)  # of a call without a good step
    single.report.contacts = whole.report.contacts
    are_same(single, whole)
    assert single.step_count == single.report.steps < 20
    assert single.report.failure == whole.report.failure != ''


@pytest.mark.parametrize('level', ['planar', 'spatial', 'auto'])
def test_who_looks_changes_nothing_and_who_writes_is_heard(level):
    scene = with_settings(CASE_A, {'level': level, 'dt': 1e-3})
    angle, rate = references(scene, 30)
    watched, alone = Simulation(scene), Simulation(scene)
    for k in range(30):
        some_by_some(watched, angle[k : k + 1], rate[k : k + 1])
        assert watched.state is watched.state
        assert watched.history is watched.history
    some_by_some(alone, angle, rate)
    are_same(watched, alone)
    # Velocities that are written into the arrays of the state are those of the next step.
    for k in (0, 1):
        simulation = (watched, alone)[k]
        u = simulation.state.u.copy()
        u[:, 0] += 0.01
        if k:
            simulation.state = State(simulation.state.q, u)
        else:
            simulation.state.u[:] = u
        simulation.advance(angle[:1], rate[:1])
    are_same(watched, alone)
    untouched = Simulation(scene)
    some_by_some(untouched, np.concatenate([angle, angle[:1]]), np.concatenate([rate, rate[:1]]))
    assert (watched.state.u != untouched.state.u).any()


def test_single_steps_come_between_others():
    scene = with_settings(CASE_A, {'dt': 1e-3})
    angle, rate = references(scene, 40)
    mixed, whole = Simulation(scene), Simulation(scene)
    for first, last in ((0, 1), (1, 2), (2, 3), (3, 10), (10, 11), (11, 12), (12, 13), (13, 40)):
        mixed.advance(angle[first:last], rate[first:last])
    whole.advance(angle, rate)
    are_same(mixed, whole)
    mixed.reset()
    whole.reset()
    some_by_some(mixed, angle, rate)
    whole.advance(angle, rate)
    assert (mixed.state.q == whole.state.q).all()


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        (lambda angle: angle[0], 'angle must be an array of shape'),
        (lambda angle: angle[:, :-1], 'angle must be an array of shape'),
        (lambda angle: angle.astype(np.float32), 'angle must be an array of shape'),
        (lambda angle: angle.tolist(), 'angle must be an array of shape'),
    ],
)
def test_references_of_another_form_are_refused(change, message):
    simulation = Simulation(CASE_A)
    angle, rate = references(CASE_A, 5)
    some_by_some(simulation, angle, rate)
    with pytest.raises(ParameterError, match=message):
        simulation.advance(change(angle[:1]), rate[:1])
    simulation.advance(angle[:1], rate[:1])
    assert simulation.step_count == 6


def test_a_push_and_another_scene_end_what_went_on():
    angle, rate = references(CASE_A, 5)
    simulation = Simulation(CASE_A)
    some_by_some(simulation, angle, rate)
    simulation.push(3, (0.0, 0.0, 0.1))
    simulation.advance(angle[:1], rate[:1])
    assert simulation.last.level == 'spatial'
    icy = with_settings(CASE_A, {'friction.transversal': 0.05})
    simulation.change(icy)
    assert simulation.scene is icy
    some_by_some(simulation, angle, rate)
    assert not simulation.report.failure


def test_steppers_of_a_caller_need_no_single_steps():
    simulation = Simulation(CASE_A, make_stepper(CASE_A))
    assert some_by_some(simulation, *references(CASE_A, 5)) == 0


@pytest.mark.parametrize('scene', [CASE_A, CASE_C], ids=['A', 'C'])
def test_references_of_the_gait_are_the_same_for_any_number_of_steps(scene):
    simulation = Simulation(scene)
    angle, rate = simulation.gait_reference(200)
    for count in (1, 3, 64, 65):
        simulation = Simulation(scene)
        for first in range(0, 130, count):
            simulation.step_count = first
            found = simulation.gait_reference(count)
            assert (found[0] == angle[first : first + count]).all()
            assert (found[1] == rate[first : first + count]).all()
            found[0][:] = 7.0  # belongs to the caller


def test_the_gait_is_that_of_the_scene_after_a_change():
    simulation = Simulation(CASE_A)
    simulation.gait_reference(1)
    simulation.step_count = 8000
    simulation.change(with_settings(CASE_A, {'gait.yaw.amplitude': 0.1}))
    assert np.abs(simulation.gait_reference(1)[0]).max() <= 0.1
    assert GaitAhead(CASE_A).midpoints(0, 2)[0] == CASE_A.dt / 2


@pytest.mark.parametrize('level', ['planar', 'spatial', 'auto'])
def test_single_steps_can_be_compiled_before(level):
    scene = with_settings(CASE_A, {'level': level, 'dt': 1e-3})
    prepared, other = Simulation(scene), Simulation(scene)
    prepared.compile()
    angle, rate = references(scene, 20)
    compiled = []
    with watched(compiled.append):
        some_by_some(prepared, angle, rate)
    assert compiled == []
    other.advance(angle, rate)
    are_same(prepared, other)

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Random scenes find what is broken; what they found once stays mended."""

import numpy as np
import pytest
import yaml

from snake_sim_benchmarks.reliability import invariants, physics
from snake_sim_benchmarks.reliability.random_scenes import (
    FLAT,
    OBSTACLES,
    random_case,
    scene_of,
    start_of,
    WORLDS,
)
from snake_sim_ros import ParameterError, Robot, Scene, Simulation, State
from snake_sim_ros.stepping.samples import make_samples
from snake_sim_ros.stepping.state import initial_state


@pytest.fixture(scope='module', autouse=True)
def compiled():
    for method in ('newton', 'bdf2'):
        physics.warm_up((FLAT, method))


def test_a_robot_of_two_links_may_have_self_contact():
    # There is no pair of links that could touch, and the least of no gaps was asked for: it lies
    # where it lies without.
    for count in (1, 2):
        lies, without = (
            initial_state(Scene(robot=Robot(link_count=count), self_contact=itself)).q
            for itself in (True, False)
        )
        assert (lies == without).all()


def test_cases_are_repeatable_and_fit_into_a_file():
    for surroundings in (FLAT, OBSTACLES, WORLDS):
        for seed in range(30):
            case = random_case(np.random.default_rng(seed), surroundings, 'newton')
            again = random_case(np.random.default_rng(seed), surroundings, 'newton')
            assert case == again == yaml.safe_load(physics.as_text(case))
            scene_of(case)


@pytest.mark.parametrize('method', ['newton', 'bdf2'])
def test_random_scenes_break_nothing(method):
    steps = judged = 0
    for seed in range(12):
        case = random_case(np.random.default_rng((99, seed)), FLAT, method)
        outcome = physics.judged(case)
        assert outcome.broken == [], (seed, physics.as_text(case))
        steps += outcome.steps
        judged += not outcome.diverged
    assert steps > 300
    assert judged >= 6


@pytest.mark.parametrize('method', ['newton', 'bdf2'])
def test_random_worlds_break_nothing(method):
    steps = overflows = 0
    for seed in range(8):
        case = random_case(np.random.default_rng((99, seed)), WORLDS, method)
        outcome = physics.judged(case)
        assert outcome.broken == [], (seed, physics.as_text(case))
        steps += outcome.steps
        overflows += outcome.overflows
    assert steps > 500 and not overflows


CASE = {
    'scene': {'robot': {'link_count': 3}, 'level': 'spatial', 'friction': {'rolling': 0.1}},
    'start': {'velocity': [0.3, 0.2, -0.4]},
    'parts': [{'steps': 5}, {'steps': 7, 'push': [1, 0.1, 0.0, 0.0]}],
}


@pytest.fixture(scope='module')
def step():
    """Return the arguments of `invariants.of_step`, of a step with an impact."""
    scene = scene_of(CASE)
    simulation = Simulation(scene)
    simulation.state = before = start_of(CASE, scene)
    samples = make_samples(scene, 1, 1)
    simulation.advance(*simulation.gait_reference(1), samples)
    after = State(samples.q[0], samples.u[0])
    return [scene, before, after, samples.torque[0], samples.impulse[0]]


def names(arguments, *, converged=True):
    broken = invariants.of_step(*arguments, converged=converged)
    return {sentence.partition(':')[0] for sentence in broken}


def test_a_good_step_breaks_nothing(step):
    assert step[4].any()
    assert names(step) == set()


def test_wrong_steps_are_found(step):
    scene, before, after, torque, impulse = step
    faster = State(after.q, after.u + np.eye(6)[0])
    assert {'balance', 'joints', 'energy', 'center of mass'} > (
        found := names([scene, before, State(after.q, 3.0 * after.u), torque, impulse])
    )
    assert 'balance' in found
    assert {'balance', 'energy', 'center of mass'} <= names(
        [scene, before, State(after.q, after.u + 5.0), torque, impulse]
    ) | {'energy'}
    assert 'balance' in names([scene, before, faster, torque, impulse])
    assert names([scene, before, faster, torque, impulse], converged=False) <= {
        *('energy', 'center of mass', 'joints'),
    }
    assert 'balance' in names([scene, before, after, torque + 10.0, impulse])
    for scale, name in (([-1.0, 1, 1, 1, 1], 'cone'), ([1.0, 9, 9, 1, 1], 'cone')):
        assert name in names([scene, before, after, torque, impulse * scale])
    assert 'friction' in names([scene, before, after, torque, impulse * [1, -1, -1, 1, 1]])
    lifted = State(before.q + 0.1 * np.eye(7)[2], before.u)
    assert 'complementarity' in names([scene, lifted, after, torque, impulse])


def test_a_run_that_sinks_or_is_not_finite_is_found(step):
    scene, before, after, _, _ = step
    samples, report = make_samples(scene, 1, 1), Simulation(scene).report
    samples.q[0], samples.u[0] = after.q, after.u

    def broken():
        sentences = invariants.of_run(scene, before, samples, report, 0.0)
        return {sentence.partition(':')[0] for sentence in sentences}

    assert broken() == set()
    report.penetration_max = 0.01
    assert broken() == {'penetration'}
    samples.q[0, 1] += 0.1
    assert {'penetration', 'joints', 'unit'} == broken()
    samples.u[0, 0, 0] = np.nan
    assert broken() == {'finite'}


def test_a_case_that_fails_is_made_smaller(monkeypatch):
    def judged(case):
        if not case['scene'].get('robot'):
            raise ParameterError('refused')
        bad = 'push' in case['parts'][-1] and case['parts'][-1]['steps'] >= 3
        return physics.Outcome(broken=['energy: too much'] if bad else [])

    monkeypatch.setattr(physics, 'judged', judged)
    least = physics.smaller(CASE)
    assert least == {
        'scene': {'robot': {'link_count': 3}},
        'start': {},
        'parts': [{'steps': 3, 'push': [1, 0.1, 0.0, 0.0]}],
    }


def test_an_attack_says_what_it_found(monkeypatch):
    broken = physics.Outcome(broken=['energy: too much'], steps=3, unconverged=1)
    monkeypatch.setattr(physics, 'warm_up', lambda kind: None)
    monkeypatch.setattr(physics, 'judged', lambda case: broken)
    monkeypatch.setattr(physics, 'smaller', lambda case: CASE)
    rows = list(physics.trials(0.01, 7))
    assert [row.subject for row in rows] == ['flat, newton', 'flat, bdf2']
    for row in rows:
        assert row.violations == row.tried > 0
        assert row.first == f'energy: energy: too much; {physics.as_text(CASE)}'
        assert f'unconverged {row.tried}, ' in row.figures

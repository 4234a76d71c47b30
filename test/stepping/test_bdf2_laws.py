# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Laws of `bdf2` with steps of any length: what it conserves, its order, and its repeatability."""

from dataclasses import replace

import numpy as np
import pytest
from random_states import EPS
from scenes import same_bits
from test_bdf2 import CASE_A, GRAVITY, momentum, references, spinning

from snake_sim_ros import Report, Robot, Scene, State
from snake_sim_ros.dynamics.force_directions import joint_gaps
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.posture import center_of_mass
from snake_sim_ros.stepping.base import Status
from snake_sim_ros.stepping.methods import empty_history, make_stepper
from snake_sim_ros.stepping.state import initial_state

METHOD = {'method': 'bdf2', 'level': 'spatial'}


def choosing(scene, tolerance):
    """Return a stepper that chooses the parts of its steps for an error of the path [m]."""
    stepper = make_stepper(scene)
    stepper.model = stepper.model._replace(path_tolerance=tolerance)
    return stepper


def run_steps(scene, state, steps, angle=None):
    """
    Return the state after steps of given lengths [s].

    The joints are held at `angle` (n-1, 2), or straight.
    """
    still = np.zeros((1, scene.robot.link_count - 1, 2))
    angle = still if angle is None else angle[None]
    history, steppers = empty_history(scene), {}
    for dt in steps:
        if dt not in steppers:
            steppers[dt] = make_stepper(replace(scene, dt=dt))
        state, history, report = steppers[dt].advance(state, history, angle, still)
        assert report.status is Status.CONVERGED
    return state


def assert_on_parabola(scene, start, end, time, steps):
    """Assert that the center of mass is where, and as fast as, gravity alone takes it."""
    v, end_v = momentum(scene.robot, start)[0], momentum(scene.robot, end)[0]
    # As in test_bdf2: each step rounds velocities up to |v| and lengths up to 200 m.
    slack = 10 * EPS * 12 * steps
    np.testing.assert_allclose(end_v, v + time * GRAVITY, atol=slack, rtol=0)
    way = center_of_mass(scene.robot, end.q) - center_of_mass(scene.robot, start.q)
    path = v * time + time**2 / 2 * GRAVITY
    np.testing.assert_allclose(way, path, atol=slack * time + 200 * EPS * steps, rtol=0)


@pytest.mark.parametrize('seed', range(5))
def test_steps_of_any_lengths_take_the_center_of_mass_along_its_parabola(seed):
    # The formula with variable steps is exact for a parabola, whatever the joints do.
    rng = np.random.default_rng(seed)
    scene, start = spinning(replace(CASE_A, **METHOD))
    steps = rng.choice([1 / 800, 1 / 400, 1 / 200, 1 / 100], 80)
    angle = rng.uniform(-0.3, 0.3, (10, 2))
    end = run_steps(scene, start, steps, angle)
    assert_on_parabola(scene, start, end, steps.sum(), len(steps))


@pytest.mark.parametrize('tolerance', [1e-4, 1e-6, 1e-8])
def test_chosen_parts_take_the_center_of_mass_along_its_parabola(tolerance):
    scene, start = spinning(replace(CASE_A, dt=1 / 50, **METHOD))
    state, history = start, empty_history(scene)
    for part in (slice(0, 20), slice(20, 50)):
        angle, rate = references(scene, 50)
        state, history, report = choosing(scene, tolerance).advance(
            state, history, angle[part], rate[part]
        )
        assert report.status is Status.CONVERGED
    assert_on_parabola(scene, start, state, 1.0, 50 * 64)


@pytest.mark.parametrize('tolerance', [0.0, 1e-6])
def test_a_push_changes_the_momentum_by_its_impulse(tolerance):
    # On one link: the joints pass it on. The state violates them, and the next part corrects this.
    scene, state = spinning(replace(CASE_A, dt=1 / 100, **METHOD))
    stepper = choosing(scene, tolerance)
    angle, rate = references(scene, 40)
    state, history, _ = stepper.advance(state, empty_history(scene), angle[:20], rate[:20])
    mass, impulse = scene.robot.per_link('link_mass'), np.array([0.3, -0.2, 0.5])
    before = momentum(scene.robot, state)[0]
    u = state.u.copy()
    u[3, :3] += impulse / mass[3]
    pushed = State(state.q, u)
    end, _, report = stepper.advance(pushed, history, angle[20:], rate[20:])
    assert report.status is Status.CONVERGED
    np.testing.assert_allclose(
        momentum(scene.robot, pushed)[0], before + impulse / mass.sum(), atol=4 * EPS, rtol=0
    )
    slack = 10 * EPS * 12 * 20 * (64 if tolerance else 1)
    expected = before + impulse / mass.sum() + 0.2 * GRAVITY
    np.testing.assert_allclose(momentum(scene.robot, end)[0], expected, atol=slack, rtol=0)


def test_spin_is_kept_to_second_order_with_alternating_steps():
    errors, time = [], 0.6
    for frequency in (100, 200, 400, 800):
        scene, start = spinning(replace(CASE_A, **METHOD))
        spin = momentum(scene.robot, start)[1]
        steps = np.tile([1 / frequency, 2 / frequency], round(time * frequency / 3))
        end = run_steps(scene, start, steps)
        errors.append(np.abs(momentum(scene.robot, end)[1] - spin).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.abs(orders - 2.0).max() <= 0.3


def test_alternating_steps_are_of_second_order():
    # Three links that turn about each other and are held straight by the controller, as in
    # test_bdf2. The reference is 16 times finer than the finest, which shifts orders by 1/256.
    scene = Scene(robot=Robot(link_count=3), gravity=(0.0, 0.0, 0.0), **METHOD)
    state, time = initial_state(scene), 0.6
    state.q[:, 2] += 5.0
    state.u[:, 4] = 2.0
    state.u[:, 1] = 2.0 * state.q[:, 0]

    def position(frequency):
        steps = np.tile([1 / frequency, 2 / frequency], round(time * frequency / 3))
        return run_steps(scene, state, steps).q[:, :3]

    exact = position(12800)
    errors = np.array([np.abs(position(f) - exact).max() for f in (100, 200, 400, 800)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert np.abs(orders - 2.0).max() <= 0.3


@pytest.mark.parametrize('name', ['lateral_undulation', 'sinus_lifting'])
def test_joints_stay_closed_to_rounding(name):
    # They are closed by the coordinates, whatever the number of steps: 11 links of 0.12 m, each
    # with a few roundings of numbers around 1.
    scene = replace(load_scene(name), dt=1 / 400, **METHOD)
    state, history, stepper = initial_state(scene), empty_history(scene), make_stepper(scene)
    for start in range(0, 40000, 20000):
        angle, rate = references(scene, 20000, start)
        state, history, report = stepper.advance(state, history, angle, rate)
        assert not report.failure
    distance = max(1.0, np.abs(state.q[:, :3]).max())
    assert np.abs(joint_gaps(scene.robot, state.q)).max() <= 10 * EPS * distance
    assert np.abs(np.linalg.norm(state.q[:, 3:], axis=1) - 1.0).max() <= 50 * EPS


@pytest.mark.parametrize('name', ['lateral_undulation', 'sidewinding', 'sinus_lifting'])
@pytest.mark.parametrize('tolerance', [0.0, 1e-5])
def test_chosen_parts_do_not_depend_on_how_a_run_is_divided(name, tolerance):
    scene = replace(load_scene(name), dt=1 / 50, **METHOD)
    scene = replace(scene, gait=replace(scene.gait, soft_start=0.2))
    angle, rate = references(scene, 120)
    start = initial_state(scene), empty_history(scene)
    whole = choosing(scene, tolerance).advance(*start, angle, rate)
    for length in (1, 7, 60):
        (state, history), total = start, Report()
        stepper = choosing(scene, tolerance)
        for k in range(0, 120, length):
            part = slice(k, k + length)
            state, history, report = stepper.advance(state, history, angle[part], rate[part])
            total += report
        np.testing.assert_array_equal(state.q, whole[0].q)
        np.testing.assert_array_equal(state.u, whole[0].u)
        assert same_bits(history, whole[1])
        assert total.iterations == whole[2].iterations

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The step of second order: its order, its stability, its landings, and what it conserves."""

from dataclasses import replace

from dense_step import EPS
import numpy as np
import pytest
from scenes import course, same_bits

from snake_sim_ros import Friction, Report, Robot, Scene, State
from snake_sim_ros.contact.laws import REST_SPEED
from snake_sim_ros.dynamics.force_directions import mean_delassus
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.posture import center_of_mass, gaps, joint_angles
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.base import Status
from snake_sim_ros.stepping.bdf2.formula import TICKS
from snake_sim_ros.stepping.methods import empty_history, make_stepper
from snake_sim_ros.stepping.state import copied, initial_state

G = 9.81
GRAVITY = np.array([0.0, 0.0, -G])
RESIDUAL = 1e-9  # m/s
PRESS_SPEED = 3e-8  # m/s, of bdf2
CASE_A = replace(load_scene('lateral_undulation'), level='spatial')
LINK = Scene(robot=Robot(link_count=1), method='bdf2', level='spatial')
each_level = pytest.mark.parametrize('level', ['planar', 'spatial'])


def references(scene, steps, start=0):
    """Return the joint references of the gait at the middle of the steps."""
    times = (np.arange(start, start + steps) + 0.5) * scene.dt
    return gait.reference(scene.gait, times, scene.robot.link_count - 1)


def run(scene, state, time):
    """Return state and report after some time."""
    steps = round(time / scene.dt)
    state, _, report = make_stepper(scene).advance(
        state, empty_history(scene), *references(scene, steps)
    )
    assert report.steps == steps
    assert report.status is Status.CONVERGED
    return state, report


def flying(scene):
    """Return the scene in the air; the gait fades in, the center of mass is kept."""
    scene = replace(
        scene, gait=replace(scene.gait, soft_start=1.0), drift_correction='center_of_mass'
    )
    state = initial_state(scene)
    state.q[:, 2] += 200.0  # m: the floor is far for 5 s
    return scene, state


def spinning(scene):
    """Return a robot in the air that turns and moves as one body."""
    scene, state = flying(scene)
    R, omega = rotation_matrices(state.q[:, 3:]), np.array([0.5, 0.3, 2.0])
    arm = state.q[:, :3] - center_of_mass(scene.robot, state.q)
    state.u[:, :3] = np.cross(omega, arm)
    state.u[:, :3] += [1.0, 0.5, 2.0]
    state.u[:, 3:] = np.einsum('iab,a->ib', R, omega)
    return scene, state


def inertia(robot):
    """Return mass (n,) and the moments of inertia in B (n, 3)."""
    m, across, along = (
        robot.per_link(name) for name in ('link_mass', 'inertia_transversal', 'inertia_axial')
    )
    return m, np.column_stack([across, across, along])


def momentum(robot, state):
    """Return the velocity of the center of mass, the spin about it and the energy about it."""
    m, theta = inertia(robot)
    v = m @ state.u[:, :3] / m.sum()
    relative = state.u[:, :3] - v
    arm = state.q[:, :3] - center_of_mass(robot, state.q)
    spin = np.einsum('iab,ib->a', rotation_matrices(state.q[:, 3:]), theta * state.u[:, 3:])
    spin += (m[:, None] * np.cross(arm, relative)).sum(axis=0)
    energy = (m @ (relative**2).sum(axis=1) + (theta * state.u[:, 3:] ** 2).sum()) / 2
    return v, spin, energy


# ---- order --------------------------------------------------------------------------------------


def observed_orders(scene, state, time, per_second, fine):
    """Return the pairwise orders of the link positions against the same method at `fine` Hz."""
    exact = run(replace(scene, dt=1 / fine), state, time)[0].q[:, :3]
    errors = np.array(
        [np.abs(run(replace(scene, dt=1 / f), state, time)[0].q[:, :3] - exact).max()
         for f in per_second]
    )  # fmt: skip
    return np.log2(errors[:-1] / errors[1:])


# The reference is 32 times finer than the finest step: it is off by 1/32 of its error (order 1) or
# 1/1000 (order 2), which shifts an order by 0.05 or less. Third-order terms and stick-slip events
# take up to 0.3.
@each_level
@pytest.mark.parametrize('time', [0.4, 1.0])
@pytest.mark.parametrize(('method', 'order'), [('bdf2', 2.0), ('newton', 1.0)])
def test_order_in_case_a(method, order, time, level):
    scene = replace(CASE_A, method=method, level=level)
    orders = observed_orders(scene, initial_state(scene), time, (100, 200, 400, 800), 25600)
    assert np.abs(orders - order).max() <= 0.3


@pytest.mark.parametrize('held', [True, False])
@pytest.mark.parametrize(('method', 'order'), [('bdf2', 2.0), ('newton', 1.0)])
def test_order_in_free_flight(method, order, held):
    # Three links that turn about each other, loose or held by the controller; no gravity, whose
    # error in the center of mass is of second order in any case.
    gains = ('yaw_stiffness', 'yaw_damping', 'pitch_stiffness', 'pitch_damping')
    loose = Robot(link_count=3, **dict.fromkeys(gains, 0.0))
    scene = Scene(
        robot=Robot(link_count=3) if held else loose,
        method=method,
        gravity=(0.0, 0.0, 0.0),
        drift_correction='center_of_mass',
    )
    state = initial_state(scene)
    state.q[:, 2] += 5.0
    half = Robot().link_length / 2
    if held:
        state.u[:, 4] = 2.0
        state.u[:, 1] = 2.0 * state.q[:, 0]
    else:  # velocities that agree with the joints
        state.u[:, 4] = 1.0, 3.0, -1.0
        state.u[:, 1] = 0.0, half * 4.0, half * 6.0
    orders = observed_orders(scene, state, 0.5, (100, 200, 400, 800), 25600)
    assert np.abs(orders - order).max() <= 0.3


@pytest.mark.parametrize('name', ['sidewinding', 'lateral_undulation'])
@pytest.mark.parametrize(('method', 'order'), [('bdf2', 2.0), ('newton', 1.0)])
def test_order_in_free_flight_with_moving_references(method, order, name):
    # The references fade in, so that nothing jumps. Steps are finer than above: 11 links held by
    # the controller swing at more than 10 Hz, and errors of the phase must be small.
    scene = replace(load_scene(name), method=method, gravity=(0.0, 0.0, 0.0))
    scene, state = flying(scene)
    orders = observed_orders(scene, state, 0.5, (800, 1600, 3200), 102400)
    assert np.abs(orders - order).max() <= 0.3


def test_one_sliding_link_is_solved_to_second_order():
    # Differences over two steps are exact for a parabola, and so is the first step.
    mu, time = 0.1, 0.5
    for frequency in (50, 100, 200, 400, 800):
        dt = 1 / frequency
        scene = replace(LINK, dt=dt, friction=Friction(longitudinal=mu, transversal=0.5))
        state = initial_state(scene)
        state.u[0, 0] = 1.0
        end, _ = run(scene, state, time)
        # Pressing into the floor at PRESS_SPEED takes load from friction, mu PRESS_SPEED of
        # velocity. Under the heavier front the link sinks faster: it pitches at
        # PRESS_SPEED/(2 L_GS) or less, and its center is L_SC above the floor. The residual goes
        # through mu and r_N/m.
        slack = mu * PRESS_SPEED + PRESS_SPEED * 0.0525 / (2 * 0.0393) + 0.3 * RESIDUAL
        assert end.u[0, 0] == pytest.approx(1.0 - mu * G * time, abs=slack)
        exact = time - mu * G * time**2 / 2
        # Gravity acts from the first step on: the gap is closed, no fall precedes it.
        assert end.q[0, 0] == pytest.approx(exact, abs=slack * time)


def test_t1_one_sliding_link_stops_where_it_should():
    mu = 0.1
    for frequency in (50, 100, 200, 400, 800, 1600):
        scene = replace(
            LINK, dt=1 / frequency, friction=Friction(longitudinal=mu, transversal=0.5)
        )
        state = initial_state(scene)
        state.u[0, 0] = 1.0
        end, _ = run(scene, state, 1.5)
        # It stops inside a step: v <= mu g dt is lost there, in place of a parabola a difference.
        exact = 1.0 / (2 * mu * G)
        assert abs(end.q[0, 0] - exact) <= mu * G * scene.dt**2 + 1e-7
        assert abs(end.u[0, 0]) <= RESIDUAL


# ---- flight -------------------------------------------------------------------------------------


@pytest.mark.parametrize(('method', 'pd_scheme'), [('bdf2', 'average'), ('newton', 'end')])
def test_free_flight_is_stable_with_large_steps(method, pd_scheme):
    scene = replace(load_scene('sidewinding'), method=method, pd_scheme=pd_scheme)
    scene, start = flying(scene)
    energies = {}
    for frequency in (1000, 100, 50):
        scene = replace(scene, dt=1 / frequency)
        stepper, state, history = make_stepper(scene), start, empty_history(scene)
        angle, rate = references(scene, 3 * frequency)
        highest, every = 0.0, max(1, frequency // 100)
        for k in range(0, len(angle), every):
            part = slice(k, k + every)
            state, history, report = stepper.advance(state, history, angle[part], rate[part])
            assert report.status is Status.CONVERGED
            highest = max(highest, momentum(scene.robot, state)[2])
        energies[frequency] = highest
        # The reference of the last middle of a step is half a step old, and moves at A omega.
        error = np.abs(joint_angles(state.q) - angle[-1]).max()
        assert error <= np.radians(30) * np.radians(80) / 2 / frequency + 0.01
    # An instability doubles it many times; second order errors (omega dt)^2 are 0.1 % here.
    assert energies[100] == pytest.approx(energies[1000], rel=0.05)
    assert energies[50] == pytest.approx(energies[1000], rel=0.05)


def test_linear_momentum_is_exact_and_spin_is_of_second_order():
    errors, time = [], 1.0
    for frequency in (100, 200, 400, 800):
        scene, start = spinning(replace(CASE_A, method='bdf2', dt=1 / frequency))
        v, spin, _ = momentum(scene.robot, start)
        end, _ = run(scene, start, time)
        end_v, end_spin, _ = momentum(scene.robot, end)
        # Each step rounds 11 velocities through a chain with condition 1e5 at most: observed are
        # units in the last place, 10 times EPS |v| per step bounds them.
        slack = 10 * EPS * 12 * frequency
        np.testing.assert_allclose(end_v, v + time * GRAVITY, atol=slack, rtol=0)
        # Differences over two steps are exact for a parabola, and so is the first step.
        path = v * time + time**2 / 2 * GRAVITY
        moved = center_of_mass(scene.robot, end.q) - center_of_mass(scene.robot, start.q)
        np.testing.assert_allclose(moved, path, atol=slack + 200 * EPS * frequency, rtol=0)
        errors.append(np.abs(end_spin - spin).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.abs(orders - 2.0).max() <= 0.1
    assert errors[-1] <= 1e-5 * np.abs(spin).max()


# ---- landing ------------------------------------------------------------------------------------


@pytest.mark.parametrize('frequency', [50, 100, 400, 4000])
def test_a_flat_link_lands_without_bounce_and_without_penetration(frequency):
    scene = replace(LINK, dt=1 / frequency)
    for height in np.linspace(0.01, 0.1, 20 if frequency < 400 else 4):
        start = initial_state(scene)
        start.q[0, 2] += height
        # It falls for at most 0.143 s.
        states, _, report = course(scene, start, round(0.2 * frequency))
        assert report.status is Status.CONVERGED
        # What is slower than REST counts as at rest: no faster upward.
        assert states.u[:, 0, 2].max() <= REST_SPEED
        assert report.penetration_max <= 1e-7
        assert np.abs(gaps(scene.robot, states.q[-1])).max() <= 1e-6
        assert np.abs(states.u[-1]).max() <= REST_SPEED


# ---- history ------------------------------------------------------------------------------------


@pytest.mark.parametrize('name', ['lateral_undulation', 'sidewinding', 'sinus_lifting'])
def test_steps_in_one_call_and_in_many_are_the_same_bit_for_bit(name):
    scene = replace(load_scene(name), method='bdf2', dt=1 / 400)
    scene = replace(scene, gait=replace(scene.gait, soft_start=0.2))
    angle, rate = references(scene, 300)
    start = initial_state(scene), empty_history(scene)
    whole = make_stepper(scene).advance(*start, angle, rate)
    stepper, (state, history), total = make_stepper(scene), start, Report()
    for k in range(300):
        state, history, report = stepper.advance(state, history, angle[k : k + 1], rate[k : k + 1])
        total += report
    np.testing.assert_array_equal(state.q, whole[0].q)
    np.testing.assert_array_equal(state.u, whole[0].u)
    assert same_bits(history, whole[1])
    assert total.iterations == whole[2].iterations
    assert total.residual_max == whole[2].residual_max


def test_the_arguments_are_left_alone():
    scene = replace(CASE_A, method='bdf2', dt=1 / 400)
    angle, rate = references(scene, 5)
    state, history = initial_state(scene), empty_history(scene)
    state, history, _ = make_stepper(scene).advance(state, history, angle, rate)
    before = State(state.q.copy(), state.u.copy()), copied(history)
    make_stepper(scene).advance(state, history, angle, rate)
    np.testing.assert_array_equal(state.q, before[0].q)
    np.testing.assert_array_equal(state.u, before[0].u)
    assert same_bits(history, before[1])


# ---- parts of a step ----------------------------------------------------------------------------


def choosing(scene, tolerance):
    """Return a stepper that chooses parts of a step by a tolerance of the path [m]."""
    stepper = make_stepper(scene)
    level = getattr(stepper, 'planar', stepper)
    level.model = level.model._replace(path_tolerance=tolerance)
    return stepper


def moving(level, time, dt=1 / 20):
    """Return case A with large steps, its state and its history after some time."""
    scene = replace(CASE_A, method='bdf2', level=level, dt=dt)
    start = initial_state(scene), empty_history(scene)
    state, history, report = make_stepper(scene).advance(
        *start, *references(scene, round(time / dt))
    )
    assert report.status is Status.CONVERGED
    return scene, state, history


@each_level
def test_chosen_parts_in_one_call_and_in_many_are_the_same_bit_for_bit(level):
    scene = replace(CASE_A, method='bdf2', level=level, dt=1 / 20)
    angle, rate = references(scene, 40)
    start = initial_state(scene), empty_history(scene)
    stepper = choosing(scene, 1e-6)
    whole = stepper.advance(*start, angle, rate)
    assert whole[2].status is Status.CONVERGED
    state, history = start
    for k in range(40):
        state, history, _ = stepper.advance(state, history, angle[k : k + 1], rate[k : k + 1])
    np.testing.assert_array_equal(state.q, whole[0].q)
    np.testing.assert_array_equal(state.u, whole[0].u)
    assert same_bits(history, whole[1])


@each_level
def test_a_part_that_is_not_taken_leaves_no_trace(level):
    # From a whole step, a half or a quarter on, the part that is taken is the same, shorter one.
    scene, state, history = moving(level, 1.0)
    memory = getattr(history.memory, 'scheme', history.memory)
    ends, iterations = [], []
    for ticks in (TICKS, TICKS // 2, TICKS // 4):
        memory.ticks[0] = ticks
        angle, rate = references(scene, 2, start=20)
        end, kept, report = choosing(scene, 1e-8).advance(state, history, angle, rate)
        assert report.status is Status.CONVERGED
        ends.append((end, kept))
        iterations.append(report.iterations)
    assert iterations[0] > iterations[1] > iterations[2]
    for end, kept in ends[1:]:
        np.testing.assert_array_equal(end.q, ends[0][0].q)
        np.testing.assert_array_equal(end.u, ends[0][0].u)
        assert same_bits(kept, ends[0][1])


@each_level
def test_a_smaller_tolerance_of_the_path_gives_a_smaller_error(level):
    fine, exact, _ = moving(level, 2.0, dt=1 / 3200)
    scene = replace(fine, dt=1 / 20)
    errors = []
    for tolerance in (1e-4, 1e-5, 1e-6, 1e-7):
        end, _, report = choosing(scene, tolerance).advance(
            initial_state(scene), empty_history(scene), *references(scene, 40)
        )
        assert report.status is Status.CONVERGED
        errors.append(np.abs(end.q - exact.q)[:, :3].max())
    assert (np.diff(errors) < 0).all(), errors


@pytest.mark.parametrize('frequency', [20, 50, 200])
def test_both_levels_take_the_same_steps(frequency):
    # The selection rule and rolling, which the plane neglects, are 1e-3 of the way.
    ends = [moving(level, 3.0, dt=1 / frequency)[1] for level in ('planar', 'spatial')]
    way = np.abs(ends[0].q - initial_state(CASE_A).q)[:, :2].max()
    assert np.abs(ends[0].q - ends[1].q)[:, :2].max() <= 1e-3 * way


# ---- contact laws in each step ------------------------------------------------------------------


@pytest.mark.parametrize('rolling', [0.0, 0.05])
@pytest.mark.parametrize('name', ['lateral_undulation', 'sidewinding', 'sinus_lifting'])
def test_the_contact_laws_hold_in_every_step(name, rolling):
    scene = replace(load_scene(name), method='bdf2', dt=1 / 400, level='spatial')
    scene = replace(scene, gait=replace(scene.gait, soft_start=0.5))
    scene = replace(scene, friction=replace(scene.friction, rolling=rolling))
    friction, r = scene.friction, scene.solver
    delassus = mean_delassus(scene.robot)
    compliance = r.normal_compliance * delassus
    stepper, state, history = make_stepper(scene), initial_state(scene), empty_history(scene)
    angle, rate = references(scene, 400)
    for k in range(len(angle)):
        last, slow = history.impulse.copy(), np.abs(history.velocity).max() <= 10 * REST_SPEED
        state, history, report = stepper.advance(state, history, angle[k : k + 1], rate[k : k + 1])
        assert report.status is Status.CONVERGED
        assert report.residual_max <= RESIDUAL
        P, gamma = history.impulse, history.velocity
        closed = P[:, 0] > 0.0
        assert (P[~closed] == 0.0).all()
        P, gamma = P[closed], gamma[closed]
        # Complementarity with the rule; velocities of landing contacts count their gap.
        # gamma = -c (P - z), where z is the last impulse if the robot was at rest, at most scaled
        # from h = dt/3 to 2/3 dt; c is at most that of the scene. Else z is 0.
        assert (gamma[:, 0] + compliance * P[:, 0] >= -RESIDUAL).all()
        rise = compliance * 2.0 * last[closed, 0] if slow else 0.0
        assert (gamma[:, 0] <= RESIDUAL + rise).all()
        # Beyond the ellipse by what the residual allows, r |e|, and the power of friction by what
        # it adds to impulses and velocities.
        for part, mu, r_k in (
            (slice(1, 3), (friction.longitudinal, friction.transversal), r.r_sliding),
            (slice(3, 5), (friction.rolling, friction.rolling), r.r_rolling),
        ):
            if mu[0] == 0.0:
                assert (P[:, part] == 0.0).all()
                continue
            used = np.linalg.norm(P[:, part] / mu, axis=1)
            assert (used <= P[:, 0] * (1 + 8 * EPS) + r_k * RESIDUAL / min(mu)).all()
            power = np.einsum('ak,ak->a', P[:, part], gamma[:, part])
            size = np.linalg.norm(P[:, part], axis=1)
            speed = np.linalg.norm(gamma[:, part], axis=1)
            assert (power <= RESIDUAL * (size + r_k * speed + r_k * RESIDUAL)).all()

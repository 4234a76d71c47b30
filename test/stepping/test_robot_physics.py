# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Laws that a robot of several links has to obey: momentum, joints, rest, dissipation, symmetry.

Where a closed solution of the time step exists it is the expected value; a bound with the solver's
tolerance eps and a prox parameter r follows from the stopping rule: the last sweep changed an
impulse by less than eps, or the natural map is below the residual tolerance.
"""

from dataclasses import replace
import math

import numpy as np
from oracle import empty_history, ORACLE
import pytest
from scenes import (
    ACROSS,
    chain_rounding,
    CLOSED,
    each_method,
    EPS,
    every_method,
    G,
    HEIGHT,
    isotropic,
    kinetic_energy,
    MASS,
    NEWTON,
    OFFSET,
    PRINTED,
    RADIUS,
    ROBOT,
    run,
    same_bits,
    slope,
    SWEEPING,
    TIGHT,
)
from schemes import press_of, span, undisturbed
from scipy.linalg import null_space

from snake_sim_ros import ParameterError, Robot, Scene, Solver, State
from snake_sim_ros.contact.laws import LEAST_COMPLIANCE, PRESS_SPEED, REST_SPEED
from snake_sim_ros.dynamics.force_directions import (
    contact_directions,
    joint_directions,
    mass_matrix,
    mean_delassus,
    torque_directions,
)
from snake_sim_ros.scene.parameters import DRIFT_CORRECTIONS, load_scene, with_settings
from snake_sim_ros.scene.posture import center_of_mass, chain_coordinates
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.base import Status
from snake_sim_ros.stepping.contact_forces import last_span
from snake_sim_ros.stepping.methods import METHODS
from snake_sim_ros.stepping.state import initial_state, named_arrays


def flying(scene):
    """Return the scene's robot at rest, high above the floor."""
    state = initial_state(scene)
    state.q[:, 2] += HEIGHT
    return state


def gait_scene(**settings):
    """Return Aiko with waves in both directions, without friction or soft start."""
    return with_settings(load_scene('sidewinding'), {'gait.soft_start': 0.0, **settings})


def free_flight(method, dt, links, steps, rule):
    """Return the scene of a gait in the air, links of many masses, and its first, last state."""
    mass = tuple(MASS * np.linspace(0.5, 1.5, links))
    robot = Robot(link_count=links, link_mass=mass)
    scene = gait_scene(robot=robot, method=method, dt=dt, drift_correction=rule)
    start = flying(scene)
    end, _, report = run(scene, start, steps)
    assert not report.contacts
    return scene, start, end


@every_method
@pytest.mark.parametrize('rule', DRIFT_CORRECTIONS)
def test_gait_in_the_air_leaves_the_center_of_mass_on_its_parabola(method, rule):
    # Joint forces and torques are internal: p = -m g t e_z, and the center of mass falls by
    # g t^2/2; both are exact at the ends of steps. Rounding: each step adds a few EPS of the
    # velocities and coordinates involved.
    dt = 1 / 4000
    links, steps = 11, 8000
    scene, start, end = free_flight(method, dt, links, steps, rule)
    mass, t = scene.robot.per_link('link_mass'), steps * dt
    momentum = mass @ end.u[:, :3]
    expected = np.array([0.0, 0.0, -mass.sum() * G * t])
    assert np.abs(momentum - expected).max() < steps * 4 * EPS * mass.sum() * (1 + G * t)
    if rule != 'paper':  # section VII-C holds link 1 and moves the others
        fall = center_of_mass(scene.robot, end.q) - center_of_mass(scene.robot, start.q)
        rounding = steps * 4 * EPS * (HEIGHT + G * t**2 / 2)
        assert np.abs(fall - [0.0, 0.0, -G * t**2 / 2]).max() < rounding


def test_drift_correction_of_the_paper_moves_the_center_of_mass_by_order_dt():
    # Closing joints from link 1 on moves the others by what a step opened them, O(dt^2), in each
    # of T/dt steps. Half the step, half the displacement, up to the next order: ratio 2 +- 0.1.
    # The joint gap of a step is below 1e-8 m here, in 10 joints and 8000 steps: 8e-4 m at worst.
    shift = []
    for dt in (1 / 4000, 1 / 8000):
        steps = round(2.0 / dt)
        scene, start, end = free_flight('paper', dt, 11, steps, 'paper')
        fall = center_of_mass(scene.robot, end.q) - center_of_mass(scene.robot, start.q)
        parabola = np.array([0.0, 0.0, -G * (steps * dt) ** 2 / 2])
        shift.append(np.linalg.norm(fall - parabola))
    assert shift[0] / shift[1] == pytest.approx(2.0, abs=0.1), shift
    assert shift[0] < 8e-4


@each_method
def test_two_links_that_spin_lose_what_the_frozen_joint_takes(method, dt):
    # Two links in line that turn about z in space, omega0 = 10 rad/s. Between the middles of two
    # steps they turn by d = 4 atan(omega dt/4), by half of it before the first; the joint acts
    # along the new direction and keeps cos(d) of the velocity m L/2 omega:
    # omega' = omega (1 - k (1 - cos d)), k = m (L/2)^2/(m (L/2)^2 + Theta_1) = 0.72486.
    half, spin = 0.061, 10.0
    k = MASS * half**2 / (MASS * half**2 + ACROSS)
    assert k == pytest.approx(0.72486, abs=5e-6)
    steps = round(2.0 / dt)
    scene = Scene(
        robot=Robot(link_count=2), gravity=(0.0, 0.0, 0.0), drift_correction='none',
        method=method, dt=dt,
    )  # fmt: skip
    q = chain_coordinates(scene.robot, np.zeros((1, 2)))
    q[:, :3] += [-half, 0.0, 1.0]
    u = np.zeros((2, 6))
    u[:, 4], u[:, 1] = spin, spin * q[:, 0]
    end, _, report = run(scene, State(q, u), steps)
    if method == 'bdf2':
        # Joints hold at the end of the step: nothing is lost but errors of second order in the
        # part of the turn that a step makes, of the velocity and of the joints.
        assert np.abs(end.u[:, 4] - spin).max() < spin * (spin * dt) ** 2
        assert report.joint_gap_max < 2 * half * (spin * dt) ** 2 * spin * steps * dt
        return
    omega = spin * (1 - k * (1 - math.cos(2 * math.atan(spin * dt / 4))))
    for _ in range(steps - 1):
        omega *= 1 - k * (1 - math.cos(4 * math.atan(omega * dt / 4)))
    assert np.abs(end.u[:, 4] - omega).max() < steps * 4 * EPS * spin
    # In time: E/E0 = 1/(1 + omega0^2 dt k t) = 0.965025 after 2 s; the recursion differs by second
    # order, (omega dt)^2 times the turns made in radians.
    energies = kinetic_energy(scene.robot, np.array([u, end.u]))
    expected = 1 / (1 + spin**2 * dt * k * steps * dt)
    assert abs(energies[1] / energies[0] - expected) < (spin * dt) ** 2 * spin * steps * dt
    # Positions take the mean of velocities at the middles of two steps, which lags by dt/2: after
    # half a turn each link is omega dt L/2 off, in opposite directions, omega being between its
    # values at the start and then.
    slowed = spin / math.sqrt(1 + spin * dt * k * math.pi)
    assert 2 * half * slowed * dt < report.joint_gap_max < 2 * half * spin * dt


def delassus(robot, q):
    """Return G_NN = W_N^T M^-1 W_N with the joints eliminated, shape (2n, 2n) [1/kg]."""
    R = rotation_matrices(q[:, 3:])
    W_N, _, _ = contact_directions(robot, R)
    W_J, M_inv = joint_directions(robot, R), np.linalg.inv(mass_matrix(robot))
    coupling = W_J.T @ M_inv @ W_N
    return W_N.T @ M_inv @ W_N - coupling.T @ np.linalg.solve(W_J.T @ M_inv @ W_J, coupling)


def straight(robot):
    """Return the robot at rest, straight and flat on the floor."""
    q = chain_coordinates(robot, np.zeros((robot.link_count - 1, 2)))
    q[:, 2] = RADIUS + CLOSED
    return State(q, np.zeros((robot.link_count, 6)))


@pytest.mark.parametrize('method', SWEEPING)
def test_printed_laws_leave_open_how_a_straight_robot_rests_on_its_contacts(method):
    # 22 contacts, but vertical motions have 12 degrees of freedom: sum N = 73.575 N is all that
    # mechanics fixes. From no impulses the sweeps stay in the range of G, where all are alike:
    # N = m g/2 = 3.34432 N each, the solution of least norm.
    solver = Solver(tolerance=1e-13, iteration_limit=100000, **PRINTED)
    scene = Scene(method=method, solver=solver, level='spatial')
    state, weight = straight(scene.robot), 11 * MASS * G
    assert np.linalg.matrix_rank(delassus(scene.robot, state.q), tol=1e-9) == 12
    end, history, report = run(scene, state, 1)
    impulse = history.impulse
    # The rest of the slowest mode, r lambda_min = 0.1 2.93: 3.5 eps; 4 eps with the last sweep.
    assert np.abs(impulse[:, 0] / scene.dt - MASS * G / 2).max() < 4 * solver.tolerance / scene.dt
    # |gamma| <= eps/r_N: over the lever for rotations.
    still = solver.tolerance / solver.r_normal / OFFSET
    assert np.abs(end.u).max() < still
    assert not report.unconverged
    # From any other impulses the split is another one, the sum and the rest are not.
    history.impulse[:, 0] *= np.random.default_rng(1).uniform(0.0, 2.0, 22)
    end, history, report = run(scene, state, 1, history)
    impulse = history.impulse
    assert np.ptp(impulse[:, 0]) > 0.1 * MASS * G / 2 * scene.dt
    assert abs(impulse[:, 0].sum() - weight * scene.dt) < 22 * 4 * solver.tolerance
    assert np.abs(end.u[:, 2]).max() < solver.tolerance / solver.r_normal
    assert not report.unconverged


@every_method
@pytest.mark.parametrize('delta', [0.0, 1e-4])
def test_robot_at_rest_stays_there(method, delta):
    # Printed laws: nothing moves by more than all steps with |gamma| <= eps/r_T or the residual
    # would. With the selection rule gamma = -c (P - z), all alike, where z is the last impulse, 0
    # in the first step, and m (gamma - gamma_before) = 2 P - m g dt. The robot sinks in the first
    # step, by 1e-11 m; everything else stays.
    steps, residual = 4000, 1e-11
    solver = replace(
        TIGHT, tolerance=1e-13, residual_tolerance=residual, normal_compliance=delta,
        iteration_limit=100000,
    )  # fmt: skip
    scene = Scene(method=method, solver=solver, level='spatial')
    state, dt, c = straight(scene.robot), scene.dt, delta * mean_delassus(scene.robot)
    end, history, report = run(scene, state, steps)
    P = depth = sinking = 0.0
    for _ in range(steps):
        last, before = P, sinking
        P = (G * dt + c * last + before) / (2 / MASS + c)
        sinking = c * (P - last)
        depth += dt / 2 * (before + sinking)
    if method == 'bdf2':  # the impulse is the weight for the time it acts, see contact_forces
        acted = last_span(scene, history)
        assert acted == pytest.approx(span(scene), rel=4 * EPS)
        P, depth = G * acted * MASS / 2, 0.0
        residual += press_of(scene) if delta else 0.0  # it sinks in the first step
        steps = 1 if delta else steps
    assert depth < 2 * PRESS_SPEED * dt
    # The residual may be in the null space of G, where impulses are off by it over c, and the
    # velocities of contacts by c times that: sqrt(22) R + R.
    error = steps * dt * residual * (math.sqrt(22) + 1 if delta else 1)
    moved = end.q - state.q
    assert np.abs(moved[:, 2] + depth).max() < error
    assert np.abs(np.delete(moved, 2, axis=1)).max() < error / OFFSET
    # 22 normal impulses, each off by the momentum of a normal velocity now and before.
    assert abs(history.impulse[:, 0].sum() - 22 * P) < 22 * 2 * MASS * residual
    assert not report.unconverged
    assert report.penetration_max < depth + error + 2 * abs(CLOSED)


@every_method
def test_selection_rule_picks_the_normal_impulses_of_least_norm(method):
    # (G + c) P = g dt: all alike, P = g dt/(2/m + c), wherever the solver starts. At a hundredth
    # of g the rule may be stiffer by PRESS_SPEED, so that sweeps, which take r c of the error in
    # the null space of G away, need not be many: r = 0.3 kg is 0.99/lambda_max. Without friction:
    # sticking contacts can push against each other, which pitches links and moves their weight.
    # The robot slides: at rest the impulses next to the last ones are selected.
    # Less weight for a method that presses in less, and impulses for the time they act.
    share = press_of(Scene(method=method)) / PRESS_SPEED
    gravity, delta = 0.01 * G * share, 0.015
    solver = Solver(
        tolerance=1e-16, residual_tolerance=1e-14 * share, normal_compliance=delta, r_normal=0.3,
        iteration_limit=20000,
    )  # fmt: skip
    scene = Scene(
        method=method, solver=solver, gravity=(0.0, 0.0, -gravity), friction=isotropic(0.0),
        level='spatial',
    )  # fmt: skip
    c = delta * mean_delassus(scene.robot)
    P = gravity * span(scene) / (2 / MASS + c)
    assert 2 * c * P < press_of(scene)
    for seed in range(5):
        start = straight(scene.robot)
        start.u[:, 0] = 10 * REST_SPEED
        history = undisturbed(scene, start)
        history.impulse[:, 0] = P * np.random.default_rng(seed).uniform(0.0, 2.0, 22)
        # What is left of a residual, or eps/r_N, in the null space of G: that over c.
        left = max(solver.tolerance / solver.r_normal, solver.residual_tolerance)
        end, history, report = run(scene, start, 1, history)
        assert np.abs(history.impulse[:, 0] - P).max() < math.sqrt(22) * left / c < 1e-6 * P
        assert np.abs(end.u[:, 2] + c * P).max() < math.sqrt(22) * left
        assert not report.unconverged


HEAVY = [(1, 1.1, 9), (10, 7.0, 109), (100, 66.6, 2371), (1000, 662, 18076)]


def heavy_middle(ratio):
    """Return a straight robot with a heavier middle link, and what each link weighs."""
    factor = np.where(np.arange(11) == 5, ratio, 1.0)
    names = ('link_mass', 'inertia_transversal', 'inertia_axial')
    robot = Robot(**{name: tuple(factor * getattr(ROBOT, name)) for name in names})
    return robot, straight(robot), factor


@pytest.mark.parametrize(
    ('method', 'ratio', 'condition', 'iterations'),
    [('paper', *case) for case in HEAVY] + [(ORACLE, *case) for case in HEAVY[:2]],
)
def test_heavy_link_costs_iterations_but_no_force(method, ratio, condition, iterations):
    # sum N = (10 + ratio) m g with the middle link heavier; a sweep with r = 1/lambda_max takes
    # 1/kappa of the slowest error away, kappa = lambda_max/lambda_min+ of G_NN.
    robot, state, factor = heavy_middle(ratio)
    modes = np.linalg.eigvalsh(delassus(robot, state.q))[10:]
    assert modes[-1] / modes[0] == pytest.approx(condition, rel=0.01)
    solver = Solver(tolerance=1e-10, iteration_limit=100000, r_normal=1 / modes[-1], **PRINTED)
    scene = Scene(
        robot=robot, solver=solver, friction=isotropic(0.0), method=method, pd_scheme='midpoint',
        level='spatial',
    )  # fmt: skip
    end, history, report = run(scene, state, 1)
    # The counts of an independent program with the same rule (93). Rounding can move the last
    # sweep, where the change goes through eps by a factor 1 - 1/kappa: by far less than 1 %.
    assert report.iterations == pytest.approx(iterations, rel=0.01)
    # Balance of momentum with the speeds that the iteration left; its last sweep changed each of
    # 22 impulses by eps at most.
    weight = factor.sum() * MASS * G * scene.dt
    momentum, carried = factor @ end.u[:, 2] * MASS, history.impulse[:, 0].sum()
    assert abs(carried - weight - momentum) < 22 * solver.tolerance
    # Those speeds are eps/r = 3e-10 m/s where contacts hold a link, a few times that where one of
    # the two is open; g dt is 2.5e-3 m/s: 1e-6 of the weight at most.
    assert carried == pytest.approx(weight, rel=1e-6)


@pytest.mark.parametrize(
    ('method', 'ratio', 'delta'),
    [
        (method, ratio, delta)
        for method in METHODS
        for ratio in (1, 10, 100, 1000)
        for delta in (0.0, 1e-4)
        if method not in SWEEPING
    ],
)
def test_heavy_link_is_carried(method, ratio, delta):
    robot, state, factor = heavy_middle(ratio)
    solver = Solver(normal_compliance=delta, iteration_limit=100000)
    scene = Scene(
        robot=robot, solver=solver, friction=isotropic(0.0), method=method, level='spatial'
    )
    end, history, report = run(scene, state, 1, undisturbed(scene, state))
    assert not report.unconverged
    weight = factor.sum() * MASS * G * span(scene)
    momentum, carried = factor @ end.u[:, 2] * MASS, history.impulse[:, 0].sum()
    # Rounding in sums of the laws with the dynamics, for each of the contacts, see there, and in
    # the dynamics: size times condition, which is up to 0.67 times the ratio.
    size = mean_delassus(robot)
    error = 11 * chain_rounding(method, G * scene.dt, size) + 22 * EPS * weight * max(1.0, ratio)
    assert abs(carried - weight - momentum) < error
    # The heavy link falls with the mean of what its two contacts press, up to the residual. Half
    # its weight is what is expected of a contact.
    expected = ratio * MASS * G * span(scene) / 2
    compliance = min(delta * size, max(LEAST_COMPLIANCE * size, press_of(scene) / expected))
    press = compliance * history.impulse[[5, 16], 0].mean()
    assert abs(end.u[5, 2] + press) < solver.residual_tolerance


def pitch_frequencies(robot):
    """Return the eigenfrequencies of the vertical joint modes of the straight robot [rad/s]."""
    R = rotation_matrices(straight(robot).q[:, 3:])
    M, W_J, W_tau = mass_matrix(robot), joint_directions(robot, R), torque_directions(robot, R)
    motions = null_space(W_J.T)
    rates = W_tau.T @ motions
    mobility = rates @ np.linalg.solve(motions.T @ M @ motions, rates.T)
    return np.sqrt(robot.pitch_stiffness * np.linalg.eigvalsh(mobility[1::2, 1::2]))


ENERGY = 0.016  # J, kinetic energy of the gait in the air


@pytest.mark.parametrize(
    ('scheme', 'damping', 'fraction', 'stable'),
    [
        ('start', 0.2, 0.9, True),
        ('start', 0.2, 1.1, False),
        ('start', 0.0, 0.5, False),
        ('midpoint', 0.2, 0.94, True),
        ('midpoint', 0.2, 1.05, False),
        ('midpoint', 0.0, 0.28, True),
        ('end', 0.2, 1.1, True),
        ('end', 0.2, 10.0, True),
        ('end', 0.0, 10.0, True),
    ],
)
def test_controller_is_stable_up_to_its_step(scheme, damping, fraction, stable):
    # One mode with frequency w and c = w^2 K_d/K_p. `start`: determinant of the step
    # 1 - c dt + w^2 dt^2/2 < 1, so dt < 2 K_d/K_p = 5.0e-4 s, never without damping.
    # `midpoint`: 4 - 2 c dt - w^2 dt^2 > 0, with the highest mode w = 1776 rad/s: 9.03e-4 s.
    # `end` has no limit. In the air, where no contact holds the modes.
    robot = Robot()
    w, ratio = pitch_frequencies(robot).max(), robot.pitch_damping / robot.pitch_stiffness
    c = w**2 * ratio
    limit = {'midpoint': (math.sqrt(c**2 + 4 * w**2) - c) / w**2}.get(scheme, 2 * ratio)
    assert w == pytest.approx(1776, abs=0.5)
    assert limit == pytest.approx(9.03e-4 if scheme == 'midpoint' else 5.0e-4, abs=5e-7)
    scene = gait_scene(
        pd_scheme=scheme, dt=fraction * limit, gravity=(0.0, 0.0, 0.0),
        **{'robot.yaw_damping': damping, 'robot.pitch_damping': damping},
    )  # fmt: skip
    end, _, report = run(scene, flying(scene), round(5.0 / scene.dt))
    energy = kinetic_energy(robot, end.u)
    if stable:
        # Undamped modes ring with what the jump of the rates at the start gave them.
        assert report.status is Status.CONVERGED
        assert energy < 3 * ENERGY
    else:
        assert report.status is Status.DIVERGED or energy > 100 * ENERGY


@every_method
def test_divergence_is_reported_and_the_last_good_state_returned(method):
    # Twenty times the step that the explicit controller bears: the pitch modes grow by more than
    # a factor a step. That must neither raise nor pass as converged.
    scene = Scene(robot=Robot(link_count=3), pd_scheme='start', dt=0.01, method=method)
    state = flying(scene)
    state.u[1, 4] = 0.1
    if method == 'bdf2':  # it has no explicit controller, and says so
        with pytest.raises(ParameterError, match='pd_scheme start is explicit, and method bdf2'):
            run(scene, state, 300)
        return
    with np.errstate(all='ignore'):
        end, history, report = run(scene, state, 300)
    assert report.status is Status.DIVERGED
    assert report.steps < 300
    assert 'link' in report.failure
    for array in (end.q, end.u, *named_arrays(history).values()):
        assert np.isfinite(array).all()


@every_method
def test_a_link_that_turns_further_than_resolved_is_divergence(method):
    # 400 rad/s make 4 rad in a step of 0.01 s; less than pi/2 is resolved.
    scene = Scene(robot=Robot(link_count=3), dt=0.01, method=method)
    state = flying(scene)
    state.u[:, 5] = 400.0
    end, history, report = run(scene, state, 10)
    assert report.status is Status.DIVERGED
    assert report.steps == 0
    assert 'would turn' in report.failure
    assert (end.q == state.q).all() and (end.u == state.u).all()
    assert same_bits(history, empty_history(scene))


@every_method
def test_a_limit_of_one_iteration_leaves_every_step_unconverged(method):
    # A tolerance that rounding keeps out of reach.
    steps = 100
    scene = with_settings(
        load_scene('lateral_undulation'),
        {
            'method': method,
            'solver.tolerance': 1e-12,
            'solver.residual_tolerance': 1e-300,
            'solver.iteration_limit': 1,
        },
    )
    _, _, report = run(scene, initial_state(scene), steps)
    assert report.status is Status.MAX_ITERATIONS
    assert (report.steps, report.unconverged) == (steps, steps)
    # A step of bdf2 that starts anew has parts, and a landing is solved once more.
    most = 3 if method == 'bdf2' else 1
    assert report.iterations_max == most
    assert report.iterations == steps or (method == 'bdf2' and report.iterations <= 2 * steps)
    assert report.residual_max > 0.0
    if method in SWEEPING:
        # It changed an impulse by eps or more: the natural map is no less than eps over the
        # largest r, spread over 66 components.
        assert report.residual_max > 1e-12 / 0.1 / math.sqrt(66)


def steps_on_a_slope(method, solver, steps):
    """Return the reports of single steps on a slope, at a tenth of the friction angle."""
    scene = Scene(solver=solver, gravity=slope(0.05, math.pi / 2), method=method)
    state, history, reports = straight(scene.robot), empty_history(scene), []
    for _ in range(steps):
        state, history, report = run(scene, state, 1, history)
        reports.append(report)
    return reports


@pytest.mark.parametrize('method', SWEEPING)
def test_prox_parameter_that_is_too_large_is_reported(method):
    # r_T lambda_max = 0.2 26.4 = 5.3 > 2: on a slope, at a tenth of the friction angle, sweeps
    # cannot settle where contacts stick. The forces stay in their ellipses: nothing blows up, only
    # the report tells. A step is either counted or ends with the natural map within eps/r.
    solver = Solver(r_sliding=0.2, iteration_limit=200, **PRINTED)
    reports = steps_on_a_slope(method, solver, 10 if method == ORACLE else 100)
    for report in reports:
        if report.unconverged:
            assert report.status is Status.MAX_ITERATIONS
            assert report.iterations == 200
        else:
            assert report.residual_max < solver.tolerance / solver.r_normal
    unconverged = [report.unconverged for report in reports]
    assert unconverged[0]
    assert sum(unconverged) > len(unconverged) / 2  # sliding ones, in between, may converge


@pytest.mark.parametrize('method', NEWTON)
def test_newton_methods_do_not_depend_on_prox_parameters(method):
    # They are the unit of the residual only.
    for report in steps_on_a_slope(method, Solver(r_sliding=0.2, iteration_limit=200), 100):
        assert not report.unconverged
        assert report.residual_max <= 1e-9

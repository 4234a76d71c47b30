# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The methods that set-valued laws are held against do what their own equations say."""

from dataclasses import replace
import math

import numpy as np
import pytest
from random_states import jointed_links, moved, random_robot, rate_of
from scenes import (
    ACROSS,
    G,
    isotropic,
    link_scene,
    lying,
    MASS,
    OFFSET,
    particle_scene,
    pitched,
    RADIUS,
    ROBOT,
    slope,
)

from snake_sim_benchmarks.comparison.baselines.integrators import (
    integrate,
    make_pyramid,
    make_semi_implicit,
    Penalty,
    SmoothRobot,
)
from snake_sim_ros import Gait, ParameterError, Scene, Simulation, State, Wave
from snake_sim_ros.dynamics import force_directions
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.scene.posture import joint_angles, joint_rates
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.methods import empty_history, make_stepper

DT = 1 / 4000
LEVEL = (0.0, 0.0, -G)
SOFT = Penalty(stiffness=1e4, sliding_velocity=0.01)
each_law = pytest.mark.parametrize('law', ['tanh', 'rational'])


def advanced(stepper, scene, state, steps):
    """Return state, history and report after some steps of a body without joints."""
    references = np.zeros((2, steps, scene.robot.link_count - 1, 2))
    return stepper.advance(state, empty_history(scene), *references)


def sunk(state, depth):
    """Return a state deeper in the floor."""
    return State(state.q - [0.0, 0.0, depth, 0.0, 0.0, 0.0, 0.0], state.u)


def undulating(**settings):
    """Return three links that wave, on their contact springs, and the state to start from."""
    waves = Gait(yaw=Wave(amplitude=0.5, angular_frequency=3.0, phase_lag=-0.9), soft_start=0.2)
    scene = with_settings(Scene(gait=waves, level='spatial', duration=0.2), settings)
    return replace(scene, robot=replace(scene.robot, link_count=3))


# ---- one body -----------------------------------------------------------------------------------


def stopping_distance(law, v, mu, eps):
    """
    Return how far a body slides under ``dv/dt = -mu g phi(v/eps)``, until it is at rest.

    ``int v dv/(mu g phi(v/eps))``: of tanh, v^2/2 + eps^2 pi^2/12 over mu g, less what a
    v >> eps leaves of exp(-2 v/eps); of the rational law, v^2/2 + eps v over mu g.
    """
    return (v * v / 2 + (eps**2 * np.pi**2 / 12 if law == 'tanh' else eps * v)) / (mu * G)


@each_law
@pytest.mark.parametrize('method', ['semi_implicit', 'RK45'])
def test_stopping_distance_is_that_of_regularized_friction(method, law):
    # T1 along the axis of less friction: eps there is mu_y/mu_x = 5 times the number given. What
    # is left of v after 3 s is below exp(-mu g/eps (3 s - 1.2 s)) = exp(-35).
    mu, v, penalty = 0.1, 1.0, replace(SOFT, law=law)
    scene = replace(particle_scene('newton', DT, (mu, 0.5), LEVEL), duration=3.0)
    start = sunk(lying((v, 0.0, 0.0), radius=0.0), MASS * G / 2 / SOFT.stiffness)
    expected, eps = stopping_distance(law, v, mu, 5 * SOFT.sliding_velocity), 0.05
    if method == 'RK45':
        run = integrate(scene, penalty, 'RK45', 1e-8, 60.0, start=start).trajectory
        end, bound = run.position[-1, 0], run.report.steps * 1e-8  # one tolerance a step
    else:
        state, _, report = advanced(make_semi_implicit(scene, penalty), scene, start, 12000)
        assert report.steps == 12000
        # Euler's step moves as if a = mu g phi were a (1 + dt/2 a'): the distance is shorter by
        # dt/2 int v a'/a dv = dt eps pi^2/16 of tanh, dt eps/2 log(1 + v/eps) = 1.5 dt eps.
        end, bound = state.q[0], 2 * DT * eps
    assert abs(end[0] - expected) < bound
    assert abs(expected - v * v / (2 * mu * G)) > 10 * bound  # it is not that of Coulomb


@each_law
def test_a_body_creeps_down_a_slope_on_which_it_should_rest(law):
    # In equilibrium phi(v/eps) = tan(beta)/mu = 0.4; a fixed point of the step, too, reached as
    # (1 - dt mu g/eps phi')^k: within 800 steps to rounding, of v and of the 5e-4 m/s of eps.
    mu, beta, eps = 0.5, math.atan(0.2), 1e-3
    scene = particle_scene('newton', DT, (mu, mu), slope(beta))
    start = sunk(lying(radius=0.0), MASS * G * math.cos(beta) / 2 / 1e4)
    stepper = make_semi_implicit(scene, Penalty(law=law, sliding_velocity=eps, stiffness=1e4))
    end, _, _ = advanced(stepper, scene, start, 800)
    expected = eps * (math.atanh(0.4) if law == 'tanh' else 0.4 / 0.6)
    assert end.u[0, 0] == pytest.approx(expected, rel=1e-9)


def test_a_link_sinks_in_until_its_springs_carry_it():
    # Each sphere m g/(2 k); critically damped with sqrt(2 k/m) = 171/s, exp(-171 0.25) = 3e-19.
    scene = link_scene('newton', DT)
    end, _, _ = advanced(make_semi_implicit(scene, SOFT), scene, lying(), 1000)
    assert RADIUS - end.q[0, 2] == pytest.approx(MASS * G / 2 / SOFT.stiffness, rel=1e-9)


@pytest.mark.parametrize(('share', 'fails'), [(0.99, False), (1.01, True)])
def test_the_spring_of_a_contact_limits_the_step(share, fails):
    # A link rocks on two springs with omega^2 = 2 k L_GS^2/Theta_1; without damping the explicit
    # step is stable up to 2/omega. Beyond, rocking grows until the link turns over in one step.
    omega = OFFSET * math.sqrt(2 * SOFT.stiffness / ACROSS)
    scene = link_scene('newton', share * 2 / omega, friction=isotropic(0.0))
    sag = MASS * G / 2 / SOFT.stiffness
    stepper = make_semi_implicit(scene, replace(SOFT, damping_ratio=0.0))
    _, _, report = advanced(stepper, scene, sunk(pitched(ROBOT, 1e-5), sag), 4000)
    assert ('would turn' in report.failure) == fails
    assert (report.penetration_max > 100 * sag) == fails
    assert (report.penetration_max < 1.01 * sag) != fails


def test_residual_says_how_far_smooth_friction_is_from_coulomb():
    # At rest the sliding impulse is 0 where that of Coulomb would hold the body: what it creeps
    # with is the residual, |gamma_T|.
    scene = particle_scene('newton', DT, (0.5, 0.5), slope(math.atan(0.2)))
    _, _, report = advanced(make_semi_implicit(scene, SOFT), scene, lying(radius=0.0), 400)
    assert report.printed_residual_max > 4e-3
    assert report.unconverged == 0


# ---- the pyramid --------------------------------------------------------------------------------


def braked(make, velocity, mu=0.4):
    """Return by how much a sliding body is slower after a step, over mu g dt, shape (2,)."""
    scene = particle_scene('paper', DT, (mu, mu), LEVEL)
    end, _, report = advanced(make(scene), scene, lying((*velocity, 0.0), radius=0.0), 1)
    assert report.unconverged == 0
    return (np.array(velocity) - end.u[0, :2]) / (mu * G * DT)


@pytest.mark.parametrize('velocity', [(1.0, 0.2), (0.3, 0.9)])
def test_friction_of_a_pyramid_is_along_the_diagonal(velocity):
    # Both components at mu N, whatever the direction; the ellipse opposes the velocity. The
    # residual of 1.5e-12 m/s of TIGHT is 1.5e-9 of mu g dt = 1e-3 m/s.
    direction = np.array(velocity) / np.hypot(*velocity)
    assert braked(make_pyramid, velocity) == pytest.approx([1.0, 1.0], abs=1e-8)
    assert braked(make_stepper, velocity) == pytest.approx(direction, abs=1e-8)


@pytest.mark.parametrize('velocity', [(1.0, 0.0), (0.0, -0.5)])
def test_friction_of_a_pyramid_is_right_along_an_axis(velocity):
    assert braked(make_pyramid, velocity) == pytest.approx(
        braked(make_stepper, velocity), abs=1e-8
    )


def test_a_pyramid_holds_a_body_on_a_slope():
    scene = particle_scene('newton', DT, (0.5, 0.5), slope(math.atan(0.49)))
    end, _, report = advanced(make_pyramid(scene), scene, lying(radius=0.0), 400)
    assert np.abs(end.u).max() < 2e-12  # the residual of TIGHT, 1e-12 m/s
    assert report.printed_residual_max < 2e-12


# ---- the smooth robot ---------------------------------------------------------------------------


def dense_motion(scene, penalty, t, state):
    """Return accelerations (n, 6), power of joints and of contacts by the dense matrices."""
    robot, n = scene.robot, scene.robot.link_count
    q, u = state.q, state.u.ravel()
    R = rotation_matrices(q[:, 3:])
    M, W_J, W_tau = (
        force_directions.mass_matrix(robot),
        force_directions.joint_directions(robot, R),
        force_directions.torque_directions(robot, R),
    )
    W_J_dot = rate_of(
        lambda q: force_directions.joint_directions(robot, rotation_matrices(q[:, 3:])), state
    )
    angle, rate = gait.reference(scene.gait, t, n - 1)
    rates = joint_rates(q, state.u)
    torque = robot.per_joint('stiffness') * (angle - joint_angles(q))
    torque += robot.per_joint('damping') * (rate - rates)
    force = force_directions.smooth_forces(robot, np.array(scene.gravity), state.u)
    force += W_tau @ torque.ravel()
    gap, W_N, W_T, _ = force_directions.scene_contacts(scene, q)
    assert 0 < (gap < 0.0).sum() < 2 * n
    mu, power = np.array([scene.friction.longitudinal, scene.friction.transversal]), 0.0
    for a in np.flatnonzero(gap < 0.0):
        slide = W_T[:, 2 * a : 2 * a + 2]
        gamma_N, gamma_T = W_N[:, a] @ u, slide.T @ u
        half = robot.per_link('link_mass')[a % n] / 2
        d = 2 * penalty.damping_ratio * math.sqrt(penalty.stiffness * half)
        F_N = max(0.0, -penalty.stiffness * gap[a] - d * gamma_N)
        w = mu * gamma_T
        s = np.linalg.norm(w) / (mu.max() * penalty.sliding_velocity)
        phi = math.tanh(s) if penalty.law == 'tanh' else s / (1 + s)
        F_T = -F_N * phi * mu * w / np.linalg.norm(w)
        force += W_N[:, a] * F_N + slide @ F_T
        power += F_N * gamma_N + F_T @ gamma_T
    zero = np.zeros((W_J.shape[1], W_J.shape[1]))
    system = np.block([[M, W_J], [W_J.T, zero]])
    solution = np.linalg.solve(system, np.concatenate([force, -W_J_dot.T @ u]))
    return solution[: 6 * n].reshape(n, 6), (torque * rates).sum(), power


@pytest.mark.parametrize(('law', 'links'), [('tanh', 5), ('rational', 4)])
def test_rate_of_change_is_that_of_the_dense_matrices(law, links):
    rng = np.random.default_rng(links)
    waves = Gait(
        yaw=Wave(amplitude=0.5, angular_frequency=2.0, phase_lag=-0.8, phase=0.3),
        pitch=Wave(amplitude=0.2, angular_frequency=1.0, offset=0.1),
        soft_start=2.0,
    )
    scene = Scene(robot=random_robot(rng, links), gait=waves, gravity=(0.3, 0.1, -9.7))
    penalty = Penalty(law=law, sliding_velocity=0.5, stiffness=1e3)
    robot = SmoothRobot(scene, penalty)
    y = robot.coordinates(jointed_links(rng, scene.robot, rng.uniform(-0.5, 0.5, (links - 1, 2))))
    begin, t = 7 + 2 * (links - 1), 0.7
    y[begin:-2] = rng.uniform(-1.0, 1.0, len(y) - begin - 2)
    y[2] += 0.03 - robot.state(y)[0].q[:, 2].mean()  # some spheres in the floor, some above
    state, _ = robot.state(y)
    acceleration, joints, contacts = dense_motion(scene, penalty, t, state)

    def coordinates(time):  # the links on their way, to second order in time
        q = moved(State(state.q, state.u + time / 2 * acceleration), time)
        return robot.coordinates(State(q, state.u + time * acceleration))

    step = 1e-6
    expected = (coordinates(step) - coordinates(-step)) / (2 * step)
    expected[-2:] = joints, contacts
    # Central differences: EPS/step = 2e-10 of coordinates near 1, and of the rates near 1 that
    # (alpha step)^2 for angular accelerations up to 1e5/s^2 of the stiff joints = 1e-2 over step.
    found = robot.rate(t, y)
    assert np.abs(found[:begin] - expected[:begin]).max() < 1e-4
    scale = np.abs(acceleration).max()
    middle = slice(begin, begin + 6)
    assert np.abs(found[middle] - acceleration[links // 2]).max() < 1e-9 * scale
    assert np.abs(found[begin:-2] - expected[begin:-2]).max() < 1e-4 * scale
    assert found[-2:] == pytest.approx(expected[-2:], rel=1e-9)


def test_jacobian_is_that_of_central_differences():
    # Forward differences of 1e-8 are off by 1e-8/2 f'', where f' changes within eps = 0.01 m/s.
    scene = undulating()
    robot = SmoothRobot(scene, SOFT)
    y = robot.coordinates(sunk(Simulation(scene).state, 1e-4))
    y[11:-2] += np.linspace(-0.01, 0.01, len(y) - 13)
    found, step = robot.jacobian(0.1, y), 1e-6
    assert robot.evaluations == len(y) + 1
    for k, column in enumerate(found.T):
        ahead, behind = y.copy(), y.copy()
        ahead[k] += step
        behind[k] -= step
        expected = (robot.rate(0.1, ahead) - robot.rate(0.1, behind)) / (2 * step)
        assert np.abs(column - expected).max() < 1e-4 * np.abs(found).max()


@pytest.mark.parametrize('tolerance', [1e-4, 1e-7])
def test_energy_of_an_integrated_run_is_balanced(tolerance):
    # Of every step one tolerance [J] may be left in the work of the joints and in that of the
    # contacts; the joints do 0.065 J, and 2/0.065 = 31.
    run = integrate(undulating(), SOFT, 'RK45', tolerance, 60.0)
    assert run.status == 'converged'
    assert len(run.trajectory.position) == 3
    assert 0.0 < run.energy_error < 31 * run.trajectory.report.steps * tolerance


def test_semi_implicit_euler_is_of_first_order():
    scene = undulating(drift_correction='center_of_mass')
    exact = integrate(scene, SOFT, 'LSODA', 1e-8, 60.0).trajectory.path[-1]
    errors = []
    for rate in (2000, 4000, 8000):
        fine = replace(scene, dt=1 / rate)
        simulation = Simulation(fine, make_semi_implicit(fine, SOFT))
        times = simulation.midpoints(rate // 5)
        simulation.advance(*gait.reference(scene.gait, times, 2))
        errors.append(np.linalg.norm(simulation.state.q[1, :3] - exact))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    # Terms of second order are dt of those of first, over the 6 ms of the contact springs.
    assert orders == pytest.approx([1.0, 1.0], abs=0.1)


def test_a_run_that_takes_too_long_is_stopped():
    run = integrate(undulating(), SOFT, 'RK45', 1e-4, 0.0)
    assert run.late
    assert run.status == 'too_slow'
    assert run.simulated == 0.0


@pytest.mark.filterwarnings('ignore::RuntimeWarning')
@pytest.mark.parametrize('integrator', ['BDF', 'Radau'])
def test_an_integrator_that_fails_says_when_and_why(integrator):
    state = Simulation(undulating()).state
    u = np.zeros_like(state.u)
    u[:, 5] = 1e100  # rad/s: the acceleration is finite, its Jacobian is not
    run = integrate(undulating(), SOFT, integrator, 1e-4, 5.0, start=State(state.q, u))
    reason = f't = 0 s: {integrator}: array must not contain infs or NaNs'
    assert run.trajectory.report.failure.startswith(reason)
    assert run.status == 'diverged'


def test_a_start_without_finite_accelerations_is_refused():
    state = Simulation(undulating()).state
    start = State(state.q, np.full_like(state.u, 1e200))
    with pytest.raises(ParameterError, match='start must have finite accelerations'):
        integrate(undulating(), SOFT, 'RK45', 1e-4, 5.0, start=start)


# ---- in a simulation ----------------------------------------------------------------------------


@pytest.mark.parametrize('make', [lambda scene: make_semi_implicit(scene, SOFT), make_pyramid])
def test_a_baseline_runs_in_a_simulation(make):
    scene = undulating()
    simulation = Simulation(scene, make(scene))
    times = simulation.midpoints(20)
    simulation.advance(*gait.reference(scene.gait, times, 2))
    end = simulation.state.q
    assert simulation.report.steps == 20
    simulation.reset()
    simulation.advance(*gait.reference(scene.gait, times, 2))
    assert (simulation.state.q == end).all()
    with pytest.raises(ParameterError, match='cannot change under a SpatialStepper'):
        simulation.change(scene)


@pytest.mark.parametrize(
    ('name', 'value'), [('law', 'cubic'), ('sliding_velocity', 0.0), ('stiffness', -1.0)]
)
def test_bad_penalties_are_refused(name, value):
    with pytest.raises(ParameterError, match=f'{name} must be .* got {value!r}'[:-2]):
        Penalty(**{name: value})


def test_scenes_that_no_baseline_can_run_are_refused():
    rolling = with_settings(load_scene('lateral_undulation'), {'friction.rolling': 0.01})
    for make in (make_pyramid, lambda scene: make_semi_implicit(scene, SOFT)):
        with pytest.raises(ParameterError, match=r'friction\.rolling must be 0 .* got 0\.01'):
            make(rolling)


@pytest.mark.parametrize(
    ('integrator', 'tolerance', 'message'),
    [('euler', 1e-4, "unknown integrator 'euler'; .* BDF"), ('RK45', 0.0, 'tolerance must be')],
)
def test_bad_integrators_are_refused(integrator, tolerance, message):
    with pytest.raises(ParameterError, match=message):
        integrate(undulating(), SOFT, integrator, tolerance, 1.0)

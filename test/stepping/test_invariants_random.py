# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What holds in every step, whatever the robot, its posture and the floor: random steps."""

from dataclasses import replace

from dense_step import EPS, one_step
from hypothesis import given, HealthCheck, settings, strategies as st
import numpy as np
from oracle import empty_history, make_stepper, ORACLE
import pytest
from scenes import same_bits, SWEEPING
from schemes import check_laws, of_two_states, step_of, undisturbed

from snake_sim_ros import Friction, Robot, Scene, Solver, State
from snake_sim_ros.scene.posture import chain_coordinates, gaps, joint_angles
from snake_sim_ros.scene.rotations import about, product, rotation_matrices
from snake_sim_ros.stepping.base import Status
from snake_sim_ros.stepping.methods import METHODS

RESIDUAL = 1e-9  # m/s
LIMIT = 500  # iterations
SWEEPS = {'paper': 20000, ORACLE: 2000}
often = settings(
    derandomize=True,
    deadline=None,
    max_examples=25,
    database=None,
    suppress_health_check=[HealthCheck.differing_executors],
)


@st.composite
def cases(draw):
    """Return scene, state and number of steps: a random robot near the floor."""
    n = draw(st.integers(2, 8))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    spread = draw(st.sampled_from([1.0, 1.2, 3.0]))

    def around(value):
        return tuple(value * np.exp(rng.uniform(-np.log(spread), np.log(spread), n)))

    length, radius, mass = around(0.122), around(0.0525), around(7.5 / 11)
    # Moments of inertia that a body can have: Theta_3 <= 2 Theta_1.
    across = tuple(m * lg**2 / 10 for m, lg in zip(mass, length, strict=True))
    robot = Robot(
        link_count=n,
        link_length=length,
        link_mass=mass,
        inertia_transversal=across,
        inertia_axial=tuple(rng.uniform(0.1, 1.5) * theta for theta in across),
        contact_offset=tuple(0.32 * value for value in length),
        contact_radius=radius,
    )
    friction = Friction(
        longitudinal=draw(st.sampled_from([0.0, 0.1, 0.3, 0.5])),
        transversal=draw(st.sampled_from([0.0, 0.2, 0.5])),
        rolling=draw(st.sampled_from([0.0, 0.0, 0.02, 0.1])),
    )
    scene = Scene(
        robot=robot,
        friction=friction,
        solver=Solver(iteration_limit=LIMIT),
        dt=draw(st.sampled_from([1 / 4000, 1 / 1000])),
        level='spatial',
        drift_correction='none',  # so that what a step did to the coordinates is to be seen
    )
    pitch = draw(st.sampled_from([0.0, 0.02, 0.3]))
    angle = rng.uniform(-1.0, 1.0, (n - 1, 2)) * [0.6, pitch]
    q = chain_coordinates(robot, angle)
    turn = product(about(2, rng.uniform(-np.pi, np.pi)), about(1, rng.uniform(-pitch, pitch)))
    q[:, :3] = q[:, :3] @ rotation_matrices(turn).T
    q[:, 3:] = product(turn, q[:, 3:])
    q[:, 2] += draw(st.sampled_from([-1e-3, -1e-9, 1e-7])) - gaps(robot, q).min()
    # One rigid body: velocities that the joints allow.
    speed = draw(st.sampled_from([0.0, 0.1, 1.0]))
    omega = rng.uniform(-1.0, 1.0, 3) * speed
    u = np.zeros((n, 6))
    u[:, :3] = rng.uniform(-1.0, 1.0, 3) * speed + np.cross(omega, q[:, :3] - q[0, :3])
    u[:, 3:] = np.einsum('iab,a->ib', rotation_matrices(q[:, 3:]), omega)
    return scene, State(q, u), draw(st.integers(1, 5))


def check_report(step, end, history, report):
    """Check the report of one step against the dense step; return whether it converged."""
    scene, method = step.scene, step.scene.method
    limit, tolerance = scene.iteration_limit, scene.solver.tolerance
    assert report.steps == 1
    carries = history.impulse[step.active, 0] > 0.0
    closed = (carries | (step.shift <= 0.0)).sum()  # those that could close are in the step, too
    if method == 'bdf2' and not of_two_states(history):  # a landing was solved once more
        assert (step.shift <= 0.0).sum() <= report.contacts <= len(step.active)
    else:  # the paper's step counts all that take part
        assert report.contacts == (closed if method == 'bdf2' else len(step.active))
    assert (np.delete(history.impulse, step.active, axis=0) == 0.0).all()
    converged = report.status is Status.CONVERGED
    assert converged == (not report.unconverged)
    if method not in SWEEPING:
        assert converged == (report.residual_max <= RESIDUAL)
    assert converged or report.iterations >= limit
    if method == 'bdf2' and not of_two_states(history):
        step = step.last_solved(report.joint_torque)
    P = history.impulse[step.active]
    if not len(P):
        return converged
    # Roundings of gamma, and of the impulses over r_T = 0.01 kg. The last sweep of those that
    # stop at a change of impulses, by the tolerance, comes after the residual: it moves each
    # impulse and its set (by mu < 1) by that much.
    r = min(scene.solver.r_normal, scene.solver.r_sliding, scene.solver.r_rolling)
    slack = 100 * EPS * (np.abs(end.u).max() + np.abs(P).max() / r)
    slack += 4 * tolerance / r if method in SWEEPING else 0.0
    residual = step.residual(P, step.gamma(end.u), step.compliance)
    assert residual <= report.residual_max + slack
    if method not in SWEEPING:
        assert converged or residual > RESIDUAL - slack
    assert (P[:, 0] >= 0.0).all()
    if converged:
        speed = np.abs(end.u).max()
        if method in ('newton', 'bdf2'):
            off = step.balance_error(P, end.u)
        else:
            # The condition of the joints, 1.4e5 for the paper's robot, times the ratio of masses.
            off = 9 * 1.4e5 * EPS * max(1e-3, speed)
        if method in SWEEPING:  # the last change of each impulse, as velocities take it
            off += tolerance * np.abs(step.responses()).sum(axis=1).max()
        check_laws(step, P, end.u, report.residual_max + slack, off)
    return converged


def scene_of(method, scene):
    """Return the scene with a method, and the tolerance and limit that it can do with."""
    solver = scene.solver
    if method in SWEEPING:
        solver = replace(solver, tolerance=1e-11, iteration_limit=SWEEPS[method])
    return replace(scene, method=method, solver=solver)


def follow(method, case):
    """Check the steps of a case; return the residuals of those that did not converge."""
    scene, state, steps = case
    scene = scene_of(method, scene)
    history, angle = undisturbed(scene, state), joint_angles(state.q)
    rate, left = np.zeros(angle.shape), []
    for _ in range(steps):
        step = None
        if method != 'bdf2' or of_two_states(history):
            step = step_of(scene, state, history, angle, rate)
        state, history, report = one_step(scene, state, history, angle, rate)
        assert not report.failure
        if step is not None:
            check_report(step, state, history, report)
        if report.unconverged:
            left.append(report.residual_max)
    return left


@pytest.mark.parametrize(
    ('method', 'examples'),
    [
        ('newton', 25),
        ('bdf2', 50),
        ('paper', 10),
        (ORACLE, 4),
    ],
)
def test_the_invariants_of_a_step(method, examples):
    left = []

    @settings(often, max_examples=examples)
    @given(case=cases())
    def steps(case):
        left.extend(follow(method, case))

    steps()
    assert not left


def test_every_method_is_tested():
    cases = test_the_invariants_of_a_step.pytestmark[0].args[1]
    assert {method for method, _ in cases} == {*METHODS, ORACLE}


@pytest.mark.parametrize('method', METHODS)
@often
@given(case=cases())
def test_the_same_bits_twice(method, case):
    scene, state, steps = case
    scene = replace(scene, method=method)
    angle = np.tile(joint_angles(state.q), (steps, 1, 1))
    rate = np.zeros(angle.shape)
    used = make_stepper(scene)
    # A stepper that has done something else before, and a new one.
    used.advance(State(state.q + 0.0, 0.5 * state.u), empty_history(scene), angle, rate)
    results = []
    for stepper in (used, make_stepper(scene)):
        end, history, report = stepper.advance(state, empty_history(scene), angle, rate)
        results.append((end.q.tobytes(), end.u.tobytes(), report.iterations, history))
    assert results[0][:3] == results[1][:3]
    assert same_bits(results[0][3], results[1][3])

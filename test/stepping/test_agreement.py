# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The compiled step against the dense one."""

from dataclasses import astuple, fields, replace
import math

import numpy as np
from oracle import moreau
import pytest
from random_states import EPS, jointed_links, random_robot, random_velocities
from scenes import layout, NEWTON, PRINTED, same_bits

from snake_sim_ros import Friction, Report, Scene, Solver, State
from snake_sim_ros.contact.laws import PRESS_SPEED, STICKING
from snake_sim_ros.dynamics import force_directions
from snake_sim_ros.scene import gait, posture
from snake_sim_ros.scene.parameters import DRIFT_CORRECTIONS, load_scene, PD_SCHEMES
from snake_sim_ros.scene.rotations import about, FLAT, H_bar, product, rotation_matrices
from snake_sim_ros.stepping.methods import empty_history, METHODS
from snake_sim_ros.stepping.state import initial_state, named_arrays

pytestmark = pytest.mark.long

# Laws of the paper as printed, and with the selection rule and the activation tolerance.
RULE: dict[str, float] = {}
# Both methods do the same arithmetic in another order. The dense one solves a system with a
# condition of up to 1.4e5 for the joint impulses: eps times that is 3e-11 of velocities around 1.
# Sweeps contract, so that their rounding does not add up.
AGREEMENT = 1e-10
FRICTIONS = {
    'isotropic': Friction(longitudinal=0.2, transversal=0.2),
    'orthotropic': Friction(longitudinal=0.1, transversal=0.5),
    'rolling': Friction(longitudinal=0.3, transversal=0.6, rolling=0.05),
    'none': Friction(longitudinal=0.0, transversal=0.0),
    'rolling only': Friction(longitudinal=0.0, transversal=0.0, rolling=0.1),
    'across only': Friction(longitudinal=0.0, transversal=0.4, rolling=0.02),
}


def random_scene(rng, link_count, friction, pd_scheme, drift_correction, laws):
    joints = np.linspace(1.2, 0.8, link_count - 1)  # gains fall from head to tail
    return Scene(
        robot=replace(
            random_robot(rng, link_count),
            yaw_stiffness=rng.uniform(10, 100) * joints,
            pitch_stiffness=rng.uniform(100, 800) * joints,
            yaw_damping=rng.uniform(0.1, 0.3) * joints,
            pitch_damping=rng.uniform(0.1, 0.3) * joints,
        ),
        friction=friction,
        solver=Solver(
            iteration_limit=40,
            r_normal=rng.uniform(0.05, 0.2),
            r_sliding=rng.uniform(0.005, 0.015),
            r_rolling=rng.uniform(0.02, 0.05),
            **laws,
        ),
        gravity=tuple(rng.uniform([-3, -3, -11], [3, 3, -8])),
        dt=rng.uniform(1e-4, 5e-4),
        pd_scheme=pd_scheme,
        drift_correction=drift_correction,
        level='spatial',
    )


def lying(rng, robot):
    """Return coordinates of a crooked robot on the floor, with about half of its spheres in it."""
    n = robot.link_count
    q = jointed_links(rng, robot, rng.uniform(-0.6, 0.6, (n - 1, 2)) * [1.0, 0.1]).q
    # Link 1 with any heading, a little pitched about e_y^I and rolled about its axis.
    first = product(about(2, rng.uniform(-3, 3)), product(about(1, rng.uniform(-0.1, 0.1)), FLAT))
    first = product(first, about(2, rng.uniform(-0.2, 0.2)))
    turn = product(first, q[0, 3:] * [1, -1, -1, -1])
    q = np.hstack([q[:, :3] @ rotation_matrices(turn).T, product(turn, q[:, 3:])])
    q[:, 2] -= np.median(posture.gaps(robot, q)) + rng.uniform(0.0, 1e-3)
    return q


def half_a_step_before(q_M, u, dt):
    """Return the state from which eq. (72) leads to q_M, exactly: it is the step back."""
    q_A = q_M.copy()
    q_A[:, :3] -= dt / 2 * u[:, :3]
    for p_A, p_M, omega in zip(q_A[:, 3:], q_M[:, 3:], u[:, 3:], strict=True):
        p_A[:] = p_M - dt / 4 * H_bar(p_M).T @ omega
        p_A /= np.linalg.norm(p_A)
    return State(q_A, u)


def random_reference(rng, state):
    """Return joint references of one step, near the angles of a state."""
    angle = posture.joint_angles(state.q)
    shape = (1, *angle.shape)
    return angle + rng.uniform(-0.05, 0.05, shape), rng.uniform(-1, 1, shape)


def random_history(rng, scene):
    """Return a history with impulses as a step could have left them, up to 1e-3 N s."""
    history, rolls = empty_history(scene), scene.friction.rolling > 0
    history.impulse[:] = rng.uniform(-1e-3, 1e-3, (2 * scene.robot.link_count, 5))
    history.impulse[:, 0] = np.abs(history.impulse[:, 0])
    history.impulse[:] *= [1, 1, 1, rolls, rolls]
    return history


def both(scene, state, history, angle, rate):
    """Return what the dense and the compiled method make of the same step."""
    # No contact may be so nearly closed that rounding decides, eqs. (9), (72).
    gap = posture.gaps(scene.robot, moreau.middle_coordinates(state, scene.dt))
    assert np.abs(gap - scene.solver.activation_tolerance).min() > 1e-9
    return (
        stepper.advance(state, history, angle, rate)
        for stepper in (moreau.DenseStepper(scene), METHODS['paper'].spatial(scene))
    )


def assert_agreement(scene, state, history, angle, rate):
    """Assert that both methods take the same step, and return the report."""
    dense, compiled = both(scene, state, history, angle, rate)
    assert np.abs(dense[0].q - compiled[0].q).max() < AGREEMENT
    assert np.abs(dense[0].u - compiled[0].u).max() < AGREEMENT
    assert layout(dense[1]) == layout(compiled[1])
    for name, array in named_arrays(dense[1]).items():
        assert np.abs(array - named_arrays(compiled[1])[name]).max(initial=0.0) < AGREEMENT, name
    expected, report = dense[2], compiled[2]
    for name in ('steps', 'iterations', 'iterations_max', 'unconverged', 'contacts', 'failure'):
        assert getattr(report, name) == getattr(expected, name), name
    assert report.status == expected.status
    # The residual is a change of impulses over a prox parameter: a velocity, like gamma itself.
    for name in (item.name for item in fields(Report) if item.name.endswith('_max')):
        assert abs(getattr(report, name) - getattr(expected, name)) < AGREEMENT, name
    return report


def random_step(
    seed,
    link_count,
    friction,
    pd_scheme='midpoint',
    drift_correction='paper',
    laws=PRINTED,
    speed=1.0,
):
    """
    Return a scene, a state on the floor, a history and joint references.

    Velocities are random, whatever the joints say. That the joints are closed in the middle of the
    step leaves no doubt about the axes of their torques.
    """
    rng = np.random.default_rng([seed, link_count])
    scene = random_scene(rng, link_count, friction, pd_scheme, drift_correction, laws)
    u = speed * random_velocities(rng, link_count)
    state = half_a_step_before(lying(rng, scene.robot), u, scene.dt)
    return scene, state, random_history(rng, scene), *random_reference(rng, state)


LINK_COUNTS = pytest.mark.parametrize('link_count', [1, 2, 6, 11])
ALL_SCHEMES = pytest.mark.parametrize('pd_scheme', PD_SCHEMES)


# One link has no joint: scheme and correction change nothing.
EVERY_CHAIN = pytest.mark.parametrize(
    ('link_count', 'pd_scheme', 'drift_correction'),
    [
        (1, PD_SCHEMES[0], DRIFT_CORRECTIONS[0]),
        *(
            (n, scheme, correction)
            for n in (2, 6, 11)
            for scheme in PD_SCHEMES
            for correction in DRIFT_CORRECTIONS
        ),
    ],
)


@EVERY_CHAIN
@pytest.mark.parametrize(('laws', 'speed'), [(PRINTED, 1.0), (RULE, 1.0), (RULE, 1e-4)])
def test_steps_agree_in_contact(link_count, pd_scheme, drift_correction, laws, speed):
    # The selection rule is reduced to PRESS_SPEED where links hit the floor: all of it if speeds
    # are low.
    closed = 0
    for seed, friction in enumerate(FRICTIONS.values()):
        step = random_step(seed, link_count, friction, pd_scheme, drift_correction, laws, speed)
        report = assert_agreement(*step)
        selected = report.printed_residual_max > report.residual_max
        assert not selected or laws is RULE
        assert report.iterations > 1
        closed += report.contacts
    # Some of the contacts were open.
    assert len(FRICTIONS) <= closed < len(FRICTIONS) * 2 * link_count


@EVERY_CHAIN
def test_steps_agree_in_flight(link_count, pd_scheme, drift_correction):
    friction = FRICTIONS['rolling']
    scene, state, *others = random_step(7, link_count, friction, pd_scheme, drift_correction)
    state.q[:, 2] += 1.0
    report = assert_agreement(scene, state, *others)
    # One iteration finds that there is nothing to do.
    assert (report.contacts, report.iterations, report.unconverged) == (0, 1, 0)


@pytest.mark.parametrize('link_count', [1, 2, 5])
def test_steps_agree_after_many_iterations(link_count):
    # 39, 305 and 5000, most of them with the contact problem condensed.
    friction = FRICTIONS['orthotropic']
    scene, state, *others = random_step(12, link_count, friction, 'midpoint', 'paper')
    scene = replace(scene, solver=Solver(**PRINTED))
    report = assert_agreement(scene, state, *others)
    assert report.iterations > 30 > 3 * report.contacts


@LINK_COUNTS
@ALL_SCHEMES
def test_torques_agree(link_count, pd_scheme):
    step = random_step(8, link_count, FRICTIONS['orthotropic'], pd_scheme, 'paper')
    expected, torque = (report.joint_torque for _, _, report in both(*step))
    assert torque.shape == expected.shape == (link_count - 1, 2)
    # Angles are equal up to rounding, rates agree like velocities, and act with K_d and, in the
    # implicit scheme, with K_d + K_p dt/2: below 1 N m s.
    assert np.abs(torque - expected).max(initial=0.0) < AGREEMENT


@pytest.mark.parametrize('link_count', [2, 11])
@ALL_SCHEMES
def test_steps_agree_when_the_joints_open_in_the_step(link_count, pd_scheme):
    # Closed at the start, but with velocities that twist and pull the joints: in the middle of the
    # step e_y^i . e_x^i+1 is up to dt/2 4 rad/s, and the axes of a joint are not quite orthogonal.
    friction = FRICTIONS['orthotropic']
    scene, state, *others = random_step(9, link_count, friction, pd_scheme, 'paper')
    state = State(moreau.middle_coordinates(state, scene.dt), state.u)
    assert np.abs(force_directions.joint_gaps(scene.robot, state.q)).max() < 120 * EPS
    assert_agreement(scene, state, *others)


@pytest.mark.parametrize('name', ['lateral_undulation', 'sidewinding', 'sinus_lifting'])
@pytest.mark.parametrize('drift_correction', ['paper', 'none'])
def test_steps_agree_along_a_scene(name, drift_correction):
    # A step of its own at the end of each second; the iteration limit keeps the dense one short.
    scene = replace(load_scene(name), drift_correction=drift_correction, level='spatial')
    limited = replace(scene, solver=Solver(iteration_limit=40))
    stepper, state = METHODS['newton'].spatial(scene), initial_state(scene)
    history = stepper.empty_history()
    for second in range(3):
        times = second + (np.arange(4001) + 0.5) * scene.dt
        angle, rate = gait.reference(scene.gait, times, 10)
        state, history, _ = stepper.advance(state, history, angle[:4000], rate[:4000])
        report = assert_agreement(limited, state, history, angle[4000:], rate[4000:])
        assert report.contacts > 0  # the laws of contacts have been compared


def test_impulses_of_rolling_are_dropped_without_rolling_friction():
    # mu_V = 0: the set of rolling impulses is a point, whatever an earlier step left.
    scene, state, history, angle, rate = random_step(10, 2, FRICTIONS['orthotropic'])
    history.impulse[:, 3:] = 1e-4
    assert assert_agreement(scene, state, history, angle, rate).contacts > 0
    for _, after, _ in both(scene, state, history, angle, rate):
        assert not after.impulse[:, 3:].any()


@pytest.mark.parametrize('tilt', [0.0, 5e-7, 5e-6, 0.1])
@pytest.mark.parametrize('down', [1, -1])
def test_steps_of_an_upright_link_agree(tilt, down):
    # Around the angle where the contact frame of a vertical link takes the place of its heading.
    rng = np.random.default_rng(11)
    scene = random_scene(rng, 1, FRICTIONS['orthotropic'], 'midpoint', 'paper', PRINTED)
    axis = product(about(2, 0.7), about(1, tilt - down * np.pi / 2))
    q_M = np.hstack([np.zeros(3), product(axis, FLAT)])[None]
    q_M[:, 2] = -posture.gaps(scene.robot, q_M).min() - 1e-4
    u = random_velocities(rng, 1) * [1, 1, 0, 0.001, 0.001, 1] - [0, 0, 0.1, 0, 0, 0]
    state = half_a_step_before(q_M, u, scene.dt)
    report = assert_agreement(scene, state, random_history(rng, scene), *np.zeros((2, 1, 0, 2)))
    assert report.contacts == 1
    assert report.residual_max > 0.0


# ---- the solvers of the contact laws ----------------------------------------------------------

RESIDUAL = 1e-11  # m/s


def contact_operator(scene, state):
    """Return M^-1 W and W^T M^-1 W of the closed contacts, joints eliminated."""
    q_M = moreau.middle_coordinates(state, scene.dt)
    R = rotation_matrices(q_M[:, 3:])
    closed = posture.gaps(scene.robot, q_M) <= scene.solver.activation_tolerance
    W_N, W_T, W_V = force_directions.contact_directions(scene.robot, R)
    pairs = np.repeat(closed, 2)
    W = np.hstack([W_N[:, closed], W_T[:, pairs], W_V[:, pairs]])
    if scene.friction.rolling == 0.0:
        W = W[:, : 3 * closed.sum()]
    M_inv = np.linalg.inv(force_directions.mass_matrix(scene.robot))
    if scene.robot.link_count > 1:
        W_J = force_directions.joint_directions(scene.robot, R)
        M_inv = M_inv - M_inv @ W_J @ np.linalg.solve(W_J.T @ M_inv @ W_J, W_J.T @ M_inv)
    return M_inv @ W, W.T @ M_inv @ W


@pytest.mark.parametrize('method', NEWTON)
@pytest.mark.parametrize('speed', [1e-4, 1e-2])
@pytest.mark.parametrize('link_count', [1, 2, 11])
def test_solvers_find_the_same_velocities_and_normal_impulses(method, speed, link_count):
    # The paper's iteration, converged, is the measure: the dense one itself for few links.
    measure = moreau.DenseStepper if link_count < 3 else METHODS['paper'].spatial
    slid = 0
    for seed, friction in enumerate(FRICTIONS.values()):
        scene, state, history, *others = random_step(
            seed, link_count, friction, laws=RULE, speed=speed
        )
        size, n = force_directions.mean_delassus(scene.robot), link_count
        solver = Solver(
            residual_tolerance=RESIDUAL, tolerance=0.01 * RESIDUAL, iteration_limit=100_000
        )
        scene = replace(scene, solver=solver)
        start = empty_history(scene)
        expected, expected_history, exact = measure(scene).advance(state, start, *others)
        end, history, report = METHODS[method].spatial(scene).advance(state, start, *others)
        assert not exact.unconverged and not report.unconverged
        slid += report.iterations > 1
        # Residuals are off in velocities of contacts: M^-1 W G^+ makes velocities of links of
        # them. The normal impulses, to which friction is proportional, are off by G^+ as well,
        # and in the null space of G by the residual over the compliance, which moves nothing but
        # what slides by friction.
        to_links, G = contact_operator(scene, state)
        modes = np.linalg.eigvalsh(G)
        lowest, left = modes[modes > 1e-9 * modes[-1]][0], 2 * math.sqrt(len(G)) * RESIDUAL
        most = max(history.impulse[:, 0].max(), 2 * np.abs(state.u[:, :3]).max())
        compliance = min(scene.solver.normal_compliance * size, PRESS_SPEED / most)
        in_impulses = left * (1 / lowest + 1 / compliance)
        mu = max(friction.longitudinal, friction.transversal, friction.rolling)
        in_links = np.linalg.norm(to_links, 2) * (left / lowest + mu * left / compliance)
        if method == 'newton':
            # It solves the links together with laws of a stiffness 1/(1e-6 G) at levers up to half
            # the length L of the robot: elimination rounds by size times condition, of which
            # the least inertia of a link makes L^2/4 stiffness/Theta_3.
            stiffness = 1 / (STICKING * size)
            half = scene.robot.per_link('link_length').sum() / 2
            condition = half**2 * stiffness / scene.robot.per_link('inertia_axial').min()
            rounding = 6 * n * EPS * condition * np.abs(expected.u).max()
            in_links += rounding
            in_impulses += rounding / lowest
        assert np.abs(end.u - expected.u).max() < in_links
        gap = history.impulse[:, 0] - expected_history.impulse[:, 0]
        assert np.abs(gap).max() < in_impulses
    assert slid > 2


def test_many_steps_are_single_steps_one_after_another():
    scene = load_scene('sidewinding')
    times = (np.arange(40) + 0.5) * scene.dt
    angle, rate = gait.reference(scene.gait, times, 10)
    state = initial_state(scene)
    for name in METHODS:
        limited = replace(scene, solver=Solver(iteration_limit=5))
        stepper = METHODS[name].spatial(limited)
        history = stepper.empty_history()
        whole = METHODS[name].spatial(limited).advance(state, history, angle, rate)
        parts = (state, history, None)
        for k in range(40):
            part = stepper.advance(parts[0], parts[1], angle[k : k + 1], rate[k : k + 1])
            report = part[2] if parts[2] is None else parts[2] + part[2]
            parts = (part[0], part[1], report)
        # The same operations in the same order: the same bits.
        assert (whole[0].q == parts[0].q).all()
        assert (whole[0].u == parts[0].u).all()
        assert same_bits(whole[1], parts[1])
        assert all(
            np.array_equal(*pair)
            for pair in zip(astuple(whole[2]), astuple(parts[2]), strict=True)
        )

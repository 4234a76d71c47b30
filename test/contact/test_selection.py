# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The selection rule: which of the many normal forces of a robot that lies flat are taken."""

from dataclasses import replace

from dense_step import dense_step, EPS, one_step
import numpy as np
from oracle import empty_history, make_stepper
import pytest
from random_states import random_robot
from scenes import NEWTON, SWEEPING
from scipy.optimize import nnls

from snake_sim_ros import Friction, Gait, Robot, Scene, Solver, State
from snake_sim_ros.contact.closing import left_gap
from snake_sim_ros.contact.laws import LEAST_COMPLIANCE, PRESS_SPEED
from snake_sim_ros.dynamics.force_directions import mean_delassus
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.scene.posture import gaps, joint_angles
from snake_sim_ros.stepping.base import Status
from snake_sim_ros.stepping.methods import METHODS
from snake_sim_ros.stepping.model import PROXIMAL
from snake_sim_ros.stepping.state import initial_state

DELTA = 1e-4  # default of Solver.normal_compliance
RESIDUAL = 1e-9  # m/s
TIGHT = 1e-13  # m/s
SCENE = replace(load_scene('lateral_undulation'), level='spatial')
each_method = pytest.mark.parametrize('method', NEWTON)


def lying(scene):
    """Return the robot at rest, 1e-9 m in the floor, and its own posture to hold."""
    q = initial_state(scene).q
    q[:, 2] -= 1e-9
    angle = joint_angles(q)
    return State(q, np.zeros((len(q), 6))), empty_history(scene), angle, np.zeros(angle.shape)


def equilibrium(step):
    """
    Return G and g of ``G P_N + g = 0``, no normal motion; contacts that stick are eliminated.

    Friction carries inner forces that press on the floor, too, since it acts below the centers.
    """
    G = step.delassus()
    free = step.gamma(step.velocities(np.zeros((len(step.active), 5)))).ravel()
    if step.scene.friction.longitudinal == 0.0:
        return G[::5, ::5], free[::5]
    normal = np.arange(0, len(G), 5)
    sliding = np.sort(np.append(normal + 1, normal + 2))
    stick = G[np.ix_(normal, sliding)] @ np.linalg.pinv(G[np.ix_(sliding, sliding)], 1e-10)
    schur = G[::5, ::5] - stick @ G[np.ix_(sliding, normal)]
    return (schur + schur.T) / 2, free[::5] - stick @ free[sliding]


@each_method
@pytest.mark.parametrize('mu', [0.0, 0.5])
@pytest.mark.parametrize('name', ['lateral_undulation', 'straight', 'random'])
def test_normal_forces_at_rest_are_those_of_least_norm(name, mu, method):
    settings = {'method': method, 'solver.residual_tolerance': TIGHT}
    scene = replace(SCENE, friction=Friction(longitudinal=mu, transversal=mu))
    scene = with_settings(scene, settings)
    if name != 'lateral_undulation':
        scene = replace(scene, gait=Gait())
    if name == 'random':  # one radius: else not all lie on the floor
        robot = random_robot(np.random.default_rng(7), 9)
        scene = replace(scene, robot=replace(robot, contact_radius=0.05))
    start = lying(scene)
    step = dense_step(scene, *start)
    end, history, report = one_step(scene, *start)
    assert report.status is Status.CONVERGED
    assert len(step.active) == 2 * scene.robot.link_count
    P_N = history.impulse[:, 0]
    P_T = np.linalg.norm(history.impulse[:, 1:3], axis=1)
    assert P_N.min() > 0.0
    assert mu == 0.0 or (P_T < mu * P_N).all()  # all stick
    G, free = equilibrium(step)
    direct = np.linalg.lstsq(G, -free, rcond=1e-9)[0]
    # Not negative by itself, so the same as with that constraint: NNLS of the equilibrium with
    # |P|^2/weight^2 added. The weight leaves 1e-8/lambda of P, lambda see below.
    weight = 1e4
    matrix = np.vstack([weight * G, np.eye(len(G))])
    expected = nnls(matrix, np.append(-weight * free, np.zeros(len(G))))[0]
    eigenvalues = np.linalg.eigvalsh(G)
    smallest = eigenvalues[eigenvalues > 1e-9 * eigenvalues[-1]][0]
    size = np.linalg.norm(direct)
    assert np.linalg.norm(expected - direct) <= 2 * size / (weight**2 * smallest**2) + 1e-9 * size
    # (G + c) P = -g moves the least-norm solution by at most c/lambda of it, lambda the smallest
    # eigenvalue of G that is not 0; what TIGHT leaves open moves it by TIGHT/c.
    share = step.compliance / smallest
    bound = share * size + len(P_N) * TIGHT / step.compliance
    assert np.linalg.norm(P_N - direct) <= bound
    weight = scene.robot.per_link('link_mass').sum() * 9.81
    np.testing.assert_allclose(P_N.sum() / scene.dt, weight, rtol=share)
    # The rule lets the robot sink at compliance P_N, and the residual is in m/s, too.
    assert np.abs(step.gamma(end.u)[:, 0] + step.compliance * P_N).max() <= 2 * TIGHT + 1e-15


def moving(scene):
    """Return the curved robot sliding and turning on the floor, all contacts closed."""
    state, history, angle, rate = lying(scene)
    state.u[:, 0], state.u[:, 1] = 0.3 - state.q[:, 1], -0.2 + state.q[:, 0]
    state.u[:, 4] = 1.0  # e_y of a flat link is up: 1 rad/s of the whole robot
    return state, history, angle, rate


def start_histories(scene):
    """Return histories that have nothing to do with the step, up to ten times the load."""
    rng = np.random.default_rng(3)
    histories = [empty_history(scene)]
    for size in (1e-4, 1e-3, 1e-2):
        history = empty_history(scene)
        contacts = rng.uniform(-size, size, (3, *history.impulse.shape))
        history.impulse[:], history.velocity[:], history.change[:] = contacts
        history.impulse[:, 0] = np.abs(history.impulse[:, 0])
        histories.append(history)
    return histories


@each_method
def test_the_result_does_not_depend_on_the_history(method):
    # The cap of the rule follows the last impulses (`apply_selection_rule`): a small compliance
    # keeps it out.
    settings = {'method': method, 'solver.residual_tolerance': 1e-12}
    scene = with_settings(SCENE, {**settings, 'solver.normal_compliance': 1e-5})
    state, _, angle, rate = moving(scene)
    ends = []
    for history in start_histories(scene):
        step = dense_step(scene, state, history, angle, rate)
        assert step.compliance == 1e-5 * mean_delassus(scene.robot)
        end, after, report = one_step(scene, state, history, angle, rate)
        assert report.status is Status.CONVERGED
        ends.append((end.u, after.impulse[:, 0]))
    # A residual e leaves e/compliance open in redundant normal impulses, and these the friction.
    slack = 2 * 22 * 1e-12 / step.compliance
    for u, P_N in ends[1:]:
        assert np.abs(P_N - ends[0][1]).max() <= slack
        # mu |G_T| <= 0.5 * 26 [1/kg], see section 7.6 of the specification
        assert np.abs(u - ends[0][0]).max() <= 13 * slack


@each_method
def test_without_the_rule_it_does(method):
    scene = with_settings(SCENE, {'method': method, 'solver.normal_compliance': 0.0})
    state, _, angle, rate = moving(scene)
    ends = []
    for history in start_histories(scene):
        end, after, report = one_step(scene, state, history, angle, rate)
        assert report.status is Status.CONVERGED
        ends.append((end.u, after.impulse[:, 0]))
    load = 7.5 * 9.81 * scene.dt / 22
    spread = max(np.abs(P_N - ends[0][1]).max() for _, P_N in ends[1:])
    assert spread > 0.1 * load  # another force distribution,
    spread = max(np.abs(u - ends[0][0]).max() for u, _ in ends[1:])
    assert spread > 1e3 * RESIDUAL  # and through friction another motion


@each_method
@pytest.mark.parametrize('name', ['lateral_undulation', 'sidewinding', 'sinus_lifting'])
def test_the_law_with_the_rule_holds_and_is_capped(name, method):
    settings = {'method': method, 'gait.soft_start': 0.5, 'level': 'spatial'}
    scene = with_settings(load_scene(name), settings)
    state, history, steps = initial_state(scene), empty_history(scene), 1500
    times = (np.arange(steps) + 0.5) * scene.dt
    references = gait.reference(scene.gait, times, scene.robot.link_count - 1)
    stepper = make_stepper(scene)
    for k in range(0, steps, 25):
        step = dense_step(scene, state, history, *(told[k] for told in references))
        before = history.impulse[:, 0].max()
        state, history, _ = stepper.advance(
            state, history, *(told[k : k + 1] for told in references)
        )
        gamma, P_N = step.gamma(state.u)[:, 0], history.impulse[step.active, 0]
        assert (gamma + step.compliance * P_N).min() >= -RESIDUAL
        # The cap is that of the impulses before the step: an impulse that grows presses more.
        growth = max(1.0, P_N.max() / before) if before > 0.0 else np.inf
        assert gamma.min() >= -PRESS_SPEED * growth - RESIDUAL
        state, history, _ = stepper.advance(
            state, history, *(told[k + 1 : k + 25] for told in references)
        )


@each_method
@pytest.mark.parametrize('ratio', [1.0, 10.0, 1000.0])
def test_at_rest_no_contact_sinks_faster_than_allowed(ratio, method):
    robot = SCENE.robot
    factor = np.where(np.arange(11) == 5, ratio, 1.0)
    heavy = {
        name: tuple(factor * robot.per_link(name))
        for name in ('link_mass', 'inertia_transversal', 'inertia_axial')
    }
    scene = replace(with_settings(SCENE, {'method': method}), robot=replace(robot, **heavy))
    state, history, angle, rate = lying(scene)
    for k in range(20):
        step = dense_step(scene, state, history, angle, rate)
        before = history.impulse[:, 0].max()
        state, history, report = one_step(scene, state, history, angle, rate)
        assert report.status is Status.CONVERGED
        if k > 0:  # before the first step nothing is known of the load
            growth = max(1.0, history.impulse[:, 0].max() / before)
            # Where the compliance is the least one, it presses with that times the impulse.
            least = LEAST_COMPLIANCE * mean_delassus(scene.robot) * history.impulse[:, 0].max()
            pressed = max(PRESS_SPEED * growth, least)
            assert step.gamma(state.u)[:, 0].min() >= -pressed - RESIDUAL
    # The weight is spread as it will stay: an impulse that still grew by 1 % would say otherwise.
    assert growth <= 1.01


# ---- mean_delassus ------------------------------------------------------------------------------


def test_mean_delassus_of_one_link():
    # v and omega_y of a free link at a distance L_GS along it: G_kk = 1/m + L_GS^2/Theta_1.
    robot = Robot(link_count=1)
    expected = 1 / robot.link_mass + robot.contact_offset**2 / robot.inertia_transversal
    assert mean_delassus(robot) == pytest.approx(expected, rel=10 * EPS)


@pytest.mark.parametrize('n', [1, 2, 5, 11])
def test_mean_delassus_scales_with_one_over_mass(n):
    robot = random_robot(np.random.default_rng(n), n)
    for factor in (1e-3, 7.0, 1e3):
        scaled = replace(
            robot,
            **{
                name: tuple(factor * robot.per_link(name))
                for name in ('link_mass', 'inertia_transversal', 'inertia_axial')
            },
        )
        # cond(W_J^T M^-1 W_J) is 1.4e5 for 11 links: that many roundings
        expected = mean_delassus(robot) / factor
        assert mean_delassus(scaled) == pytest.approx(expected, rel=1.4e5 * EPS)


def test_mean_delassus_is_that_of_the_step():
    # A straight robot at rest, with all spheres on the floor and no controller.
    robot = replace(
        random_robot(np.random.default_rng(5), 6),
        contact_radius=0.05,
        **dict.fromkeys(('yaw_stiffness', 'yaw_damping', 'pitch_stiffness', 'pitch_damping'), 0.0),
    )
    step = dense_step(scene := Scene(robot=robot), *lying(scene))
    expected = np.diag(step.delassus())[::5].mean()
    assert mean_delassus(robot) == pytest.approx(expected, rel=1.4e5 * EPS)


# ---- activation tolerance -----------------------------------------------------------------------


@pytest.mark.parametrize('method', [*NEWTON, *SWEEPING])
@pytest.mark.parametrize('tolerance', [1e-6, 1e-8, 0.0])
def test_a_contact_lands_without_a_gap(method, tolerance):
    # A link at rest over the floor. Up to the gap that counts as closed it stays where it is.
    # Beyond, it falls to the floor in the second half of the step, if g dt leads it there, and is
    # stopped. Without a tolerance, as printed, it falls until it is inside the floor.
    scene = Scene(
        robot=Robot(link_count=1), method=method, level='spatial',
        solver=Solver(activation_tolerance=tolerance),
    )  # fmt: skip
    dt, closed = scene.dt, min(tolerance, 2.5 * scene.dt**2)
    q, none = initial_state(scene).q, np.zeros((0, 2))
    lands = 0.5 * 9.81 * dt**2 if tolerance else 0.0
    # What an iteration leaves of its impulses, over its prox parameter, on each of two contacts.
    left = PRESS_SPEED + 2 * 1e-7 / 0.1
    for gap in (0.9 * closed, 1.1 * closed + 1e-15, 0.9 * lands, 1.1 * lands):
        q[0, 2] += gap - gaps(scene.robot, q).min()
        start = State(q, np.zeros((1, 6)))
        end, history, _ = one_step(scene, start, empty_history(scene), none, none)
        if gap <= max(closed, lands):
            assert abs(end.u[0, 2]) <= left
            kept = min(gap, left_gap(closed)) + left * dt / 2 + 1e-15
            assert abs(gaps(scene.robot, end.q).min()) <= kept
        else:
            assert end.u[0, 2] == pytest.approx(-9.81 * dt, rel=10 * EPS)
        assert np.count_nonzero(history.impulse[:, 0]) == (2 if gap <= max(closed, lands) else 0)


@pytest.mark.parametrize('method', [name for name in METHODS if name != 'bdf2'])
def test_a_step_closes_the_gaps_of_loaded_contacts(method):
    # A link falls so fast that its contacts are inside the floor in the middle of the step. A move
    # of 1e-4 m closes them to the proximal compliance of a gap, and changes no velocity: they are
    # at rest but for what the rule presses and iterations leave.
    scene = Scene(robot=Robot(link_count=1), method=method, level='spatial')
    q, none = initial_state(scene).q, np.zeros((0, 2))
    start = State(q, np.array([[0.0, 0.0, -1.0, 0.0, 0.0, 0.0]]))
    end, _, report = one_step(scene, start, empty_history(scene), none, none)
    assert np.abs(gaps(scene.robot, end.q)).max() <= 2 * PROXIMAL * scene.dt / 2
    assert report.penetration_max <= 2 * PROXIMAL * scene.dt / 2
    assert np.abs(end.u).max() <= 3 * PRESS_SPEED + 1e-7 / 0.1 * 2


@pytest.mark.parametrize('method', [name for name in METHODS if name != 'bdf2'])
def test_a_step_undoes_no_more_depth_than_it_makes(method):
    # A link that is 2 mm inside the floor at the start, and does not fall, stays there.
    scene = Scene(robot=Robot(link_count=1), method=method, level='spatial')
    q, none = initial_state(scene).q, np.zeros((0, 2))
    q[0, 2] -= 2e-3
    start = State(q, np.array([[0.01, 0.0, 0.0, 0.0, 0.0, 0.0]]))
    end, _, report = one_step(scene, start, empty_history(scene), none, none)
    assert np.abs(gaps(scene.robot, end.q) + 2e-3).max() <= 1e-9
    assert report.penetration_max == pytest.approx(2e-3, abs=1e-9)


def test_friction_does_not_change_who_carries_at_rest():
    # Nothing pulls along the floor: with and without friction the same forces.
    results = []
    for mu in (0.0, 0.5):
        scene = replace(SCENE, friction=Friction(longitudinal=mu, transversal=mu))
        scene = with_settings(scene, {'solver.residual_tolerance': TIGHT})
        results.append(one_step(scene, *lying(scene))[1].impulse[:, 0])
    step = dense_step(scene, *lying(scene))
    bound = 2 * 22 * TIGHT / step.compliance
    # No contact moves, so friction is only what couples in by sinking: compliance/G of the load.
    assert np.abs(results[0] - results[1]).max() <= bound + 10 * DELTA * results[0].max()

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What holds in every step of every gait: the contact laws, dissipation, symmetry, repeatability.

With eps the tolerance and r a prox parameter: the last sweep P' = prox_C(P - r gamma) changed P by
less than eps, where gamma are the velocities that the step ends with.
Methods that stop at a residual R leave P, which gave gamma, within r R of prox_C(P - r gamma).
"""

import math

import numpy as np
from oracle import empty_history, make_stepper, ORACLE
from oracle.contact_laws import selection_center, selection_compliance
from oracle.moreau import middle_coordinates
import pytest
from scenes import (
    chain_rounding,
    CLOSED,
    course,
    EPS,
    kinetic_energy,
    NEWTON,
    PRINTED,
    references,
    ROBOT,
    run,
    same_bits,
    SWEEPING,
)
from schemes import check_laws, of_two_states, step_of

from snake_sim_ros import Friction, Gait, ParameterError, Report, Robot, Scene, Solver, State, Wave
from snake_sim_ros.contact.closing import closed_gap
from snake_sim_ros.contact.detection import reach_of_step
from snake_sim_ros.contact.laws import LEAST_COMPLIANCE, STICKING
from snake_sim_ros.dynamics.force_directions import contact_directions, mean_delassus
from snake_sim_ros.scene.parameters import PD_SCHEMES
from snake_sim_ros.scene.posture import gaps
from snake_sim_ros.scene.rotations import about, product, rotation_matrices
from snake_sim_ros.stepping.bdf2.step import IMPLICIT_SCHEMES
from snake_sim_ros.stepping.methods import METHODS
from snake_sim_ros.stepping.state import initial_state


def wave(sign=1.0):
    """Return the yaw wave of lateral undulation, or its mirror image."""
    degree = math.radians(1.0)
    return Wave(
        amplitude=sign * 30 * degree, angular_frequency=80 * degree, phase_lag=-50 * degree
    )


PITCH = Wave(
    amplitude=math.radians(10),
    angular_frequency=math.radians(80),
    phase_lag=math.radians(-50),
    phase=math.pi / 2,
)
UNDULATION, SIDEWINDING = Gait(yaw=wave()), Gait(yaw=wave(), pitch=PITCH)
ORTHOTROPIC = Friction()
RULE: dict[str, float] = {}
ROLLING = Friction(longitudinal=0.2, transversal=0.2, rolling=0.05)


def contact_velocities(scene, q_mid, u):
    """Return (normal, sliding x y, rolling x y) of every contact [m/s], shape (2n, 5)."""
    W = contact_directions(scene.robot, rotation_matrices(q_mid[:, 3:]))
    gamma_N, gamma_T, gamma_V = (W_k.T @ u.ravel() for W_k in W)
    return np.column_stack([gamma_N, gamma_T.reshape(-1, 2), gamma_V.reshape(-1, 2)])


@pytest.mark.parametrize(
    ('method', 'links', 'steps', 'gait', 'friction', 'laws'),
    [
        ('newton', 11, 50, UNDULATION, ORTHOTROPIC, RULE),
        ('newton', 11, 100, SIDEWINDING, ORTHOTROPIC, RULE),
        ('newton', 3, 100, SIDEWINDING, ROLLING, RULE),
        ('newton', 3, 100, SIDEWINDING, ORTHOTROPIC, PRINTED),
        ('paper', 11, 50, UNDULATION, ORTHOTROPIC, PRINTED),
        ('paper', 11, 50, SIDEWINDING, ORTHOTROPIC, PRINTED),
        ('paper', 3, 100, SIDEWINDING, ROLLING, PRINTED),
        ('paper', 11, 50, SIDEWINDING, ORTHOTROPIC, RULE),
        (ORACLE, 3, 20, SIDEWINDING, ROLLING, PRINTED),
        (ORACLE, 3, 20, UNDULATION, ORTHOTROPIC, PRINTED),
        (ORACLE, 3, 20, SIDEWINDING, ROLLING, RULE),
    ],
)
def test_contacts_obey_their_laws_and_take_energy_in_every_step(
    method, links, steps, gait, friction, laws
):
    solver = Solver(tolerance=1e-7, residual_tolerance=1e-9, iteration_limit=20000, **laws)
    r = np.array([solver.r_normal, solver.r_sliding, solver.r_rolling])
    # How far the impulses of a step are from the projections [N s], and how far those are outside
    # that made the velocities: the last sweep is a projection of them.
    off = np.full(3, solver.tolerance) if method in SWEEPING else r * solver.residual_tolerance
    outside = np.zeros(3) if method in SWEEPING else off
    scene = Scene(
        robot=Robot(link_count=links), gait=gait, friction=friction, solver=solver, method=method,
        pd_scheme='midpoint',  # explicit: its torque is the same with and without contacts
        level='spatial',
    )  # fmt: skip
    size = mean_delassus(scene.robot)
    state = initial_state(scene)
    state.q[:, 2] += CLOSED
    states, impulses, report = course(scene, state, steps)
    assert not report.unconverged
    closed, sliding, pressed = [], 0, 0.0
    angle, rate = references(scene, steps)
    stepper = make_stepper(scene)
    for k in range(steps):
        start, end = (State(states.q[j], states.u[j]) for j in (k, k + 1))
        q_mid = middle_coordinates(start, scene.dt)
        gap, closes = gaps(scene.robot, q_mid), closed_gap(solver.activation_tolerance, scene.dt)
        touching = gap <= reach_of_step(closes, scene.dt / 2)
        P = impulses[k + 1][touching]
        gamma = contact_velocities(scene, q_mid, end.u)[touching]
        closed.append(touching.sum())
        P_N, P_T, P_V = P[:, 0], P[:, 1:3], P[:, 3:]
        gamma_T, gamma_V = gamma[:, 1:3], gamma[:, 3:]
        # The selection rule presses with c (P_N - center); c is less where PRESS_SPEED would be
        # exceeded by the last impulse, or by twice what stops the link and half its weight.
        before = contact_velocities(scene, q_mid, start.u)[touching, :3]
        stop = -scene.gravity[2] * scene.dt / 2 - 2 * before[:, 0]
        last = impulses[k][touching, 0]
        most = float(np.append(last, ROBOT.link_mass * stop).max(initial=0.0))
        c = selection_compliance(solver.normal_compliance * size, LEAST_COMPLIANCE * size, most)
        # A contact that lands has the velocity that closes its gap in half of the step.
        shift = np.where(gap > closes, gap / (scene.dt / 2), 0.0)[touching]
        weight = -scene.gravity[2] * scene.dt * scene.robot.per_link('link_mass').sum()
        gamma_N = gamma[:, 0] + shift + c * (P_N - selection_center(last, before, weight))
        pressed = max(pressed, (c * P_N).max(initial=0.0))
        # Signorini: P_N >= 0; where P_N' > 0, P_N' - P_N = -r gamma; where not, gamma >= -off/r.
        assert (P_N >= 0.0).all()
        assert (np.minimum(P_N, 1.0) * np.abs(gamma_N) <= P_N * off[0] / r[0] + outside[0]).all()
        assert (gamma_N >= -off[0] / r[0]).all()
        # Coulomb: in the ellipse, up to rounding of its projection.
        radii = np.array([friction.longitudinal, friction.transversal])
        reserve = P_N - np.hypot(*(P_T / radii).T)
        assert (reserve >= -8 * EPS * P_N - outside[1] / radii.min()).all()
        sliding += (reserve < 1e-6 * P_N).sum()
        assert (np.hypot(*P_V.T) <= friction.rolling * P_N * (1 + 8 * EPS) + outside[2]).all()
        # Dissipation: the projection P' is nearer to P - r gamma than 0, which is in the set too,
        # so that r gamma . P' <= (P - P') . P' <= off |P'|; P itself is `outside` beside P'.
        work = P_N.sum() * off[0] / r[0]
        for impulse, velocity, j in ((P_T, gamma_T, 1), (P_V, gamma_V, 2)):
            power = np.sum(impulse * velocity, axis=1)
            most = off[j] * (np.hypot(*impulse.T) + outside[j]) / r[j]
            most += outside[j] * np.hypot(*velocity.T)
            assert (power <= most * (1 + 8 * EPS)).all()
            work += most.sum()
        # Energy of the step against that of the same step without a floor, 10 m higher: joints do
        # no work on either velocity, so the difference is the work of the contact impulses at the
        # mean of both velocities: exactly so for the impulses before the last sweep, eps away.
        lifted = State(start.q + 10.0 * np.eye(7)[2], start.u)
        free, _, _ = stepper.advance(
            lifted, empty_history(scene), angle[k : k + 1], rate[k : k + 1]
        )
        loss = kinetic_energy(scene.robot, free.u) - kinetic_energy(scene.robot, end.u)
        mean = (gamma + contact_velocities(scene, q_mid, free.u)[touching]) / 2
        # Friction, normal and rolling parts change by eps each in a last sweep; 1e-15 J of
        # rounding in energies of 1e-2 J with their 66 summands; and what the method `newton`
        # rounds of the momentum at every contact, in an elimination of size 6n in place of 4.
        error = 1e-15 + 3 * solver.tolerance * np.linalg.norm(mean) * (method in SWEEPING)
        speed = np.abs(end.u).max()
        error += closed[-1] * 1.5 * links * chain_rounding(method, speed, size) * speed
        assert abs(loss + np.sum(P * mean)) < error
        assert loss >= -work - error
    # The test has seen what it is about: sliding, and sticking or open contacts.
    assert sliding
    assert min(closed) < 2 * links if gait is SIDEWINDING else sliding < sum(closed)
    assert (pressed > 1e-8) == (solver.normal_compliance > 0.0)


@pytest.mark.parametrize(
    ('links', 'steps', 'gait', 'friction', 'laws'),
    [
        (11, 20, UNDULATION, ORTHOTROPIC, RULE),
        (5, 50, SIDEWINDING, ORTHOTROPIC, RULE),
        (3, 100, SIDEWINDING, ROLLING, RULE),
        (3, 100, SIDEWINDING, ORTHOTROPIC, PRINTED),
    ],
)
def test_contacts_of_bdf2_obey_their_laws_and_take_energy(links, steps, gait, friction, laws):
    # At the predicted end of the step, see `schemes`; its first one has two parts.
    solver = Solver(residual_tolerance=1e-9, iteration_limit=20000, **laws)
    scene = Scene(
        robot=Robot(link_count=links), gait=gait, friction=friction, solver=solver, method='bdf2',
        level='spatial', drift_correction='none',
    )  # fmt: skip
    state, history, stepper = initial_state(scene), empty_history(scene), make_stepper(scene)
    checked = sliding = fewest = 0
    for angle, rate in zip(*references(scene, steps), strict=True):
        step = step_of(scene, state, history, angle, rate) if of_two_states(history) else None
        state, history, report = stepper.advance(state, history, angle[None], rate[None])
        assert not report.unconverged
        if step is None:
            continue
        if not of_two_states(history):
            step = step.last_solved(report.joint_torque)
        P = history.impulse[step.active]
        assert not np.delete(history.impulse, step.active, axis=0).any()
        slack = 100 * EPS * (np.abs(state.u).max() + np.abs(P).max() / solver.r_sliding)
        check_laws(step, P, state.u, 1e-9 + slack, step.balance_error(P, state.u))
        radii = np.array([friction.longitudinal, friction.transversal])
        used = np.hypot(*(P[:, 1:3] / radii).T)
        sliding += (used > (1 - 1e-6) * P[:, 0])[P[:, 0] > 0.0].sum()
        fewest = min(fewest or 2 * links, (P[:, 0] > 0.0).sum())
        checked += 1
    assert checked > 0.8 * steps
    assert sliding
    assert fewest < 2 * links or gait is UNDULATION


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('links', [1, 3, 11])
def test_velocities_are_those_that_the_impulses_give(method, links):
    # (75) in dense matrices, or the balance of bdf2 at its predicted end. Solvers iterate for the
    # laws only, so that what is left of it is rounding: eps times the condition of the joints,
    # 1.4e5, as in test_agreement, of velocities around 1. The last sweep of those that stop at a
    # change of impulses adds what their tolerance makes of velocities.
    steps = 50 if links < 11 else 10
    scene = Scene(
        robot=Robot(link_count=links), gait=SIDEWINDING, friction=ROLLING, method=method,
        level='spatial', drift_correction='none',
    )  # fmt: skip
    state, history, stepper = initial_state(scene), empty_history(scene), make_stepper(scene)
    checked = 0
    # Through the chain impulses are rounded with the stiffness of the laws, eps |gamma|/(1e-6 G):
    # 1e-10 N s at 0.1 m/s, and the torque of rolling turns a link by L_SC/Theta_3 of it.
    stiff = EPS * 0.1 / (STICKING * mean_delassus(scene.robot))
    turn = scene.robot.contact_radius / scene.robot.inertia_axial
    bound = stiff * turn * 2 * links if method == 'newton' else 1e-10
    for angle, rate in zip(*references(scene, steps), strict=True):
        step = None
        if method != 'bdf2' or of_two_states(history):
            step = step_of(scene, state, history, angle, rate)
        state, history, report = stepper.advance(state, history, angle[None], rate[None])
        if step is None:
            continue
        checked += 1
        if method == 'bdf2' and not of_two_states(history):
            step = step.last_solved(report.joint_torque)
        P, allowed = history.impulse[step.active], bound
        if method == 'bdf2':
            allowed = step.balance_error(P, state.u)
        if method in SWEEPING and len(P):
            allowed += scene.solver.tolerance * np.abs(step.responses()).sum(axis=1).max()
        assert np.abs(step.velocities(P) - state.u.ravel()).max() < allowed
    assert checked >= 0.8 * steps


@pytest.mark.parametrize('method', NEWTON)
def test_history_holds_impulses_velocities_and_their_changes(method):
    scene = Scene(robot=Robot(link_count=3), gait=SIDEWINDING, friction=ROLLING, method=method)
    stepper, state, history = make_stepper(scene), initial_state(scene), empty_history(scene)
    opened = 0
    for angle, rate in zip(*references(scene, 200), strict=True):
        start, before = state, history
        state, history, _ = stepper.advance(state, before, angle[None], rate[None])
        q_mid = middle_coordinates(start, scene.dt)
        gamma = contact_velocities(scene, q_mid, state.u)
        carries = history.impulse[:, 0] > 0.0
        lasts = carries & (before.impulse[:, 0] > 0.0)
        opened += (~carries).sum()
        assert history.memory is None
        for array in (history.impulse, history.velocity, history.change):
            assert not array[~carries].any()
        # Twists about O in place of velocities of links: rounding of lengths and speeds around 1.
        assert np.abs(history.velocity - gamma)[carries].max(initial=0.0) < 1e-13
        change = history.velocity - before.velocity
        change[:, 0] = (history.impulse - before.impulse)[:, 0]
        assert (history.change[lasts] == change[lasts]).all()
        assert not history.change[~lasts].any()
    assert opened


def lowered(scene):
    """
    Return the initial state with all contacts safely closed, 1e-6 m deep.

    A flat robot that touches the floor exactly has gaps of +-1e-17 m: which contacts are closed
    would be decided by rounding, and with it the split of the normal forces.
    """
    state = initial_state(scene)
    state.q[:, 2] -= 1e-6
    return state


# Symmetric runs differ by rounding, sweep by sweep; but where one stops a sweep earlier they
# differ by eps. Here all do the same number of sweeps, as the tolerance is out of reach. Rounding,
# 1e-16 of lengths of 1 m in each of 400 steps, grows along the path; contacts that open in one run
# and not in the other would make it chaotic later. 1e-9 m is far from both.
SWEEPS = Solver(tolerance=1e-300, iteration_limit=50, **PRINTED)
PATH = 1e-9  # m

# The others end at a residual, at which they arrive in the same iteration or are 1e-11 m/s off.
ENDS = Solver(residual_tolerance=1e-11)


def symmetric_solver(method):
    """Return settings with which two runs of a method differ by little more than rounding."""
    return SWEEPS if method in SWEEPING else ENDS


symmetric_cases = pytest.mark.parametrize(
    ('method', 'links', 'steps'),
    [
        ('newton', 11, 400),
        ('bdf2', 11, 400),
        ('paper', 11, 400),
        (ORACLE, 3, 30),
    ],
)
waves_and_friction = pytest.mark.parametrize(
    ('pitch', 'friction'), [(Wave(), ORTHOTROPIC), (PITCH, ROLLING)]
)


def check_close(end, other, start):
    """Check that two ends of runs are the same, and that they are not where they began."""
    assert np.abs(end.q[:, :3] - start.q[:, :3]).max() > 1e4 * PATH
    assert np.abs(end.q[:, :3] - other.q[:, :3]).max() < PATH
    assert np.abs(end.u[:, :3] - other.u[:, :3]).max() < 10 * PATH


@symmetric_cases
@waves_and_friction
def test_mirrored_gait_gives_the_mirrored_path(method, links, steps, pitch, friction):
    # y -> -y turns yaw angles around and leaves pitch angles and the floor as they are.
    ends, mirror = [], np.array([1.0, -1.0, 1.0])
    for sign in (1.0, -1.0):
        gait = Gait(yaw=wave(sign), pitch=pitch)
        scene = Scene(
            robot=Robot(link_count=links), gait=gait, friction=friction, method=method,
            solver=symmetric_solver(method),
        )  # fmt: skip
        start = lowered(scene)
        ends.append(run(scene, start, steps)[0])
    end = State(mirror * ends[0].q[:, :3], mirror * ends[0].u[:, :3])
    check_close(end, ends[1], start)


@symmetric_cases
@waves_and_friction
def test_robot_turned_on_the_floor_goes_the_turned_path(method, links, steps, pitch, friction):
    gait, turn = Gait(yaw=wave(), pitch=pitch), about(2, 1.234)
    scene = Scene(
        robot=Robot(link_count=links),
        gait=gait,
        friction=friction,
        solver=symmetric_solver(method),
        method=method,
    )
    start, R = lowered(scene), rotation_matrices(turn)
    turned = start.q.copy()
    turned[:, :3] = start.q[:, :3] @ R.T
    turned[:, 3:] = product(turn, start.q[:, 3:])
    end, _, _ = run(scene, start, steps)
    other, _, _ = run(scene, State(turned, start.u), steps)
    check_close(end, State(other.q[:, :3] @ R, other.u[:, :3] @ R), start)


def same(one, other):
    """Return whether states, histories and reports are equal bit by bit."""
    (a, history, report_a), (b, other_history, report_b) = one, other
    arrays = [(a.q, b.q), (a.u, b.u)]
    arrays.append((report_a.joint_torque, report_b.joint_torque))
    values = [
        {k: v for k, v in vars(report).items() if k != 'joint_torque'}
        for report in (report_a, report_b)
    ]
    states_are = all(x.tobytes() == y.tobytes() for x, y in arrays)
    return states_are and same_bits(history, other_history) and values[0] == values[1]


@pytest.mark.parametrize(
    ('method', 'links', 'chunks', 'length'),
    [
        ('newton', 11, 20, 50),
        ('bdf2', 11, 20, 50),
        ('paper', 11, 20, 50),
    ],
)
@pytest.mark.parametrize('pd_scheme', PD_SCHEMES)
def test_repeated_and_divided_runs_are_equal_bit_by_bit(method, links, chunks, length, pd_scheme):
    scene = Scene(
        robot=Robot(link_count=links), gait=SIDEWINDING, friction=ROLLING, method=method,
        pd_scheme=pd_scheme,
    )  # fmt: skip
    if method == 'bdf2' and pd_scheme not in IMPLICIT_SCHEMES:
        with pytest.raises(ParameterError, match=f'pd_scheme {pd_scheme} is explicit, and'):
            make_stepper(scene)
        return
    start, steps = initial_state(scene), chunks * length
    before = start.q.copy(), start.u.copy()
    whole = run(scene, start, steps)
    assert same(whole, run(scene, start, steps))
    # Divided, with a stepper that has done other steps before.
    stepper = make_stepper(scene)
    angle, rate = references(scene, steps)
    stepper.advance(start, empty_history(scene), angle[:7], rate[:7])
    state, history, report = start, empty_history(scene), Report()
    for k in range(0, steps, length):
        part = slice(k, k + length)
        state, history, news = stepper.advance(state, history, angle[part], rate[part])
        report += news
    assert same(whole, (state, history, report))
    # The arguments are left alone.
    assert np.array_equal(start.q, before[0]) and np.array_equal(start.u, before[1])

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The planar level: against its dense step, and its loads, friction and motion in closed form."""

from dataclasses import replace
from itertools import pairwise
import math

from flat_states import crooked, flat_robot, headings, in_plane, lying_flat
import numpy as np
from oracle import empty_history, make_stepper, ORACLE
import pytest
from scenes import course, EPS, G, kinetic_energy, MASS, OFFSET, RADIUS, references
from schemes import span
from scipy.linalg import null_space

from snake_sim_ros import Friction, ParameterError, Robot, Scene, Solver
from snake_sim_ros.scene.parameters import load_scene, PD_SCHEMES
from snake_sim_ros.scene.posture import center_of_mass, joint_angles
from snake_sim_ros.stepping.base import Status
from snake_sim_ros.stepping.contact_forces import last_span
from snake_sim_ros.stepping.methods import METHODS
from snake_sim_ros.stepping.planar.model import HOLD, ROOT_HOLD
from snake_sim_ros.stepping.state import initial_state

RESIDUAL = 1e-12  # m/s
# Impulses are some 1e-3 N s, rounded through the chain of joints: 1e5 EPS of it at most.
EXACT = Solver(tolerance=1e-12, residual_tolerance=RESIDUAL, r_sliding=0.03)
COMPILED = list(METHODS)
each_method = pytest.mark.parametrize('method', [*METHODS, ORACLE])
# So little that a robot that slides at will in all directions does not roll over.
FRICTIONS = {
    'orthotropic': Friction(longitudinal=0.02, transversal=0.1),
    'isotropic': Friction(longitudinal=0.05, transversal=0.05),
    'none': Friction(longitudinal=0.0, transversal=0.0),
}
ONE = Robot(link_count=1)
# Share of a load that the compiled step may be off. Pitch joints hold the robot against rolling as
# springs of a share HOLD of the stiffness of contacts and carry that of what contacts should, and
# the floor carries ROOT_HOLD/HOLD of what the joints should. The shape of a robot amplifies both,
# by less than 10 where it is bent by 0.2 rad a joint.
HELD = 10 * (HOLD + ROOT_HOLD / HOLD)


def flat_scene(method='newton', **settings):
    """Return a scene of the planar level, solved exactly."""
    return Scene(**{'method': method, 'level': 'planar', 'solver': EXACT, **settings})


def held(state, steps):
    """Return references that hold the joint angles of a state."""
    angle = np.tile(joint_angles(state.q), (steps, 1, 1))
    return angle, np.zeros(angle.shape)


def advance(scene, state, angle, rate):
    """Return what a new stepper makes of a state without history."""
    return make_stepper(scene).advance(state, empty_history(scene), angle, rate)


# ---- against the dense step ---------------------------------------------------------------------


def random_problem(seed, link_count):
    """Return a robot, a state and references of one step."""
    rng = np.random.default_rng([seed, link_count])
    robot = flat_robot(rng, link_count)
    state = crooked(rng, robot, speed=10.0 ** -(seed % 3))
    angle, rate = held(state, 1)
    angle[..., 0] += rng.uniform(-0.05, 0.05, angle.shape[:2])
    rate[..., 0] = rng.uniform(-1.0, 1.0, rate.shape[:2])
    return robot, state, angle, rate


def check_with_dense_step(scene, state, angle, rate):
    """Check a step of all methods against that of a scene; return how many could take it."""
    taken, link_count = 0, scene.robot.link_count
    end, history, report = advance(scene, state, angle, rate)
    largest = history.impulse[:, 0].max()
    # Friction is mu of the load; a link turns by L_GS/Theta_1 = 41/(kg m) of it at most,
    # which is more than 1/m, and rounds by the condition of the joints, 1.4e5.
    load = HELD * largest + EXACT.tolerance
    speed = 41 * 2 * link_count * scene.friction.transversal * load + 1.4e5 * EPS
    for method in COMPILED:
        if method == 'bdf2':  # another step, see below
            continue
        other, memory, news = advance(replace(scene, method=method), state, angle, rate)
        assert news.failure == report.failure, method
        if report.failure:
            continue
        taken += 1
        assert news.contacts == report.contacts == 2 * link_count
        assert np.abs(memory.impulse - history.impulse).max() < load, method
        assert np.abs(other.u - end.u).max() < speed, method
        assert np.abs(other.q - end.q).max() < scene.dt * speed + 10 * EPS, method
        # Yaw torques change with the rates, in the implicit part; pitch torques carry
        # the moment of loads, with levers below the length of the robot.
        yaw = news.joint_torque[:, 0] - report.joint_torque[:, 0]
        assert np.abs(yaw).max() < 1.0 * speed, method
        pitch = news.joint_torque[:, 1] - report.joint_torque[:, 1]
        assert np.abs(pitch).max() < link_count * load / scene.dt, method
    return taken


@pytest.mark.parametrize('pd_scheme', PD_SCHEMES)
@pytest.mark.parametrize('rule', ['paper', 'center_of_mass'])
def test_steps_agree_with_the_dense_step(rule, pd_scheme):
    taken = 0
    for link_count in (2, 3, 5, 12):
        for seed, friction in enumerate(FRICTIONS.values()):
            robot, *start = random_problem(seed, link_count)
            settings = {'robot': robot, 'friction': friction, 'drift_correction': rule}
            scene = flat_scene(ORACLE, pd_scheme=pd_scheme, **settings)
            taken += check_with_dense_step(scene, *start)
    assert taken >= 10 * (len(COMPILED) - 1)


@pytest.mark.parametrize('link_count', [3, 5, 12])
def test_a_robot_with_both_spheres_at_the_center_of_each_link_agrees_with_the_dense_step(
    link_count,
):
    # Nothing but the pitch joints keeps its links from pitching to and fro.
    robot, *start = random_problem(1, link_count)
    robot = replace(robot, contact_offset=0.0)
    scene = flat_scene(ORACLE, robot=robot, friction=FRICTIONS['isotropic'])
    assert check_with_dense_step(scene, *start) == len(COMPILED) - 1


@pytest.mark.parametrize('rule', ['paper', 'center_of_mass'])
@pytest.mark.parametrize('link_count', [5, 7])
def test_bdf2_goes_to_the_path_of_the_dense_step(link_count, rule):
    # The same motion as dt goes to 0: paths are apart by what the order of both makes of dt, the
    # paper's step by half as much at half the step, or better where the second order counts.
    robot, state, angle, _ = random_problem(1, link_count)
    apart = []
    for k in range(3):
        dt, steps = 1 / 1000 / 2**k, 10 * 2**k
        settings = {'robot': robot, 'friction': FRICTIONS['isotropic'], 'drift_correction': rule}
        ends = {}
        for method in (ORACLE, 'bdf2'):
            scene = flat_scene(method, dt=dt, **settings)
            references = np.tile(angle, (steps, 1, 1)), np.zeros((steps, link_count - 1, 2))
            ends[method], _, report = advance(scene, state, *references)
            assert not report.failure
        apart.append(np.abs(ends['bdf2'].q - ends[ORACLE].q)[:, :3].max())
    ratios = np.divide(apart[:-1], apart[1:])
    assert ratios.min() > 1.6, apart


@pytest.mark.parametrize('pd_scheme', ['start', 'midpoint'])
def test_bdf2_refuses_explicit_control(pd_scheme):
    robot, state, angle, rate = random_problem(0, 2)
    with pytest.raises(ParameterError, match=f'pd_scheme {pd_scheme} is explicit, and'):
        advance(flat_scene('bdf2', robot=robot, pd_scheme=pd_scheme), state, angle, rate)


@each_method
@pytest.mark.parametrize('angle', [0.0, 0.7, 2.1, 3.9])
def test_one_link_that_stopped_stands_in_any_direction(method, angle):
    # What the solver leaves of friction across, 1e-15 N s, is no reason to roll.
    friction = Friction(longitudinal=0.3, transversal=0.5)
    scene = flat_scene(method, robot=ONE, friction=friction, dt=1 / 1000)
    start = in_plane(ONE, lying_flat(ONE, np.zeros(0), angle), 0.03 * heading(angle), np.zeros(1))
    steps = 30 if method == ORACLE else 300
    _, _, report = advance(scene, start, *held(start, steps))
    assert (report.failure, report.steps) == ('', steps)


@pytest.mark.parametrize('method', COMPILED)
def test_one_link_agrees_with_the_dense_step(method):
    # Nothing holds it against rolling and nothing makes it roll: loads are exact.
    state = in_plane(ONE, lying_flat(ONE, np.zeros(0), 0.7), 0.3 * heading(0.7), np.zeros(1))
    if method == 'bdf2':  # exact under a constant force, with impulses for the time they act
        scene = flat_scene(method, robot=ONE)
        end, history, report = advance(scene, state, *held(state, 1))
        assert report.status is Status.CONVERGED
        mu, dt = scene.friction.longitudinal, scene.dt
        acted = last_span(scene, history)
        share = mu * RADIUS / OFFSET * np.array([1, -1])
        load = MASS * G / 2 * (1 + share) * acted
        assert np.abs(history.impulse[:, 0] - load).max() < 1e-13
        assert np.abs(history.impulse[:, 1] + mu * load).max() < 1e-13
        assert np.abs(end.u[0, :2] - (0.3 - mu * G * dt) * heading(0.7)).max() < 1e-11
        way = (end.q - state.q)[0, :2] - (0.3 * dt - mu * G * dt**2 / 2) * heading(0.7)
        assert np.abs(way).max() < 10 * EPS
        return
    end, history, _ = advance(flat_scene(ORACLE, robot=ONE), state, *held(state, 1))
    other, memory, report = advance(flat_scene(method, robot=ONE), state, *held(state, 1))
    assert report.status is Status.CONVERGED
    assert np.abs(other.u - end.u).max() < 1e-11
    assert np.abs(memory.impulse - history.impulse).max() < 1e-13


def test_solvers_agree_along_a_gait():
    # Of case A from 0.1 s on: at its start projections need not converge. Each step leaves a
    # residual, 1e-9 m/s, in the velocities of 22 contacts, and loads that follow.
    scene = replace(load_scene('lateral_undulation'), dt=1 / 1000)
    angle, rate = references(scene, 500)
    state, history, _ = advance(scene, initial_state(scene), angle[:100], rate[:100])
    ends = {}
    for method in COMPILED:
        stepper = make_stepper(replace(scene, method=method))
        # They all go on with the same planar coordinates; `bdf2` with what it knows at first.
        empty = stepper.empty_history().memory
        planar = history.memory.planar._replace(scheme=empty.planar.scheme)
        start = state, history._replace(memory=empty._replace(planar=planar))
        ends[method], _, report = stepper.advance(*start, angle[100:], rate[100:])
        assert report.status is Status.CONVERGED
        assert report.planar_steps == report.steps == 400
    for method in COMPILED:
        off = np.abs(ends[method].q - ends['newton'].q)[:, :3].max()
        if method == 'bdf2':  # another step: that of the paper is late by a part of dt
            assert off < scene.dt * np.abs(ends['newton'].u[:, :3]).max()
        elif method == 'paper':  # it stops at a change of impulses
            assert off < 0.4 * 22 * scene.solver.tolerance / scene.solver.r_sliding
        else:
            assert off < 0.4 * 22 * 1e-9


# ---- loads --------------------------------------------------------------------------------------


def heading(angle):
    """Return the unit vector of a heading."""
    return np.array([math.cos(angle), math.sin(angle)])


def upright_motions(robot, q):
    """
    Return what the robot can do out of the plane, and the vertical velocities of contacts.

    Minimal coordinates: heave, roll and pitch of all, and each pitch joint, about e_x of its outer
    link. Shapes (n, 3, n+2) for (v_z, omega_x, omega_y) of links, (2n, n+2).
    """
    n, theta = robot.link_count, headings(q)
    half, offset = robot.per_link('link_length') / 2, robot.per_link('contact_offset')
    motions = np.zeros((n, 3, n + 2))
    for i in range(n):
        x, y = q[i, :2]
        motions[i, :, :3] = [[1.0, y, -x], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
        for j in range(i):
            a, b = -math.sin(theta[j + 1]), math.cos(theta[j + 1])
            px, py = q[j, :2] + half[j] * heading(theta[j])
            motions[i, :, 3 + j] = a * (y - py) - b * (x - px), a, b
    ahead = np.array([heading(angle) for angle in theta])
    lever = offset[:, None] * (motions[:, 1] * ahead[:, 1:] - motions[:, 2] * ahead[:, :1])
    return motions, np.vstack([motions[:, 0] + lever, motions[:, 0] - lever])


def load_of_friction(scene, q, tangential, time):
    """Return the impulses (n, 3) out of the plane of weight and of friction in a time."""
    n, radius = scene.robot.link_count, scene.robot.per_link('contact_radius')
    load = np.zeros((n, 3))
    load[:, 0] = -scene.robot.per_link('link_mass') * G * time
    for i, angle in enumerate(headings(q)):
        along, across = tangential[i] + tangential[n + i]
        Px, Py = along * heading(angle) + across * heading(angle + math.pi / 2)
        load[i, 1:] = radius[i] * Py, -radius[i] * Px  # (0, 0, -r) x P
    return load


@each_method
def test_loads_are_those_of_least_norm(method):
    for seed, link_count in enumerate((2, 4, 7, 11)):
        robot, state, angle, rate = random_problem(seed, link_count)
        scene = flat_scene(method, robot=robot, friction=FRICTIONS['orthotropic'], pd_scheme='end')
        end, history, report = advance(scene, state, angle, rate)
        if report.failure:
            continue
        theta = headings(state.q) + scene.dt / 2 * state.u[:, 4]
        acted = scene.dt
        if method == 'bdf2':  # at the end, of which the prediction is off by the acceleration
            theta = headings(end.q)
            acted = last_span(scene, history)
        middle = lying_flat(robot, np.diff(theta), theta[0])
        motions, vertical = upright_motions(robot, middle)
        load = load_of_friction(scene, middle, history.impulse[:, 1:3], acted)
        forces = np.einsum('ikc,ik->c', motions, load)
        # Rolling is what no contact sees; pitch joints hold it as springs of their stiffness do.
        rolling = null_space(vertical, rcond=1e-9)
        spring = np.zeros((link_count + 2, 1))
        spring[3:] = robot.per_joint('stiffness')[:, 1:] * rolling[3:]
        free = null_space(spring.T)
        expected = np.linalg.pinv(free.T @ vertical.T, rcond=1e-9) @ (-free.T @ forces)
        P_N = history.impulse[:, 0]
        share = 1e-9 if method == ORACLE else HELD
        assert np.abs(P_N - expected).max() <= share * P_N.max()
        # Of the whole robot, whatever joints do: but for a share of the moments of friction.
        whole = (vertical.T @ P_N + forces)[:3]
        assert np.abs(whole).max() <= share * 0.1 * 0.05 * P_N.sum()
        weight = robot.per_link('link_mass').sum() * G
        assert P_N.sum() / acted == pytest.approx(weight, rel=1e-9)


@each_method
def test_a_straight_robot_at_rest_carries_half_a_link_with_each_contact(method):
    robot = Robot()
    state = in_plane(robot, lying_flat(robot, np.zeros(10)), np.zeros(2), np.zeros(11))
    _, history, report = advance(flat_scene(method), state, *held(state, 3))
    assert report.status is Status.CONVERGED
    # Out of the plane the chain of springs has a condition of some (n L/L_GS)^2 n = 1e4.
    acted = last_span(flat_scene(method), history)
    assert history.impulse[:, 0] / acted == pytest.approx(MASS * G / 2, rel=1e-10)
    assert not history.impulse[:, 1:].any()


@each_method
@pytest.mark.parametrize('angle', [0.0, 2.1])
def test_t1_one_link_slides_along_its_axis(method, angle):
    # N_F,R = (m g/2)(1 +- mu r/L_GS), constant friction mu m g, and rest after v0/(mu g). The
    # mean velocity of a step is exact, so that the way is, if v0 is a multiple of mu g dt.
    mu, steps, dt = 0.3, 100, 1 / 1000
    friction = Friction(longitudinal=mu, transversal=0.5)
    scene = flat_scene(method, robot=ONE, friction=friction, dt=dt)
    speed = steps * mu * G * dt
    start = in_plane(ONE, lying_flat(ONE, np.zeros(0), angle), speed * heading(angle), np.zeros(1))
    states, impulses, report = course(scene, start, steps + 10)
    assert report.status is Status.CONVERGED
    share = mu * RADIUS / OFFSET
    acted = np.full((steps - 2, 1), span(scene))
    if method == 'bdf2':  # the first step ends with a part of dt/2, after parts of dt/4
        acted[:2, 0] = 3 / 5 * dt / 2, 3 / 5 * dt  # both twice as long as the part before
    expected = MASS * G / 2 * np.array([1 + share, 1 - share]) * acted
    # Heading and contacts round; the last iterate leaves tolerance/r_T or RESIDUAL.
    assert np.abs(impulses[1 : steps - 1, :, 0] - expected).max() < 1e-10 * MASS * G * dt
    left = EXACT.tolerance / EXACT.r_sliding  # m/s
    way = (states.q[:, 0, :2] - start.q[0, :2]) @ heading(angle)
    # The formula of two states goes on for a bit of the step in which the link stops: a third of
    # its way, mu g dt^2/2, a third of that, and so on.
    beyond = mu * G * dt**2 / 4 * (1 - 3.0**-10) if method == 'bdf2' else 0.0
    assert way[-1] - beyond == pytest.approx(speed**2 / (2 * mu * G), abs=2 * steps * dt * left)
    assert np.abs(states.u[steps:]).max() < 2 * left


@pytest.mark.parametrize('method', COMPILED)
def test_a_link_that_would_tip_over_is_noticed(method):
    # The rear sphere lifts at mu > L_GS/r = 0.7486; auto takes up the step at the spatial level.
    start = in_plane(ONE, lying_flat(ONE, np.zeros(0)), heading(0.0), np.zeros(1))
    for mu, planar in ((0.74, True), (0.76, False)):
        friction = Friction(longitudinal=mu, transversal=mu)
        scene = flat_scene(method, robot=ONE, friction=friction)
        end, _, report = advance(scene, start, *held(start, 5))
        assert (report.failure == '') == planar
        if planar:
            assert report.steps == 5
            continue
        assert report.failure == (
            'level planar: the rear sphere of link 1 would lift off; choose level spatial or auto'
        )
        assert report.steps == 0
        assert (end.q == start.q).all() and (end.u == start.u).all()
        _, _, report = advance(replace(scene, level='auto'), start, *held(start, 5))
        assert (report.failure, report.steps, report.planar_steps) == ('', 5, 0)
        assert (report.level, report.left) == (
            'spatial', 'the rear sphere of link 1 would lift off'
        )  # fmt: skip


# ---- friction -----------------------------------------------------------------------------------


@each_method
def test_t7_friction_is_along_the_normal_of_its_ellipse(method):
    # Contacts at the height of the center of gravity: the link slides in any direction and does
    # not turn. Implicitly, v' = v - g dt D^2 v'/|D v'| with D = diag(mu_x, mu_y).
    mu = np.array([0.1, 0.4])
    robot = Robot(link_count=1, contact_radius=0.0)
    friction = Friction(longitudinal=mu[0], transversal=mu[1])
    scene = flat_scene(method, robot=robot, friction=friction, dt=1 / 200)
    q = lying_flat(robot, np.zeros(0), 0.4)
    axes = np.array([heading(0.4), heading(0.4 + math.pi / 2)])
    start = in_plane(robot, q, np.array([0.3, 0.5]) @ axes, np.zeros(1))
    states, impulses, report = course(scene, start, 20)
    assert report.status is Status.CONVERGED
    assert (impulses[1:, :, 0] > 0).all()
    v = states.u[:, 0, :2] @ axes.T
    before, after = v[:-1], v[1:]
    if method == 'bdf2':  # the same from u_hat, for the time in which its impulses act
        # (in the second step from a state within the first one)
        before, after = (4 * v[2:-1] - v[1:-2]) / 3, v[3:]
    power = np.linalg.norm(mu * after, axis=1)[:, None]
    change = before - G * span(scene) * mu**2 * after / power
    # What a residual leaves: 2/m of r_T gamma at two contacts, or of the tolerance.
    left = 10 * EXACT.tolerance / MASS
    assert np.abs(after - change).max() < left
    assert np.abs(states.u[:, 0, 5]).max() < left / OFFSET


@pytest.mark.parametrize('method', COMPILED)
def test_a_robot_that_sticks_does_not_creep(method):
    # Wound up by its joints to below what friction bears; then velocities are residuals.
    scene = replace(load_scene('lateral_undulation'), method=method, dt=1 / 1000)
    friction = Friction(longitudinal=0.5, transversal=0.5)
    solver = replace(EXACT, residual_tolerance=1e-10)
    scene = replace(scene, friction=friction, solver=solver, level='planar')
    state, history, stepper = initial_state(scene), empty_history(scene), make_stepper(scene)
    angle, rate = held(state, 1000)
    angle[..., 0] += 0.0005 * (-1.0) ** np.arange(10)
    rest, history, _ = stepper.advance(state, history, angle[:400], rate[:400])
    end, history, report = stepper.advance(rest, history, angle[400:], rate[400:])
    P = history.impulse
    used = np.linalg.norm(P[:, 1:3], axis=1) / (0.5 * P[:, 0])
    assert used.min() >= 0.0 and 0.05 < used.max() < 0.99
    assert report.status is Status.CONVERGED
    # Residuals of 22 contacts, one for every step.
    assert np.abs(end.q - rest.q)[:, :3].max() <= 600 * scene.dt * 22 * 1e-10 + 100 * EPS


def test_friction_takes_energy_and_the_floor_does_no_work():
    # Joints without gains: nothing but friction works. u' solves M (u' - u) = W P with joints of
    # the middle of the step, in which u is off by O(dt) of the joints: they only take of it, too.
    robot = Robot(
        link_count=5, yaw_stiffness=0.0, yaw_damping=0.0, pitch_stiffness=800.0, pitch_damping=0.2
    )
    rng = np.random.default_rng(3)
    scene = flat_scene(robot=robot, friction=FRICTIONS['orthotropic'], dt=1 / 1000)
    start = crooked(rng, robot, 0.5)
    states, impulses, report = course(scene, start, 200)
    assert report.status is Status.CONVERGED
    energy = kinetic_energy(robot, states.u)
    assert (np.diff(energy) <= 100 * EPS * energy[0]).all()
    assert energy[-1] < 0.9 * energy[0]
    within = np.linalg.norm(impulses[1:, :, 1:3] / [0.02, 0.1], axis=2) <= impulses[1:, :, 0] * (
        1 + 1e-9
    )
    assert within.all()


# ---- motion -------------------------------------------------------------------------------------


def angular_momentum(robot, state_q, state_u):
    """Return the angular momentum about the vertical through the origin [N m s]."""
    mass, across = robot.per_link('link_mass'), robot.per_link('inertia_transversal')
    q, u = state_q, state_u
    return mass @ (q[:, 0] * u[:, 1] - q[:, 1] * u[:, 0]) + across @ u[:, 4]


def test_momentum_is_kept_without_friction():
    # The gait pulls at its joints, nothing else acts. Linear momentum is exact; each step acts in
    # the directions of its middle, so that of spin it makes an error of first order in all.
    time, errors = 0.2, []
    for dt in 1 / 1000 / 2.0 ** np.arange(4):
        scene = load_scene('lateral_undulation')
        scene = replace(
            scene, friction=FRICTIONS['none'], dt=dt, drift_correction='center_of_mass'
        )
        scene = replace(scene, level='planar')
        robot, rest = scene.robot, initial_state(scene)
        start = in_plane(robot, rest.q, np.array([0.2, -0.1]), np.full(11, 0.5))
        states, _, _ = course(scene, start, round(time / dt), round(time / dt))
        mass = robot.per_link('link_mass')
        momentum = np.einsum('i,kij->kj', mass, states.u[:, :, :2])
        assert np.abs(momentum[-1] - momentum[0]).max() < time / dt * 100 * EPS * mass.sum()
        moved = center_of_mass(robot, states.q[-1]) - center_of_mass(robot, states.q[0])
        expected = np.append(momentum[0] / mass.sum() * time, 0.0)
        assert np.abs(moved - expected).max() < time / dt * 100 * EPS
        spin = [angular_momentum(robot, states.q[k], states.u[k]) for k in (0, -1)]
        errors.append(abs(spin[1] - spin[0]))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 0.8).all(), (errors, orders)
    assert errors[-1] < 1e-3 * abs(spin[0])


def test_order_of_lateral_undulation():
    # First order, by what velocities do to the joints; sampled at 0.25 s, from rest.
    ends = []
    for dt in 1 / 500 / 2.0 ** np.arange(4):
        scene = replace(load_scene('lateral_undulation'), dt=dt, level='planar')
        steps = round(0.25 / dt)
        states, _, report = course(scene, initial_state(scene), steps, steps)
        assert report.status is Status.CONVERGED
        ends.append(states.q[-1, :, :2])
    errors = [np.abs(a - b).max() for a, b in pairwise(ends)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.abs(orders - 1.0).max() < 0.2, orders


def test_a_rigid_robot_turns_about_its_center():
    # Held straight by its joint, no friction: its links keep the momentum that the joint does not
    # pull out of line when the directions turn, from the middle of one step to that of the next
    # (by half of it before the first): omega' = omega (1 - k (1 - cos(omega dt))) with
    # k = m (L/2)^2/(m (L/2)^2 + Theta_1), as in test_robot_physics but for exact angles.
    robot = Robot(link_count=2)
    scene = flat_scene(robot=robot, friction=FRICTIONS['none'], drift_correction='center_of_mass')
    half, spin, steps = robot.link_length / 2, 2.0, 400
    q = lying_flat(robot, np.zeros(1))
    q[:, 0] -= half
    start = in_plane(robot, q, np.array([0.0, -half * spin]), np.full(2, spin))
    states, _, _ = course(scene, start, steps, steps)
    k = MASS * half**2 / (MASS * half**2 + robot.inertia_transversal)
    omega, turned, dt = spin, 0.0, scene.dt
    for step in range(steps):
        before, turn = omega, omega * dt * (1.0 if step else 0.5)
        omega *= 1 - k * (1 - math.cos(turn))
        turned += dt / 2 * (before + omega)
    assert np.abs(states.u[-1, :, 4] - omega).max() < steps * 10 * EPS * spin
    assert np.abs(headings(states.q[-1]) - turned).max() < steps * 10 * EPS
    assert np.abs(center_of_mass(robot, states.q[-1])[:2]).max() < steps * 10 * EPS * half

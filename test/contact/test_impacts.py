# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Impacts of one link on the floor, also those that friction causes without a collision.

The impact law is that of the paper: completely inelastic, friction of Coulomb's kind in impulses.
"""

from dataclasses import replace
import math

import numpy as np
from obstacle_scenes import MIDDLE
from oracle import make_stepper, ORACLE
import pytest
from scenes import (
    ACROSS,
    chain_rounding,
    course,
    each_method,
    EPS,
    every_method,
    G,
    isotropic,
    kinetic_energy,
    link_scene,
    lying,
    MASS,
    OFFSET,
    pitched,
    PRINTED,
    RADIUS,
    references,
    ROBOT,
    run,
    SPEED,
    TIGHT,
)

from snake_sim_ros import Gait, Robot, Scene, Simulation, Solver, State, Wave
from snake_sim_ros.contact.closing import closed_gap, left_gap
from snake_sim_ros.contact.laws import IMPACT_WEIGHTS, LEAST_COMPLIANCE, PRESS_SPEED, REST_SPEED
from snake_sim_ros.dynamics.force_directions import mean_delassus
from snake_sim_ros.scene.rotations import product, rotation_matrices
from snake_sim_ros.stepping.methods import METHODS
from snake_sim_ros.stepping.state import initial_state


@each_method
@pytest.mark.parametrize('angle', [math.radians(30), math.radians(-30)])
def test_pitched_link_lands_on_one_end(method, dt, angle):
    # Frictionless inelastic impact of the lower sphere at the lever c = L_GS cos 30 deg from the
    # center, q = m c^2/Theta_1: v+ = v- q/(1 + q), omega+ = |v-| (m c/Theta_1)/(1 + q), E+/E- =
    # q/(1 + q) = 0.450592. After a fall of 0.1 m: v- = -1.40071, v+ = -0.631151 m/s, omega+ =
    # 18.5443 rad/s.
    height, scene = 0.1, link_scene(method, dt, friction=isotropic(0.0))
    lever = OFFSET * math.cos(angle)
    q = MASS * lever**2 / ACROSS
    assert q / (1 + q) == pytest.approx(0.450592, abs=5e-7)
    steps = math.ceil(math.sqrt(2 * height / G) / dt) + 1
    states, _, _ = course(scene, pitched(scene.robot, angle, clearance=height), steps)
    impact = np.flatnonzero(states.u[:, 0, 3])[0]  # the first rotation
    before = states.u[impact - 1, 0, 2] - G * dt  # the end of that step without the floor
    after = states.u[impact, 0]
    # The step is an exact impact at its own velocity. SPEED over the lever for the rotation.
    # A rounding of momentum at the lever turns the link, m c^2/Theta_1 < 1 of it over m c.
    error = SPEED / lever + chain_rounding(method, -before) / (MASS * lever)
    assert abs(after[2] - before * q / (1 + q)) < error
    # The lower end goes up; a turn about +e_x of the link, which is +y of I, lowers the front.
    turn = math.copysign(before * MASS * lever / ACROSS / (1 + q), -angle)
    assert np.abs(after[3:] - [turn, 0.0, 0.0]).max() < error
    energy = kinetic_energy(scene.robot, states.u[impact]) / (MASS * before**2 / 2)
    assert energy == pytest.approx(q / (1 + q), abs=4 * error)
    # The floor is noticed at the first middle of a step below it, less than dt late, and the
    # velocity is taken half a step later.
    assert abs(before + math.sqrt(2 * G * height)) < 1.5 * G * dt


@each_method
def test_flat_link_lands_without_rebound(method, dt):
    # Completely inelastic: u+ = 0 from the impact on. The floor is noticed at the first middle of
    # a step below it; these are v dt apart: the penetration is less and stays.
    height, scene = 0.1, link_scene(method, dt)
    state = lying()
    state.q[0, 2] = RADIUS + height
    steps = math.ceil(math.sqrt(2 * height / G) / dt)
    falling, _, report = run(scene, state, steps - 1)
    assert falling.u[0, 2] == pytest.approx(-(steps - 1) * G * dt, rel=steps * EPS)
    assert not report.contacts
    states, _, report = course(scene, falling, round(0.1 / dt))
    at_rest = states.u[2:]
    assert np.abs(at_rest).max() < SPEED / OFFSET  # rotations: contact speed over the lever
    assert report.penetration_max < math.sqrt(2 * G * height) * dt + 1.5 * G * dt**2
    assert np.ptp(states.q[2:, 0, 2]) < 0.1 * SPEED
    assert not report.unconverged


# A slender rod of 1 m and 1 kg on its leading end, tan theta = 2. With x = cos/2, y = sin/2 the
# Delassus matrix (normal, along) is [[1 + 12 x^2, 12 x y], [12 x y, 1 + 12 y^2]] = [[1.6, 1.2],
# [1.2, 3.4]] 1/kg, its largest eigenvalue is 4: r = 0.3 kg is admissible, r lambda_max = 1.2 < 2.
ROD = Robot(
    link_count=1,
    link_mass=1.0,
    inertia_transversal=1 / 12,
    inertia_axial=1e-3,
    contact_offset=0.5,
    contact_radius=0.0,
)
# Where a sweep changes impulses by less than 1e-13 N s, the residual is below that over r.
ROD_SOLVER = Solver(
    tolerance=1e-13,
    residual_tolerance=1e-13 / 0.3,
    r_normal=0.3,
    r_sliding=0.3,
    iteration_limit=100000,
    **PRINTED,
)


def rod(method, dt, mu):
    """Return velocity and impulse (normal, along) of the rod's lower end in its first step."""
    scene = Scene(
        robot=ROD, solver=ROD_SOLVER, friction=isotropic(mu), method=method, dt=dt, level='spatial'
    )
    state, _, report = run(scene, pitched(ROD, math.atan(2), v=(1.0, 0.0, 0.0)), 1)
    assert not report.unconverged
    # Of 1 kg: its momentum, whatever the parts of the step.
    return state.u[0], np.array([state.u[0, 2] + G * dt, state.u[0, 0] - 1.0])


@pytest.mark.parametrize('dt', [1e-5, 1e-4])
@every_method
def test_painleve_rod_slides_with_a_large_force(method, dt):
    # N = m g/(1 + 3 cos^2 - 3 mu sin cos) = m g/0.16 = 6.25 m g for mu = 1.2; exact in the first
    # step, as the rod does not turn before it. The iteration contracts by 1 - r 0.16 = 0.952: 21
    # times the tolerance is left. In the second part of a step of BDF2 the rod has turned: its end
    # is pushed up by 6 N sin cos < 250 m/s^2 more than it falls, which changes 1/N, of which the
    # derivative with respect to the angle is below 10/(m g), by 10 250 dt^2.
    _, impulse = rod(method, dt, 1.2)
    expected = 6.25 * G * dt * np.array([1.0, -1.2])
    error = 25 * ROD_SOLVER.tolerance + 2 * EPS
    if method == 'bdf2':
        error += 2500 * dt**2 * 6.25 * np.abs(expected).max()
    assert np.abs(impulse - expected).max() < error


@pytest.mark.parametrize('dt', [1e-5, 1e-4])
@every_method
def test_painleve_rod_jams_in_an_impact_without_collision(method, dt):
    # mu = 1.5 is above 4/3: sliding has no solution, the end sticks at once. G P = (g dt, -v0)
    # with the inverse [[3.4, -1.2], [-1.2, 1.6]]/4: P_N = 0.3 v0 + 0.85 g dt, P_T = -0.4 v0 - 0.3
    # g dt. Without g dt: u+ = (0.6, 0.3) v0, omega+ = 1.34164 v0/m, E+/E- = 0.6.
    # BDF2 jams in the first part of its step; in the second one the end carries what it must, less
    # than the weight, and the rod has turned by 1.4 dt: these are terms of g dt, too.
    u, impulse = rod(method, dt, 1.5)
    expected = np.array([0.3 + 0.85 * G * dt, -0.4 - 0.3 * G * dt])
    # Smallest eigenvalue of G: 1, so that 1/(r 1) of the tolerance is left.
    error = 4 * ROD_SOLVER.tolerance + chain_rounding(method, 1.0, compliance=4.0)
    if method == 'bdf2':
        error += G * dt
    assert np.abs(impulse - expected).max() < error
    x, y = math.cos(math.atan(2)) / 2, math.sin(math.atan(2)) / 2
    turn = 12 * (expected[0] * x + expected[1] * y)  # lowers the leading end
    limit = np.array([1 + expected[1], 0.0, expected[0] - G * dt, -turn, 0.0, 0.0])
    assert np.abs(u - limit).max() < 12 * error
    assert abs(turn) == pytest.approx(0.6 * math.sqrt(5), abs=4 * G * dt)  # 1.34164
    assert kinetic_energy(ROD, u[None]) == pytest.approx(0.6 / 2, abs=2 * G * dt)


@every_method
def test_link_of_aiko_jams_above_its_critical_friction(method):
    # Sliding has a solution while (Theta_1/m + x^2) > mu x y, x = L_GS cos, y = L_GS sin + L_SC:
    # up to mu = 0.978 at 46.5 deg. 1 % below, N = m g/(1 + (x^2 - mu x y) m/Theta_1); 1 % above,
    # the normal impulse is of the order m v0, whatever dt is.
    dt = 1e-5
    pitch = np.radians(np.linspace(30, 60, 3001))
    x, y = OFFSET * np.cos(pitch), OFFSET * np.sin(pitch) + RADIUS
    critical = (ACROSS / MASS + x**2) / (x * y)
    worst = np.argmin(critical)
    assert np.degrees(pitch[worst]) == pytest.approx(46.5, abs=0.05)
    assert critical[worst] == pytest.approx(0.978, abs=5e-4)
    mu = critical[worst] * np.array([0.99, 1.01])
    x, y = x[worst], y[worst]
    force = MASS * G / (1 + (x**2 - mu[0] * x * y) * MASS / ACROSS)
    # Sticking at once: G P = (g dt, -v0); G = [[a, b], [b, c]].
    a, b, c = 1 / MASS + x**2 / ACROSS, x * y / ACROSS, 1 / MASS + y**2 / ACROSS
    jam = (b * 1.0 + c * G * dt) / (a * c - b * b)
    for coefficient, expected in zip(mu, (force * dt, jam), strict=True):
        solver = Solver(
            tolerance=1e-13,
            residual_tolerance=1e-13 / 0.1,
            r_normal=0.1,
            r_sliding=0.1,
            iteration_limit=100000,
            **PRINTED,
        )
        scene = link_scene(method, dt, friction=isotropic(coefficient), solver=solver)
        start = pitched(ROBOT, pitch[worst], v=(1.0, 0.0, 0.0))
        state, _, report = run(scene, start, 1)
        impulse = MASS * (state.u[0, 2] + G * dt)
        # Sliding contracts by 1 - r (a - mu b), a - mu b = 1 % of a = 2.2 1/kg: 450 eps are left.
        # In the second part of a step of BDF2 the link has turned by less than 1e3 g dt^2 when it
        # slides, which changes the large force by 1e3 times that; after the jam it carries what it
        # must, a few times its weight.
        error = 500 * solver.tolerance + 2 * EPS
        if method == 'bdf2':
            error += 1e7 * dt**2 * expected if coefficient < critical[worst] else 5 * MASS * G * dt
        assert abs(impulse - expected) < error
        assert not report.unconverged


@each_method
def test_selection_rule_presses_an_impact_no_deeper_than_its_bound(method, dt):
    # A link lands flat with v: twice what stops it and half its weight, m (2 v + g dt/2), is
    # expected, so that the compliance is PRESS_SPEED over that, if that is not below the least
    # one; two contacts carry (2/m + c) P = v + g dt. In the next step the last impulse is what is
    # expected. If the link rests then, up to REST_SPEED, the rule selects next to it, but next
    # to ten weights at most, so that the compliance lifts the link by that, less what presses it
    # in. BDF2 has its own, smaller PRESS_SPEED, and lands with the impulses of an impact.
    v, size = 1.0, mean_delassus(ROBOT)
    solver = replace(TIGHT, normal_compliance=1e-4)
    scene = link_scene(method, dt, solver=solver, friction=isotropic(0.0))
    c = max(LEAST_COMPLIANCE * size, PRESS_SPEED / (MASS * (2 * v + G * dt / 2)))
    assert c < 1e-4 * size
    P = (v + G * dt) / (2 / MASS + c)
    state, history, report = run(scene, lying((0.0, 0.0, -v)), 1)
    error = SPEED + chain_rounding(method, v) / MASS
    if method == 'bdf2':
        assert abs(state.u[0, 2]) <= LEAST_COMPLIANCE * size * P + error
        assert abs(run(scene, state, 1, history)[0].u[0, 2]) <= 1e-1 * PRESS_SPEED
        return
    assert abs(state.u[0, 2] + c * P) < error
    assert c * P < max(PRESS_SPEED, LEAST_COMPLIANCE * size * P * 1.01)
    # G^-1 <= m/2 makes less than m R of the residuals of two contacts.
    assert abs(history.impulse[0, 0] - P) < MASS * error
    # The printed laws are violated by as much, and the report tells.
    assert abs(report.printed_residual_max - c * P) < error
    assert report.residual_max <= SPEED
    later = min(
        1e-4 * size,
        max(LEAST_COMPLIANCE * size, PRESS_SPEED / max(P, MASS * (G * dt / 2 + 2 * c * P))),
    )
    lift = later * min(P, IMPACT_WEIGHTS * MASS * G * dt) if c * P <= REST_SPEED else 0.0
    P = (c * P + G * dt + lift) / (2 / MASS + later)
    state, history, report = run(scene, state, 1, history)
    assert abs(state.u[0, 2] + later * P - lift) < error
    assert abs(report.printed_residual_max - abs(lift - later * P)) < error


@pytest.mark.parametrize('method', [*METHODS, ORACLE])
def test_an_impact_does_not_depend_on_when_in_a_step_it_is(method):
    # A tilted link lands with one sphere and slides. Two impacts one after the other, with the
    # velocity between them that closes the gap, would turn it by 0.1 rad/s more or less.
    dt, found = 1e-5, []
    for share in (0.1, 0.4, 0.6, 0.9):
        scene = Scene(
            robot=Robot(link_count=1), friction=isotropic(0.3), method=method, dt=dt,
            level='spatial', solver=Solver(tolerance=1e-13, r_sliding=0.03),
        )  # fmt: skip
        q = initial_state(scene).q
        about_y = np.array([np.cos(0.01), 0.0, np.sin(0.01), 0.0])
        about_x = np.array([np.cos(0.005), np.sin(0.005), 0.0, 0.0])
        q[0, 3:] = product(product(about_y, about_x), q[0, 3:])
        R, omega = rotation_matrices(q[:, 3:])[0], np.array([0.3, 0.2, 0.5])
        v = np.array([0.05, 0.1, -0.1])
        ends = [side * scene.robot.contact_offset * R[:, 2] for side in (-1, 1)]
        lowest = min(ends, key=lambda end: end[2])
        fall = -(v + np.cross(omega, lowest))[2]
        q[0, 2] = scene.robot.contact_radius - lowest[2] + (2 + share) * dt * fall
        simulation = Simulation(scene, make_stepper(scene))
        simulation.state = State(q, np.concatenate([v, R.T @ omega])[None])
        assert not simulation.advance(np.zeros((6, 0, 2))).failure
        found.append(simulation.state.u)
    assert np.ptp(found, axis=0).max() < 3e-3


@pytest.mark.parametrize('laws', [{}, {'joint_friction': 0.02, 'pitch_torque_limit': 0.3}])
def test_a_landing_of_links_with_joints_is_that_of_the_dense_step(laws):
    # Three links that lift and set down, one sphere after the other: steps in which one lands.
    # test_bdf2_reference.py has the dense step of bdf2.
    yaw, pitch = (Wave(amplitude=a, angular_frequency=12.0, phase_lag=1.0) for a in (0.4, 0.3))
    scene = Scene(
        robot=Robot(link_count=3, **laws), friction=isotropic(0.3), dt=1e-3, level='spatial',
        gait=Gait(yaw=yaw, pitch=pitch), solver=Solver(tolerance=1e-13, iteration_limit=5000),
    )  # fmt: skip
    states, impulses, _ = course(scene, initial_state(scene), 400)
    loaded, (angle, rate) = impulses[:, :, 0] > 0.0, references(scene, 400)
    landings = np.flatnonzero((loaded[1:] & ~loaded[:-1]).any(axis=1))
    judged = dict.fromkeys(MIDDLE, 0)
    for k in landings:
        state, ends = State(states.q[k], states.u[k]), []
        for name in (ORACLE, *MIDDLE):
            stepper = make_stepper(replace(scene, method=name))
            history = stepper.empty_history()
            history.impulse[:] = impulses[k]
            ends.append(stepper.advance(state, history, angle[k : k + 1], rate[k : k + 1]))
        (dense, _, dense_report), *ends = ends
        for method, (end, _, report) in zip(MIDDLE, ends, strict=True):
            if report.unconverged or dense_report.unconverged:
                continue
            judged[method] += 1
            assert np.abs(end.u - dense.u).max() < 1e-8
            assert np.abs(end.q - dense.q).max() < 1e-8 * scene.dt
            assert np.abs(report.joint_torque - dense_report.joint_torque).max() < 1e-6
    assert min(judged.values()) > 8


@each_method
@pytest.mark.parametrize('speed', [0.5, 2.0, 6.0])
def test_a_fall_of_any_speed_ends_on_the_floor(method, dt, speed):
    # The floor is met at any moment of a step, up to 0.5 dt v below it in its middle; what is left
    # is what a contact may keep.
    for late in (0.05, 0.35, 0.65, 0.95):
        solver = replace(TIGHT, activation_tolerance=Solver().activation_tolerance)
        scene = link_scene(method, dt, solver=solver)
        state = lying((0.0, 0.0, -speed))
        state.q[0, 2] += late * speed * dt
        end, _, report = run(scene, state, 4)
        assert not report.unconverged and not report.failure
        closed = closed_gap(scene.solver.activation_tolerance, dt)
        assert abs(end.q[0, 2] - RADIUS) <= left_gap(closed) + 10 * EPS, late

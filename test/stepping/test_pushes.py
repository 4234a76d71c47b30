# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Pushes: what friction holds, how it slides, momentum, and that steps have them as forces."""

from dataclasses import replace

import numpy as np
from oracle import bdf2 as dense_bdf2, empty_history, make_stepper, ORACLE
from oracle.pushes import generalized, step_of
import pytest
from scenes import (
    EPS,
    every_method,
    G,
    isotropic,
    late_stop,
    link_scene,
    MASS,
    sliding_error,
    SWEEPING,
    TIGHT,
)

from snake_sim_ros import Gait, ParameterError, Push, Robot, Scene, Simulation, Solver, State
from snake_sim_ros.dynamics.force_directions import joint_gaps
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.posture import chain_coordinates
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.accuracy import with_accuracy
from snake_sim_ros.stepping.bdf2.formula import AT_START
from snake_sim_ros.stepping.pushes import make_push, make_table, Pushes, STEP

FORCE, TORQUE = np.array([0.3, -0.2, 0.5]), np.array([0.02, 0.05, -0.03])
MU = 0.5


def momentum(robot, state):
    """Return momentum [N s] and angular momentum about the origin [N m s]."""
    mass = robot.per_link('link_mass')
    transversal, axial = robot.per_link('inertia_transversal'), robot.per_link('inertia_axial')
    p = mass[:, None] * state.u[:, :3]
    spin = np.column_stack([transversal, transversal, axial]) * state.u[:, 3:]
    spin = np.einsum('nij,nj->ni', rotation_matrices(state.q[:, 3:]), spin)
    return p.sum(axis=0), (np.cross(state.q[:, :3], p) + spin).sum(axis=0)


def advanced(simulation, steps):
    report = simulation.advance(*simulation.gait_reference(steps))
    assert not report.failure
    assert not report.unconverged
    return report


def slid(simulation, steps):
    """Advance, up to a residual that rounding leaves beside the tolerance."""
    report = simulation.advance(*simulation.gait_reference(steps))
    assert not report.failure
    assert report.residual_max < 1e-11
    return report


# ---- friction -----------------------------------------------------------------------------------


def aiko_at_rest(**settings):
    """Return straight Aiko on a floor that holds it against 36.8 N."""
    return Scene(gait=Gait(), friction=isotropic(MU), **settings)


def moved(scene, seconds):
    """Return by how much a robot moves at most [m] while it is pushed, and the report."""
    simulation = Simulation(scene)
    start = simulation.state.q.copy()
    report = simulation.advance(*simulation.gait_reference(round(seconds / scene.dt)))
    assert not report.failure
    # Where the push begins, projections stop at their limit, with what the report says is left.
    assert not report.unconverged or scene.method in SWEEPING
    return np.abs(simulation.state.q - start)[:, :2].max(), report


@every_method
@pytest.mark.parametrize('level', ['planar', 'spatial'])
def test_friction_holds_what_it_can(method, level):
    # 30 N on link 6, of which the friction of its own contacts holds 3.3 N and that of the others
    # the rest. It begins and ends within steps.
    seconds, tolerance = 0.05, 1e-9
    solver = Solver(residual_tolerance=tolerance, tolerance=1e-12, iteration_limit=100_000)
    push = Push(link=6, force=(30.0, 0.0, 0.0), start=0.0033, duration=0.0404)
    scene = aiko_at_rest(method=method, level=level, dt=1 / 1000, solver=solver, pushes=(push,))
    way, report = moved(scene, seconds)
    # Contacts that stick move with the residual: |P - prox(P - r gamma)|/r = |gamma|. Where it is
    # far below the tolerance, the moves that close gaps show: the rule presses by 5e-10 m a step.
    assert way <= seconds * max(report.residual_max, tolerance) + 100 * EPS
    # What a sweep may leave is its last change over r.
    slowest = scene.solver.tolerance / min(scene.solver.r_sliding, scene.solver.r_normal)
    if not report.unconverged:
        assert report.residual_max <= (slowest if method in SWEEPING else tolerance)


@pytest.mark.parametrize('method', ['newton', 'bdf2'])
@pytest.mark.parametrize('level', ['planar', 'spatial'])
@pytest.mark.parametrize('dt', [1 / 1000, 1 / 100])
def test_it_holds_for_long(method, level, dt):
    push = Push(link=6, force=(30.0, 0.0, 0.0), start=0.00123, duration=2.0)
    scene = aiko_at_rest(method=method, level=level, dt=dt, pushes=(push,))
    assert moved(scene, 2.1)[0] <= 2.1 * scene.solver.residual_tolerance


@pytest.mark.parametrize('accuracy', [1e-1, 1e-2, 1e-3, 1e-4])
def test_it_holds_with_every_accuracy(accuracy):
    push = Push(link=6, force=(30.0, 0.0, 0.0), start=0.00123, duration=2.0)
    scene = with_accuracy(aiko_at_rest(pushes=(push,)), accuracy, 1 / 50, ())
    assert moved(scene, 2.1)[0] <= 2.1 * scene.solver.residual_tolerance


@every_method
@pytest.mark.parametrize('share', [0.0, 0.3])
def test_a_pushed_link_slides_as_its_friction_says(method, share):
    # It stays at mu m g and slides beyond with (F - mu m g)/m, then stops with mu g. `share` is
    # how far in a step the push begins; it ends that much earlier in another.
    dt, steps, most = 1 / 256, 24, MU * MASS * G
    share = round(share * STEP) / STEP
    start, duration = (3 + share) * dt, (steps - 2 * share) * dt
    for force in (0.999 * most, 1.001 * most, 1.5 * most):
        push = Push(force=(force, 0.0, 0.0), start=start, duration=duration)
        scene = link_scene(
            method, dt, friction=isotropic(MU), gait=Gait(), pushes=(push,),
            solver=replace(TIGHT, activation_tolerance=1e-6),
        )  # fmt: skip
        simulation = Simulation(scene)
        first = simulation.state.q[0, 0]
        slid(simulation, 3 + steps)
        a, error = max(0.0, (force - most) / MASS), sliding_error(method, MU, 3 + steps)
        # A step of the paper knows the mean force of the step, and friction for all of it. Where
        # the push begins, friction takes mu g share dt too much, or all that the push gives.
        late = min(MU * G * share, a * (1 - share)) * dt if method != 'bdf2' else 0.0
        after = share * dt  # the push has ended, and the link slows down
        speed = max(0.0, a * duration - MU * G * after)
        way = a * duration**2 / 2 + a * duration * after - MU * G * after**2 / 2
        if a * duration > MU * G * after:
            assert simulation.state.u[0, 0] == pytest.approx(speed, abs=late + error + 10 * EPS)
            assert simulation.state.q[0, 0] - first == pytest.approx(
                way, abs=(late + error) * (duration + dt) + a * dt**2 / 8 * (share > 0) + 10 * EPS
            )
        slid(simulation, 2 + int(speed / (MU * G) / dt))
        assert abs(simulation.state.u[0, 0]) <= error + 10 * EPS
        stop = a * duration / (MU * G) * (a * duration) / 2 + a * duration**2 / 2
        abs_error = late_stop(method) * MU * G * dt**2 + error + a * dt**2 / 8 * (share > 0)
        abs_error += late * (duration + (speed + late) / (MU * G))
        assert simulation.state.q[0, 0] - first == pytest.approx(stop, abs=abs_error + 10 * EPS)


@pytest.mark.parametrize('level', ['planar', 'spatial'])
def test_bdf2_keeps_its_order(level):
    # Five links slide, are pushed sideways from within a step to within another, and turn.
    robot, angle = Robot(link_count=5), np.zeros((4, 2))
    angle[:, 0] = [0.6, 0.5, -0.5, -0.6]
    push = Push(link=3, force=(8.0, 4.0, 0.0), start=0.0437, duration=0.1211)
    q, u = chain_coordinates(robot, angle), np.zeros((5, 6))
    q[:, 2] += 0.0525
    u[:, :2] = 1.0, 0.3

    def end(dt):
        scene = Scene(
            robot=robot, gait=Gait(), friction=isotropic(0.1), method='bdf2', dt=dt, level=level,
            pushes=(push,),
        )  # fmt: skip
        simulation = Simulation(scene)
        simulation.state = State(q, u)
        report = simulation.advance(np.tile(angle, (round(0.2 / dt), 1, 1)))
        assert not report.failure
        return simulation.state.q[:, :2]

    exact = (4 * end(1 / 12800) - end(1 / 6400)) / 3
    errors = [np.abs(end(dt) - exact).max() for dt in (1 / 50, 1 / 100, 1 / 200, 1 / 400)]
    # Each of these is what one of half the step takes a quarter of, where events fall alike.
    assert np.log2(errors[0] / errors[-1]) / 3 > 1.7, errors


# ---- momentum -----------------------------------------------------------------------------------


def floating(method, dt, links=4, **settings):
    """Return a robot without weight, in the air."""
    return Scene(
        robot=Robot(link_count=links), gait=Gait(), gravity=(0.0, 0.0, 0.0), method=method, dt=dt,
        level='spatial', **settings,
    )  # fmt: skip


def in_the_air(scene):
    simulation = Simulation(scene)
    q = simulation.state.q.copy()
    q[:, 2] += 1.0
    simulation.state = State(q, simulation.state.u)
    return simulation


@every_method
def test_a_free_robot_gets_the_momentum_of_the_force(method):
    # One push of the scene, from within a step to within another; a short one in a step; and two
    # that begin meanwhile, one of which takes the place of another.
    pushes = (
        Push(link=1, force=tuple(FORCE), torque=tuple(TORQUE), start=0.0032, duration=0.0077),
        Push(link=3, force=(0.0, 90.0, 0.0), start=0.01234, duration=1e-5),
    )
    simulation = in_the_air(floating(method, 1 / 1000, pushes=pushes))
    robot = simulation.scene.robot
    for steps in (3, 1, 7, 2, 17):
        advanced(simulation, steps)
    simulation.pushes.begin(1, (9.0, 9.0, 9.0), duration=1.0)
    simulation.pushes.begin(1, FORCE, TORQUE, duration=0.0183)
    simulation.pushes.begin(2, (0.0, 0.0, 2.0), duration=1.0)
    advanced(simulation, 10)
    simulation.pushes.begin(2, (0.0, 0.0, -3.0), duration=0.0025)
    for steps in (19, 1):
        advanced(simulation, steps)
    assert not simulation.pushes
    p, _ = momentum(robot, simulation.state)
    expected = (0.0077 + 0.0183) * FORCE + [0.0, 90e-5, 2.0 * 0.01 - 3.0 * 0.0025]
    # 60 steps, of a dozen parts at the most, round velocities below 1 m/s, and of 2.7 kg.
    assert p == pytest.approx(expected, abs=60 * 12 * 3 * 10 * EPS)
    assert np.abs(joint_gaps(robot, simulation.state.q)).max() < 1e-6


def test_a_push_that_is_cleared_ends_at_once():
    simulation = in_the_air(floating('bdf2', 1 / 1000))
    simulation.pushes.begin(0, FORCE, duration=1.0)
    assert simulation.pushes
    advanced(simulation, 5)
    simulation.pushes.clear()
    assert not simulation.pushes
    advanced(simulation, 5)
    p, _ = momentum(simulation.scene.robot, simulation.state)
    assert p == pytest.approx(0.005 * FORCE, abs=1e4 * EPS)


def test_shares_of_all_steps_make_the_impulse():
    rng = np.random.default_rng(3)
    for _ in range(200):
        start, duration = rng.uniform(0.0, 20.0), 10.0 ** rng.uniform(-5.0, 1.0)
        push = make_push(0, FORCE, TORQUE, False, start, duration)
        assert 0 <= push.begin <= STEP * start + 0.01 < push.begin + 1.01
        pushes, frames = make_table([push], 5), np.eye(3)[None]
        total = sum(generalized(pushes, step_of(pushes, k), frames) for k in range(-5, 30))
        assert total == pytest.approx(duration * np.concatenate([FORCE, TORQUE]), rel=1e-13)


# ---- dense steps --------------------------------------------------------------------------------


def random_pushes(rng, links, flat):
    """Return pushes in axes of I and of links, from within a step to within another one."""
    pushes = []
    for turns in (False, True, True):
        force, torque = rng.normal(size=3), 0.1 * rng.normal(size=3)
        up = 1 if turns else 2
        if flat:
            force[up], torque[up] = 0.0, torque[up] / 10
            torque[np.arange(3) != up] = 0.0
        start, duration = rng.uniform(0.0, 0.5, 2)
        pushes.append(make_push(int(rng.integers(links)), force, torque, turns, start, duration))
    return make_table(pushes)


def random_start(rng, links, height):
    """Return a state of a robot that is bent, at rest."""
    angle = rng.uniform(-0.5, 0.5, (links - 1, 2)) * [1.0, height > 0.1]
    q = chain_coordinates(Robot(link_count=links), angle)
    q[:, 2] += height
    return State(q, np.zeros((links, 6))), angle


@pytest.mark.parametrize('links', [1, 2, 5])
def test_steps_with_pushes_are_the_dense_ones(links):
    rng = np.random.default_rng(links)
    # One link that lies flat rolls if it is pushed across.
    for level, height in (('spatial', 1.0), ('planar', 0.0525))[: min(links, 2)]:
        state, angle = random_start(rng, links, height)
        pushes = random_pushes(rng, links, level == 'planar')
        scene = Scene(
            robot=Robot(link_count=links), gait=Gait(), friction=isotropic(0.02), level=level,
            solver=replace(TIGHT, normal_compliance=1e-4, iteration_limit=10_000), dt=1 / 400,
        )  # fmt: skip
        references = np.tile(angle, (3, 1, 1)), np.zeros((3, links - 1, 2))
        ends = []
        for method in ('newton', ORACLE):
            stepper = make_stepper(replace(scene, method=method))
            history = stepper.empty_history()
            end, _, report = stepper.advance(state, history, *references, None, pushes)
            assert not report.failure
            assert not report.left
            ends.append(np.hstack([end.q, end.u]))
        assert np.abs(ends[0]).max() > 1e-4
        # Impulses of 1e-14 N s, on inertias of 2e-4 kg m^2, or rounding of dense systems.
        assert np.abs(ends[0] - ends[1]).max() < 1e-9


@pytest.mark.parametrize('links', [1, 2, 5])
def test_steps_of_bdf2_with_pushes_are_the_dense_ones(links):
    rng = np.random.default_rng(links)
    for dt in (1 / 400, 1 / 50):
        state, angle = random_start(rng, links, 1.0)
        pushes, scene = random_pushes(rng, links, False), floating('bdf2', dt, links)
        references = angle, np.zeros((links - 1, 2))
        stepper = make_stepper(scene)
        start = state, stepper.empty_history(), references[0][None], references[1][None]
        end, _, report = stepper.advance(*start, None, pushes)
        assert not report.failure
        start = state, empty_history(scene)._replace(memory=stepper.empty_history().memory)
        parts = dense_bdf2.step(scene, *start, *references, AT_START, pushes)
        assert len(parts) >= 3 + 2 * 2
        part = parts[-1]
        assert np.abs(end.q - part.state.q).max() < 1e-12
        assert np.abs(end.u - part.state.u).max() < 1e-11


# ---- how steps are taken ------------------------------------------------------------------------


@pytest.mark.parametrize('method', ['newton', 'bdf2'])
def test_pushes_act_in_any_calls_alike(method):
    # Horizontal ones leave the robot in the plane; a vertical one takes it to space.
    pushes = (
        Push(force=(0.0, 3.0, 0.0), start=0.01, duration=0.013),
        Push(link=3, force=(0.0, 0.0, 2.0), start=0.0321, duration=0.0042),
    )
    scene = replace(load_scene('lateral_undulation'), pushes=pushes, method=method, dt=1 / 1000)
    whole, one_by_one = Simulation(scene), Simulation(scene)
    angle, rate = whole.gait_reference(60)
    report = whole.advance(angle, rate)
    levels = [one_by_one.advance(angle[k : k + 1], rate[k : k + 1]).level for k in range(60)]
    assert whole.step_count == one_by_one.step_count == report.steps == 60
    assert whole.state.q.tobytes() == one_by_one.state.q.tobytes()
    assert whole.state.u.tobytes() == one_by_one.state.u.tobytes()
    assert levels == 32 * ['planar'] + 28 * ['spatial']
    assert report.left == one_by_one.last.left == 'link 3 is pushed out of the plane'


def test_steps_in_place_go_on_while_a_push_lasts():
    simulation = Simulation(replace(load_scene('lateral_undulation'), method='newton'))
    simulation.pushes.begin(5, (0.0, 3.0, 0.0), duration=1.0)
    for _ in range(3):
        advanced(simulation, 1)
    going_on = simulation._in_place
    assert going_on
    for _ in range(5):
        advanced(simulation, 1)
    assert simulation._in_place is going_on


def test_the_planar_level_says_what_lifts():
    push = Push(link=2, torque=(0.1, 0.0, 0.0), start=0.002)
    scene = aiko_at_rest(level='planar', method='newton', dt=1 / 1000, pushes=(push,))
    simulation = Simulation(scene)
    report = simulation.advance(*simulation.gait_reference(5))
    assert report.steps == 2
    assert 'level planar: link 2 is pushed out of the plane; choose level' in report.failure


def test_what_is_not_a_push_is_refused():
    pushes = Pushes(Scene())
    nan, inf = float('nan'), float('inf')
    for values, said in (
        (((nan, 0, 0), (0, 0, 0), 1.0), 'force must be 3 finite numbers in N'),
        (((0, 0, 0), (0, inf, 0), 1.0), 'torque must be 3 finite numbers in N m'),
        (((0, 0), (0, 0, 0), 1.0), 'force must be 3 finite numbers in N'),
        (((1, 0, 0), (0, 0, 0), inf), 'duration must be above 0 s and finite, got inf s'),
        (((1, 0, 0), (0, 0, 0), 0.0), 'duration must be above 0 s and finite, got 0 s'),
    ):
        force, torque, duration = values
        with pytest.raises(ParameterError, match=said):
            pushes.begin(0, force, torque, duration=duration)
    with pytest.raises(ParameterError, match='link must be 0 to 10, got 11'):
        pushes.begin(11, (1, 0, 0), duration=1.0)
    assert not pushes


def test_joints_stay_closed_while_a_push_lasts():
    simulation = Simulation(replace(load_scene('lateral_undulation'), level='spatial'))
    simulation.pushes.begin(0, (0.0, 20.0, 0.0), duration=0.1)
    for _ in range(20):
        assert not simulation.advance(*simulation.gait_reference(20)).failure
        assert np.abs(joint_gaps(simulation.scene.robot, simulation.state.q)).max() < 1e-6

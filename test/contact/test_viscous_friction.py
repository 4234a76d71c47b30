# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Viscous friction of the ground, alone and beside Coulomb's, in closed form."""

from dataclasses import replace
import math

from flat_states import crooked, flat_robot
import numpy as np
from oracle import empty_history, make_stepper
import pytest
from scenes import course, G, kinetic_energy, lying, MASS, OFFSET, RADIUS, run, slope
from test_friction import (
    agreeing_at_both_levels,
    BLOCK,
    block_scene,
    border,
    each_level,
    heading,
    sliding,
)

from snake_sim_ros import Friction, ParameterError, Robot, Scene, Solver
from snake_sim_ros.scene.obstacles import is_flat
from snake_sim_ros.scene.parameters import scene_from_text, scene_to_text, with_settings
from snake_sim_ros.stepping.contact_forces import contact_forces
from snake_sim_ros.stepping.methods import METHODS

pytestmark = pytest.mark.fast

ALONG, ACROSS = 1.5, 6.0  # N s/m
VISCOUS = Friction(
    longitudinal=0.0, transversal=0.0, viscous_longitudinal=ALONG, viscous_transversal=ACROSS
)
RATES = np.array([ALONG, ACROSS]) / MASS  # 1/s, at which velocities along and across decay
ROUNDED = 1e-11


def order(errors):
    """Return the orders of convergence of errors, of which each has half of the step before."""
    return np.log2(np.array(errors[:-1]) / errors[1:])


def first_or_second(method):
    """Return the order of convergence of a method for a smooth motion."""
    return 2 if method == 'bdf2' else 1


@each_level
@pytest.mark.parametrize('angle', [0.0, 2.5])
def test_velocities_decay_along_and_across(method, level, angle):
    # v = v0 exp(-c t/m) for each axis on its own. The step of the paper is implicit:
    # v' = v/(1 + c dt/m), to rounding.
    v0, time, errors = np.array([0.6, -0.4]), 0.2, []
    for steps in (20, 40, 80):
        scene = block_scene(method, level, friction=VISCOUS, dt=time / steps)
        states, _, report = course(scene, sliding(angle, v0), steps, steps)
        assert not report.unconverged and not report.failure
        velocity = states.u[-1, 0, :2] @ heading(angle).T
        if method != 'bdf2':
            assert np.abs(velocity - v0 / (1 + RATES * scene.dt) ** steps).max() < ROUNDED
        errors.append(np.abs(velocity - v0 * np.exp(-RATES * time)).max())
    assert (order(errors) > first_or_second(method) - 0.1).all()


@each_level
def test_beside_friction_of_coulomb_a_block_stops(method, level):
    # m v' = -mu m g - c v: v = (v0 + a/k) exp(-k t) - a/k with a = mu g, k = c/m, and rest from
    # ln(1 + k v0/a)/k on. Implicitly v' = (v - a dt)/(1 + k dt) until that is negative.
    mu, v0 = 0.05, 0.5
    a, k = mu * G, RATES[0]
    stops, errors = math.log(1 + k * v0 / a) / k, []
    friction = replace(VISCOUS, longitudinal=mu, transversal=mu)
    for steps in (20, 40, 80):
        time = 0.7 * stops
        scene = block_scene(method, level, friction=friction, dt=time / steps)
        states, _, report = course(scene, sliding(0.7, (v0, 0.0)), 2 * steps, 1)
        assert not report.unconverged and not report.failure
        velocity = states.u[:, 0, :2] @ heading(0.7).T
        exact = (v0 + a / k) * math.exp(-k * time) - a / k
        errors.append(abs(velocity[steps, 0] - exact))
        if method != 'bdf2':
            v = v0
            for _ in range(steps):
                v = (v - a * scene.dt) / (1 + k * scene.dt)
            # Loads are off by a residual in each step, as in test_friction.py.
            assert abs(velocity[steps, 0] - v) < 1e-9
        at_rest = velocity[math.ceil(stops / scene.dt) + 2 :]
        assert np.abs(at_rest).max() < 1e-4 * v0
    assert (order(errors) > first_or_second(method) - 0.1).all()


@each_level
def test_a_link_that_turns_slows_down(method, level):
    # Half of the friction acts at each of both contacts, L_GS before and behind the center:
    # Theta omega' = -c_across L_GS^2 omega.
    rate = ACROSS * BLOCK.contact_offset**2 / BLOCK.inertia_transversal
    omega, time, errors = 1.2, 0.05, []
    for steps in (20, 40, 80):
        scene = block_scene(method, level, friction=VISCOUS, dt=time / steps)
        start = sliding(0.3, (0.0, 0.0))
        start.u[0, 4] = omega
        states, _, report = course(scene, start, steps, steps)
        assert not report.unconverged and not report.failure
        turning = np.linalg.norm(states.u[-1, 0, 3:])
        errors.append(abs(turning - omega * math.exp(-rate * time)))
    assert (order(errors) > first_or_second(method) - 0.1).all()


@pytest.mark.parametrize('method', METHODS)
def test_the_load_makes_no_difference(method):
    # On a slope the block reaches m g sin b/c, in any direction and at any load.
    for downhill, weight in ((0.0, 1.0), (1.1, 0.2)):
        gravity = tuple(weight * g for g in slope(0.2, downhill))
        scene = block_scene(method, 'spatial', friction=VISCOUS, gravity=gravity, dt=1 / 20)
        states, _, report = course(scene, sliding(0.0, (0.0, 0.0)), 400, 400)
        assert not report.unconverged
        expected = np.array(gravity[:2]) / RATES
        assert np.abs(states.u[-1, 0, :2] - expected).max() < 1e-9


@each_level
def test_patches_scale_it(method, level):
    for factor in (0.0, 3.0):
        scene = block_scene(
            method, level, friction=VISCOUS, patches=border(factor, -20.0), dt=1 / 400
        )
        states, _, _ = course(scene, sliding(0.0, (0.3, 0.1)), 40, 40)
        k = factor * RATES * scene.dt
        decay, left = (1 + k) ** -40, 1e-9
        if method == 'bdf2':  # (k dt)^2/2 of the exponent 40 k dt, k dt up to 0.065
            decay, left = np.exp(-40 * k), 6e-3
        assert states.u[-1, 0, :2] == pytest.approx([0.3, 0.1] * decay, rel=left)


@each_level
def test_forces_of_contacts_contain_it(method, level):
    # After a step from a given state: the last part of `bdf2` shows only its own end.
    scene = block_scene(method, level, friction=replace(VISCOUS, longitudinal=0.02), dt=1 / 1000)
    stepper, history, state = make_stepper(scene), empty_history(scene), sliding(0.4, (0.3, 0.2))
    zeros = np.zeros((4, 0, 2))
    end, history, _ = stepper.advance(state, history, zeros, zeros)
    points, forces = contact_forces(scene, end, history)
    assert len(points) == 2
    velocity = end.u[0, :2] @ heading(0.4).T
    expected = -np.array([ALONG, ACROSS]) * velocity - [0.02 * MASS * G, 0.0]
    assert forces.sum(axis=0)[:2] @ heading(0.4).T == pytest.approx(expected, rel=1e-6)


@each_level
def test_it_loads_the_front_of_a_link_that_glides(method, level):
    # It acts a radius below the center: the loads of both ends, 2 offset apart, are as different
    # as balances c v radius. A step of `bdf2` has parts, of which the last one is short.
    scene = block_scene(method, level, friction=VISCOUS, robot=Robot(link_count=1), dt=1 / 1000)
    end, history, report = run(scene, lying((0.3, 0.0, 0.0)), 1)
    assert not report.unconverged
    (front, rear), v = history.impulse[:2, 0], end.u[0, 0]
    expected = ALONG * v * RADIUS / (OFFSET * MASS * G)
    # A residual of 1e-12 m/s is 1e-10 of the impulse of the weight.
    assert (front - rear) / (front + rear) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize('method', METHODS)
def test_it_only_takes_energy(method):
    rng = np.random.default_rng(7)
    robot = flat_robot(rng, 4)
    robot = replace(
        robot, yaw_stiffness=0.0, yaw_damping=0.0, pitch_stiffness=0.0, pitch_damping=0.0
    )
    # Projections need hundreds of sweeps where the load of a contact is nearly zero.
    solver = Solver(tolerance=1e-9, residual_tolerance=1e-9, iteration_limit=20000)
    scene = Scene(robot=robot, friction=VISCOUS, method=method, dt=1 / 500, solver=solver)
    states, _, report = course(scene, crooked(rng, robot, speed=0.5), 30)
    assert not report.unconverged
    assert (np.diff(kinetic_energy(robot, states.u)) < 0.0).all()


def test_both_levels_take_the_dense_step():
    # As in test_friction.py; `bdf2` is in test_bdf2_reference.py.
    friction = replace(VISCOUS, longitudinal=0.02, transversal=0.1)
    taken = agreeing_at_both_levels(friction, 6, 0.3)
    assert taken >= 4 * (len(METHODS) - 1)


def test_it_is_paid_for_only_where_it_is():
    assert is_flat(replace(Scene(), friction=Friction(viscous_longitudinal=0.0)))
    assert not is_flat(replace(Scene(), friction=VISCOUS))


def test_a_scene_keeps_it_as_text():
    scene = replace(Scene(), friction=VISCOUS)
    assert scene_from_text(scene_to_text(scene)) == scene


@pytest.mark.parametrize(
    ('value', 'sentence'),
    [
        (-0.1, 'must be at least 0 N s/m, got -0.1 N s/m'),
        (math.nan, 'must be finite, got nan N s/m'),
        ('much', "must be a number, got 'much'"),
    ],
)
def test_bad_values_get_one_sentence(value, sentence):
    with pytest.raises(ParameterError) as raised:
        with_settings(Scene(), {'friction.viscous_transversal': value})
    assert str(raised.value) == f'friction.viscous_transversal {sentence}'

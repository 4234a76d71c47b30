# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Postures and places in which scenes start, and pushes that they hold."""

import math

import numpy as np
import pytest

from snake_sim_ros import ParameterError, Simulation
from snake_sim_ros.scene.parameters import (
    load_scene,
    scene_from_text,
    scene_to_text,
    with_settings,
)
from snake_sim_ros.scene.posture import center_of_mass, gaps, initial_coordinates, joint_angles
from snake_sim_ros.stepping.simulation import sample, simulate

CASE_A = load_scene('lateral_undulation')
MASS = 7.5
STILL = {'gait.yaw.amplitude': 0.0}


def test_a_scene_starts_in_its_posture_and_place():
    yaw = np.linspace(-0.4, 0.5, 10)
    scene = with_settings(
        CASE_A,
        {
            'start.yaw': yaw,
            'start.pitch_deg': [5.0] * 10,
            'start.position': [1.0, -2.0],
            'start.height': 0.1,
        },
    )
    q = initial_coordinates(scene)
    assert joint_angles(q)[:, 0] == pytest.approx(yaw, abs=1e-12)
    assert joint_angles(q)[:, 1] == pytest.approx(math.radians(5.0), abs=1e-12)
    assert q[:, :2].mean(axis=0) == pytest.approx([1.0, -2.0])
    assert gaps(scene.robot, q).min() == pytest.approx(0.1)
    assert scene_from_text(scene_to_text(scene)) == scene


@pytest.mark.parametrize('heading', [0.0, math.pi / 2, -2.0])
def test_heading_is_the_direction_of_the_robot(heading):
    q = initial_coordinates(with_settings(CASE_A, {'start.yaw': 0.0, 'start.heading': heading}))
    along = q[-1, :3] - q[0, :3]
    assert math.atan2(along[1], along[0]) == pytest.approx(heading)
    turned = with_settings(CASE_A, {'start.heading': heading})
    a, b = (initial_coordinates(scene)[:, 2] for scene in (CASE_A, turned))
    assert a == pytest.approx(b, abs=1e-15)


def test_without_a_start_nothing_differs():
    same = with_settings(CASE_A, {'start.position': [0, 0], 'start.heading': 0})
    assert initial_coordinates(same).tobytes() == initial_coordinates(CASE_A).tobytes()


@pytest.mark.parametrize(
    ('values', 'sentence'),
    [
        (
            {'start.yaw': [0.1, 0.2]},
            'start.yaw must be one number or one for each of the 10 joints, got 2 numbers',
        ),
        (
            {'start.yaw': 30},
            'start.yaw must be within the joint limit, +-0.7854 rad, got 30 rad; for degrees say '
            'start.yaw_deg',
        ),
        ({'start.position': [1]}, 'start.position must have 2 components, got 1'),
        ({'start.height': -0.1}, 'start.height must be at least 0 m, got -0.1 m'),
        ({'start.heigth': 1}, "unknown name 'start.heigth'; did you mean 'height'?"),
        ({'pushes': {'link': 1}}, None),
        ({'pushes': [{'link': 12, 'force': [1, 0, 0]}]}, 'link of a push must be 1 to 11, got 12'),
        (
            {'pushes': [{'link': 0, 'force': [1, 0, 0]}]},
            'pushes[0]: link must be at least 1, got 0',
        ),
        (
            {'pushes': [{'link': 1}]},
            'pushes[0]: a push must have a force or a torque that is not 0',
        ),
        (
            {'pushes': [{'force': [1, 0, 0]}, {'force': [1, 0]}]},
            'pushes[1]: force must have 3 components, got 2',
        ),
        (
            {'pushes': [{'force': [1, 0, 0], 'duration': 0}]},
            'pushes[0]: duration must be above 0 s, got 0 s',
        ),
    ],
)
def test_what_is_refused(values, sentence):
    with pytest.raises(ParameterError) as caught:
        with_settings(CASE_A, values)
    usual = "pushes must be a list of mappings of names to values, got {'link': 1}"
    assert str(caught.value) == (sentence or usual)


# ---- pushes -------------------------------------------------------------------------------------


def afloat(**values):
    """Return Aiko, straight and without weight, far above the ground."""
    settings = {'gravity': [0.0, 0.0, 0.0], 'start.height': 1.0, 'duration': 0.2, **STILL}
    return with_settings(CASE_A, {**settings, **values})


def motion(scene):
    """Return momentum [N s] and center of mass [m] at the end of a run."""
    trajectory = simulate(scene)
    assert not trajectory.report.failure
    momentum = scene.robot.per_link('link_mass') @ trajectory.velocity[-1, :, :3]
    return momentum, center_of_mass(scene.robot, trajectory.coordinates[-1])


@pytest.mark.parametrize(('method', 'dt'), [('newton', 1 / 800), ('bdf2', 1 / 100)])
def test_a_push_has_the_momentum_and_the_way_of_its_force(method, dt):
    pushes = [
        {'link': 2, 'force': [3.0, 0.0, 1.0], 'start': 0.05, 'duration': 0.0625},
        {'force': [0.0, -2.0, 0.0], 'duration': 0.1},
    ]
    scene = afloat(pushes=pushes, method=method, dt=dt)
    momentum, place = motion(scene)
    before = center_of_mass(scene.robot, initial_coordinates(scene))
    assert momentum == pytest.approx([3.0 * 0.0625, -2.0 * 0.1, 0.0625], abs=1e-9)
    # F T (t - T/2 - start) / m
    wanted = np.array([0.1875, 0.0, 0.0625]) * (0.15 - 0.03125) + np.array([0, -0.2, 0]) * 0.15
    # Where a push begins or ends within a step, that of the paper takes its mean: F dt^2/8/m.
    error = 0.0 if method == 'bdf2' else 3.0 * dt**2 / 4 / MASS
    assert place - before == pytest.approx(wanted / MASS, abs=error + 1e-12)


def test_a_torque_turns_the_robot():
    scene = afloat(pushes=[{'torque': [0.0, 0.0, 1.0], 'duration': 0.1}])
    trajectory = simulate(scene)
    q, u = trajectory.coordinates[-1], trajectory.velocity[-1]
    mass = scene.robot.per_link('link_mass')
    arm = q[:, :3] - center_of_mass(scene.robot, q)
    orbital = np.cross(arm, mass[:, None] * u[:, :3])[:, 2].sum()
    own = scene.robot.per_link('inertia_transversal') @ u[:, 4]  # e_y of B is up
    assert orbital + own == pytest.approx(0.1, rel=1e-3)


def test_pushes_act_in_any_calls_alike():
    scene = with_settings(
        CASE_A, {'pushes': [{'force': [0, 30, 0], 'start': 0.01, 'duration': 0.013}]}
    )
    whole, one_by_one = Simulation(scene), Simulation(scene)
    angle, rate = whole.gait_reference(120)
    report = whole.advance(angle, rate)
    for k in range(120):
        one_by_one.advance(angle[k : k + 1], rate[k : k + 1])
    assert report.steps == one_by_one.report.steps == whole.step_count == 120
    assert whole.state.q.tobytes() == one_by_one.state.q.tobytes()
    plain = Simulation(CASE_A)
    plain.advance(angle, rate)
    assert np.abs(plain.state.q - whole.state.q)[:, 1].max() > 1e-4


def test_samples_are_those_of_the_steps():
    pushes = [{'force': [0, 30, 0], 'start': 0.01, 'duration': 0.013}]
    scene = with_settings(CASE_A, {'pushes': pushes, 'duration': 0.05})
    simulation = Simulation(scene)
    found = sample(simulation, 20, 10)
    assert len(found.time) == 11
    assert (found.coordinates[-1] == simulation.state.q).all()
    other = Simulation(scene)
    for k in range(1, 11):
        other.advance(*other.gait_reference(20))
        assert (found.coordinates[k] == other.state.q).all()


def test_a_call_that_is_refused_does_not_push():
    scene = with_settings(CASE_A, {'pushes': [{'force': [0, 30, 0]}]})
    simulation = Simulation(scene)
    before = simulation.state
    with pytest.raises(ParameterError, match='rate must be an array of shape'):
        simulation.advance(np.zeros((5, 10, 2)), np.zeros((4, 10, 2)))
    assert simulation.state is before
    bad = np.zeros((5, 10, 2))
    simulation.stepper.advance, kept = interrupted, simulation.stepper.advance
    with pytest.raises(KeyboardInterrupt):
        simulation.advance(bad, bad)
    simulation.stepper.advance = kept
    assert (simulation.state.q == before.q).all()
    assert (simulation.state.u == before.u).all()
    assert simulation.step_count == 0


def interrupted(*_):
    raise KeyboardInterrupt

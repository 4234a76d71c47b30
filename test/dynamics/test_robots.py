# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Robots that differ from Aiko and from link to link: gains, agreement, momentum, very many links.

The methods other than `bdf2` take the same step; the one in dense NumPy is what they must agree
with.
"""

from dataclasses import replace
import math

import numpy as np
from oracle import empty_history, make_stepper, ORACLE
import pytest
from scenes import EPS, every_method, G, references, run

from snake_sim_ros import Friction, Gait, ParameterError, Robot, Scene, Solver
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.posture import center_of_mass, joint_angles, joint_rates
from snake_sim_ros.stepping.methods import METHODS
from snake_sim_ros.stepping.state import initial_state

# Soft in pitch: under their weight all links come down to the floor, thin ones too.
UNEQUAL = """
robot:
  link_count: 5
  link_length: [0.12, 0.09, 0.15, 0.1, 0.13]
  link_mass: [0.7, 0.4, 1.1, 0.5, 0.8]
  contact_offset: [0.04, 0.03, 0.05, 0.03, 0.045]
  contact_radius: [0.05, 0.04, 0.06, 0.045, 0.05]
  inertia: consistent
  yaw_stiffness: [40, 20, 60, 30]
  yaw_damping: [0.2, 0.1, 0.3, 0.15]
  pitch_stiffness: [8, 6, 7, 5]
  pitch_damping: [0.5, 0.3, 0.4, 0.6]
gait:
  yaw: {amplitude_deg: 30, angular_frequency_deg: 80, phase_lag_deg: -50}
"""
FRICTIONS = {
    'orthotropic': Friction(longitudinal=0.1, transversal=0.5),
    'rolling': Friction(longitudinal=0.2, transversal=0.2, rolling=0.05),
}
LONGER = ('slender_undulation', 'hyper_redundant')  # scenes of robots of more links
HEIGHT = 5.0  # m
PATH = {'newton': 1 / 4000, 'bdf2': 1 / 400}  # methods that run for long, and their time steps


@pytest.fixture
def unequal(tmp_path):
    """Return the scene of a robot of five unequal links, read from a file."""
    path = tmp_path / 'unequal.yaml'
    path.write_text(UNEQUAL, encoding='utf-8')
    return load_scene(path)


def lifted(scene):
    """Return the scene's robot at rest in the air."""
    state = initial_state(scene)
    state.q[:, 2] += HEIGHT
    return state


# ---- unequal links ------------------------------------------------------------------------------


@pytest.mark.parametrize('method', METHODS)
def test_every_joint_has_gains_of_its_own(unequal, method):
    # At rest and 0.3 rad off the references, without gravity. The mean controller acts with the
    # mean angle and rate of the step, that of bdf2 with those of its end. What is beside the law
    # is of second order in the turn of the step, theta = 2e-4 rad: K theta^2 of 60 N m/rad, and
    # the same of the rate, up to 2 rad/s, in the damping 0.6 N m s/rad.
    scene = replace(unequal, method=method, gravity=(0.0, 0.0, 0.0), gait=Gait(), dt=1e-4)
    state, reference = lifted(scene), np.full((1, 4, 2), 0.3)
    end, _, report = make_stepper(scene).advance(
        state, empty_history(scene), reference, np.zeros_like(reference)
    )
    share = 1.0 if method == 'bdf2' else 0.5
    angle, rate = share * joint_angles(end.q), share * joint_rates(end.q, end.u)
    robot, turn = scene.robot, 2e-4
    assert np.abs(joint_angles(end.q)).max() < turn
    expected = robot.per_joint('stiffness') * (0.3 - angle) - robot.per_joint('damping') * rate
    assert np.abs(report.joint_torque - expected).max() < 60 * turn**2 + 0.6 * 2 * turn**2


@pytest.mark.parametrize('friction', FRICTIONS)
def test_unequal_links_move_alike_in_all_methods(unequal, friction):
    # On the floor and sliding. Newton's methods leave residuals of 1e-12 m/s, the sweeps eps/r_T =
    # 1e-11 m/s, at contacts. A link may turn these into ten times as much, in each of five steps:
    # below 1e-9 m/s.
    solver = Solver(tolerance=1e-13, residual_tolerance=1e-12, iteration_limit=100_000)
    scene = replace(unequal, friction=FRICTIONS[friction], solver=solver)
    state, history, _ = run(scene, initial_state(scene), 1000)
    ends = {}
    for method in (*METHODS, ORACLE):
        if method != 'bdf2':
            end, _, report = make_stepper(replace(scene, method=method)).advance(
                state, history, *references(scene, 5, start=1000)
            )
            assert not report.unconverged
            assert report.contacts >= 2
            ends[method] = end
    expected = ends.pop(ORACLE)
    assert np.abs(expected.u).max() > 0.1
    for end in ends.values():
        assert np.abs(end.u - expected.u).max() < 1e-9
        assert np.abs(end.q - expected.q).max() < 1e-9 * scene.dt * 5


@pytest.mark.parametrize('method', METHODS)
def test_unequal_links_keep_their_momentum_in_the_air(unequal, method):
    # Joints and controllers are internal: p = -m g t e_z. A step adds a few EPS of what it sums.
    scene, steps = replace(unequal, method=method), 200
    end, _, report = run(scene, lifted(scene), steps)
    assert not report.contacts
    mass, t = scene.robot.per_link('link_mass'), steps * scene.dt
    expected = np.array([0.0, 0.0, -mass.sum() * G * t])
    rounding = steps * 4 * EPS * mass.sum() * (1 + G * t)
    assert np.abs(mass @ end.u[:, :3] - expected).max() < rounding


def test_both_time_steps_lead_unequal_links_along_one_path(unequal):
    # Newton's method has an error of first order at 1/4000 s, bdf2 of second at 1/400 s: both are
    # below 1 % of the way for Aiko.
    path = {}
    for method, dt in PATH.items():
        scene = replace(unequal, method=method, dt=dt)
        end, _, report = run(scene, initial_state(scene), round(4.5 / dt))
        assert not report.unconverged
        path[method] = center_of_mass(scene.robot, end.q)
    way = np.linalg.norm(path['newton'])
    assert np.linalg.norm(path['newton'] - path['bdf2']) < 0.02 * way


@pytest.mark.parametrize('name', ['yaw_stiffness', 'pitch_damping'])
def test_gains_of_the_wrong_number_are_refused_by_name(tmp_path, name):
    path = tmp_path / 'scene.yaml'
    path.write_text(f'robot: {{link_count: 5, {name}: [1, 2, 3, 4, 5]}}', encoding='utf-8')
    with pytest.raises(ParameterError) as caught:
        load_scene(path)
    assert str(caught.value) == (
        f'scene.yaml: robot: {name} must be one number or one for each of the 4 joints, '
        'got 5 numbers'
    )


# ---- other numbers of links ---------------------------------------------------------------------


@every_method
def test_two_links_are_a_robot(method):
    robot = Robot(link_count=2, yaw_stiffness=(30.0,), pitch_damping=(0.3,))
    scene = Scene(robot=robot, method=method)
    _, _, report = run(scene, initial_state(scene), 20)
    assert report.contacts == 4
    assert not report.unconverged


@pytest.mark.parametrize('name', LONGER)
def test_shipped_robots_are_consistent_cylinders(name):
    # Cylinders that touch at the joint limit of 45 deg: L_GS = L/2 - r tan(22.5 deg), to the
    # digits printed; and the density of Aiko's links, 645 kg/m^3, to 3 %.
    robot = load_scene(name).robot
    L, r = robot.link_length, robot.contact_radius
    assert robot.inertia == 'consistent'
    assert robot.contact_offset == pytest.approx(L / 2 - r * math.tan(math.pi / 8), abs=5e-6)
    assert robot.link_mass / (math.pi * r**2 * L) == pytest.approx(645, rel=0.03)


@pytest.mark.parametrize(
    ('name', 'method'), [(LONGER[0], 'newton'), (LONGER[0], 'bdf2'), (LONGER[1], 'newton')]
)
def test_other_robots_move_forward(name, method):
    # Head first, against the wave: that runs along the body at L omega/delta, which is the speed
    # of a snake that does not slip sideways, on the way of its body. At mu = 0.1, 0.5 it slips,
    # and its way winds: Aiko makes 0.6 of that speed. In the last 0.5 of 1.5 s.
    scene = replace(load_scene(name), method=method, dt=PATH[method])
    state, history, centers = initial_state(scene), empty_history(scene), []
    ahead = state.q[0, :3] - state.q[-1, :3]
    for part in range(3):
        steps = round(0.5 / scene.dt)
        state, history, report = make_stepper(scene).advance(
            state, history, *references(scene, steps, start=part * steps)
        )
        assert not report.unconverged
        assert report.residual_max <= scene.solver.residual_tolerance
        centers.append(center_of_mass(scene.robot, state.q))
    speed = (centers[2] - centers[1]) @ ahead / np.linalg.norm(ahead) / 0.5
    wave = scene.gait.yaw
    along = scene.robot.link_length * wave.angular_frequency / abs(wave.phase_lag)
    assert 0.5 * along < speed < along


def test_momentum_of_very_many_links_in_the_air():
    # As of few; sums of 200 links.
    scene, steps = load_scene('hyper_redundant'), 100
    end, _, report = run(scene, lifted(scene), steps)
    assert not report.contacts
    mass, t = scene.robot.per_link('link_mass'), steps * scene.dt
    expected = np.array([0.0, 0.0, -mass.sum() * G * t])
    rounding = steps * 4 * EPS * mass.sum() * (1 + G * t)
    assert np.abs(mass @ end.u[:, :3] - expected).max() < rounding


def test_laws_that_are_not_there_are_not_worked_on():
    # In the air the method that solves the chain together with its contacts does to the last bit
    # what one does that solves the chain alone.
    scene = load_scene('slender_undulation')
    alone, _, _ = run(replace(scene, method='paper'), lifted(scene), 50)
    end, _, report = run(scene, lifted(scene), 50)
    assert report.iterations == report.steps
    assert (end.q == alone.q).all() and (end.u == alone.u).all()

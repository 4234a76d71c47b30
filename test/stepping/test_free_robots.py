# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What robots keep that nothing acts on, and floors that nothing sinks into.

Without friction the floor carries and does nothing else: the center of mass stays where it is, in
any gait. In free flight energy and angular momentum are kept to the order of the method, through
every posture. A robot that moves flat sinks to a small depth and no deeper.
"""

from dataclasses import replace

import numpy as np
import pytest
from scenes import EPS, HEIGHT, isotropic, references
from test_bdf2 import momentum

from snake_sim_ros import Robot, Scene, State
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.posture import center_of_mass, chain_coordinates, joint_angles
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.base import Status
from snake_sim_ros.stepping.methods import empty_history, make_stepper, METHODS
from snake_sim_ros.stepping.state import initial_state

GAITS = ('lateral_undulation', 'sidewinding', 'sinus_lifting')  # A and B, C, D
# Steps without friction. `paper` sweeps for long.
STEPS = {
    'newton': 50_000,
    'bdf2': 15_000,
    'paper': 500,
}


@pytest.mark.parametrize('name', GAITS)
@pytest.mark.parametrize('level', ['spatial', 'planar'])
@pytest.mark.parametrize('method', METHODS)
def test_without_friction_the_center_of_mass_stays_put(method, level, name):
    scene = load_scene(name)
    solver = replace(scene.solver, iteration_limit=200)  # what is left of laws moves nobody aside
    scene = replace(scene, method=method, level=level, friction=isotropic(0.0), solver=solver)
    start, steps = initial_state(scene), STEPS[method]
    reference = references(scene, steps)
    end, _, report = make_stepper(scene).advance(start, empty_history(scene), *reference)
    if level == 'planar' and name != 'lateral_undulation':
        assert 'level planar' in report.failure  # pitch lifts the robot off
        return
    assert report.steps == steps
    # Each step rounds velocities below 1 m/s, and lengths of 1.3 m, a few times; what velocities
    # are off goes on for all the time.
    time = steps * scene.dt
    bound = 4 * EPS * steps * (time / 2 + 1.3)
    moved = center_of_mass(scene.robot, end.q) - center_of_mass(scene.robot, start.q)
    assert np.abs(moved[:2]).max() < bound
    mass = scene.robot.per_link('link_mass')
    assert np.abs(mass @ end.u[:, :2]).max() < 4 * EPS * steps * mass.sum()


def limp(link_count, **settings):
    """Return the scene of a robot in free flight, without gravity and without joint control."""
    gains = ('yaw_stiffness', 'yaw_damping', 'pitch_stiffness', 'pitch_damping')
    robot = Robot(link_count=link_count, **dict.fromkeys(gains, 0.0))
    return Scene(robot=robot, gravity=(0.0, 0.0, 0.0), level='spatial', **settings)


def thrown(robot, pitch_rate, yaw_rate):
    """Return a straight robot whose links turn at rates (n,) [rad/s] that its joints allow."""
    q = chain_coordinates(robot, np.zeros((robot.link_count - 1, 2)))
    q[:, 2] += HEIGHT
    R = rotation_matrices(q[:, 3:])
    omega = np.column_stack([np.zeros(robot.link_count), pitch_rate, yaw_rate])
    arm = robot.link_length / 2 * np.cross(omega, R[:, :, 2])
    v = np.zeros((robot.link_count, 3))
    v[1:] = np.cumsum(arm[:-1] + arm[1:], axis=0)
    return State(q, np.hstack([v, np.einsum('iab,ia->ib', R, omega)]))


def flight_errors(scene, start, time):
    """Return relative errors of energy and spin after a flight, and the angles at its end."""
    steps = round(time / scene.dt)
    still = np.zeros((steps, scene.robot.link_count - 1, 2))
    end, _, report = make_stepper(scene).advance(start, empty_history(scene), still, still)
    assert report.status is Status.CONVERGED and report.steps == steps
    _, spin, energy = momentum(scene.robot, start)
    _, end_spin, end_energy = momentum(scene.robot, end)
    errors = abs(end_energy / energy - 1), np.abs(end_spin - spin).max() / np.abs(spin).max()
    return np.array(errors), joint_angles(end.q)


@pytest.mark.parametrize('rule', ['paper', 'center_of_mass'])
@pytest.mark.parametrize(
    ('method', 'order', 'most'),
    [
        # What the step of the paper loses at 1/4000 s: omega^2 dt k t of the energy as in
        # test_robot_physics, of both links at up to 5 rad/s relative to each other.
        ('newton', 1, 25 / 4000),
        ('paper', 1, 25 / 4000),
        # (omega dt)^2, for each radian.
        ('bdf2', 2, 5 * (5 / 4000) ** 2),
    ],
)
def test_a_pitch_through_a_right_angle_keeps_energy_and_spin(method, order, most, rule):
    errors = []
    for dt in (1 / 1000, 1 / 2000, 1 / 4000):
        scene = limp(2, method=method, dt=dt, drift_correction=rule)
        start = thrown(scene.robot, [3.0, -2.0], [0.5, 0.3])
        error, angle = flight_errors(scene, start, 1.0)
        assert abs(angle[0, 1]) > 1.1 * np.pi / 2  # it went through
        errors.append(error)
    observed = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.abs(observed - order).max() < 0.1, (observed, errors)
    assert errors[-1].max() < most


@pytest.mark.parametrize('yaw', [0.0, 1.0])
@pytest.mark.parametrize('speed', [2.0, 5.0])
def test_a_limp_robot_keeps_its_energy_with_bdf2(speed, yaw):
    # More than half was lost in 10 s when links flipped beyond a right angle.
    scene = limp(11, method='bdf2', dt=1 / 4000)
    rng = np.random.default_rng(0)
    pitch_rate, yaw_rate = rng.uniform(-speed, speed, (2, 11))
    start = thrown(scene.robot, pitch_rate, yaw * yaw_rate)
    errors, _ = flight_errors(scene, start, 10.0)
    assert errors.max() < 1e-3


@pytest.mark.parametrize('name', ['lateral_undulation', 'lateral_undulation_isotropic'])
@pytest.mark.parametrize(('method', 'rate'), [('newton', 4000), ('bdf2', 200)])
def test_a_robot_that_moves_flat_sinks_no_deeper(method, rate, name):
    scene = replace(load_scene(name), level='spatial', method=method, dt=1 / rate)
    stepper, state, history = make_stepper(scene), initial_state(scene), empty_history(scene)
    angle, rates = references(scene, 12 * rate)
    depths = []
    for part in (slice(0, 6 * rate), slice(6 * rate, None)):
        state, history, report = stepper.advance(state, history, angle[part], rates[part])
        assert report.status is Status.CONVERGED
        depths.append(report.penetration_max)
    assert max(depths) <= 1e-6
    if method == 'newton':  # large steps look at the mean of depths: single links may go up to it
        assert depths[1] <= depths[0] * (1 + 1e-3)

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Pushes that last: momentum, joints, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import EPS
from scenes import every_method
from scenes import isotropic

from snake_sim_ros.dynamics.force_directions import joint_directions
from snake_sim_ros.dynamics.force_directions import joint_gaps
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Gait
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.parameters import Robot
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.pushes import Pushes
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.stepping.state import State

FORCE, TORQUE = np.array([0.3, -0.2, 0.5]), np.array([0.02, 0.05, -0.03])


def momentum(robot, state):
    """Return momentum [N s] and angular momentum about the origin [N m s]."""
    mass = robot.per_link('link_mass')
    transversal, axial = robot.per_link('inertia_transversal'), robot.per_link('inertia_axial')
    p = mass[:, None] * state.u[:, :3]
    spin = np.column_stack([transversal, transversal, axial]) * state.u[:, 3:]
    spin = np.einsum('nij,nj->ni', rotation_matrices(state.q[:, 3:]), spin)
    return p.sum(axis=0), (np.cross(state.q[:, :3], p) + spin).sum(axis=0)


def bent(scene):
    """Return a simulation of a robot in the air, bent in both directions."""
    simulation = Simulation(scene)
    q = simulation.state.q.copy()
    q[:, 2] += 1.0
    simulation.state = State(q, simulation.state.u)
    return simulation


@pytest.mark.parametrize('link', [0, 5, 10])
@pytest.mark.parametrize('turns', [False, True])
def test_an_impulse_gives_its_momentum_and_opens_no_joint(link, turns):
    scene = load_scene('sidewinding')
    simulation, rng = bent(scene), np.random.default_rng(link)
    robot, q = scene.robot, simulation.state.q
    pushes = Pushes(robot)
    pushes.begin(link, FORCE, TORQUE, duration=0.3, turns=turns)
    before = State(q, rng.normal(size=(11, 6)))
    after = pushes.act(before, 0.1)
    R = rotation_matrices(q[:, 3:])
    axes = R[link] if turns else np.eye(3)
    P = 0.1 * axes @ FORCE
    L = 0.1 * axes @ TORQUE + np.cross(q[link, :3], P)
    (p_0, L_0), (p_1, L_1) = momentum(robot, before), momentum(robot, after)
    size = np.abs(robot.per_link('link_mass')).sum() * np.abs(before.u).max()
    assert np.abs(p_1 - p_0 - P).max() < 100 * EPS * size
    assert np.abs(L_1 - L_0 - L).max() < 100 * EPS * size
    # Joints open no faster than before: rounding of the solution, of 40 rows.
    change = (after.u - before.u).ravel()
    assert np.abs(joint_directions(robot, R).T @ change).max() < 1e4 * EPS * np.abs(change).max()
    assert (after.q == before.q).all()


@every_method
def test_a_free_robot_gets_the_momentum_of_the_force(method):
    # No gravity, no contact: what the steps between two pushes conserve.
    robot = Robot(link_count=4)
    scene = Scene(
        robot=robot, gait=Gait(), gravity=(0.0, 0.0, 0.0), method=method, dt=1 / 1000,
        level='spatial',
    )  # fmt: skip
    simulation, pushes, period = bent(scene), Pushes(robot), 5 * scene.dt
    pushes.begin(1, FORCE, TORQUE, duration=0.018)  # three periods and three fifths of one
    for _ in range(10):
        simulation.state = pushes.act(simulation.state, period)
        report = simulation.advance(*simulation.gait_reference(5))
        assert not report.failure
    assert not pushes
    p, _ = momentum(robot, simulation.state)
    # A step rounds velocities below 1 m/s, 50 times.
    assert p == pytest.approx(0.018 * FORCE, abs=1e4 * EPS)
    assert np.abs(joint_gaps(robot, simulation.state.q)).max() < 1e-6


@every_method
@pytest.mark.parametrize('force', [3.0, 5.0])
def test_a_push_along_a_link_slides_as_its_impulses_say(method, force):
    # One link of 0.68 kg, mu = 0.5: 3.3 N hold it against a force. Impulses of F T move it at v =
    # F T/m, which friction stops after v^2/(2 mu g) where F is less than that.
    mu = 0.5
    scene = Scene(
        robot=Robot(link_count=1), gait=Gait(), friction=isotropic(mu), method=method,
        dt=1 / 1000, level='spatial',
    )  # fmt: skip
    mass, period = scene.robot.link_mass, 5 * scene.dt
    simulation, pushes = Simulation(scene), Pushes(scene.robot)
    start = simulation.state.q[0, 0]
    pushes.begin(0, (force, 0.0, 0.0), duration=0.1)
    for _ in range(20):
        simulation.state = pushes.act(simulation.state, period)
        assert not simulation.advance(*simulation.gait_reference(5)).failure
    way, speed = simulation.state.q[0, 0] - start, simulation.state.u[0, 0]
    # Solvers leave 1e-6 m/s in each of 100 steps; a step moves by v dt more or less where it ends.
    v = force / mass * period
    if force > mu * mass * 9.81:
        assert speed == pytest.approx((force / mass - mu * 9.81) * 0.1, abs=1e-4)
    else:
        assert abs(speed) < 1e-4
        assert way == pytest.approx(20 * v**2 / (2 * mu * 9.81), abs=20 * v * scene.dt)


def test_a_push_takes_the_place_of_that_before_on_its_link():
    robot = load_scene('lateral_undulation').robot
    state, pushes = Simulation(Scene()).state, Pushes(robot)
    pushes.begin(2, (1.0, 0.0, 0.0), duration=1.0)
    pushes.begin(2, (0.0, 1.0, 0.0), duration=1.0)
    pushes.begin(3, (0.0, 0.0, 2.0), duration=0.5)
    p, _ = momentum(robot, pushes.act(state, 1.0))
    assert p == pytest.approx([0.0, 1.0, 1.0], abs=1e-14)
    assert not pushes
    assert pushes.act(state, 1.0) is state
    pushes.begin(2, (1.0, 0.0, 0.0), duration=1.0)
    pushes.clear()
    assert not pushes


def test_what_is_not_a_push_is_refused():
    pushes = Pushes(Robot())
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
    scene = replace(load_scene('lateral_undulation'), level='spatial')
    simulation, pushes = Simulation(scene), Pushes(scene.robot)
    pushes.begin(0, (0.0, 20.0, 0.0), duration=0.1)
    for _ in range(20):
        simulation.state = pushes.act(simulation.state, 0.005)
        assert not simulation.advance(*simulation.gait_reference(20)).failure
        assert np.abs(joint_gaps(scene.robot, simulation.state.q)).max() < 1e-6

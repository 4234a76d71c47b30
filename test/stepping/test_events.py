# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What changes a velocity from outside is what the next step starts from: pushes, states, gravity.

A step that differentiates over two states must not differentiate across such a jump. Without the
compiler these are short robots with all methods, with it a long one with those most used.
"""

from dataclasses import replace

import numpy as np
from obstacle_scenes import WITHOUT_COMPILER
import pytest
from scenes import EPS, isotropic

from snake_sim_ros import Robot, Scene, Simulation, Solver, State
from snake_sim_ros.scene.posture import center_of_mass
from snake_sim_ros.stepping.methods import METHODS

IMPULSE = np.array([0.3, -1.0, 0.0])  # N s
# `newton` adds laws of a stiffness 1/(1e-5 G) to the inertia, and joints have a condition of
# 1.4e5: of velocities around 1 m/s that rounds 1e-10. What solvers leave of the loads has no part
# along a floor without friction.
ROUNDED = 1e-10  # m/s
SOLVER = Solver(iteration_limit=300)
FLOORS = {'space': (0.0, 0.0, 0.0), 'floor': (0.0, 0.0, -9.81)}

each_method = pytest.mark.parametrize('method', METHODS)
each_dt = pytest.mark.parametrize('dt', [1 / 4000, 1 / 100])
each_level = pytest.mark.parametrize(
    ('level', 'floor'), [('planar', 'floor'), ('spatial', 'floor'), ('spatial', 'space')]
)
each_robot = pytest.mark.parametrize('links', [1, 3] if WITHOUT_COMPILER else [11])


def slippery(method, level, dt, floor, links):
    """Return a robot on a floor without friction or without gravity, that moves at 0.1 m/s."""
    scene = Scene(
        robot=Robot(link_count=links), method=method, level=level, dt=dt, solver=SOLVER,
        friction=isotropic(0.0), gravity=FLOORS[floor],
    )  # fmt: skip
    simulation = Simulation(scene)
    u = simulation.state.u.copy()
    u[:, 0] = 0.1
    simulation.state = State(simulation.state.q, u)
    return simulation


def still(simulation, steps):
    """Take steps with references that hold the joints where they are."""
    joints = simulation.scene.robot.link_count - 1
    report = simulation.advance(np.zeros((steps, joints, 2)), np.zeros((steps, joints, 2)))
    assert not report.failure and not report.unconverged


def momentum(simulation):
    return simulation.scene.robot.per_link('link_mass') @ simulation.state.u[:, :3]


@each_robot
@each_dt
@each_level
@each_method
def test_a_push_arrives_as_what_it_is(method, level, dt, floor, links):
    # Momentum along the floor is what was there and the impulse, at once and for all steps after;
    # and the center of mass moves with it.
    for steps in (0, 5):
        simulation = slippery(method, level, dt, floor, links)
        still(simulation, steps)
        start = momentum(simulation)
        place = center_of_mass(simulation.scene.robot, simulation.state.q)
        mass = simulation.scene.robot.per_link('link_mass').sum()
        simulation.push(links // 2, IMPULSE)
        for _ in range(4):
            still(simulation, 1)
            assert np.abs(momentum(simulation) - start - IMPULSE)[:2].max() < mass * ROUNDED
        # The step of the paper moves by the mean of the velocities of its start and end, that of
        # the formula by what starts anew: both are exact for a constant velocity.
        way = center_of_mass(simulation.scene.robot, simulation.state.q) - place
        short = way - (start + IMPULSE) / mass * 4 * dt
        assert np.abs(short)[:2].max() < 4 * dt * ROUNDED + 8 * EPS


@each_level
@each_method
def test_a_state_that_is_given_is_where_a_step_starts(method, level, floor):
    # Another pose and other velocities than the last step left.
    simulation = slippery(method, level, 1 / 400, floor, 3)
    still(simulation, 5)
    q, u = simulation.state.q.copy(), simulation.state.u.copy()
    q[:, :2] += [0.5, -0.2]
    u[:, :2] = [-0.3, 0.7]
    simulation.state = State(q, u)
    for k in range(1, 5):
        still(simulation, 1)
        error = ROUNDED
        assert np.abs(simulation.state.u[:, :2] - [-0.3, 0.7]).max() < error
        way = k * simulation.scene.dt * np.array([-0.3, 0.7])
        bound = k * simulation.scene.dt * error + 8 * EPS
        assert np.abs(simulation.state.q[:, :2] - q[:, :2] - way).max() < bound


@each_method
@pytest.mark.parametrize('level', ['auto', 'spatial'])
def test_another_gravity_acts_from_the_next_step_on(method, level):
    # Steps that fall get g dt each, whatever was before; a floor that tilts gives g_x dt.
    simulation = slippery(method, level, 1 / 400, 'floor', 3)
    still(simulation, 5)
    for gravity in ((0.5, 0.0, -9.8), (-0.7, 0.2, -9.8), (0.0, 0.0, -9.81)):
        simulation.change(replace(simulation.scene, gravity=gravity))
        before = simulation.state.u.copy()
        for k in range(1, 5):
            still(simulation, 1)
            expected = before[:, :2] + k * simulation.scene.dt * np.array(gravity[:2])
            error = ROUNDED
            assert np.abs(simulation.state.u[:, :2] - expected).max() < error

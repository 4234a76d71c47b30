# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Forces of the contacts, as they are shown: points, frames, and the balance of momentum."""

from dataclasses import replace

import numpy as np
from obstacle_scenes import anywhere, random_ground, random_pegs, robot_scene
import pytest
from random_states import moved
from scenes import DT, isotropic, slope

from snake_sim_ros import Friction, Gait, Scene, Simulation
from snake_sim_ros.scene import obstacles
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.stepping.contact_forces import contact_forces
from snake_sim_ros.stepping.methods import empty_history

MASS, WEIGHT = 7.5, 7.5 * 9.81
# The method `newton` loses up to six digits of velocities around 1 m/s: as forces of a step,
# these are 1e-10 m/s m/dt.
ROUNDED = 1e-10 * MASS / DT  # N
CASE_A = load_scene('lateral_undulation')


@pytest.mark.parametrize('seed', range(3))
def test_points_and_frames_are_those_of_the_middle_of_the_step(seed):
    rng = np.random.default_rng(seed)
    scene = robot_scene(
        rng, ground=random_ground(rng), pegs=random_pegs(rng), self_contact=True, dt=0.01
    )
    state, history = anywhere(rng, 5), empty_history(scene)
    state.q[0, 3:] = [1.0, 0.0, 0.0, 0.0]  # upright, without a heading
    state.u[0, 3:] = 1e-12
    gap, lever, frame = obstacles.contact_geometry(scene, moved(state, -scene.dt / 2))
    loaded = np.isfinite(gap) & (rng.uniform(size=len(gap)) < 0.5)
    assert loaded[:10].any()
    assert loaded[10 : obstacles.first_peg(scene)].any()
    assert loaded[obstacles.first_pair(scene) :].any()
    history.impulse[loaded] = rng.uniform(0.1, 1.0, (loaded.sum(), 5))
    points, forces = contact_forces(scene, state, history)
    # A turn by a is taken as one by 2 atan(a/2): a = 0.02 rad, a^3/12.
    links = obstacles.contact_links(scene)[loaded, 0]
    centers = state.q[links, :3] - scene.dt / 2 * state.u[links, :3]
    assert np.abs(points - centers - lever[loaded]).max() < 1e-6
    expected = np.einsum('ak,aki->ai', history.impulse[loaded, :3], frame[loaded]) / scene.dt
    assert np.abs(forces - expected).max() < 1e-4 * np.abs(expected).max()


def balance(simulation, steps):
    """Assert that forces and gravity make the momentum of each step; return the last forces."""
    scene = simulation.scene
    mass = scene.robot.per_link('link_mass')
    for _ in range(steps):
        before = simulation.state.u
        simulation.advance(*simulation.gait_reference(1))
        points, forces = contact_forces(scene, simulation.state, simulation.history)
        rate = mass @ (simulation.state.u - before)[:, :3] / scene.dt
        total = forces.sum(axis=0) + mass.sum() * np.array(scene.gravity)
        assert len(points) == len(forces)
        assert np.abs(total - rate).max() < ROUNDED
    return points, forces


@pytest.mark.parametrize('level', ['planar', 'spatial'])
def test_at_rest_the_contacts_carry_the_weight(level):
    simulation = Simulation(Scene(gait=Gait(), level=level))
    points, forces = balance(simulation, 20)
    assert len(points) == 22
    assert (forces[:, 2] > 0).all()
    assert forces[:, 2].sum() == pytest.approx(WEIGHT, abs=ROUNDED)
    assert np.abs(forces[:, :2].sum(axis=0)).max() < ROUNDED
    assert np.abs(points[:, 2]).max() < 1e-9


VISCOUS = Friction(viscous_longitudinal=0.2, viscous_transversal=0.6)
SCENES = {
    'planar': replace(CASE_A, level='planar'),
    'spatial': replace(CASE_A, level='spatial'),
    'lifting': load_scene('sidewinding'),
    'slope': replace(CASE_A, gravity=slope(0.2), friction=isotropic(0.1)),
    'pegs': load_scene('obstacle_aided'),
    'viscous': replace(CASE_A, level='planar', friction=VISCOUS),
    'viscous, spatial': replace(CASE_A, level='spatial', friction=VISCOUS),
}


@pytest.mark.parametrize('scene', SCENES.values(), ids=SCENES.keys())
def test_forces_are_those_that_accelerate_the_robot(scene):
    simulation = Simulation(scene)
    simulation.advance(*simulation.gait_reference(8000))
    points, forces = balance(simulation, 20)
    assert np.abs(forces[:, :2]).max() > 0.1
    if scene.pegs.x:
        assert points[-1, 2] > 0.01  # at a peg
        assert forces[-1, 2] == 0.0
        assert np.abs(forces[-1, :2]).max() > 0.1


@pytest.mark.parametrize('level', ['planar', 'spatial'])
def test_forces_of_the_step_of_second_order(level):
    # M (3 u_E - 4 u_n + u_(n-1)) / (2 dt) = forces: impulses act for 2/3 of a step.
    scene = replace(CASE_A, level=level, method='bdf2', dt=1 / 400)
    mass, simulation, velocities = scene.robot.per_link('link_mass'), Simulation(scene), []
    for _ in range(10):
        simulation.advance(*simulation.gait_reference(1))
        velocities.append(simulation.state.u)
    _, forces = contact_forces(scene, simulation.state, simulation.history)
    momenta = [mass @ u[:, :3] for u in velocities[-3:]]
    rate = np.array([1, -4, 3]) @ momenta / (2 * scene.dt)
    # Impulses are along and across the links as they are predicted: h (u_E - u*) beside the end.
    u_0, u_1, u_E = velocities[-3:]
    turn = 2 / 3 * scene.dt * np.linalg.norm((u_E - 2 * u_1 + u_0)[:, 3:], axis=1).max()
    bound = turn * np.abs(forces[:, :2]).sum() + ROUNDED
    assert np.abs(forces.sum(axis=0) - [0, 0, WEIGHT] - rate).max() < bound < 2e-3
    # The first step is four of backward Euler; impulses of the last one are kept. The selection
    # rule lets the floor give way at up to 3e-8 m/s, bdf2.PRESS_SPEED.
    simulation.reset()
    simulation.advance(*simulation.gait_reference(1))
    _, forces = contact_forces(scene, simulation.state, simulation.history)
    assert forces[:, 2].sum() == pytest.approx(WEIGHT, abs=3e-8 * MASS / (scene.dt / 4))


def test_in_flight_and_before_the_first_step_there_is_nothing():
    simulation = Simulation(replace(CASE_A, level='spatial'))
    points, forces = contact_forces(simulation.scene, simulation.state, simulation.history)
    assert points.shape == forces.shape == (0, 3)
    simulation.state.q[:, 2] += 1.0
    points, _ = balance(simulation, 5)
    assert points.shape == (0, 3)


def test_impulses_of_another_method_are_those_of_a_whole_step():
    # Its history has no memory that would say otherwise.
    simulation = Simulation(replace(load_scene('lateral_undulation'), level='spatial'))
    simulation.advance(*simulation.gait_reference(10))
    state, history = simulation.state, simulation.history
    scene = replace(simulation.scene, method='bdf2')
    points, forces = contact_forces(scene, state, history)
    _, expected = contact_forces(simulation.scene, state, history)
    assert len(points) == 22
    # The frames are those of the end of the step, not of its middle: an angle of omega dt/2.
    turn = np.abs(state.u[:, 3:]).max() * scene.dt
    assert np.abs(forces - expected).max() < turn * np.abs(expected).max()

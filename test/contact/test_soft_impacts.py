# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Soft impacts: whatever a link meets and however slowly, it does not bounce.

The law of impacts is completely inelastic, and has no speed below which it is another one. These
tests run without the compiler, see conftest.py: a few steps of a link or two with all methods.
"""

from functools import cache
import math

import numpy as np
import pytest
from scenes import course, G, isotropic, link_scene, lying, OFFSET, RADIUS, SPEED

from snake_sim_ros import Ground, Pegs, Robot, Scene, Solver, State
from snake_sim_ros.dynamics.force_directions import scene_contacts
from snake_sim_ros.scene import obstacles
from snake_sim_ros.scene.posture import chain_coordinates
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.methods import METHODS

PEG = 0.03  # m
FAST = 1e-6  # velocity away from what it met up to which a body has not bounced [m/s]
# `newton` adds laws of a stiffness 1/(1e-5 G) to the inertia: it rounds velocities at 1 m/s.
ROUNDED = 1e-10
NONE = (0.0, 0.0, 0.0)
SLACK = dict.fromkeys(('yaw_stiffness', 'yaw_damping', 'pitch_stiffness', 'pitch_damping'), 0.0)
# Walls to the right and ahead, whose corner the front of a link runs into.
CORNER = Ground(
    heights=((0.2, 0.2), (0.0, 0.2)), cell=1.0, origin=(OFFSET + RADIUS - 1.0, -RADIUS - 1.0)
)
DOWN, ASIDE, DIAGONALLY = (0.0, 0.0, -1.0), (0.0, -1.0, 0.0), (1.0, -1.0, 0.0)
# What is met, in which direction, by a link that lies at the origin: where it touches the floor,
# too, that is beside the motion.
OBSTACLES = {
    'a peg': (ASIDE, {'pegs': Pegs(x=(0.0,), y=(-RADIUS - PEG,), radius=PEG)}),
    'a peg beside the center': (ASIDE, {'pegs': Pegs(x=(0.03,), y=(-RADIUS - PEG,), radius=PEG)}),
    'two pegs': (ASIDE, {'pegs': Pegs(x=(-0.03, 0.02), y=(-RADIUS - PEG,) * 2, radius=PEG)}),
    'one of two pegs around it': (
        ASIDE,
        {'pegs': Pegs(x=(0.0, 0.0), y=(-RADIUS - PEG, RADIUS + PEG + 2e-2), radius=PEG)},
    ),
    'a riser': (ASIDE, {'ground': Ground(heights=((0.2,) * 2,), cell=1.0,
                                         origin=(-1.0, -RADIUS - 1.0))}),
    'a corner of two cells': (DIAGONALLY, {'ground': CORNER}),
    'the floor with both ends': (DOWN, {}),
    'cells with both ends': (DOWN, {'ground': Ground(heights=((0.1,) * 2,) * 2, cell=1.0,
                                                     origin=(-1.0, -1.0))}),
}  # fmt: skip


def leaving(scene, state):
    """Return the fastest motion of contacts that touch away from what they touch [m/s]."""
    gap, W_N, _, _ = scene_contacts(scene, state.q)
    return (W_N.T @ state.u.ravel())[np.abs(gap) < 1e-4].max()


@pytest.mark.parametrize('dt', [1 / 4000, 1 / 100])
@pytest.mark.parametrize('speed', [1e-4, 5e-3, 0.5])
@pytest.mark.parametrize('name', OBSTACLES)
@pytest.mark.parametrize('method', METHODS)
def test_a_link_that_meets_something_does_not_leave_it(method, name, speed, dt):
    # Two or three steps before it, and one that it takes.
    direction, obstacles = OBSTACLES[name]
    scene = link_scene(method, dt, friction=isotropic(0.0), gravity=NONE, **obstacles)
    state, direction = lying(tuple(speed * np.array(direction))), np.array(direction)
    state.q[0, :3] -= 2.4 * dt * speed * direction
    state.q[0, 2] += 0.1 if name == 'cells with both ends' else 0.0
    states, _, report = course(scene, state, 8)
    assert np.abs(states.u[:3, 0, :3] - speed * direction).max() < SPEED + ROUNDED
    assert not report.unconverged
    met = np.flatnonzero(states.u[:, 0, :3] @ direction < 0.9 * (direction @ direction) * speed)[0]
    assert met <= 4
    if name == 'a peg beside the center':
        # The link turns on around the peg, and turns its directions after the law has held.
        turn = np.abs(states.u[:, 0, 4]).max() * dt
        assert leaving(scene, State(states.q[met], states.u[met])) <= FAST + 2 * speed * turn
    else:
        assert np.abs(states.u[met:, 0]).max() <= FAST + SPEED / OFFSET + ROUNDED


@cache
def bent_to_a_u(robot, gap):
    """Return coordinates of three links above the floor whose outer ones are `gap` apart."""
    scene, angle = Scene(robot=robot, self_contact=True), np.zeros((2, 2))
    low, high = math.radians(80), math.radians(110)
    for _ in range(60):
        angle[:, 0] = (low + high) / 2
        q = chain_coordinates(robot, angle)
        q[:, 2] = RADIUS + 1e-3
        closest = obstacles.contact_geometry(scene, q)[0][obstacles.first_pair(scene) :].min()
        low, high = (angle[0, 0], high) if closest > gap else (low, angle[0, 0])
    return q


@pytest.mark.parametrize('dt', [1 / 4000, 1 / 100])
@pytest.mark.parametrize('speed', [1e-4, 5e-3, 0.1])
@pytest.mark.parametrize('method', METHODS)
def test_links_that_meet_each_other_stay_together(method, speed, dt):
    # The outer links of three, bent to a U, close in on each other alike, without momentum: that
    # is one degree of freedom, and the impact stops it.
    robot = Robot(link_count=3, **SLACK)
    scene = Scene(
        robot=robot, self_contact=True, friction=isotropic(0.0), gravity=NONE, method=method,
        dt=dt, level='spatial', solver=Solver(residual_tolerance=1e-10, tolerance=1e-12),
    )  # fmt: skip
    q = bent_to_a_u(robot, 2.4 * dt * speed)
    R, half, u = rotation_matrices(q[:, 3:]), robot.link_length / 2, np.zeros((3, 6))
    for i, sign in ((0, -1.0), (2, 1.0)):
        # Turning by 1 rad/s about the joint, which is ahead of the first and behind the last link.
        u[i, 4] = sign
        arm = sign * half * R[i, :, 2]
        u[i, :2] = sign * np.array([-arm[1], arm[0]])
    u[:, :3] -= u[:, :3].mean(axis=0)
    first = obstacles.first_pair(scene)
    rate = (scene_contacts(scene, q)[1].T @ u.ravel())[first:].min()
    states, _, report = course(scene, State(q, u * speed / -rate), 8)
    assert not report.unconverged
    assert np.abs(states.u[4:]).max() <= (FAST + ROUNDED) / OFFSET


@pytest.mark.parametrize('height', [1e-6, 3e-6, 1e-5, 1e-4])
@pytest.mark.parametrize('method', METHODS)
def test_a_drop_of_some_micrometers_does_not_rebound(method, height):
    # It lands within sqrt(2 h/g): 4.5 ms for 0.1 mm.
    dt = 1 / 4000
    steps = math.ceil(math.sqrt(2 * height / G) / dt) + 1
    for ground in (Ground(), Ground(heights=((0.0,) * 2,) * 2, cell=1.0, origin=(-1.0, -1.0))):
        scene = link_scene(method, dt, friction=isotropic(0.2), ground=ground)
        state = lying()
        state.q[0, 2] += height
        states, _, report = course(scene, state, steps + 10)
        assert np.abs(states.u[steps:, 0]).max() <= FAST + SPEED / OFFSET + ROUNDED
        assert not report.unconverged

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Chains of any links and joints: compiled steps against the dense ones, and what holds for each.

The dense steps know nothing of a tree. They hold a joint with one axis by five constraints, and
one with two axes by four, and solve for their forces.
"""

import numpy as np
from obstacle_scenes import random_ground
from oracle import moreau
import pytest
from random_states import random_chain, random_velocities
from test_bdf2_reference import assert_agreement, both, FRICTIONS, random_case

from snake_sim_ros import Friction, Pegs, Scene, Solver, State
from snake_sim_ros.dynamics.force_directions import joint_gaps
from snake_sim_ros.scene import obstacles
from snake_sim_ros.scene.posture import chain_coordinates, joint_angles
from snake_sim_ros.scene.rotations import about, product, rotation_matrices
from snake_sim_ros.stepping.bdf2.formula import ANEW, SMOOTH, UNKNOWN
from snake_sim_ros.stepping.methods import empty_history, make_stepper

pytestmark = pytest.mark.fast

# A dense system for the joint impulses has a condition of up to 1e5 here: eps times that is 2e-11
# of velocities around 1.
AGREEMENT = 1e-10
GROUNDS = ('floor', 'cells', 'pegs', 'links')


def scene_on(ground, rng, robot, **settings):
    """Return a scene with a robot on a kind of ground."""
    more = {
        'floor': {},
        'cells': {'ground': random_ground(rng)},
        'pegs': {'pegs': Pegs(x=(0.3, -0.2), y=(0.05, -0.04), radius=0.03)},
        'links': {'self_contact': True},
    }[ground]
    solver = Solver(iteration_limit=300, residual_tolerance=1e-13, tolerance=1e-15)
    friction = Friction(longitudinal=0.2, transversal=0.5)
    return Scene(
        robot=robot, solver=solver, friction=friction, level='spatial', **{**more, **settings}
    )


def lying(rng, scene, bend=0.3):
    """Return coordinates of the robot with random angles, touching the ground."""
    present = scene.robot.chain.places.present
    q = chain_coordinates(scene.robot, rng.uniform(-bend, bend, present.shape) * present)
    turn = product(about(2, rng.uniform(-3, 3)), about(1, rng.uniform(-0.1, 0.1)))
    q = np.hstack([q[:, :3] @ rotation_matrices(turn).T, product(turn, q[:, 3:])])
    q[:, :2] -= q[:, :2].mean(axis=0)
    q[:, 2] += obstacles.lift_onto_ground(scene, q)
    return q


@pytest.mark.parametrize('ground', GROUNDS)
@pytest.mark.parametrize('links', [2, 3, 6, 9])
def test_step_of_the_paper_is_the_dense_one(ground, links):
    rng = np.random.default_rng([links, GROUNDS.index(ground)])
    scene = scene_on(ground, rng, random_chain(rng, links), method='paper', dt=1e-3)
    for _ in range(3):
        q = lying(rng, scene)
        state = State(q, 0.2 * random_velocities(rng, links))
        angle = joint_angles(q, scene.robot) + rng.uniform(-0.05, 0.05, (1, links - 1, 2))
        found, expected = (
            stepper.advance(state, empty_history(scene), angle, 0 * angle)
            for stepper in (make_stepper(scene), moreau.DenseStepper(scene))
        )
        assert np.abs(found[0].q - expected[0].q).max() < AGREEMENT
        assert np.abs(found[0].u - expected[0].u).max() < AGREEMENT
        assert np.abs(found[1].impulse - expected[1].impulse).max() < AGREEMENT
        assert found[2].contacts == expected[2].contacts
        assert found[2].joint_twist_max == pytest.approx(expected[2].joint_twist_max, abs=1e-12)
        assert np.abs(joint_gaps(scene.robot, found[0].q)).max() < 1e-12


@pytest.mark.parametrize('ground', GROUNDS)
@pytest.mark.parametrize('phase', [UNKNOWN, ANEW, SMOOTH])
@pytest.mark.parametrize('links', [2, 5, 9])
def test_step_of_bdf2_is_the_dense_one(ground, phase, links):
    rng = np.random.default_rng(GROUNDS.index(ground))
    settings = {
        'floor': {},
        'cells': {'ground': random_ground(rng, spread=0.02)},
        'pegs': {'pegs': Pegs(x=(0.3, -0.2), y=(0.05, -0.04), radius=0.03)},
        'links': {'self_contact': True},
    }[ground]
    compared = 0
    for seed in range(4):
        case = random_case(
            [seed, links, 11], links, FRICTIONS['orthotropic'], phase, 1.0, speed=0.1,
            robot=random_chain, **settings,
        )  # fmt: skip
        end, after, report, parts = both(case)
        if not report.unconverged:
            assert_agreement(end, after, parts, AGREEMENT)
            compared += 1
    assert compared >= 3

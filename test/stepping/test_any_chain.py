# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Chains of any links and joints: compiled steps against the dense ones, and what holds for each.

The dense steps know nothing of a tree. They hold a joint with one axis by five constraints, and
one with two axes by four, and solve for their forces.
"""

from dataclasses import replace
import math

from modular import aiko_link_by_link, modular_robot
import numpy as np
from obstacle_scenes import random_ground
from oracle import moreau
import pytest
from random_states import random_chain, random_velocities
from test_bdf2_reference import assert_agreement, both, FRICTIONS, random_case

from snake_sim_ros import (
    Friction,
    Gait,
    Joint,
    Link,
    load_scene,
    ParameterError,
    Pegs,
    Robot,
    run,
    Scene,
    Shape,
    Simulation,
    Solver,
    Start,
    State,
    Wave,
)
from snake_sim_ros.dynamics.force_directions import joint_gaps
from snake_sim_ros.scene import obstacles
from snake_sim_ros.scene.chain import FixedFrame
from snake_sim_ros.scene.posture import chain_coordinates, joint_angles
from snake_sim_ros.scene.rotations import about, product, rotation_matrices
from snake_sim_ros.stepping.bdf2.formula import ANEW, SMOOTH, UNKNOWN
from snake_sim_ros.stepping.methods import empty_history, make_stepper

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
@pytest.mark.parametrize('links', [2, 3, 6])
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
@pytest.mark.parametrize('links', [2, 3, 6])
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


def test_aiko_link_by_link_is_aiko():
    # Frames B are made of products of the same numbers: 1e-14 of the path after 300 steps.
    scene = replace(load_scene('sidewinding'), method='newton', dt=1e-3, duration=0.3)
    expected = run(replace(scene, level='spatial'), rate=100)
    found = run(replace(scene, robot=aiko_link_by_link(11)), rate=100)
    assert found.scene.robot.axis_names == expected.scene.robot.axis_names
    assert np.abs(found.position - expected.position).max() < 1e-12
    assert np.abs(found.joint_angle - expected.joint_angle).max() < 1e-10
    assert np.abs(found.joint_torque - expected.joint_torque).max() < 1e-8


@pytest.mark.parametrize(('method', 'dt'), [('newton', 1e-3), ('bdf2', 5e-3)])
def test_a_held_axis_is_as_good_as_none(method, dt):
    # Held by springs of 1e9 N m/rad an axis gives way by less than 1e-9 rad under 1 N m. In the
    # air, since on a floor the loads of rigid contacts are selected by less than that.
    scene = replace(
        load_scene('lateral_undulation'), start=Start(height=30.0), method=method, dt=dt,
        duration=2.0, level='spatial',
    )  # fmt: skip
    held = aiko_link_by_link(6, pitch_stiffness=1e9, pitch_damping=1e9)
    single = aiko_link_by_link(6, two_axes=False)
    one, other = (run(replace(scene, robot=robot), rate=20) for robot in (held, single))
    assert one.joint_angle.shape[1] == 2 * other.joint_angle.shape[1] == 10
    assert np.abs(one.position - other.position).max() < 1e-9
    assert np.abs(one.joint_angle[:, ::2] - other.joint_angle).max() < 1e-9


def rotated_axis(simulation, axis):
    """Return an axis in the frame of the first link in axes of I."""
    chain, q = simulation.scene.robot.chain, simulation.state.q
    return rotation_matrices(q[:1, 3:])[0] @ chain.frame[0] @ axis


@pytest.mark.parametrize('method', ['newton', 'bdf2'])
def test_a_pendulum_swings_about_any_axis(method):
    """Two round bodies in the air, without gravity: the period of a torsion spring."""
    axis = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    body = {'inertia': (2e-3, 2e-3, 2e-3, 0.0, 0.0, 0.0), 'mass': 1.0, 'shapes': (Shape(),)}
    robot = Robot(
        links=(Link(name='body', **body), Link(name='arm', **body)),
        joints=(Joint(name='hinge', axis=tuple(axis)),),
        yaw_stiffness=1.0, pitch_stiffness=1.0, yaw_damping=0.0, pitch_damping=0.0,
    )  # fmt: skip
    scene = Scene(
        robot=robot, gravity=(0.0, 0.0, 0.0), method=method, level='spatial', dt=1e-3,
        duration=0.4, start=Start(yaw=0.0, pitch=0.0, height=1.0),
    )  # fmt: skip
    simulation = Simulation(scene)
    start, state = 0.05, simulation.state  # rad/s of the arm against the body
    spin = rotation_matrices(state.q[:, 3:]).transpose(0, 2, 1) @ rotated_axis(simulation, axis)
    state.u[:, 3:] = spin * np.array([[-start / 2], [start / 2]])
    swing = [simulation.joint_angle[0]]
    for _ in range(400):
        simulation.advance(np.zeros((1, 1, 2)))
        swing.append(simulation.joint_angle[0])
    # The reduced moment of inertia is half of 2e-3: omega = sqrt(1/1e-3) = 31.6 rad/s.
    rate = math.sqrt(1.0 / 1e-3)
    expected = start / rate * np.sin(rate * 1e-3 * np.arange(401))
    # Both methods are of second order here: rate^2 dt^2/12 of the phase after 12.6 rad is 1 ms.
    assert np.abs(np.array(swing) - expected).max() < 5e-3 * start / rate * 12.6


@pytest.mark.parametrize('method', ['newton', 'bdf2'])
def test_weight_of_any_robot_is_on_the_floor(method):
    # Bent, so that it does not roll.
    scene = Scene(
        robot=modular_robot(6), gait=Gait(yaw=Wave(offset=0.5)), method=method, level='spatial',
        duration=1.5, dt=2e-3,
    )  # fmt: skip
    found = run(scene, rate=10)
    force = found.contacts(len(found.time) - 1)[1].sum(axis=0)
    assert force == pytest.approx([0.0, 0.0, 6 * 0.16 * 9.81], abs=1e-3)
    assert found.report.penetration_max < 1e-5


def test_spheres_of_a_link_rub_with_its_friction():
    """A body of one link that slides on three balls stops where its friction says."""
    stops = {}
    for factor in (0.5, 2.0):
        ball = Link(
            name='ball', mass=1.0, inertia=(1e-3, 1e-3, 1e-3, 0.0, 0.0, 0.0), friction=factor,
            shapes=tuple(
                Shape(radius=0.02, start=place)
                for place in ((0.1, 0.1, 0.0), (-0.1, 0.1, 0.0), (0.0, -0.1, 0.0))
            ),
        )  # fmt: skip
        robot = Robot(links=(ball,), joints=())
        scene = Scene(
            robot=robot, friction=Friction(longitudinal=0.2, transversal=0.2), level='spatial',
            method='newton', dt=1e-4,
        )  # fmt: skip
        simulation = Simulation(scene)
        simulation.push(0, np.array([0.5, 0.0, 0.0]))
        begin = simulation.state.position[0, 0]
        simulation.advance(np.zeros((6000, 0, 2)))
        stops[factor] = simulation.state.position[0, 0] - begin
    # v^2/(2 mu g), first order in dt: v dt/2 = 3e-5 m.
    for factor, way in stops.items():
        assert way == pytest.approx(0.25 / (2 * 0.2 * factor * 9.81), abs=1e-4)


def links_with_frames(*names):
    frames = ((FixedFrame(name=name),) for name in names)
    return tuple(Link(name=a, frames=frame) for a, frame in zip('abc', frames, strict=True))


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        (
            {'links': 3 * (Link(name='bare'),)},
            "names of links must differ, got 'bare' twice",
        ),
        (
            {'links': tuple(Link(name=name) for name in 'abc')},
            'a link must have shapes to lie on: all links have none',
        ),
        (
            {'links': links_with_frames('x', 'b', 'y')},
            "names of frames must differ, got 'b' twice",
        ),
        (
            {'links': links_with_frames('x', 'a_center', 'y')},
            "names of frames must differ, got 'a_center' twice",
        ),
        (
            {'joints': (Joint(name='one'), Joint(name='two', backward=True))},
            'joints that lead backward must come before the others, got one before them',
        ),
        ({'joints': ()}, 'joints must be one fewer than the links, got 0 joints and 3 links'),
        ({'link_count': 5}, 'link_count must be the number of links, 3, got 5'),
        ({'up': (0, 0, 0)}, 'up must be a direction of 3 numbers, got [0.0, 0.0, 0.0]'),
        ({'up': (1, 0, 0)}, 'up must not be along a link, got [1.0, 0.0, 0.0] for a link along'),
    ],
)
def test_chains_that_cannot_be(change, sentence):
    with pytest.raises(ParameterError) as caught:
        replace(modular_robot(3), **change)
    assert str(caught.value).startswith(sentence)


@pytest.mark.parametrize(
    ('record', 'values', 'sentence'),
    [
        (Joint, {'axis': (0, 0, 0)}, 'axis of a joint must not be 0, got [0.0, 0.0, 0.0]'),
        (Joint, {'axis': (0, 1)}, 'axis must have 3 numbers, got 2'),
        (Joint, {'axis': (0, math.nan, 1)}, 'axis must be finite, got nan'),
        (
            Joint,
            {'name': 'knee', 'second_axis': (0, 1, 1)},
            'axis and second_axis of knee must be at right angles, got an angle of 45 degrees',
        ),
        (Link, {'mass': 0.0}, 'mass must be above 0 kg, got 0 kg'),
        (Link, {'inertia': (1, 1)}, 'inertia must have 6 numbers, got 2'),
        (
            Link,
            {'name': 'tail', 'inertia': (1, 1, 3, 0, 0, 0)},
            'inertia of tail must have principal moments above 0, each at most the sum of the',
        ),
        (FixedFrame, {}, 'a fixed frame must have a name, got none'),
        (FixedFrame, {'name': 'imu', 'rotation': (1, 2)}, 'rotation must have 3 numbers, got 2'),
        (Shape, {'radius': -1.0}, 'radius must be above 0 m, got -1 m'),
        (Shape, {'start': (1,)}, 'start must have 3 numbers, got 1'),
    ],
)
def test_links_and_joints_that_cannot_be(record, values, sentence):
    with pytest.raises(ParameterError) as caught:
        record(**values)
    assert str(caught.value).startswith(sentence)

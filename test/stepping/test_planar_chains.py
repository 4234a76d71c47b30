# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Robots that are given link by link in the plane: against the dense step and the spatial one."""

from dataclasses import replace

from flat_states import crooked, flat_modules, in_plane, lying_flat
import numpy as np
from oracle import empty_history, make_stepper, ORACLE
import pytest
from test_planar import EXACT, flat_scene, FRICTIONS, HELD

from snake_sim_ros import Friction, load_robot, load_scene, ParameterError, Patches, Pegs, Shape
from snake_sim_ros.scene.posture import joint_angles
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.levels import what_is_not_planar
from snake_sim_ros.stepping.methods import METHODS

pytestmark = pytest.mark.fast

# A light link turns by a lever of 3 cm over its inertia, 500/(kg m), times its friction at most;
# impulses round through the joints as in test_planar.py.
TURNING = 500
ROUNDING = 1e-9


def problem(seed, link_count, **settings):
    """Return a scene of the dense step with modules, a state that bends, and references."""
    rng = np.random.default_rng([seed, link_count])
    robot = replace(flat_modules(rng, link_count), **settings.pop('robot', {}))
    state = crooked(rng, robot, speed=0.1)
    angle = joint_angles(state.q, robot)[None]
    angle[..., 0] += rng.uniform(-0.05, 0.05, angle.shape[:2])
    rate = np.zeros(angle.shape)
    rate[..., 0] = rng.uniform(-1.0, 1.0, rate.shape[:2])
    solver = replace(EXACT, r_sliding=0.04)  # links are lighter than those of Aiko
    settings = {'friction': FRICTIONS['orthotropic'], 'solver': solver, **settings}
    scene = flat_scene(ORACLE, robot=robot, **settings)
    return scene, state, angle, rate


def step_of(scene, method, state, angle, rate):
    """Return what a step of a method makes of a state without history."""
    scene = replace(scene, method=method)
    return make_stepper(scene).advance(state, empty_history(scene), angle, rate)


def check(scene, state, angle, rate):
    """Check a step of all methods of the paper's step against the dense one; return if taken."""
    end, history, report = step_of(scene, ORACLE, state, angle, rate)
    if report.failure:  # it lifts a sphere or rolls, which Newton's method finds out in seconds
        return False
    load = HELD * history.impulse[:, 0].max() + EXACT.tolerance
    speed = TURNING * len(history.impulse) * scene.friction.transversal * load + ROUNDING
    for method in METHODS:
        if method == 'bdf2':
            continue
        other, memory, news = step_of(scene, method, state, angle, rate)
        assert news.failure == '', method
        assert news.contacts == report.contacts == len(history.impulse)
        assert np.abs(memory.impulse - history.impulse).max() < load, method
        assert np.abs(other.u - end.u).max() < speed, method
        assert np.abs(other.q - end.q).max() < scene.dt * speed + 1e-14, method
        torque = np.abs(news.joint_torque - report.joint_torque).max(axis=0)
        assert torque[0] < speed, method
        assert torque[1] < scene.robot.link_count * load / scene.dt, method
        absent = scene.robot.chain.places.present == 0.0
        assert (news.joint_torque[absent] == 0.0).all()
    return True


@pytest.mark.parametrize('friction', FRICTIONS)
@pytest.mark.parametrize('link_count', [3, 5, 8])
def test_steps_agree_with_the_dense_step(link_count, friction):
    settings = {'friction': FRICTIONS[friction], 'pd_scheme': 'end'}
    assert sum(check(*problem(seed, link_count, **settings)) for seed in range(8)) >= 2


def test_laws_of_joints_hold_for_the_axes_that_are_there():
    limits = {'yaw_torque_limit': 0.2, 'joint_viscous_friction': 0.02}
    assert sum(check(*problem(seed, 6, robot=limits)) for seed in range(8)) >= 2


def test_links_rub_with_their_own_friction():
    # Viscous friction, a factor for each link, and patches below some of them.
    robot = flat_modules(np.random.default_rng(2), 5)
    factors = (0.5, 1.0, 1.5, 1.0, 0.7)
    links = tuple(replace(link, friction=f) for link, f in zip(robot.links, factors, strict=True))
    friction = Friction(
        longitudinal=0.02, transversal=0.05, viscous_longitudinal=0.3, viscous_transversal=0.5
    )
    patches = Patches(factors=((0.5, 1.5), (1.0, 0.7)), cell=0.1, origin=(-0.1, -0.1))
    taken = 0
    for seed in range(4):
        scene, *_ = problem(seed, 5, friction=friction, patches=patches)
        scene = replace(scene, robot=replace(robot, links=links))
        state = crooked(np.random.default_rng(seed), scene.robot, speed=0.1)
        angle = joint_angles(state.q, scene.robot)[None]
        taken += check(scene, state, angle, 0 * angle)
    assert taken >= 2


@pytest.mark.parametrize('seed', [2, 3])
def test_bdf2_goes_to_the_path_of_the_dense_step(seed):
    # As in test_planar.py: apart by O(dt), which is what the paper's step makes.
    apart = []
    for k in range(3):
        scene, state, angle, _ = problem(seed, 4, friction=FRICTIONS['isotropic'])
        scene, steps = replace(scene, dt=1 / 1000 / 2**k, pd_scheme='end'), 8 * 2**k
        reference = np.tile(angle, (steps, 1, 1)), np.zeros((steps, 3, 2))
        ends = [step_of(scene, method, state, *reference) for method in (ORACLE, 'bdf2')]
        assert not any(report.failure for _, _, report in ends)
        apart.append(np.abs(ends[0][0].q - ends[1][0].q)[:, :3].max())
    assert np.divide(apart[:-1], apart[1:]).min() > 1.6, apart


def test_a_robot_without_pitch_axes_is_held_by_its_contacts():
    # As the same modules in space do, it rolls once it is straight.
    robot = flat_modules(np.random.default_rng(4), 4, yaw=1.0)
    joints = tuple(replace(joint, second_axis=None) for joint in robot.joints)
    robot = replace(robot, joints=joints, pitch_stiffness=100.0)
    for bend, failure in ((0.4, ''), (0.0, 'the robot would roll')):
        scene = flat_scene(robot=robot, friction=FRICTIONS['isotropic'])
        q = lying_flat(robot, np.full(3, bend))
        state = in_plane(robot, q, np.array([0.0, 0.1]), np.zeros(4))
        angle = joint_angles(q, robot)[None]
        report = step_of(scene, 'newton', state, angle, 0 * angle)[2]
        assert failure in report.failure and bool(failure) == bool(report.failure)


def test_links_touch_pegs_where_their_capsules_are():
    """The impulse is that of space, where pegs are found by other code."""
    robot = flat_modules(np.random.default_rng(3), 4)
    shapes = (Shape(radius=0.03, start=(0.01, 0.0, 0.0), end=(0.05, 0.0, 0.0)),)
    robot = replace(robot, links=tuple(replace(link, shapes=shapes) for link in robot.links))
    q = lying_flat(robot, np.full(3, 0.3) * robot.chain.places.present[:, 0])
    c, s = rotation_matrices(q[1:2, 3:])[0, :2, 2]
    peg = q[1, :2] + robot.chain.capsules.center[1, 2] * np.array([c, s])
    peg = peg + (0.03 + 0.02 + 1e-7) * np.array([-s, c])
    found = {}
    for level in ('planar', 'spatial'):
        scene = flat_scene(
            robot=robot, friction=FRICTIONS['none'], level=level, dt=1e-3,
            pegs=Pegs(x=(peg[0],), y=(peg[1],), radius=0.02),
        )  # fmt: skip
        state = in_plane(robot, q, np.array([0.0, 0.1]), np.zeros(4))
        angle = joint_angles(q, robot)[None]
        end, history, report = step_of(scene, 'newton', state, angle, 0 * angle)
        assert not report.failure
        found[level] = end.u[:, :2], history.impulse[robot.chain.spheres.link.size :, :2]
    (u, P), (v, Q) = found.values()
    assert P.max() > 1e-3
    assert np.abs(P - Q).max() < 1e-3 * P.max()
    assert np.abs(u - v).max() < 1e-3 * np.abs(v).max()


@pytest.mark.parametrize(
    ('change', 'reason'),
    [
        ({'shapes': ()}, 'link module_1 has 0 spheres, and in the plane links have one or two'),
        (
            {'shapes': (Shape(radius=0.03, start=(0.03, 0.01, 0.0)),)},
            'the center of mass of link module_1 is 0.01 m beside the line of its joints',
        ),
        (
            {'shapes': (Shape(radius=0.02, start=(0.03, 0.0, 0.0)),)},
            'a sphere of link module_1 is 0.01 m above the floor when all joints are at 0',
        ),
        (
            {'center_of_mass': (0.03, 0.0, -0.01)},
            'the center of mass of link module_1 is 0.01 m beside the line of its joints',
        ),
        (
            {'inertia': (1e-4, 1e-4, 1e-4, 0.0, 2e-5, 0.0)},
            'link module_1 has products of inertia with the upright axis',
        ),
    ],
)
def test_what_does_not_lie_in_the_plane(change, reason):
    robot = flat_modules(np.random.default_rng(1), 4)
    links = (robot.links[0], replace(robot.links[1], **change), *robot.links[2:])
    scene = flat_scene(robot=replace(robot, links=links))
    assert what_is_not_planar(scene, 'newton', METHODS['newton']).startswith(reason)
    with pytest.raises(ParameterError, match=r'level planar: .*; choose level spatial or auto'):
        make_stepper(scene)
    assert make_stepper(replace(scene, level='auto')).level == 'spatial'


def test_joints_that_turn_about_slanted_axes_are_not_planar():
    robot = flat_modules(np.random.default_rng(1), 3)
    joints = (robot.joints[0], replace(robot.joints[1], axis=(0.0, 0.1, 1.0)))
    scene = flat_scene(robot=replace(robot, joints=joints))
    reason = 'servo_1 turns about an axis that is neither upright nor across the links beside it'
    assert what_is_not_planar(scene, 'newton', METHODS['newton']) == reason


def test_numbers_rounded_in_a_file_make_no_difference():
    robot = flat_modules(np.random.default_rng(1), 3)
    turned = (1.5708 - np.pi / 2, 0.0, 0.0)
    joints = tuple(replace(joint, rotation=turned) for joint in robot.joints)
    scene = flat_scene(robot=replace(robot, joints=joints))
    assert what_is_not_planar(scene, 'newton', METHODS['newton']) == ''


@pytest.mark.parametrize('name', ['reu_lateral', 'sea', 'rsnake'])
def test_robots_of_the_package_are_planar(name):
    scene = load_scene('reu_lateral')
    if name != 'reu_lateral':
        scene = replace(scene, robot=load_robot(name))
    assert what_is_not_planar(scene, 'newton', METHODS['newton']) == ''

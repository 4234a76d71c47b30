# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
One step of two or three links against the dense step: the first verdict on an edit of the physics.

It takes some seconds without the compiler:

    NUMBA_DISABLE_JIT=1 ./run test test/stepping/test_one_step.py
"""

from dataclasses import replace

from dense_step import dense_step
from flat_states import crooked, flat_robot
from hinges import AXES, floating, hinge, of_joint
import numpy as np
from obstacle_scenes import (
    check_agreement,
    lying_on,
    MIDDLE,
    random_ground,
    random_patches,
    random_pegs,
)
from oracle import moreau, ORACLE
import pytest
from random_states import EPS, jointed_links, random_robot
from scenes import first_steps, isotropic, link_scene, lying, OFFSET, RADIUS, run, SPEED
from test_bdf2_reference import (
    among_obstacles,
    assert_agreement,
    both,
    check_among_obstacles,
    check_cases,
    HELD_AGREEMENT,
    random_case,
    with_laws_of_joints,
)
from test_planar import EXACT, HELD

from snake_sim_ros import Friction, Robot, Scene, Solver, State
from snake_sim_ros.contact.closing import gaps_to_close, MOST_CLOSED
from snake_sim_ros.contact.contacts import make_contacts
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.force_directions import joint_gaps
from snake_sim_ros.scene.parameters import DRIFT_CORRECTIONS, PD_SCHEMES
from snake_sim_ros.scene.posture import center_of_mass, chain_coordinates, joint_angles
from snake_sim_ros.stepping.bdf2.formula import ANEW, SMOOTH, UNKNOWN
from snake_sim_ros.stepping.methods import empty_history

pytestmark = pytest.mark.fast

FRICTION = Friction(longitudinal=0.2, transversal=0.4, backward=0.3, rolling=0.05)
each_solver = pytest.mark.parametrize('method', MIDDLE)
# The dense solve of the joints has a condition of 1.4e5 and velocities are below 10 m/s and rad/s.
FREE_AGREEMENT = 10 * 1.4e5 * EPS


def floor_scene(rng, links, **settings):
    """Return a scene of different links on a slope, with every friction there is."""
    robot = random_robot(rng, links)
    return Scene(
        robot=robot, friction=FRICTION, gravity=(0.1, 0.2, -9.8), level='spatial', **settings
    )


def in_flight(rng, links, **settings):
    """Return scene, state and references of a bent robot above the floor."""
    scene = floor_scene(rng, links, **settings)
    state = jointed_links(rng, scene.robot, rng.uniform(-0.6, 0.6, (links - 1, 2)))
    state.q[:, 2] += 2.0
    angle = joint_angles(state.q) + rng.uniform(-0.05, 0.05, (links - 1, 2))
    return scene, state, angle, rng.uniform(-1.0, 1.0, angle.shape)


# ---- the step of the paper ----------------------------------------------------------------------


@each_solver
def test_contacts_with_the_floor(method):
    closed = 0
    for links, seed in ((2, 4), (3, 2), (3, 5)):
        rng = np.random.default_rng([seed, links])
        scene = floor_scene(rng, links)
        closed += check_agreement(scene, lying_on(rng, scene), rng, method)
    assert closed > 6


@each_solver
def test_contacts_with_pegs_and_cells(method):
    closed = 0
    for seed in range(3):
        rng = np.random.default_rng(seed)
        obstacles = {'pegs': random_pegs(rng), 'ground': random_ground(rng)}
        scene = floor_scene(rng, 3, patches=random_patches(rng), **obstacles)
        closed += check_agreement(scene, lying_on(rng, scene), rng, method)
    assert closed > 3


@each_solver
def test_contacts_of_links_with_each_other(method):
    # Folded by 97 degrees a joint, in the air: the outer ends of the outer links are 9 mm inside
    # each other.
    rng = np.random.default_rng(1)
    scene = Scene(
        robot=Robot(link_count=3), self_contact=True, self_contact_friction=0.3, level='spatial'
    )
    q = chain_coordinates(scene.robot, np.array([[1.7, 0.0], [1.7, 0.0]]))
    q[:, 2] += 1.0
    u = rng.uniform(-0.1, 0.1, (3, 6))
    assert check_agreement(scene, State(q, u), rng, method) == 1


@each_solver
@pytest.mark.parametrize('pd_scheme', PD_SCHEMES)
def test_the_articulated_body_in_flight(method, pd_scheme):
    # One linear system of masses, dampers and joints.
    for links in (1, 2, 3):
        rng = np.random.default_rng(links)
        scene, state, angle, rate = in_flight(rng, links, pd_scheme=pd_scheme, method=method)
        expected = dense_step(scene, state, empty_history(scene), angle, rate)
        end, _, report = first_steps(scene, state, angle[None], rate[None])
        assert report.contacts == 0
        u = expected.velocities(np.zeros((0, 5))).reshape(links, 6)
        assert np.abs(end.u - u).max() < FREE_AGREEMENT


@each_solver
@pytest.mark.parametrize('axis', AXES)
@pytest.mark.parametrize('pd_scheme', PD_SCHEMES)
def test_the_controller_of_a_joint(method, axis, pd_scheme):
    # Two straight links turn about their own centers: Theta/2 is the inertia of the joint, at the
    # angle 0 and the rate w before. The references a, b are of the middle, dt w/2 its angle.
    K, D, a, b, w = 40.0, 0.02, 0.01, 0.5, 2.0
    scene = replace(
        floating(method, **{f'{axis}_stiffness': K, f'{axis}_damping': D}), pd_scheme=pd_scheme
    )
    dt = scene.dt
    c, middle = 2 * dt / scene.robot.inertia_transversal, dt / 2 * w
    end = {
        'start': w + c * (K * (a - dt / 2 * b) + D * (b - w)),
        'midpoint': w + c * (K * (a - middle) + D * (b - w)),
        'average': (w + c * (K * (a - middle + dt / 4 * w) + D * (b - w / 2)))
        / (1 + c * (D / 2 + K * dt / 4)),
        'end': (w + c * (K * (a + dt / 2 * b - middle) + D * b)) / (1 + c * (D + K * dt / 2)),
    }
    references = np.zeros((2, 1, 1, 2))
    references[:, 0, 0, AXES[axis]] = a, b
    state, _, _ = first_steps(scene, hinge(scene, axis, w), *references)
    # In the middle the joint is bent by 1 mrad, the square of which is lost.
    assert of_joint(state, axis)[1] == pytest.approx(end[pd_scheme], rel=middle**2)


@each_solver
@pytest.mark.parametrize('flies', [False, True])
def test_laws_of_joints(method, flies):
    seen = np.zeros(2, int)
    for seed in range(10) if flies else (1, 6, 7, 9, 11):  # sweeps in NumPy end soon in these
        rng, links = np.random.default_rng([seed, 2]), 2 + seed % 2
        scene, state, angle, rate = in_flight(rng, links, solver=Solver(tolerance=1e-13))
        if not flies:
            state = lying_on(rng, scene)
            angle = joint_angles(state.q) + rng.uniform(-0.05, 0.05, angle.shape)
        scene = with_laws_of_joints(seed, scene, state)
        start = state, angle[None], rate[None]
        expected, _, dense = first_steps(replace(scene, method=ORACLE), *start)
        end, _, report = first_steps(replace(scene, method=method), *start)
        assert dense.unconverged == report.unconverged == 0
        # Rates that are held are rounded as in test_bdf2_reference.py.
        assert np.abs(end.u - expected.u).max() < HELD_AGREEMENT
        most = scene.robot.per_joint('torque_limit')
        seen += 1, (np.abs(report.joint_torque) >= most * (1 - 1e-12)).any()
    assert seen.min() >= 2


@each_solver
@pytest.mark.parametrize('rule', DRIFT_CORRECTIONS)
def test_drift(method, rule):
    for links in (2, 3):
        rng = np.random.default_rng(links)
        scene, state, angle, rate = in_flight(rng, links, drift_correction=rule, method=method)
        end, _, report = first_steps(scene, state, angle[None], rate[None])
        q_M = moreau.middle_coordinates(state, scene.dt)
        drifted = moreau.end_coordinates(state.q, q_M, state.u, end.u, scene.dt)
        drifted[:, 3:] /= np.linalg.norm(drifted[:, 3:], axis=1)[:, None]
        left = joint_gaps(scene.robot, drifted)
        assert report.joint_gap_max == pytest.approx(np.abs(left[:, :3]).max(), abs=10 * EPS)
        assert report.joint_twist_max == pytest.approx(np.abs(left[:, 3]).max(), abs=10 * EPS)
        open_joints = np.abs(joint_gaps(scene.robot, end.q)).max()
        if rule == 'none':
            assert np.abs(end.q - drifted).max() < 10 * EPS
            assert open_joints > 1e-9
            continue
        assert open_joints < 100 * EPS
        if rule == 'paper':
            assert np.abs(end.q[0] - drifted[0]).max() < 10 * EPS
        else:
            way = center_of_mass(scene.robot, end.q) - center_of_mass(scene.robot, drifted)
            assert np.abs(way).max() < 10 * EPS
            assert np.abs(end.q[0, 3:] - drifted[0, 3:]).max() < 10 * EPS


@pytest.mark.parametrize(
    'friction', [isotropic(0.05), Friction(longitudinal=0.02, transversal=0.1)]
)
def test_in_the_plane(friction):
    for links in (2, 3):
        rng = np.random.default_rng(links)
        robot = flat_robot(rng, links)
        state = crooked(rng, robot, speed=0.1)
        scene = Scene(robot=robot, friction=friction, level='planar', solver=EXACT)
        angle = joint_angles(state.q)
        angle[:, 0] += rng.uniform(-0.05, 0.05, links - 1)
        start = state, angle[None], np.zeros((1, links - 1, 2))
        expected, loads, _ = first_steps(replace(scene, method=ORACLE), *start)
        end, history, report = first_steps(scene, *start)
        assert not report.failure and report.planar_steps == 1
        # As in test_planar.py.
        load = HELD * loads.impulse[:, 0].max() + EXACT.tolerance
        assert np.abs(history.impulse - loads.impulse).max() < load
        speed = 41 * 2 * links * friction.transversal * load + 1.4e5 * EPS
        assert np.abs(end.u - expected.u).max() < speed
        assert np.abs(end.q - expected.q).max() < scene.dt * speed + 10 * EPS


# ---- the step of `bdf2` -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('phase', 'ratio'), [(SMOOTH, 0.5), (SMOOTH, 2.0), (ANEW, 1.0), (UNKNOWN, 1.0)]
)
def test_bdf2_with_the_floor(phase, ratio):
    landed, jumped, pushed = check_cases(range(1, 13), phase, ratio, (2, 3))
    assert 5 < landed <= jumped < 12 and pushed > 0


def test_bdf2_among_pegs_cells_and_links():
    # Three links do not meet there; in the last case the first link and the last of five do.
    cases = [among_obstacles(seed, 3) for seed in range(8)]
    check_among_obstacles([*cases, among_obstacles(83, 5)])


@pytest.mark.parametrize('lift', [0.0, 5.0])
def test_bdf2_with_laws_of_joints(lift):
    settled = 0
    for seed in range(12):
        phase = (SMOOTH, ANEW)[seed % 2]
        case = random_case([seed, 8], 2 + seed // 2 % 2, Friction(), phase, 1.0, lift=lift)
        case = with_laws_of_joints(seed, *case[:2]), *case[1:]
        end, after, report, parts = both(case)
        if not report.unconverged and all(part.settled for part in parts):
            assert_agreement(end, after, parts, HELD_AGREEMENT)
            settled += 1
    assert settled >= 6


@pytest.mark.parametrize('links', [2, 3])
def test_bdf2_starts_with_velocities_that_joints_allow(links):
    # Without an impact, which would make the first part one of first order.
    scene, state, _, *references = random_case(links, links, Friction(), SMOOTH, 1.0, lift=5.0)
    end, after, _, parts = both((scene, state, empty_history(scene), *references))
    assert_agreement(end, after, parts)


@pytest.mark.parametrize('depth', [-1e-4, 0.0, 1e-4, 5e-3, 2e-2])
@pytest.mark.parametrize('speed', [0.0, 0.3])
def test_a_link_thrown_on_into_the_floor_is_not_thrown_out(depth, speed):
    # A step undoes the way that it made itself: the link stops as deep as it was, and one that was
    # above the floor stops at the floor.
    scene = link_scene('bdf2', 1 / 100, friction=isotropic(0.0), gravity=(0.0, 0.0, 0.0))
    state = lying((0.0, 0.0, -speed))
    state.q[0, 2] = RADIUS - depth
    for steps in (1, 3):
        end, _, _ = run(scene, state, steps)
        fallen = max(0.0, -depth) if speed else 0.0
        assert np.abs(state.q[0] - end.q[0] - [0, 0, fallen, 0, 0, 0, 0]).max() < 10 * EPS
        assert np.abs(end.u).max() < SPEED / OFFSET


@compiled
def marked(most, closed, contacts):
    """Return the largest gap that is to be closed; see `closing.gaps_to_close`."""
    return gaps_to_close(most, 0.0, closed, contacts)[0]


def test_what_is_no_error_of_a_step_is_not_closed_by_a_move():
    # Loaded contacts close from either side, the others only if they are inside; none that is
    # farther away than a step leaves it.
    contacts = make_contacts(np.zeros((6, 2), dtype=int))
    contacts['solution']['end_gap'][:] = np.array([-1.01, -0.99, 0.99, 1.01, -0.5, 0.5]) * 1e-2
    contacts['solution']['is_loaded'][:] = 1, 1, 1, 1, 0, 0
    to_close = marked(MOST_CLOSED, np.arange(6), contacts)
    assert to_close == pytest.approx(0.99 * MOST_CLOSED)
    assert contacts['newton']['S_N'].tolist() == [0.0, 1.0, 1.0, 0.0, 1.0, 0.0]

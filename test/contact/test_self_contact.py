# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Contacts of links with each other: gaps, directions, impacts, and a robot that curls up."""

from dataclasses import replace
from functools import cache
import math
from pathlib import Path

import numpy as np
from obstacle_scenes import anywhere, check_agreement, each_method, robot_scene
import pytest
from random_states import EPS, rate_of
from scenes import course, isotropic, kinetic_energy, RADIUS

from snake_sim_ros import (
    Friction,
    Gait,
    ParameterError,
    Pegs,
    Robot,
    Scene,
    Simulation,
    Solver,
    State,
    Wave,
)
from snake_sim_ros.dynamics.force_directions import mean_delassus, scene_contacts
from snake_sim_ros.scene import obstacles
from snake_sim_ros.scene.posture import chain_coordinates, initial_coordinates
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.methods import empty_history, make_stepper, METHODS

SLACK = dict.fromkeys(('yaw_stiffness', 'yaw_damping', 'pitch_stiffness', 'pitch_damping'), 0.0)


# Solve contacts by Newton's method, in steps of first and of second order.
by_newton = pytest.mark.parametrize('method', ['newton', 'bdf2'])


def folded():
    """
    Return single steps of soft robots that fold onto themselves: scene, state, angle and rate.

    Robots of 7 to 10 links with 2 or 5 N m/rad whose joints were told to turn by up to 1.5 rad; 2
    to 21 contacts are closed. Up to FRICTIONLESS they have no friction. Each is one in which an
    earlier solver gave up: it solved once for impulses of links on each other, and corrected only
    what these left of the balance of momentum.
    """
    with np.load(Path(__file__).parents[1] / 'data' / 'folded.npz') as file:
        links, settings, numbers = (file[key] for key in ('links', 'settings', 'numbers'))
    steps, start = [], 0
    for n, (along, across, rolling, mu, stiffness, damping, dt) in zip(
        links, settings, strict=True
    ):
        parts = []
        for shape in ((n, 7), (n, 6), (1, n - 1, 2), (1, n - 1, 2)):
            size = int(np.prod(shape))
            parts.append(numbers[start : start + size].reshape(shape))
            start += size
        robot = Robot(
            link_count=int(n), yaw_stiffness=stiffness, pitch_stiffness=stiffness,
            yaw_damping=damping, pitch_damping=damping, joint_limit=math.pi / 2,
        )  # fmt: skip
        scene = Scene(
            robot=robot, self_contact=True, self_contact_friction=mu, level='spatial', dt=dt,
            friction=Friction(longitudinal=along, transversal=across, rolling=rolling),
        )  # fmt: skip
        steps.append((scene, State(*parts[:2]), *parts[2:]))
    return steps


FOLDED, FRICTIONLESS = folded(), 6
each_frictionless = pytest.mark.parametrize('k', range(FRICTIONLESS))


def solved(scene, state, angle, rate, method, history=None, **settings):
    """Return the end of a step, its impulses, and the report, with some settings of the solver."""
    scene = replace(scene, method=method, solver=replace(scene.solver, **settings))
    history = empty_history(scene) if history is None else history
    end, history, report = make_stepper(scene).advance(state, history, angle, rate)
    assert report.steps == 1
    return end, history.impulse, report


def curled(robot, gap=0.0):
    """Return a robot bent in one plane until two links are `gap` apart, flat on the floor."""
    q, angle = _curled(robot, gap)
    return q.copy(), angle.copy()


@cache
def _curled(robot, gap):
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = (low + high) / 2
        angle = np.zeros((robot.link_count - 1, 2))
        angle[:, 0] = middle
        q = chain_coordinates(robot, angle)
        q[:, 2] = RADIUS
        scene = Scene(robot=robot, self_contact=True)
        first = obstacles.first_pair(scene)
        closest = obstacles.contact_geometry(scene, q)[0][first:].min()
        low, high = (middle, high) if closest > gap else (low, middle)
    return q, angle


@pytest.mark.parametrize('seed', range(20))
def test_gaps_and_directions(seed):
    rng = np.random.default_rng(seed)
    scene, state = robot_scene(rng, self_contact=True), anywhere(rng, 5)
    robot, R = scene.robot, rotation_matrices(state.q[:, 3:])
    gap, lever, _ = obstacles.contact_geometry(scene, state.q)
    apart = obstacles.capsule_pairs(scene)
    assert apart == [(0, 2), (0, 3), (0, 4), (1, 3), (1, 4), (2, 4)]
    first, of_pair = obstacles.first_pair(scene), obstacles.OF_PAIR
    grid = np.linspace(-1.0, 1.0, 401)
    for p, (i, j) in enumerate(apart):
        part = slice(first + of_pair * p, first + of_pair * (p + 1))
        one, other = (
            state.q[k, :3] + robot.contact_offset[k] * grid[:, None] * R[k, :, 2] for k in (i, j)
        )
        distance = np.linalg.norm(one[:, None] - other, axis=2)
        radii = robot.contact_radius[i], robot.contact_radius[j]
        # The least gap is that of the capsules. On the grid one is half a cell off on either axis.
        off = (robot.contact_offset[i] + robot.contact_offset[j]) / 400
        assert -off <= gap[part].min() - (distance.min() - sum(radii)) < 8 * EPS
        # Both ends are there, at distances of their own from all of the other axis.
        for end, row in ((0, distance[0]), (1, distance[-1])):
            assert -off <= gap[part][end] - (row.min() - sum(radii)) < 8 * EPS
        # The nearest point of the first is on its surface, and the gap away from the second.
        a = part.start + int(gap[part].argmin())
        if gap[a] > 0.0:
            point = state.q[i, :3] + lever[a]
            inward = [np.linalg.norm(point - each, axis=1).min() for each in (one, other)]
            assert abs(inward[0] - radii[0]) < off
            assert abs(inward[1] - (gap[a] + radii[1])) < off
    # Of the rate of a gap: third derivatives of a distance d > 0.1 m at relative velocities below
    # 5 m/s, 1e-10/6 of 3 v^3/d^2 = 4e4. Velocities of body points: two links, as one in two.
    gamma_N, gamma_T = (W.T @ state.u.ravel() for W in scene_contacts(scene, state.q)[1:3])
    touch = np.flatnonzero(gap[first:] < np.inf)
    rate = rate_of(lambda q: obstacles.contact_geometry(scene, q)[0][first:][touch], state)
    assert np.abs(gamma_N[first:][touch] - rate).max() < 2e-6
    _, lever, frame = obstacles.contact_geometry(scene, state.q)
    v, omega = state.u[:, :3], np.einsum('ijk,ik->ij', R, state.u[:, 3:])
    for a in first + touch:
        i, j = apart[(a - first) // of_pair]
        point = state.q[i, :3] + lever[a]
        ends = [v[k] + np.cross(omega[k], point - state.q[k, :3]) for k in (i, j)]
        slip = frame[a, 1:] @ (ends[0] - ends[1])
        assert np.abs(gamma_T[2 * a : 2 * a + 2] - slip).max() < 1e-13


def test_links_on_each_other_keep_momentum_where_joints_are_open():
    # Forces of two links on each other are opposite, and on one line: their sum and their moment
    # about any point are 0, wherever the links are.
    rng = np.random.default_rng(3)
    scene, state = robot_scene(rng, self_contact=True), anywhere(rng, 5)
    R, first = rotation_matrices(state.q[:, 3:]), obstacles.first_pair(scene)
    W_N, W_T = scene_contacts(scene, state.q)[1:3]
    for W in (W_N[:, first:], W_T[:, 2 * first :]):
        force, moment = np.moveaxis(W.T.reshape(-1, 5, 2, 3), 2, 0)
        about = np.einsum('iab,cib->cia', R, moment) + np.cross(state.q[:, :3], force)
        assert np.abs(force.sum(axis=1)).max() == 0.0
        assert np.abs(about.sum(axis=1)).max() < 8 * EPS


@each_method
def test_step_agrees_with_the_dense_one(method):
    # Robots curled up in the air and on the floor, with a peg beside some of them.
    touched = 0
    for seed in range(3):
        rng = np.random.default_rng(seed)
        robot = Robot(link_count=7)
        q, _ = curled(robot, gap=-1e-3)
        q[:, 2] += -1e-4 if seed % 2 else 0.1
        friction = Friction(longitudinal=0.2, transversal=0.4, rolling=0.05 * (seed % 3))
        scene = Scene(
            robot=robot, self_contact=True, self_contact_friction=0.3, friction=friction,
            pegs=Pegs(x=(q[3, 0],), y=(q[3, 1] - RADIUS - 0.02,), radius=0.02),
        )  # fmt: skip
        state = State(q, rng.uniform(-0.1, 0.1, (7, 6)))
        touched += check_agreement(scene, state, rng, method)
    assert touched > 6


@pytest.mark.parametrize('method', [name for name in METHODS if name != 'bdf2'])
def test_step_with_open_joints_agrees_with_the_dense_one(method):
    # Joints open by a centimeter, as in the middle of a step that turns links by half a radian.
    # `bdf2` has no such joints: its coordinates are their angles.
    scene = Scene(
        robot=Robot(link_count=7), self_contact=True, self_contact_friction=0.3,
        gravity=(0.0, 0.0, 0.0),
    )  # fmt: skip
    for seed in range(3):
        rng = np.random.default_rng(seed)
        q, _ = curled(scene.robot, gap=-2e-2)
        q[:, 2] += 0.1
        q[:, :3] += rng.uniform(-1e-2, 1e-2, (7, 3))
        u = rng.uniform(-0.1, 0.1, (7, 6))
        u[:, :3] -= q[:, :3] - q[:, :3].mean(axis=0)  # the ends close in on each other
        assert check_agreement(scene, State(q, u), rng, method) > 0


def crossed(rng):
    """Return a robot in the air two links of which touch where their axes cross."""
    scene = Scene(robot=Robot(link_count=7, contact_radius=1e-3), self_contact=True)
    first, crossing = obstacles.first_pair(scene), obstacles.OF_PAIR - 1
    while True:
        q = chain_coordinates(scene.robot, rng.uniform(-1.5, 1.5, (6, 2)))
        gap = obstacles.contact_geometry(scene, q)[0][first:]
        if gap.argmin() % obstacles.OF_PAIR == crossing and 0.02 < gap.min() < 0.1:
            q[:, 2] += 1.0
            return Robot(link_count=7, contact_radius=1e-3 + gap.min() / 2 + 1e-8), q


@each_method
def test_links_touch_between_their_ends(method):
    # The step is that of the dense method. At first the only contact is where their axes cross.
    for seed in range(3):
        rng = np.random.default_rng(seed)
        robot, q = crossed(rng)
        scene = Scene(
            robot=robot, self_contact=True, self_contact_friction=0.3, gravity=(0.0, 0.0, 0.0),
            level='spatial',
        )  # fmt: skip
        gap, _, frame = obstacles.contact_geometry(scene, q)
        (a,) = np.flatnonzero(gap < 0.0)
        i, j = obstacles.contact_links(scene)[a]
        R = rotation_matrices(q[:, 3:])
        assert np.abs(R[[i, j], :, 2] @ frame[a, 0]).max() < 1e-12  # at right angles to both
        u = rng.uniform(-0.1, 0.1, (7, 6))
        u[:, :3] -= np.outer(np.arange(7) == i, frame[a, 0])  # they close in on each other
        assert check_agreement(scene, State(q, u), rng, method) >= 1


def test_links_side_by_side_touch_at_both_ends():
    axes, half = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]]), np.array([0.04, 0.04])
    apart = np.array([0.1, 0.0, 0.03])
    # The front end of the one is beyond the other, whose front end is beside it; so for the rears.
    places = [(-0.04, -0.01), (0.04, 0.04), None, (0.01, 0.04), None]
    found = obstacles.nearest_on_axes(apart, axes, half)
    assert [place is None for place in found] == [place is None for place in places]
    assert np.allclose([p for p in found if p], [p for p in places if p], rtol=0.0, atol=1e-15)
    # A sphere has one end and no interior.
    found = obstacles.nearest_on_axes(apart, axes, np.array([0.04, 0.0]))
    assert [place is None for place in found] == [False, False, False, True, True]
    assert obstacles.nearest_on_axes(apart, axes, np.zeros(2))[1:] == [None] * 4


@each_method
def test_ends_of_a_robot_hit_each_other(method):
    # A slack robot in free space whose ends close in on each other: their relative velocity along
    # the normal is 0 after the impact, momentum is kept, energy is lost, nobody else is touched.
    robot = Robot(link_count=7, **SLACK)
    # Of the first step of `bdf2` history has the second part only: the ends are apart at first.
    q, _ = curled(robot, gap=1e-3 if method == 'bdf2' else 0.0)
    scene = Scene(
        robot=robot, self_contact=True, self_contact_friction=0.5, friction=isotropic(0.0),
        gravity=(0.0, 0.0, 0.0), method=method, dt=1 / 1000,
    )  # fmt: skip
    scene = replace(scene, solver=replace(scene.solver, tolerance=1e-11, iteration_limit=20000))
    u = np.zeros((7, 6))
    # Bending at a rate: every link turns at k times it about the vertical, joints stay closed.
    rate, half = 0.3, robot.per_link('link_length') / 2
    R = rotation_matrices(q[:, 3:])
    for i in range(7):
        u[i, 4] = rate * i
        if i > 0:
            u[i, :2] = u[i - 1, :2]
            for k in (i - 1, i):
                u[i, :2] += half[k] * u[k, 4] * np.array([-R[k, 1, 2], R[k, 0, 2]])
    states, impulses, report = course(scene, State(q, u), 40)
    first = obstacles.first_pair(scene)
    assert impulses[:, first:, 0].max() > 1e-3
    assert impulses[:, :first].max() < 1e-9  # the floor is there, but nothing weighs on it
    mass = robot.per_link('link_mass')
    momentum = np.einsum('i,tij->tj', mass, states.u[:, :, :3])
    assert np.abs(momentum - momentum[0]).max() < 1e-8
    energy = kinetic_energy(robot, states.u)
    assert np.diff(energy).max() < 1e-7 * energy[0]
    assert energy[-1] < 0.999 * energy[0]
    assert report.unconverged == 0
    # Up to the step of the impact the links get v dt closer, less than 1 mm.
    assert report.penetration_max < 2.0 * scene.dt


@pytest.mark.parametrize(('k', 'limit'), [(6, 200), (7, 200), (8, 2000)])
@by_newton
def test_a_folded_robot_with_friction_converges(k, limit, method):
    # In the last one, with friction of 1 and 2, most starts lead round and round.
    _, _, report = solved(*FOLDED[k], method, iteration_limit=limit)
    assert report.unconverged == 0
    # Of those that are near, `bdf2` counts which push or are inside.
    assert report.contacts >= (2 if method == 'bdf2' else 4)


@each_frictionless
@by_newton
def test_a_folded_robot_without_friction_converges_to_rounding(k, method):
    # Contact velocities sum over a dozen products of up to 13 rad/s and 1 m: 3e-13 m/s of
    # rounding. The problem is convex and piecewise linear: Newton's method ends in it, and its
    # linear problems are solved to rounding, so that no tolerance above it is out of reach.
    # A step of `bdf2` from rest is four: 50 iterations each are more than any needs, with contacts
    # that are near among them, and with a round of held radii.
    parts = 4 if method == 'bdf2' else 1
    _, _, report = solved(*FOLDED[k], method, residual_tolerance=1e-12, iteration_limit=100)
    assert report.unconverged == 0
    assert report.residual_max <= 1e-12
    assert report.iterations <= 50 * parts
    assert report.contacts >= 2


@each_frictionless
def test_a_folded_robot_is_solved_for_from_anywhere(k):
    # The slope of a convex function along a line leads to its minimum from any start.
    scene, state, angle, rate = FOLDED[k]
    rng = np.random.default_rng(k)
    history = empty_history(scene)
    shape = history.impulse.shape
    history.impulse[:], history.velocity[:] = rng.uniform(0.0, 1.0, shape), rng.normal(size=shape)
    _, _, report = solved(scene, state, angle, rate, 'newton', history, iteration_limit=60)
    assert report.unconverged == 0


@each_frictionless
@by_newton
def test_energy_of_a_slack_folded_robot_falls_by_that_of_the_jump(k, method):
    # Without friction, gravity and torque the velocity after an impact is the projection of that
    # before it on what joints and contacts admit: the energy lost is that of the jump u_E - u_0,
    # and -P gamma = c P^2 besides. In a step of a nanosecond all else changes by a share of
    # dt |omega|: geometry, gyroscopic and centripetal forces, the steps that `bdf2` makes of one.
    scene, state, angle, rate = FOLDED[k]
    robot = replace(scene.robot, **SLACK)
    state = State(state.q, np.random.default_rng(k).uniform(-1.0, 1.0, state.u.shape))
    scene = replace(scene, robot=robot, gravity=(0.0, 0.0, 0.0), dt=1e-9)
    end, P, report = solved(
        scene, state, 0.0 * angle, 0.0 * rate, method, residual_tolerance=1e-12,
        iteration_limit=30,
    )  # fmt: skip
    assert report.unconverged == 0
    before, after = kinetic_energy(robot, state.u), kinetic_energy(robot, end.u)
    jump = kinetic_energy(robot, end.u - state.u)
    speed = max(np.linalg.norm(u[:, 3:], axis=1).max() for u in (state.u, end.u))
    slack = 10 * scene.dt * speed * before
    pressed = scene.solver.normal_compliance * mean_delassus(robot) * (P[:, 0] ** 2).sum()
    assert jump > 0.2 * before
    # The later parts of a step of `bdf2` take back the -c P by which the rule pressed in the first
    # one: in place of c P^2 the energy lost is less than that of the jump by as much.
    taken_back = 0.0
    if method == 'bdf2':
        _, P, _ = solved(scene, state, 0.0 * angle, 0.0 * rate, 'newton', residual_tolerance=1e-12)
        taken_back = scene.solver.normal_compliance * mean_delassus(robot) * (P[:, 0] ** 2).sum()
    assert -taken_back - slack <= before - after - jump <= pressed + slack


@each_method
def test_a_robot_that_folds_stops_at_itself(method):
    # Joints told to turn by 130 degrees would put the outer links of three through each other:
    # they stop where they touch, at 110 to 115 degrees.
    robot, dt = Robot(link_count=3), 1 / 100
    scene = Scene(
        robot=robot, self_contact=True, friction=isotropic(0.0), gravity=(0.0, 0.0, 0.0),
        method=method, dt=dt, level='spatial', solver=Solver(iteration_limit=2000),
    )  # fmt: skip
    ends = {}
    for contact in (False, True):
        simulation = Simulation(replace(scene, self_contact=contact))
        times = simulation.midpoints(round(0.8 / dt))
        angle, rate = np.zeros((2, len(times), 2, 2))
        angle[:, :, 0] = np.minimum(times / 0.6, 1.0)[:, None] * math.radians(130)
        rate[:, :, 0] = np.where(times < 0.6, math.radians(130) / 0.6, 0.0)[:, None]
        report = simulation.advance(angle, rate)
        assert not report.failure
        gap, _, _ = obstacles.contact_geometry(scene, simulation.state.q)
        ends[contact] = gap[obstacles.first_pair(scene) :].min(), report
    assert ends[False][0] < -0.02
    # A step late at the relative velocity of the ends, 2 * 0.1 m * 3.8 rad/s.
    assert ends[True][0] > -0.8 * dt
    assert ends[True][1].unconverged == 0


def test_links_that_overlap_at_the_start_are_refused():
    def bent(angle):
        gait = Gait(yaw=Wave(offset=angle))
        return Scene(robot=Robot(link_count=9), self_contact=True, gait=gait)

    with pytest.raises(ParameterError) as caught:
        initial_coordinates(bent(math.radians(44)))
    assert str(caught.value).startswith('links must be apart at the start: link 1 is ')
    assert str(caught.value).endswith(' m inside link 9')
    initial_coordinates(bent(math.radians(20)))
    initial_coordinates(replace(bent(math.radians(44)), self_contact=False))


@each_method
def test_a_folded_robot_of_unequal_links_knows_how_deep_it_is(method):
    # Link 1 along x, link 2 at 90 degrees to it, link 3 at 150: the rear sphere of link 3 is
    # beside the axis of link 1. At rest nothing changes.
    length, offset, radius = (0.12, 0.05, 0.10), (0.05, 0.01, 0.02), (0.035, 0.01, 0.040)
    robot = Robot(
        link_count=3, link_length=length, contact_offset=offset, contact_radius=radius,
        joint_limit=math.pi / 2, **SLACK,
    )  # fmt: skip
    angle = np.array([[[math.pi / 2, 0.0], [math.pi / 3, 0.0]]])
    q = chain_coordinates(robot, angle[0])
    q[:, 2] += 1.0
    scene = Scene(
        robot=robot, self_contact=True, gravity=(0.0, 0.0, 0.0), method=method, level='spatial'
    )
    start = State(q, np.zeros((3, 6))), empty_history(scene)
    _, _, report = make_stepper(scene).advance(*start, angle, np.zeros(angle.shape))
    arm = length[2] / 2 - offset[2]  # from the joint to the rear sphere of link 3
    assert 0.0 < offset[0] - length[0] / 2 - arm * math.cos(math.radians(150)) < 2 * offset[0]
    depth = radius[0] + radius[2] - length[1] - arm * math.sin(math.radians(150))
    assert report.penetration_max == pytest.approx(depth, abs=1e-12)


def test_a_pair_does_nothing_until_it_closes():
    # The same steps with and without self-contact while the links are apart: the same numbers up
    # to rounding, though contacts with frames round differently; 1e-9 m/s of the residual.
    robot = Robot(link_count=7)
    q, angle = curled(robot, gap=0.01)
    scene, ends = Scene(robot=robot, friction=isotropic(0.2), level='spatial'), []
    references = np.tile(angle, (20, 1, 1)), np.zeros((20, 6, 2))
    for case in (scene, replace(scene, self_contact=True)):
        start = State(q, np.zeros((7, 6))), empty_history(case)
        ends.append(make_stepper(case).advance(*start, *references)[0])
    assert np.abs(ends[0].u - ends[1].u).max() < 1e-8

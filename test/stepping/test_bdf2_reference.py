# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The compiled step of `bdf2` against the dense one of `oracle.bdf2`."""

from dataclasses import replace

import numpy as np
from obstacle_scenes import random_ground, random_patches
from oracle import bdf2 as dense_bdf2, contact_laws
import pytest
from random_states import random_robot

from snake_sim_ros import Friction, Pegs, Scene, Solver, State
from snake_sim_ros.scene import obstacles
from snake_sim_ros.scene.posture import chain_coordinates, joint_angles
from snake_sim_ros.scene.rotations import about, FLAT, product, rotation_matrices
from snake_sim_ros.stepping.bdf2.formula import AFTER_EVENT, ANEW, AT_START, SMOOTH, TICKS, UNKNOWN
from snake_sim_ros.stepping.bdf2.motion import Bdf2Memory, make_memory, Motion
from snake_sim_ros.stepping.methods import empty_history, make_stepper

pytestmark = pytest.mark.fast

FRICTIONS = {
    'isotropic': Friction(longitudinal=0.2, transversal=0.2),
    'orthotropic': Friction(longitudinal=0.1, transversal=0.5),
    'rolling': Friction(longitudinal=0.3, transversal=0.4, rolling=0.05),
    'across only': Friction(longitudinal=0.0, transversal=0.4),
}
RESIDUAL = 1e-14  # m/s
# Impulses that hold a joint are stiffness times rounding of rates: 1e7 N m s^2 times 1e-14 rad/s,
# here of links of 1e-3 kg m^2.
HELD_AGREEMENT = 1e-6
# Velocities up to 10 m/s and rad/s are rounded in dense systems with a condition of up to 1e3.
FASTEST = 10.0
AGREEMENT = 1e3 * FASTEST * np.finfo(float).eps
INSIDE = 1e-2  # m
LINKS, SPEEDS, LIFTS = (1, 2, 5, 11), (0.05, 0.2, 0.5), (0.0, 1e-4, 1e-3)  # m/s, m


def random_scene(rng, links, friction, dt, **settings):
    """Return a scene with a robot whose links differ; `robot` makes another kind of robot."""
    make = settings.pop('robot', random_robot)
    solver = Solver(iteration_limit=200, residual_tolerance=RESIDUAL)
    return Scene(
        robot=make(rng, links), friction=friction, solver=solver, dt=dt, method='bdf2',
        level='spatial', **settings,
    )  # fmt: skip


def lying(rng, scene, bend):
    """Return coordinates of a robot with yaw between `bend` that touches the ground."""
    robot, joints = scene.robot, scene.robot.link_count - 1
    angle = np.column_stack([rng.uniform(*bend, joints), rng.uniform(-0.003, 0.003, joints)])
    q = chain_coordinates(robot, angle * robot.chain.places.present)
    first = product(
        about(2, rng.uniform(-3, 3)), product(about(1, rng.uniform(-0.003, 0.003)), FLAT)
    )
    turn = product(first, q[0, 3:] * [1, -1, -1, -1])
    q = np.hstack([q[:, :3] @ rotation_matrices(turn).T, product(turn, q[:, 3:])])
    q[:, :2] -= q[:, :2].mean(axis=0)
    q[:, 2] += obstacles.lift_onto_ground(scene, q)
    return q


def motion(rng, robot, q, speed):
    """Return a motion of a robot at q that its joints allow, with random velocities."""
    n = robot.link_count
    rest = dense_bdf2.motion_of(robot, State(q, np.zeros((n, 6))))
    u = np.tile(rng.uniform(-1.0, 1.0, 6) * speed, (n, 1))
    rate = rng.uniform(-3.0, 3.0, (n - 1, 2)) * [speed, 0.3 * speed] * robot.chain.places.present
    R = rotation_matrices(q[:, 3:])
    u = dense_bdf2.chain_velocities(robot, R, rest._replace(rate=rate, u=u))
    return rest._replace(rate=rate, u=u)


def one_before(rng, robot, now, dt):
    """Return a motion that leads to another one in a time dt, with changing velocities."""

    def change(x):
        return x + dt * rng.uniform(-5.0, 5.0, x.shape)

    pose, present = (
        dense_bdf2.moved(robot, now.pose, -dt, now.pose, now.u),
        robot.chain.places.present,
    )
    return Motion(pose, now.angle - dt * now.rate, present * change(now.rate), change(now.u))


def memory_of(robot, q, now, before, dt, phase):
    """Return a memory of a part of length dt that led to q (n, 7)."""
    return Bdf2Memory(
        end=now, start=before, q=q, reference_rate=np.zeros((robot.link_count - 1, 2)),
        dt=np.array([dt]), span=np.array([dt]), phase=np.array([phase]),
        ticks=np.array([float(TICKS)]), depth=np.zeros(1),
    )  # fmt: skip


def random_case(
    seed,
    links,
    friction,
    phase,
    ratio,
    speed=0.3,
    lift=0.0,
    dt=1 / 100,
    bend=(-0.5, 0.5),
    **settings,
):
    """Return scene, state, history and references of a random step."""
    rng = np.random.default_rng(seed)
    scene = random_scene(rng, links, friction, dt, **settings)
    q = lying(rng, scene, bend)
    q[:, 2] += lift - rng.uniform(0.0, 1e-6)
    now = motion(rng, scene.robot, q, speed)
    memory, before = make_memory(links), one_before(rng, scene.robot, now, dt / ratio)
    history = empty_history(scene)
    if phase != UNKNOWN:
        memory = memory_of(scene.robot, q, now, before, dt / ratio, phase)
        count = len(history.impulse)
        if lift == 0.0:
            history.impulse[:, 0] = rng.uniform(0.0, 1e-1, count) * rng.integers(0, 2, count)
    state = State(q, now.u if phase != UNKNOWN else now.u + rng.uniform(-0.1, 0.1, now.u.shape))
    angle = joint_angles(q, scene.robot) + rng.uniform(-0.05, 0.05, now.rate.shape)
    return scene, state, history._replace(memory=memory), angle, rng.uniform(-1, 1, now.rate.shape)


def first_part(memory):
    """Return how many times shorter than the step its first part is."""
    if memory.phase[0] == SMOOTH:
        return 1
    return AFTER_EVENT if memory.span[0] > 0.0 else AT_START


def both(case):
    """Return end and history of the compiled step, its report, and the parts of the dense one."""
    scene, state, history, angle, rate = case
    stepper = make_stepper(scene)
    end, after, report = stepper.advance(state, history, angle[None], rate[None])
    assert not report.failure
    return (
        end,
        after,
        report,
        dense_bdf2.step(*case, first_part(history.memory)),
    )


def assert_agreement(end, after, parts, agreement=AGREEMENT):
    """
    Assert that the compiled step ended where the dense parts did.

    In the next part an error of a gap is one of a velocity that closes it in h, here some ms, so
    that each part passes on up to ten times its error.
    """
    part, bound = parts[-1], agreement * 10.0 ** (len(parts) - 1)
    assert np.abs(end.q - part.state.q).max() < bound
    assert np.abs(end.u - part.state.u).max() < bound * FASTEST
    for name, size in (('pose', 1.0), ('angle', 1.0), ('rate', 2 * FASTEST), ('u', FASTEST)):
        ours, theirs = getattr(after.memory.end, name), getattr(part.motion, name)
        assert np.abs(ours - theirs).max(initial=0.0) < bound * size, name
    assert after.memory.span[0] == pytest.approx(part.h, rel=1e-15)
    assert after.memory.phase[0] == (ANEW if part.jumps else SMOOTH)


def check_cases(seeds, phase, ratio, links=LINKS):
    """
    Compare random steps; return how many landed, jumped, and how many contacts pushed in all.

    The solver of the compiled step stops short of RESIDUAL where laws are nearly degenerate. Such
    steps are not compared, and are few.
    """
    landed = jumped = pushed = left = 0
    for seed in seeds:
        case = random_case(
            [seed, int(2 * phase)], links[seed // 4 % len(links)],
            FRICTIONS[[*FRICTIONS][seed % 4]], phase, ratio,
            speed=SPEEDS[seed % 3], lift=LIFTS[seed % 3],
        )  # fmt: skip
        end, after, report, parts = both(case)
        if report.unconverged:
            left += 1
            continue
        assert_agreement(end, after, parts)
        landed += any(part.lands for part in parts)
        jumped += any(part.jumps for part in parts)
        pushed += int((parts[-1].impulse[:, 0] > 0.0).sum())
    assert left <= len(seeds) / 10
    return landed, jumped, pushed


@pytest.mark.parametrize(
    ('phase', 'ratio'),
    [(SMOOTH, 0.5), (SMOOTH, 1.0), (SMOOTH, 2.0), (ANEW, 1.0), (UNKNOWN, 1.0)],
)
def test_the_compiled_step_is_the_dense_one(phase, ratio):
    # Not seed 0: both contacts of its only link stick, which has solutions that differ by 2e-9.
    landed, jumped, pushed = check_cases(range(1, 25), phase, ratio)
    # The test has seen what it is about.
    assert 2 < landed < 22
    assert landed <= jumped < 22
    assert pushed >= 12


@pytest.mark.parametrize('ratio', [0.5, 1.0, 2.0])
def test_it_is_in_free_flight(ratio):
    for phase in (SMOOTH, ANEW):
        for links in (1, 2, 5, 11):
            case = random_case(
                [links, 7], links, Friction(), phase, ratio, speed=1.0, lift=5.0, dt=1 / 40
            )
            end, after, _, parts = both(case)
            assert_agreement(end, after, parts)
            assert not parts[-1].jumps


def with_laws_of_joints(seed, scene, state):
    """Return a scene with random torque limits, friction and stops, near the angles of a state."""
    rng = np.random.default_rng([seed, 9])
    robot = replace(
        scene.robot,
        yaw_torque_limit=rng.choice([0.05, 0.5, 5.0]),
        pitch_torque_limit=rng.choice([0.5, 5.0, 50.0]),
        joint_friction=rng.choice([0.0, 0.05, 0.5]),
        joint_viscous_friction=rng.choice([0.0, 0.01]),
        joint_limit=max(0.02, float(np.abs(joint_angles(state.q)).max()) - 0.01),
        joint_stop=bool(rng.integers(2)),
    )
    return replace(scene, robot=robot)


@pytest.mark.parametrize('lift', [0.0, 5.0])
def test_it_is_with_laws_of_the_joints(lift):
    seen = np.zeros(3, int)
    for seed in range(36):
        phase = (SMOOTH, ANEW)[seed % 2]
        case = random_case([seed, 8], (2, 5)[seed // 2 % 2], Friction(), phase, 1.0, lift=lift)
        scene = with_laws_of_joints(seed, *case[:2])
        end, after, report, parts = both((scene, *case[1:]))
        if report.unconverged or not all(part.settled for part in parts):
            continue
        assert_agreement(end, after, parts, HELD_AGREEMENT)
        robot = scene.robot
        limits = robot.per_joint('torque_limit')
        seen += (
            bool((np.abs(report.joint_torque) >= limits * (1 - 1e-12)).any()),
            bool((np.abs(after.memory.end.rate) < 1e-11).any()),
            robot.joint_stop and any(part.lands for part in parts),
        )
    # The test has seen joints at their limits, joints that friction holds, and stops.
    assert seen.min() >= 3


def beside_links(rng, scene, q, count):
    """Return where pegs of radius 0.02 m stand, x and y, that touch some links."""
    i = rng.integers(len(q), size=count)
    apart = 0.02 + scene.robot.per_link('contact_radius')[i] - rng.uniform(0.0, 1e-6, count)
    across = rotation_matrices(q[i, 3:])[:, :2, 2] @ [[0.0, 1.0], [-1.0, 0.0]]
    return (q[i, :2] + (apart / np.hypot(*across.T))[:, None] * across).T


SIDES_AND_VISCOUS = replace(
    FRICTIONS['rolling'], backward=0.4, viscous_longitudinal=1.0, viscous_transversal=3.0
)
# So little that impacts have one solution.
FALLING = replace(SIDES_AND_VISCOUS, rolling=0.0, kinetic_ratio=0.9, stribeck_speed=0.5)


def among_obstacles(seed, links, friction=SIDES_AND_VISCOUS):
    """Return a random step among pegs, cells and links, or None if one is inside of another."""
    rng, patches = np.random.default_rng([seed, 3]), np.random.default_rng([seed, 8])
    pegs = Pegs(x=(9.0, 9.1), y=(9.0, 9.0), radius=0.02, friction=0.3)
    scene, state, *others = random_case(
        [seed, 4], links, friction, SMOOTH, 1.0, bend=(0.9, 1.3), pegs=pegs,
        ground=random_ground(rng, 0.03), patches=random_patches(patches), self_contact=True,
    )  # fmt: skip
    x, y = beside_links(rng, scene, state.q, 2)
    scene = replace(scene, pegs=replace(pegs, x=tuple(x), y=tuple(y)))
    if obstacles.contact_geometry(scene, state.q)[0].min() < -INSIDE:
        return None
    return scene, state, *others


def check_among_obstacles(cases):
    """Compare such steps, and check that contacts of every kind carried load in one of them."""
    kinds = set()
    for case in cases:
        if case is None:
            continue
        end, after, report, parts = both(case)
        if report.unconverged:
            continue
        assert_agreement(end, after, parts)
        for a in np.flatnonzero(parts[-1].impulse[:, 0]):
            kinds.add(obstacles.contact_keys(case[0])[a][0])
    assert kinds == {'floor', 'cell', 'peg', 'pair'}


@pytest.mark.parametrize('friction', [SIDES_AND_VISCOUS, FALLING], ids=['sides', 'falling'])
def test_it_is_among_pegs_cells_and_links(friction):
    # In the last one the first link of five meets the last.
    seeds = [*range(45), 83]
    check_among_obstacles(among_obstacles(seed, (3, 5)[seed % 2], friction) for seed in seeds)


def test_a_given_state_is_recognized():
    # With velocities that the joints allow, and with others.
    for phase in (SMOOTH, UNKNOWN):
        scene, state, _, _, _ = random_case([1], 5, Friction(), phase, 1.0)
        memory = dense_bdf2.recognized(scene.robot, state, make_memory(5))
        assert memory.phase[0] == (ANEW if phase == SMOOTH else UNKNOWN)
        assert np.abs(memory.end.angle - joint_angles(state.q)).max() == 0.0


def test_coordinates_of_the_joints_are_those_of_the_links():
    scene, state, _, _, _ = random_case([2], 6, Friction(), SMOOTH, 1.0)
    now = dense_bdf2.motion_of(scene.robot, state)
    q = dense_bdf2.coordinates(scene.robot, now.pose, now.angle)
    assert np.abs(q - state.q).max() < 1e-15 * 20  # 6 rotations and lengths of up to 1 m
    u = dense_bdf2.chain_velocities(scene.robot, rotation_matrices(q[:, 3:]), now)
    assert np.abs(u - state.u).max() < 1e-14


def test_the_slope_of_the_projection_is_its_derivative():
    rng, step = np.random.default_rng(5), 1e-6
    for share in (contact_laws.WHOLE, np.array([0.6, 1.0]), np.array([1.0, 0.3]), np.zeros(2)):
        for _ in range(200):
            x = rng.uniform(-1.0, 1.0, 5)
            slope = contact_laws.prox_slope(x, share)
            ends = [
                [contact_laws.prox(x + d * e, share) for d in (step, -step)] for e in np.eye(5)
            ]
            columns = [(after - before) / (2 * step) for after, before in ends]
            # Central differences: step^2 and rounding over the step, but for kinks within it.
            assert np.abs(np.column_stack(columns) - slope).max() < 1e-8

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A step knows no directions but those of gravity and friction, and its loads are those of the laws.

Robots that are turned, mirrored or shifted take the same step, with every method and on both
levels, and so does one among pegs that are listed in another order. Tolerances of the solvers do
not show in the loads.
"""

from dataclasses import replace

from flat_states import crooked, flat_robot
import numpy as np
import pytest
from scenes import first_steps, NEWTON

from snake_sim_ros import Friction, Pegs, Robot, Scene, Solver, State
from snake_sim_ros.scene.posture import joint_angles
from snake_sim_ros.scene.rotations import about, product, rotation_matrices
from snake_sim_ros.stepping.methods import METHODS
from snake_sim_ros.stepping.state import initial_state

pytestmark = pytest.mark.long

LINKS = 6
FRICTION = {
    'isotropic': Friction(longitudinal=0.4, transversal=0.4),
    'orthotropic': Friction(longitudinal=0.1, transversal=0.5),
    'backward': Friction(longitudinal=0.2, transversal=0.4, backward=0.3),
    'rolling': Friction(longitudinal=0.2, transversal=0.4, backward=0.3, rolling=0.05),
}
FLAT = [name for name in FRICTION if name != 'rolling']  # on the planar level nothing rolls
# A turn rounds velocities of 1 m/s by 1e-16, and the 12 loads of the floor by that over the
# compliance that shares them: a normal velocity of 1e-4 G P_N is 4e-7 m/s, so that 3e-10 of a load
# follow from one rounding. Velocities answer to loads by friction alone.
SAME = 1e-9
# On the planar level loads are those of a chain that the floor holds. It is 1e10 times less stiff
# against the rolling of the robot than against its weight (`equilibrium.ROOT_HOLD`), of which a
# bent robot feels the part that its own shape does not hold.
SAME_IN_PLANE = 2e-8
LOADS = 1e-6  # what default tolerances may leave of normal impulses, relative to the step
# Methods that stop at a residual, at which they leave loads accurate.
ACCURATE = [*NEWTON, 'bdf2']
cases = pytest.mark.parametrize(
    ('method', 'level', 'friction'),
    [
        *((method, 'spatial', name) for method in METHODS for name in FRICTION),
        *((method, 'planar', name) for method in METHODS for name in FLAT),
    ],
)


def case(seed, level, **settings):
    """Return a scene of six different links, and a state in which it slides and turns."""
    rng = np.random.default_rng(seed)
    robot = flat_robot(rng, LINKS)
    return Scene(robot=robot, level=level, **settings), crooked(rng, robot)


def loaded_case(method, level, friction, **settings):
    """Return the first case in which the robot stays flat on all of its contacts."""
    for seed in range(30):
        scene, state = case(seed, level, method=method, friction=FRICTION[friction], **settings)
        _, loads, report = step(scene, state)
        if not report.failure and (loads[: 2 * LINKS, 0] > 0.0).sum() > LINKS:
            return scene, state
    raise AssertionError('no robot stays on the floor')


def step(scene, state):
    """Return velocities, impulses and report of one step in which joints hold their angles."""
    angle = joint_angles(state.q)
    end, history, report = first_steps(scene, state, angle[None], np.zeros_like(angle)[None])
    return end.u, history.impulse.copy(), report


def turned(state, angle):
    """Return a state turned about the vertical [rad]."""
    turn = about(2, angle)
    R = rotation_matrices(turn)
    q, u = state.q.copy(), state.u.copy()
    q[:, :3], q[:, 3:] = q[:, :3] @ R.T, product(turn, q[:, 3:])
    u[:, :3] = u[:, :3] @ R.T
    return State(q, u)


def mirrored(state):
    """Return a flat state mirrored left and right, at the plane y = 0 of I."""
    q, u = state.q.copy(), state.u.copy()
    q[:, 1] *= -1.0
    q[:, 3:] = mirrored_rotations(q[:, 3:])
    u[:, 1] *= -1.0
    u[:, 3:] *= [1.0, -1.0, -1.0]  # e_x of a flat link is across, and mirrored, too
    return State(q, u)


def mirrored_rotations(p):
    """Return the Euler parameters of flat links mirrored at y = 0: headings change their signs."""
    e_z = rotation_matrices(p)[:, :, 2]
    heading = np.arctan2(e_z[:, 1], e_z[:, 0])
    turns = [about(2, -2.0 * angle) for angle in heading]
    back = np.array([product(*each) for each in zip(turns, p, strict=True)])
    assert np.abs(rotation_matrices(back)[:, 1, 2] + e_z[:, 1]).max() < 1e-12
    return back


def assert_same(one, other, bound):
    """Compare velocities and the impulses of normal and sliding contacts, relative to the step."""
    (u, P, _), (other_u, other_P, _) = one, other
    assert np.abs(other_u - u).max() <= bound * np.abs(u).max()
    assert np.abs(other_P - P)[:, :3].max() <= bound * np.abs(P).max()


def bound_of(level):
    return SAME if level == 'spatial' else SAME_IN_PLANE


@cases
def test_a_turned_robot(method, level, friction):
    scene, state = loaded_case(method, level, friction)
    angle = np.radians(37)
    u, P, report = step(scene, turned(state, angle))
    back = turned(State(state.q, u), -angle).u
    assert_same(step(scene, state), (back, P, report), bound_of(level))


@cases
def test_a_mirrored_robot(method, level, friction):
    scene, state = loaded_case(method, level, friction)
    u, P, report = step(scene, mirrored(state))
    u[:, 1] *= -1.0
    u[:, 3:] *= [1.0, -1.0, -1.0]
    P[:, 2] *= -1.0
    assert_same(step(scene, state), (u, P, report), bound_of(level))


@cases
def test_a_shifted_robot(method, level, friction):
    scene, state = loaded_case(method, level, friction)
    q = state.q.copy()
    q[:, :2] += 3.0, -5.0  # rounds places to 1e-15 m
    assert_same(step(scene, state), step(scene, State(q, state.u)), 10 * bound_of(level))


@pytest.mark.parametrize('method', METHODS)
def test_a_turned_slope(method):
    scene, state = case(0, 'spatial', method=method, friction=FRICTION['rolling'])
    scene = replace(scene, gravity=(0.5, 0.3, -9.7))
    R = rotation_matrices(about(2, np.radians(37)))
    other = replace(scene, gravity=tuple(R @ scene.gravity))
    u, P, report = step(other, turned(state, np.radians(37)))
    back = turned(State(state.q, u), -np.radians(37)).u
    assert_same(step(scene, state), (back, P, report), SAME)


@pytest.mark.parametrize('method', METHODS)
def test_the_order_of_pegs(method):
    # One robot pressed into a groove of three pegs, of which two touch it.
    scene, state = wedge(method, 0.5)
    pegs, last = scene.pegs, 2  # contacts with the floor are first
    order = [2, 0, 1]
    permuted = replace(pegs, x=tuple(pegs.x[k] for k in order), y=tuple(pegs.y[k] for k in order))
    u, P, report = step(replace(scene, pegs=permuted), state)
    P[[last + place for place in order]] = P[last:]
    expected = step(scene, state)
    assert (expected[1][:, 0] > 0.0).sum() == 4
    assert_same(expected, (u, P, report), SAME)


# ---- loads --------------------------------------------------------------------------------------


def wedge(method, mu, **settings):
    """
    Return a link that gravity pulls along its axis between two pegs, and a third one beside them.

    The normals of the pegs are 60 degrees beside the pull. With a friction of 0.5 the floor and
    both pegs hold it in many ways.
    """
    angle, reach, slope = np.radians(60), 0.0525 + 0.05 - 1e-9, -9.81
    robot = Robot(link_count=1)
    state = turned(initial_state(Scene(robot=robot)), -np.pi / 2)
    x, y = state.q[0, :2]
    way = reach * np.sin(angle)
    pegs = Pegs(
        x=(x - way, x + way, x + 0.5),
        y=(y - robot.contact_offset - reach * np.cos(angle),) * 2 + (y,),
        radius=0.05,
        friction=mu,
    )
    scene = Scene(
        robot=robot, pegs=pegs, method=method, gravity=(0.0, slope, -9.81), level='spatial',
        friction=Friction(longitudinal=0.0, transversal=0.0), **settings,
    )  # fmt: skip
    return scene, state


@pytest.mark.parametrize('method', ACCURATE)
@pytest.mark.parametrize('mu', [0.1, 0.5])
def test_loads_of_a_wedge_are_those_of_newton(method, mu):
    exact = 'bdf2' if method == 'bdf2' else 'newton'  # bdf2 divides its first step
    _, expected, tight = step(*wedge(exact, mu, solver=Solver(residual_tolerance=1e-13)))
    _, P, report = step(*wedge(method, mu))
    assert report.unconverged == tight.unconverged == 0
    assert np.abs(P - expected)[:, 0].max() <= LOADS * expected.max()


@pytest.mark.parametrize('method', ACCURATE)
@pytest.mark.parametrize('friction', FRICTION)
def test_loads_do_not_depend_on_the_tolerance(method, friction):
    for seed in range(10):
        scene, state = case(seed, 'spatial', method=method, friction=FRICTION[friction])
        tight = replace(scene, solver=Solver(residual_tolerance=1e-13))
        _, P, report = step(scene, state)
        _, expected, _ = step(tight, state)
        assert report.unconverged == 0
        assert np.abs(P - expected)[:, 0].max() <= LOADS * expected.max()

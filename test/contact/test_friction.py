# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Friction that differs forward and backward, and in patches of the ground, in closed form."""

from dataclasses import replace
import math

from flat_states import crooked, flat_robot, in_plane, lying_flat
import numpy as np
from obstacle_scenes import COARSE, each_method
from oracle import empty_history, make_stepper, ORACLE
from oracle.contact_laws import prox_half_ellipses
import pytest
from scenes import course, DT, EPS, G, kinetic_energy, late_stop, MASS, slope
from schemes import span

from snake_sim_ros import Friction, ParameterError, Patches, Robot, Scene, Solver
from snake_sim_ros.contact.laws import prox_ellipse
from snake_sim_ros.scene.obstacles import is_flat
from snake_sim_ros.scene.parameters import scene_from_text, scene_to_text, with_settings
from snake_sim_ros.scene.posture import joint_angles
from snake_sim_ros.stepping.methods import METHODS

FORWARD, BACKWARD, ACROSS = 0.1, 0.25, 0.4
SCALES = Friction(longitudinal=FORWARD, backward=BACKWARD, transversal=ACROSS)
# Contacts at the height of the center of gravity: the link slides in any direction, and neither
# turns nor pitches, so that every contact carries half of it.
BLOCK = Robot(link_count=1, contact_radius=0.0)
RESIDUAL = 1e-12  # m/s
EXACT = Solver(tolerance=1e-14, residual_tolerance=RESIDUAL, r_sliding=0.03, iteration_limit=20000)
LEVELS = [
    pytest.param(name, level, id=f'{name}-{level}')
    for name in METHODS
    for level in ('planar', 'spatial')
]
each_level = pytest.mark.parametrize(('method', 'level'), LEVELS)


def block_scene(method, level, **settings):
    """
    Return a scene of a block on the floor.

    At the spatial level without the selection rule, which would press it in at 5e-7 m/s when its
    load begins. The planar level takes the loads of the rule, without its compliance.
    """
    if level == 'spatial':
        settings = {'solver': replace(EXACT, normal_compliance=0.0), **settings}
    given = {'robot': BLOCK, 'friction': SCALES, 'solver': EXACT, 'dt': 1 / 200, **settings}
    return Scene(method=method, level=level, **given)


def heading(angle):
    """Return the unit vectors along and across a link of a heading."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, s], [-s, c]])


def sliding(angle, velocity):
    """Return a block that slides with velocities along and across it [m/s]."""
    q = lying_flat(BLOCK, np.zeros(0), angle)
    return in_plane(BLOCK, q, np.array(velocity) @ heading(angle), np.zeros(1))


def left_over(steps):
    """
    Return what a solver may leave of the velocity of a block after some steps [m/s].

    Friction of two contacts is off by r_T R each, over the mass, in each step; loads by 2 m R in
    all. Sweeps leave eps in place of r R, which is as little.
    """
    return 2 * steps * EXACT.r_sliding * RESIDUAL / MASS + 2 * RESIDUAL + steps * 100 * EPS


# ---- the set ------------------------------------------------------------------------------------


def test_the_projection_is_the_nearest_point_of_both_halves():
    rng = np.random.default_rng(1)
    turn = np.linspace(0, 2 * math.pi, 20001)
    for _ in range(100):
        forward, backward, across = rng.uniform(0.05, 1.0, 3)
        along = np.where(np.cos(turn) > 0.0, backward, forward)
        edge = np.column_stack([along * np.cos(turn), across * np.sin(turn)])
        x, y = rng.uniform(-2.0, 2.0, 2)
        near = np.array(prox_half_ellipses(x, y, forward, backward, across))
        half = backward if x > 0.0 else forward
        inside = math.hypot(x / half, y / across) <= 1.0
        if inside:
            assert (near == (x, y)).all()
            continue
        # No point of the edge is nearer, and one of these is beside it by 3e-4 rad at most.
        distance, beside = np.hypot(*(edge - (x, y)).T).min(), turn[1] * max(along.max(), across)
        assert np.hypot(*(near - (x, y))) <= distance + 8 * EPS
        assert np.hypot(*(near - (x, y))) ** 2 >= distance**2 - 2 * beside**2 - beside * distance
        # Convex: the set is on one side of the plane through the nearest point.
        assert ((edge - near) @ (near - (x, y)) >= -1e-12).all()
        assert near[0] * x >= 0.0


def test_equal_halves_are_the_ellipse():
    rng = np.random.default_rng(2)
    for x, y in rng.uniform(-1.0, 1.0, (50, 2)):
        assert prox_half_ellipses(x, y, 0.2, 0.2, 0.5) == prox_ellipse(x, y, 0.2, 0.5)


# ---- sliding ------------------------------------------------------------------------------------


@each_level
@pytest.mark.parametrize('angle', [0.0, 2.5])
@pytest.mark.parametrize(('sign', 'mu'), [(1.0, FORWARD), (-1.0, BACKWARD)])
def test_a_block_stops_forward_and_backward(method, level, angle, sign, mu):
    # v = v0 - mu g t, and rest after v0/(mu g), here after 20 steps; d = v0^2/(2 mu g).
    steps, scene = 20, block_scene(method, level)
    speed = steps * mu * G * scene.dt
    states, _, report = course(scene, sliding(angle, (sign * speed, 0.0)), steps + 10)
    assert not report.unconverged and not report.failure
    velocity = states.u[:, 0, :2] @ heading(angle).T
    expected = np.maximum(0.0, speed - mu * G * scene.dt * np.arange(steps + 11))
    left = left_over(steps + 10)
    # The step of `bdf2` in which the block stops goes on for a bit, see `scenes.late_stop`.
    later = method == 'bdf2'
    exact = np.arange(steps + 11) < steps if later else np.arange(steps + 11) >= 0
    assert np.abs(velocity[exact, 0] - sign * expected[exact]).max() < left
    assert np.abs(velocity[steps + 8 if later else steps :]).max() < 1e-4 if later else left
    assert np.abs(velocity[:, 1]).max() < left
    way = (states.q[-1, 0, :2] - states.q[0, 0, :2]) @ heading(angle)[0]
    late = 2 * late_stop(method) * mu * G * scene.dt**2
    assert -scene.dt * steps * left <= sign * way - speed**2 / (2 * mu * G) < late


@each_level
@pytest.mark.parametrize('direction', [0.3, 1.3, math.pi / 2, 1.9, 2.8, 4.0, 5.9])
def test_friction_is_the_support_point_of_the_set(method, level, direction):
    # Dissipation is largest: with D = diag(mu, mu_T), mu that of the side of v, the step is
    # v' = v - g dt D^2 v'/|D v'|, implicitly, and its force the point of the set against v'.
    scene = block_scene(method, level)
    v0 = 0.6 * np.array([math.cos(direction), math.sin(direction)])
    states, impulses, report = course(scene, sliding(0.7, v0), 12)
    assert not report.unconverged and not report.failure
    v = states.u[:, 0, :2] @ heading(0.7).T
    before, after = v[:-1], v[1:]
    if method == 'bdf2':  # from u_hat, for the time in which impulses act; two states must exist
        before, after = (4 * v[2:-1] - v[1:-2]) / 3, v[3:]
    D = np.column_stack(
        [np.where(after[:, 0] > 0.0, FORWARD, BACKWARD), np.full(len(after), ACROSS)]
    )
    power = np.linalg.norm(D * after, axis=1)[:, None]
    change = before - G * span(scene) * D**2 * after / power
    # A velocity that is off turns the direction on the ellipse, by it over |v|, with a curvature
    # of 1/mu at most: g dt (mu_T/mu)^2/|v| = 2 times.
    left = 10 * left_over(12)
    assert np.abs(after - change).max() < left
    # The bound of the set is reached: it slides.
    P = impulses[1:, :, 1:3].sum(axis=1)
    mu = np.where(P[:, 0] < 0.0, FORWARD, BACKWARD)
    used = np.hypot(P[:, 0] / mu, P[:, 1] / ACROSS) / impulses[1:, :, 0].sum(axis=1)
    assert np.abs(used - 1.0).max() < 1e-8
    assert ((P * v[1:]).sum(axis=1) < 0.0).all()
    energy = kinetic_energy(BLOCK, states.u)
    assert (np.diff(energy) < 0.0).all()


@each_method
@pytest.mark.parametrize('downhill', [0.0, math.pi, 0.5, 2.6, math.pi / 2])
def test_a_block_sticks_up_to_the_threshold_of_its_side(method, downhill):
    # Along the link tan b <= mu of that side; in other directions where the load of the slope is
    # on the edge of the ellipse of this side. Gravity is tilted: the plane has no slope.
    mu = FORWARD if math.cos(downhill) > 0.0 else BACKWARD
    onset = 1 / math.hypot(math.cos(downhill) / mu, math.sin(downhill) / ACROSS)
    for load in (0.999, 1.01):
        gravity = slope(math.atan(load * onset), downhill)
        scene = block_scene(method, 'spatial', gravity=gravity, dt=COARSE)
        states, _, report = course(scene, sliding(0.0, (0.0, 0.0)), 40, 40)
        assert not report.unconverged
        if load < 1.0:
            # Each step leaves a residual.
            assert np.abs(states.u[:, 0, :2]).max() < left_over(40)
            assert np.abs(states.q[-1, 0, :2]).max() < left_over(40) * 40 * scene.dt
        else:
            # It starts in the direction in which the ellipse lets it, and not uphill.
            assert states.u[-1, 0, :2] @ gravity[:2] > 0.0
            assert np.hypot(*states.u[-1, 0, :2]) > 1e-4


@each_level
def test_passive_wheels_roll_freely_along(method, level):
    # The limit of small friction along the link: 1e-3 forward, ten times that backward.
    wheels = Friction(longitudinal=1e-3, backward=1e-2, transversal=ACROSS)
    scene = block_scene(method, level, friction=wheels)
    for sign, mu in ((1.0, 1e-3), (-1.0, 1e-2)):
        states, _, report = course(scene, sliding(0.4, (sign * 0.5, 0.0)), 20)
        assert not report.unconverged and not report.failure
        velocity = states.u[-1, 0, :2] @ heading(0.4).T
        assert abs(velocity[0] - sign * (0.5 - 20 * mu * G * scene.dt)) < left_over(20)
        assert abs(velocity[1]) < left_over(20)


def agreeing_methods(scene, state, angle):
    """
    Check that methods of the paper's step take the dense one; return how many, 0 if it fails.

    `scene` is that of the dense step, and `angle`, shape (1, n-1, 2), are the references.
    """
    ends = {}
    for method in [ORACLE, *(name for name in METHODS if name != 'bdf2')]:
        each = replace(scene, method=method)
        start = state, empty_history(each), angle, np.zeros(angle.shape)
        ends[method] = make_stepper(each).advance(*start)
    end, history, report = ends.pop(ORACLE)
    if report.failure:
        assert all(news.failure for _, _, news in ends.values())
        return 0
    for other, memory, news in ends.values():
        assert not news.unconverged
        # Velocities of 1 m/s, impulses of 1e-3 N s: see test_planar.py.
        assert np.abs(memory.impulse - history.impulse).max() < 1e-8
        assert np.abs(other.u - end.u).max() < 1e-7
    return len(ends)


def agreeing_at_both_levels(friction, seed, speed):
    """Return the sum of `agreeing_methods` of random flat robots, at both levels."""
    taken = 0
    cases = [(links, level) for links in (1, 3, 5) for level in ('planar', 'spatial')]
    for number, (links, level) in enumerate(cases):
        rng = np.random.default_rng([number, seed])
        robot = flat_robot(rng, links)
        state = crooked(rng, robot, speed=speed)
        angle = joint_angles(state.q)[None] + np.array([0.03, 0.0])
        solver = replace(EXACT, tolerance=1e-12, normal_compliance=1e-2, iteration_limit=500)
        scene = Scene(
            robot=robot, friction=friction, level=level, method=ORACLE, solver=solver, dt=DT
        )
        taken += agreeing_methods(scene, state, angle)
    return taken


def test_methods_take_the_dense_step_in_the_plane():
    # As in test_planar.py, with sides and patches. The spatial level has both in test_pegs.py and
    # test_ground.py, and `bdf2` in test_bdf2_reference.py.
    rng = np.random.default_rng(4)
    factors = tuple(map(tuple, rng.uniform(0.2, 2.0, (20, 20))))
    patches = Patches(factors=factors, cell=0.08, origin=(-0.8, -0.8))
    # So little that the robot does not roll over.
    friction = Friction(longitudinal=0.02, backward=0.05, transversal=0.1)
    taken = 0
    for seed, links in enumerate((2, 3, 5, 5)):
        rng = np.random.default_rng([seed, 5])
        robot = flat_robot(rng, links)
        state = crooked(rng, robot, speed=10.0 ** -(seed % 3))
        angle = joint_angles(state.q)[None] + np.array([0.03, 0.0])
        settings = {'robot': robot, 'friction': friction, 'patches': patches, 'level': 'planar'}
        solver = replace(EXACT, tolerance=1e-12, normal_compliance=1e-2, iteration_limit=500)
        scene = Scene(method=ORACLE, solver=solver, dt=DT, **settings)
        taken += agreeing_methods(scene, state, angle)
    assert taken >= 2 * (len(METHODS) - 2)


# ---- patches ------------------------------------------------------------------------------------


def border(factor, x=0.0):
    """Return a half plane with another friction, from x on [m]."""
    return Patches(factors=((factor,),), cell=40.0, origin=(x, -20.0))


@each_level
@pytest.mark.parametrize('factor', [2.0, 0.5])
def test_a_block_slides_over_a_border(method, level, factor):
    # It comes with v0, has sqrt(v0^2 - 2 mu g d) at the border and stops (that^2)/(2 f mu g)
    # beyond it. Both spheres cross it at once, as the block slides along the border's normal with
    # the spheres across.
    mu, d, v0, dt = 0.3, 0.02, 0.5, 1 / 1000
    friction = Friction(longitudinal=0.1, transversal=mu)
    scene = block_scene(method, level, friction=friction, patches=border(factor, d), dt=dt)
    start = sliding(math.pi / 2, (0.0, -v0))  # across the link: along x
    at_border = math.sqrt(v0**2 - 2 * mu * G * d)
    stop = d + at_border**2 / (2 * factor * mu * G)
    duration = (v0 - at_border) / (mu * G) + at_border / (factor * mu * G)
    states, _, report = course(scene, start, math.ceil(duration / dt) + 10)
    assert not report.unconverged and not report.failure
    assert np.abs(states.u[-1]).max() < 1e-4
    # The border is noticed at most a step too early or late, at which v is off by |f - 1| mu g dt,
    # and so is the way, by dt times that times the rest of the time; the last step ends at rest.
    off = (
        abs(factor - 1) * mu * G * dt * duration + 2 * late_stop(method) * factor * mu * G * dt**2
    )
    assert abs(states.q[-1, 0, 0] - stop) < off
    assert np.abs(states.q[:, 0, 1]).max() < duration * left_over(len(states.q))


@each_level
def test_a_block_with_one_end_in_a_patch_turns(method, level):
    # Spheres at x = +-L_GS, the front one on ice: the load at the rear brakes, so that the link
    # begins to turn by mu (m g/2) L_GS/Theta_1.
    mu = 0.3
    friction = Friction(longitudinal=mu, transversal=mu)
    scene = block_scene(method, level, friction=friction, patches=border(0.0), dt=1e-4)
    states, impulses, report = course(scene, sliding(0.0, (0.0, 0.5)), 3)
    assert not report.unconverged and not report.failure
    offset, inertia = BLOCK.contact_offset, BLOCK.inertia_transversal
    rate = mu * MASS * G / 2 * offset / inertia * 3 * scene.dt
    # Meanwhile the velocity turns by rate t L_GS/v = 1e-4.
    turning = np.linalg.norm(states.u[-1, 0, 3:])
    assert turning == pytest.approx(rate, rel=1e-3)
    assert np.abs(impulses[1:, 0, 1:3]).max() == 0.0


@each_method
def test_a_block_sticks_on_one_patch_and_slides_on_the_other(method):
    # tan b = 0.2 holds at mu = 0.3 and not at a third of it.
    gravity = slope(math.atan(0.2))
    friction = Friction(longitudinal=0.3, transversal=0.3)
    scene = block_scene(
        method, 'spatial', friction=friction, gravity=gravity, patches=border(1 / 3), dt=COARSE
    )
    here, there = sliding(0.0, (0.0, 0.0)), sliding(0.0, (0.0, 0.0))
    here.q[0, 0], there.q[0, 0] = -1.0, 1.0
    rest, _, report = course(scene, here, 40, 40)
    assert not report.unconverged
    assert np.abs(rest.u[-1, 0, :2]).max() < left_over(40)
    slides, _, report = course(scene, there, 40, 40)
    assert not report.unconverged
    angle = math.atan(0.2)
    expected = G * (math.sin(angle) - 0.1 * math.cos(angle)) * 40 * scene.dt
    # The selection rule presses in at 1e-6 m/s, so that the load is off by less than that over g.
    assert slides.u[-1, 0, 0] == pytest.approx(expected, abs=left_over(40) + 1e-6)


def test_rolling_friction_is_that_of_the_patch():
    # A link that rolls across: without friction of rolling it goes on, in the patch it slows down.
    friction = Friction(longitudinal=0.5, transversal=0.5, rolling=0.02)
    robot = Robot(link_count=1)
    radius = robot.contact_radius
    for factor in (0.0, 1.0, 2.0):
        scene = Scene(
            robot=robot, friction=friction, level='spatial', method='newton',
            patches=Patches(factors=((factor,),), cell=40.0, origin=(-20.0, -20.0)),
        )  # fmt: skip
        start = in_plane(robot, lying_flat(robot, np.zeros(0)), np.array([0.0, 0.3]), np.zeros(1))
        start.u[0, 5] = -0.3 / radius  # rolls without sliding, about e_z of the link
        states, _, _ = course(scene, start, 40, 40)
        # m a r + Theta_3 a/r = mu_V m g r, as test_rolling.py has it.
        mass, inertia = robot.link_mass, robot.inertia_axial
        slows = 0.02 * factor * mass * G * radius / (mass * radius + inertia / radius)
        lost = 0.3 - states.u[-1, 0, 1]
        assert lost == pytest.approx(slows * 40 * scene.dt, abs=1e-5)


# ---- scenes -------------------------------------------------------------------------------------


def test_friction_is_paid_for_only_where_it_differs():
    plain = Scene()
    assert is_flat(plain)
    same = Friction(backward=Friction().longitudinal)
    assert is_flat(replace(plain, friction=same))
    assert not is_flat(replace(plain, friction=SCALES))
    assert not is_flat(replace(plain, patches=border(2.0)))


def test_scenes_keep_sides_and_patches_as_text():
    scene = replace(Scene(), friction=SCALES, patches=border(2.0))
    assert scene_from_text(scene_to_text(scene)) == scene
    assert scene_from_text(scene_to_text(Scene())) == Scene()


@pytest.mark.parametrize(
    ('name', 'value', 'sentence'),
    [
        ('friction.backward', -0.1, 'friction.backward must be at least 0, got -0.1'),
        ('friction.backward', math.nan, 'friction.backward must be finite, got nan'),
        ('friction.backward', 'much', "friction.backward must be a number, got 'much'"),
        ('friction.backward', [0.1], 'friction.backward must be a number, got [0.1]'),
        ('patches.factors', [[1.0, -2.0]], 'patches.factors must be at least 0, got -2'),
        ('patches.factors', [[1.0, math.nan]], 'patches.factors must be finite, got nan'),
        (
            'patches.factors',
            [[1.0], [1.0, 2.0]],
            'patches.factors must be rows of one length, got rows of 1 and of 2 numbers',
        ),
        ('patches.cell', 0.0, 'patches.cell must be above 0 m, got 0 m'),
        ('patches.origin', [1.0], 'patches.origin must have 2 components, got 1'),
    ],
)
def test_bad_values_get_one_sentence(name, value, sentence):
    with pytest.raises(ParameterError) as raised:
        with_settings(Scene(), {name: value})
    assert str(raised.value) == sentence

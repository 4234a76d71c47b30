# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Pegs: gaps, directions, impacts, friction, and a snake that pushes itself along them."""

from dataclasses import replace
import math

import numpy as np
from obstacle_scenes import (
    anywhere,
    check_agreement,
    check_directions,
    COARSE,
    each_method,
    each_method_and_step,
    lying_on,
    only_compiled,
    pushed,
    random_pegs,
    robot_scene,
    travelled,
    WITHOUT_COMPILER,
)
import pytest
from scenes import (
    ACROSS,
    CLOSED,
    course,
    isotropic,
    kinetic_energy,
    late_stop,
    link_scene,
    lying,
    MASS,
    OFFSET,
    RADIUS,
    run,
    SPEED,
)

from snake_sim_ros import ParameterError, Pegs, Robot, Scene, Solver, State
from snake_sim_ros.contact.closing import closed_gap, left_gap
from snake_sim_ros.scene import obstacles
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.posture import chain_coordinates, initial_coordinates
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.methods import empty_history, make_stepper, METHODS
from snake_sim_ros.stepping.state import initial_state

pytestmark = pytest.mark.long

PEG = 0.03  # radius of a single peg [m]
FREE = 25.0  # far above the floor [m]
# A method that adds laws of a stiffness 1/(1e-5 G) to the inertia of a link loses up to six digits
# of velocities around 1 m/s.
ROUNDED = 1e-10
SLIPPERY = {'friction': isotropic(0.0), 'gravity': (0.0, 0.0, 0.0)}


def peg(x, y, mu=0.0, radius=PEG):
    return Pegs(x=(x,), y=(y,), radius=radius, friction=mu)


# ---- geometry -----------------------------------------------------------------------------------


@pytest.mark.parametrize('seed', range(10))
def test_gaps_are_distances_seen_from_above(seed):
    rng = np.random.default_rng(seed)
    scene = robot_scene(rng, pegs=random_pegs(rng))
    robot, state = scene.robot, anywhere(rng, 5)
    gap, lever, frame = obstacles.contact_geometry(scene, state.q)
    R = rotation_matrices(state.q[:, 3:])
    for k, (x, y, radius) in enumerate(scene.pegs.axes):
        for i in range(5):
            a = obstacles.first_peg(scene) + 5 * k + i
            s = np.linspace(-1.0, 1.0, 20001) * robot.contact_offset[i]
            axis = state.q[i, :3] + s[:, None] * R[i, :, 2]
            distance = np.linalg.norm(axis[:, :2] - [x, y], axis=1)
            # The nearest of the points is up to half their distance, 2e-6 m, from the nearest.
            sampled = distance.min() - radius - robot.contact_radius[i]
            assert -4e-6 < gap[a] - sampled <= 1e-15
            # The contact point is on the link; seen from above it is `gap` away from the peg, in
            # the direction of the normal, and as high as the point of the axis.
            point = state.q[i, :3] + lever[a]
            peg_side = np.array([x, y]) + radius * frame[a, 0, :2]
            assert np.abs(point[:2] - peg_side - gap[a] * frame[a, 0, :2]).max() < 1e-15
            assert abs(point[2] - axis[distance.argmin(), 2]) < 4e-6
            assert frame[a, 0, 2] == 0.0
            assert frame[a, 2].tolist() == [0.0, 0.0, 1.0]


@pytest.mark.parametrize('seed', range(20))
def test_directions(seed):
    rng = np.random.default_rng(seed)
    scene, state = robot_scene(rng, pegs=random_pegs(rng)), anywhere(rng, 5)
    gap, _, _ = obstacles.contact_geometry(scene, state.q)
    # The third derivative of a distance d is about 3 v^3/d^2; v < 2.2 m/s and d > 0.15 m make
    # 1e-10/6 of 1500: 3e-8. Pegs have a distance d > 0.07 m + gap, links turn past them likewise.
    far = np.flatnonzero(gap[10:] > 0.1) + 10
    assert len(far) > 3
    check_directions(scene, state, far, 1e-7)


# ---- steps --------------------------------------------------------------------------------------


@each_method
def test_step_agrees_with_the_dense_one(method):
    closed = 0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        scene = robot_scene(rng, pegs=random_pegs(rng))
        closed += check_agreement(scene, lying_on(rng, scene), rng, method)
    assert closed > 8


@each_method_and_step
def test_link_stops_at_a_peg_without_rebound(method, dt):
    # A peg in front of the center: u+ = 0. It is noticed at the first middle of a step inside.
    distance, v = 0.01, 1.0
    y = -(RADIUS + PEG + distance)
    scene = link_scene(method, dt, pegs=peg(0.0, y), **SLIPPERY)
    states, impulses, report = course(scene, lying((0.0, -v, 0.0)), math.ceil(1.5 * distance / dt))
    hit = np.flatnonzero(np.abs(states.u[:, 0]).max(axis=1) < 0.5)[0]
    assert np.abs(states.u[hit:, 0]).max() < SPEED + ROUNDED
    # The momentum is that of one impulse.
    assert abs(impulses[hit, 2, 0] - MASS * v) < MASS * (SPEED + ROUNDED)
    inside = -(states.q[-1, 0, 1] + distance)
    assert -1e-12 <= inside < v * dt
    assert abs(report.penetration_max - inside) < 1e-9


@each_method_and_step
@pytest.mark.parametrize('arm', [0.02, -0.03, OFFSET])
def test_peg_beside_the_center_turns_the_link(method, dt, arm):
    # Frictionless inelastic impact at the lever c from the center, q = m c^2/Theta_1:
    # v+ = v q/(1 + q), omega_z+ = -v (m c/Theta_1)/(1 + q).
    # A step of `bdf2` that starts anew has two parts, between which the link turns: here by 1e-11.
    v, q = -1.0, MASS * arm**2 / ACROSS
    dt = 1e-12 if method == 'bdf2' else dt
    scene = link_scene(method, dt, pegs=peg(arm, -RADIUS - PEG), **SLIPPERY)
    end, _, _ = run(scene, lying((0.0, v, 0.0)), 1)
    turn = -v * MASS * arm / ACROSS / (1 + q)
    error = (SPEED + ROUNDED) / abs(arm)
    assert abs(end.u[0, 1] - v * q / (1 + q)) < error
    assert abs(end.u[0, 4] - turn) < error  # e_y of the link is up
    assert np.abs(end.u[0, [0, 2, 3, 5]]).max() < error


def long_link(method, dt, mu, gravity):
    """Return a scene of one link, 2 m long, that does not turn, with a peg beside its center."""
    robot = Robot(
        link_count=1, link_length=2.2, contact_offset=1.0,
        inertia_transversal=1e9, inertia_axial=1e9,
    )  # fmt: skip
    return link_scene(
        method, dt, robot=robot, friction=isotropic(0.0), gravity=gravity,
        pegs=peg(0.0, -RADIUS - PEG, mu),
    )  # fmt: skip


@each_method_and_step
@pytest.mark.parametrize('direction', [0.0, 0.7, 2.5])
def test_link_slides_along_a_peg_by_the_law_of_coulomb(method, dt, direction):
    # Pressed on the peg by m g_y, friction mu m g_y is against the sliding velocity, here in the
    # vertical plane: v(t) = v_0 - mu g_y t along a straight line, then rest.
    mu, press, v = 0.4, 5.0, 0.3
    scene = long_link(method, dt, mu, (0.0, -press, 0.0))
    along = np.array([math.cos(direction), 0.0, math.sin(direction)])
    state = lying(tuple(v * along))
    state.q[0, 1], state.q[0, 2] = CLOSED, FREE
    steps = math.ceil(v / (mu * press) / dt) + 5
    states, forces = pushed(scene, state, steps)
    expected = np.maximum(0.0, v - mu * press * dt * np.arange(steps + 1))
    # In every step friction may be r_T SPEED beside its disc.
    error = (SPEED + ROUNDED) * (1 + steps / 100)
    assert np.abs(states.u[:, 0, :3] - expected[:, None] * along).max() < error
    # The shortest part of a step of `bdf2` for which impulses act is dt/3.
    assert np.abs(forces[:, 2] - MASS * press).max() < MASS * error / (dt / 3)
    moved = states.q[-1, 0, :3] - states.q[0, 0, :3]
    # The last step stops within itself.
    bound = late_stop(method) * mu * press * dt**2 + error * steps * dt
    assert np.linalg.norm(moved - v**2 / (2 * mu * press) * along) < bound


@each_method_and_step
def test_peg_does_not_hold_what_leaves(method, dt):
    scene = long_link(method, dt, 0.4, (0.0, 0.0, 0.0))
    state = lying((0.1, 0.2, 0.3))
    state.q[0, 1], state.q[0, 2] = -0.2 * dt, FREE  # closed at the middle of the step
    end, history, report = run(scene, state, 1)
    assert report.contacts == 1
    assert np.abs(end.u - state.u).max() < ROUNDED
    assert not history.impulse.any()


# Only `newton` meets pegs in the plane.
at_both_levels = pytest.mark.parametrize(
    ('method', 'level'), [('newton', 'planar'), *((name, 'spatial') for name in METHODS)]
)


@at_both_levels
def test_how_deep_a_bent_robot_of_unequal_links_is_in_a_peg(method, level):
    # Link 1 along x, link 2 at 60 degrees to it, link 3 at 90: a peg beside the center of link 3,
    # 1 mm in it. At rest nothing changes.
    length, bend, depth = (0.10, 0.16, 0.13), np.radians([60.0, 30.0]), 1e-3
    robot = Robot(
        link_count=3, link_length=length, joint_limit=math.pi / 2,
        contact_offset=(0.03, 0.05, 0.04),
    )  # fmt: skip
    q = chain_coordinates(robot, np.column_stack([bend, np.zeros(2)]))
    q[:, 2] = RADIUS
    turns = np.cumsum([0.0, *bend])
    steps = np.array(length)[:, None] * np.column_stack([np.cos(turns), np.sin(turns)])
    x, y = steps[0] / 2 + steps[1] + steps[2] / 2  # the center of link 3 from that of link 1
    scene = Scene(
        robot=robot, method=method, level=level, friction=isotropic(0.0),
        pegs=peg(q[0, 0] + x + PEG + RADIUS - depth, q[0, 1] + y),
    )  # fmt: skip
    angle = np.column_stack([bend, np.zeros(2)])[None]
    start = State(q, np.zeros((3, 6))), empty_history(scene)
    _, _, report = make_stepper(scene).advance(*start, angle, np.zeros(angle.shape))
    assert report.penetration_max == pytest.approx(depth, abs=1e-9)
    assert report.level == level


@at_both_levels
@pytest.mark.parametrize(('share', 'goes_on'), [(0.4, False), (0.55, False), (0.8, True)])
def test_a_peg_is_found_at_the_middle_of_a_step(method, level, share, goes_on):
    # A link that gets to the peg before the middle of the step stops. So does one that is at most
    # as far from it there as 0.1 m/s would close in the rest of the step. Others go on. With
    # `bdf2` all stop. They are at the peg in the end.
    v, dt = 0.5, COARSE
    pegs, solver = peg(0.0, -(RADIUS + PEG + share * v * dt)), Solver(residual_tolerance=SPEED)
    scene = link_scene(method, dt, level=level, pegs=pegs, friction=isotropic(0.0), solver=solver)
    end, _, report = run(scene, lying((0.0, -v, 0.0)), 1)
    assert report.level == level
    # The selection rule gives way by a share of 1e-4.
    goes_on = goes_on and method != 'bdf2'
    assert abs(end.u[0, 1] + goes_on * v) < 1e-4 * v
    gap = left_gap(closed_gap(solver.activation_tolerance, dt))
    assert abs(end.q[0, 1] + (1.0 if goes_on else share) * v * dt) < gap + 1e-4 * v * dt


@each_method
def test_impacts_take_energy(method):
    # A slack robot thrown between pegs, in the plane, where nothing turns but about the vertical:
    # E_E - E_A = u_E . W P - |u_E - u_A|^2/2 is not above 0. The first step of `bdf2` after an
    # event is exact for constant forces; those of joints turn by omega dt in it, and velocities
    # are off by half of its square.
    rng = np.random.default_rng(3)
    throws, dt = (1, 1 / 400) if WITHOUT_COMPILER else (3, 1 / 1000)
    robot = Robot(
        link_count=4, yaw_stiffness=0.0, yaw_damping=0.0, pitch_stiffness=0.0, pitch_damping=0.0
    )
    pegs = Pegs(x=(-0.2, 0.15, 0.0), y=(0.12, 0.12, -0.12), radius=PEG, friction=0.3)
    # Projections of all contacts at once settle an impact in hundreds of sweeps.
    solver = Solver(tolerance=1e-9, residual_tolerance=1e-9, iteration_limit=20000)
    scene = Scene(robot=robot, pegs=pegs, method=method, solver=solver, dt=dt, **SLIPPERY)
    q = chain_coordinates(robot, np.zeros((3, 2)))
    q[:, 0] -= q[:, 0].mean()
    q[:, 2] = RADIUS
    for _ in range(throws):
        v, turn = rng.uniform(-0.5, 0.5, 2), rng.uniform(-2.0, 2.0)
        u = np.zeros((4, 6))
        u[:, 0], u[:, 1], u[:, 4] = v[0], v[1] + turn * q[:, 0], turn
        states, impulses, _ = course(scene, State(q.copy(), u), round(0.3 / dt))
        energy = kinetic_energy(robot, states.u)
        assert impulses[:, 8:, 0].max() > 0.01  # hits
        fastest = np.abs(states.u[:, :, 4]).max()
        late = (fastest * dt) ** 2 if method == 'bdf2' else 0.0
        assert np.diff(energy).max() < (1e-7 + late) * energy[0]
        assert energy[-1] < energy[0]


# ---- obstacle-aided locomotion ------------------------------------------------------------------


@only_compiled
def test_snake_pushes_itself_along_pegs():
    scene = load_scene('obstacle_aided')
    simulation, there = travelled(scene)
    assert simulation.report.unconverged == 0
    assert simulation.report.penetration_max < 1e-4
    without, slipped = travelled(replace(scene, pegs=Pegs()))
    assert without.report.unconverged == 0
    # The body runs along a curve that stands between the pegs, at most as fast as the wave: about
    # 0.8 m of wave length at 80/360 Hz. Without pegs the wave slips through.
    assert 10 * abs(slipped[0]) < -there[0] < 0.8 * 80 / 360 * scene.duration


@only_compiled
@pytest.mark.parametrize(('method', 'dt'), [('newton', 1 / 1000), ('bdf2', 1 / 100)])
def test_large_steps_follow_the_path_of_small_ones(method, dt):
    scene = replace(load_scene('obstacle_aided'), duration=5.0)
    _, fine = travelled(scene)
    large, coarse = travelled(replace(scene, method=method, dt=dt))
    assert large.report.unconverged == 0
    assert np.linalg.norm(fine - coarse) < 1e-3 * np.linalg.norm(fine)


# ---- refusals -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('values', 'expected'),
    [
        ({'x': (0.1, 0.2), 'y': (0.1,)}, 'x and y must be of one length, got 2 and 1 numbers'),
        (
            {'x': (0.1, 0.2), 'y': (0.1, 0.3), 'radius': (0.1, 0.1, 0.1)},
            'radius must be one number or one for each of the 2 pegs, got 3 numbers',
        ),
        ({'radius': -0.05}, 'radius must be above 0 m, got -0.05 m'),
        ({'x': (math.nan,), 'y': (0.1,)}, 'x must be finite, got nan m'),
        ({'friction': -0.1}, 'friction must be at least 0, got -0.1'),
    ],
)
def test_pegs_that_are_refused(values, expected):
    with pytest.raises(ParameterError) as caught:
        Pegs(**values)
    assert str(caught.value) == expected


def test_a_peg_inside_the_robot_is_refused():
    scene = Scene(pegs=Pegs(x=(0.0, 0.25), y=(0.5, 0.06), radius=(0.1, 0.02)))
    with pytest.raises(ParameterError) as caught:
        initial_state(scene)
    # Link 8 is around x = 0.244 m, along x: 0.0525 + 0.02 - 0.06 = 0.0125 m inside.
    assert str(caught.value) == (
        'pegs must be beside the robot at its start: peg 2 at (0.25, 0.06) m with radius 0.02 m '
        'is 0.0125 m inside link 8'
    )
    # Touching is beside.
    beside = Scene(pegs=Pegs(x=(0.25,), y=(0.0725 + 1e-12,), radius=0.02))
    assert np.array_equal(initial_coordinates(beside), initial_coordinates(Scene()))

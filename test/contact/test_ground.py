# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Ground of cells: gaps, directions, risers and edges, and a robot that climbs a step."""

from dataclasses import replace
import math

import numpy as np
from obstacle_scenes import (
    anywhere,
    check_agreement,
    check_directions,
    each_method,
    each_method_and_step,
    lying_on,
    MIDDLE,
    only_compiled,
    random_ground,
    robot_scene,
    travelled,
    WITHOUT_COMPILER,
)
import pytest
from random_states import EPS
from scenes import (
    CLOSED,
    course,
    G,
    isotropic,
    kinetic_energy,
    link_scene,
    lying,
    OFFSET,
    RADIUS,
    references,
    run,
    SPEED,
    SWEEPING,
)

from snake_sim_ros import Ground, ParameterError, Robot, Scene, State
from snake_sim_ros.scene import obstacles
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.posture import initial_coordinates
from snake_sim_ros.scene.rotations import about, FLAT, product
from snake_sim_ros.stepping.methods import empty_history, make_stepper, METHODS
from snake_sim_ros.stepping.state import initial_state

# A method that adds laws of a stiffness 1/(1e-5 G) to the inertia of a link loses up to six digits
# of velocities around 1 m/s.
ROUNDED = 1e-10
WALL = Ground(heights=((0.0,) * 8, (0.2,) * 8), cell=0.15, origin=(-0.6, -0.15))  # from y = 0 on
STEP = 0.03  # m


def step_at(x, height=STEP):
    """Return ground that is `height` high from x on, 2 m far and wide."""
    return Ground(heights=((height,) * 2,) * 2, cell=1.0, origin=(x, -1.0))


# ---- geometry -----------------------------------------------------------------------------------


@pytest.mark.parametrize('seed', range(10))
def test_gaps_are_distances_from_the_ground(seed):
    rng = np.random.default_rng(seed)
    ground = random_ground(rng)
    scene = robot_scene(rng, ground=ground)
    robot, state = scene.robot, anywhere(rng, 5)
    state.q[:, 2] = np.abs(state.q[:, 2]) * 0.4
    gap, _, _ = obstacles.contact_geometry(scene, state.q)
    ends = 0
    for i in range(5):
        for side, sign in enumerate((1, -1)):
            arm = sign * robot.contact_offset[i]
            axis = obstacles.rotation_matrices(state.q[i : i + 1, 3:])[0, :, 2]
            center = state.q[i, :3] + arm * axis
            column, row = obstacles.cell_at(ground, *center[:2])
            if center[2] <= obstacles.cell_height(ground, column, row):
                continue  # inside the ground there is no nearest point
            # The nearest of all points of the boxes around, if it is within half a cell.
            nearest = math.inf
            for step in np.ndindex(5, 5):
                cell = np.array([column, row]) + step - 2
                low = np.array(ground.origin) + ground.cell * cell
                box = np.clip(center[:2], low, low + ground.cell)
                point = np.array([*box, min(center[2], obstacles.cell_height(ground, *cell))])
                nearest = min(nearest, float(np.linalg.norm(center - point)))
            if nearest > ground.cell / 2:
                continue
            ends += 1
            expected = nearest - robot.contact_radius[i]
            # The cell below the sphere and its three neighbors: 10 spheres each.
            assert abs(gap[5 * side + i :: 10].min() - expected) < 8 * EPS
    assert ends > 0


@pytest.mark.parametrize('seed', range(20))
def test_directions(seed):
    rng = np.random.default_rng(seed)
    scene, state = robot_scene(rng, ground=random_ground(rng)), anywhere(rng, 5)
    gap, _, _ = obstacles.contact_geometry(scene, state.q)
    # Distances from edges as in test_pegs: v < 1.5 m/s, d > 0.05 m, 1e-10/6 of 3 v^3/d^2 = 4000.
    # A sphere on its way into another cell changes its contacts; at 2e-5 m/cell none does here.
    apart = np.flatnonzero((gap > 0.0) & np.isfinite(gap))
    assert len(apart) >= 2
    check_directions(scene, state, apart, 1e-7)


def test_level_neighbors_are_not_felt():
    # Positions over the border of level cells, apart from and at a straight wall of several.
    for y, contacts in ((-0.07, 1), (-RADIUS, 2)):
        for x in np.linspace(-0.1, 0.1, 17):
            points = obstacles.nearest_points(WALL, np.array([x, y, RADIUS]))
            assert [point is None for point in points] == [False, True, False, True]
            scene = Scene(robot=Robot(link_count=1, contact_offset=0.0), ground=WALL)
            state = lying()
            state.q[0, :3] = x, y, RADIUS
            gap, _, frame = obstacles.contact_geometry(scene, state.q)
            touching = np.flatnonzero(np.abs(gap[[0, 2, 4, 6]]) < 1e-9)
            assert len(touching) == contacts
            assert contacts == 1 or frame[4, 0].tolist() == [0.0, -1.0, 0.0]


def test_a_pillar_beyond_the_corner_is_felt():
    pillar = Ground(heights=((0.2,),), cell=0.2, origin=(0.0, 0.0))
    points = obstacles.nearest_points(pillar, np.array([-0.01, -0.02, 0.1]))
    assert [point is None for point in points] == [False, True, True, False]
    assert points[3].tolist() == [0.0, 0.0, 0.1]


@pytest.mark.parametrize('seed', range(10))
def test_a_robot_begins_on_the_ground(seed):
    rng = np.random.default_rng(seed)
    scene = replace(load_scene('sidewinding'), ground=random_ground(rng))
    gap, _, _ = obstacles.contact_geometry(scene, initial_coordinates(scene))
    assert abs(gap.min()) < 4 * EPS


# ---- steps --------------------------------------------------------------------------------------


@each_method
def test_step_agrees_with_the_dense_one(method):
    closed = 0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        scene = robot_scene(rng, ground=random_ground(rng, 0.06))
        closed += check_agreement(scene, lying_on(rng, scene), rng, method)
    assert closed > 8


@each_method
def test_level_cells_are_a_floor(method):
    # 0.1 m up and all over cells, against the floor of the paper; link 1 rolls and slides.
    flat = replace(load_scene('lateral_undulation'), method=method, dt=1 / 400)
    flat = replace(flat, level='spatial', solver=replace(flat.solver, tolerance=1e-9))
    steps = 100
    if WITHOUT_COMPILER:
        flat, steps = replace(flat, robot=Robot(link_count=2)), 3
        # Gauss-Seidel stops at its limit of sweeps on such a floor, see test_change.py.
        flat = replace(flat, solver=replace(flat.solver, iteration_limit=1000))
    cells = replace(flat, ground=Ground(heights=((0.1,) * 20,) * 20, cell=0.11, origin=(-1.1, -1)))
    ends = []
    for scene in (flat, cells):
        state, _, _ = run(scene, initial_state(scene), steps)
        ends.append(state)
    # Residuals of 1e-9 m/s in 0.25 s; the paper's sweeps to 1e-9 N s leave 1e-7 m/s.
    bound = 1e-6 if method in SWEEPING else 1e-7
    assert np.abs(ends[1].q - ends[0].q - np.array([0, 0, 0.1, 0, 0, 0, 0])).max() < bound


@each_method
def test_a_contact_that_opens_keeps_no_force(method):
    # A link that lay on the floor and is thrown up: markers and sensors show what history has.
    scene = link_scene(method, 1 / 1000, ground=step_at(1.0))
    stepper, history = make_stepper(scene), empty_history(scene)
    state, history, _ = stepper.advance(lying(), history, *references(scene, 5))
    assert (history.impulse[:2, 0] > 0.0).all()
    thrown = State(state.q, state.u + np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))
    _, history, report = stepper.advance(thrown, history, *references(scene, 5))
    assert report.contacts == 0
    assert (history.impulse == 0.0).all()


@each_method_and_step
def test_link_slides_along_a_wall_of_several_cells(method, dt):
    # Frictionless along a wall of cells, pressed on it: neither floor nor wall change the velocity
    # along it, over three cells. It starts in contact with both.
    v = 1.0
    scene = link_scene(method, dt, friction=isotropic(0.0), ground=WALL, gravity=(0.0, 2.0, -G))
    state = lying((v, 0.0, 0.0))
    state.q[0, :2] = -0.4, -RADIUS - CLOSED
    steps = math.ceil(0.45 / v / dt)
    end, _, report = run(scene, state, steps)
    assert report.contacts == 4
    error = (SPEED + ROUNDED) * (1 + 3 * math.sqrt(steps))
    assert np.abs(end.u[0] - [v, 0, 0, 0, 0, 0]).max() < error
    assert report.penetration_max < 1e-9


@each_method_and_step
def test_link_stops_at_a_riser_without_rebound(method, dt):
    # A riser higher than the center of the front sphere: u+ = 0, on the floor.
    v, distance = 1.0, 0.01
    scene = link_scene(method, dt, friction=isotropic(0.0), ground=step_at(0.0, 0.1))
    state = lying((v, 0.0, 0.0))
    state.q[0, 0] = -OFFSET - RADIUS - distance
    end, _, report = run(scene, state, math.ceil(1.5 * distance / v / dt))
    assert report.contacts == 3
    assert np.abs(end.u).max() < SPEED + ROUNDED
    assert -1e-12 <= end.q[0, 0] - state.q[0, 0] - distance < v * dt
    assert abs(end.q[0, 2] - RADIUS) < 1e-9


@each_method_and_step
@pytest.mark.parametrize('height', [0.01, 0.03, 0.05])
def test_ball_is_deflected_by_an_edge(method, dt, height):
    # Frictionless: what is left of the velocity is its part along the tangent plane of the edge.
    # With n = (-a, c), c = (r - h)/r: v_x+ = v c^2, v_z+ = v a c, E+/E- = c^2.
    v, c = 1.0, (RADIUS - height) / RADIUS
    a = math.sqrt(1.0 - c * c)
    ball = Robot(link_count=1, contact_offset=0.0)
    scene = link_scene(
        method, dt, robot=ball, friction=isotropic(0.0), gravity=(0.0, 0.0, 0.0),
        ground=step_at(0.0, height),
    )  # fmt: skip
    state = lying((v, 0.0, 0.0))
    state.q[0, 0] = -a * RADIUS - v * dt / 2 - CLOSED  # at the edge in the middle of the step
    end, _, _ = run(scene, state, 1)
    expected = [v * c * c, 0.0, v * a * c, 0.0, 0.0, 0.0]
    assert np.abs(end.u[0] - expected).max() < SPEED + 1e-9  # CLOSED over r tilts n by 2e-11


@each_method_and_step
def test_link_comes_to_rest_with_its_front_on_a_step(method, dt):
    # Both spheres rest on their cells when the axis has the slope sin = h/(2 L_GS).
    slope = math.asin(STEP / (2 * OFFSET))
    scene = link_scene(method, dt, friction=isotropic(0.5), ground=step_at(0.0))
    q = np.concatenate([[-0.01, 0.0, RADIUS + STEP / 2 + 1e-3], product(about(1, -slope), FLAT)])
    landed, history, _ = run(scene, State(q[None], np.zeros((1, 6))), math.ceil(0.1 / dt))
    # It lands with sqrt(2 g 1e-3) = 0.14 m/s, up to that times dt late.
    late = 0.15 * dt
    assert abs(landed.q[0, 2] - (RADIUS + STEP / 2)) < late
    axis = obstacles.rotation_matrices(landed.q[:, 3:])[0, :, 2]
    assert abs(2 * OFFSET * axis[2] - STEP) < 2 * late
    # Then it stays: no creep.
    end, _, _ = run(scene, landed, math.ceil(0.3 / dt), history)
    assert np.abs(end.u).max() < SPEED + ROUNDED
    assert np.abs(end.q - landed.q).max() < 0.3 * (SPEED + ROUNDED)


@each_method_and_step
def test_link_leans_on_an_edge(method, dt):
    # Pitched with its rear on the floor and its axis on the edge's side, held by friction: sphere
    # and edge are in contact off the vertical. tan of the contact normal is below mu: it rests.
    height, mu = 0.02, 1.0
    scene = link_scene(method, dt, friction=isotropic(mu), ground=step_at(0.0, height))
    inside = 0.25 * RADIUS  # the front sphere center is that far before the edge
    rise = height + math.sqrt(RADIUS**2 - inside**2) - RADIUS
    slope = math.asin(rise / (2 * OFFSET))
    center = -inside - OFFSET * math.cos(slope)
    middle = [center, 0.0, RADIUS + rise / 2 + CLOSED]
    q = np.concatenate([middle, product(about(1, -slope), FLAT)])
    state = State(q[None], np.zeros((1, 6)))
    gap, _, frame = obstacles.contact_geometry(scene, state.q)
    assert np.flatnonzero(gap <= 1e-9).tolist() == [1, 2]  # rear on the floor, front at the edge
    assert np.abs(frame[2, 0] - [-0.25, 0.0, math.sqrt(1 - 0.25**2)]).max() < 1e-9
    end, _, report = run(scene, state, math.ceil(0.1 / dt))
    assert report.contacts == 2
    assert np.abs(end.u).max() < SPEED + ROUNDED
    assert np.abs(end.q - state.q).max() < 0.1 * (SPEED + ROUNDED)


def thrown(method, seed, **settings):
    """Return a scene of random steps, and a link that is thrown onto them."""
    ground = random_ground(np.random.default_rng(seed), 0.06)
    dt = 1 / 400 if WITHOUT_COMPILER else 1 / 2000
    scene = link_scene(method, dt, friction=isotropic(0.3), ground=ground, **settings)
    scene = replace(scene, solver=replace(scene.solver, tolerance=1e-10))
    q = initial_coordinates(scene)
    q[0, 2] += 0.02
    u = np.random.default_rng([seed, 1]).uniform(-1.0, 1.0, (1, 6))
    return scene, State(q, u * [0.5, 0.5, 0.5, 2.0, 2.0, 2.0])


@pytest.mark.parametrize('method', [name for name in METHODS if name in MIDDLE])
def test_impacts_take_energy(method):
    # Links thrown over steps: contacts leave no more energy than the step without them has.
    for seed in range(3):
        scene, state = thrown(method, seed)
        stepper, history, zero = make_stepper(scene), empty_history(scene), references(scene, 1)
        closed = 0
        for _ in range(round(0.15 / scene.dt)):
            lifted = State(state.q + np.eye(7)[2], state.u)
            free, _, _ = stepper.advance(lifted, empty_history(scene), *zero)
            state, history, report = stepper.advance(state, history, *zero)
            closed += report.contacts
            most = kinetic_energy(scene.robot, free.u)
            assert kinetic_energy(scene.robot, state.u) < most + 1e-9
        assert closed > 0


@each_method
def test_impacts_take_energy_without_gravity(method):
    # Then nothing gives any, either: that holds for steps that start from two states, too. The
    # gyroscopic torque at the start of a step turns omega by (omega dt)^2/2 of it too far.
    for seed in range(3):
        scene, state = thrown(method, seed, gravity=(0.0, 0.0, 0.0))
        state.u[0, 2] = -0.5
        states, _, _ = course(scene, state, round(0.15 / scene.dt))
        energy = kinetic_energy(scene.robot, states.u)
        fastest = np.linalg.norm(states.u[:, 0, 3:], axis=-1).max()
        assert np.diff(energy).max() < (fastest * scene.dt) ** 2 * energy[0] + 1e-9
        assert energy[-1] < 0.9 * energy[0]


# ---- a robot on a step --------------------------------------------------------------------------


@only_compiled
def test_sidewinding_robot_climbs_a_step():
    scene = load_scene('step')
    simulation, there = travelled(scene)
    report, q = simulation.report, simulation.state.q
    assert report.unconverged == 0
    assert report.penetration_max < 1e-3
    # All of it is on the plateau: no sphere is below its height.
    gap, _, _ = obstacles.contact_geometry(scene, q)
    n = scene.robot.link_count
    assert gap[: 2 * n].min() > -1e-3
    assert q[:, 2].min() >= 0.02 + RADIUS - 1e-3
    assert there[1] < -0.5


# ---- refusals -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('values', 'expected'),
    [
        (
            {'heights': ((0.0, 0.1), (0.0,))},
            'heights must be rows of one length, got rows of 1 and of 2 numbers',
        ),
        ({'heights': ((0.0, math.nan),)}, 'heights must be finite, got nan m'),
        ({'heights': (0.0, 0.1)}, 'heights must be numbers, got 0.0'),
        ({'cell': 0.0}, 'cell must be above 0 m, got 0 m'),
        ({'origin': (0.0,)}, 'origin must have 2 components, got 1'),
    ],
)
def test_ground_that_is_refused(values, expected):
    with pytest.raises(ParameterError) as caught:
        Ground(**values)
    assert str(caught.value) == expected


def test_cells_smaller_than_a_sphere_are_refused():
    with pytest.raises(ParameterError) as caught:
        Scene(ground=Ground(heights=((0.1,),), cell=0.1))
    assert str(caught.value) == (
        'ground.cell must be at least twice the largest contact radius, 0.105 m, got 0.1 m'
    )
    assert Scene(ground=Ground(cell=0.1)).ground.cell == 0.1  # without cells nothing to fit on

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Worlds of solids: distances, one contact for each feature, seams, edges, and what cannot be."""

from dataclasses import replace
import math

import numpy as np
from obstacle_scenes import each_method
import pytest

from snake_sim_ros import Friction, ParameterError, Patches, Robot, run, Scene, Start
from snake_sim_ros.contact.placing import depth_of_robot, lift_out_of_world, world_geometry
from snake_sim_ros.contact.surroundings import make_surroundings, NEARBY
from snake_sim_ros.scene.chain import roll_pitch_yaw
from snake_sim_ros.scene.obstacles import contact_count, first_peg, OF_CAPSULE, OF_SPHERE
from snake_sim_ros.scene.parameters import (
    load_scene,
    scene_from_text,
    scene_to_text,
    with_settings,
)
from snake_sim_ros.scene.posture import initial_coordinates
from snake_sim_ros.scene.rotations import about, product, rotation_matrices
from snake_sim_ros.scene.world import (
    Box,
    EggCrate,
    HeightField,
    Pipe,
    Pole,
    Ramp,
    solids_of,
    Stairs,
    TriangleMesh,
    World,
)
from snake_sim_ros.stepping.methods import empty_history, make_stepper
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.stepping.state import initial_state, State

RADIUS = 0.05  # m
DT = 1e-3  # s
MOVES = np.array([0.8, 0.13, 0.0])  # m/s
ROUNDING = 1e-12  # of distances of about 1 m
BALL = Robot(link_count=1, contact_radius=RADIUS, contact_offset=0.0, inertia='consistent')
ROD = replace(BALL, contact_offset=0.2)  # a capsule with an axis of 0.4 m
FLUSH = World(boxes=tuple(Box(center=(x, 0.0, 0.1), size=(1.0, 1.0, 0.2)) for x in (0.0, 1.0)))
BLOCK = World(boxes=(Box(center=(0.0, 0.0, 0.1), size=(1.0, 1.0, 0.2)),))


def scene_of(world, robot=BALL, **settings):
    """Return a scene of one link without friction in a world."""
    return Scene(
        robot=robot, world=world, level='spatial', dt=DT,
        **{'friction': Friction(longitudinal=0.0, transversal=0.0), **settings},
    )  # fmt: skip


def at(center, along=(1.0, 0.0, 0.0)):
    """Return coordinates of one link, shape (1, 7), with its axis along a vector."""
    x, y, z = np.array(along) / np.linalg.norm(along)
    turn = product(about(2, math.atan2(y, x)), about(1, math.acos(z)))
    return np.array([[*center, *turn]])


def touching(world, center, along=(1.0, 0.0, 0.0), robot=BALL):
    """Return gaps and normals of the contacts of one link with a world, nearest first."""
    gap, _, frame, _ = world_geometry(scene_of(world, robot), at(center, along))
    if robot.contact_offset == 0.0:  # both spheres are one
        gap[2 + OF_SPHERE :] = np.inf
    found = np.flatnonzero(np.isfinite(gap))
    found = found[np.argsort(gap[found], kind='stable')]
    return gap[found], frame[found, 0]


def depth(world, center, along=(1.0, 0.0, 0.0), robot=BALL):
    """Return how deep one link is in a world [m]."""
    world, chain = make_surroundings(scene_of(world, robot)), robot.chain
    return depth_of_robot(world, chain.spheres, chain.capsules, at(center, along))


def motion(world, q, u, method, steps, robot=BALL, **settings):
    """Return the coordinates and velocities of one link after each of some steps."""
    scene = scene_of(world, robot, method=method, **settings)
    simulation = Simulation(scene)
    simulation.state = State(q.copy(), np.array([[*u, 0.0, 0.0, 0.0]]))
    states = []
    for _ in range(steps):
        simulation.advance(np.zeros((1, 0, 2)), np.zeros((1, 0, 2)))
        states.append(simulation.state)
    return np.array([s.q[0] for s in states]), np.array([s.u[0] for s in states])


# ---- distances ----------------------------------------------------------------------------------


def from_box(box, point):
    """Return the distance of a point outside from a box [m]."""
    local = roll_pitch_yaw(box.rpy).T @ (point - box.center)
    return np.linalg.norm(np.maximum(np.abs(local) - np.array(box.size) / 2, 0.0))


def from_segment(start, end, point):
    """Return the distance of a point from a straight line between two points [m]."""
    start, way = np.array(start), np.array(end) - start
    t = np.clip((point - start) @ way / (way @ way), 0.0, 1.0)
    return np.linalg.norm(point - start - t * way)


def from_triangle(corners, point):
    """Return the distance of a point from a triangle [m]."""
    a, b, c = corners
    weights, *_ = np.linalg.lstsq(np.column_stack([b - a, c - a]), point - a, rcond=None)
    if weights.min() >= 0.0 and weights.sum() <= 1.0:
        return np.linalg.norm(point - a - weights[0] * (b - a) - weights[1] * (c - a))
    return min(from_segment(*pair, point) for pair in ((a, b), (b, c), (c, a)))


def random_world(rng):
    """Return a box, a pole and a height field around the middle of a cube of 0.6 m."""
    heights = rng.uniform(0.0, 0.15, (7, 7))
    corner, size = rng.uniform(0.0, 0.6, (2, 3))
    return World(
        boxes=(Box(center=tuple(corner), size=tuple(0.02 + 0.4 * size), rpy=tuple(9 * size)),),
        poles=(Pole(start=tuple(rng.uniform(0, 0.6, 3)), end=tuple(rng.uniform(0, 0.6, 3)),
                    radius=0.03),),
        height_fields=(HeightField(heights=tuple(map(tuple, heights)), cell=0.1),),
    )  # fmt: skip


@pytest.mark.parametrize('seed', range(4))
def test_a_sphere_is_as_deep_as_the_nearest_solid_is_near(seed):
    rng = np.random.default_rng(seed)
    world = random_world(rng)
    (box,), (pole,), (field,) = world.boxes, world.poles, solids_of(world).meshes
    count = 0
    while count < 40:
        point = rng.uniform(0.0, 0.6, 3)
        low = math.floor(point[0] / 0.1), math.floor(point[1] / 0.1)
        local = roll_pitch_yaw(box.rpy).T @ (point - box.center)
        inside = (np.abs(local) < np.array(box.size) / 2).all()
        if inside or point[2] < 0.16 or max(low) > 5:
            continue
        near = min(
            from_box(box, point),
            from_segment(pole.start, pole.end, point) - pole.radius,
            *(from_triangle(field.vertices[face], point) for face in field.faces),
        )
        if near < 2e-3:
            continue
        count += 1
        robot = replace(BALL, contact_radius=near + 1e-3)
        assert abs(depth(world, point, robot=robot) - 1e-3) < ROUNDING
        gap, normal = touching(world, point, robot=robot)
        assert abs(gap.min() + 1e-3) < ROUNDING
        # A way away from what is nearest opens the gap by as much.
        away = point + 1e-4 * normal[0]
        assert abs(depth(world, away, robot=robot) - 9e-4) < 1e-7


@pytest.mark.parametrize('seed', range(4))
def test_normals_are_the_gradients_of_gaps(seed):
    # Central differences of a function with curvature radii above 1 mm, over 1e-6 m: 1e-9.
    rng = np.random.default_rng(seed)
    world, h, count = random_world(rng), 1e-6, 0
    while count < 20:
        point, reach = np.array([*rng.uniform(0.05, 0.55, 2), rng.uniform(0.0, 0.4)]), 0.2
        if depth(world, point, robot=replace(BALL, contact_radius=1e-3)) > 0.0:
            continue
        near = reach - depth(world, point, robot=replace(BALL, contact_radius=reach))
        if near < 2e-3:
            continue
        robot = replace(BALL, contact_radius=near)
        gap, normal = touching(world, point, robot=robot)
        if near > reach - 1e-3 or len(gap) != 1:
            continue
        count += 1
        slope = [
            (touching(world, point + way, robot=robot)[0][0]
             - touching(world, point - way, robot=robot)[0][0]) / (2 * h)
            for way in h * np.eye(3)
        ]  # fmt: skip
        assert np.abs(slope - normal[0]).max() < 1e-6


def test_a_sphere_in_a_pipe_and_on_it():
    pipe = Pipe(start=(0.0, 0.0, 1.0), end=(1.0, 0.0, 1.0), radius=0.2, inner=0.15)
    world = World(pipes=(pipe,))
    (gap,), (normal,) = touching(world, (0.5, 0.0, 0.9))
    assert abs(gap) < ROUNDING and np.allclose(normal, [0.0, 0.0, 1.0], atol=ROUNDING)
    (gap,), (normal,) = touching(world, (0.5, 0.15, 1.2))
    assert abs(gap) < ROUNDING and np.allclose(normal, [0.0, 0.6, 0.8], atol=ROUNDING)
    (gap,), (normal,) = touching(world, (-RADIUS, 0.17, 1.0))
    assert abs(gap) < ROUNDING and np.allclose(normal, [-1.0, 0.0, 0.0], atol=ROUNDING)
    (gap,), (normal,) = touching(world, (-0.04, 0.12, 1.0))
    assert abs(gap) < ROUNDING and np.allclose(normal, [-0.8, -0.6, 0.0], atol=ROUNDING)


# ---- one contact for each feature ---------------------------------------------------------------


def test_boxes_in_one_plane_are_one_floor():
    for x in (0.3, 0.49, 0.5 - 1e-6, 0.5 - 1e-13, 0.5, 0.5 + 1e-13, 0.5 + 1e-6, 0.51):
        gap, normal = touching(FLUSH, (x, 0.1, 0.25))
        assert len(gap) == 1 and abs(gap[0]) < ROUNDING
        assert np.allclose(normal, [0.0, 0.0, 1.0], rtol=0.0, atol=1e-11)


def test_flat_triangles_are_one_floor():
    world = World(height_fields=(HeightField(heights=((0.2,) * 21,) * 21, cell=0.05),))
    rng = np.random.default_rng(3)
    points = np.concatenate([rng.uniform(0.1, 0.9, (50, 2)), 0.05 * rng.integers(2, 18, (30, 2))])
    points = np.concatenate([points, points[50:] + 1e-13, points[50:] - [1e-6, 0.0]])
    for x, y in points:
        gap, normal = touching(world, (x, y, 0.25))
        assert len(gap) == 1 and abs(gap[0]) < ROUNDING
        assert np.allclose(normal, [0.0, 0.0, 1.0], rtol=0.0, atol=1e-11)


def test_neighbors_in_one_plane_leave_out_nothing():
    """What is not looked at beside a triangle in a plane makes no contact and no depth."""
    rng = np.random.default_rng(5)
    heights = np.full((41, 41), 0.2)
    heights[8:14, 8:14] += rng.uniform(-0.01, 0.01, (6, 6))  # rough
    heights[25, 25] += 1e-7  # almost level
    heights[:, 30:] += 0.03 * np.arange(11)  # a ramp
    field = HeightField(heights=tuple(map(tuple, heights.tolist())), cell=0.02)
    slab = Box(center=(0.15, 0.6, 0.1), size=(0.1, 0.1, 0.2))  # in the level of the field
    scene = scene_of(World(height_fields=(field,), boxes=(slab,)))
    world, shapes = (
        make_surroundings(scene),
        (scene.robot.chain.spheres, scene.robot.chain.capsules),
    )
    assert 0.3 < world.pieces.level.mean() < 0.8
    pieces = world.pieces._replace(level=np.zeros_like(world.pieces.level))
    all_round = world._replace(pieces=pieces)
    points = rng.uniform(-0.02, 0.82, (2000, 2))
    points[:400] = 0.02 * rng.integers(0, 41, (400, 2)) + rng.choice([0.0, 1e-13, 1e-9], (400, 2))
    found = 0
    for x, y in points:
        q = at((x, y, 0.2 + RADIUS + rng.choice([-1e-3, 0.0, 1e-4])))
        one, other = (world_geometry(scene, q, each) for each in (world, all_round))
        assert np.allclose(one[0], other[0], rtol=0.0, atol=ROUNDING)
        touch = np.isfinite(one[0])
        assert np.allclose(one[2][touch], other[2][touch], rtol=0.0, atol=1e-7)
        depths = [depth_of_robot(each, *shapes, q) for each in (world, all_round)]
        assert abs(depths[0] - depths[1]) < ROUNDING
        found += touch.any()
    assert found > 1000


def test_a_wall_of_bricks_is_one_wall():
    bricks = [
        Box(center=(0.0, 0.2 * j + 0.1 * (k % 2), 0.05 + 0.1 * k), size=(0.2, 0.2, 0.1))
        for j in range(5) for k in range(4)
    ]  # fmt: skip
    world = World(boxes=tuple(bricks))
    for z in (0.05, 0.1, 0.15, 0.2, 0.2 + 1e-13, 0.25):
        for y in (0.2, 0.3, 0.35, 0.4):
            gap, normal = touching(world, (0.15, y, z))
            assert len(gap) == 1 and abs(gap[0]) < ROUNDING
            assert np.allclose(normal, [1.0, 0.0, 0.0], rtol=0.0, atol=1e-11)


def test_a_corner_of_stairs_has_two_contacts_and_an_edge_one():
    world = World(stairs=(Stairs(count=3, rise=0.1, run=0.3),))
    gap, normal = touching(world, (0.3 - RADIUS, 0.0, 0.1 + RADIUS))
    assert len(gap) == 2 and np.abs(gap).max() < ROUNDING
    assert np.allclose(sorted(normal.tolist()), [[-1, 0, 0], [0, 0, 1]], atol=ROUNDING)
    over = RADIUS * math.sqrt(0.5)
    gap, normal = touching(world, (0.3 - over, 0.0, 0.2 + over))
    assert len(gap) == 1 and np.allclose(normal, [[-math.sqrt(0.5), 0.0, math.sqrt(0.5)]])


def test_nothing_is_touched_from_behind():
    # A plate of triangles, 10 mm thick: its far side is nearer than a radius.
    heights = ((0.01,) * 9,) * 9
    world = World(height_fields=(HeightField(heights=heights, cell=0.1),))
    gap, normal = touching(world, (0.42, 0.33, 0.01 + RADIUS))
    assert len(gap) == 1 and np.allclose(normal, [[0.0, 0.0, 1.0]])
    # From inside, where the center never is in a run, a solid pushes out where it is nearest.
    gap, normal = touching(world, (0.42, 0.33, 0.009))
    assert np.allclose(normal, [[0.0, 0.0, 1.0]]) and abs(gap[0] + RADIUS + 1e-3) < ROUNDING


def test_a_ball_beside_a_solid_is_not_in_it():
    # The triangles of its far side have bounds that the ball is in, and those of the near side
    # are farther than a radius.
    thin = World(ramps=(Ramp(run=1.0, rise=0.5, width=1.0, start=(0.0, 0.0, 0.0), heading=0.5),))
    for point in np.random.default_rng(4).uniform((-0.5, -1.0, RADIUS), (1.5, 1.0, 0.8), (300, 3)):
        gap, _ = touching(thin, point)
        assert depth(thin, point) == pytest.approx(max(0.0, -min(gap, default=0.0)), abs=1e-12)


@pytest.mark.parametrize('seed', range(3))
def test_sharp_corners_are_seen_from_outside(seed):
    # The triangle that such a point faces most is turned away from it.
    rng, count = np.random.default_rng(seed), 0
    while count < 5:
        heights = rng.uniform(0.05, 0.5, (3, 3))
        world = World(height_fields=(HeightField(heights=tuple(map(tuple, heights)), cell=0.1),))
        (field,) = solids_of(world).meshes
        for k, corner in enumerate(field.vertices):
            faces = field.faces[(field.faces == k).any(axis=1)]
            a, b, c = field.vertices[faces.T]
            normal = np.cross(b - a, c - a)
            normal /= np.linalg.norm(normal, axis=1, keepdims=True)
            way = rng.normal(size=(300, 3))
            way *= 0.01 / np.linalg.norm(way, axis=1, keepdims=True)
            nearest = (way @ (field.vertices[faces.ravel()] - corner).T <= 0.0).all(axis=1)
            beside = np.abs(corner[:2] + way[:, :2] - 0.1).max(axis=1) > 0.1  # the field
            facing = way @ normal.T
            most = np.take_along_axis(facing, np.abs(facing).argmax(axis=1)[:, None], 1)[:, 0]
            for d in way[beside & nearest & (most < 0.0) & (corner[2] > 0.02)][:2]:
                count += 1
                assert abs(depth(world, corner + d) - (RADIUS - 0.01)) < ROUNDING


def test_a_capsule_has_few_contacts():
    up = [0.0, 0.0, 1.0]
    # Across a box that is shorter: on two edges, also when it is tilted a little.
    narrow = World(boxes=(Box(center=(0.0, 0.0, 0.1), size=(0.2, 1.0, 0.2)),))
    for tilt in (0.0, 1e-7, -1e-7):
        gap, normal = touching(narrow, (0.0, 0.1, 0.25), (1.0, 0.0, tilt), ROD)
        assert len(gap) == 2 and np.abs(gap).max() < 2e-8
        assert np.allclose(normal, [up, up], atol=2e-7)
    # On a long one: on both ends, with nothing between, on boxes or on triangles.
    field = World(height_fields=(HeightField(heights=((0.2,) * 41,) * 41, cell=0.025),))
    for world, x in ((FLUSH, 0.45), (field, 0.5)):
        gap, normal = touching(world, (x, 0.4, 0.25), (1.0, 0.2, 0.0), ROD)
        assert len(gap) == 2 and np.allclose(normal, [up, up], atol=1e-11)
    # Over the edge of one: an end and the edge.
    gap, normal = touching(BLOCK, (0.45, 0.1, 0.25), (1.0, 0.0, 0.0), ROD)
    assert len(gap) == 2 and np.allclose(normal, [up, up], atol=1e-11)


def test_a_capsule_in_a_groove_has_both_ends_on_both_sides():
    groove = World(
        boxes=tuple(
            Box(center=(0.0, side * 0.5, 0.3), size=(2.0, 1.6, 0.2), rpy=(side * 0.7, 0.0, 0.0))
            for side in (-1.0, 1.0)
        )
    )
    # n (p - c) = 0.1 m + r for the normal (0, -sin, cos) of the upper side.
    height = 0.3 + (0.1 + RADIUS - 0.5 * math.sin(0.7)) / math.cos(0.7)
    scene, q = scene_of(groove, ROD), at((0.0, 0.0, height))
    gap, _, frame, _ = world_geometry(scene, q)
    near = np.abs(gap) < 1e-9
    assert near.sum() == 4 and np.isfinite(gap).sum() == 4
    assert np.allclose(np.abs(frame[near, 0, 1]), math.sin(0.7), atol=1e-9)


def test_a_capsule_meets_edges_corners_and_poles_between_its_ends():
    corner = World(boxes=(Box(center=(0.0, 0.0, 0.0), size=(0.2, 0.2, 0.2), rpy=(0.9, 0.6, 0)),))
    axes = roll_pitch_yaw((0.9, 0.6, 0.0))
    tips = [axes @ (0.1 * (2.0 * np.array(s) - 1.0)) for s in np.ndindex(2, 2, 2)]
    tip = max(tips, key=lambda p: p[2])
    gap, normal = touching(corner, tip + RADIUS * np.eye(3)[2], (0.8, 0.6, 0.0), ROD)
    assert len(gap) == 1 and abs(gap[0]) < ROUNDING and np.allclose(normal, [[0, 0, 1]])
    pole = World(poles=(Pole(start=(0.1, -1.0, 1.0), end=(0.1, 1.0, 1.0), radius=0.03),))
    gap, normal = touching(pole, (0.0, 0.0, 1.08), (1.0, 0.0, 0.0), ROD)
    assert len(gap) == 1 and abs(gap[0]) < ROUNDING and np.allclose(normal, [[0, 0, 1]])


@each_method
@pytest.mark.parametrize('poles', [OF_SPHERE, OF_SPHERE + 1])
def test_contacts_without_a_number_are_counted(method, poles):
    # A ball in the air that upright poles all around it touch.
    reach, turns = RADIUS + 0.01, np.linspace(0.0, 2.0 * math.pi, poles, endpoint=False)
    feet = [(reach * math.cos(turn), reach * math.sin(turn)) for turn in turns]
    cage = World(
        poles=tuple(Pole(start=(x, y, 0.1), end=(x, y, 2.0), radius=0.01) for x, y in feet)
    )
    simulation = Simulation(scene_of(cage, method=method))
    simulation.state = State(at((0.0, 0.0, 1.0)), np.zeros((1, 6)))
    report = simulation.advance(*simulation.gait_reference(3))
    assert report.overflows == (3 if poles > OF_SPHERE else 0)
    assert simulation.report.overflows == report.overflows


# ---- motion -------------------------------------------------------------------------------------


@each_method
def test_a_sphere_slides_over_seams_without_losing_speed(method):
    field = World(
        height_fields=(HeightField(heights=((0.2,) * 31,) * 11, cell=0.05, origin=(-0.5, -0.25)),)
    )
    for world in (FLUSH, field):
        q, u = motion(world, at((0.3, 0.1, 0.25)), MOVES, method, 400)
        assert np.abs(u[:, :2] - MOVES[:2]).max() < 1e-9
        assert np.abs(q[:, 2] - 0.25).max() < 1e-6


@pytest.mark.parametrize('method', ['newton', 'bdf2'])
def test_a_ball_that_lands_in_a_shallow_groove_is_not_moved_sideways(method):
    # It hits the right side of a groove and leaves the left one, in which it is by less in the
    # middle of the step. To touch both, it would have to move by 1.5 mm.
    slope, beside, speed = 0.03, 1e-3, 0.5
    sides = []
    for side in (-1.0, 1.0):
        R = roll_pitch_yaw((0.0, -side * slope, 0.0))
        center = np.array([0.0, 0.0, 0.3]) + R @ (side * 0.5, 0.0, -0.1)
        sides.append(Box(center=center, size=(1.0, 1.0, 0.2), rpy=(0.0, -side * slope, 0.0)))
    height = 0.3 + (RADIUS + 1e-9 + beside * math.sin(slope)) / math.cos(slope)
    start = at((beside, 0.0, height))
    q, u = motion(World(boxes=tuple(sides)), start, [speed, 0.0, -1.0], method, 1)
    moved = q[0, 0] - beside - DT * (speed + u[0, 0]) / 2
    # It is moved out along the normal by half of the way of a step.
    assert abs(moved) < 0.6 * DT * math.sin(slope)


@each_method
def test_a_sphere_falls_over_an_edge_as_a_ball_on_a_point_does(method):
    # Without friction, energy is kept as long as it touches the edge and in flight.
    q, u = motion(BLOCK, at((0.47, 0.1, 0.25)), [0.3, 0.0, 0.0], method, 250)
    energy = 0.5 * (u[:, :3] ** 2).sum(axis=1) + 9.81 * q[:, 2]
    # Steps of first order lose or gain v^2/2 times dt v/r = 0.006 of it.
    assert np.abs(energy - energy[0]).max() < 1e-2 * 0.5 * 0.3**2
    assert q[-1, 0] > 0.54 and np.abs(u[:, 1]).max() < 1e-9


@each_method
def test_friction_is_that_of_the_solid_and_of_the_patch(method):
    world = replace(BLOCK, boxes=(replace(BLOCK.boxes[0], grip=2.0),))
    friction = Friction(longitudinal=0.1, transversal=0.1)
    particle = replace(BALL, contact_radius=1e-6, inertia='as_printed')
    start = at((0.0, 0.0, 0.2 + 1e-6))
    for factor in (1.0, 1.5):
        patches = Patches(factors=((factor,) * 2,) * 2, cell=1.0, origin=(-1.0, -1.0))
        settings = {'friction': friction, 'patches': patches, 'robot': particle}
        _, u = motion(world, start, [0.4, 0.0, 0.0], method, 100, **settings)
        # The particle slides with mu g; the first step of a method may begin with less load.
        assert abs(u[-1, 0] - (0.4 - 0.2 * factor * 9.81 * 0.1)) < 3e-3


@each_method
def test_a_rod_rests_across_a_box(method):
    narrow = World(boxes=(Box(center=(0.0, 0.0, 0.1), size=(0.2, 1.0, 0.2)),))
    q, u = motion(narrow, at((0.03, 0.1, 0.25)), [0.0, 0.0, 0.0], method, 200, ROD)
    assert np.abs(u).max() < 1e-5 and np.abs(q[:, 2] - 0.25).max() < 1e-6


@pytest.mark.parametrize('seed', range(3))
def test_a_robot_moves_in_a_random_world_without_entering_it(seed):
    rng = np.random.default_rng(seed)
    place = lambda low, high: tuple(rng.uniform((-0.6, -0.6, low), (0.6, 0.6, high)))  # noqa: E731
    world = World(
        boxes=tuple(
            Box(center=place(0.0, 0.1), size=tuple(rng.uniform(0.05, 0.4, 3)), rpy=place(-3, 3))
            for _ in range(4)
        ),
        poles=(Pole(start=place(0.0, 0.1), end=place(0.1, 0.4)),),
        egg_crates=(EggCrate(amplitude=0.02, wavelength=0.3, size=(3.0, 3.0)),),
    )
    scene = replace(load_scene('sidewinding'), world=world, method='bdf2', dt=1 / 200)
    simulation = Simulation(scene)
    report = simulation.advance(*simulation.gait_reference(200))
    assert not report.failure and report.unconverged == 0
    # Gaps that are closed are at most 1e-6 m, and parts that end deeper are repeated.
    assert report.penetration_max < 1e-5


# ---- start --------------------------------------------------------------------------------------


def test_robots_start_beside_all_solids():
    crate = World(egg_crates=(EggCrate(amplitude=0.03, wavelength=0.3, size=(3.0, 3.0)),))
    for world in (crate, World(stairs=(Stairs(start=(0.3, 0.0, 0.0)),)), World(ramps=(Ramp(),))):
        scene = Scene(world=world)
        q, chain = initial_state(scene).q, scene.robot.chain
        inside = depth_of_robot(make_surroundings(scene), chain.spheres, chain.capsules, q)
        assert inside <= 1e-10 and q[0, 2] > initial_coordinates(scene)[0, 2]
        above = with_settings(scene, {'start.height': 0.2})
        assert abs(initial_state(above).q[0, 2] - q[0, 2] - 0.2) < ROUNDING


@pytest.mark.parametrize(
    ('wall', 'top'),
    [
        (World(boxes=(Box(center=(0.0, 0.0, 0.1), size=(0.001, 2.0, 0.4)),)), 0.3),
        (World(ramps=(Ramp(start=(-0.005, 0.0, 0.0), run=0.01, rise=0.3, width=2.0),)), 0.3),
        (World(pipes=(Pipe(start=(0, -1, 0), end=(0, 1, 0), radius=0.101, inner=0.1),)), 0.101),
    ],
)
def test_no_wall_goes_through_a_link_at_its_start(wall, top):
    # A rod along x at z = RADIUS, both ends of which are far from the wall, is lifted onto it.
    lift = lift_out_of_world(scene_of(wall, ROD), at((0.0, 0.0, RADIUS)))
    assert lift == pytest.approx(top, abs=1e-7)


def test_a_robot_starts_inside_of_a_pipe_not_on_it():
    pipe = Pipe(start=(-2.0, 0.0, 0.2), end=(2.0, 0.0, 0.2), radius=0.2, inner=0.18)
    q = initial_state(Scene(world=World(pipes=(pipe,)), start=Start(yaw=0.0))).q
    # A link along the pipe rests where its axis is 0.18 m - 0.0525 m below that of the pipe.
    assert abs(q[5, 2] - (0.2 - 0.18 + 0.0525)) < 1e-9


def test_a_robot_starts_upright():
    scene = Scene(robot=Robot(link_count=3), start=Start(yaw=0.0, tilt=math.pi / 2))
    q = initial_coordinates(scene)
    assert np.allclose(q[:, :2], 0.0, atol=1e-12) and abs(q[1, 2] - q[0, 2] - 0.122) < 1e-12
    assert abs(q[0, 2] - 0.0393 - 0.0525) < 1e-12
    assert np.allclose(rotation_matrices(q[:, 3:])[:, 2, 2], 1.0)


def test_contacts_are_numbered():
    scene = Scene(world=BLOCK)
    assert first_peg(scene) == contact_count(scene) == 22 + 22 * OF_SPHERE + 11 * OF_CAPSULE
    assert NEARBY < 1e-3


# ---- scenes -------------------------------------------------------------------------------------


def test_worlds_are_written_and_read():
    scene = Scene(
        world=World(
            boxes=(Box(rpy=(0.1, 0.2, 0.3), grip=0.5),), stairs=(Stairs(),), ramps=(Ramp(),),
            poles=(Pole(),), pipes=(Pipe(),), egg_crates=(EggCrate(),),
            height_fields=(HeightField(heights=((0.0, 0.1), (0.2, 0.3))),),
        )
    )  # fmt: skip
    assert scene_from_text(scene_to_text(scene)) == scene


def test_heights_are_read_from_files(tmp_path):
    heights = np.array([[0.0, 0.1, 0.2], [0.3, 0.4, 0.5]])
    np.savez(tmp_path / 'field.npz', heights=heights)
    text = 'world: {height_fields: [{file: field.npz, cell: 0.1}]}'
    (tmp_path / 'scene.yaml').write_text(text, encoding='utf-8')
    (field,) = load_scene(tmp_path / 'scene.yaml').world.height_fields
    assert np.array_equal(field.points(), heights)
    image = pytest.importorskip('PIL.Image')
    image.fromarray(np.array([[255, 0], [0, 51]], dtype=np.uint8)).save(tmp_path / 'field.png')
    points = HeightField(file=str(tmp_path / 'field.png'), white=0.5).points()
    assert np.allclose(points, [[0.0, 0.1], [0.5, 0.0]])


def test_meshes_are_read_from_files(tmp_path):
    trimesh = pytest.importorskip('trimesh')
    box = trimesh.creation.box((1.0, 1.0, 0.2))
    box.apply_translation((0.0, 0.0, 0.1))
    for name in ('box.stl', 'box.obj'):
        box.export(tmp_path / name)
        world = World(meshes=(TriangleMesh(file=str(tmp_path / name)),))
        for center, along, robot in (
            ((0.2, 0.1, 0.25), (1, 0, 0), BALL),
            ((0.52, 0.1, 0.23), (1, 0, 0), BALL),
            ((0.45, 0.1, 0.25), (1, 0, 0), ROD),
        ):
            gap, normal = touching(world, center, along, robot)
            wanted_gap, wanted = touching(BLOCK, center, along, robot)
            assert np.allclose(gap, wanted_gap, atol=1e-8) and np.allclose(normal, wanted)


@pytest.mark.parametrize(
    ('make', 'message'),
    [
        (lambda: Box(size=(1.0, 0.0, 1.0)), 'size must be at least 0.0001 m, got 0 m'),
        (lambda: Box(center=(1.0, 0.0)), 'center must have 3 components, got 2'),
        (lambda: Pole(end=(0.0, 0.0, 0.0)), 'start and end must be at least 0.0001 m apart'),
        (lambda: Pipe(inner=0.2), 'inner must be at least 0.0001 m below radius, 0.15 m'),
        (lambda: Stairs(count=0), 'count must be at least 1, got 0'),
        (lambda: HeightField(heights=((0.0, 1.0), (0.0,))), 'heights must be rows of one length'),
        (lambda: HeightField(heights=((0.0, 1.0),)), 'heights must be 2 rows of 2 num'),
        (lambda: HeightField(heights=((0.0, -1.0),) * 2), 'heights must be at least 0 m, got -1'),
        (lambda: HeightField(file='a.tif'), "file must end in .npz or .png, got a.tif"),
        (lambda: HeightField(file='no.npz').points(), 'no.npz: '),
        (lambda: TriangleMesh(), 'file must be that of a mesh, got none'),
        (lambda: solids_of(World(meshes=(TriangleMesh(file='no.stl'),))), 'no file no.stl'),
        (lambda: EggCrate(size=(900.0, 900.0), cell=0.001), 'an egg crate must have at most'),
        (lambda: with_settings(Scene(world=BLOCK), {'ground.heights': ((0.1,),)}),
         'ground.heights must be empty in a scene with a world'),
        (lambda: Scene(world={'bokses': ()}), 'world must be a mapping'),
        (lambda: scene_from_text('world: {bokses: []}'), "unknown key 'bokses'; did you mean"),
        (lambda: scene_from_text('world: {boxes: [{rpy_deg: [0, 0]}]}'), 'rpy must have 3'),
    ],
)  # fmt: skip
def test_what_cannot_be_is_said_in_a_sentence(make, message):
    with pytest.raises(ParameterError) as error:
        make()
    assert message in str(error.value)


def test_a_robot_that_fits_nowhere_is_refused():
    tower = World(boxes=(Box(center=(0.0, 0.0, 0.0), size=(9.0, 9.0, 1e6)),))
    with pytest.raises(ParameterError, match='must fit beside the solids of the world'):
        initial_state(Scene(world=tower))


def test_stepper_of_a_world_has_a_history():
    scene = scene_of(BLOCK)
    assert make_stepper(scene) is not None and len(empty_history(scene).impulse) == 1 * 2 + 16


@pytest.mark.parametrize('method', ['newton', 'bdf2'])
def test_a_helix_climbs_inside_a_pipe(method):
    climb = run(
        'pipe_climb', duration=4.0, method=method, dt=1 / (1000 if method == 'newton' else 200)
    )
    height = climb.position[:, :, 2].mean(axis=1)
    assert climb.report.unconverged == 0
    # Both, and shorter steps, climb 0.306 m: each link rolls on the wall.
    assert height[-1] - height[0] == pytest.approx(0.306, abs=0.005)

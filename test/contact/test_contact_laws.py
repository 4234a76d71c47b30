# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Projections on the sets of admissible impulses: nearest points, and the laws that follow."""

import math

import numpy as np
import pytest
from random_states import EPS
from scenes import MASS
from schemes import press_of, span, step_of, undisturbed

from snake_sim_ros import Friction, Robot, Scene, Simulation, Solver, State
from snake_sim_ros.contact.laws import prox_disc, prox_ellipse, prox_half_line
from snake_sim_ros.dynamics import force_directions
from snake_sim_ros.scene.parameters import load_scene, STICKY, with_settings
from snake_sim_ros.scene.posture import chain_coordinates
from snake_sim_ros.stepping.methods import make_stepper, METHODS

# A projection is exact up to rounding: the root t to sqrt(1e-8)^2, then three products.
ROUNDING = 8 * EPS
HALF_AXES = [
    (scale * x, scale * y)
    for scale in (1e-6, 1.0, 1e6)
    for ratio in (1.0, 1.001, 5.0, 100.0, 1e4)
    for x, y in ((1.0, ratio), (ratio, 1.0))
]


def size(*numbers):
    return max(abs(number) for number in numbers)


def points_around(rng, a, b, count):
    """Yield points from well inside to far outside the ellipse, in all directions."""
    for _ in range(count):
        angle, radius = rng.uniform(0, 2 * math.pi), 10 ** rng.uniform(-2, 2)
        yield radius * a * math.cos(angle), radius * b * math.sin(angle)
        # Round about the long half axis in place of along both.
        length = radius * max(a, b)
        yield length * math.cos(angle), length * math.sin(angle)


@pytest.mark.parametrize(
    ('point', 'expected'),
    [
        # (x a^2/(t + a^2), y b^2/(t + b^2)), t by bisection of the ellipse's equation there.
        ((0.3, 0.4), (0.0706199903319633, 0.35400624872710273)),
        ((1.0, 1.0), (0.03422950939854934, 0.4697962506857261)),
        ((0.05, 0.6), (0.00819504416439703, 0.49831820283689177)),
        # Inside nothing changes: (0.6)^2 + (0.6)^2 < 1.
        ((0.06, 0.3), (0.06, 0.3)),
        ((0.0, 0.0), (0.0, 0.0)),
        # Outside on an axis the vertex is nearest, at any distance.
        ((0.1001, 0.0), (0.1, 0.0)),
        ((-7.0, 0.0), (-0.1, 0.0)),
        ((0.0, 0.51), (0.0, 0.5)),
        ((0.0, -9.0), (0.0, -0.5)),
    ],
)
def test_ellipse_values(point, expected):
    for flip in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
        result = prox_ellipse(flip[0] * point[0], flip[1] * point[1], 0.1, 0.5)
        assert np.abs(result - np.multiply(flip, expected)).max() < ROUNDING
    # Exchanging the axes exchanges the components.
    assert (
        np.abs(np.subtract(prox_ellipse(*point[::-1], 0.5, 0.1), expected[::-1])).max() < ROUNDING
    )


@pytest.mark.parametrize(('a', 'b'), HALF_AXES)
def test_ellipse_finds_the_foot_of_a_normal(a, b):
    rng = np.random.default_rng(1)
    angles = np.concatenate([rng.uniform(0, 2 * math.pi, 100), np.arange(4) * math.pi / 2])
    for angle in angles:
        foot = np.array([a * math.cos(angle), b * math.sin(angle)])
        normal = np.array([math.cos(angle) / a, math.sin(angle) / b])
        for distance in 10.0 ** rng.uniform(-4, 4, 3):
            x = foot + distance * max(a, b) * normal / np.linalg.norm(normal)
            error = np.abs(prox_ellipse(*x, a, b) - foot).max()
            # The point itself is rounded, and a projection does not make that larger.
            assert error < ROUNDING * size(*x, a, b)


@pytest.mark.parametrize(('a', 'b'), HALF_AXES)
def test_ellipse_is_a_projection(a, b):
    rng = np.random.default_rng(2)
    points = list(points_around(rng, a, b, 100))
    images = [prox_ellipse(*point, a, b) for point in points]
    boundary = rng.uniform(0, 2 * math.pi, 50)
    boundary = np.column_stack([a * np.cos(boundary), b * np.sin(boundary)])
    for point, image in zip(points, images, strict=True):
        # In the set. A relative error of the half axes.
        assert math.hypot(image[0] / a, image[1] / b) - 1 < ROUNDING
        # Idempotent: the image is on the edge up to rounding, so it moves by no more than that.
        assert np.abs(np.subtract(prox_ellipse(*image, a, b), image)).max() < ROUNDING * size(a, b)
        # Variational inequality: (x - prox x) . (z - prox x) <= 0 for all z of the set.
        x = np.subtract(point, image)
        products = (boundary - image) @ x
        assert products.max() < ROUNDING * size(*point, a, b) * size(a, b)
        # A point of the set is its own image, exactly.
        if math.hypot(point[0] / a, point[1] / b) < 1 - ROUNDING:
            assert image == point
    # Non-expansive: |prox x - prox y| <= |x - y|.
    for i, j in rng.integers(len(points), size=(100, 2)):
        before = math.dist(points[i], points[j])
        rounding = ROUNDING * size(*points[i], *points[j], a, b)
        assert math.dist(images[i], images[j]) < before + rounding


@pytest.mark.parametrize('radius', [1e-6, 0.3, 1e6])
def test_disc_is_a_projection(radius):
    rng = np.random.default_rng(3)
    for x, y in points_around(rng, radius, radius, 200):
        length = math.hypot(x, y)
        # The nearest point is on the same ray: x min(1, radius/|x|).
        expected = np.multiply(min(1.0, radius / length), (x, y))
        assert np.abs(prox_disc(x, y, radius) - expected).max() < 4 * EPS * radius
        # An ellipse with equal half axes is this disc, one with half axes that differ by a part in
        # 1e9 differs from it by that much.
        equal = prox_ellipse(x, y, radius, radius)
        assert np.abs(equal - expected).max() < 4 * EPS * radius
        nearly = prox_ellipse(x, y, radius, radius * (1 + 1e-9))
        assert np.abs(nearly - expected).max() < 1.1e-9 * radius


def test_half_line_is_a_projection():
    # max(0, x), eqs. (52)-(54)
    assert [prox_half_line(x) for x in (-2.0, -1e-300, 0.0, 1e-300, 3.0)] == [0, 0, 0, 1e-300, 3]


def test_no_friction_or_no_normal_impulse_leaves_nothing():
    rng = np.random.default_rng(4)
    for x, y in [(0.0, 0.0), *rng.standard_normal((50, 2))]:
        # The set is a point: mu = 0 or P_N = 0.
        assert prox_ellipse(x, y, 0.0, 0.0) == (0.0, 0.0)
        assert prox_disc(x, y, 0.0) == (0.0, 0.0)
        # The set is a segment: friction along one axis only.
        assert prox_ellipse(x, y, 0.4, 0.0) == (min(max(x, -0.4), 0.4), 0.0)
        assert prox_ellipse(x, y, 0.0, 0.4) == (0.0, min(max(y, -0.4), 0.4))


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
def test_projections_end_for_values_that_are_not_finite(bad):
    # What a diverging step hands over; an iteration that does not end would hang the program.
    for arguments in ((bad, 1.0, 0.1, 0.5), (1.0, bad, 0.1, 0.5), (1.0, 1.0, bad, 0.5)):
        assert len(prox_ellipse(*arguments)) == 2
    assert len(prox_disc(bad, 1.0, 0.5)) == 2


def solved(prox):
    """Return the fixed point of a contraction with a factor below 0.987: 0.987^4000 = 1e-23."""
    point = np.zeros(2)
    for _ in range(4000):
        point = prox(point)
    return point


def sliding_contact(seed):
    """Return G with eigenvalues from 0.5 to 2.5 per kg, free velocity, coefficients and P_N."""
    rng = np.random.default_rng(seed)
    root = rng.uniform(-1, 1, (2, 2))
    G, c = root @ root.T + 0.5 * np.eye(2), rng.uniform(-1, 1, 2)
    return G, c, rng.uniform(0.3, 1.0, 2), rng.uniform(0.1, 2.0)


@pytest.mark.parametrize('seed', range(20))
def test_sliding_law_and_its_scaled_disc_have_one_solution(seed):
    G, c, mu, P_N = sliding_contact(seed)
    # r = 0.3 kg makes both iterations contractions: |1 - r G| and |1 - r S G S| stay below
    # 1 - 0.3 0.5 0.3^2 = 0.987.
    r = 0.3
    P = solved(lambda P: np.array(prox_ellipse(*(P - r * (G @ P + c)), *(mu * P_N))))
    # The same law without an ellipse: P = S prox_disc(S^-1 P - r S gamma), S = diag(mu), whose
    # iterates differ but not its fixed points.
    disc = solved(lambda P: mu * prox_disc(*(P / mu - r * mu * (G @ P + c)), P_N))
    # 1/(1 - 0.987) = 77 times the rounding of one iteration on numbers up to 2.
    bound = 77 * 16 * EPS
    assert np.abs(P - disc).max() < bound
    gamma = G @ P + c
    if math.hypot(*(P / mu)) < P_N * (1 - 1e-9):
        assert np.abs(gamma).max() < bound / r  # sticks: r gamma is the last change
    else:
        # Slides: P = -P_N (mu_x^2 gamma_x, mu_y^2 gamma_y)/sqrt(mu_x^2 gamma_x^2 + ...), and the
        # power lost is P_N times this root, by which the error of gamma is divided.
        root = math.hypot(*(mu * gamma))
        assert np.abs(P + P_N * mu**2 * gamma / root).max() < bound * max(1.0, P_N / root)
        assert abs(P @ gamma + P_N * root) < bound


def test_both_sticking_and_sliding_were_solved():
    # Guards the seeds above. Sticking takes P = -G^-1 c, if friction can bring it up.
    sticks = 0
    for G, c, mu, P_N in map(sliding_contact, range(20)):
        sticks += math.hypot(*(np.linalg.solve(G, c) / mu)) < P_N
    assert 3 <= sticks <= 17


@pytest.mark.parametrize('delta', [0.0, 1e-4])
@pytest.mark.parametrize('velocity', [(0.5, 0.3), (-0.2, 0.05), (0.0, 0.001), (1e-5, 1e-4)])
@pytest.mark.parametrize('method', METHODS)
def test_a_solved_step_satisfies_the_scaled_disc_law(method, velocity, delta):
    # One link on the floor, with the velocities of all its contacts from the dense directions.
    # Of the two spheres of one body the sliding rows are dependent, so only the law is compared.
    tolerance = 1e-13  # N s
    scene = Scene(
        robot=Robot(link_count=1),
        friction=Friction(longitudinal=0.1, transversal=0.5),
        solver=Solver(
            tolerance=tolerance,
            residual_tolerance=tolerance / 0.01,  # of a sliding velocity, r_T = 0.01 kg
            iteration_limit=100_000,
            normal_compliance=delta,
        ),
        method=method,
        level='spatial',
    )
    q = chain_coordinates(scene.robot, np.zeros((0, 2)))
    q[:, 2] = scene.robot.contact_radius - 1e-9
    start = State(q, np.array([[*velocity, 0.0, 0.0, 0.0, 0.0]]))
    zero, before = np.zeros((1, 0, 2)), undisturbed(scene, start)
    step = step_of(scene, start, before, zero[0], zero[0])
    end, history, report = make_stepper(scene).advance(start, before, zero, zero)
    assert (report.contacts, report.unconverged) == (2, 0)
    assert (step.active == [0, 1]).all()
    gammas, compliance = step.gamma(end.u), delta * force_directions.mean_delassus(scene.robot)
    mu, r = np.array([0.1, 0.5]), scene.solver.r_sliding
    for P, gamma in zip(history.impulse, gammas[:, 1:3], strict=True):
        scaled = mu * prox_disc(*(P[1:3] / mu - r * mu * gamma), P[0])
        # A step changes the impulses by less than the tolerance. From the residual of one law to
        # that of the other: a factor up to 1/mu_x^2 = 100.
        assert np.abs(scaled - P[1:3]).max() < 100 * tolerance
    # Normal law: gamma_N + c P_N vanishes, up to the tolerance over r_N or the residual. c is less
    # where the rule would press in more than it may if a contact carried half of a link.
    expected = -MASS * scene.gravity[2] / 2 * span(scene)
    P_N, c = history.impulse[:, 0], min(compliance, press_of(scene) / expected)
    assert (P_N > 0).all()
    assert np.abs(gammas[:, 0] + c * P_N).max() < scene.solver.residual_tolerance


@pytest.mark.parametrize('mu', [5e-324, 1e-170, STICKY])
def test_friction_of_any_size_is_usable(mu):
    friction = {f'friction.{name}': mu for name in ('longitudinal', 'transversal', 'rolling')}
    simulation = Simulation(with_settings(load_scene('lateral_undulation'), friction))
    report = simulation.advance(*simulation.gait_reference(40))
    assert not report.failure
    assert report.unconverged == 0

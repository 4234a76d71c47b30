# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The cones of friction, and the central path of stored hard steps that leads to their laws."""

from functools import cache
import math

from hard_contacts import load_hard_steps
import numpy as np
import pytest

from snake_sim_ros.contact import newton
from snake_sim_ros.contact.central_path import (
    begin_path,
    cone_det,
    divided,
    follow_path,
    residual_on_path,
    scaled_once,
    scaled_twice,
    velocity_of,
    way_to_edge,
)
from snake_sim_ros.contact.delassus import end_twists
from snake_sim_ros.dynamics.articulated_body import factor_chain, reset_chain
from snake_sim_ros.dynamics.balance import axis_loads
from snake_sim_ros.scene.parameters import with_settings
from snake_sim_ros.stepping.methods import make_stepper

REFLECTION = np.diag([1.0, -1.0, -1.0])
SIDES = 'curled, friction 1.5'  # here with less friction forward and, by half, backward
STEPS = {  # with contacts on the floor, with cells and pegs, between links, and dry joints
    'sinus lifting, friction 1.5': 1,
    'wedged, friction 1.5': 0,
    'curled, friction 1': 0,
    'cells and pegs, curled': 4,
    'joint friction': 1,
    SIDES: 0,
}


def inside(rng):
    """Return a random number of the cone."""
    x = rng.normal(size=3)
    x[0] = math.hypot(*x[1:]) * (1.0 + 10.0 ** rng.uniform(-6.0, 2.0))
    return x


@cache
def problem_of(name):
    """Return the contact problem of a stored step, as Newton's method is given it."""

    class FoundError(Exception):
        pass

    def stop(problem, limit, operator):
        raise FoundError(problem)

    step = load_hard_steps()[name][STEPS[name]]
    sides = {'friction.longitudinal': 0.7, 'friction.backward': 1.05} if name == SIDES else {}
    stepper, iterate = make_stepper(with_settings(step.scene, sides)), newton.iterate
    newton.iterate = stop
    try:
        stepper.advance(step.state, step.history, step.angle[None], step.rate[None])
    except FoundError as found:
        return found.args[0]
    finally:
        newton.iterate = iterate


@pytest.mark.parametrize('seed', range(20))
def test_the_way_to_the_edge_ends_there(seed):
    rng = np.random.default_rng(seed)
    x, d = inside(rng), rng.normal(size=3)
    way = way_to_edge(tuple(x), tuple(d))
    if way < 1e9:
        end = x + way * d
        assert abs(end[0] - math.hypot(*end[1:])) < 1e-9 * np.abs(end).max()
    for share in (0.5, 0.999):
        assert cone_det(tuple(x + share * min(way, 1e3) * d)) > 0.0


@pytest.mark.parametrize('seed', range(10))
def test_products_of_the_algebra_are_undone(seed):
    rng = np.random.default_rng(seed)
    b, x = inside(rng), rng.normal(size=3)
    product = np.array([b @ x, *(b[0] * x[1:] + x[0] * b[1:])])
    scale = np.linalg.norm(b) ** 2 / cone_det(tuple(b))
    assert np.allclose(divided(tuple(product), tuple(b)), x, rtol=0.0, atol=1e-13 * scale)


@pytest.mark.parametrize('seed', range(10))
def test_scaling_twice_is_its_square(seed):
    rng = np.random.default_rng(seed)
    w, y, eta = inside(rng), rng.normal(size=3), 10.0 ** rng.uniform(-3.0, 3.0)
    w /= math.sqrt(cone_det(tuple(w)))
    square = eta**2 * (2.0 * np.outer(w, w) - REFLECTION)
    assert np.allclose(scaled_twice(eta, tuple(w), tuple(y)), square @ y, rtol=1e-9)
    once = scaled_once(eta, tuple(w), scaled_once(eta, tuple(w), tuple(y)))
    assert np.allclose(once, square @ y, rtol=1e-9, atol=1e-9 * np.abs(square).max())


@pytest.mark.parametrize('name', STEPS)
def test_it_leads_to_the_laws(name):
    problem = problem_of(name)
    laws, closed, contacts, chain, _, joints = problem
    path, solution = contacts.path, contacts.solution
    first = begin_path(problem)
    point, count, residual = follow_path(problem, first, 150, 1e-4)
    assert 1 < count < 150
    assert residual <= 1e-4
    for a in closed:  # as far from the path as its points may be
        x, y = path.x[a], path.y[a]
        goal = velocity_of(laws, contacts, a, first.speed * point.m / first.first)
        product = np.array([x @ y, *(x[0] * y[1:] + y[0] * x[1:])])
        assert np.abs(product - point.m * np.eye(3)[0]).max() < point.m
        assert np.abs(y - goal).max() < y[0]
    tolerance = laws.residual_tolerance
    point, rest, residual = follow_path(problem, point, 150, tolerance)
    assert residual <= tolerance
    # The same impulses lead to these velocities through the chain without laws.
    gamma = solution.gamma[closed, :3].copy()
    if joints.take_part:
        axis_loads(joints.torque, joints.damping, chain)
    reset_chain(chain)
    factor_chain(chain)
    end_twists(closed, contacts, chain)
    assert np.abs(solution.gamma[closed, :3] - gamma).max() < 0.1 * tolerance
    assert np.abs(residual_on_path(problem, 0.0)[0] - residual) < tolerance
    # A path in parts is the same as at once, but where the first step of a part is too long.
    _, whole, _ = follow_path(problem, begin_path(problem), 150, tolerance)
    assert abs(whole - count - rest) <= (5 if joints.take_part else 2)

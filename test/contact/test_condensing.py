# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The Delassus operator, and the contact problem on it, against the same through the chain."""

from dataclasses import replace

from dense_step import dense_step
import numpy as np
from obstacle_scenes import anywhere, lying_on, random_ground, random_pegs
import pytest
from random_states import random_robot, random_velocities

from snake_sim_ros import Friction, Scene, Solver, State
from snake_sim_ros.contact.delassus import end_twists
from snake_sim_ros.contact.directions import add_contact_wrench, contact_velocities
from snake_sim_ros.contact.laws import impulse_width
from snake_sim_ros.contact.linear_problem import linear_step
from snake_sim_ros.contact.newton import make_operator, prepare_contacts, solve_prepared
from snake_sim_ros.contact.problem import Joints, Problem
from snake_sim_ros.contact.sweeps import predict
from snake_sim_ros.dynamics.articulated_body import factor_chain, reset_chain, solve_chain
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.scene.obstacles import contact_count
from snake_sim_ros.scene.posture import chain_coordinates
from snake_sim_ros.stepping.methods import empty_history
from snake_sim_ros.stepping.model import make_model, make_workspace
from snake_sim_ros.stepping.moreau import begin_step
from snake_sim_ros.stepping.samples import make_samples
from snake_sim_ros.stepping.steps import make_steps, Record

ROLLING = Friction(longitudinal=0.2, transversal=0.4, rolling=0.05)
SLIDING = Friction(longitudinal=0.2, transversal=0.4, rolling=0.0)


@compiled
def shifted_problem(model, work, steps):
    """Return the number of contacts of a step; each has a shift of its own."""
    closed = begin_step(model, work, steps, 0).closed
    for k, a in enumerate(closed):
        work.contacts.solution.shift[a] = 0.1 * (k + 1)
    return len(closed)


@compiled
def operators(problem, operator, columns, free):
    """Condense the contacts; fill columns of G and free velocities from sweeps over the chain."""
    laws, closed, contacts, chain, _, _ = problem
    solution = contacts.solution
    width = impulse_width(laws)
    prepare_contacts(operator, problem)
    for a in closed:
        solution.impulse[a] = 0.0
    reset_chain(chain)
    factor_chain(chain)
    end_twists(closed, contacts, chain)
    chain.residual_torque[:] = 0.0
    for k, a in enumerate(closed):
        for j in range(width):
            free[width * k + j] = solution.gamma[a, j] - (solution.shift[a] if j == 0 else 0.0)
    for k, a in enumerate(closed):
        for j in range(width):
            chain.wrench[:] = 0.0
            solution.impulse[a, j] = 1.0
            add_contact_wrench(closed[k : k + 1], contacts, chain.frame, chain.wrench)
            solution.impulse[a, j] = 0.0
            solve_chain(chain, chain.residual_torque)
            contact_velocities(closed, contacts, chain.frame, chain.twist)
            for m, b in enumerate(closed):
                for i in range(width):
                    gamma = solution.gamma[b, i] - (solution.shift[b] if i == 0 else 0.0)
                    columns[width * m + i, width * k + j] = gamma


@compiled
def one_iteration(problem, operator, history):
    """Take one Newton iteration from the same start."""
    predict(problem.laws, problem.closed, problem.contacts, history)
    prepare_contacts(operator, problem)
    for a in problem.closed:
        problem.contacts.newton.disc_radius[a] = -1.0
    return linear_step(problem, operator, False)[0]


@compiled
def solved_again(model, problem, some, operator, history, fresh):
    """Solve for some of the contacts, on the operator of all of them or on their own."""
    laws, _, contacts, chain, pairs, joints = problem
    part = Problem(laws, some, contacts, chain, pairs, joints)
    prepare_contacts(operator, part if fresh else problem)
    return solve_prepared(operator, part, history, model.iteration_limit).converged


def scenes():
    """Yield names, scenes and states with contacts of all kinds."""
    rng = np.random.default_rng(17)
    for n in (1, 2, 5, 6, 8):
        for name, friction in (('rolling', ROLLING), ('sliding', SLIDING)):
            robot = random_robot(rng, n)
            scene = Scene(robot=robot, friction=friction, level='spatial')
            q = chain_coordinates(robot, rng.uniform(-0.3, 0.3, (n - 1, 2)))
            q[:, 2] -= np.min(q[:, 2]) + rng.uniform(0.0, 0.1)
            yield f'{name} {n}', scene, State(q, random_velocities(rng, n))
            settings = {'ground': random_ground(rng), 'pegs': random_pegs(rng)}
            scene = replace(scene, **settings)
            yield f'{name} {n} obstacles', scene, lying_on(rng, scene)
            scene = replace(scene, self_contact=True, self_contact_friction=0.5)
            state = anywhere(rng, n)
            state.q[:, :3] *= 0.15 * max(1.0, n / 6)  # many pairs of links touch
            yield f'{name} {n} links', scene, state


CASES = {name: case for name, *case in scenes()}
each_case = pytest.mark.parametrize('name', CASES)


def started(name):
    """Return scene, model, contact problem, history and the operator for its contacts."""
    scene, state = CASES[name]
    scene = replace(scene, solver=Solver(residual_tolerance=1e-12))
    history = empty_history(scene)
    still = np.zeros((1, scene.robot.link_count - 1, 2))
    model, work = make_model(scene), make_workspace(scene)
    record = Record(*make_samples(scene, 0, 0)[:-1])
    steps = make_steps((state.q.copy(), state.u.copy()), history, (still, still), record)
    closed = work.closed[: shifted_problem(model, work, steps)]
    laws = model.robot.joint_laws
    joints = Joints(laws.present, laws, work.axes, work.torque, work.damping)
    problem = Problem(model.laws, closed, work.contacts, work.chain, work.pairs, joints)
    return scene, model, problem, history, make_operator(contact_count(scene), scene)


@each_case
def test_the_operator_is_that_of_sweeps_over_the_chain(name):
    scene, _, problem, _, operator = started(name)
    rows = (5 if scene.friction.rolling else 3) * len(problem.closed)
    columns, free = np.zeros((rows, rows)), np.zeros(rows)
    operators(problem, operator, columns, free)
    G = operator.delassus.operator[:rows, :rows]
    assert rows > 0
    assert (G == G.T).all()
    size = np.abs(columns).max()
    assert np.abs(G - columns).max() <= 1e-12 * size
    assert np.linalg.eigvalsh(G).min() >= -1e-13 * size
    found = operator.delassus.free_velocity[:rows]
    assert np.abs(found - free).max() <= 1e-12 * np.abs(free).max()


@pytest.mark.parametrize('name', [name for name in CASES if len(name.split()) == 2])
def test_the_operator_is_the_dense_one(name):
    scene, _, problem, history, operator = started(name)
    width = 5 if scene.friction.rolling else 3
    rows = width * len(problem.closed)
    operators(problem, operator, np.zeros((rows, rows)), np.zeros(rows))
    still = np.zeros((scene.robot.link_count - 1, 2))
    dense = dense_step(scene, CASES[name][1], history, still, still)
    order = np.searchsorted(dense.active, problem.closed)
    taken = (5 * order[:, None] + np.arange(width)).ravel()
    G = dense.delassus()[np.ix_(taken, taken)]
    assert np.abs(operator.delassus.operator[:rows, :rows] - G).max() <= 1e-9 * np.abs(G).max()


@each_case
def test_an_iteration_is_that_through_the_chain(name):
    scene, _, problem, history, operator = started(name)
    found = []
    for solver in (operator, None):
        assert one_iteration(problem, solver, history)
        found.append((problem.contacts['solution']['gamma'][problem.closed].copy(),
                      problem.contacts['solution']['impulse'][problem.closed].copy()))  # fmt: skip
    assert operator.is_condensed[0] == 1
    for one, other in zip(*found, strict=True):
        width = 5 if scene.friction.rolling else 3
        assert np.abs(one - other)[:, :width].max() <= 1e-12 * np.abs(one).max()


# With eight links and rolling friction, iterations take seconds where nothing is compiled.
@pytest.mark.parametrize('name', [name for name in CASES if name != 'rolling 8 links'])
def test_solving_again_is_solving_anew(name):
    _, model, problem, history, operator = started(name)
    some = problem.closed[::2].copy()
    found = []
    for fresh in (False, True):
        for array in history[:4]:
            array[:] = 0.0
        problem.contacts['solution']['shift'][some] = 0.0
        assert solved_again(model, problem, some, operator, history, fresh)
        found.append(
            (problem.contacts['solution']['impulse'][some].copy(), problem.chain.twist.copy())
        )
    for one, other in zip(*found, strict=True):
        assert np.abs(one - other).max() <= 1e-12 * np.abs(one).max()

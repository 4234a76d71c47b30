# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Random scenes with pegs and steps, and checks of their contacts, for several tests."""

from dataclasses import replace
import os
from typing import Any

import numpy as np
from oracle import ORACLE
import pytest
from random_states import free_links, random_robot, rate_of
from scenes import DT, first_steps, references

from snake_sim_ros import Friction, Ground, Patches, Pegs, Report, Scene, Simulation, Solver, State
from snake_sim_ros.contact.laws import PRESS_SPEED
from snake_sim_ros.dynamics.force_directions import scene_contacts
from snake_sim_ros.scene import gait, obstacles
from snake_sim_ros.scene.parameters import Array, steps_in
from snake_sim_ros.scene.posture import chain_coordinates
from snake_sim_ros.scene.rotations import about, product, rotation_matrices
from snake_sim_ros.stepping.methods import empty_history, make_stepper, METHODS
from snake_sim_ros.stepping.samples import make_samples
from snake_sim_ros.stepping.state import History

CELL = 0.15  # m

# Without the compiler a step of a few links takes milliseconds, so that steps are longer.
WITHOUT_COMPILER = bool(os.environ.get('NUMBA_DISABLE_JIT'))
MIDDLE = [name for name in METHODS if name != 'bdf2']  # of the step of the paper
COARSE = 1 / 400
each_method = pytest.mark.parametrize('method', METHODS)
each_method_and_step = pytest.mark.parametrize(
    ('method', 'dt'), [(name, COARSE if WITHOUT_COMPILER else DT) for name in METHODS]
)
only_compiled = pytest.mark.skipif(WITHOUT_COMPILER, reason='too many steps without the compiler')


_dense_steps: dict[tuple[Any, ...], tuple[State, History, Report]] = {}


def random_ground(rng: np.random.Generator, spread: float = 0.1) -> Ground:
    """Return 12 x 10 cells around the origin with heights between -spread/2 and spread."""
    heights = rng.uniform(-spread / 2, spread, (10, 12))
    return Ground(heights=tuple(map(tuple, heights)), cell=CELL, origin=(-0.9, -0.75))


def random_patches(rng: np.random.Generator) -> Patches:
    """Return 11 x 13 patches around the origin, a tenth of them without friction."""
    factors = np.maximum(0.0, rng.uniform(-0.2, 1.8, (13, 11)))
    return Patches(factors=tuple(map(tuple, factors)), cell=0.13, origin=(-0.7, -0.8))


def random_pegs(rng: np.random.Generator) -> Pegs:
    """Return three pegs around the origin."""
    x, y = rng.uniform(-0.3, 0.3, (2, 3))
    return Pegs(x=tuple(x), y=tuple(y), radius=tuple(rng.uniform(0.01, 0.08, 3)), friction=0.3)


def anywhere(rng: np.random.Generator, link_count: int) -> State:
    """Return free links in a cube of 1 m around the origin with any orientation."""
    state = free_links(rng, link_count)
    state.q[:, :3] *= 0.5
    return state


def lying_on(rng: np.random.Generator, scene: Scene) -> State:
    """Return a robot on its ground, up to 1 cm in it, bent by up to 0.5 rad and slowly moving."""
    robot = scene.robot
    q = chain_coordinates(robot, rng.uniform(-0.5, 0.5, (robot.link_count - 1, 2)))
    turn = product(about(2, rng.uniform(-3.0, 3.0)), about(0, rng.uniform(-0.2, 0.2)))
    q[:, :3] = q[:, :3] @ rotation_matrices(turn).T
    q[:, 3:] = product(turn, q[:, 3:])
    q[:, :2] -= q[:, :2].mean(axis=0)
    q[:, 2] += obstacles.lift_onto_ground(scene, q) - rng.uniform(0.0, 1e-2)
    return State(q, rng.uniform(-0.1, 0.1, (robot.link_count, 6)))


def check_directions(scene: Scene, state: State, contacts: Array, tolerance: float) -> None:
    """
    Assert that the directions of contacts are right, by differences along the exact motion.

    ``W_N^T u`` is the rate of the gap; ``W_T^T u`` is the velocity of the body-fixed point at the
    contact along e_x, e_y; ``W_V^T u`` is minus the velocity of the contact over the sphere as the
    link turns, along e_x, e_y.
    """
    n, radius = scene.robot.link_count, scene.robot.per_link('contact_radius')
    R = rotation_matrices(state.q[:, 3:])
    _, lever, frame = obstacles.contact_geometry(scene, state.q)
    _, *directions = scene_contacts(scene, state.q)
    gamma_N, gamma_T, gamma_V = (W.T @ state.u.ravel() for W in directions)
    rate = rate_of(lambda q: obstacles.contact_geometry(scene, q)[0][contacts], state)
    assert np.abs(gamma_N[contacts] - rate).max(initial=0.0) < tolerance
    for a in contacts:
        i = a % n
        assert np.abs(frame[a] @ frame[a].T - np.eye(3)).max() < 1e-14
        assert np.linalg.det(frame[a]) > 0.0
        point_B = R[i].T @ lever[a]
        velocity = rate_of(lambda q, i=i, b=point_B: q[i, :3] + turned(q, i) @ b, state)
        assert np.abs(gamma_T[2 * a : 2 * a + 2] - frame[a, 1:] @ velocity).max() < 2e-10
        omega = R[i] @ state.u[i, 3:]
        over = radius[i] * np.cross(omega, frame[a, 0])  # -n stays, the sphere turns below it
        assert np.abs(gamma_V[2 * a : 2 * a + 2] + frame[a, 1:] @ over).max() < 1e-14


def turned(q: Array, i: int) -> Array:
    """Return the rotation matrix of link i."""
    return rotation_matrices(q[i : i + 1, 3:])[0]


def check_agreement(scene: Scene, state: State, rng: np.random.Generator, method: str) -> int:
    """
    Assert that a method takes the step of the dense one; return the number of closed contacts.

    For `bdf2`, whose step is another one, `check_impact` asserts it for an impact.
    """
    if method == 'bdf2':
        return check_impact(scene, state, method)
    # Residuals of 1e-10 m/s, also of sweeps to 1e-12 N s over r_T = 0.01 kg; nearly dependent
    # contacts, eigenvalues of G from below 0.1 to above 10 1/kg, make up to 1e-7 m/s of them. The
    # method `paper` does the same sweeps: its rounding is that on a flat floor, 1e-10.
    residual = 1e-10
    solver = Solver(
        tolerance=1e-12,
        residual_tolerance=residual,
        iteration_limit=100000,
        normal_compliance=1e-2,
    )
    scene = replace(scene, solver=solver)
    angle = rng.uniform(-0.5, 0.5, (1, scene.robot.link_count - 1, 2))
    start = state, angle, np.zeros(angle.shape)
    expected, impulses, dense = dense_step(scene, *start)
    end, history, report = first_steps(replace(scene, method=method), *start)
    bound = 1e-10 if method == 'paper' else 1e3 * residual
    assert dense.unconverged == report.unconverged == 0
    assert report.contacts == dense.contacts
    assert np.abs(end.u - expected.u).max() < bound
    assert np.abs(end.q - expected.q).max() < bound * scene.dt
    assert np.abs(history.impulse - impulses.impulse).max() < bound
    assert abs(report.penetration_max - dense.penetration_max) < bound * scene.dt
    return report.contacts


def dense_step(
    scene: Scene, state: State, angle: Array, rate: Array
) -> tuple[State, History, Report]:
    """Return the end of the first step by the oracle, once for all that ask for it."""
    key = scene, state.q.tobytes(), state.u.tobytes(), angle.tobytes(), rate.tobytes()
    if key not in _dense_steps:
        _dense_steps[key] = first_steps(replace(scene, method=ORACLE), state, angle, rate)
    return _dense_steps[key]


def check_impact(scene: Scene, state: State, method: str) -> int:
    """Assert that a method resolves an impact as the dense step does; return what closes."""
    # In a picosecond nothing moves, and forces make 1e7 rad/s^2 1e-12 s of velocity: what is
    # left is the impact law, the same for all steps. The selection rule lets contacts sink at
    # up to PRESS_SPEED, in each step in its way, and links turn at that over levers of 3 cm and
    # more.
    solver = Solver(
        tolerance=1e-12, residual_tolerance=1e-10, iteration_limit=100000, normal_compliance=1e-5
    )
    scene = replace(scene, solver=solver, dt=1e-12)
    still = np.zeros((1, scene.robot.link_count - 1, 2))
    start = state, still, still
    expected, _, dense = dense_step(scene, *start)
    end, _, report = first_steps(replace(scene, method=method), *start)
    assert dense.unconverged == report.unconverged == 0
    assert report.contacts == dense.contacts
    assert np.abs(end.u - expected.u).max() < 2 * PRESS_SPEED / 0.03
    return report.contacts


def robot_scene(rng: np.random.Generator, **settings) -> Scene:
    """
    Return five different links on a slope.

    They have every friction there is, but sides and patches where all is compiled: scenes with
    these have a compiled form of their own, which test_friction_scenes.py compiles.
    """
    robot, patches = random_robot(rng, 5), random_patches(rng)
    friction = Friction(longitudinal=0.2, transversal=0.4, rolling=0.05)
    if WITHOUT_COMPILER:
        settings = {'patches': patches, **settings}
        friction = replace(friction, backward=0.3)
    return Scene(robot=robot, friction=friction, gravity=(0.1, 0.2, -9.8), **settings)


def pushed(scene: Scene, state: State, steps: int) -> tuple[State, Array]:
    """Return states at the start and after every step, and the normal forces of the steps [N]."""
    samples, stepper = make_samples(scene, 1, steps), make_stepper(scene)
    stepper.advance(state, empty_history(scene), *references(scene, steps), samples)
    states = State(np.array([state.q, *samples.q]), np.array([state.u, *samples.u]))
    return states, samples.impulse[:, :, 0] / samples.span[:, None]


def travelled(scene: Scene) -> tuple[Simulation, Array]:
    """Return a scene after its duration, and how far its centroid got [m]."""
    simulation = Simulation(scene)
    start = simulation.state.q[:, :3].mean(axis=0)
    times = simulation.midpoints(steps_in(scene.duration, scene.dt, 'duration'))
    simulation.advance(*gait.reference(scene.gait, times, scene.robot.link_count - 1))
    return simulation, simulation.state.q[:, :3].mean(axis=0) - start

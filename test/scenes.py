# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Scenes, runs and error bounds that the tests of the physics share."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from oracle import empty_history, make_stepper, ORACLE
import pytest

from snake_sim_ros import Friction, Report, Robot, Scene, Solver, State
from snake_sim_ros.contact.laws import STICKING
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.posture import gaps
from snake_sim_ros.scene.rotations import about, FLAT, product
from snake_sim_ros.stepping.methods import METHODS
from snake_sim_ros.stepping.samples import make_samples
from snake_sim_ros.stepping.state import History

EPS = np.finfo(float).eps
G = 9.81
ROBOT = Robot(link_count=1)
MASS = 7.5 / 11
RADIUS = 0.0525
OFFSET = 0.0393  # L_GS
ACROSS, ALONG = 9.63e-4, 2.35e-4  # Theta_1, Theta_3

# Far below any law and far above rounding: an iteration rounds impulses to EPS r |gamma|, that is
# 1e-16 N s for 6 m/s and r = 0.1 kg.
TOLERANCE = 1e-14  # N s
# One link, r as in the paper. A contact that stays closed, sticks or rolls is changed by r gamma
# in the last sweep, which is below the tolerance: |gamma| <= eps/r, and r_T = 0.01 kg is smallest.
SPEED = TOLERANCE / 0.01  # m/s
# Methods that stop at a natural-map residual, |P - prox(P - r gamma)|/r, stop at the same speed:
# where a contact stays closed, sticks or rolls, the residual is |gamma|.
SWEEPING = ('paper', ORACLE)  # stop by (93), at a change of impulses
# Solve the paper's step for its laws. The laboratory runs tests of these with solvers of its own.
NEWTON = [name for name in METHODS if name not in (*SWEEPING, 'bdf2')]
PRINTED = {'normal_compliance': 0.0, 'activation_tolerance': 0.0}  # laws as the paper prints them
TIGHT = Solver(tolerance=TOLERANCE, residual_tolerance=SPEED, **PRINTED)
# A contact whose gap is exactly 0 may open by rounding and would then be closed one step later.
CLOSED = -1e-12  # m
STILL = (0.0, 0.0, 0.0)
HEIGHT = 25.0  # m, enough for 2 s of free fall

# The oracle in dense NumPy is a hundred times slower: the same laws with forty times the step, the
# bounds below are formulas in dt.
DT = 1 / 4000
each_method = pytest.mark.parametrize(
    ('method', 'dt'), [*((name, DT) for name in METHODS), (ORACLE, 1 / 100)]
)
every_method = pytest.mark.parametrize('method', METHODS)


def sliding_error(method: str, mu: float, steps: int, r_T: float = 0.01) -> float:
    """
    Return what a solver may leave of the velocity of one link that slides [m/s].

    Of its friction only the sum of the normal impulses matters. A sweep takes r_N lambda = 0.1 kg
    2/m = 0.29 of its error away, so eps/0.29 is left, of which friction makes mu/m eps/0.29 <= 5
    mu eps of velocity, in each step.

    A residual R leaves a normal velocity up to R, so that the sum of the normal impulses of all
    steps, a momentum, is off by 2 m R at most; and each of two friction impulses may be r_T R
    beside its ellipse, in each step.
    """
    if method in SWEEPING:
        return 5 * mu * TOLERANCE * steps
    return 2 * mu * SPEED + steps * 2 * r_T * SPEED / MASS


def whole_steps(method: str) -> float:
    """Return the share of a step that its impulses act for: two thirds in the formula of BDF2."""
    return 2 / 3 if method == 'bdf2' else 1.0


def late_stop(method: str) -> float:
    """
    Return how much too far a body gets that stops within a step, at most, over a dt^2.

    It has the velocity v = a tau left, tau <= dt. The paper's step takes it v dt/2 further, and
    not v tau/2: by a (dt - tau) tau/2, at most dt^2/8. BDF2 goes on by a third of the step before,
    a (tau + dt/2) dt, then by a third of that and so on: by half of it in all, and not by
    a tau^2/2. That is 3/8 dt^2 too far for tau = dt/2.
    """
    return 3 / 8 if method == 'bdf2' else 1 / 8


def impulse_error(method: str) -> float:
    """
    Return what a solver may leave of the normal impulses of one link [N s].

    eps/(r_N lambda) <= 4 eps of a sweep. With a residual R, ``G P`` is off by R and by what the
    step before left, R as well; lambda >= 2/m makes sqrt(2) 2 R m/2 of that, and friction of up to
    0.1, which pitches the link, 13 % more (its own residual, r_T R, another 4 %): below 2 m R.
    """
    return 4 * TOLERANCE if method in SWEEPING else 2 * MASS * SPEED


def link_scene(method: str, dt: float, **settings) -> Scene:
    """Return a scene of one link of Aiko in space, with a tight tolerance."""
    given = {'robot': ROBOT, 'solver': TIGHT, 'method': method, 'dt': dt, 'level': 'spatial'}
    return Scene(**{**given, **settings})


def particle_scene(method: str, dt: float, mu: Sequence[float], gravity: Sequence[float]) -> Scene:
    """
    Return a scene of a body that slides and does not turn: both contacts at the center of a link.

    ``G = 1/m [[1, 1], [1, 1]]`` in every direction: with r = 1/lambda_max = m/2 the first sweep
    ends at the projection of what would stop the body, which is the solution.
    """
    robot = Robot(link_count=1, contact_offset=0.0, contact_radius=0.0)
    solver = replace(TIGHT, r_normal=MASS / 2, r_sliding=MASS / 2)
    return Scene(
        robot=robot,
        solver=solver,
        friction=Friction(longitudinal=mu[0], transversal=mu[1]),
        gravity=tuple(gravity),
        method=method,
        dt=dt,
        level='spatial',
    )


def chain_rounding(method: str, v: float, compliance: float = 3.07) -> float:
    """
    Return the momentum of one link that `newton` and `bdf2` may round away in a step [N s].

    They add laws of a stiffness 1/(1e-6 G) to the inertia of a link, for each of two contacts, and
    a velocity v at one point that is 0 at the contact comes out of a difference of products with
    it: EPS v times the stiffness, in both products. G is the mean Delassus entry [1/kg]. Other
    methods solve the dynamics without the laws.
    """
    return 2 * EPS * v * 2 / (STICKING * compliance) if method in ('newton', 'bdf2') else 0.0


def particle_impulse(method: str) -> float:
    """Return what a solver may leave of an impulse of `particle_scene`: eps or r R [N s]."""
    return TOLERANCE if method in SWEEPING else MASS / 2 * SPEED


def isotropic(mu: float) -> Friction:
    """Return the same Coulomb friction along and across the link."""
    return Friction(longitudinal=mu, transversal=mu)


def slope(angle: float, direction: float = 0.0) -> tuple[float, float, float]:
    """Return gravity over a floor tilted by `angle`; downhill is at `direction` from x."""
    down = G * np.sin(angle)
    return (down * np.cos(direction), down * np.sin(direction), -G * np.cos(angle))


def lying(
    v: Sequence[float] = STILL, omega: Sequence[float] = STILL, radius: float = RADIUS
) -> State:
    """Return one link that lies along x, in contact, with velocities v in I, omega in B."""
    q = np.concatenate([[0.0, 0.0, radius + CLOSED], FLAT])[None]
    return State(q, np.concatenate([v, omega])[None])


def pitched(
    robot: Robot, angle: float, v: Sequence[float] = STILL, clearance: float = CLOSED
) -> State:
    """Return one link with its front end down by `angle`, its lower sphere at a given gap."""
    q = np.concatenate([STILL, product(about(1, angle), FLAT)])[None]
    q[0, 2] = clearance - gaps(robot, q).min()
    return State(q, np.concatenate([v, STILL])[None])


def references(scene: Scene, steps: int, start: int = 0) -> tuple[Array, Array]:
    """Return the joint references of the gait at the middle of steps `start` and later."""
    times = (np.arange(start, start + steps) + 0.5) * scene.dt
    return gait.reference(scene.gait, times, scene.robot.link_count - 1)


def first_steps(
    scene: Scene, state: State, angle: Array, rate: Array
) -> tuple[State, History, Report]:
    """Return state, history and report after the first steps of a scene, with references."""
    stepper = make_stepper(scene)
    return stepper.advance(state, stepper.empty_history(), angle, rate)


def run(
    scene: Scene, state: State, steps: int, history: History | None = None
) -> tuple[State, History, Report]:
    """Return state, history and report after some steps of a scene."""
    history = empty_history(scene) if history is None else history
    return make_stepper(scene).advance(state, history, *references(scene, steps))


def course(scene: Scene, state: State, steps: int, every: int = 1) -> tuple[State, Array, Report]:
    """
    Return states and impulses at the start, after `every` steps each and at the end, and a report.

    Those after a failure are 0.
    """
    samples, start = make_samples(scene, every, steps // every), empty_history(scene)
    end, history, report = make_stepper(scene).advance(
        state, start, *references(scene, steps), samples
    )
    last = [(end.q, end.u, history.impulse)] if steps % every else []
    found = [(state.q, state.u, start.impulse)]
    found += [*zip(samples.q, samples.u, samples.impulse, strict=True), *last]
    q, u, impulses = (np.array(part) for part in zip(*found, strict=True))
    return State(q, u), impulses, report


def same_bits(one: Any, other: Any) -> bool:
    """Return whether two histories have the same parts: types, shapes and all bits of numbers."""
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one, other) and one.tobytes() == other.tobytes()
    return type(one) is type(other) and (one is None or all(map(same_bits, one, other)))


def layout(record: Any) -> Any:
    """Return types and shapes of all parts of a history, to be compared."""
    if isinstance(record, np.ndarray):
        return record.shape, record.dtype
    return None if record is None else (type(record), *map(layout, record))


def kinetic_energy(robot: Robot, u: Array) -> Array:
    """Return the kinetic energy of all links [J], shape (...) for u (..., n, 6)."""
    m, across, along = (
        robot.per_link(name) for name in ('link_mass', 'inertia_transversal', 'inertia_axial')
    )
    inertia = np.column_stack([m, m, m, across, across, along])
    return np.sum(inertia * u**2, axis=(-2, -1)) / 2

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Falls, jamming, an upright link and a free spin: limits of time steps."""

from dataclasses import replace
import math

import numpy as np

from snake_sim_benchmarks.comparison.baselines.integrators import Penalty
from snake_sim_benchmarks.comparison.stability.regularized import spring_limit
from snake_sim_benchmarks.comparison.stability.runs import Case
from snake_sim_benchmarks.comparison.stability.scenes import (
    AIKO,
    CASE_A,
    FLYING_HEIGHT,
    G,
    kinetic_energy,
    MASS,
    OFFSET,
    PRECISE_SOLVER,
    RADIUS,
    stepper_of,
    THETA_1,
    THETA_3,
    turned,
    WEIGHTLESS,
    with_method,
)
from snake_sim_benchmarks.comparison.timed_run import SAMPLING_PERIOD
from snake_sim_ros.scene.parameters import Friction, Robot, Scene, Solver
from snake_sim_ros.scene.posture import gaps
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.state import initial_state
from snake_sim_ros.stepping.trajectory import Trajectory


def dropped(method: str, dt: float, height: float, tilt: float, solver: Solver) -> Case:
    """Return three straight links that fall from a height, tilted."""
    robot = replace(AIKO, link_count=3)
    scene = Scene(robot=robot, friction=CASE_A.friction, solver=solver, dt=dt)
    scene = with_method(scene, method)
    state = initial_state(scene)
    state.q[:] = turned(state.q, tilt)
    state.q[:, 2] += height - gaps(robot, state.q).min()
    available = 3 * MASS * G * (state.q[:, 2].mean() - RADIUS)
    duration = SAMPLING_PERIOD * math.ceil((math.sqrt(2 * height / G) + 0.3) / SAMPLING_PERIOD)
    return Case(scene, state, duration, available, stepper_of(method))


def dropped_flat(method: str, dt: float, height: float) -> Case:
    """Return three links that fall flat."""
    return dropped(method, dt, height, 0.0, PRECISE_SOLVER)


def dropped_tilted(method: str, dt: float, height: float) -> Case:
    """Return three links that fall on one end, which slams the other end down."""
    return dropped(method, dt, height, math.radians(30), PRECISE_SOLVER)


def dropped_precisely(method: str, residual: float, height: float) -> Case:
    """Return a tilted fall that is solved to a residual, to r times it by method `paper`."""
    tolerance = residual * PRECISE_SOLVER.r_sliding
    solver = replace(PRECISE_SOLVER, residual_tolerance=residual, tolerance=tolerance)
    return dropped(method, 1 / 4000, height, math.radians(30), solver)


def landing_error(case: Case, run: Trajectory, fine: Trajectory | None) -> float:
    """Return the larger of the deepest penetration and the final gap, over the radius."""
    gap = np.abs(gaps(case.scene.robot, run.coordinates[-1])).max()
    return float(max(run.report.penetration_max, gap) / RADIUS)


def landing_limit(method: str, height: float) -> float:
    """
    Return the time step below which a flat fall ends with an error of 1 % of the radius [s].

    A contact closes in the first step whose middle is below the floor, so by less than v dt too
    late. Contacts of bdf2 close when they touch the floor.
    """
    if method == 'regularized':
        return spring_limit(method, Penalty().stiffness)
    if method == 'bdf2':
        return math.nan
    return 0.01 * RADIUS / math.sqrt(2 * G * height)


def upright(method: str, dt: float, tilt: float) -> Case:
    """Return one link that slides and spins on its front sphere, tilted off the vertical."""
    robot = replace(AIKO, link_count=1)
    scene = Scene(robot=robot, friction=CASE_A.friction, solver=PRECISE_SOLVER, dt=dt)
    scene = with_method(scene, method)
    state = initial_state(scene)
    state.q[:] = turned(state.q, math.pi / 2 - tilt)
    state.q[:, 2] -= gaps(robot, state.q).min()
    state.u[0] = 0.3, 0.2, 0.0, 0.0, 0.0, 5.0
    available = kinetic_energy(robot, state) + MASS * G * OFFSET
    return Case(scene, state, 0.4, available)


# A slender rod of 1 m and 1 kg on its leading end, tan theta = 2: Painleve's paradox.
ROD = Robot(
    link_count=1, link_mass=1.0, inertia_transversal=1 / 12, inertia_axial=1e-3,
    contact_offset=0.5, contact_radius=0.0,
)  # fmt: skip


def rod_limit(method: str, dt: float) -> float:
    """
    Return the friction from which on the rod jams in its first step.

    G = [[1.6, 1.2], [1.2, 3.4]] 1/kg in normal and sliding direction; sticking at once takes the
    impulses G^-1 (g dt, -v), which lie in the cone from here on: 4/3 for dt = 0.
    """
    return (0.4 + 0.3 * G * dt) / (0.3 + 0.85 * G * dt)


def rod(method: str, mu: float, dt: float) -> Case:
    """Return the first step of the rod that slides at 1 m/s; r is admissible, r lambda = 1.2."""
    friction = Friction(longitudinal=mu, transversal=mu)
    solver = Solver(r_normal=0.3, r_sliding=0.3, normal_compliance=0.0, tolerance=1e-11)
    scene = with_method(Scene(robot=ROD, friction=friction, solver=solver, dt=dt), method)
    state = initial_state(scene)
    state.q[:] = turned(state.q, math.atan(2))
    state.u[0, 0] = 1.0
    # The contact is closed in the middle of the step and at its predicted end.
    state.q[:, 2] -= gaps(ROD, state.q).min() + 1e-12
    return Case(scene, state, dt, kinetic_energy(ROD, state))


def rod_error(case: Case, run: Trajectory, fine: Trajectory | None) -> float:
    """Return by how much the speed is off at which the lower end slides after the step [m/s]."""
    mu, dt = case.scene.friction.longitudinal, case.scene.dt
    jams = mu >= rod_limit('', dt)
    expected = 0.0 if jams else 1.0 - (3.4 * mu - 1.2) * G * dt / (1.6 - 1.2 * mu)
    R, u = rotation_matrices(run.coordinates[-1, :, 3:])[0], run.velocity[-1, 0]
    arm = -np.sign(R[2, 2]) * ROD.contact_offset * R[:, 2]
    return float(abs(u[0] + np.cross(R @ u[3:], arm)[0] - expected))


def spinning(method: str, dt: float, spin: float) -> Case:
    """Return one link that spins freely about its axis, and a tenth of that across."""
    robot = replace(AIKO, link_count=1)
    scene = with_method(Scene(robot=robot, gravity=WEIGHTLESS, dt=dt), method)
    state = initial_state(scene)
    state.q[:, 2] += FLYING_HEIGHT
    state.u[0, 3:] = 0.1 * spin, 0.0, spin
    return Case(scene, state, 1.0, kinetic_energy(robot, state))


def transverse_gain(case: Case, run: Trajectory, fine: Trajectory | None) -> float:
    """Return the relative change of the energy of the rotation across the axis."""
    before, after = (np.sum(u[0, 3:5] ** 2) for u in run.velocity[[0, -1]])
    return float(abs(after / before - 1))


def spin_limit(method: str, spin: float) -> float:
    """
    Return the time step at which the energy across the axis gains 10 % in 1 s.

    The explicit gyroscopic term multiplies it by exp(W^2 dt t), with W = (Theta_3 -
    Theta_1)/Theta_1 omega_z.
    """
    if method == 'bdf2':
        return math.nan
    rate = (THETA_3 - THETA_1) / THETA_1 * spin
    return math.log(1.1) / rate**2

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where methods reach limits: contact laws, impacts, regularized contact, joint control."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
import math
from typing import Any

import numpy as np

from snake_sim_benchmarks.comparison.baselines.integrators import make_semi_implicit, Penalty
from snake_sim_benchmarks.comparison.paths import SAMPLING_PERIOD
from snake_sim_benchmarks.comparison.stability.runs import Case
from snake_sim_ros import Friction, Robot, Scene, Solver, State
from snake_sim_ros.dynamics.force_directions import (
    contact_directions,
    joint_directions,
    mass_matrix,
    torque_directions,
)
from snake_sim_ros.scene.parameters import Array, load_scene, with_settings
from snake_sim_ros.scene.posture import gaps, joint_angles
from snake_sim_ros.scene.rotations import about, product, rotation_matrices
from snake_sim_ros.stepping.base import Stepper
from snake_sim_ros.stepping.methods import METHODS
from snake_sim_ros.stepping.state import initial_state
from snake_sim_ros.stepping.trajectory import Trajectory

# ---- what several maps share --------------------------------------------------------------------


G = 9.81  # m/s^2
WEIGHTLESS = (0.0, 0.0, 0.0)
FLYING_HEIGHT = 1.0  # m, so high that the robot does not touch the floor
AIKO = Robot()
MASS, LENGTH, RADIUS, OFFSET, THETA_1, THETA_3 = (
    float(AIKO.per_link(name)[0])
    for name in (
        'link_mass',
        'link_length',
        'contact_radius',
        'contact_offset',
        'inertia_transversal',
        'inertia_axial',
    )
)
CASE_A = load_scene('lateral_undulation')
CLOSED_DEPTH = 1e-9  # m, so that contacts are closed despite rounding
# For maps of contacts: this velocity counts as rest. Another map shows what solvers reach.
PRECISE_SOLVER = replace(CASE_A.solver, residual_tolerance=1e-6)


def with_method(scene: Scene, method: str) -> Scene:
    """Return the scene with the method and, if it is named, the scheme of the controller."""
    name, _, scheme = method.partition(' ')
    name = name if name in METHODS else 'newton'
    return replace(scene, method=name, level='spatial', pd_scheme=scheme or scene.pd_scheme)


def stepper_of(method: str, **penalty: Any) -> Callable[[Scene], Stepper] | None:
    """Return what makes the stepper of a baseline; None for a method of `methods.METHODS`."""
    if method != 'regularized':
        return None
    return partial(make_semi_implicit, penalty=Penalty(**penalty))


def kinetic_energy(robot: Robot, state: State) -> float:
    """Return the kinetic energy of a state [J]."""
    u = state.u.ravel()
    return float(0.5 * u @ (mass_matrix(robot) @ u))


def operator(robot: Robot, q: Array, W: Array) -> Array:
    """Return W^T M^-1 W with the joints eliminated, in a posture q of shape (n, 7)."""
    W_J = joint_directions(robot, rotation_matrices(q[:, 3:]))
    M_inv = 1.0 / np.diag(mass_matrix(robot))[:, None]
    G_J = W_J.T @ (M_inv * W)
    return np.asarray(W.T @ (M_inv * W) - G_J.T @ np.linalg.solve(W_J.T @ (M_inv * W_J), G_J))


def turned(q: Array, tilt: float) -> Array:
    """Return coordinates turned about y of I, front ends down by `tilt` [rad]."""
    turn = about(1, tilt)
    p = product(np.broadcast_to(turn, (len(q), 4)), q[:, 3:])
    return np.hstack([q[:, :3] @ rotation_matrices(turn).T, p])


def angle_error(case: Case, run: Trajectory, fine: Trajectory | None) -> float:
    """Return the largest error of a joint angle at the samples over the largest joint angle."""
    assert fine
    expected = joint_angles(fine.coordinates)
    return float(np.abs(joint_angles(run.coordinates) - expected).max() / np.abs(expected).max())


def position_error(case: Case, run: Trajectory, fine: Trajectory | None) -> float:
    """Return the largest error of the position of a link at the samples over the way it went."""
    assert fine
    way = np.linalg.norm(fine.position[-1] - fine.position[0], axis=-1).max()
    return float(np.linalg.norm(run.position - fine.position, axis=-1).max() / way)


def speed(case: Case, run: Trajectory, fine: Trajectory | None) -> float:
    """Return the largest speed of a link at the end [m/s]."""
    return float(np.linalg.norm(run.velocity[-1, :, :3], axis=-1).max())


# ---- solvers of contact laws: friction, prox parameters, mass ratios ----------------------------


def undulating(method: str, dt: float, mu: float) -> Case:
    """Return case A with another friction across the links."""
    friction = replace(CASE_A.friction, transversal=mu)
    scene = with_method(replace(CASE_A, friction=friction, solver=PRECISE_SOLVER, dt=dt), method)
    return Case(scene, initial_state(scene), 0.5, make=stepper_of(method))


def prox_robot(size: float) -> Robot:
    """Return one link with inertias of cylinders `size` times as thick as the link."""
    m, L, r = MASS, LENGTH, size * RADIUS
    return replace(
        AIKO,
        link_count=1,
        inertia_transversal=m * (3 * r**2 + L**2) / 12,
        inertia_axial=m * r**2 / 2,
    )


def sticking(method: str, factor: float, size: float) -> Case:
    """
    Return one link on a slope on which it sticks, with prox parameters times a factor.

    It is one link because its contacts are not redundant, so that all of them carry load.
    """
    r = CASE_A.solver
    solver = replace(
        r, r_normal=factor * r.r_normal, r_sliding=factor * r.r_sliding, normal_compliance=0.0
    )
    slope = (G * math.sin(0.03), 0.0, -G * math.cos(0.03))
    scene = replace(CASE_A, robot=prox_robot(size), solver=solver, gravity=slope)
    scene = with_settings(with_method(scene, method), {'gait.yaw.angular_frequency': 0.0})
    state = initial_state(scene)
    state.q[:, 2] -= CLOSED_DEPTH
    state.u[:] = np.random.default_rng(1).normal(0.0, 1e-5, state.u.shape)  # every mode of G
    fall = G * 20 * scene.dt
    return Case(scene, state, 20 * scene.dt, 0.5 * MASS * fall**2)


def prox_limit(method: str, size: float) -> float:
    """Return the factor on r at which r lambda_max of the Delassus operator is 2, for `paper`."""
    if method != 'paper':
        return math.nan
    scene = sticking(method, 1.0, size).scene
    q = initial_state(scene).q
    W_N, W_T, _ = contact_directions(scene.robot, rotation_matrices(q[:, 3:]))
    r = np.sqrt(
        np.repeat([scene.solver.r_normal, scene.solver.r_sliding], [W_N.shape[1], W_T.shape[1]])
    )
    W = np.hstack([W_N, W_T]) * r
    return float(2 / np.linalg.eigvalsh(operator(scene.robot, q, W)).max())


def heavy(method: str, ratio: float, links: float) -> Case:
    """Return a straight robot at rest whose middle link is heavier than the others."""
    n = round(links)
    factor = np.where(np.arange(n) == n // 2, ratio, 1.0)
    names = ('link_mass', 'inertia_transversal', 'inertia_axial')
    lists: dict[str, Any] = {name: tuple(factor * getattr(AIKO, name)) for name in names}
    robot = Robot(link_count=n, **lists)
    scene = with_method(
        Scene(robot=robot, friction=CASE_A.friction, solver=PRECISE_SOLVER), method
    )
    state = initial_state(scene)
    state.q[:, 2] -= CLOSED_DEPTH
    fall = G * 10 * scene.dt
    return Case(scene, state, 10 * scene.dt, 0.5 * sum(lists['link_mass']) * fall**2)


def sinking(case: Case, run: Trajectory, fine: Trajectory | None) -> float:
    """Return the largest speed of a link at the end over that of a free fall."""
    return speed(case, run, fine) / (G * case.duration)


# ---- falls, jamming, an upright link and a free spin: limits of time steps ----------------------


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


# ---- regularized contact: stiff springs, friction that is smooth at rest ------------------------


def pushed(method: str, dt: float, v: Sequence[float], mu: float, **penalty: Any) -> Case:
    """Return three straight links that lie on the floor, pushed with a velocity."""
    robot, friction = replace(AIKO, link_count=3), Friction(longitudinal=mu, transversal=mu)
    scene = with_method(
        Scene(robot=robot, friction=friction, solver=PRECISE_SOLVER, dt=dt), method
    )
    state = initial_state(scene)
    sag = MASS * G / 2 / Penalty(**penalty).stiffness if penalty else CLOSED_DEPTH
    state.q[:, 2] -= sag
    state.u[:, :3] = v
    # A little motion in every mode; the links keep rolling at less than a micrometer a second.
    state.u[:, [2, 5]] += np.random.default_rng(1).normal(0.0, (1e-4, 1e-5), (3, 2))
    available = kinetic_energy(robot, state) + 3 * MASS * G * sag
    return Case(scene, state, 0.5, available, stepper_of(method, **penalty))


def pushed_down(method: str, dt: float, stiffness: float) -> Case:
    """Return a push into the floor, on springs of a stiffness, without friction."""
    return pushed(method, dt, (0.0, 0.0, -0.01), 0.0, stiffness=stiffness)


def pushed_along(method: str, dt: float, sliding_velocity: float) -> Case:
    """Return a push along the floor, with friction that is smooth below a sliding velocity."""
    return pushed(method, dt, (0.01, 0.0, 0.0), 0.5, sliding_velocity=sliding_velocity)


def lying_operator(direction: int) -> Array:
    """Return the Delassus operator of three straight links: 0 for normal, 1 for sliding."""
    robot = replace(AIKO, link_count=3)
    q = initial_state(Scene(robot=robot)).q
    W = contact_directions(robot, rotation_matrices(q[:, 3:]))[direction]
    return operator(robot, q, W)


def spring_limit(method: str, stiffness: float) -> float:
    """
    Return the largest stable time step of spring-dampers under three straight links [s].

    As of the joint controller at the middle: 4 - 2 c dt - w^2 dt^2 > 0 with w^2 = k g, c = d g,
    g the largest eigenvalue of the Delassus operator.
    """
    if method != 'regularized':
        return math.nan
    g = np.linalg.eigvalsh(lying_operator(0)).max()
    zeta = Penalty().damping_ratio
    ww, c = stiffness * g, 2 * zeta * math.sqrt(stiffness * MASS / 2) * g
    return float((math.sqrt(c**2 + 4 * ww) - c) / ww)


def smooth_limit(method: str, sliding_velocity: float) -> float:
    """
    Return the largest stable time step of smooth friction and springs under the same links [s].

    A force -c v that is known at the start takes c g dt of a velocity away: c g dt < 2, with the
    slope c = mu F_N/eps of friction at rest, g the largest eigenvalue in sliding direction.
    """
    if method != 'regularized':
        return math.nan
    slope = 0.5 * MASS * G / 2 / sliding_velocity
    limit = 2 / (slope * np.linalg.eigvalsh(lying_operator(1)).max())
    return float(min(limit, spring_limit(method, Penalty().stiffness)))


# ---- the joint controller, in flight and on the ground ------------------------------------------


def flying(scene: Scene) -> State:
    """Return the straight robot in the air; it bends slowly, and a little in all of its modes."""
    state, n = initial_state(scene), scene.robot.link_count
    state.q[:, 2] += FLYING_HEIGHT
    slow = 0.1 * np.cos(math.pi * np.arange(n) / (n - 1))
    state.u[:, 3:5] = slow[:, None] + np.random.default_rng(1).normal(0.0, 1e-4, (n, 2))
    return state


def in_flight(method: str, dt: float, **gains: Any) -> Case:
    """Return Aiko in weightless flight, with joints that are to stay straight, pushed a little."""
    robot = replace(AIKO, **gains)
    scene = with_method(Scene(robot=robot, gravity=WEIGHTLESS, dt=dt), method)
    start = flying(scene)
    return Case(scene, start, 0.5, kinetic_energy(robot, start))


def on_the_ground(method: str, dt: float, **gains: Any) -> Case:
    """Return case A, lateral undulation, with other gains."""
    scene = with_method(replace(CASE_A, robot=replace(AIKO, **gains), dt=dt), method)
    return Case(scene, initial_state(scene), 0.5)


def control_limit(method: str, robot: Robot) -> float:
    """
    Return the largest stable time step of a scheme of the joint controller in flight [s].

    One mode with w^2 = K_p g and c = K_d g, g an eigenvalue of the mobility of the joint axes. The
    step has determinant 1 - c dt + w^2 dt^2/2 and trace 2 - c dt - w^2 dt^2/2 for `start`, so that
    dt < 2 K_d/K_p and c dt < 2; 1 - c dt and 2 - c dt - w^2 dt^2 for `midpoint`, so that
    4 - 2 c dt - w^2 dt^2 > 0. The implicit schemes have no limit.
    """
    scheme = method.partition(' ')[2]
    if scheme not in ('start', 'midpoint'):
        return math.nan
    state = flying(Scene(robot=robot))
    W_tau = torque_directions(robot, rotation_matrices(state.q[:, 3:]))
    mobility = operator(robot, state.q, W_tau)
    limits = []
    for axis, name in enumerate(('yaw', 'pitch')):
        g = np.linalg.eigvalsh(mobility[axis::2, axis::2]).max()
        K_p, K_d = getattr(robot, f'{name}_stiffness'), getattr(robot, f'{name}_damping')
        ww, c = K_p * g, K_d * g
        limits.append((math.sqrt(c**2 + 4 * ww) - c) / ww)
        if scheme == 'start':
            limits[-1] = min(2 * K_d / K_p, 2 / c)
    return float(min(limits))

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The time step of the paper as printed: dense matrices in NumPy, to read beside the paper [1].

The compiled steppers are tested against this definition. It is slow. Single letters are those of
the paper; NOTATION.md maps them to names. Times are marked ``_A`` (start), ``_M`` (middle) and
``_E`` (end of the step). Contacts are numbered as in eq. (10): the front spheres F of all links,
then the rear spheres R.

.. [1] A. A. Transeth, R. I. Leine, Ch. Glocker, K. Y. Pettersen, "3-D snake robot motion:
   nonsmooth modeling, simulations, and experiments", IEEE T-RO 24(2), 2008.
"""

import math
from typing import NamedTuple

import numpy as np

from oracle.closing import Closing, levers, with_closed_gaps
from oracle.contact_laws import (
    called_often,
    falling,
    prox_half_ellipses,
    selection_center,
    selection_compliance,
    viscosity,
)
from oracle.joint_drift import furthest_angles, without_drift
from oracle.joint_laws import dense_laws, solve_laws_of_axes
from oracle.pushes import generalized, step_of
from snake_sim_ros import Report, Scene, Solver, State
from snake_sim_ros.contact.closing import closed_gap, DEEP
from snake_sim_ros.contact.detection import reach_of_step
from snake_sim_ros.contact.laws import LEAST_COMPLIANCE, prox_disc, prox_half_line
from snake_sim_ros.dynamics.force_directions import (
    joint_directions,
    joint_gaps,
    mass_matrix,
    mean_delassus,
    scene_contacts,
    scene_gaps,
    smooth_forces,
    torque_directions,
)
from snake_sim_ros.dynamics.joint_control import (
    ControlLoop,
    ControlMemory,
    held_torque,
    make_control_loop,
    pd_law,
)
from snake_sim_ros.dynamics.joint_laws import make_joint_laws
from snake_sim_ros.scene import obstacles, posture
from snake_sim_ros.scene.parameters import Array, PD_SCHEMES
from snake_sim_ros.scene.rotations import H_bar, rotation_matrices
from snake_sim_ros.stepping.base import divergence
from snake_sim_ros.stepping.model import PROXIMAL
from snake_sim_ros.stepping.pushes import NO_PUSHES, PushTable
from snake_sim_ros.stepping.samples import Samples
from snake_sim_ros.stepping.state import copied, empty_history, History, Returned


def dense_control(
    scene: Scene, memory: ControlMemory, measured: Array, angle: Array, rate: Array
) -> tuple[Array, Array, ControlLoop]:
    """
    Return what `read_by_controllers` does, in NumPy, for measured angles (n-1, 2), and the loop.

    The memory is changed in place.
    """
    loop, dt = make_control_loop(scene), scene.dt
    if not loop.present:
        return angle, rate, loop
    if loop.delay > 0:
        if memory.next[0] == 0.0:
            memory.queue[:, 0], memory.queue[:, 1] = angle - dt / 2 * rate, 0.0
            memory.next[0] = 1.0
        oldest = int(memory.next[0]) - 1
        newest, (angle, rate) = (angle, rate), memory.queue[oldest].copy()
        memory.queue[oldest] = newest
        memory.next[0] = 1 + (oldest + 1) % loop.delay
    if loop.hold > 0:
        if memory.wait[1] == 0.0:
            memory.wait[1], memory.held_reference[0] = loop.hold, angle - dt / 2 * rate
        memory.wait[1] -= 1.0
        angle, rate = memory.held_reference
    if loop.period > 0:
        if memory.wait[0] == 0.0:
            memory.wait[0], step = loop.period, loop.resolution
            read = step * np.floor(measured / step + 0.5) if step > 0.0 else measured
            memory.error[:], memory.rate[:] = angle - dt / 2 * rate - read, rate
        memory.wait[0] -= 1.0
    return angle, rate, loop


def joint_torque_law(
    scene: Scene, state: State, q_M: Array, control: ControlMemory, angle: Array, rate: Array
) -> tuple[Array, Array]:
    """Return torque [N m] and damping [N m s] of the controllers of all axes, (2(n-1),)."""
    robot = scene.robot
    kp, kd = robot.per_joint('stiffness'), robot.per_joint('damping')
    starts = np.stack(
        [posture.joint_angles(state.q, robot), posture.joint_rates(state.q, state.u, robot)], -1
    )
    mids = np.stack(
        [posture.joint_angles(q_M, robot), posture.joint_rates(q_M, state.u, robot)], -1
    )
    scheme, dt = PD_SCHEMES.index(scene.pd_scheme), scene.dt
    measured = mids[..., 0] - dt / 2 * mids[..., 1]
    angle, rate, loop = dense_control(scene, control, measured, angle, rate)
    torque, damping = np.zeros((2, *kp.shape))
    for j, k in np.ndindex(kp.shape):
        held, stiffness, known = held_torque(loop, control, j, k, kp[j, k], rate[j, k])
        torque[j, k], damping[j, k] = pd_law(
            scheme, dt, starts[j, k], mids[j, k], (angle[j, k], known), (stiffness, kd[j, k])
        )
        torque[j, k] += held
    return torque.ravel(), damping.ravel()


def middle_coordinates(state: State, dt: float) -> Array:
    """
    Return q_M = q_A + dt/2 F(q_M) u_A, eq. (72), with Euler parameters of length 1.

    F(q_M) makes the equation implicit. It is linear in p_M and is solved in closed form.
    """
    q_M = state.q.copy()
    for i, (v, omega) in enumerate(zip(state.u[:, :3], state.u[:, 3:], strict=True)):
        q_M[i, :3] += dt / 2 * v
        p_M = q_M[i, 3:] + dt / 4 * H_bar(q_M[i, 3:]).T @ omega
        q_M[i, 3:] = p_M / np.linalg.norm(p_M)
    return q_M


def end_coordinates(q_A: Array, q_M: Array, u_A: Array, u_E: Array, dt: float) -> Array:
    """Return q_E = q_M + dt/2 F(q_M) u_E, eq. (83); p_M has the length that eq. (72) gives it."""
    q_E = q_M.copy()
    for i in range(len(q_M)):
        length = 1.0 / math.sqrt(1.0 + dt**2 / 16 * (u_A[i, 3:] @ u_A[i, 3:]))
        p_M = length * np.linalg.norm(q_A[i, 3:]) * q_M[i, 3:]
        q_E[i, :3] += dt / 2 * u_E[i, :3]
        q_E[i, 3:] = p_M + dt / 4 * H_bar(p_M).T @ u_E[i, 3:]
    return q_E


def contact_prox(
    r: Solver,
    compliance: float,
    friction: list[float],
    center: float,
    P: list[float],
    gamma: list[float],
) -> tuple[float, ...]:
    """
    Return the five impulses of a contact after one projection, eqs. (87)-(89).

    The sliding and rolling sets are those of the new normal impulse.

    Deviation: the selection rule takes ``gamma_N + compliance (P_N - center)`` for gamma_N.
    The normal forces of a robot that lies flat are not unique, and friction depends on them; this
    tiny compliance makes them the ones of least norm. The scene can switch it off.
    """
    forward, backward, mu_y, mu_V = friction
    r_T, r_V = r.r_sliding, r.r_rolling
    P_N = called_often(prox_half_line)(
        P[0] - r.r_normal * (gamma[0] + compliance * (P[0] - center))
    )
    x, y = P[1] - r_T * gamma[1], P[2] - r_T * gamma[2]
    P_T = prox_half_ellipses(x, y, forward * P_N, backward * P_N, mu_y * P_N)
    P_V = called_often(prox_disc)(P[3] - r_V * gamma[3], P[4] - r_V * gamma[4], mu_V * P_N)
    return P_N, *P_T, *P_V


class Terms(NamedTuple):
    """The terms of the balance (75) at the middle of a step, with W of the active contacts."""

    active: Array  # (k,) numbers of the active contacts
    R: Array  # (n, 3, 3) link frames in I
    gap: Array  # (k,) [m]
    shift: Array  # (k,) velocities that gaps allow, see `closing.predict_gaps` [m/s]
    start_gap: Array  # (k,) gap of a contact that is deep at the start, else 0 [m]
    friction: Array  # (k, 4) mu forward, backward, across the link and of rolling
    W_N: Array  # (6n, k)
    W_T: Array  # (6n, 2k)
    W_V: Array  # (6n, 2k)
    W_J: Array  # (6n, 4(n-1))
    W_tau: Array  # (6n, 2(n-1))
    M_inv: Array  # (6n, 6n)
    momentum: Array  # (6n,) M u_A + h dt + tau_C dt

    def velocities(self, u: Array) -> Array:
        """Return gamma_N, gamma_T and gamma_V, eqs. (90)-(92), shape (k, 5) [m/s]."""
        gamma_T, gamma_V = (self.W_T.T @ u).reshape(-1, 2), (self.W_V.T @ u).reshape(-1, 2)
        return np.hstack([(self.W_N.T @ u)[:, None], gamma_T, gamma_V])

    def shifted_velocities(self, u: Array) -> Array:
        """Return the velocities, gamma_N with what gaps allow, shape (k, 5) [m/s]."""
        gamma = self.velocities(u)
        gamma[:, 0] += self.shift
        return gamma


class SelectionRule(NamedTuple):
    """Which normal impulses a step takes where they are not unique, see `contact.laws`."""

    compliance: float  # [1/kg]
    center: Array  # (k,) normal impulses about which it is compliant [N s]


class Solution(NamedTuple):
    """The solution of the contacts of a step, for known laws of the joints."""

    terms: Terms
    rule: SelectionRule
    P: Array  # (k, 5) impulses of the active contacts [N s]
    last_P: Array  # (k, 5) those before the last projection
    u_E: Array  # (6n,)
    converged: bool


def closed_contacts(
    terms: Terms, rule: SelectionRule, P: Array
) -> tuple[Terms, SelectionRule, Array]:
    """Return what belongs to the contacts that are closed after a landing, without shifts."""
    kept = (terms.shift == 0.0) | (P[:, 0] > 0.0)
    return (
        terms._replace(
            active=terms.active[kept],
            gap=terms.gap[kept],
            shift=np.zeros(kept.sum()),
            start_gap=terms.start_gap[kept],
            friction=terms.friction[kept],
            W_N=terms.W_N[:, kept],
            W_T=terms.W_T[:, np.repeat(kept, 2)],
            W_V=terms.W_V[:, np.repeat(kept, 2)],
        ),
        rule._replace(center=rule.center[kept]),
        P[kept],
    )


class DenseStepper:
    """The time step (72)-(93) of the paper for a scene; see `base.Stepper`."""

    level = 'spatial'
    cycles = np.zeros(0, np.int64)

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.size = mean_delassus(scene.robot)

    def empty_history(self) -> History:
        """Return the history before the first step."""
        return empty_history(self.scene)

    def advance(
        self, state: State, history: History, angle: Array, rate: Array,
        samples: Samples | None = None, pushes: PushTable = NO_PUSHES,
    ) -> tuple[State, History, Report]:  # fmt: skip
        """Return state, history and report after as many steps as there are references."""
        links = self.scene.robot.link_count
        Returned(links, self.empty_history()).check(state, history, angle, rate)
        report = Report()
        for step_angle, step_rate in zip(angle, rate, strict=True):
            acting = pushes.after(report.steps)
            end, end_history, step_report = self.step(
                state, history, step_angle, step_rate, acting
            )
            omega = end.u[:, 3:]
            turn = np.where(np.isfinite(end.u).all(axis=1), np.linalg.norm(omega, axis=1), np.inf)
            if not (turn * self.scene.dt < math.pi / 2).all():
                link = int(turn.argmax())
                turned = float(turn[link] * self.scene.dt)
                report.failure = divergence(link + 1, turned, self.scene.dt)
                return state, self.empty_history(), report
            state, history, report = end, end_history, report + step_report
            if samples:
                kept = state, history, step_report.joint_torque, self.scene.dt
                samples.add(report.steps - 1, *kept)
        return state, history, report

    def in_place(
        self, count: int, state: State, history: History, pushes: PushTable, every: int = 0
    ) -> None:
        """Return None: `advance` takes all steps."""

    def step(
        self, state: State, history: History, angle: Array, rate: Array,
        pushes: PushTable = NO_PUSHES,
    ) -> tuple[State, History, Report]:  # fmt: skip
        """Return state, history and report after one step, section VII."""
        scene, robot, dt = self.scene, self.scene.robot, self.scene.dt
        n, history = robot.link_count, copied(history)
        q_M = middle_coordinates(state, dt)  # (72)
        torque, damping = joint_torque_law(scene, state, q_M, history.control, angle, rate)
        of_joints, angle_M = make_joint_laws(robot), posture.joint_angles(q_M, robot)
        low = np.where(angle_M <= of_joints.stop[..., 0], 0.0, -np.inf)
        high = np.where(angle_M >= of_joints.stop[..., 1], 0.0, np.inf)
        laws = dense_laws(of_joints, dt, dt * torque, dt * damping, low, high)

        first: Solution | None = None  # in which contacts land

        def solve(torque: Array, damping: Array, limit: int) -> tuple[Array, Solution, int]:
            terms = self.terms(state, q_M, torque.ravel(), damping.ravel(), pushes)
            P = history.impulse[terms.active]
            rule = self.selection_rule(terms, state.u.ravel(), P)
            if first is not None:
                terms, rule, P = closed_contacts(terms, rule, first.P)
            P, last_P, u_E, iterations, converged = self.iterate(terms, rule, P, limit)
            found = Solution(terms, rule, P, last_P, u_E, converged)
            return (terms.W_tau.T @ u_E).reshape(-1, 2), found, iterations

        limit, rates = scene.iteration_limit, posture.joint_rates(q_M, state.u, robot)
        found, rates, _, iterations, settled = solve_laws_of_axes(
            laws, of_joints.inertia, rates, solve, limit
        )
        moving = found.u_E.reshape(n, 6)
        lands = ((found.terms.shift > 0.0) & (found.P[:, 0] > 0.0)).any()
        if lands and found.converged and iterations < limit:
            first = found
            found, rates, _, more, settled = solve_laws_of_axes(
                laws, of_joints.inertia, rates, solve, limit - iterations
            )
            iterations += more
        terms, rule, P, last_P, u_E, converged = found
        history.impulse[:] = 0.0  # also of contacts that have opened
        history.impulse[terms.active] = P

        gamma, u_E = terms.shifted_velocities(u_E), u_E.reshape(n, 6)
        q_free = end_coordinates(state.q, q_M, state.u, moving, dt)  # (83)
        furthest = furthest_angles(of_joints.stop, posture.joint_angles(state.q, robot), angle_M)
        q_E = without_drift(robot, q_free, scene.drift_correction, furthest)
        closing = Closing(
            terms.W_N, terms.W_J, terms.M_inv, terms.R, PROXIMAL * self.size, levers(robot),
            obstacles.is_flat(scene),
        )  # fmt: skip
        start = terms.start_gap, terms.W_N.T @ state.u.ravel()
        q_E = with_closed_gaps(scene, closing, terms.active, start, P[:, 0] > 0.0, q_E, furthest)
        g_J = joint_gaps(robot, without_drift(robot, q_free, 'none', furthest))

        def residual(compliance: float) -> float:
            friction = terms.friction * falling(scene, terms.active, gamma)
            each = zip(friction, rule.center, last_P, gamma, strict=True)
            found = (contact_natural_map(scene.solver, compliance, *contact) for contact in each)
            return max(found, default=0.0)

        report = Report(
            steps=1,
            iterations=iterations,
            iterations_max=iterations,
            unconverged=int(not (converged and settled)),
            residual_max=residual(rule.compliance),
            printed_residual_max=residual(0.0),
            penetration_max=max(0.0, -float(scene_gaps(scene, q_E).min())),
            joint_gap_max=_largest(g_J[:, :3]),
            joint_twist_max=_largest(g_J[:, 3:]),
            contacts=len(terms.active),
            joint_torque=laws.controller(rates) / dt,
        )
        return State(q_E, u_E), history, report

    def terms(
        self, state: State, q_M: Array, torque: Array, damping: Array,
        pushes: PushTable = NO_PUSHES,
    ) -> Terms:  # fmt: skip
        """Return the terms of (75) for torques [N m s] and dampings of the axes, (2(n-1),)."""
        scene, robot, dt = self.scene, self.scene.robot, self.scene.dt
        R = rotation_matrices(q_M[:, 3:])
        gap, *directions = scene_contacts(scene, q_M)
        closed = closed_gap(scene.solver.activation_tolerance, dt)
        active = np.flatnonzero(gap <= reach_of_step(closed, dt / 2))
        W_N, W_T, W_V = (_columns(W, active, len(gap)) for W in directions)
        gap, way = gap[active], dt / 2 * W_N.T @ state.u.ravel()
        deep = gap - way < -2 * np.abs(way) - DEEP
        W_tau = torque_directions(robot, R)
        h = smooth_forces(robot, np.array(scene.gravity), state.u)
        h += generalized(pushes, step_of(pushes), R)
        # (75): M (u_E - u_A) - h dt - S - W_J P_J = tau_C dt. What an implicit controller takes
        # from u_E joins the mass matrix.
        friction = obstacles.contact_friction(scene, active, q_M)
        shift = np.where(gap > closed, gap / (dt / 2), 0.0)
        viscous = dt * viscosity(scene, active, friction[:, 4], shift)
        return Terms(
            active=active,
            R=R,
            gap=gap,
            shift=shift,
            start_gap=np.where(deep, gap - way, 0.0),
            friction=friction[:, :4],
            W_N=W_N,
            W_T=W_T,
            W_V=W_V,
            W_J=joint_directions(robot, R),
            W_tau=W_tau,
            M_inv=np.linalg.inv(
                mass_matrix(robot) + (W_tau * damping) @ W_tau.T + (W_T * viscous) @ W_T.T
            ),
            momentum=mass_matrix(robot) @ state.u.ravel() + h * dt + W_tau @ torque,
        )

    def selection_rule(self, terms: Terms, u_A: Array, P: Array) -> SelectionRule:
        """Return the selection rule of a step, from its start and the last impulses."""
        scene, mass = self.scene, self.scene.robot.per_link('link_mass')
        fall, links = -scene.dt * scene.gravity[2], obstacles.contact_links(scene)
        gamma_A = terms.velocities(u_A)[:, :3]
        stops = mass[links[terms.active, 0]] * (0.5 * fall - 2.0 * gamma_A[:, 0])
        most = max(0.0, float(np.append(P[:, 0], stops).max(initial=0.0)))
        compliance = selection_compliance(
            scene.solver.normal_compliance * self.size, LEAST_COMPLIANCE * self.size, most
        )
        center = selection_center(P[:, 0], gamma_A, fall * float(mass.sum()))
        return SelectionRule(compliance, center)

    def iterate(
        self, terms: Terms, rule: SelectionRule, P: Array, limit: int
    ) -> tuple[Array, Array, Array, int, bool]:
        """
        Iterate the contact impulses, eqs. (84)-(93), up to `limit` times.

        Returns
        -------
        P : ndarray, shape (k, 5)
            Impulses of the active contacts.
        last_P : ndarray, shape (k, 5)
            Those before the last projection, which lead to u_E.
        u_E : ndarray, shape (6n,)
        iterations : int
        converged : bool

        """
        solver, centers = self.scene.solver, rule.center.tolist()
        *_, W_N, W_T, W_V, W_J, _, M_inv, momentum = terms
        G_J, rows = W_J.T @ M_inv @ W_J, len(momentum)
        directions = W_N[:, :, None], W_T.reshape(rows, -1, 2), W_V.reshape(rows, -1, 2)
        W = np.concatenate(directions, axis=2).reshape(rows, -1)

        def velocities(load: Array) -> Array:
            # (84), with both terms negative; the paper's first sign is lost in print.
            P_J = -np.linalg.solve(G_J, W_J.T @ M_inv @ load)
            return np.asarray(M_inv @ (load + W_J @ P_J))  # (86)

        # Velocities are linear in impulses: (84), (86) and (90)-(92) are gamma = G P + gamma_free.
        G, gamma_free = W.T @ velocities(W), terms.shifted_velocities(velocities(momentum))
        falls, friction = self.scene.friction.kinetic_ratio != 1.0, terms.friction.tolist()
        last_P, iterations, change = P, 0, math.inf
        while not change < solver.tolerance and iterations < limit:
            gamma = gamma_free + (G @ P.ravel()).reshape(-1, 5)
            if falls:
                factor = falling(self.scene, terms.active, gamma)
                friction = (terms.friction * factor).tolist()
            each = zip(friction, centers, P.tolist(), gamma.tolist(), strict=True)
            P_new = [contact_prox(solver, rule.compliance, *contact) for contact in each]
            last_P, P = P, np.reshape(P_new, P.shape)
            squares = ((P - last_P) ** 2).sum(axis=0)
            change = float(np.sqrt(np.add.reduceat(squares, (0, 1, 3))).sum())  # (93)
            iterations += 1
        u_E = velocities(momentum + W @ last_P.ravel())  # (76)
        return P, last_P, u_E, iterations, change < solver.tolerance


def contact_natural_map(
    r: Solver, compliance: float, friction: Array, center: float, P: Array, gamma: Array
) -> float:
    """Return ``max |P - prox_C(P - r gamma)|/r`` of a contact, sets of the given P_N [m/s]."""
    *radii, radius = friction * P[0]
    P_T = prox_half_ellipses(*(P[1:3] - r.r_sliding * gamma[1:3]), *radii)
    P_V = prox_disc(*(P[3:] - r.r_rolling * gamma[3:]), radius)
    P_N = prox_half_line(P[0] - r.r_normal * (gamma[0] + compliance * (P[0] - center)))
    sliding = float(np.linalg.norm(P[1:3] - P_T)) / r.r_sliding
    rolling = float(np.linalg.norm(P[3:] - P_V)) / r.r_rolling
    return max(float(abs(P[0] - P_N)) / r.r_normal, sliding, rolling)


def _columns(W: Array, contacts: Array, count: int) -> Array:
    """Return the columns of W that belong to the given contacts of `count`."""
    width = W.shape[1] // count
    return W[:, (contacts[:, None] * width + np.arange(width)).ravel()]


def _largest(values: Array) -> float:
    return float(np.abs(values).max(initial=0.0))

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A step of method `bdf2` in dense NumPy, to read beside its equations, as `moreau` is for [1].

The compiled step of `bdf2` is tested against this definition, which is slow and shares no algebra
with it: W_J and P_J are eliminated in a dense system, not in sweeps over links, and contacts are
solved on the dense Delassus operator. A step of the scene has one part or several, see `step`; a
`part` takes a time dt from ``_A`` (its start) to ``_E`` (its end), and the part before took
dt_before, from ``_B`` to ``_A``.

Coordinates x are the pose, shape (7,), and the joint angles, so that joints are closed whatever x
is. The pose is the center of mass [m, frame I] and the Euler parameters p of the middle link.
Velocities u are those of all links, as in [1]; they satisfy ``W_J^T u = 0``. With
``w = dt/dt_before`` the formula BDF2 with variable steps is

    x_hat = x_A + c (x_A - x_B),  u_hat = u_A + c (u_A - u_B),  c = w^2/(1 + 2w),            (i)
    h = dt (1 + w)/(1 + 2w),                                                                (ii)
    x_E = x_hat + h F(x*) u_E,                                                             (iii)
    M u_E = M u_hat + h (h(u*) + W_tau tau_E) + W_J P_J + W P,  W_J^T u_E = 0,              (iv)

where all W are those of the predicted end, ``u* = u_A + w (u_A - u_B)`` and
``x* = x_hat + h F(x_A) u*`` (v). The phase of the memory says what is known:

- SMOOTH: both states before.
- ANEW, after an event or from a given state: ``u_hat = u_A`` and h = dt for velocities,
  ``x_hat = x_A + dt/2 F(x_A) u_A`` and h_q = dt/2 in place of h for coordinates; u* = u_A.  (vi)
- UNKNOWN, if u_A violates the joints: backward Euler, ``u_hat = u_A``, ``x_hat = x_A``, h = dt.

The joint controller acts at the end (vii), ``tau_E = K (ref_E - angle_E) + D (ref_rate_E -
rate_E)`` with ``angle_E = angle_hat + h_q rate_E``, within the laws of `dynamics.joint_laws`; a
stop bounds rate_E so that angle_E reaches it at most. Contacts have the laws of `contact`, with
``gamma_N + shift`` for gamma_N (viii): a contact that may close has the shift gap_hat/h_q, where
``gap_hat = gap(x*) - h_q gamma_N*`` is its gap without the motion of the part; see `shifts`.
If such a contact closes, u_E moves the coordinates, and an impact gives the velocity afterwards:

    M u+ = M u_hat + h (h(u*) + W_tau tau_E) + W_J P_J + W P,  W_J^T u+ = 0,                (ix)

with the shifts of the closed contacts 0. That is (iv) with torques that are known: no spring or
damper acts in an impact, so that the joints are free in it. Gaps of
contacts that carry load are then closed by a move of the configuration alone: by the velocities
that impulses nu on the normals give, ``G_NN nu = -gap/h_q`` (x), added to u_E in (iii) only.

.. [1] A. A. Transeth, R. I. Leine, Ch. Glocker, K. Y. Pettersen, "3-D snake robot motion:
   nonsmooth modeling, simulations, and experiments", IEEE T-RO 24(2), 2008.
"""

from functools import partial
from typing import NamedTuple

import numpy as np

from oracle.closing import goes_far, levers
from oracle.contact_laws import (
    falling,
    selection_center,
    selection_compliance,
    solve_laws,
    viscosity,
)
from oracle.joint_laws import dense_laws, DenseLaws, solve_laws_of_axes
from oracle.pushes import generalized, not_pushed, Pushed, stretches_of
from snake_sim_ros import Robot, Scene, State
from snake_sim_ros.contact.closing import (
    closed_gap,
    COMPLIANCE,
    left_gap,
    most_closed,
    MOST_RELEASES,
)
from snake_sim_ros.contact.detection import LANDING_SPEED
from snake_sim_ros.contact.laws import IMPACT_WEIGHTS, LEAST_COMPLIANCE
from snake_sim_ros.dynamics.force_directions import (
    joint_directions,
    joint_normals,
    mass_matrix,
    mean_delassus,
    scene_contacts,
    scene_gaps,
    smooth_forces,
    torque_directions,
)
from snake_sim_ros.dynamics.joint_laws import make_joint_laws
from snake_sim_ros.scene import obstacles, posture
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.rotations import CONJUGATE, cross, H_bar, product, rotation_matrices
from snake_sim_ros.stepping.bdf2.events import DEEP, FEW, FLAT_GAP, RESTING_GAP
from snake_sim_ros.stepping.bdf2.formula import AFTER_EVENT, ANEW, SMOOTH, TICKS, UNKNOWN
from snake_sim_ros.stepping.bdf2.motion import Bdf2Memory, CONSISTENT_SPEED, Motion
from snake_sim_ros.stepping.bdf2.step import MOST_CLOSINGS, PRESS_SPEED
from snake_sim_ros.stepping.model import MOST_CONDENSED, PROXIMAL
from snake_sim_ros.stepping.pushes import NO_PUSHES, PushTable, STEP, Stretch
from snake_sim_ros.stepping.state import History

FALLS = 200  # iterations of factors of friction, at most


def motion_of(robot: Robot, state: State) -> Motion:
    """Return a state in joint coordinates."""
    pose = np.append(posture.center_of_mass(robot, state.q), state.q[robot.link_count // 2, 3:])
    present = robot.chain.places.present
    rate = present * posture.joint_rates(state.q, state.u, robot)
    return Motion(pose, present * posture.joint_angles(state.q, robot), rate, state.u)


def recognized(robot: Robot, state: State, memory: Bdf2Memory) -> Bdf2Memory:
    """Return the memory to go on with from a given state: UNKNOWN if u violates W_J^T u = 0."""
    R, places = rotation_matrices(state.q[:, 3:]), robot.chain.places
    weights = []
    for j in range(robot.link_count - 1):
        half = float(np.linalg.norm(places.distal[j]))
        weights += [1.0, 1.0, 1.0] + [half] * len(joint_normals(robot, R, j))
    rate = weights * (joint_directions(robot, R).T @ state.u.ravel())
    agrees = float(np.abs(rate).max(initial=0.0)) <= CONSISTENT_SPEED
    phase = np.array([ANEW if agrees else UNKNOWN])
    return memory._replace(end=motion_of(robot, state), q=state.q, phase=phase)


def coordinates(robot: Robot, pose: Array, angle: Array) -> Array:
    """Return q (n, 7) of links with a pose (7,), as in `Motion`, and joint angles (n-1, 2)."""
    q, root = posture.chain_coordinates(robot, angle), robot.link_count // 2
    turn = product(pose[3:], q[root, 3:] * CONJUGATE)
    q[:, 3:] = product(turn, q[:, 3:])
    q[:, :3] = q[:, :3] @ rotation_matrices(turn).T
    q[:, :3] += pose[:3] - posture.center_of_mass(robot, q)
    return q


def moved(robot: Robot, pose: Array, h: float, at: Array, u: Array) -> Array:
    """Return ``pose + h F(at) u``, where `at` is the pose whose middle link turns, eq. (74)."""
    mass = robot.per_link('link_mass')
    turn = H_bar(at[3:]).T @ u[robot.link_count // 2, 3:] / 2
    return pose + h * np.append(mass @ u[:, :3] / mass.sum(), turn)


def end_of(robot: Robot, hat: Motion, h_q: float, at: Array, rate: Array, u: Array) -> Motion:
    """Return ``x_hat + h_q F(at) u``, eqs. (iii), (v), with Euler parameters of length 1."""
    pose = moved(robot, hat.pose, h_q, at, u)
    pose[3:] /= np.linalg.norm(pose[3:])
    return Motion(pose, hat.angle + h_q * rate, rate, u)


def chain_velocities(robot: Robot, R: Array, motion: Motion) -> Array:
    """
    Return the velocities (n, 6) that the joints allow, with the rates and the middle link of u*.

    The u* of other links fit the joints at the predicted end up to the error of prediction only.
    """
    n, root = robot.link_count, robot.link_count // 2
    places, (inner, outer) = robot.chain.places, posture.joint_frames(R, robot)
    front, rear = (np.einsum('iab,ib->ia', R, arm) for arm in (places.distal, places.proximal))
    rates = places.present * motion.rate
    turn = rates[:, :1] * inner[:, :, 1] + rates[:, 1:] * outer[:, :, 0]
    omega = np.tile(R[root] @ motion.u[root, 3:], (n, 1))
    v = np.tile(motion.u[root, :3], (n, 1))
    for i in range(root + 1, n):
        omega[i] = omega[i - 1] + turn[i - 1]
        v[i] = v[i - 1] + cross(omega[i - 1], front[i - 1]) - cross(omega[i], rear[i])
    for i in range(root - 1, -1, -1):
        omega[i] = omega[i + 1] - turn[i]
        v[i] = v[i + 1] + cross(omega[i + 1], rear[i + 1]) - cross(omega[i], front[i])
    return np.hstack([v, np.einsum('iab,ia->ib', R, omega)])


def same(memory: Bdf2Memory, state: State) -> bool:
    """Return whether a state is the end of the last step."""
    return bool((memory.q == state.q).all() and (memory.end.u == state.u).all())


class Formula(NamedTuple):
    """What the states before say about a part, eqs. (i), (ii), (v), (vi)."""

    h: float  # time for which forces act on velocities [s]
    h_q: float  # time for which velocities act on coordinates [s]
    hat: Motion  # its rates are those of the start, and are not used
    star: Motion  # predicted end


def formula(robot: Robot, memory: Bdf2Memory, dt: float) -> Formula:
    """Return what the states before say about a part, eqs. (i), (ii), (v), (vi)."""
    A, B, phase = memory.end, memory.start, memory.phase[0]
    w = dt / memory.dt[0] if phase == SMOOTH else 0.0
    c, h = w**2 / (1 + 2 * w), dt * (1 + w) / (1 + 2 * w)
    hat = Motion(*(a + c * (a - b) for a, b in zip(A, B, strict=True)))
    half = dt / 2 if phase == ANEW else 0.0
    if phase == ANEW:
        pose = moved(robot, A.pose, half, A.pose, A.u)
        hat = hat._replace(pose=pose, angle=A.angle + half * A.rate)
    rate, u = A.rate + w * (A.rate - B.rate), A.u + w * (A.u - B.u)
    return Formula(h, h - half, hat, end_of(robot, hat, h - half, A.pose, rate, u))


class Contacts(NamedTuple):
    """The contacts of a part that may close in it."""

    active: Array  # (k,) their numbers
    W: Array  # (6n, k, 5) directions (normal, sliding x y, rolling x y) at the predicted end
    gap: Array  # (k,) at the predicted end [m]
    approach: Array  # (k,) normal velocities gamma_N* there [m/s]
    last: Array  # (k,) normal impulses of the part before, for a time h [N s]
    loaded: Array  # (k,) whether they carry load
    shift: Array  # (k,) eq. (viii) [m/s]
    friction: Array  # (k, 5) impulses per scaled impulse: 1, largest mu_x, mu_y, mu_V, mu_V
    share: Array  # (k, 2) of mu_x in the largest one, against sliding forward and backward
    compliance: float  # of the selection rule [1/kg]
    center: Array  # (k,) normal impulses about which the rule is compliant [N s]
    viscous: Array  # (6n, 6n) sum of c W W^T over sliding directions, c their viscous friction

    def without_gaps(self, kept: Array) -> 'Contacts':
        """Return some of the contacts, by a mask (k,), with shifts 0."""
        return self._replace(
            active=self.active[kept],
            W=self.W[:, kept],
            gap=self.gap[kept],
            approach=self.approach[kept],
            last=self.last[kept],
            loaded=self.loaded[kept],
            shift=np.zeros(kept.sum()),
            friction=self.friction[kept],
            share=self.share[kept],
            center=self.center[kept],
        )


class Balance(NamedTuple):
    """The balance (iv) with the controller (vii): ``A u_E = momentum + W_J P_J + W P``."""

    M: Array  # (6n, 6n)
    resistance: Array  # (2(n-1),) R = h (D + h_q K), with which A = M + W_tau R W_tau^T
    torque: Array  # (2(n-1),) impulses of the controller without the rates of the end [N m s]
    smooth: Array  # (6n,) M u_hat + h h(u*)
    W_J: Array  # (6n, 4(n-1))
    W_tau: Array  # (6n, 2(n-1))
    viscous: Array | float = 0.0  # (6n, 6n) impulse of viscous friction per velocity

    @property
    def A(self) -> Array:
        """The mass matrix with the implicit part of the controller, and viscous friction."""
        implicit = (self.W_tau * self.resistance) @ self.W_tau.T
        return np.asarray(self.M + implicit + self.viscous)

    @property
    def momentum(self) -> Array:
        """What u_E follows from, but for impulses of joints and contacts."""
        return np.asarray(self.smooth + self.W_tau @ self.torque)

    def velocities(self, loads: Array) -> Array:
        """Return velocities (6n, m) with closed joints for loads (6n, m)."""
        rows, joints = self.W_J.shape
        K = np.block([[self.A, -self.W_J], [self.W_J.T, np.zeros((joints, joints))]])
        return np.linalg.solve(K, np.vstack([loads, np.zeros((joints, loads.shape[1]))]))[:rows]


class PartEnd(NamedTuple):
    """The end of a part."""

    state: State
    motion: Motion  # the same in joint coordinates
    impulse: Array  # (contacts, 5) impulses, of the second solution after a landing [N s]
    h: float  # time for which they acted [s]
    lands: bool  # whether there was a second solution
    jumps: bool  # whether the next part starts anew
    settled: bool  # whether the laws of the joint axes hold
    took_part: Array  # (contacts,) which contacts could close
    gap: Array  # (contacts,) at its end [m]


def balance(
    scene: Scene, R: Array, terms: Formula, angle: Array, rate: Array, pushed: Pushed
) -> Balance:
    """Return the balance (iv) at the predicted end, with references (n-1, 2) of the end."""
    robot, h = scene.robot, terms.h
    M, W_tau = mass_matrix(robot), torque_directions(robot, R)
    K, D = robot.per_joint('stiffness'), robot.per_joint('damping')
    torque = K * (angle - terms.hat.angle) + D * rate  # (vii) without the rate of the end
    return Balance(
        M=M,
        resistance=h * (D + terms.h_q * K).ravel(),
        torque=h * torque.ravel(),
        smooth=M @ terms.hat.u.ravel()
        + h * (smooth_forces(robot, np.array(scene.gravity), terms.star.u) + pushed(R)),
        W_J=joint_directions(robot, R),
        W_tau=W_tau,
    )


def shifts(
    gap: Array, approach: Array, last: Array, h_q: float, dt: float, tolerance: float
) -> Array:
    """
    Return what gaps leave open of the normal velocities, eq. (viii), shape (k,) [m/s].

    An open contact may close its gap and no more. A contact inside the floor is moved out, but by
    no more than it has moved in before the time h_q. A contact that carries load has no gap but
    errors of integration, up to RESTING_GAP.
    """
    gap_hat = gap - h_q * approach
    inside = np.maximum(gap_hat, (dt - h_q) * np.minimum(0.0, approach))
    shift = np.where(gap_hat > tolerance, gap_hat, np.where(gap_hat < 0.0, inside, 0.0)) / h_q
    return np.where((last > 0.0) & (gap <= RESTING_GAP), 0.0, shift)


def contacts_of(
    scene: Scene, q: Array, u: Array, terms: Formula, dt: float, impulse: Array, takes_part: Array
) -> Contacts:
    """Return the contacts that may close, at the predicted end q (n, 7) with velocities (n, 6)."""
    h, h_q, solver = terms.h, terms.h_q, scene.solver
    gap, *directions = scene_contacts(scene, q)
    closed = closed_gap(solver.activation_tolerance, scene.dt)
    near = gap <= max(closed, LANDING_SPEED * h_q)
    active = np.flatnonzero(near | (takes_part & np.isfinite(gap)))
    W = np.concatenate([W_k.reshape(u.size, len(gap), -1) for W_k in directions], axis=2)
    W, gap, last = W[:, active], gap[active], impulse[active, 0]
    gamma = np.einsum('rkj,r->kj', W, u.ravel())
    approach = gamma[:, 0].copy()
    shift = shifts(gap, approach, last, h_q, dt, closed)
    gamma[:, 0] += shift
    compliance, center = selection_rule(scene, active, h, gamma[:, :3], last)
    mu = obstacles.contact_friction(scene, active, q)
    along = mu[:, :2].max(axis=1, keepdims=True)
    share = np.divide(mu[:, :2], along, out=np.ones((len(mu), 2)), where=along > 0.0)
    friction = np.hstack([np.ones((len(mu), 1)), along, mu[:, 2:4], mu[:, 3:4]])
    loaded, W_T = last > 0.0, W[:, :, 1:3].reshape(u.size, -1)
    return Contacts(
        active, W, gap, approach, last, loaded, shift, friction, share, compliance, center,
        (W_T * viscosity(scene, active, mu[:, 4], shift)) @ W_T.T,
    )  # fmt: skip


def selection_rule(
    scene: Scene, active: Array, h: float, gamma: Array, last: Array
) -> tuple[float, Array]:
    """Return compliance and centers (k,) of the selection rule, see `contact.laws`."""
    mass, size = scene.robot.per_link('link_mass'), mean_delassus(scene.robot)
    fall = -h * scene.gravity[2]
    stops = mass[obstacles.contact_links(scene)[active, 0]] * (fall / 2 - 2 * gamma[:, 0])
    most = float(np.append(last, stops).max(initial=0.0))
    compliance = selection_compliance(
        scene.solver.normal_compliance * size, LEAST_COMPLIANCE * size, most, PRESS_SPEED
    )
    return compliance, selection_center(last, gamma, fall * float(mass.sum()))


def solve_contacts(contacts: Contacts, free: Array, response: Array) -> tuple[Array, Array]:
    """
    Return u_E (n, 6) and the impulses (k, 5) that satisfy the balance (iv) and the laws (viii).

    The balance gives velocities `free` (6n,) without contacts and `response` (6n, 5k) to impulses.

    Impulses are scaled with the coefficients of friction, so that ellipses become discs of
    radius P_N, of which `share` leaves less on one side: the impulses of a contact are ``friction
    * P`` and the laws those of ``friction * gamma``, with ``gamma = G P + gamma_free``. The
    selection rule adds ``compliance (P_N - center)`` to gamma_N.
    """
    scale = contacts.friction.ravel()
    W, response = contacts.W.reshape(len(free), -1) * scale, response * scale
    G, gamma_free = W.T @ response, (W.T @ free).reshape(-1, 5)
    normals = np.arange(0, len(G), 5)
    G[normals, normals] += contacts.compliance
    gamma_free[:, 0] += contacts.shift - contacts.compliance * contacts.center
    P = solve_laws(G, gamma_free.ravel(), contacts.share)
    u_E = free + response @ P
    return u_E.reshape(-1, 6), P.reshape(-1, 5) * contacts.friction


def solve_falling(scene: Scene, terms: Balance, contacts: Contacts) -> tuple[Array, Array]:
    """
    Return what `solve_contacts` does, where sliding friction falls with speed.

    The factor of each contact is found by iteration: it is larger where the contact is slower, and
    the contact is slower where it is larger, so that the iterates go one way.
    """
    factor = np.ones((len(contacts.active), 1))
    W = contacts.W.reshape(len(terms.M), -1)
    solution = terms.velocities(np.column_stack([terms.momentum, W]))
    free, response = solution[:, 0], solution[:, 1:]
    for _ in range(FALLS):
        friction = contacts.friction.copy()
        friction[:, 1:] *= factor
        u_E, P = solve_contacts(contacts._replace(friction=friction), free, response)
        gamma = np.einsum('rkj,r->kj', contacts.W, u_E.ravel())
        before, factor = factor, falling(scene, contacts.active, gamma)
        if np.abs(factor - before).max(initial=0.0) <= 1e-15:
            break
    return u_E, P


def solve_all(
    scene: Scene, dynamics: Balance, contacts: Contacts, laws: DenseLaws, rate: Array
) -> tuple[tuple[Array, Array, Balance], Array, Array, int, bool]:
    """Return what `solve_laws_of_axes` does, with u_E, P and the balance that they satisfy."""

    def solve(torque: Array, damping: Array, limit: int) -> tuple[Array, object, int]:
        terms = dynamics._replace(torque=torque.ravel(), resistance=damping.ravel())
        u_E, P = solve_falling(scene, terms, contacts)
        return (terms.W_tau.T @ u_E.ravel()).reshape(-1, 2), (u_E, P, terms), 0

    return solve_laws_of_axes(laws, make_joint_laws(scene.robot).inertia, rate, solve, 1)


def jumps(contacts: Contacts, P_N: Array, weight: float) -> bool:
    """
    Return whether velocities jump: a contact meets the floor, or an impulse is that of an impact.

    `weight` is that of the robot times h [N s].
    """
    meets = (P_N > 0.0) & (contacts.last <= 0.0) & (contacts.approach < 0.0)
    most = IMPACT_WEIGHTS * max(weight, float(contacts.last.max(initial=0.0)))
    return bool((meets | (P_N > most)).any())


def end_gaps(contacts: Contacts, u_E: Array, h_q: float) -> Array:
    """Return the gaps (k,) that u_E leads to, linear about the predicted end [m]."""
    gamma_N = np.einsum('rk,r->k', contacts.W[:, :, 0], u_E.ravel())
    return np.asarray(contacts.gap + h_q * (gamma_N - contacts.approach))


def closing_velocities(
    scene: Scene, terms: Balance, contacts: Contacts, closes: Array, gap: Array, h_q: float,
    few: bool,
) -> Array:  # fmt: skip
    """
    Return the velocities (n, 6) that close gaps (k,) of a mask within a time h_q, eq. (x).

    Contacts that they would pull are left out as in `closing.Closing.moves`. Normal
    directions W_N may depend on each other: a little compliance leaves the smallest impulses. The
    compiled step has one for few contacts and one for many.
    """
    largest, lever = np.abs(gap[closes]).max(), levers(scene.robot)
    for _ in range(1 if obstacles.is_flat(scene) else MOST_RELEASES + 1):
        u, nu = _closing(scene, terms, contacts.W[:, closes, 0], gap[closes], h_q, few)
        far = goes_far(lever, h_q * u[:, :3], h_q * u[:, 3:], largest)
        pulls = np.zeros_like(closes)
        pulls[closes] = nu < 0.0
        closes = closes & ((contacts.loaded & ~far) | ~pulls)
    return u


def _closing(
    scene: Scene, terms: Balance, W_N: Array, gap: Array, h_q: float, few: bool
) -> tuple[Array, Array]:
    """Return the velocities (n, 6) that close gaps (k,), and their impulses."""
    response = terms.velocities(W_N)
    G = W_N.T @ response
    little = COMPLIANCE * np.diag(G) if few else PROXIMAL * mean_delassus(scene.robot)
    nu = np.linalg.solve(G + little * np.eye(len(gap)), -gap / h_q)
    return np.asarray(response @ nu).reshape(-1, 6), nu


def placed(
    scene: Scene, terms: Formula, dynamics: Balance, contacts: Contacts, u_E: Array, gap: Array,
    start_gap: Array, few: bool,
) -> tuple[Motion, Array, Array]:  # fmt: skip
    """
    Return the motion that u_E leads to, eq. (iii), and q_E (n, 7), with closed gaps, eq. (x).

    The third array is that of all gaps at q_E.

    `gap` is that of `end_gaps`, and `start_gap` that at the start if any contact was deep there.
    Gaps are closed of contacts that carry load, or that are deeper than at the start.
    """
    robot, W_tau, u = scene.robot, dynamics.W_tau, u_E
    left = left_gap(closed_gap(scene.solver.activation_tolerance, scene.dt))
    left = min(left, FLAT_GAP) if contacts.loaded.sum() > FEW else left
    for attempt in range(MOST_CLOSINGS + 1):
        gap = gap - start_gap
        closes = (np.abs(gap) <= most_closed(scene.dt)) & ((gap < 0.0) | contacts.loaded)
        if attempt < MOST_CLOSINGS and np.abs(gap[closes]).max(initial=0.0) > left:
            u = u + closing_velocities(scene, dynamics, contacts, closes, gap, terms.h_q, few)
        elif attempt > 0:
            break
        rate = (W_tau.T @ u.ravel()).reshape(-1, 2)
        end = end_of(robot, terms.hat, terms.h_q, terms.star.pose, rate, u)
        q_E = coordinates(robot, end.pose, end.angle)
        gap_E = scene_gaps(scene, q_E)
        gap = gap_E[contacts.active]
    return end, q_E, gap_E


def closed_at_end(contacts: Contacts, P_N: Array, gap: Array, tolerance: float) -> Array:
    """Return which contacts are closed at the end of a part that lands, as a mask (k,)."""
    return np.asarray((P_N > 0.0) | (contacts.shift == 0.0) | (gap <= tolerance))


def problem(
    scene: Scene, history: History, dt: float, angle: Array, rate: Array,
    takes_part: Array | None = None, pushed: Pushed = not_pushed,
) -> tuple[Formula, Contacts, Balance]:  # fmt: skip
    """
    Return what the velocities at the end of a part of length dt have to satisfy.

    The history is that of the part before; its impulses count for the time h of this part. Joint
    references (n-1, 2) are those of the end, and `pushed` returns the force (6n,) of pushes for
    link frames. Contacts of a mask (contacts,) take part whatever their gaps.
    """
    robot, memory = scene.robot, history.memory
    terms = formula(robot, memory, dt)
    q_star = coordinates(robot, terms.star.pose, terms.star.angle)
    R = rotation_matrices(q_star[:, 3:])
    known = history.memory.phase[0] != UNKNOWN  # else velocities do not fit the joints
    u_star = chain_velocities(robot, R, terms.star) if known else terms.star.u
    last = history.impulse * (terms.h / (memory.span[0] or scene.dt))
    asked = np.zeros(len(last), dtype=bool) if takes_part is None else takes_part
    contacts = contacts_of(scene, q_star, u_star, terms, dt, last, asked)
    dynamics = balance(scene, R, terms, angle, rate, pushed)
    return terms, contacts, dynamics._replace(viscous=terms.h * contacts.viscous)


def part(
    scene: Scene, history: History, dt: float, angle: Array, rate: Array,
    takes_part: Array | None = None, pushed: Pushed = not_pushed,
) -> PartEnd:  # fmt: skip
    """Return the end of a part of length dt; the parameters are those of `problem`."""
    terms, contacts, dynamics = problem(scene, history, dt, angle, rate, takes_part, pushed)
    candidates = contacts
    of_joints, angle_A = make_joint_laws(scene.robot), history.memory.end.angle
    low, high = of_joints.stop[..., 0], of_joints.stop[..., 1]
    stops = np.minimum(low, angle_A), np.maximum(high, angle_A)
    bounds = ((stop - terms.hat.angle) / terms.h_q for stop in stops)
    laws = dense_laws(of_joints, terms.h, dynamics.torque, dynamics.resistance, *bounds)
    (u_E, P, dynamics), joint_rate, torque, _, settled = solve_all(
        scene, dynamics, contacts, laws, terms.star.rate
    )
    weight = -terms.h * scene.gravity[2] * float(scene.robot.per_link('link_mass').sum())
    meets = bool(laws.meets_stop(joint_rate).any())
    lands = meets or bool((contacts.shift[P[:, 0] > 0.0] != 0.0).any())
    anew = lands or jumps(contacts, P[:, 0], weight)
    gap, moving, closed = end_gaps(contacts, u_E, terms.h_q), u_E, np.ones(len(P), dtype=bool)
    if lands:  # (ix)
        tolerance = closed_gap(scene.solver.activation_tolerance, scene.dt)
        closed = closed_at_end(contacts, P[:, 0], gap, tolerance)
        contacts = contacts.without_gaps(closed)
        laws = laws.in_impact(joint_rate, torque)
        u_E, P, dynamics = solve_all(scene, dynamics, contacts, laws, joint_rate)[0]
    candidates.loaded[:] = False
    candidates.loaded[closed] = P[:, 0] > 0.0
    start_gap = np.zeros(len(candidates.active))
    if history.memory.depth[0] > DEEP:
        q_A = coordinates(scene.robot, history.memory.end.pose, history.memory.end.angle)
        start_gap = np.minimum(scene_gaps(scene, q_A)[candidates.active], 0.0)
    few = len(P) <= MOST_CONDENSED
    end, q_E, gap_E = placed(scene, terms, dynamics, candidates, moving, gap, start_gap, few)
    end = end._replace(rate=(dynamics.W_tau.T @ u_E.ravel()).reshape(-1, 2), u=u_E)
    took_part = np.zeros(len(history.impulse), dtype=bool)
    took_part[candidates.active] = True
    impulse = np.zeros(history.impulse.shape)
    impulse[contacts.active] = np.where(P[:, :1] > 0.0, P, 0.0)
    return PartEnd(State(q_E, u_E), end, impulse, terms.h, lands, anew, settled, took_part, gap_E)


def remembered(history: History, dt: float, end: PartEnd) -> Bdf2Memory:
    """Return the memory after a part of length dt."""
    memory = history.memory
    unsure = end.jumps or memory.phase[0] == UNKNOWN
    return Bdf2Memory(
        end=end.motion,
        start=memory.end,
        q=end.state.q,
        reference_rate=memory.reference_rate,
        dt=np.array([dt]),
        span=np.array([end.h]),
        phase=np.array([ANEW if unsure else SMOOTH]),
        ticks=memory.ticks,
        depth=memory.depth,
    )


def depth_of(scene: Scene, state: State) -> float:
    """Return how deep the robot is inside of something [m], 0 if it is not."""
    return max(0.0, -float(scene_gaps(scene, state.q).min()))


def references(
    scene: Scene, known: Bdf2Memory, angle: Array, rate: Array, late: float
) -> tuple[Array, Array]:
    """
    Return the joint references a time `late` [s] after the middle of a step, from those there.

    They have the mean acceleration since the step before, if the memory of it is known.
    """
    acceleration = 0.0 * rate
    if known.span[0] > 0.0:
        acceleration = (rate - known.reference_rate) / scene.dt
    return angle + late * (rate + late / 2 * acceleration), rate + late * acceleration


def after_change(history: History, pushes: PushTable, stretch: Stretch) -> History:
    """Return the history to go on with in a stretch, anew if a push begins or ends there."""
    smooth = history.memory.phase[0] == SMOOTH
    if not (smooth and stretch.begin in (*pushes.begin, *pushes.end)):
        return history
    return history._replace(memory=history.memory._replace(phase=np.array([ANEW])))


def step(
    scene: Scene, state: State, history: History, angle: Array, rate: Array, first: int,
    pushes: PushTable = NO_PUSHES,
) -> list[PartEnd]:  # fmt: skip
    """
    Return the ends of the parts of a step of the scene, with references (n-1, 2) of its middle.

    Its first part is ``1/first`` of it. Parts double where they fit. A part with an end inside the
    floor is repeated with the contacts that are deep there and, if all of them took part, with
    half of its length. Where a push begins or ends, the step is divided first.
    """
    memory, ends, done, size = history.memory, [], 0, TICKS // first
    nobody = takes_part = np.zeros(len(history.impulse), dtype=bool)
    known = memory
    if not (memory.phase[0] != UNKNOWN and same(memory, state)):
        history = history._replace(memory=recognized(scene.robot, state, memory))
        inside = np.array([depth_of(scene, state)])
        history = history._replace(memory=history.memory._replace(depth=inside))
    stretches = stretches_of(pushes)
    history = after_change(history, pushes, stretches[0])
    while done < TICKS:
        while done % size:
            size //= 2
        stretch = stretches[0]
        length = (stretch.end - stretch.begin) / STEP
        late = (stretch.begin - stretch.step_end) / STEP + length * (done + size) / TICKS
        dt, late = scene.dt * length * size / TICKS, scene.dt * (late + 0.5)
        told, pushed = references(scene, known, angle, rate, late), partial(generalized, pushes)
        end = part(scene, history, dt, *told, takes_part, partial(pushed, stretch))
        takes_part = takes_part | end.took_part
        depth, before = max(0.0, -float(end.gap.min())), history.memory.depth[0]
        closed = closed_gap(scene.solver.activation_tolerance, scene.dt)
        deep = depth > (before + closed if before > DEEP else DEEP)
        deep_ones = end.gap <= -DEEP
        if deep and (deep_ones & ~takes_part).any():
            takes_part = takes_part | deep_ones
        elif deep and size > 1:
            size //= 2
        else:
            ends.append(end)
            memory = remembered(history, dt, end)._replace(depth=np.array([depth]))
            history = history._replace(impulse=end.impulse, memory=memory)
            done, size, takes_part = done + size, min(2 * size, TICKS), nobody
            if done == TICKS and len(stretches) > 1:
                del stretches[0]
                history = after_change(history, pushes, stretches[0])
                done, size = 0, TICKS // AFTER_EVENT
    return ends

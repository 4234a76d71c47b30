# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""One step of the paper's scheme in dense NumPy, to judge the results of compiled solvers."""

from dataclasses import dataclass, replace

import numpy as np
from oracle import make_stepper, moreau
from oracle.contact_laws import selection_center, selection_compliance

from snake_sim_ros import Report, Scene, State
from snake_sim_ros.contact.closing import closed_gap
from snake_sim_ros.contact.detection import reach_of_step
from snake_sim_ros.contact.laws import LEAST_COMPLIANCE
from snake_sim_ros.dynamics import force_directions
from snake_sim_ros.dynamics.joint_control import make_control_memory
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.posture import gaps
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.model import PROXIMAL
from snake_sim_ros.stepping.state import History

EPS = np.finfo(float).eps


@dataclass
class DenseStep:
    """
    The linear part of a step, eqs. (75), (76): velocities that follow from contact impulses.

    Attributes
    ----------
    active : ndarray, shape (k,)
        Closed contacts.
    W : ndarray, shape (6n, k, 5)
        Directions (normal, sliding x y, rolling x y): ``gamma = W^T u``.
    M : ndarray, shape (6n, 6n)
        Mass matrix with the implicit part of the controller.
    W_J : ndarray, shape (6n, 4(n-1))
    momentum : ndarray, shape (6n,)
    compliance : float
        Of the selection rule in this step [1/kg].
    center : ndarray, shape (k,)
        Normal impulses about which the rule is compliant [N s].
    shift : ndarray, shape (k,)
        What gaps leave open of the normal velocities: ``gamma_N + shift`` is in the law [m/s].

    """

    scene: Scene
    active: Array
    W: Array
    M: Array
    W_J: Array
    momentum: Array
    compliance: float
    center: Array
    shift: Array

    def velocities(self, P: Array) -> Array:
        """Return u (6n,) for impulses (k, 5) of the closed contacts, with closed joints."""
        right = self.momentum + np.einsum('rkj,kj->r', self.W, P)
        return self._balance(right[:, None])[:, 0]

    def _balance(self, loads: Array) -> Array:
        """Return velocities (6n, m) for loads (6n, m) with closed joints."""
        rows, joints = self.W_J.shape
        K = np.zeros((rows + joints, rows + joints))
        K[:rows, :rows], K[:rows, rows:], K[rows:, :rows] = self.M, -self.W_J, self.W_J.T
        return np.linalg.solve(K, np.vstack([loads, np.zeros((joints, loads.shape[1]))]))[:rows]

    def responses(self) -> Array:
        """Return the velocities (6n, 5k) for a unit of every impulse."""
        return self._balance(self.W.reshape(len(self.W), -1))

    def gamma(self, u: Array) -> Array:
        """Return relative velocities (k, 5) with their shifts, as the laws take them."""
        gamma = np.einsum('rkj,r->kj', self.W, u.ravel())
        gamma[:, 0] += self.shift
        return gamma

    def energy(self, u: Array) -> float:
        """Return u^T M u/2, with the implicit controller; contact impulses cannot increase it."""
        return float(u.ravel() @ self.M @ u.ravel()) / 2

    def delassus(self) -> Array:
        """Return G (5k, 5k): gamma = G P + gamma_free."""
        W = self.W.reshape(len(self.W), -1)
        columns = np.linalg.solve(self.M, np.hstack([W, self.W_J]))
        split = W.shape[1]
        G, H = W.T @ columns[:, :split], self.W_J.T @ columns[:, :split]
        if self.W_J.shape[1]:
            G = G - H.T @ np.linalg.solve(self.W_J.T @ columns[:, split:], H)
        return G

    def balance_error(self, P: Array, u: Array) -> float:
        """
        Return a bound for the rounding error ``velocities(P) - u`` in the balance of `newton`.

        Impulses are those of the proximal laws at u, ``dP = -S dgamma``. The normal law has
        1/(compliance + c), c = PROXIMAL G; friction 2/c where it sticks and P_N mu^2/|mu gamma|
        where it slides, and follows the normal impulse with mu. A contact velocity rounds ten
        times a number up to |u|: v and two products with lengths below 1 m, twice.
        """
        gamma, P_N = self.gamma(u), P[:, 0]
        proximal = PROXIMAL * force_directions.mean_delassus(self.scene.robot)
        S = np.zeros(P.shape)
        S[:, 0] = np.where(P_N > 0.0, 1.0 / (self.compliance + proximal), 0.0)
        friction = self.scene.friction
        for part, mu in (
            (slice(1, 3), (friction.longitudinal, friction.transversal)),
            (slice(3, 5), (friction.rolling, friction.rolling)),
        ):
            slip = np.maximum(np.linalg.norm(mu * gamma[:, part], axis=1), 1e-300)
            stiffness = np.minimum(2.0 / proximal, P_N * max(mu) ** 2 / slip)
            S[:, part] = stiffness[:, None] + max(mu) * S[:, :1]
        speed = max(1e-3, float(np.abs(u).max()))
        # The condition of the joints: 1.4e5 for the paper's robot.
        return (
            10 * EPS * speed * float((np.abs(self.responses()) @ S.ravel()).max())
            + 1.4e5 * EPS * speed
        )

    def residual(self, P: Array, gamma: Array, compliance: float) -> float:
        """Return the exact natural-map residual of all closed contacts [m/s]."""
        floor, solver = self.scene.friction, self.scene.solver
        mu = (floor.longitudinal, floor.against_backward, floor.transversal, floor.rolling)
        friction = np.tile(mu, (len(P), 1))
        each = zip(friction, self.center, P, gamma, strict=True)
        return max(
            (moreau.contact_natural_map(solver, compliance, *contact) for contact in each),
            default=0.0,
        )


@dataclass
class MoreauStep(DenseStep):
    """
    The linear part of a step of the paper.

    Attributes
    ----------
    landed : bool
        Whether it is that of a landing.

    """

    landed: bool = False

    def after_landing(self, P: Array) -> 'MoreauStep':
        """
        Return the step as it was solved last, from its impulses (k, 5).

        It is this one or, if contacts with gaps carry load, that of all contacts that are closed.
        """
        loaded = P[:, 0] > 0.0
        if not self.shift[loaded].any():
            return self
        kept = (self.shift == 0.0) | loaded
        return replace(
            self,
            active=self.active[kept],
            W=self.W[:, kept],
            center=self.center[kept],
            shift=np.zeros(kept.sum()),
            landed=True,
        )


def dense_step(
    scene: Scene, state: State, history: History, angle: Array, rate: Array
) -> MoreauStep:
    """Return the step from a state with one reference (n-1, 2)."""
    robot, dt, n = scene.robot, scene.dt, scene.robot.link_count
    q_M = moreau.middle_coordinates(state, dt)
    R = rotation_matrices(q_M[:, 3:])
    closed, gap = closed_gap(scene.solver.activation_tolerance, dt), gaps(robot, q_M)
    active = np.flatnonzero(gap <= reach_of_step(closed, dt / 2))
    W_N, W_T, W_V = force_directions.contact_directions(robot, R)
    W = np.concatenate(
        [W_N[:, :, None], W_T.reshape(6 * n, -1, 2), W_V.reshape(6 * n, -1, 2)], axis=2
    )[:, active]
    W_tau = force_directions.torque_directions(robot, R)
    torque, damping = moreau.joint_torque_law(
        scene, state, q_M, make_control_memory(scene), angle, rate
    )
    M, u_A = force_directions.mass_matrix(robot), state.u.ravel()
    h = force_directions.smooth_forces(robot, np.array(scene.gravity), state.u)
    gamma_A = np.einsum('rkj,r->kj', W[:, :, :3], u_A)
    stop = -dt * scene.gravity[2] / 2 - 2.0 * gamma_A[:, 0]
    last = history.impulse[active, 0]
    expected = np.append(last, robot.per_link('link_mass')[active % n] * stop)
    most = float(expected.max(initial=0.0))
    size = force_directions.mean_delassus(robot)
    compliance = selection_compliance(
        scene.solver.normal_compliance * size, LEAST_COMPLIANCE * size, most
    )
    weight = -dt * scene.gravity[2] * robot.per_link('link_mass').sum()
    return MoreauStep(
        scene=scene,
        active=active,
        W=W,
        M=M + dt * (W_tau * damping) @ W_tau.T,
        W_J=force_directions.joint_directions(robot, R),
        momentum=M @ u_A + h * dt + W_tau @ torque * dt,
        compliance=compliance,
        center=selection_center(last, gamma_A, weight),
        shift=np.where(gap > closed, gap / (dt / 2), 0.0)[active],
    )


def solved_step(
    scene: Scene, state: State, history: History, angle: Array, rate: Array
) -> tuple[MoreauStep, Array, Array, Report]:
    """Return the dense step, impulses and velocities of a scene's method, and its report."""
    step = dense_step(scene, state, history, angle, rate)
    end, history, report = one_step(scene, state, history, angle, rate)
    step = step.after_landing(history.impulse[step.active])
    return step, history.impulse[step.active], end.u, report


def rounding(P: Array, u: Array) -> float:
    """Return a bound for what rounding makes of a residual [m/s]."""
    # A contact velocity sums over a dozen products, 100 EPS |u| is ample; an impulse is rounded to
    # EPS |P|, and the residual divides it by r_T = 0.01 kg.
    return float(100 * EPS * (np.abs(u).max() + np.abs(P).max(initial=0.0) / 0.01))


def one_step(
    scene: Scene, state: State, history: History, angle: Array, rate: Array
) -> tuple[State, History, Report]:
    """Return state, history and report after one step with one reference (n-1, 2)."""
    return make_stepper(scene).advance(state, history, angle[None], rate[None])

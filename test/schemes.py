"""
The steps of all methods in dense NumPy: which balance and which laws a step of each has to hold.

Methods of the paper's step hold them in its middle, see `dense_step`. `bdf2` holds them at the end
that is predicted from two states, for a part of the step. What is here follows the equations in
the docstring of `bdf2`, with the matrices of `reference`, and shares no code with the solver.
"""

from dataclasses import dataclass
from dataclasses import replace

from dense_step import dense_step
from dense_step import DenseStep
from dense_step import EPS
import numpy as np
from scenes import whole_steps

from snake_sim_ros.contact.selection import LEAST_COMPLIANCE
from snake_sim_ros.contact.selection import PRESS_SPEED
from snake_sim_ros.contact.selection import selection_center
from snake_sim_ros.contact.selection import selection_compliance
from snake_sim_ros.dynamics import force_directions
from snake_sim_ros.scene import posture
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.posture import gaps
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping import bdf2
from snake_sim_ros.stepping import bdf2_memory
from snake_sim_ros.stepping import events
from snake_sim_ros.stepping import reference
from snake_sim_ros.stepping.methods import empty_history
from snake_sim_ros.stepping.state import History
from snake_sim_ros.stepping.state import State


def span(scene: Scene) -> float:
    """Return the time for which the impulses of a step act that nothing disturbs [s]."""
    return whole_steps(scene.method) * scene.dt


def of_two_states(history: History) -> bool:
    """Return whether the next step of `bdf2` uses the formula of two states."""
    return bool(history.memory.phase[0] == bdf2_memory.SMOOTH)


def before_last(history: History) -> State:
    """Return the state that `bdf2` keeps of the start of the last step, in space."""
    return State(history.memory.q_before, history.memory.u_before)


def in_motion(scene: Scene, before: State, now: State) -> History:
    """Return a history without contacts, of a robot that came from one state to another."""
    memory = bdf2_memory.Bdf2Memory(
        q_before=before.q.copy(),
        u_before=before.u.copy(),
        q=now.q.copy(),
        u=now.u.copy(),
        rate=np.zeros((scene.robot.link_count - 1, 2)),
        span=np.array([span(scene)]),
        phase=np.array([bdf2_memory.SMOOTH]),
    )
    return empty_history(scene)._replace(memory=memory)


def undisturbed(scene: Scene, state: State) -> History:
    """
    Return a history without contacts, of a robot that moved with these velocities for a step.

    Without it the first step of `bdf2` has two parts, and its end shows only the second one.
    """
    if scene.method != 'bdf2':
        return empty_history(scene)
    q = moved(state.q, state.q, state.u, -scene.dt)
    return in_motion(scene, State(q, state.u), state)


def press_of(scene: Scene) -> float:
    """Return the velocity at which the method may press a contact into the floor [m/s]."""
    return bdf2.PRESS_SPEED if scene.method == 'bdf2' else PRESS_SPEED


def moved(frame: Array, start: Array, u: Array, time: float) -> Array:
    """Return ``start + time F(frame) u``, Euler parameters of length 1, shape (n, 7)."""
    q = start.copy()
    for i, (v, omega) in enumerate(zip(u[:, :3], u[:, 3:], strict=True)):
        q[i, :3] += time * v
        q[i, 3:] += time / 2 * reference.H_bar(frame[i, 3:]).T @ omega
        q[i, 3:] /= np.linalg.norm(q[i, 3:])
    return q


@dataclass
class Bdf2Step(DenseStep):
    """
    A step of `bdf2` in terms of a `DenseStep`, see there.

    Attributes
    ----------
    frame, q_hat : ndarray, shape (n, 7)
        ``q_E = q_hat + h F(frame) u_E``.
    ahead : ndarray, shape (k,)
        Gaps without the velocity of the end, linear about the predicted end [m].
    h : float
        Time over which it acts [s].

    """

    frame: Array
    q_hat: Array
    ahead: Array
    h: float

    def moved_with(self, q: Array) -> Array:
        """Return the velocities (n, 6) that took q_hat to q: those before a second solution."""
        u = np.zeros((len(q), 6))
        for i, (start, end, p) in enumerate(zip(self.q_hat, q, self.frame[:, 3:], strict=True)):
            u[i, :3] = (end[:3] - start[:3]) / self.h
            end_p = end[3:] * (start[3:] @ p) / (end[3:] @ p)  # its length before it became 1
            u[i, 3:] = 2 / self.h * reference.H_bar(p) @ (end_p - start[3:]) / (p @ p)
        return u

    def landed(self, q: Array) -> 'Bdf2Step':
        """Return the step solved once more for the contacts that are closed at its end q."""
        end = self.ahead + self.h * DenseStep.gamma(self, self.moved_with(q))[:, 0]
        end -= self.h * self.shift
        kept = (end <= self.scene.solver.activation_tolerance) | (self.shift == 0.0)
        return replace(
            self,
            active=self.active[kept],
            W=self.W[:, kept],
            center=self.center[kept],
            shift=np.zeros(kept.sum()),
            ahead=self.ahead[kept],
        )


def bdf2_step(
    scene: Scene, before: State, now: State, history: History, angle: Array, rate: Array,
    last_rate: Array,
) -> Bdf2Step:  # fmt: skip
    """
    Return the step of `bdf2` from two states, with references (n-1, 2) of its middle.

    Impulses in `history` are those of the last step, `last_rate` is its rate of the references.
    """
    robot, dt, n = scene.robot, scene.dt, scene.robot.link_count
    h = 2 / 3 * dt
    q_hat, u_hat = (4 * now.q - before.q) / 3, (4 * now.u - before.u) / 3
    u_star = 2 * now.u - before.u
    frame = 2 * now.q - before.q
    q_star = moved(frame, q_hat, u_star, h)
    R, M = rotation_matrices(q_star[:, 3:]), force_directions.mass_matrix(robot)

    # Controller, linear about the predicted end; references go on as they did.
    acceleration = (rate - last_rate) / dt
    target = angle + dt / 2 * (rate + dt / 4 * acceleration), rate + dt / 2 * acceleration
    rate_star = posture.joint_rates(q_star, u_star)
    stiffness, damping = robot.per_joint('stiffness'), robot.per_joint('damping')
    torque = stiffness * (target[0] - posture.joint_angles(q_star) + h * rate_star)
    torque += damping * target[1]
    resistance = damping + h * stiffness
    W_tau = force_directions.torque_directions(R)

    # Contacts that may close, and what their gaps leave open.
    gap = gaps(robot, q_star)
    reach = max(scene.solver.activation_tolerance, events.LANDING_SPEED * h)
    active = np.flatnonzero(gap <= reach)
    W_N, W_T, W_V = force_directions.contact_directions(robot, R)
    W = np.concatenate(
        [W_N[:, :, None], W_T.reshape(6 * n, -1, 2), W_V.reshape(6 * n, -1, 2)], axis=2
    )[:, active]
    gamma = np.einsum('rkj,r->kj', W, u_star.ravel())
    gap, last = gap[active], history.impulse[active, 0] * h / history.memory.span[0]
    ahead = gap - h * gamma[:, 0]  # where the contact would be without the motion of the step
    rests = (last > 0.0) & (gap <= events.RESTING_GAP)
    out = np.maximum(ahead, (dt - h) * np.minimum(0.0, gamma[:, 0]))  # of what is inside by then
    open_ = ahead > scene.solver.activation_tolerance
    shift = np.where(rests, 0.0, np.where(open_, ahead, np.minimum(out, 0.0))) / h
    gamma[:, 0] += shift

    # The selection rule.
    fall, size = -h * scene.gravity[2], force_directions.mean_delassus(robot)
    mass = robot.per_link('link_mass')
    stops = mass[active % n] * (fall / 2 - 2 * gamma[:, 0])
    most = float(np.append(last, stops).max(initial=0.0))
    compliance = selection_compliance(
        scene.solver.normal_compliance * size, LEAST_COMPLIANCE * size, most, bdf2.PRESS_SPEED
    )
    center = selection_center(
        dt, last, gamma[:, :3], gap, compliance, most, fall * mass.sum(), bdf2.PRESS_SPEED
    )
    return Bdf2Step(
        scene=scene,
        active=active,
        W=W,
        M=M + h * (W_tau * resistance.ravel()) @ W_tau.T,
        W_J=force_directions.joint_directions(robot, R),
        momentum=M @ u_hat.ravel()
        + h * force_directions.smooth_forces(robot, np.array(scene.gravity), u_star)
        + h * W_tau @ torque.ravel(),
        compliance=compliance,
        center=center,
        shift=shift,
        frame=frame,
        q_hat=q_hat,
        ahead=ahead,
        h=h,
    )


def step_of(scene: Scene, state: State, history: History, angle: Array, rate: Array) -> DenseStep:
    """Return the step of the scene's method; of `bdf2` one that `of_two_states` says it is."""
    if scene.method != 'bdf2':
        return dense_step(scene, state, history, angle, rate)
    before, last_rate = before_last(history), history.memory.rate
    return bdf2_step(scene, before, state, history, angle, rate, last_rate)


def check_laws(step: DenseStep, P: Array, u: Array, error: float, off: float) -> None:
    """
    Check T20 of a step that converged: complementarity, ellipses, and what contacts take.

    Parameters
    ----------
    step : DenseStep
    P : ndarray, shape (k, 5)
        Impulses of the closed contacts.
    u : ndarray, shape (n, 6)
        Velocities at the end.
    error : float
        Natural-map residual that is left [m/s].
    off : float
        How far u may be from what the impulses give [m/s].

    """
    friction, r, e = step.scene.friction, step.scene.solver, error
    gamma = step.gamma(u)
    assert (P[:, 0] >= 0.0).all()
    # Complementarity with the rule: what carries does not move off, nothing moves in.
    rule = step.compliance * (P[:, 0] - step.center)
    ruled = gamma[:, 0] + rule
    assert (ruled >= -e).all()
    assert (ruled[P[:, 0] > r.r_normal * e] <= e).all()
    # Normal impulses do work on what the rule presses in with and on the residual.
    work = (P[:, 0] * (e + np.maximum(0.0, -rule - step.shift))).sum()
    for part, mu, r_k in (
        (slice(1, 3), (friction.longitudinal, friction.transversal), r.r_sliding),
        (slice(3, 5), (friction.rolling, friction.rolling), r.r_rolling),
    ):
        # Within r e of the ellipse; a half axis of 0 leaves r e.
        for k, coefficient in enumerate(mu):
            bound = coefficient * P[:, 0] * (1 + 8 * EPS) + r_k * e
            assert (np.abs(P[:, part][:, k]) <= bound).all()
        if min(mu) > 0.0:
            used = np.linalg.norm(P[:, part] / mu, axis=1)
            assert (used <= P[:, 0] * (1 + 8 * EPS) + r_k * e / min(mu)).all()
        # P' = P - r e is in the set and -(gamma - e) normal to it, 0 is in it, too: the power
        # is not positive but for what e adds.
        power = np.einsum('ak,ak->a', P[:, part], gamma[:, part])
        size = np.linalg.norm(P[:, part], axis=1)
        along = np.linalg.norm(gamma[:, part], axis=1)
        allowed = e * (size + r_k * along + r_k * e)
        assert (power <= allowed).all()
        work += allowed.sum()
    # E(u_E) = E(u_free) + P . gamma - P . G P/2: contacts take energy. What u_E is off the
    # balance of its impulses comes with its momentum.
    assert np.abs(step.velocities(P) - u.ravel()).max() <= off
    work += off * np.abs(step.M).sum() * np.abs(u).max()
    before = step.energy(step.velocities(np.zeros(P.shape)))
    assert step.energy(u) <= before + work + 100 * EPS * before

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The steps of all methods in dense NumPy: which balance and which laws a step of each has to hold.

Methods of the paper's step hold them in its middle, see `dense_step`. `bdf2` holds them at the end
that is predicted from two states, for a part of the step, as `oracle.bdf2` defines it.
"""

from dataclasses import dataclass, replace

from dense_step import dense_step, DenseStep, EPS
import numpy as np
from oracle import bdf2 as dense_bdf2, empty_history
from oracle.bdf2 import motion_of, moved
from scenes import whole_steps

from snake_sim_ros import Scene, State
from snake_sim_ros.contact.closing import closed_gap
from snake_sim_ros.contact.laws import PRESS_SPEED
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.bdf2 import formula, motion, step as bdf2
from snake_sim_ros.stepping.bdf2.motion import Motion
from snake_sim_ros.stepping.state import History


def span(scene: Scene) -> float:
    """Return the time for which the impulses of a step act that nothing disturbs [s]."""
    return whole_steps(scene.method) * scene.dt


def of_two_states(history: History) -> bool:
    """Return whether the next step of `bdf2` uses the formula of two states."""
    return bool(history.memory.phase[0] == formula.SMOOTH)


def in_motion(scene: Scene, before: Motion, state: State) -> History:
    """Return a history without contacts, of a robot that came from a motion to a state."""
    memory = motion.Bdf2Memory(
        end=motion_of(scene.robot, state),
        start=before,
        q=state.q.copy(),
        reference_rate=np.zeros((scene.robot.link_count - 1, 2)),
        dt=np.array([scene.dt]),
        span=np.array([span(scene)]),
        phase=np.array([formula.SMOOTH]),
        ticks=np.array([float(formula.TICKS)]),
        depth=np.array([dense_bdf2.depth_of(scene, state)]),
    )
    return empty_history(scene)._replace(memory=memory)


def undisturbed(scene: Scene, state: State) -> History:
    """
    Return a history without contacts, of a robot that moved with these velocities for a step.

    Without it the first step of `bdf2` has several parts, and its end shows only the last one.
    """
    if scene.method != 'bdf2':
        return empty_history(scene)
    now = motion_of(scene.robot, state)
    pose = moved(scene.robot, now.pose, -scene.dt, now.pose, now.u)
    return in_motion(scene, now._replace(pose=pose, angle=now.angle - scene.dt * now.rate), state)


def press_of(scene: Scene) -> float:
    """Return the velocity at which the method may press a contact into the floor [m/s]."""
    return bdf2.PRESS_SPEED if scene.method == 'bdf2' else PRESS_SPEED


@dataclass
class Bdf2Step(DenseStep):
    """
    A step of `bdf2` in terms of a `DenseStep`, see there, of which the reference makes the rest.

    Attributes
    ----------
    terms : Formula
    contacts : Contacts
    dynamics : Balance

    """

    terms: dense_bdf2.Formula
    contacts: dense_bdf2.Contacts
    dynamics: dense_bdf2.Balance

    def last_solved(self, torque: Array) -> 'Bdf2Step':
        """
        Return the step as it was solved last, after an event.

        It is this one, after an impact without a landing, or the impact of the contacts that are
        closed at its end, with the torques (n-1, 2) that the joints had in the step [N m].
        """
        u, P = dense_bdf2.solve_falling(self.scene, self.dynamics, self.contacts)
        if not self.shift[P[:, 0] > 0.0].any():
            return self
        gap = dense_bdf2.end_gaps(self.contacts, u, self.terms.h_q)
        closed = closed_gap(self.scene.solver.activation_tolerance, self.scene.dt)
        kept = dense_bdf2.closed_at_end(self.contacts, P[:, 0], gap, closed)
        known = self.terms.h * torque.ravel()
        impact = self.dynamics._replace(torque=known, resistance=np.zeros(known.shape))
        return replace(
            self,
            active=self.active[kept],
            W=self.W[:, kept],
            M=impact.A,
            momentum=impact.momentum,
            center=self.center[kept],
            shift=np.zeros(kept.sum()),
            dynamics=impact,
        )


def step_of(scene: Scene, state: State, history: History, angle: Array, rate: Array) -> DenseStep:
    """Return the step of the scene's method; of `bdf2` one that `of_two_states` says it is."""
    if scene.method != 'bdf2':
        return dense_step(scene, state, history, angle, rate)
    targets = dense_bdf2.references(scene, history.memory, angle, rate, scene.dt / 2)
    terms, contacts, dynamics = dense_bdf2.problem(scene, history, scene.dt, *targets)
    return Bdf2Step(
        scene=scene,
        active=contacts.active,
        W=contacts.W,
        M=dynamics.A,
        W_J=dynamics.W_J,
        momentum=dynamics.momentum,
        compliance=contacts.compliance,
        center=contacts.center,
        shift=contacts.shift,
        terms=terms,
        contacts=contacts,
        dynamics=dynamics,
    )


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

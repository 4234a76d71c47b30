# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The set-valued laws of `joint_laws` in NumPy, for the dense steps; arrays of any one shape.

A law is the graph of pairs (w, P) that controller, friction and stop admit. A trial solution is
moved to the point of the graph with the same ``w - r P``, for some r > 0, and the part of the
graph that it falls on is the linear law of the next solution. Rates are held by a softer spring
than in `joint_laws`, since dense matrices are inverted with it, and in more solutions.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from snake_sim_ros.dynamics.joint_laws import JointLaws, MEETING_RATE
from snake_sim_ros.scene.parameters import Array

HOLD = 1e5  # stiffness that holds a rate, relative to inertia and damping of an axis
SAME_RATE = 1e-11  # [rad/s]
MOST_CHANGES = 300  # solutions of a step
TOGETHER = 12  # solutions after which one axis at a time goes to another part of its law


class DenseLaws(NamedTuple):
    """The laws of the axes in a part of a step, as `joint_laws.AxisLaws`."""

    torque: Array  # c of the controller ``c - R w`` [N m s]
    damping: Array  # R [N m s^2]
    limit: Array  # [N m s]
    friction: Array  # [N m s]
    viscous: Array  # [N m s^2]
    low: Array  # [rad/s]
    high: Array  # [rad/s]
    fastest: Array  # bound of the rate at any angle [rad/s]

    def controller(self, rate: Array) -> Array:
        """Return the impulses of the controllers at given rates [N m s]."""
        return np.asarray(np.clip(self.torque - self.damping * rate, -self.limit, self.limit))

    def meets_stop(self, rate: Array) -> Array:
        """Return which axes meet a stop: they move at the rate that leads there."""
        return self.holds_stop(rate) & (np.abs(rate) > MEETING_RATE)

    def holds_stop(self, rate: Array) -> Array:
        """Return which axes have the rate of a stop of their angle."""
        low, high = self.at_bounds(rate)
        return low | high

    def at_bounds(self, rate: Array) -> tuple[Array, Array]:
        """Return which axes have the lower and which the upper rate that such a stop allows."""
        low = (self.low > -self.fastest) & (np.abs(rate - self.low) <= SAME_RATE)
        high = (self.high < self.fastest) & (np.abs(rate - self.high) <= SAME_RATE)
        return np.asarray(low), np.asarray(high)

    def in_impact(self, rate: Array, impulse: Array) -> 'DenseLaws':
        """Return the laws in an impact after a part with these rates and impulses."""
        sliding = np.where(np.abs(rate) > SAME_RATE, np.sign(rate), 0.0)
        smooth = self.controller(rate) - self.viscous * rate - sliding * self.friction
        none, infinite = np.zeros(rate.shape), np.full(rate.shape, np.inf)
        low, high = self.at_bounds(rate)
        return DenseLaws(
            torque=np.where(self.holds_stop(rate), smooth, impulse),
            damping=none,
            limit=infinite,
            friction=none,
            viscous=none,
            low=np.where(low, 0.0, -self.fastest),
            high=np.where(high, 0.0, self.fastest),
            fastest=self.fastest,
        )


def dense_laws(
    laws: JointLaws, h: float, torque: Array, damping: Array, low: Array, high: Array
) -> DenseLaws:
    """Return the laws of all axes for a time h [s], from those of the controller and the stops."""
    shape = low.shape
    numbers = h * laws.torque_limit, h * laws.friction, h * laws.viscous
    limit, friction, viscous = (each[:, : shape[1]] for each in numbers)
    fastest = laws.fastest[:, : shape[1]]
    low, high = (np.clip(bound, -fastest, fastest) for bound in (low, high))
    return DenseLaws(
        *(torque.reshape(shape), damping.reshape(shape), limit, friction, viscous),
        *(low, high, fastest),
    )


class Parts(NamedTuple):
    """The parts of the graphs that the axes are on."""

    torque: Array  # P = torque - damping w
    damping: Array
    cut: Array  # sign of the limit that acts
    slip: Array  # sign of the rate against which friction acts
    held: Array  # sign of the bound that holds the rate
    miss: Array  # how far the trial rates are from the graphs [rad/s]


def on_slope(laws: DenseLaws, slip: float, r: Array, z: Array) -> tuple[Array, Array]:
    """Return the rates with ``w - r P = z`` while axes slide one way, and the signs of limits."""
    c, R, L, V, F = laws.torque, laws.damping, laws.limit, laws.viscous, slip * laws.friction
    w = (z + r * (c - F)) / (1.0 + r * (R + V))
    cut = np.where(np.abs(c - R * w) <= L, 0.0, np.sign(c - R * w))
    bound = np.where(cut == 0.0, 0.0, L)
    return np.where(cut == 0.0, w, (z + r * (cut * bound - F)) / (1.0 + r * V)), cut


def parts_at(laws: DenseLaws, inertia: float, rate: Array, P: Array, last: Parts | None) -> Parts:
    """Return the parts for trial rates [rad/s] and impulses [N m s], see `joint_laws.axis_law`."""
    c, R, L, F, V, low, high, _ = laws
    r = 1.0 / (inertia + R)
    z = rate - r * P
    w, cut = on_slope(laws, 1.0, r, z)
    w_back, cut_back = on_slope(laws, -1.0, r, z)
    has_friction, back = F > 0.0, (F > 0.0) & ~(w > 0.0)
    slip = np.where(has_friction, np.where(back, -1.0, 1.0), 0.0)
    w, cut = np.where(back, w_back, w), np.where(back, cut_back, cut)
    holds = back & ~(w < 0.0)
    turns = slip * last.slip < 0.0 if last else np.zeros(w.shape, bool)
    w = np.clip(np.where(holds, 0.0, w), low, high)
    miss = np.abs(rate - w)
    if last:
        cut = np.where(cut * last.cut < 0.0, 0.0, cut)
    w, holds = np.where(turns, 0.0, w), holds | turns
    slip, cut = np.where(holds, 0.0, slip), np.where(holds, 0.0, cut)
    bound = np.where(cut == 0.0, 0.0, L)
    torque = np.where(cut == 0.0, c, cut * bound) - slip * F
    damping = np.where(cut == 0.0, R, 0.0) + V
    held = np.where(w == high, 1.0, np.where(w == low, -1.0, 0.0))
    if last:
        held = np.where(held * last.held < 0.0, 0.0, held)
    holds = holds | (held != 0.0)
    K = HOLD * (inertia + R + V)
    pull = (np.where(holds, w, 0.0) - z) / r + K * np.where(holds, w, 0.0)
    return Parts(np.where(holds, pull, torque), np.where(holds, K, damping), cut, slip, held, miss)


Solve = Callable[[Array, Array, int], tuple[Array, Any, int]]


def solve_laws_of_axes(
    laws: DenseLaws, inertia: float, rate: Array, solve: Solve, limit: int
) -> tuple[Any, Array, Array, int, bool]:
    """
    Solve a step with the laws of its joint axes.

    Parameters
    ----------
    laws : DenseLaws
    inertia : float
        `JointLaws.inertia` [kg m^2].
    rate : ndarray
        Rates to begin with [rad/s].
    solve : callable
        Returns the rates at the end of the step, its solution and the iterations that this took,
        for torques, dampings and the most iterations that it may take.
    limit : int
        Most iterations of all solutions together.

    Returns
    -------
    solution : object
        As `solve` returns it.
    rate, impulse : ndarray
        Rates of the axes [rad/s] and their impulses, those of friction and stops included [N m s].
    iterations : int
        Of all solutions.
    converged : bool

    """
    part = parts_at(laws, inertia, rate, laws.controller(rate), None)
    iterations = 0
    for attempt in range(MOST_CHANGES):
        rate, solution, spent = solve(part.torque, part.damping, limit - iterations)
        iterations += spent
        impulse = part.torque - part.damping * rate
        after = parts_at(laws, inertia, rate, impulse, part)
        misses = after.miss > SAME_RATE
        if iterations >= limit or not misses.any():
            break
        same = (after.cut == part.cut) & (after.slip == part.slip) & (after.held == part.held)
        moves = misses & ~same
        if attempt >= TOGETHER and moves.any():
            misses &= ~moves | (np.arange(moves.size).reshape(moves.shape) == moves.argmax())
        part = Parts(*(np.where(misses, a, b) for a, b in zip(after, part, strict=True)))
    return solution, rate, impulse, iterations, not misses.any()

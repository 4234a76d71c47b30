# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Set-valued laws on the axes of the joints: limited torque, dry friction and stops.

An axis has the impulse P that its rate w at the end of a step determines:

- The controller gives the impulse ``c - R w``, see `joint_control`, cut off at the limit L.
- Friction resists with F against the sense of w; at rest it takes any value from -F to F.
- Viscous friction resists with V w.
- A stop keeps w between two bounds: Signorini's law, as of a contact.
- A stop of the rate does so at any angle, between two bounds that are always the same.

The set of admissible pairs (w, P) is the graph of a falling function with vertical parts, a
maximal monotone relation. The law is therefore equivalent to ``w = resolvent(w - r P)`` for any
r > 0, where the resolvent gives the only w of the graph with ``w - r P`` as given. A step solves
the laws of all axes by Newton's method: where the resolvent falls on a sloped part, P is linear in
w, with the torque and the damping of this part; on a vertical part the rate is held. Then the
contacts are solved as without these laws, for the chain of links with these torques and dampings,
and the rates show what has changed.

A rate v is held by the impulse ``P + K (v - w)`` with a stiffness K far beyond that of the chain.
P is that of the solution before, so that what is left of w - v vanishes with the next solution
(augmented Lagrangian).
"""

import math
from typing import NamedTuple, Protocol

import numpy as np

from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.dynamics.spatial_vectors import Three
from snake_sim_ros.scene.parameters import Array, Robot

HOLD = 1e9  # stiffness that holds a rate, relative to inertia and damping of an axis
SAME_RATE = 1e-12  # rates that differ by less are the same [rad/s]
# An axis that is at a stop does not meet it again because moves that close gaps took it away by
# rounding.
MEETING_RATE = 1e-9  # least rate with which an axis meets a stop [rad/s]
MOST_CHANGES = 300  # solutions of a step after which it counts as unconverged
# So many times all axes go to other parts of their laws at once; then one at a time, the first one
# from another joint each time. If all began at the same joint, more steps would cycle.
TOGETHER = 12


class JointLaws(NamedTuple):
    """The numbers of the laws for a robot of n links, axes (yaw, pitch)."""

    present: bool  # whether any axis has a law besides the controller
    torque_limit: Array  # (n-1, 2) largest torque of the controller [N m]; infinite without limit
    friction: Array  # (n-1, 2) [N m]
    viscous: Array  # (n-1, 2) [N m s/rad]
    has_stops: bool  # whether there are stops of the angles
    stop: Array  # (n-1, 2, 2) least and largest angle [rad]; infinite without stops
    fastest: Array  # (n-1, 2) largest rate [rad/s]; infinite without stops of the rate
    inertia: float  # scale of 1/r: the moment of inertia across a link [kg m^2]


class AxisLaws(NamedTuple):
    """The laws of the axes (yaw, pitch) in a part of a step, in impulses."""

    torque: Array  # (n-1, 2) c, impulse of the controller without its implicit part [N m s]
    damping: Array  # (n-1, 2) R, impulse of the controller per rate [N m s^2]
    limit: Array  # (n-1, 2) L, largest impulse of the controller [N m s]
    friction: Array  # (n-1, 2) F, impulse of dry friction [N m s]
    viscous: Array  # (n-1, 2) V, impulse of viscous friction per rate [N m s^2]
    low: Array  # (n-1, 2) least rate [rad/s]
    high: Array  # (n-1, 2) largest rate [rad/s]
    rate: Array  # (n-1, 2) w, of the last solution [rad/s]
    cut: Array  # (n-1, 2) sign of the limit that the controller is at; 0: it follows
    # (n-1, 2) sign of the rate against which friction acts; 0: it does not, or it holds
    slip: Array
    held: Array  # (n-1, 2) sign of the bound that holds the rate; 0: none does
    # (n-1, 2, 2) see `joint_drift.furthest_angles` [rad]; empty without stops
    furthest: Array


def make_joint_laws(robot: Robot) -> JointLaws:
    """Return the laws of the joints of a robot."""
    limit, friction, viscous = (
        robot.per_joint(name) for name in ('torque_limit', 'friction', 'viscous_friction')
    )
    has_stops, most = robot.joint_stop, robot.limits
    stop = np.stack([most.low, most.high], axis=-1)
    if not has_stops:
        stop[..., 0], stop[..., 1] = -math.inf, math.inf
    fastest = most.rate if robot.rate_stop else np.full(most.rate.shape, math.inf)
    stopped = has_stops or robot.rate_stop
    present = np.isfinite(limit).any() or friction.any() or viscous.any() or stopped
    inertia = float(robot.per_link('inertia_transversal').mean())
    return JointLaws(bool(present), limit, friction, viscous, has_stops, stop, fastest, inertia)


def make_axis_laws(robot: Robot) -> AxisLaws:
    """Return the arrays for a robot."""
    joints = robot.link_count - 1
    axes = AxisLaws(*(np.zeros((joints, 2)) for _ in AxisLaws._fields))
    furthest = np.tile([-math.inf, math.inf], (joints if robot.joint_stop else 0, 2, 1))
    return axes._replace(furthest=furthest)


@inlined
def begin_axis(laws: JointLaws, axes: AxisLaws, h: float, j: int, k: int, known: Three) -> None:
    """
    Fill the law of axis k of joint j for a time h [s], without stops.

    `known` are torque [N m s] and damping [N m s^2] of the controller, and the rate that is
    expected [rad/s].
    """
    axes.torque[j, k], axes.damping[j, k], axes.rate[j, k] = known
    axes.limit[j, k] = h * laws.torque_limit[j, k]
    axes.friction[j, k] = h * laws.friction[j, k]
    axes.viscous[j, k] = h * laws.viscous[j, k]
    axes.low[j, k], axes.high[j, k] = -laws.fastest[j, k], laws.fastest[j, k]


@inlined
def stop_at_end(
    laws: JointLaws, axes: AxisLaws, j: int, k: int, way: tuple[float, float], h_q: float
) -> None:
    """
    Bound the rate of axis k of joint j by its stops at the end, within what the rate may be.

    `way` are its angles at the start, and at the end without the rate, which acts on it for a time
    h_q [s]. A joint that is beyond its stop at the start goes no further.
    """
    (angle, hat), fastest = way, laws.fastest[j, k]
    low, high = min(laws.stop[j, k, 0], angle), max(laws.stop[j, k, 1], angle)
    axes.low[j, k] = min(max((low - hat) / h_q, -fastest), fastest)
    axes.high[j, k] = min(max((high - hat) / h_q, -fastest), fastest)


@inlined
def stop_at_middle(laws: JointLaws, axes: AxisLaws, j: int, k: int, angle: float) -> None:
    """Bound the rate of an axis that is at a stop with its angle at the middle of a step [rad]."""
    if angle >= laws.stop[j, k, 1]:
        axes.high[j, k] = 0.0
    elif angle <= laws.stop[j, k, 0]:
        axes.low[j, k] = 0.0


@inlined
def controller_impulse(axes: AxisLaws, j: int, k: int) -> float:
    """Return the impulse of the controller on axis k of joint j [N m s]."""
    P, L = axes.torque[j, k] - axes.damping[j, k] * axes.rate[j, k], axes.limit[j, k]
    return min(max(P, -L), L)


@inlined
def controller_impulses(
    laws: JointLaws, axes: AxisLaws, loads: tuple[Array, Array], rate: Array, applied: Array
) -> bool:
    """
    Fill the impulses of the controllers, (n-1, 2) [N m s]; return whether a joint meets a stop.

    `loads` are torques and dampings, as of `joint_laws_change`, and `rate` rates of a solution.
    """
    (torque, damping), meets = loads, False
    for j in range(len(rate)):
        for k in range(2):
            applied[j, k] = torque[j, k] - damping[j, k] * rate[j, k]
            if laws.present:
                applied[j, k] = controller_impulse(axes, j, k)
                meets = meets or is_at_stop(laws, axes, j, k)
    return meets


@inlined
def first_law(inertia: float, axes: AxisLaws, j: int, k: int) -> tuple[float, float]:
    """Return the first torque and damping, from the rate in axes.rate; see `axis_law`."""
    axes.cut[j, k] = axes.slip[j, k] = axes.held[j, k] = 0.0
    torque, damping, _ = axis_law(inertia, axes, j, k, controller_impulse(axes, j, k))
    return torque, damping


@compiled
def axis_law(inertia: float, axes: AxisLaws, j: int, k: int, impulse: float) -> Three:
    """
    Return the part of the law of axis k of joint j that a trial solution falls on.

    From one limit to the other, from sliding one way to the other, and from one bound of the rate
    to the other, it passes the part between them. Otherwise Newton's method oscillates.

    Parameters
    ----------
    inertia : float
        `JointLaws.inertia`.
    axes : AxisLaws
        Its rate is that of the trial solution; cut, slip and held are replaced by those of the
        part.
    j, k : int
    impulse : float
        P of the trial solution [N m s].

    Returns
    -------
    torque, damping : float
        The part as ``P = torque - damping w`` [N m s], [N m s^2].
    miss : float
        Difference of the trial rate and the resolvent, 0 in a solution [rad/s].

    """
    F, low, high = axes.friction[j, k], axes.low[j, k], axes.high[j, k]
    c, R, L, V = axes.torque[j, k], axes.damping[j, k], axes.limit[j, k], axes.viscous[j, k]
    r = 1.0 / (inertia + R)
    z = axes.rate[j, k] - r * impulse
    slip = 1.0 if F > 0.0 else 0.0
    w, cut = rate_on_slope(c - F, R, F, (L, V), (r, z))
    if F > 0.0 and not w > 0.0:
        slip = -1.0
        w, cut = rate_on_slope(c + F, R, -F, (L, V), (r, z))
        if not w < 0.0:
            w = slip = cut = 0.0
    w = min(max(w, low), high)
    miss = abs(axes.rate[j, k] - w)
    if slip * axes.slip[j, k] < 0.0:
        w = slip = cut = 0.0
    elif cut * axes.cut[j, k] < 0.0:
        cut = 0.0
    held = 1.0 if w == high else (-1.0 if w == low else 0.0)
    if held * axes.held[j, k] < 0.0:
        held = 0.0
    axes.slip[j, k], axes.cut[j, k], axes.held[j, k] = slip, cut, held
    if (F > 0.0 and slip == 0.0) or held != 0.0:
        K = HOLD * (inertia + R + V)
        return (w - z) / r + K * w, K, miss
    if cut == 0.0:
        return c - slip * F, R + V, miss
    return cut * L - slip * F, V, miss


@inlined
def rate_on_slope(
    torque: float, R: float, F: float, bounds: tuple[float, float], line: tuple[float, float]
) -> tuple[float, float]:
    """
    Return the rate w with ``w - r P = z`` while friction F acts, and the sign of the limit there.

    `torque` is that of controller and friction, `bounds` are limit L and viscous friction V, and
    `line` are r and z; the sign is 0 where the limit is not reached.
    """
    (L, V), (r, z) = bounds, line
    w = (z + r * torque) / (1.0 + r * (R + V))
    P = torque + F - R * w
    if abs(P) <= L:
        return w, 0.0
    cut = 1.0 if P > 0.0 else -1.0
    return (z + r * (cut * L - F)) / (1.0 + r * V), cut


@inlined
def is_at_stop(laws: JointLaws, axes: AxisLaws, j: int, k: int) -> bool:
    """Return whether axis k of joint j meets a stop: it moves at the rate that leads there."""
    w = axes.rate[j, k]
    return (is_low(laws, axes, j, k) or is_high(laws, axes, j, k)) and abs(w) > MEETING_RATE


@inlined
def is_low(laws: JointLaws, axes: AxisLaws, j: int, k: int) -> bool:
    """Return whether axis k of joint j has the lower rate that a stop of its angle allows."""
    return axes.low[j, k] > -laws.fastest[j, k] and is_at(axes.rate[j, k], axes.low[j, k])


@inlined
def is_high(laws: JointLaws, axes: AxisLaws, j: int, k: int) -> bool:
    """Return whether axis k of joint j has the upper rate that a stop of its angle allows."""
    return axes.high[j, k] < laws.fastest[j, k] and is_at(axes.rate[j, k], axes.high[j, k])


@inlined
def is_at(rate: float, bound: float) -> bool:
    """Return whether a rate is that of a bound [rad/s]."""
    return abs(rate - bound) <= SAME_RATE


@inlined
def begin_axis_impact(
    laws: JointLaws, axes: AxisLaws, j: int, k: int, torque: float, damping: float
) -> tuple[float, float]:
    """
    Return torque and damping of axis k of joint j in an impact after a part of a step.

    The impulses of controller and friction stay what they are; a stop that was reached holds.
    `torque` and `damping` are those of the solution of the part [N m s], [N m s^2], and so is the
    rate in `axes`, of which the rest is replaced.
    """
    w = axes.rate[j, k]
    low, high = is_low(laws, axes, j, k), is_high(laws, axes, j, k)
    known = torque - damping * w
    if low or high:  # without the reaction of the stop
        known = controller_impulse(axes, j, k) - axes.viscous[j, k] * w
        if abs(w) > SAME_RATE:
            known -= math.copysign(axes.friction[j, k], w)
    axes.torque[j, k], axes.damping[j, k], axes.limit[j, k] = known, 0.0, math.inf
    axes.friction[j, k] = axes.viscous[j, k] = 0.0
    axes.low[j, k] = 0.0 if low else -laws.fastest[j, k]
    axes.high[j, k] = 0.0 if high else laws.fastest[j, k]
    return first_law(laws.inertia, axes, j, k)


@inlined
def begin_joint_laws(
    laws: JointLaws, axes: AxisLaws, dt: float, mid: Array, loads: tuple[Array, Array]
) -> None:
    """
    Begin a step of the paper of dt [s] with the laws of m axes a joint: both, or yaw.

    `mid`, shape (n-1, m, 2 or more), are angles [rad] and rates [rad/s] at the middle. `loads`,
    shape (n-1, m), are torques and dampings of the controllers [N m s], [N m s^2]; replaced.
    """
    torque, damping = loads
    for j in range(len(mid)):
        for k in range(mid.shape[1]):
            begin_axis(laws, axes, dt, j, k, (torque[j, k], damping[j, k], mid[j, k, 1]))
            stop_at_middle(laws, axes, j, k, mid[j, k, 0])
            torque[j, k], damping[j, k] = first_law(laws.inertia, axes, j, k)


@inlined
def begin_predicted_laws(
    laws: JointLaws,
    axes: AxisLaws,
    times: tuple[float, float],
    way: tuple[Array, Array],
    rate: Array,
    loads: tuple[Array, Array],
) -> None:
    """
    Begin a part of a step of `bdf2` with the laws of m axes a joint: both, or yaw.

    `times` are h and h_q, for which forces act on rates, and rates on angles [s]. `way`, shape
    (n-1, m) each, are angles at the start, and at the end without the rates of the end [rad], and
    `rate`, shape (n-1, m), predicted rates [rad/s]. `loads` are as of `begin_joint_laws`.
    """
    (h, h_q), (start, hat), (torque, damping) = times, way, loads
    for j in range(len(rate)):
        for k in range(rate.shape[1]):
            begin_axis(laws, axes, h, j, k, (torque[j, k], damping[j, k], rate[j, k]))
            if laws.has_stops:
                stop_at_end(laws, axes, j, k, (start[j, k], hat[j, k]), h_q)
            torque[j, k], damping[j, k] = first_law(laws.inertia, axes, j, k)


class Trial(NamedTuple):
    """A solution of the contacts with parts of the laws of the joints that may not hold."""

    iterations: int  # of the contact solver
    converged: bool  # whether its residual is within the tolerance
    attempt: int  # number of the solution in its step, from 0
    left: int  # iterations that it was allowed to take


class Counts(Protocol):
    """What the laws count in the report of the steps."""

    iterations: int  # of the contact solver
    unconverged: int  # steps without an end


@inlined
def joint_laws_change(
    laws: JointLaws, axes: AxisLaws, loads: tuple[Array, Array], trial: Trial, report: Counts
) -> bool:
    """
    Fill torques and dampings of the next solution; return whether there is one.

    The rates in `axes` are those of the last solution, `trial`. If it took all iterations that
    were left, there is no other one. `loads`, shape (n-1, m), are its torques and dampings
    [N m s], [N m s^2], of both axes or of yaw. The report counts the iterations of all solutions
    but the last one, and a step without an end.
    """
    misses = moves = False
    (torque, damping), (iterations, converged, attempt, left) = loads, trial
    is_last = attempt + 1 == MOST_CHANGES or iterations >= left
    for i in range(len(torque)):
        j = (i + max(0, attempt - TOGETHER)) % len(torque)
        for k in range(torque.shape[1]):
            impulse = torque[j, k] - damping[j, k] * axes.rate[j, k]
            cut, slip, held = axes.cut[j, k], axes.slip[j, k], axes.held[j, k]
            new_torque, new_damping, miss = axis_law(laws.inertia, axes, j, k, impulse)
            if miss > SAME_RATE:
                misses = True
                is_same = cut == axes.cut[j, k] and slip == axes.slip[j, k]
                is_same = is_same and held == axes.held[j, k]
                if not is_last and (is_same or attempt < TOGETHER or not moves):
                    torque[j, k], damping[j, k] = new_torque, new_damping
                    moves = moves or not is_same
                else:
                    axes.cut[j, k], axes.slip[j, k], axes.held[j, k] = cut, slip, held
    if misses and is_last:
        report.unconverged += converged
        return False
    if misses:
        report.iterations += iterations
    return misses

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
r > 0, where the resolvent gives the only w of the graph with ``w - r P`` as given.

They are solved as those of friction, see `contact.linear_problem`: a proximal point method makes
P a function of w alone, ``P(w) = P_a + K (resolvent(w - P_a/K) - w)``, with an impulse P_a that
follows the iterates and a stiffness K far beyond that of the chain. Newton's method makes it
linear about a trial rate, as ``P = torque - damping w``, which the chain of links takes as it
takes a controller. `contact.newton` does so in each of its iterations, with the contacts. For
other methods the contacts are solved with linear laws of the joints, again and again; see
`contact.prox_iteration.joint_laws_change`.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.kinematics import copy_rows
from snake_sim_ros.dynamics.spatial_vectors import Three
from snake_sim_ros.scene.parameters import Array, Robot

# Stiffness K of the proximal point method, relative to inertia and damping of an axis.
HOLD = 1e7
# An axis that is at a stop does not meet it again because moves that close gaps took it away by
# rounding. At a stop, friction acts against rates that are larger.
MEETING_RATE = 1e-9  # least rate with which an axis meets a stop [rad/s]


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


class AxisPath(NamedTuple):
    """A point of the path of `contact.central_path` and steps from it; see `joint_path`."""

    point: Array  # (n-1, 2, 2) rate w [rad/s] and impulse P [N m s]
    kept: Array  # (n-1, 2, 2) the last point
    step: Array  # (n-1, 2, 4, 2) changes of w and P by the kinds of steps
    slope: Array  # (n-1, 2) of the resolvent where steps begin [1]
    reach: Array  # (n-1, 2) change of w - r P at which this slope changes [rad/s]


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
    held: Array  # (n-1, 2) sign of the bound that holds the rate in it; 0: none does
    trial: Array  # (n-1, 2) rate about which the law is linear [rad/s]
    anchor: Array  # (n-1, 2) P_a, prox center of the proximal point method [N m s]
    iterate: Array  # (n-1, 2) impulse of the last iterate [N m s]
    saved_trial: Array  # (n-1, 2) at the end of the last round with held radii [rad/s]
    saved_iterate: Array  # (n-1, 2) [N m s]
    # (n-1, 2, 2) see `joint_drift.furthest_angles` [rad]; empty without stops
    furthest: Array
    path: AxisPath


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
    path = AxisPath(*(np.zeros((joints, 2, *shape)) for shape in ((2,), (2,), (4, 2), (), ())))
    furthest = np.tile([-math.inf, math.inf], (joints if robot.joint_stop else 0, 2, 1))
    arrays: list[Any] = [np.zeros((joints, 2)) for _ in AxisLaws._fields]
    arrays[-2:] = furthest, path
    return AxisLaws(*arrays)


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
def start_axis(inertia: float, axes: AxisLaws, j: int, k: int) -> None:
    """Begin with the impulse of the law of axis k of joint j that is next to the expected rate."""
    P, w = controller_impulse(axes, j, k), axes.rate[j, k]
    torque, damping = linear_law(axes, j, k, w, P, inertia + axes.damping[j, k])
    P = torque - damping * w
    axes.trial[j, k], axes.anchor[j, k], axes.iterate[j, k] = w, P, P


@inlined
def resolvent(axes: AxisLaws, j: int, k: int, r: float, z: float) -> tuple[float, float, float]:
    """
    Return the rate w of the law of axis k of joint j with ``w - r P = z``, and its part.

    Returns
    -------
    w : float
        [rad/s]
    torque, damping : float
        The part as ``P = torque - damping w`` [N m s], [N m s^2]; the damping is infinite where
        friction or a bound holds the rate.

    """
    F, low, high = axes.friction[j, k], axes.low[j, k], axes.high[j, k]
    c, R, L, V = axes.torque[j, k], axes.damping[j, k], axes.limit[j, k], axes.viscous[j, k]
    slip = 1.0 if F > 0.0 else 0.0
    w, cut = rate_on_slope(c - F, R, F, (L, V), (r, z))
    holds = False
    if F > 0.0 and not w > 0.0:
        slip = -1.0
        w, cut = rate_on_slope(c + F, R, -F, (L, V), (r, z))
        if not w < 0.0:
            w, holds = 0.0, True
    if holds or w <= low or w >= high:
        return min(max(w, low), high), 0.0, math.inf
    if cut == 0.0:
        return w, c - slip * F, R + V
    return w, cut * L - slip * F, V


@inlined
def linear_law(
    axes: AxisLaws, j: int, k: int, w: float, anchor: float, K: float
) -> tuple[float, float]:
    """
    Return the impulse of axis k of joint j as ``P = torque - damping w``, linear about a rate.

    It is ``P(w)`` of the proximal point method where the resolvent falls on a vertical part of the
    law. On a slope it is that of the law, to the bit: there nothing depends on the anchor.

    Parameters
    ----------
    axes : AxisLaws
    j, k : int
    w : float
        The rate [rad/s].
    anchor : float
        P_a [N m s].
    K : float
        Stiffness of the proximal point method [N m s^2].

    Returns
    -------
    torque, damping : float
        [N m s], [N m s^2]

    """
    v, torque, damping = resolvent(axes, j, k, 1.0 / K, w - anchor / K)
    if damping == math.inf:
        return anchor + K * v, K
    return torque, damping


@inlined
def linearize_axes(laws: JointLaws, axes: AxisLaws, loads: tuple[Array, Array]) -> None:
    """
    Fill torques and dampings of the laws, linear about the trial rates, for m axes a joint.

    `loads`, shape (n-1, m), are those of both axes or of yaw [N m s], [N m s^2].
    """
    torque, damping = loads
    for j in range(len(torque)):
        for k in range(torque.shape[1]):
            K, w = HOLD * (laws.inertia + axes.damping[j, k]), axes.trial[j, k]
            law = linear_law(axes, j, k, w, axes.anchor[j, k], K)
            torque[j, k], damping[j, k] = law


@inlined
def axes_error(
    laws: JointLaws, axes: AxisLaws, loads: tuple[Array, Array], fraction: float
) -> tuple[float, float]:
    """
    Compare impulses and laws at a fraction of the way from trial and iterate to the solution.

    The rates in `axes` are those of the solution with `loads`, as of `linearize_axes`.

    Returns
    -------
    slope : float
        ``sum (P - P(w)) . (w - trial)``, as of `contact.newton.law_error`.
    residual : float
        Largest ``|P - P(w)|`` over inertia and damping of the axis [rad/s].

    """
    slope, worst, (torque, damping) = 0.0, 0.0, loads
    for j in range(len(torque)):
        for k in range(torque.shape[1]):
            scale, w, P = laws.inertia + axes.damping[j, k], axes.rate[j, k], axes.iterate[j, k]
            step, end = w - axes.trial[j, k], torque[j, k] - damping[j, k] * w
            at = axes.trial[j, k] + fraction * step
            c, D = linear_law(axes, j, k, at, axes.anchor[j, k], HOLD * scale)
            d = P + fraction * (end - P) - (c - D * at)
            slope += d * step
            worst = max(worst, abs(d) / scale)
    return slope, worst


@inlined
def axes_residual(laws: JointLaws, axes: AxisLaws, loads: tuple[Array, Array]) -> float:
    """
    Return how far the solution is from the laws, ``max |w - resolvent(w - r P)|`` [rad/s].

    The rates in `axes` are those of the solution with `loads`; `held` is filled. The scale of r is
    that of inertia and damping of an axis.
    """
    worst, (torque, damping) = 0.0, loads
    for j in range(len(torque)):
        for k in range(torque.shape[1]):
            r, w = 1.0 / (laws.inertia + axes.damping[j, k]), axes.rate[j, k]
            z = w - r * (torque[j, k] - damping[j, k] * w)
            v, _, _ = resolvent(axes, j, k, r, z)
            worst = max(worst, abs(w - v))
            held = v == axes.high[j, k], v == axes.low[j, k]
            axes.held[j, k] = 1.0 if held[0] else (-1.0 if held[1] else 0.0)
    return worst


@inlined
def move_axes(axes: AxisLaws, loads: tuple[Array, Array], fraction: float) -> None:
    """Move trial and iterate a fraction of the way to the solution, as of `axes_error`."""
    torque, damping = loads
    for j in range(len(torque)):
        for k in range(torque.shape[1]):
            w, P = axes.rate[j, k], axes.iterate[j, k]
            end = torque[j, k] - damping[j, k] * w
            axes.trial[j, k] += fraction * (w - axes.trial[j, k])
            axes.iterate[j, k] = P + fraction * (end - P)


@inlined
def anchor_axes(axes: AxisLaws) -> None:
    """Fill the anchors with the iterates."""
    copy_rows(axes.iterate, axes.anchor, 2)


@inlined
def save_axes(axes: AxisLaws) -> None:
    """Keep trial and iterate."""
    copy_rows(axes.trial, axes.saved_trial, 2)
    copy_rows(axes.iterate, axes.saved_iterate, 2)


@inlined
def return_axes(axes: AxisLaws) -> None:
    """Return to the trial and iterate that were kept."""
    copy_rows(axes.saved_trial, axes.trial, 2)
    copy_rows(axes.saved_iterate, axes.iterate, 2)


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
    is_held = is_low(laws, axes, j, k) or is_high(laws, axes, j, k)
    return is_held and abs(axes.rate[j, k]) > MEETING_RATE


@inlined
def is_low(laws: JointLaws, axes: AxisLaws, j: int, k: int) -> bool:
    """Return whether axis k of joint j has the lower rate that a stop of its angle allows."""
    return axes.held[j, k] < 0.0 and axes.low[j, k] > -laws.fastest[j, k]


@inlined
def is_high(laws: JointLaws, axes: AxisLaws, j: int, k: int) -> bool:
    """Return whether axis k of joint j has the upper rate that a stop of its angle allows."""
    return axes.held[j, k] > 0.0 and axes.high[j, k] < laws.fastest[j, k]


@inlined
def begin_axis_impact(
    laws: JointLaws, axes: AxisLaws, j: int, k: int, torque: float, damping: float
) -> None:
    """
    Begin the law of axis k of joint j in an impact after a part of a step.

    The impulses of controller and friction stay what they are; a stop that was reached holds.
    `torque` and `damping` are those of the solution of the part [N m s], [N m s^2], and so are
    rate and `held` in `axes`, of which the rest is replaced.
    """
    w = axes.rate[j, k]
    low, high = is_low(laws, axes, j, k), is_high(laws, axes, j, k)
    known = torque - damping * w
    if low or high:  # without the reaction of the stop
        known = controller_impulse(axes, j, k) - axes.viscous[j, k] * w
        if abs(w) > MEETING_RATE:
            known -= math.copysign(axes.friction[j, k], w)
    axes.torque[j, k], axes.damping[j, k], axes.limit[j, k] = known, 0.0, math.inf
    axes.friction[j, k] = axes.viscous[j, k] = 0.0
    axes.low[j, k] = 0.0 if low else -laws.fastest[j, k]
    axes.high[j, k] = 0.0 if high else laws.fastest[j, k]
    start_axis(laws.inertia, axes, j, k)


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
            start_axis(laws.inertia, axes, j, k)
    linearize_axes(laws, axes, loads)


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
            start_axis(laws.inertia, axes, j, k)
    linearize_axes(laws, axes, loads)

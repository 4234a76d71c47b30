# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The laws of the joints on the path of `contact.central_path`.

The resolvent of an axis, w = J(w - r P) as of `joint_laws.resolvent`, is made of clamps: friction
takes what is within r F, the torque limit bounds what the controller does, and stops bound the
rate. On the path clamps are round over a rate s, which vanishes at its end, so that w and P of
every axis are the only ones with ``w = J_s(w - r P)``. A step changes them by ``dP = T - D dw``,
which the chain of links takes as it takes a controller.
"""

import math
from typing import NamedTuple

from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.joint_laws import AxisLaws, JointLaws
from snake_sim_ros.dynamics.kinematics import copy_rows
from snake_sim_ros.scene.parameters import Array

FLAT = 1e-6  # least slope of a resolvent with which a step is linear
RATE, IMPULSE = range(2)


class Rounded(NamedTuple):
    """A value of a function of x that is round over s."""

    value: float
    slope: float  # derivative with respect to x
    change: float  # derivative with respect to s
    reach: float  # change of x at which the slope changes


@inlined
def round_part(x: float, s: float) -> Rounded:
    """Return ``max(0, x)``, round over s > 0."""
    if x == -math.inf:
        return Rounded(0.0, 0.0, 0.0, math.inf)
    root = math.sqrt(x * x + s * s)
    value = 0.5 * (root + x) if x > 0.0 else 0.5 * s * s / (root - x)
    return Rounded(value, value / root, 0.5 * s / root, root)


@inlined
def round_clamp(x: float, low: float, high: float, s: float) -> Rounded:
    """Return x, at least `low` and at most `high`, round over s > 0."""
    below, above = round_part(low - x, s), round_part(x - high, s)
    return Rounded(
        x + below.value - above.value,
        1.0 - below.slope - above.slope,
        below.change - above.change,
        min(below.reach, above.reach),
    )


@inlined
def round_resolvent(
    axes: AxisLaws, j: int, k: int, line: tuple[float, float], s: float
) -> Rounded:
    """Return the rate w of axis k of joint j with ``w - r P = z``; `line` are r and z."""
    (r, z), F, L, V = line, axes.friction[j, k], axes.limit[j, k], axes.viscous[j, k]
    c, R = axes.torque[j, k], axes.damping[j, k]
    at_rest = r * min(max(c, -L), L)
    x, slope, change, reach = z + at_rest, 1.0, 0.0, math.inf
    if F > 0.0:
        held = round_clamp(x, -r * F, r * F, s)
        x -= held.value
        slope, change, reach = 1.0 - held.slope, -held.change, held.reach
    free, driven = 1.0 / (1.0 + r * V), 1.0 / (1.0 + r * (R + V))
    if R == 0.0 or L == math.inf:
        w, slope, change = driven * x, driven * slope, driven * change
    else:
        x -= at_rest
        first, last = (c - L) / (R * free) - r * L, (c + L) / (R * free) + r * L
        part = round_clamp(x, first, last, s)
        w = driven * (part.value + r * c) + free * (x - part.value)
        gain = free + (driven - free) * part.slope
        slope, change = gain * slope, gain * change + (driven - free) * part.change
        reach = min(reach, part.reach)
    end = round_clamp(w, axes.low[j, k], axes.high[j, k], s)
    change = end.slope * change + end.change
    return Rounded(end.value, end.slope * slope, change, min(reach, end.reach))


@inlined
def begin_axes(axes: AxisLaws, loads: tuple[Array, Array]) -> None:
    """Begin the path with the rates in `axes` and the impulses that `loads` give for them."""
    torque, damping = loads
    for j in range(len(torque)):
        for k in range(2):
            w = axes.rate[j, k]
            axes.path.point[j, k, RATE] = w
            axes.path.point[j, k, IMPULSE] = torque[j, k] - damping[j, k] * w


@inlined
def resolvent_at(laws: JointLaws, axes: AxisLaws, j: int, k: int, s: float) -> Rounded:
    """Return the resolvent of axis k of joint j at the point of the path."""
    r, point = 1.0 / (laws.inertia + axes.damping[j, k]), axes.path.point
    return round_resolvent(axes, j, k, (r, point[j, k, RATE] - r * point[j, k, IMPULSE]), s)


@inlined
def linearize_on_path(laws: JointLaws, axes: AxisLaws, damping: Array, s: float) -> None:
    """Fill the dampings D of steps from the point of the path [N m s^2]."""
    for j in range(len(damping)):
        for k in range(2):
            found = resolvent_at(laws, axes, j, k, s)
            slope = max(FLAT, found.slope)
            axes.path.slope[j, k], axes.path.reach[j, k] = slope, found.reach
            damping[j, k] = (1.0 - slope) / slope * (laws.inertia + axes.damping[j, k])


@inlined
def load_step(laws: JointLaws, axes: AxisLaws, torque: Array, s: float, along: bool) -> None:
    """Fill the torques T [N m s] of a step back to the path, or along it with s by itself."""
    for j in range(len(torque)):
        for k in range(2):
            found = resolvent_at(laws, axes, j, k, s)
            left = s * found.change if along else found.value - axes.path.point[j, k, RATE]
            scale = laws.inertia + axes.damping[j, k]
            torque[j, k] = left * scale / axes.path.slope[j, k]


@inlined
def take_axes(axes: AxisLaws, loads: tuple[Array, Array], kind: int) -> None:
    """Fill a step with the changes of the rates in `axes`, and of the impulses by `loads`."""
    torque, damping = loads
    for j in range(len(torque)):
        for k in range(2):
            dw = axes.rate[j, k]
            axes.path.step[j, k, kind, RATE] = dw
            axes.path.step[j, k, kind, IMPULSE] = torque[j, k] - damping[j, k] * dw


@inlined
def relative_step(laws: JointLaws, axes: AxisLaws, j: int, k: int, kind: int) -> float:
    """Return a step of axis k of joint j, relative to where the slope of its resolvent changes."""
    r, path = 1.0 / (laws.inertia + axes.damping[j, k]), axes.path
    dz = path.step[j, k, kind, RATE] - r * path.step[j, k, kind, IMPULSE]
    return dz / path.reach[j, k]


@inlined
def axes_product(laws: JointLaws, axes: AxisLaws, one: int, other: int) -> float:
    """Return the inner product of two steps of all axes; see `relative_step`."""
    total = 0.0
    for j in range(len(axes.path.step)):
        for k in range(2):
            step = relative_step(laws, axes, j, k, one)
            total += step * relative_step(laws, axes, j, k, other)
    return total


@inlined
def axes_way(laws: JointLaws, axes: AxisLaws, kind: int) -> float:
    """Return the largest step of an axis; see `relative_step`."""
    largest = 0.0
    for j in range(len(axes.path.step)):
        for k in range(2):
            largest = max(largest, abs(relative_step(laws, axes, j, k, kind)))
    return largest


@inlined
def add_steps_of_axes(axes: AxisLaws, kind: int, one: int, share: float, other: int) -> None:
    """Let a step be the sum of one and a share of another."""
    step = axes.path.step
    for j in range(len(step)):
        for k in range(2):
            for i in range(2):
                step[j, k, kind, i] = step[j, k, one, i] + share * step[j, k, other, i]


@inlined
def move_axes_on(axes: AxisLaws, share: float, kind: int) -> None:
    """Move the point by a share of a step."""
    path = axes.path
    for j in range(len(path.point)):
        for k in range(2):
            for i in range(2):
                path.point[j, k, i] += share * path.step[j, k, kind, i]


@inlined
def copy_point(point: Array, to: Array) -> None:
    """Copy a point (n-1, 2, 2)."""
    for j in range(len(point)):
        copy_rows(point[j], to[j], 2)


@inlined
def end_axes(axes: AxisLaws, loads: tuple[Array, Array]) -> None:
    """Fill rates, trial, iterate and anchors, and the loads, with those of the point."""
    torque, damping = loads
    for j in range(len(torque)):
        for k in range(2):
            w, P = axes.path.point[j, k, RATE], axes.path.point[j, k, IMPULSE]
            axes.rate[j, k] = axes.trial[j, k] = w
            axes.iterate[j, k] = axes.anchor[j, k] = torque[j, k] = P
            damping[j, k] = 0.0

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Sets of admissible contact impulses and the projections on them, section V of the paper.

A set-valued law is an inclusion in the normal cone of a convex set C, ``-gamma in N_C(P)``. It is
equivalent to ``P = prox_C(P - r gamma)`` for any r > 0. The sets are cones in the normal impulse,
so one law covers contact forces and impacts. All functions are compiled; they take and return
numbers in one unit, N s for impulses.
"""

import math

from snake_sim_ros.dynamics.compilation import compiled


@compiled
def prox_half_line(x):
    """Return the nearest number that is not negative: Signorini's law, eqs. (52)-(54)."""
    return max(0.0, x)


@compiled
def prox_disc(x, y, radius):
    """Return the nearest point of a disc about 0: isotropic sliding and rolling friction."""
    length = math.sqrt(x * x + y * y)
    if length <= radius:
        return x, y
    return x * radius / length, y * radius / length


@compiled
def prox_ellipse(x, y, a, b):
    """
    Return the nearest point of the ellipse with half axes a, b: orthotropic Coulomb friction.

    The point is ``(x a^2/(t + a^2), y b^2/(t + b^2))``, where t > 0 puts it on the boundary.
    Newton's method solves ``1/s(t) = 1`` from the left, where s^2 is the left side of the equation
    of the ellipse. It converges monotonically because 1/s is increasing and concave, so that it
    needs no safeguard.
    """
    if a <= 0.0 or b <= 0.0:
        return min(max(x, -a), a) if a > 0.0 else 0.0, min(max(y, -b), b) if b > 0.0 else 0.0
    if a == b:
        return prox_disc(x, y, a)
    if x * x * b * b + y * y * a * a <= a * a * b * b:
        return x, y
    scale = 1.0 / max(a, b)
    a, b = scale * a, scale * b
    aa, bb = a * a, b * b
    ux, uy = a * abs(scale * x), b * abs(scale * y)
    t = max(ux - aa, uy - bb, 0.0)
    step = math.inf
    while step > 1e-8 * (t + min(aa, bb)):  # the square of a smaller one is below rounding
        over_a, over_b = 1.0 / (t + aa), 1.0 / (t + bb)
        p, q = (ux * over_a) ** 2, (uy * over_b) ** 2
        square = p + q
        step = square * (math.sqrt(square) - 1.0) / (p * over_a + q * over_b)
        t += step
    return x * aa / (t + aa), y * bb / (t + bb)


@compiled
def prox_half_ellipses(x, y, forward, backward, b):
    """
    Return the nearest point of two half ellipses: Coulomb friction that differs along a line.

    The half axis along x is `forward` where x is negative, against sliding forward, and `backward`
    where x is positive; both halves have the half axis b along y. The set is convex. The nearest
    point lies on the side of x, and is that of the whole ellipse of this side, which is symmetric.
    """
    return prox_ellipse(x, y, backward if x > 0.0 else forward, b)

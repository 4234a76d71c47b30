# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A chain of links with one hinge a joint, linear in the number of links: `stepping.planar` has two.

This is the algorithm of `articulated_body` with three numbers a twist instead of six, and with
symmetric inertias. In the plane a twist is (angular velocity, velocity of the body point at O) and
a wrench (moment about O, impulse). Out of the plane they are (angular velocities about x and y,
vertical velocity) and (moments, vertical impulse). The sweeps are the same for both. Units are
rad/s, m/s, N m s and N s.

The root is the middle link, so that the sweeps over the two arms are independent.
"""

from typing import NamedTuple

from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.dynamics.spatial_vectors import Three
from snake_sim_ros.scene.parameters import Array


class HingeChain(NamedTuple):
    """
    A chain as the sweeps take and fill it; s is the axis of a joint, A the inertia beyond.

    Twists, wrenches and inertias are about O, in the units of `articulated_body.Chain`.
    """

    axis: Array  # (n-1, 3) twist s of the outer link against its parent
    damping: Array  # (n-1,) impulse per rate that resists a joint [N m s^2]
    inertia: Array  # (n, 6) entries 11, 12, 13, 22, 23, 33; of the root its factors
    left: Array  # (n-1, 3) A s/D with D = s . A s + damping [1], [1/m]
    compliance: Array  # (n-1,) 1/D [1/(kg m^2)]
    load: Array  # (n-1,) loads of the joints [N m s]
    wrench: Array  # (n, 3) load of every link: momentum plus impulse wrench
    rate: Array  # (n-1,) rates of the joints [rad/s]
    twist: Array  # (n, 3) twists of the links: the solution


@compiled
def factor_hinges(chain: HingeChain) -> None:
    """
    Turn link inertias into articulated ones, and that of the root into its factors L D L^T.

    Parameters
    ----------
    chain : HingeChain
        Its axis, damping and inertia are read; inertia, left and compliance are filled.

    """
    inertia = chain.inertia
    n = len(inertia)
    root = n // 2
    for k in range(root):
        fold_hinge(chain, k, inertia[k], inertia[k + 1])
        i = n - 1 - k
        if i > root:
            fold_hinge(chain, i - 1, inertia[i], inertia[i - 1])
    A = inertia[root]
    over = 1.0 / A[5]  # starts at the last entry: a chain along x needs this pivot
    a, b = A[2] * over, A[4] * over
    d01, d11 = A[1] - a * A[4], 1.0 / (A[3] - b * A[4])
    c = d01 * d11
    A[0] = 1.0 / (A[0] - a * A[2] - c * d01)
    A[1], A[2], A[3], A[4], A[5] = c, a, d11, b, over


@inlined
def fold_hinge(chain: HingeChain, j: int, A: Array, parent: Array) -> None:
    """Add to the inertia of the parent what it feels through joint j of the inertia A beyond."""
    axis, left = chain.axis, chain.left
    s0, s1, s2 = axis[j, 0], axis[j, 1], axis[j, 2]
    g0 = A[0] * s0 + A[1] * s1 + A[2] * s2
    g1 = A[1] * s0 + A[3] * s1 + A[4] * s2
    g2 = A[2] * s0 + A[4] * s1 + A[5] * s2
    over = 1.0 / (chain.damping[j] + (s0 * g0 + s1 * g1 + s2 * g2))
    l0, l1, l2 = g0 * over, g1 * over, g2 * over
    chain.compliance[j] = over
    left[j, 0], left[j, 1], left[j, 2] = l0, l1, l2
    parent[0] += A[0] - l0 * g0
    parent[1] += A[1] - l0 * g1
    parent[2] += A[2] - l0 * g2
    parent[3] += A[3] - l1 * g1
    parent[4] += A[4] - l1 * g2
    parent[5] += A[5] - l2 * g2


@compiled
def solve_hinges(chain: HingeChain, torque: Array) -> None:
    """
    Fill the twists and rates that loads cause on a factored chain, as in `articulated_body`.

    Here `torque`, shape (n-1,), is the impulse on every joint [N m s].
    """
    n = len(chain.wrench)
    root = n // 2
    wrench = chain.wrench
    arm, other = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(root):
        arm = fold(chain, k, torque, wrench[k], arm)
        i = n - 1 - k
        if i > root:
            other = fold(chain, i - 1, torque, wrench[i], other)
    w0 = wrench[root, 0] + arm[0] + other[0]
    w1 = wrench[root, 1] + arm[1] + other[1]
    w2 = wrench[root, 2] + arm[2] + other[2]
    A = chain.inertia[root]
    w1 -= A[4] * w2
    w0 -= A[2] * w2 + A[1] * w1
    v0 = A[0] * w0
    v1 = A[3] * w1 - A[1] * v0
    arm = v0, v1, A[5] * w2 - A[2] * v0 - A[4] * v1
    other = arm
    twist = chain.twist
    twist[root, 0], twist[root, 1], twist[root, 2] = arm
    for k in range(root):
        i = root - 1 - k
        arm = unfold(chain, i, twist[i], arm)
        i = root + 1 + k
        if i < n:
            other = unfold(chain, i - 1, twist[i], other)


@inlined
def fold(chain: HingeChain, j: int, torque: Array, wrench: Array, beyond: Three) -> Three:
    """Return what the parent of joint j feels of the wrenches beyond; store its load."""
    axis, left = chain.axis, chain.left
    w0, w1, w2 = wrench[0] + beyond[0], wrench[1] + beyond[1], wrench[2] + beyond[2]
    s = torque[j] + (axis[j, 0] * w0 + axis[j, 1] * w1 + axis[j, 2] * w2)
    chain.load[j] = s
    return w0 - left[j, 0] * s, w1 - left[j, 1] * s, w2 - left[j, 2] * s


@inlined
def unfold(chain: HingeChain, j: int, twist: Array, v: Three) -> Three:
    """Fill and return the twist of the link beyond joint j from that of its parent, v."""
    axis, left = chain.axis, chain.left
    s = chain.compliance[j] * chain.load[j] - (
        left[j, 0] * v[0] + left[j, 1] * v[1] + left[j, 2] * v[2]
    )
    chain.rate[j] = s
    twist[0] = v[0] + axis[j, 0] * s
    twist[1] = v[1] + axis[j, 1] * s
    twist[2] = v[2] + axis[j, 2] * s
    return twist[0], twist[1], twist[2]

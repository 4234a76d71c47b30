# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The chain of links without contacts, factored once a step for any number of contact impulses.

The algorithm is that of `articulated_body`, whose words are used here. The inertias of the links
alone are symmetric, so that 21 numbers describe an articulated inertia. They and the wrenches stay
in the registers of a processor all the way along an arm. Both arms are done at once, as pairs of
numbers; see `compilation.pair`. With an even number of links the first arm has a link more: the
outermost one, which is then done as both of a pair.

With ``D = U^T U`` the axes of a joint are scaled to ``S U^-1``, in whose rates the joint has the
inertia 1. The root is scaled likewise, with ``A = U^T U``. Loads of the scaled axes and of the
root are listed in `load`: six numbers of the root, then two for every joint, arm by arm from the
root outward. In them the kinetic energy is half of the sum of squares. Therefore the loads of unit
impulses, in rows X, give the Delassus operator ``G = X X^T``, and loads f of momentum and torques
give the velocities without contact impulses, ``X f``.
"""

import math

import numpy as np

from snake_sim_ros.dynamics.articulated_body import Chain, FreeChain
from snake_sim_ros.dynamics.compilation import inlined, Packs, pair, square_root
from snake_sim_ros.dynamics.spatial_vectors import (
    add,
    add_links,
    both_arms,
    combine,
    dot,
    inertia_of_first_arm,
    lane_of,
    less,
    of_first_arm,
    reduced,
    row_of,
    row_pair,
    scaled,
    Six,
    store,
    store_pair,
    Symmetric,
    symmetric_times,
)
from snake_sim_ros.scene.parameters import Array


def make_free_chain(n: int) -> FreeChain:
    """Return the arrays for n links."""
    return FreeChain(
        axis=np.zeros((n - 1, 2, 6)),
        reach=np.zeros((n - 1, 2, 6)),
        root=np.zeros((6, 6)),
        load=np.zeros(2 * n + 4),
        end_load=np.zeros(2 * n + 4),
    )


@inlined
def joint_column(n: int, j: int) -> int:
    """Return the place in `load` of joint j of n links; that of its second axis follows."""
    root = n // 2
    return 6 + 2 * (j if j >= root else root - 1 - j)


@inlined
def opposite(n: int, k: int) -> tuple[int, int]:
    """Return the link of the other arm that is processed with link k, and its joint."""
    i = n - k - n % 2
    return (i, i - 1) if i < n else (0, 0)


@inlined
def factor_free(chain: Chain) -> None:
    """
    Factor the chain without contacts, and fill the loads of its momentum and torques.

    Of the chain, axis, torque, damping, bare and momentum are read, and `chain.free` is filled.
    """
    n, free, bare, momentum = len(chain.momentum), chain.free, chain.bare, chain.momentum
    root, o = n // 2, pair(0.0, 0.0)
    w = o, o, o, o, o, o
    A = o, o, o, o, o, o, o, o, o, o, o, o, o, o, o, o, o, o, o, o, o
    for k in range(root):
        i, j = opposite(n, k)
        A = add_links(A, bare[k], bare[i])
        w = add(w, row_pair(momentum, k, i))
        A, w = fold_free(chain, k, j, A, w)
        if i == 0:
            A, w = inertia_of_first_arm(A), of_first_arm(w)
    factor_root(free.root, A, bare[root])
    load = root_load(free.root, add(add(lane_of(w, 0), lane_of(w, 1)), row_of(momentum, root)))
    for k in range(6):
        free.load[k] = load[k]


@inlined
def fold_free(chain: Chain, j: int, other: int, A: Symmetric, w: Packs) -> tuple[Symmetric, Packs]:
    """
    Return what the parents of two joints feel of the inertias and the wrenches beyond.

    Parameters
    ----------
    chain : Chain
        Its axis, damping and torque are read, and `chain.free` is filled.
    j, other : int
        Numbers of the joints.
    A : tuple of 21 pairs
        Articulated inertias beyond the joints: their upper triangles, row by row.
    w : tuple of 6 pairs
        Wrenches beyond the joints.

    """
    free, K, torque = chain.free, chain.damping, chain.torque
    s0 = row_pair(chain.axis[:, 0], j, other)
    s1 = row_pair(chain.axis[:, 1], j, other)
    g0, g1 = symmetric_times(A, s0), symmetric_times(A, s1)
    d00 = pair(K[j, 0], K[other, 0]) + dot(s0, g0)
    d01 = pair(K[j, 1], K[other, 1]) + dot(s0, g1)
    d11 = pair(K[j, 2], K[other, 2]) + dot(s1, g1)
    c0, c1 = 1.0 / d00, d00 / (d00 * d11 - d01 * d01)
    share = d01 * c0
    g1, s1 = less(g1, share, g0), less(s1, share, s0)
    torque0 = pair(torque[j, 0], torque[other, 0])
    load0 = torque0 + dot(s0, w)
    load1 = pair(torque[j, 1], torque[other, 1]) - share * torque0 + dot(s1, w)
    r0, r1 = square_root(c0), square_root(c1)
    store_pair(free.axis[:, 0], j, other, scaled(r0, s0))
    store_pair(free.axis[:, 1], j, other, scaled(r1, s1))
    store_pair(free.reach[:, 0], j, other, scaled(r0, g0))
    store_pair(free.reach[:, 1], j, other, scaled(r1, g1))
    load0, load1 = r0 * load0, r1 * load1
    n = len(chain.momentum)
    column, other_column = joint_column(n, j), joint_column(n, other)
    free.load[column], free.load[column + 1] = load0[0], load1[0]
    free.load[other_column], free.load[other_column + 1] = load0[1], load1[1]
    load0, load1 = r0 * load0, r1 * load1
    return (
        reduced(A, scaled(c0, g0), g0, scaled(c1, g1), g1),
        less(less(w, load0, g0), load1, g1),
    )


@inlined
def fold_wrench(axis: Array, reach: Array, w: Packs) -> tuple[Array, Array, Packs]:
    """Return the loads that a wrench beyond a joint causes, and what the parent feels of it."""
    load0, load1 = dot(row_of(axis, 0), w), dot(row_of(axis, 1), w)
    return load0, load1, less(less(w, load0, row_of(reach, 0)), load1, row_of(reach, 1))


@inlined
def unfold_free(free: FreeChain, load: Array, twist: Array) -> None:
    """Fill the twists of all links, shape (n, 6), that loads cause on the factored chain."""
    n = len(twist)
    root = n // 2
    v = both_arms(root_twist(free.root, load))
    store(twist, root, lane_of(v, 0))
    for k in range(root - 1, -1, -1):
        i, j = opposite(n, k)
        if i == 0:
            v = both_arms(lane_of(v, 0))
        column, other = joint_column(n, k), joint_column(n, j)
        reach0, reach1 = row_pair(free.reach[:, 0], k, j), row_pair(free.reach[:, 1], k, j)
        rate0 = pair(load[column], load[other]) - dot(reach0, v)
        rate1 = pair(load[column + 1], load[other + 1]) - dot(reach1, v)
        axis0, axis1 = row_pair(free.axis[:, 0], k, j), row_pair(free.axis[:, 1], k, j)
        v = add(v, combine(rate0, axis0, rate1, axis1))
        store_pair(twist, k, i, v)


# The root, with A = L D L^T: L is below the diagonal of `root`, D^-1/2 on it.


@inlined
def factor_root(root: Array, A: Symmetric, bare: Array) -> None:
    """Fill the factors of the articulated inertia of the root, from those of both arms A."""
    m = 0
    for i in range(6):
        for j in range(i, 6):
            root[j, i] = A[m][0] + A[m][1] + bare[i, j]
            m += 1
    for k in range(6):
        over = 1.0 / root[k, k]
        for i in range(k + 1, 6):
            share = root[i, k] * over
            for j in range(k + 1, i + 1):
                root[i, j] -= share * root[j, k]
        for i in range(k + 1, 6):
            root[i, k] *= over
        root[k, k] = math.sqrt(over)


@inlined
def root_load(L: Array, w: Packs) -> Packs:
    """Return the scaled loads of the root that a wrench causes."""
    z0 = w[0]
    z1 = w[1] - L[1, 0] * z0
    z2 = w[2] - L[2, 0] * z0 - L[2, 1] * z1
    z3 = w[3] - L[3, 0] * z0 - L[3, 1] * z1 - L[3, 2] * z2
    z4 = w[4] - L[4, 0] * z0 - L[4, 1] * z1 - L[4, 2] * z2 - L[4, 3] * z3
    z5 = w[5] - L[5, 0] * z0 - L[5, 1] * z1 - L[5, 2] * z2 - L[5, 3] * z3 - L[5, 4] * z4
    return z0 * L[0, 0], z1 * L[1, 1], z2 * L[2, 2], z3 * L[3, 3], z4 * L[4, 4], z5 * L[5, 5]


@inlined
def root_twist(L: Array, load: Array) -> Six:
    """Return the twist of the root that its scaled loads cause."""
    v5 = load[5] * L[5, 5]
    v4 = load[4] * L[4, 4] - L[5, 4] * v5
    v3 = load[3] * L[3, 3] - L[5, 3] * v5 - L[4, 3] * v4
    v2 = load[2] * L[2, 2] - L[5, 2] * v5 - L[4, 2] * v4 - L[3, 2] * v3
    v1 = load[1] * L[1, 1] - L[5, 1] * v5 - L[4, 1] * v4 - L[3, 1] * v3 - L[2, 1] * v2
    v0 = load[0] * L[0, 0] - L[5, 0] * v5 - L[4, 0] * v4 - L[3, 0] * v3 - L[2, 0] * v2
    return v0 - L[1, 0] * v1, v1, v2, v3, v4, v5

# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Forward dynamics of a chain of links with two hinge axes a joint, linear in the number of links.

The articulated-body algorithm [1] on impulses: given the impulse wrenches on all links, it finds
the twists that satisfy the joint constraints. All quantities are about the common point O, in axes
of I, so that nothing is transformed along the chain. Twists are (angular [rad/s], linear [m/s]),
wrenches (moment [N m s], impulse [N s]). `factor_chain` prepares a configuration once; then
`articulated_velocity` solves it for any number of wrenches.

The inertia of a link may be any 6x6 matrix by which its wrench depends on its twist. A contact
adds the derivative of its impulse, which is not symmetric when friction follows the normal
impulse.

The root is the middle link. Its two arms do not depend on each other, so a processor works on both
at the same time. The parent of a link is the next one toward the root. With S the two axis twists
of the joint between both, and A the articulated inertia of everything from the link outward,
``D = S^T A S + damping``, the rates of the joint are
``q' = D^-1 (torque + S^T wrench) - D^-1 S^T A twist_parent``, and the parent feels the inertia
``A - A S D^-1 S^T A``.

.. [1] R. Featherstone, "Rigid Body Dynamics Algorithms", Springer 2008, ch. 7.
"""

from typing import NamedTuple

from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.spatial_vectors import (
    add,
    add_reduced,
    combine,
    combine_rows,
    dot,
    factor,
    row_of,
    rows_of,
    Six,
    solve,
    store,
)
from snake_sim_ros.scene.chain import JointPlaces
from snake_sim_ros.scene.parameters import Array

ZERO = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class FreeChain(NamedTuple):
    """
    The factors of a chain of n links without contacts, and its loads; see `free_chain`.

    U is in kg^1/2 m where it scales turns, and in kg^1/2 where it scales ways of the root. Scaled
    loads are in kg^1/2 m/s.
    """

    axis: Array  # (n-1, 2, 6) scaled axes S U^-1
    reach: Array  # (n-1, 2, 6) A S U^-1, of the inertia A beyond the joint
    root: Array  # (6, 6) factors of the root; see `free_chain.factor_root`
    load: Array  # (2n+4,) scaled loads of momentum and torques
    end_load: Array  # (2n+4,) the same with contact impulses


class Chain(NamedTuple):
    """
    A chain of links as the sweeps take it, and the arrays that they fill.

    Twists are angular velocities [rad/s] and velocities at O [m/s], and impulse wrenches moments
    about O [N m s] and impulses [N s], both in axes of I. Blocks of an inertia are in [kg m^2],
    [kg m] and [kg].
    """

    places: JointPlaces  # where the joints are, and which axes they have
    axis: Array  # (n-1, 2, 6) twists of the joint axes: of the outer link against its parent
    torque: Array  # (n-1, 2) impulse on every joint axis [N m s]
    damping: Array  # (n-1, 3) entries 11, 12, 22 of the impulse per rate of the axes [N m s^2]
    bare: Array  # (n, 6, 6) inertia of the links alone
    momentum: Array  # (n, 6) impulse wrench of everything but contacts and torques
    inertia: Array  # (n, 6, 6) articulated inertia; in inertia[n // 2] factors of the root
    wrench: Array  # (n, 6) load of every link: momentum plus impulse wrench
    # (n-1, 2, 6) A S D^-1, of the inertia A beyond the joint and its axes S [1], [1/m]
    left: Array
    right: Array  # (n-1, 2, 6) D^-1 S^T A, with D = S^T A S + damping [1], [1/m]
    compliance: Array  # (n-1, 4) entries 11, 12, 21, 22 of D^-1 [1/(kg m^2)]
    load: Array  # (n-1, 2) loads of the joint axes [N m s]
    rate: Array  # (n-1, 2) rates of the joint axes [rad/s]
    rate_correction: Array  # (n-1, 2) correction of these rates [rad/s]
    residual_torque: Array  # (n-1, 2) torque less what the rates resist [N m s]
    twist: Array  # (n, 6) twists of the links: the solution
    correction: Array  # (n, 6) correction of these twists
    # (contacts, 3, 3) contact frames, rows normal, e_x, e_y in axes of I; None on a flat floor
    frame: Array | None
    free: FreeChain  # the chain without contacts


@inlined
def reset_chain(chain: Chain) -> None:
    """
    Fill inertia and wrench with those of the links alone, residual torques with the torques.

    Twists and rates become 0, so that a correction of them is the solution.
    """
    for i in range(len(chain.wrench)):
        for k in range(6):
            chain.wrench[i, k] = chain.momentum[i, k]
            for j in range(6):
                chain.inertia[i, k, j] = chain.bare[i, k, j]
            chain.twist[i, k] = 0.0
    for j in range(len(chain.torque)):
        chain.residual_torque[j, 0], chain.residual_torque[j, 1] = (
            chain.torque[j, 0],
            chain.torque[j, 1],
        )
        chain.rate[j, 0] = chain.rate[j, 1] = 0.0


@inlined
def solve_chain(chain: Chain, torque: Array) -> None:
    """
    Fill chain.twist and chain.rate, which loads cause on a factored chain.

    `torque`, shape (n-1, 2), is the impulse on every joint axis [N m s], `chain.wrench` the load
    of the links.
    """
    articulated_velocity(chain, torque, chain.rate, chain.twist)


@inlined
def solve_residual(chain: Chain) -> None:
    """Fill chain.correction, the twists that residual torques and chain.wrench cause."""
    articulated_velocity(chain, chain.residual_torque, chain.rate_correction, chain.correction)


@inlined
def correct_chain(chain: Chain) -> float:
    """
    Solve a factored chain for the residual loads, and add the solution to twists and rates.

    Returns
    -------
    float
        Largest component of a twist that was added.

    """
    solve_residual(chain)
    largest = 0.0
    for i in range(len(chain.twist)):
        for k in range(6):
            chain.twist[i, k] += chain.correction[i, k]
            largest = max(largest, abs(chain.correction[i, k]))
    for j in range(len(chain.rate)):
        chain.rate[j, 0] += chain.rate_correction[j, 0]
        chain.rate[j, 1] += chain.rate_correction[j, 1]
    return largest


@inlined
def find_residual(chain: Chain) -> None:
    """
    Fill wrenches and residual torques with what the twists leave of the balance of momentum.

    On entry chain.wrench holds all loads, those of contacts at these twists included. The
    stiffness of contacts in a factored inertia costs up to eight digits. A second solution for the
    residual, which is evaluated with the inertia of the links alone, recovers them (iterative
    refinement).
    """
    for i in range(len(chain.twist)):
        v = row_of(chain.twist, i)
        for k in range(6):
            chain.wrench[i, k] -= dot(row_of(chain.bare[i], k), v)
    for j in range(len(chain.rate)):
        rate0, rate1 = chain.rate[j, 0], chain.rate[j, 1]
        d00, d01, d11 = chain.damping[j, 0], chain.damping[j, 1], chain.damping[j, 2]
        chain.residual_torque[j, 0] = chain.torque[j, 0] - d00 * rate0 - d01 * rate1
        chain.residual_torque[j, 1] = chain.torque[j, 1] - d01 * rate0 - d11 * rate1


@inlined
def factor_chain(chain: Chain) -> None:
    """
    Turn link inertias into articulated-body inertias, and that of the root into its LU factors.

    On entry chain.inertia has the inertias of the links; axis and damping are read, and left,
    right and compliance filled.
    """
    inertia = chain.inertia
    n = len(inertia)
    root = n // 2
    for k in range(root):
        fold_inertia(chain, k, inertia[k], inertia[k + 1])
        i = n - 1 - k
        if i > root:
            fold_inertia(chain, i - 1, inertia[i], inertia[i - 1])
    factor(inertia[root])


@inlined
def fold_inertia(chain: Chain, j: int, A: Array, parent: Array) -> None:
    """Add to the inertia of the parent what it feels through joint j of the inertia A beyond."""
    axis, damping, compliance = chain.axis, chain.damping, chain.compliance
    s0, s1 = row_of(axis[j], 0), row_of(axis[j], 1)
    rows = rows_of(A)
    a0, a1, a2, a3, a4, a5 = rows
    g0 = (dot(a0, s0), dot(a1, s0), dot(a2, s0), dot(a3, s0), dot(a4, s0), dot(a5, s0))
    g1 = (dot(a0, s1), dot(a1, s1), dot(a2, s1), dot(a3, s1), dot(a4, s1), dot(a5, s1))
    h0, h1 = combine_rows(s0, rows), combine_rows(s1, rows)
    d00, d01 = damping[j, 0] + dot(s0, g0), damping[j, 1] + dot(s0, g1)
    d10, d11 = damping[j, 1] + dot(s1, g0), damping[j, 2] + dot(s1, g1)
    scale = 1.0 / (d00 * d11 - d01 * d10)
    c00, c01, c10, c11 = d11 * scale, -d01 * scale, -d10 * scale, d00 * scale
    compliance[j, 0], compliance[j, 1] = c00, c01
    compliance[j, 2], compliance[j, 3] = c10, c11
    g0, g1 = combine(c00, g0, c10, g1), combine(c01, g0, c11, g1)
    add_reduced(parent, rows, g0, h0, g1, h1)
    store(chain.left[j], 0, g0)
    store(chain.left[j], 1, g1)
    store(chain.right[j], 0, combine(c00, h0, c01, h1))
    store(chain.right[j], 1, combine(c10, h0, c11, h1))


@inlined
def articulated_velocity(chain: Chain, torque: Array, rate: Array, twist: Array) -> None:
    """
    Fill the twists of all links that torques and chain.wrench cause on a factored chain.

    Parameters
    ----------
    chain : Chain
        As filled by `factor_chain`; its load is filled.
    torque : ndarray, shape (n-1, 2)
        Impulse on every joint axis [N m s].
    rate : ndarray, shape (n-1, 2)
        Filled with the rates of the joint axes [rad/s].
    twist : ndarray, shape (n, 6)
        Filled with the twists.

    """
    wrench = chain.wrench
    n = len(wrench)
    root = n // 2
    arm, other = ZERO, ZERO
    for k in range(root):
        arm = fold(chain, k, torque, add(arm, row_of(wrench, k)))
        i = n - 1 - k
        if i > root:
            other = fold(chain, i - 1, torque, add(other, row_of(wrench, i)))
    arm = solve(chain.inertia[root], add(add(arm, other), row_of(wrench, root)))
    other = arm
    store(twist, root, arm)
    for k in range(root):
        i = root - 1 - k
        arm = unfold(chain, i, rate, arm)
        store(twist, i, arm)
        i = root + 1 + k
        if i < n:
            other = unfold(chain, i - 1, rate, other)
            store(twist, i, other)


@inlined
def fold(chain: Chain, j: int, torque: Array, w: Six) -> Six:
    """Return what the parent of joint j feels of the wrench w beyond; store its load."""
    axis, left, load = chain.axis, chain.left, chain.load
    load0 = torque[j, 0] + dot(row_of(axis[j], 0), w)
    load1 = torque[j, 1] + dot(row_of(axis[j], 1), w)
    load[j, 0], load[j, 1] = load0, load1
    return (
        w[0] - left[j, 0, 0] * load0 - left[j, 1, 0] * load1,
        w[1] - left[j, 0, 1] * load0 - left[j, 1, 1] * load1,
        w[2] - left[j, 0, 2] * load0 - left[j, 1, 2] * load1,
        w[3] - left[j, 0, 3] * load0 - left[j, 1, 3] * load1,
        w[4] - left[j, 0, 4] * load0 - left[j, 1, 4] * load1,
        w[5] - left[j, 0, 5] * load0 - left[j, 1, 5] * load1,
    )


@inlined
def unfold(chain: Chain, j: int, rate: Array, v: Six) -> Six:
    """Return the twist of the link beyond joint j from that of its parent, v; store the rates."""
    axis, right, compliance = chain.axis, chain.right, chain.compliance
    load0, load1 = chain.load[j, 0], chain.load[j, 1]
    rate0 = compliance[j, 0] * load0 + compliance[j, 1] * load1 - dot(row_of(right[j], 0), v)
    rate1 = compliance[j, 2] * load0 + compliance[j, 3] * load1 - dot(row_of(right[j], 1), v)
    rate[j, 0], rate[j, 1] = rate0, rate1
    return add(v, combine(rate0, row_of(axis[j], 0), rate1, row_of(axis[j], 1)))

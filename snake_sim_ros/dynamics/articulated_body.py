# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Forward dynamics of a chain of links with two hinge axes a joint, linear in the number of links.

The articulated-body algorithm [1] on impulses: given the impulse wrenches on all links, it finds
the twists that satisfy the joint constraints. All quantities are about the common point O, in axes
of I, so that nothing is transformed along the chain. Twists are (angular [rad/s], linear [m/s]),
wrenches (moment [N m s], impulse [N s]). `articulated_inertia` prepares a configuration once; then
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

from typing import Any, NamedTuple

from snake_sim_ros.dynamics.compilation import compiled, inlined, merged, Packs
from snake_sim_ros.scene.parameters import Array

ZERO = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Chain(NamedTuple):
    """
    A chain of links as the sweeps take it, and the arrays that they fill.

    Twists are angular velocities [rad/s] and velocities at O [m/s], and impulse wrenches moments
    about O [N m s] and impulses [N s], both in axes of I. Blocks of an inertia are in [kg m^2],
    [kg m] and [kg].
    """

    axis: Array  # (n-1, 2, 6) twists of the joint axes: of the outer link against its parent
    torque: Array  # (n-1, 2) impulse on every joint axis [N m s]
    damping: Array  # (n-1, 3) entries 11, 12, 22 of the impulse per rate of the axes [N m s^2]
    bare: Array  # (n, 6, 6) inertia of the links alone, about O
    momentum: Array  # (n, 6) impulse wrench of everything but contacts and torques
    inertia: Array  # (n, 6, 6) articulated inertia; in inertia[n // 2] factors of the root
    wrench: Array  # (n, 6) load of every link: momentum plus impulse wrench
    left: Array  # (n-1, 2, 6) A S D^-1, of the inertia A beyond the joint and its axes S
    right: Array  # (n-1, 2, 6) D^-1 S^T A, with D = S^T A S + damping
    compliance: Array  # (n-1, 4) entries 11, 12, 21, 22 of D^-1 [1/(kg m^2)]
    load: Array  # (n-1, 2) loads of the joint axes [N m s]
    rate: Array  # (n-1, 2) rates of the joint axes [rad/s]
    rate_correction: Array  # (n-1, 2) correction of these rates [rad/s]
    residual_torque: Array  # (n-1, 2) torque less what the rates resist [N m s]
    twist: Array  # (n, 6) twists of the links: the solution
    correction: Array  # (n, 6) correction of these twists
    no_torque: Array  # (n-1, 2) zeros
    frame: Array | None = None  # (contacts, 3, 3) contact frames; None on a flat floor
    free: Any = None  # the chain without contacts, see `free_chain.FreeChain`
    pair_delassus: Any = None  # Delassus operator of contacts of two links, if there can be any


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
def factor_chain(chain: Chain) -> None:
    """Prepare the chain for solutions, with the link inertias in chain.inertia."""
    articulated_inertia(
        chain.axis, chain.damping, chain.inertia, chain.left, chain.right, chain.compliance
    )


@inlined
def solve_chain(chain: Chain, torque: Array) -> None:
    """
    Fill the twists and rates that loads cause on a factored chain.

    Parameters
    ----------
    chain : Chain
        Its `wrench` is the load of the links; `twist` and `rate` are filled.
    torque : ndarray, shape (n-1, 2)
        Impulse on every joint axis [N m s].

    """
    articulated_velocity(
        chain.axis, chain.left, chain.right, chain.compliance,
        chain.inertia[len(chain.inertia) // 2], torque, chain.wrench,
        chain.load, chain.rate, chain.twist,
    )  # fmt: skip


@inlined
def solve_residual(chain: Chain) -> None:
    """Fill chain.correction, the twists that residual torques and chain.wrench cause."""
    articulated_velocity(
        chain.axis, chain.left, chain.right, chain.compliance,
        chain.inertia[len(chain.inertia) // 2], chain.residual_torque, chain.wrench,
        chain.load, chain.rate_correction, chain.correction,
    )  # fmt: skip


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


@merged
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


@compiled
def articulated_inertia(
    axis: Array, damping: Array, inertia: Array, left: Array, right: Array, compliance: Array
) -> None:
    """
    Turn link inertias into articulated-body inertias, and that of the root into its LU factors.

    Joint j is between link j and link j+1 (counted from 0).

    Parameters
    ----------
    axis : ndarray, shape (n-1, 2, 6)
        Twists S of the joint axes: of the outer link against its parent.
    damping : ndarray, shape (n-1, 3)
        Entries 11, 12, 22 of the impulse per rate that resists the axes [N m s^2].
    inertia : ndarray, shape (n, 6, 6)
        On entry inertia of the links; on return articulated inertia, and in ``inertia[n // 2]``
        the factors of the articulated inertia of the root.
    left, right : ndarray, shape (n-1, 2, 6)
        Filled with A S D^-1 and D^-1 S^T A.
    compliance : ndarray, shape (n-1, 4)
        Filled with the entries 11, 12, 21, 22 of D^-1.

    """
    n = len(inertia)
    root = n // 2
    for k in range(root):
        fold_inertia(k, axis, damping, inertia[k], inertia[k + 1], left, right, compliance)
        i = n - 1 - k
        if i > root:
            parent = inertia[i - 1]
            fold_inertia(i - 1, axis, damping, inertia[i], parent, left, right, compliance)
    factor(inertia[root])


@inlined
def fold_inertia(
    j: int,
    axis: Array,
    damping: Array,
    A: Array,
    parent: Array,
    left: Array,
    right: Array,
    compliance: Array,
) -> None:
    """Add to the inertia of the parent what it feels through joint j of the inertia A beyond."""
    s0, s1 = row_of(axis[j], 0), row_of(axis[j], 1)
    a0, a1, a2, a3, a4, a5 = rows_of(A)
    g0 = (dot(a0, s0), dot(a1, s0), dot(a2, s0), dot(a3, s0), dot(a4, s0), dot(a5, s0))
    g1 = (dot(a0, s1), dot(a1, s1), dot(a2, s1), dot(a3, s1), dot(a4, s1), dot(a5, s1))
    h0, h1 = combine_rows(s0, a0, a1, a2, a3, a4, a5), combine_rows(s1, a0, a1, a2, a3, a4, a5)
    d00, d01 = damping[j, 0] + dot(s0, g0), damping[j, 1] + dot(s0, g1)
    d10, d11 = damping[j, 1] + dot(s1, g0), damping[j, 2] + dot(s1, g1)
    scale = 1.0 / (d00 * d11 - d01 * d10)
    c00, c01, c10, c11 = d11 * scale, -d01 * scale, -d10 * scale, d00 * scale
    compliance[j, 0], compliance[j, 1] = c00, c01
    compliance[j, 2], compliance[j, 3] = c10, c11
    g0, g1 = combine(c00, g0, c10, g1), combine(c01, g0, c11, g1)
    add_reduced(parent, (a0, a1, a2, a3, a4, a5), g0, h0, g1, h1)
    store(left[j], 0, g0)
    store(left[j], 1, g1)
    store(right[j], 0, combine(c00, h0, c01, h1))
    store(right[j], 1, combine(c10, h0, c11, h1))


@compiled
def articulated_velocity(
    axis: Array,
    left: Array,
    right: Array,
    compliance: Array,
    root_factor: Array,
    torque: Array,
    wrench: Array,
    load: Array,
    rate: Array,
    twist: Array,
) -> None:
    """
    Fill the twists of all links under given loads.

    Parameters
    ----------
    axis, left, right, compliance : ndarray
        As filled by `articulated_inertia`.
    root_factor : ndarray, shape (6, 6)
        LU factors of the articulated inertia of the root.
    torque : ndarray, shape (n-1, 2)
        Impulse on every joint axis [N m s].
    wrench : ndarray, shape (n, 6)
        Momentum and impulse wrench of every link together.
    load : ndarray, shape (n-1, 2)
        Filled with the loads of the joint axes [N m s].
    rate : ndarray, shape (n-1, 2)
        Filled with the rates of the joint axes [rad/s].
    twist : ndarray, shape (n, 6)
        Filled with the twists.

    """
    n = len(wrench)
    root = n // 2
    arm, other = ZERO, ZERO
    for k in range(root):
        arm = fold(k, axis, left, torque, load, add(arm, row_of(wrench, k)))
        i = n - 1 - k
        if i > root:
            other = fold(i - 1, axis, left, torque, load, add(other, row_of(wrench, i)))
    arm = solve(root_factor, add(add(arm, other), row_of(wrench, root)))
    other = arm
    store(twist, root, arm)
    for k in range(root):
        i = root - 1 - k
        arm = unfold(i, axis, right, compliance, load, rate, arm)
        store(twist, i, arm)
        i = root + 1 + k
        if i < n:
            other = unfold(i - 1, axis, right, compliance, load, rate, other)
            store(twist, i, other)


@inlined
def fold(
    j: int,
    axis: Array,
    left: Array,
    torque: Array,
    load: Array,
    w: tuple[float, float, float, float, float, float],
) -> tuple[float, float, float, float, float, float]:
    """Return what the parent of joint j feels of the wrench w beyond; store its load."""
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
def unfold(
    j: int,
    axis: Array,
    right: Array,
    compliance: Array,
    load: Array,
    rate: Array,
    v: tuple[float, float, float, float, float, float],
) -> tuple[float, float, float, float, float, float]:
    """Return the twist of the link beyond joint j from that of its parent, v; store the rates."""
    load0, load1 = load[j, 0], load[j, 1]
    rate0 = compliance[j, 0] * load0 + compliance[j, 1] * load1 - dot(row_of(right[j], 0), v)
    rate1 = compliance[j, 2] * load0 + compliance[j, 3] * load1 - dot(row_of(right[j], 1), v)
    rate[j, 0], rate[j, 1] = rate0, rate1
    return add(v, combine(rate0, row_of(axis[j], 0), rate1, row_of(axis[j], 1)))


@compiled
def factor(A: Array) -> None:
    """Replace a 6x6 matrix by its factors L and U, the diagonal of U inverted (no pivoting)."""
    for k in range(6):
        A[k, k] = 1.0 / A[k, k]
        for i in range(k + 1, 6):
            A[i, k] *= A[k, k]
            for j in range(k + 1, 6):
                A[i, j] -= A[i, k] * A[k, j]


@compiled
def solve(
    A: Array, w: tuple[float, float, float, float, float, float]
) -> tuple[float, float, float, float, float, float]:
    """Return x with L U x = w, for the factors that `factor` left in A."""
    x0 = w[0]
    x1 = w[1] - A[1, 0] * x0
    x2 = w[2] - A[2, 0] * x0 - A[2, 1] * x1
    x3 = w[3] - A[3, 0] * x0 - A[3, 1] * x1 - A[3, 2] * x2
    x4 = w[4] - A[4, 0] * x0 - A[4, 1] * x1 - A[4, 2] * x2 - A[4, 3] * x3
    x5 = w[5] - A[5, 0] * x0 - A[5, 1] * x1 - A[5, 2] * x2 - A[5, 3] * x3 - A[5, 4] * x4
    x5 = x5 * A[5, 5]
    x4 = (x4 - A[4, 5] * x5) * A[4, 4]
    x3 = (x3 - A[3, 5] * x5 - A[3, 4] * x4) * A[3, 3]
    x2 = (x2 - A[2, 5] * x5 - A[2, 4] * x4 - A[2, 3] * x3) * A[2, 2]
    x1 = (x1 - A[1, 5] * x5 - A[1, 4] * x4 - A[1, 3] * x3 - A[1, 2] * x2) * A[1, 1]
    x0 = x0 - A[0, 5] * x5 - A[0, 4] * x4 - A[0, 3] * x3 - A[0, 2] * x2 - A[0, 1] * x1
    return x0 * A[0, 0], x1, x2, x3, x4, x5


# Functions of six numbers, which a processor keeps in registers.


@inlined
def row_of(A: Array, i: int) -> tuple[float, float, float, float, float, float]:
    """Return A[i] as a tuple."""
    return A[i, 0], A[i, 1], A[i, 2], A[i, 3], A[i, 4], A[i, 5]


@merged
def rows_of(
    A: Array,
) -> tuple[
    tuple[float, float, float, float, float, float],
    tuple[float, float, float, float, float, float],
    tuple[float, float, float, float, float, float],
    tuple[float, float, float, float, float, float],
    tuple[float, float, float, float, float, float],
    tuple[float, float, float, float, float, float],
]:
    """Return the six rows of A as tuples."""
    return (
        (A[0, 0], A[0, 1], A[0, 2], A[0, 3], A[0, 4], A[0, 5]),
        (A[1, 0], A[1, 1], A[1, 2], A[1, 3], A[1, 4], A[1, 5]),
        (A[2, 0], A[2, 1], A[2, 2], A[2, 3], A[2, 4], A[2, 5]),
        (A[3, 0], A[3, 1], A[3, 2], A[3, 3], A[3, 4], A[3, 5]),
        (A[4, 0], A[4, 1], A[4, 2], A[4, 3], A[4, 4], A[4, 5]),
        (A[5, 0], A[5, 1], A[5, 2], A[5, 3], A[5, 4], A[5, 5]),
    )


@compiled
def store(A: Array, i: int, w: tuple[float, float, float, float, float, float]) -> None:
    """Write the tuple w to A[i]."""
    A[i, 0], A[i, 1], A[i, 2], A[i, 3], A[i, 4], A[i, 5] = w


@inlined
def dot(a: Packs, b: Packs) -> Any:
    """Return a . b."""
    return (a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3]) + (a[4] * b[4] + a[5] * b[5])


@inlined
def add(a: Packs, b: Packs) -> Packs:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5]


@inlined
def combine(x: Any, a: Packs, y: Any, b: Packs) -> Packs:
    """Return x a + y b."""
    return (
        x * a[0] + y * b[0], x * a[1] + y * b[1], x * a[2] + y * b[2],
        x * a[3] + y * b[3], x * a[4] + y * b[4], x * a[5] + y * b[5],
    )  # fmt: skip


@inlined
def combine_rows(
    s: tuple[float, float, float, float, float, float],
    a0: tuple[float, float, float, float, float, float],
    a1: tuple[float, float, float, float, float, float],
    a2: tuple[float, float, float, float, float, float],
    a3: tuple[float, float, float, float, float, float],
    a4: tuple[float, float, float, float, float, float],
    a5: tuple[float, float, float, float, float, float],
) -> tuple[float, float, float, float, float, float]:
    """Return the sum of s[k] a_k."""
    return add(
        add(combine(s[0], a0, s[1], a1), combine(s[2], a2, s[3], a3)), combine(s[4], a4, s[5], a5)
    )


@merged
def add_reduced(
    A: Array,
    rows: tuple[
        tuple[float, float, float, float, float, float],
        tuple[float, float, float, float, float, float],
        tuple[float, float, float, float, float, float],
        tuple[float, float, float, float, float, float],
        tuple[float, float, float, float, float, float],
        tuple[float, float, float, float, float, float],
    ],
    x: tuple[float, float, float, float, float, float],
    b: tuple[float, float, float, float, float, float],
    y: tuple[float, float, float, float, float, float],
    c: tuple[float, float, float, float, float, float],
) -> None:
    """Add to A the matrix with the given rows, minus x b^T and y c^T."""
    for i in range(6):
        for j in range(6):
            A[i, j] += rows[i][j] - x[i] * b[j] - y[i] * c[j]

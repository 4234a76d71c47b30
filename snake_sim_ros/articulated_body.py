"""
Forward dynamics of a chain of links with two hinge axes a joint, linear in the number of links.

The articulated-body algorithm [1] on impulses: given momentum and impulse wrenches, find the
twists after the step that satisfy the joint constraints. All quantities are about one common point
in common axes, twists as (angular, linear), wrenches as (moment, impulse), so that nothing is
transformed on the way along the chain. `articulated_inertia` prepares a configuration once;
`articulated_velocity` then solves for any number of loads.

The root is the middle link: its two arms do not depend on each other, and a processor works on
both at the same time. With S the two axis twists of the joint between a link and its parent, which
is the next one toward the root, and A the articulated inertia of everything from the link outward,
the rates of the joint are ``q' = D^-1 (torque + S^T wrench) - G^T twist_parent`` with ``G = A S
D^-1`` and ``D = S^T A S + damping``, and the parent feels ``A - G D G^T``.

.. [1] R. Featherstone, "Rigid Body Dynamics Algorithms", Springer 2008, ch. 7.
"""

from snake_sim_ros.compilation import compiled

ZERO = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@compiled
def articulated_inertia(axis, damping, inertia, gain, compliance):
    """
    Turn link inertias into articulated-body inertias, and that of the root into its inverse.

    Joint j is between link j and link j+1 (counted from 0).

    Parameters
    ----------
    axis : ndarray, shape (n-1, 2, 6)
        Twists S of the joint axes: of the outer link against its parent.
    damping : ndarray, shape (n-1, 3)
        Entries 11, 12, 22 of the impulse per rate that resists the axes [N m s^2].
    inertia : ndarray, shape (n, 6, 6)
        On entry inertia of the links; on return articulated inertia, and in ``inertia[n // 2]``
        the inverse of the articulated inertia of the root.
    gain : ndarray, shape (n-1, 2, 6)
        Filled with G.
    compliance : ndarray, shape (n-1, 3)
        Filled with the entries 11, 12, 22 of D^-1.

    """
    n = len(inertia)
    root = n // 2
    for k in range(root):
        fold_inertia(k, axis, damping, inertia[k], inertia[k + 1], gain, compliance)
        i = n - 1 - k
        if i > root:
            fold_inertia(i - 1, axis, damping, inertia[i], inertia[i - 1], gain, compliance)
    invert(inertia[root])


@compiled
def fold_inertia(j, axis, damping, A, parent, gain, compliance):
    """Add to the inertia of the parent what joint j lets it feel of the inertia A beyond."""
    S, G = axis[j], gain[j]
    for k in range(2):
        for row in range(6):
            G[k, row] = (
                A[row, 0] * S[k, 0] + A[row, 1] * S[k, 1] + A[row, 2] * S[k, 2]
                + A[row, 3] * S[k, 3] + A[row, 4] * S[k, 4] + A[row, 5] * S[k, 5]
            )  # fmt: skip
    d11, d12, d22 = damping[j, 0], damping[j, 1], damping[j, 2]
    for row in range(6):
        d11 += S[0, row] * G[0, row]
        d12 += S[0, row] * G[1, row]
        d22 += S[1, row] * G[1, row]
    determinant = d11 * d22 - d12 * d12
    c11, c12, c22 = d22 / determinant, -d12 / determinant, d11 / determinant
    compliance[j, 0], compliance[j, 1], compliance[j, 2] = c11, c12, c22
    for row in range(6):
        g0, g1 = c11 * G[0, row] + c12 * G[1, row], c12 * G[0, row] + c22 * G[1, row]
        for column in range(row, 6):  # of G only rows before `row` are final, the others hold A S
            value = A[row, column] - g0 * G[0, column] - g1 * G[1, column]
            parent[row, column] += value
            if column > row:
                parent[column, row] += value
        G[0, row], G[1, row] = g0, g1


@compiled
def invert(A):
    """Replace a symmetric positive definite matrix by its inverse (Gauss-Jordan, no pivoting)."""
    size = len(A)
    for k in range(size):
        pivot = 1.0 / A[k, k]
        A[k, k] = 1.0
        for j in range(size):
            A[k, j] *= pivot
        for i in range(size):
            if i != k:
                factor = A[i, k]
                A[i, k] = 0.0
                for j in range(size):
                    A[i, j] -= factor * A[k, j]


@compiled
def articulated_velocity(
    axis, gain, compliance, root_inverse, torque, momentum, wrench, load, twist
):
    """
    Fill the twists of all links under given loads.

    Parameters
    ----------
    axis, gain, compliance : ndarray
        As filled by `articulated_inertia`.
    root_inverse : ndarray, shape (6, 6)
        Inverse of the articulated inertia of the root.
    torque : ndarray, shape (n-1, 2)
        Impulse on every joint axis [N m s].
    momentum, wrench : ndarray, shape (n, 6)
        Momentum and impulse wrench of every link; only their sum counts.
    load : ndarray, shape (n-1, 2)
        Filled with the loads of the joint axes.
    twist : ndarray, shape (n, 6)
        Filled with the twists.

    """
    n = len(momentum)
    root = n // 2
    left = right = ZERO
    for k in range(root):
        left = fold(k, axis, gain, torque, load, total(left, momentum, wrench, k))
        i = n - 1 - k
        if i > root:
            right = fold(i - 1, axis, gain, torque, load, total(right, momentum, wrench, i))
    w = total(left, momentum, wrench, root)
    w = (w[0] + right[0], w[1] + right[1], w[2] + right[2],
         w[3] + right[3], w[4] + right[4], w[5] + right[5])  # fmt: skip
    A = root_inverse
    left = (row(A, 0, w), row(A, 1, w), row(A, 2, w), row(A, 3, w), row(A, 4, w), row(A, 5, w))
    right = left
    store(twist, root, left)
    for k in range(root):
        i = root - 1 - k
        left = unfold(i, axis, gain, compliance, load, left)
        store(twist, i, left)
        i = root + 1 + k
        if i < n:
            right = unfold(i - 1, axis, gain, compliance, load, right)
            store(twist, i, right)


@compiled
def fold(j, axis, gain, torque, load, w):
    """Return what the parent of joint j feels of the wrench w beyond; keep its load."""
    load0 = torque[j, 0] + dot(axis, j, 0, w)
    load1 = torque[j, 1] + dot(axis, j, 1, w)
    load[j, 0], load[j, 1] = load0, load1
    return (
        w[0] - gain[j, 0, 0] * load0 - gain[j, 1, 0] * load1,
        w[1] - gain[j, 0, 1] * load0 - gain[j, 1, 1] * load1,
        w[2] - gain[j, 0, 2] * load0 - gain[j, 1, 2] * load1,
        w[3] - gain[j, 0, 3] * load0 - gain[j, 1, 3] * load1,
        w[4] - gain[j, 0, 4] * load0 - gain[j, 1, 4] * load1,
        w[5] - gain[j, 0, 5] * load0 - gain[j, 1, 5] * load1,
    )


@compiled
def unfold(j, axis, gain, compliance, load, v):
    """Return the twist of the link beyond joint j from that of its parent, v."""
    c11, c12, c22 = compliance[j, 0], compliance[j, 1], compliance[j, 2]
    rate0 = c11 * load[j, 0] + c12 * load[j, 1] - dot(gain, j, 0, v)
    rate1 = c12 * load[j, 0] + c22 * load[j, 1] - dot(gain, j, 1, v)
    return (
        v[0] + axis[j, 0, 0] * rate0 + axis[j, 1, 0] * rate1,
        v[1] + axis[j, 0, 1] * rate0 + axis[j, 1, 1] * rate1,
        v[2] + axis[j, 0, 2] * rate0 + axis[j, 1, 2] * rate1,
        v[3] + axis[j, 0, 3] * rate0 + axis[j, 1, 3] * rate1,
        v[4] + axis[j, 0, 4] * rate0 + axis[j, 1, 4] * rate1,
        v[5] + axis[j, 0, 5] * rate0 + axis[j, 1, 5] * rate1,
    )


@compiled
def total(w, momentum, wrench, i):
    """Return w and the loads of link i together."""
    return (
        w[0] + momentum[i, 0] + wrench[i, 0],
        w[1] + momentum[i, 1] + wrench[i, 1],
        w[2] + momentum[i, 2] + wrench[i, 2],
        w[3] + momentum[i, 3] + wrench[i, 3],
        w[4] + momentum[i, 4] + wrench[i, 4],
        w[5] + momentum[i, 5] + wrench[i, 5],
    )


@compiled
def dot(A, j, k, w):
    """Return A[j, k] . w."""
    return (
        (A[j, k, 0] * w[0] + A[j, k, 1] * w[1])
        + (A[j, k, 2] * w[2] + A[j, k, 3] * w[3])
        + (A[j, k, 4] * w[4] + A[j, k, 5] * w[5])
    )


@compiled
def row(A, i, w):
    """Return A[i] . w."""
    return (
        (A[i, 0] * w[0] + A[i, 1] * w[1])
        + (A[i, 2] * w[2] + A[i, 3] * w[3])
        + (A[i, 4] * w[4] + A[i, 5] * w[5])
    )


@compiled
def store(A, i, w):
    """Write the tuple w to A[i]."""
    A[i, 0], A[i, 1], A[i, 2], A[i, 3], A[i, 4], A[i, 5] = w

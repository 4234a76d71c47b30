"""
Forward dynamics of a chain of links with two hinge axes a joint, linear in the number of links.

The articulated-body algorithm [1] on impulses: given momentum and impulse wrenches, find the twists
after the step that satisfy the joint constraints. All quantities are about one common point in common
axes, twists as (angular, linear), wrenches as (moment, impulse), so that nothing is transformed on the
way along the chain. `articulated_inertia` prepares a configuration once; `articulated_velocity` then
solves for any number of loads.

With S the two axis twists of the joint between link i and link i+1 and A the articulated inertia of
everything from link i+1 on, the rates of the joint are
``q' = D^-1 (torque + S^T wrench) - G^T twist_i`` with ``G = A S D^-1`` and ``D = S^T A S + damping``,
and link i feels ``A - G D G^T``.

.. [1] R. Featherstone, "Rigid Body Dynamics Algorithms", Springer 2008, ch. 7.
"""

from snake_sim_ros.compilation import compiled


@compiled
def articulated_inertia(axis, damping, inertia, gain, compliance):  # type: ignore[no-untyped-def]
    """
    Turn link inertias into articulated-body inertias, and the first one into its inverse.

    Parameters
    ----------
    axis : ndarray, shape (n-1, 2, 6)
        Twists of the joint axes, S.
    damping : ndarray, shape (n-1, 2)
        Impulse per rate that resists every axis [N m s^2].
    inertia : ndarray, shape (n, 6, 6)
        On entry inertia of the links; on return articulated inertia, and in ``inertia[0]`` the
        inverse of the articulated inertia of the first link.
    gain : ndarray, shape (n-1, 2, 6)
        Filled with G.
    compliance : ndarray, shape (n-1, 3)
        Filled with the entries 11, 12, 22 of D^-1.

    """
    for j in range(len(axis) - 1, -1, -1):
        A, below, S, G = inertia[j + 1], inertia[j], axis[j], gain[j]
        for k in range(2):
            for row in range(6):
                G[k, row] = (
                    A[row, 0] * S[k, 0] + A[row, 1] * S[k, 1] + A[row, 2] * S[k, 2]
                    + A[row, 3] * S[k, 3] + A[row, 4] * S[k, 4] + A[row, 5] * S[k, 5]
                )  # fmt: skip
        d11, d12, d22 = damping[j, 0], 0.0, damping[j, 1]
        for row in range(6):
            d11 += S[0, row] * G[0, row]
            d12 += S[0, row] * G[1, row]
            d22 += S[1, row] * G[1, row]
        determinant = d11 * d22 - d12 * d12
        c11, c12, c22 = d22 / determinant, -d12 / determinant, d11 / determinant
        compliance[j, 0], compliance[j, 1], compliance[j, 2] = c11, c12, c22
        for row in range(6):
            a0, a1 = G[0, row], G[1, row]
            g0, g1 = c11 * a0 + c12 * a1, c12 * a0 + c22 * a1
            for column in range(row, 6):
                # A S is overwritten by G only in rows up to `row`; column >= row is still A S.
                value = A[row, column] - g0 * G[0, column] - g1 * G[1, column]
                below[row, column] += value
                if column > row:
                    below[column, row] += value
            G[0, row], G[1, row] = g0, g1
    invert(inertia[0])


@compiled
def invert(A):  # type: ignore[no-untyped-def]
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
def articulated_velocity(axis, gain, compliance, root, torque, momentum, wrench, load, twist):  # type: ignore[no-untyped-def]
    """
    Fill the twists of all links under given loads.

    Parameters
    ----------
    axis, gain, compliance : ndarray
        As filled by `articulated_inertia`.
    root : ndarray, shape (6, 6)
        Inverse of the articulated inertia of the first link.
    torque : ndarray, shape (n-1, 2)
        Impulse on every joint axis [N m s].
    momentum, wrench : ndarray, shape (n, 6)
        Momentum and impulse wrench of every link; only their sum counts.
    load : ndarray, shape (n-1, 2)
        Filled with the loads of the joint axes.
    twist : ndarray, shape (n, 6)
        Filled with the twists.

    """
    w = total(momentum, wrench, len(momentum) - 1)
    for j in range(len(axis) - 1, -1, -1):
        load0 = torque[j, 0] + dot(axis, j, 0, w)
        load1 = torque[j, 1] + dot(axis, j, 1, w)
        load[j, 0], load[j, 1] = load0, load1
        f = total(momentum, wrench, j)
        w = (
            w[0] + f[0] - gain[j, 0, 0] * load0 - gain[j, 1, 0] * load1,
            w[1] + f[1] - gain[j, 0, 1] * load0 - gain[j, 1, 1] * load1,
            w[2] + f[2] - gain[j, 0, 2] * load0 - gain[j, 1, 2] * load1,
            w[3] + f[3] - gain[j, 0, 3] * load0 - gain[j, 1, 3] * load1,
            w[4] + f[4] - gain[j, 0, 4] * load0 - gain[j, 1, 4] * load1,
            w[5] + f[5] - gain[j, 0, 5] * load0 - gain[j, 1, 5] * load1,
        )
    v = (row(root, 0, w), row(root, 1, w), row(root, 2, w),
         row(root, 3, w), row(root, 4, w), row(root, 5, w))  # fmt: skip
    store(twist, 0, v)
    for j in range(len(axis)):
        c11, c12, c22 = compliance[j, 0], compliance[j, 1], compliance[j, 2]
        rate0 = c11 * load[j, 0] + c12 * load[j, 1] - dot(gain, j, 0, v)
        rate1 = c12 * load[j, 0] + c22 * load[j, 1] - dot(gain, j, 1, v)
        v = (
            v[0] + axis[j, 0, 0] * rate0 + axis[j, 1, 0] * rate1,
            v[1] + axis[j, 0, 1] * rate0 + axis[j, 1, 1] * rate1,
            v[2] + axis[j, 0, 2] * rate0 + axis[j, 1, 2] * rate1,
            v[3] + axis[j, 0, 3] * rate0 + axis[j, 1, 3] * rate1,
            v[4] + axis[j, 0, 4] * rate0 + axis[j, 1, 4] * rate1,
            v[5] + axis[j, 0, 5] * rate0 + axis[j, 1, 5] * rate1,
        )
        store(twist, j + 1, v)


@compiled
def total(a, b, i):  # type: ignore[no-untyped-def]
    """Return row i of a + b as a tuple."""
    return (
        a[i, 0] + b[i, 0],
        a[i, 1] + b[i, 1],
        a[i, 2] + b[i, 2],
        a[i, 3] + b[i, 3],
        a[i, 4] + b[i, 4],
        a[i, 5] + b[i, 5],
    )


@compiled
def dot(A, j, k, w):  # type: ignore[no-untyped-def]
    """Return A[j, k] . w."""
    return (
        (A[j, k, 0] * w[0] + A[j, k, 1] * w[1])
        + (A[j, k, 2] * w[2] + A[j, k, 3] * w[3])
        + (A[j, k, 4] * w[4] + A[j, k, 5] * w[5])
    )


@compiled
def row(A, i, w):  # type: ignore[no-untyped-def]
    """Return A[i] . w."""
    return (
        (A[i, 0] * w[0] + A[i, 1] * w[1])
        + (A[i, 2] * w[2] + A[i, 3] * w[3])
        + (A[i, 4] * w[4] + A[i, 5] * w[5])
    )


@compiled
def store(A, i, w):  # type: ignore[no-untyped-def]
    """Write the tuple w to A[i]."""
    A[i, 0], A[i, 1], A[i, 2], A[i, 3], A[i, 4], A[i, 5] = w

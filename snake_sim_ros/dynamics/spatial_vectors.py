# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Spatial vectors and matrices of fixed size, as tuples that a processor keeps in registers.

A vector has six numbers: a twist or a wrench. Each number may be a pair, one of either arm of the
chain; see `compilation.pair`. A symmetric matrix is the upper half of a 6x6 matrix, row by row.
"""

from snake_sim_ros.dynamics.compilation import inlined, Pack, Packs, pair
from snake_sim_ros.scene.parameters import Array

Three = tuple[float, float, float]
Six = tuple[float, float, float, float, float, float]
Rows = tuple[Six, Six, Six, Six, Six, Six]
Symmetric = tuple[Pack, ...]  # 21 entries


# ---- vectors ----


@inlined
def row_of(A: Array, i: int) -> Six:
    """Return A[i] as a tuple."""
    return A[i, 0], A[i, 1], A[i, 2], A[i, 3], A[i, 4], A[i, 5]


@inlined
def store(A: Array, i: int, w: Six) -> None:
    """Write the tuple w to A[i]."""
    A[i, 0], A[i, 1], A[i, 2], A[i, 3], A[i, 4], A[i, 5] = w


@inlined
def dot(a: Packs, b: Packs) -> Pack:
    """Return a . b."""
    return (a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3]) + (a[4] * b[4] + a[5] * b[5])


@inlined
def add(a: Packs, b: Packs) -> Packs:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5]


@inlined
def combine(x: Pack, a: Packs, y: Pack, b: Packs) -> Packs:
    """Return x a + y b."""
    return (
        x * a[0] + y * b[0], x * a[1] + y * b[1], x * a[2] + y * b[2],
        x * a[3] + y * b[3], x * a[4] + y * b[4], x * a[5] + y * b[5],
    )  # fmt: skip


@inlined
def scaled(x: float, a: Packs) -> Packs:
    """Return x a."""
    return x * a[0], x * a[1], x * a[2], x * a[3], x * a[4], x * a[5]


@inlined
def less(a: Packs, x: Array, b: Packs) -> Packs:
    """Return a - x b."""
    return (
        a[0] - x * b[0], a[1] - x * b[1], a[2] - x * b[2],
        a[3] - x * b[3], a[4] - x * b[4], a[5] - x * b[5],
    )  # fmt: skip


# ---- pairs of vectors ----


@inlined
def row_pair(A: Array, i: int, j: int) -> Packs:
    """Return the rows i and j of A, side by side."""
    return (
        pair(A[i, 0], A[j, 0]), pair(A[i, 1], A[j, 1]), pair(A[i, 2], A[j, 2]),
        pair(A[i, 3], A[j, 3]), pair(A[i, 4], A[j, 4]), pair(A[i, 5], A[j, 5]),
    )  # fmt: skip


@inlined
def store_pair(A: Array, i: int, j: int, w: Packs) -> None:
    """Write the first numbers of w to row i of A, the second ones to row j."""
    store(A, i, lane_of(w, 0))
    store(A, j, lane_of(w, 1))


@inlined
def lane_of(w: Packs, k: int) -> Six:
    """Return the k-th numbers of six pairs."""
    return w[0][k], w[1][k], w[2][k], w[3][k], w[4][k], w[5][k]


@inlined
def both_arms(v: Six) -> Packs:
    """Return pairs of the same numbers."""
    return (
        pair(v[0], v[0]), pair(v[1], v[1]), pair(v[2], v[2]),
        pair(v[3], v[3]), pair(v[4], v[4]), pair(v[5], v[5]),
    )  # fmt: skip


@inlined
def of_first_arm(w: Packs) -> Packs:
    """Return w with 0 for the other arm."""
    return (
        pair(w[0][0], 0.0), pair(w[1][0], 0.0), pair(w[2][0], 0.0),
        pair(w[3][0], 0.0), pair(w[4][0], 0.0), pair(w[5][0], 0.0),
    )  # fmt: skip


# ---- matrices ----


@inlined
def rows_of(A: Array) -> Rows:
    """Return the six rows of A as tuples."""
    return (
        (A[0, 0], A[0, 1], A[0, 2], A[0, 3], A[0, 4], A[0, 5]),
        (A[1, 0], A[1, 1], A[1, 2], A[1, 3], A[1, 4], A[1, 5]),
        (A[2, 0], A[2, 1], A[2, 2], A[2, 3], A[2, 4], A[2, 5]),
        (A[3, 0], A[3, 1], A[3, 2], A[3, 3], A[3, 4], A[3, 5]),
        (A[4, 0], A[4, 1], A[4, 2], A[4, 3], A[4, 4], A[4, 5]),
        (A[5, 0], A[5, 1], A[5, 2], A[5, 3], A[5, 4], A[5, 5]),
    )


@inlined
def combine_rows(s: Six, A: Rows) -> Six:
    """Return s A."""
    return add(
        add(combine(s[0], A[0], s[1], A[1]), combine(s[2], A[2], s[3], A[3])),
        combine(s[4], A[4], s[5], A[5]),
    )


@inlined
def add_reduced(A: Array, rows: Rows, x: Six, b: Six, y: Six, c: Six) -> None:
    """Add to A the matrix with the given rows, minus x b^T and y c^T."""
    for i in range(6):
        for j in range(6):
            A[i, j] += rows[i][j] - x[i] * b[j] - y[i] * c[j]


@inlined
def factor(A: Array) -> None:
    """Replace a 6x6 matrix by its factors L and U, the diagonal of U inverted (no pivoting)."""
    for k in range(6):
        A[k, k] = 1.0 / A[k, k]
        for i in range(k + 1, 6):
            A[i, k] *= A[k, k]
            for j in range(k + 1, 6):
                A[i, j] -= A[i, k] * A[k, j]


@inlined
def solve(A: Array, w: Six) -> Six:
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


# ---- symmetric matrices ----


@inlined
def symmetric_times(A: Symmetric, s: Packs) -> Packs:
    """Return A s."""
    return (
        (A[0] * s[0] + A[1] * s[1]) + (A[2] * s[2] + A[3] * s[3]) + (A[4] * s[4] + A[5] * s[5]),
        (A[1] * s[0] + A[6] * s[1]) + (A[7] * s[2] + A[8] * s[3]) + (A[9] * s[4] + A[10] * s[5]),
        (A[2] * s[0] + A[7] * s[1])
        + (A[11] * s[2] + A[12] * s[3])
        + (A[13] * s[4] + A[14] * s[5]),
        (A[3] * s[0] + A[8] * s[1])
        + (A[12] * s[2] + A[15] * s[3])
        + (A[16] * s[4] + A[17] * s[5]),
        (A[4] * s[0] + A[9] * s[1])
        + (A[13] * s[2] + A[16] * s[3])
        + (A[18] * s[4] + A[19] * s[5]),
        (A[5] * s[0] + A[10] * s[1])
        + (A[14] * s[2] + A[17] * s[3])
        + (A[19] * s[4] + A[20] * s[5]),
    )


@inlined
def reduced(A: Symmetric, x: Packs, a: Packs, y: Packs, b: Packs) -> Symmetric:
    """Return ``A - x a^T - y b^T``, which is symmetric."""
    return (
        A[0] - x[0] * a[0] - y[0] * b[0], A[1] - x[0] * a[1] - y[0] * b[1],
        A[2] - x[0] * a[2] - y[0] * b[2],
        A[3] - x[0] * a[3] - y[0] * b[3], A[4] - x[0] * a[4] - y[0] * b[4],
        A[5] - x[0] * a[5] - y[0] * b[5],
        A[6] - x[1] * a[1] - y[1] * b[1], A[7] - x[1] * a[2] - y[1] * b[2],
        A[8] - x[1] * a[3] - y[1] * b[3],
        A[9] - x[1] * a[4] - y[1] * b[4], A[10] - x[1] * a[5] - y[1] * b[5],
        A[11] - x[2] * a[2] - y[2] * b[2],
        A[12] - x[2] * a[3] - y[2] * b[3], A[13] - x[2] * a[4] - y[2] * b[4],
        A[14] - x[2] * a[5] - y[2] * b[5],
        A[15] - x[3] * a[3] - y[3] * b[3], A[16] - x[3] * a[4] - y[3] * b[4],
        A[17] - x[3] * a[5] - y[3] * b[5],
        A[18] - x[4] * a[4] - y[4] * b[4], A[19] - x[4] * a[5] - y[4] * b[5],
        A[20] - x[5] * a[5] - y[5] * b[5],
    )  # fmt: skip


@inlined
def add_links(A: Symmetric, bare: Array, other: Array) -> Symmetric:
    """Return A plus the inertias of two links; entries of the upper half, row by row."""
    return (
        A[0] + pair(bare[0, 0], other[0, 0]), A[1] + pair(bare[0, 1], other[0, 1]),
        A[2] + pair(bare[0, 2], other[0, 2]), A[3] + pair(bare[0, 3], other[0, 3]),
        A[4] + pair(bare[0, 4], other[0, 4]), A[5] + pair(bare[0, 5], other[0, 5]),
        A[6] + pair(bare[1, 1], other[1, 1]), A[7] + pair(bare[1, 2], other[1, 2]),
        A[8] + pair(bare[1, 3], other[1, 3]), A[9] + pair(bare[1, 4], other[1, 4]),
        A[10] + pair(bare[1, 5], other[1, 5]), A[11] + pair(bare[2, 2], other[2, 2]),
        A[12] + pair(bare[2, 3], other[2, 3]), A[13] + pair(bare[2, 4], other[2, 4]),
        A[14] + pair(bare[2, 5], other[2, 5]), A[15] + pair(bare[3, 3], other[3, 3]),
        A[16] + pair(bare[3, 4], other[3, 4]), A[17] + pair(bare[3, 5], other[3, 5]),
        A[18] + pair(bare[4, 4], other[4, 4]), A[19] + pair(bare[4, 5], other[4, 5]),
        A[20] + pair(bare[5, 5], other[5, 5]),
    )  # fmt: skip


@inlined
def inertia_of_first_arm(A: Symmetric) -> Symmetric:
    """Return A with 0 for the other arm."""
    return (
        pair(A[0][0], 0.0), pair(A[1][0], 0.0), pair(A[2][0], 0.0), pair(A[3][0], 0.0),
        pair(A[4][0], 0.0), pair(A[5][0], 0.0), pair(A[6][0], 0.0), pair(A[7][0], 0.0),
        pair(A[8][0], 0.0), pair(A[9][0], 0.0), pair(A[10][0], 0.0), pair(A[11][0], 0.0),
        pair(A[12][0], 0.0), pair(A[13][0], 0.0), pair(A[14][0], 0.0), pair(A[15][0], 0.0),
        pair(A[16][0], 0.0), pair(A[17][0], 0.0), pair(A[18][0], 0.0), pair(A[19][0], 0.0),
        pair(A[20][0], 0.0),
    )  # fmt: skip

"""An orthonormal basis of the null space, by Householder reflections with column pivoting."""

import numpy as np

from engine.arrays import Array
from engine.jit import inner, kernel

RANK = 1e-10  # share of the largest column: if all remaining columns are smaller, they are rounding errors
WORN = 1e-6  # share of a computed square: once subtractions leave less than this, it is computed again


def null_space(rows: Array) -> Array:
    """Return an orthonormal basis, (n, n - rank), of all x with rows x = 0; the squares of the rows must be finite.

    Its bits do not depend on the number of cores, unlike those of LAPACK's.
    """
    left = np.array(rows, float)  # C order: each row is a column of the matrix whose range is removed
    pivot, squares = np.zeros(len(left)), np.zeros((2, len(left)))
    rank = _reflect(left, pivot, squares)
    basis = np.zeros((left.shape[1] - rank, left.shape[1]))
    _complement(left, pivot, rank, basis)
    return np.ascontiguousarray(basis.T)


@kernel
def _reflect(rows, pivot, squares):
    """Overwrite the rows with the vectors of reflections I - v v' that map their range to the first axes; return rank.

    The vector v of reflection k has the entries ``pivot[k]`` and ``rows[k, k + 1 :]`` and does not affect the axes
    before k. ``squares`` holds the squares of the remaining lengths, and their values when they were last computed
    exactly.
    """
    (m, n), (left, measured) = rows.shape, squares
    largest = 0.0
    for i in range(m):
        left[i] = measured[i] = _dot(rows[i], rows[i], 0)
    for k in range(min(m, n)):
        where = k
        for i in range(k + 1, m):
            if left[i] > left[where]:
                where = i
        for j in range(n):
            rows[k, j], rows[where, j] = rows[where, j], rows[k, j]
        left[where], measured[where] = left[k], measured[k]
        length = np.sqrt(_dot(rows[k], rows[k], k))
        largest = max(largest, length)
        if not length > RANK * largest:
            return k
        head = rows[k, k] + length if rows[k, k] >= 0.0 else rows[k, k] - length
        scale = 1 / np.sqrt(abs(head) * length)  # v . v = 2
        for j in range(k + 1, n):
            rows[k, j] *= scale
        pivot[k] = head * scale
        for i in range(k + 1, m):
            _mirror(rows[k], pivot[k], k, rows[i])
            left[i] -= rows[i, k] * rows[i, k]
            if not left[i] > WORN * measured[i]:
                left[i] = measured[i] = _dot(rows[i], rows[i], k + 1)
    return min(m, n)


@kernel
def _complement(rows, pivot, rank, basis):
    """Write the images of the axes after the range, applying the reflections from the last to the first."""
    for i in range(basis.shape[0]):
        basis[i, rank + i] = 1.0
        for k in range(rank - 1, -1, -1):
            _mirror(rows[k], pivot[k], k, basis[i])


@inner
def _mirror(v, head, k, x):
    """Reflect x from its entry k on."""
    share = head * x[k] + _dot(v, x, k + 1)
    x[k] -= share * head
    for j in range(k + 1, x.shape[0]):
        x[j] -= share * v[j]


@inner
def _dot(a, b, first):
    """Return the scalar product of two vectors from an entry on, as four sums that a processor computes at once."""
    s0, s1, s2, s3, n, j = 0.0, 0.0, 0.0, 0.0, a.shape[0], first
    while j + 3 < n:
        s0 += a[j] * b[j]
        s1 += a[j + 1] * b[j + 1]
        s2 += a[j + 2] * b[j + 2]
        s3 += a[j + 3] * b[j + 3]
        j += 4
    while j < n:
        s0 += a[j] * b[j]
        j += 1
    return (s0 + s1) + (s2 + s3)

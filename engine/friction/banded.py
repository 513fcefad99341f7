"""Systems of the bodies' velocities, stored by their band: assembly from blocks, factors without pivoting, solution.

Row i of a system lies in ``K[i]``, its column j at ``K[i, middle + j - i]``, ``middle = (K.shape[1] - 1) // 2``. A band
is stored two wider than the contacts ask for: three rows are eliminated at a time, and the first of them is read as far
as the last. All systems here have a positive definite symmetric part, which is what spares the pivoting.
"""

from engine.kernels.jit import inner

BODY = 6  # velocities of a body
ROWS_AT_ONCE = 3


@inner
def start_system(n, K):
    """Write the identity: the mass matrix of whitened velocities."""
    middle = (K.shape[1] - 1) // 2
    for i in range(n):
        for j in range(K.shape[1]):
            K[i, j] = 0.0
        K[i, middle] = 1.0


@inner
def add_block(rows, i, A, AG, K):
    """Add G_i' A G_i to the system, for the 3 x 3 block A of contact i.

    Runs of a body are of known size, which the compiler turns into straight code: a third of the time.
    """
    runs, a, middle = rows.width.shape[1], 0, (K.shape[1] - 1) // 2
    g0, g1, g2, h0, h1, h2 = rows.G[i, 0], rows.G[i, 1], rows.G[i, 2], AG[0], AG[1], AG[2]
    a00, a01, a02 = A[i, 0, 0], A[i, 0, 1], A[i, 0, 2]
    a10, a11, a12 = A[i, 1, 0], A[i, 1, 1], A[i, 1, 2]
    a20, a21, a22 = A[i, 2, 0], A[i, 2, 1], A[i, 2, 2]
    for j in range(g0.shape[0]):
        h0[j] = a00 * g0[j] + a01 * g1[j] + a02 * g2[j]
        h1[j] = a10 * g0[j] + a11 * g1[j] + a12 * g2[j]
        h2[j] = a20 * g0[j] + a21 * g1[j] + a22 * g2[j]
    for run in range(runs):
        row, m, c = rows.start[i, run], rows.width[i, run], 0
        for other in range(runs):
            n = rows.width[i, other]
            first = middle + rows.start[i, other] - row
            e0, e1, e2 = h0[c:], h1[c:], h2[c:]
            for j in range(m):
                line, f0, f1, f2 = K[row + j, first - j :], g0[a + j], g1[a + j], g2[a + j]
                if n == BODY:
                    for k in range(BODY):
                        line[k] += f0 * e0[k] + f1 * e1[k] + f2 * e2[k]
                else:
                    for k in range(n):
                        line[k] += f0 * e0[k] + f1 * e1[k] + f2 * e2[k]
            c += n
        a += m


@inner
def factorise(n, K):
    """Replace K by its factors L U; the diagonal holds the inverses of the pivots."""
    middle = (K.shape[1] - 1) // 2
    last = middle + 1  # of the columns that a pivot's row can reach, and one more
    whole = n - n % ROWS_AT_ONCE
    for k in range(0, whole, ROWS_AT_ONCE):
        a, b, c = K[k, middle:], K[k + 1, middle - 1 :], K[k + 2, middle - 2 :]  # all from column k on
        a[0] = 1 / a[0]
        b[0] *= a[0]
        for j in range(1, last):
            b[j] -= b[0] * a[j]
        b[1] = 1 / b[1]
        c[0] *= a[0]
        c[1] = (c[1] - c[0] * a[1]) * b[1]
        for j in range(2, last):
            c[j] -= c[0] * a[j] + c[1] * b[j]
        c[2] = 1 / c[2]
        for i in range(k + 3, min(k + last, n)):
            row = K[i, middle + k - i :]
            if row[0] != 0.0 or row[1] != 0.0 or row[2] != 0.0:
                f = row[0] * a[0]
                g = (row[1] - f * a[1]) * b[1]
                h = (row[2] - f * a[2] - g * b[2]) * c[2]
                row[0], row[1], row[2] = f, g, h
                for j in range(3, last):
                    row[j] -= f * a[j] + g * b[j] + h * c[j]
    for k in range(whole, n):
        a = K[k, middle:]
        a[0] = 1 / a[0]
        for i in range(k + 1, n):
            row = K[i, middle + k - i :]
            row[0] *= a[0]
            for j in range(1, n - k):
                row[j] -= row[0] * a[j]


@inner
def substitute(n, K, x):
    """Solve L U x = x in place, for factors from `factorise`."""
    middle = (K.shape[1] - 1) // 2
    band = middle - ROWS_AT_ONCE + 1
    for i in range(n):
        reach = min(band, i)
        x[i] -= _dot(reach, K[i, middle - reach :], x[i - reach :])
    for i in range(n - 1, -1, -1):
        x[i] = (x[i] - _dot(min(band, n - 1 - i), K[i, middle + 1 :], x[i + 1 :])) * K[i, middle]


@inner
def _dot(n, a, b):
    """Return the sum of a[k] b[k]: four sums at a time, or each addition waits for the last."""
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    whole = n - n % 4
    for k in range(0, whole, 4):
        s0 += a[k] * b[k]
        s1 += a[k + 1] * b[k + 1]
        s2 += a[k + 2] * b[k + 2]
        s3 += a[k + 3] * b[k + 3]
    for k in range(whole, n):
        s0 += a[k] * b[k]
    return (s0 + s1) + (s2 + s3)

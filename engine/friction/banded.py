"""Systems of the bodies' velocities, stored by their band: assembly from blocks, factors without pivoting, solution.

Row i of a system lies in ``K[i]``, its column j at ``K[i, middle + j - i]``, ``middle = (K.shape[1] - 1) // 2``. A band
is stored two wider than the contacts need: three rows are eliminated at a time, and the first of them is read as far as
the last. The symmetric part of all systems here is positive definite: no pivoting is needed.
"""

from engine.jit import inner

BODY = 6  # velocities of a body
PAIR = 2 * BODY
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
def add_blocks(nc, rows, mu, A, block, K):
    """Add G_i' A_i G_i to the system, for the first ``nc`` contacts' 3 x 3 blocks A; A_NN = 0 means no block.

    Successive contacts between the same two bodies are summed in ``block`` first. The compiler knows its size, which
    makes the code four times as fast.
    """
    if rows.width.shape[1] != 2 or rows.G.shape[2] != PAIR:
        for i in range(nc):
            if A[i, 0, 0] != 0.0:
                _add_block(rows, i, A, block, K)
        return
    last = -1
    for i in range(nc + 1):
        if i < nc and A[i, 0, 0] == 0.0:
            continue
        if i == nc or last < 0 or not _same_bodies(rows, i, last):
            if last >= 0:
                _spread(rows, last, block, K)
            for k in range(PAIR * PAIR):
                block[k] = 0.0
        if i < nc:
            _sum_up(rows.G[i], A[i], mu[i] == 0.0, block)
            last = i


@inner
def _same_bodies(rows, i, j):
    """Return whether contacts i and j touch the same runs."""
    for run in range(rows.width.shape[1]):
        if rows.start[i, run] != rows.start[j, run] or rows.width[i, run] != rows.width[j, run]:
            return False
    return True


@inner
def _sum_up(G, A, smooth, block):
    """Add G' A G to the first PAIR^2 numbers of ``block``; A G lies behind them. Only A_NN counts if ``smooth``."""
    g0, g1, g2 = G[0], G[1], G[2]
    a00, a01, a02 = A[0, 0], A[0, 1], A[0, 2]
    if smooth:
        for k in range(PAIR):
            block[PAIR * PAIR + k] = a00 * g0[k]
        for j in range(PAIR):
            f0 = g0[j]
            for k in range(PAIR):
                block[PAIR * j + k] += f0 * block[PAIR * PAIR + k]
        return
    a10, a11, a12 = A[1, 0], A[1, 1], A[1, 2]
    a20, a21, a22 = A[2, 0], A[2, 1], A[2, 2]
    for k in range(PAIR):
        x, y, z = g0[k], g1[k], g2[k]
        block[PAIR * PAIR + k] = a00 * x + a01 * y + a02 * z
        block[PAIR * (PAIR + 1) + k] = a10 * x + a11 * y + a12 * z
        block[PAIR * (PAIR + 2) + k] = a20 * x + a21 * y + a22 * z
    for j in range(PAIR):
        f0, f1, f2 = g0[j], g1[j], g2[j]
        for k in range(PAIR):
            block[PAIR * j + k] += (
                f0 * block[PAIR * PAIR + k] + f1 * block[PAIR * (PAIR + 1) + k] + f2 * block[PAIR * (PAIR + 2) + k]
            )


@inner
def _spread(rows, i, block, K):
    """Add the sum over the contacts between contact i's bodies to the system."""
    a, middle = 0, (K.shape[1] - 1) // 2
    for run in range(2):
        row, m, c = rows.start[i, run], rows.width[i, run], 0
        for other in range(2):
            first, n = middle + rows.start[i, other] - row, rows.width[i, other]
            for j in range(m):
                line, part = K[row + j, first - j :], block[PAIR * (a + j) + c :]
                if n == BODY:
                    for k in range(BODY):
                        line[k] += part[k]
                else:
                    for k in range(n):
                        line[k] += part[k]
            c += n
        a += m


@inner
def _add_block(rows, i, A, block, K):
    """Add G_i' A_i G_i to the system, for any number of runs of any width."""
    runs, a, middle = rows.width.shape[1], 0, (K.shape[1] - 1) // 2
    for run in range(runs):
        row = rows.start[i, run]
        for j in range(rows.width[i, run]):
            for k in range(3):
                block[k] = 0.0
                for m in range(3):
                    block[k] += rows.G[i, m, a + j] * A[i, m, k]
            c = 0
            for other in range(runs):
                line = K[row + j, middle + rows.start[i, other] - row - j :]
                for k in range(rows.width[i, other]):
                    line[k] += (
                        block[0] * rows.G[i, 0, c + k] + block[1] * rows.G[i, 1, c + k] + block[2] * rows.G[i, 2, c + k]
                    )
                c += rows.width[i, other]
        a += rows.width[i, run]


@inner
def factorise(n, K):
    """Replace K by its factors L U; the diagonal holds the inverses of the pivots."""
    middle = (K.shape[1] - 1) // 2
    last = middle + 1  # one more than the columns that a pivot's row can reach
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
    """Return the sum of a[k] b[k]: four sums at a time, so that no addition waits for the last one."""
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

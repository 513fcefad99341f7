"""Systems in the bodies' velocities in 6 x 6 blocks: assembly from contacts, factorisation without pivoting, solution.

The unknowns are grouped in nodes of six: the velocities of a body, or the multipliers of up to six bilateral rows.
Blocks exist only for pairs of nodes with a contact or a row between them, and where elimination creates fill-in, which
is known beforehand (`engine.friction.elimination`). Nodes are numbered in the order of elimination. Node a's diagonal
block is piece a of ``K``; the pair of a and a later node b has two pieces: the block right of the diagonal, K_ab, and
the transpose of the one below it, K_ba'. In both, rows belong to a's unknowns and columns to b's. A row of a piece is
eight numbers, the last two of them 0, and so is a node's part of a vector, so that it fits a register of the processor.

The symmetric part of all systems here is positive definite, so no pivoting is needed.
"""

from typing import NamedTuple

import numpy as np

from engine.jit import by_address, inner
from engine.jit.lanes import LANES, fused, read, spread, total, write

BODY = 6  # velocities per body
ROW = LANES
PIECE = BODY * ROW


@by_address
class Elimination(NamedTuple):
    """The blocks of a system and their order of elimination; see `engine.friction.elimination`."""

    first: np.ndarray  # (nodes + 1,) int64, index of each node's first pair
    pair: np.ndarray  # (pairs,) int64, the first of each pair's two pieces
    later: np.ndarray  # (pairs,) int64, the pair's other node, ascending for each node
    begin: np.ndarray  # (nodes,) int64, index of each node's first target
    target: np.ndarray  # (targets,) int64, first piece between the later nodes of every two pairs of a node


@inner
def clear(a):
    """Write zeros to an array whose length is a multiple of eight."""
    for k in range(0, a.shape[0], LANES):
        write(spread(0.0), a, k)


@inner
def start_system(system, K):
    """Write the identity: the mass matrix of whitened velocities."""
    clear(K)
    for node in range(system.begin.shape[0]):
        for k in range(BODY):
            K[PIECE * node + (ROW + 1) * k] = 1.0


@inner
def add_contact(rows, i, A, smooth, K):
    """Add G_i' A_i G_i to the system for contact i, with A_i in column i of ``A``; only A_NN is used if ``smooth``."""
    G = rows.G[i]
    for s in range(rows.node.shape[1]):
        node = rows.node[i, s]
        if node < 0:
            continue
        if smooth:
            _add_outer(G[0], ROW * s, A[0, i] * read(G[0], ROW * s), K, PIECE * node)
        else:
            _add_diagonal(G, ROW * s, i, A, K, PIECE * node)
        for t in range(rows.node.shape[1]):
            if rows.node[i, t] > node:
                pair = PIECE * rows.pair[i, s, t]
                if smooth:
                    y = A[0, i] * read(G[0], ROW * t)
                    _add_outer(G[0], ROW * s, y, K, pair)
                    _add_outer(G[0], ROW * s, y, K, pair + PIECE)
                else:
                    _add_pair(G, ROW * s, ROW * t, i, A, K, pair)


@inner
def _add_outer(g, s, y, K, at):
    """Add g_s y' to a piece."""
    for k in range(BODY):
        write(fused(g[s + k], y, read(K, at + ROW * k)), K, at + ROW * k)


@inner
def _add_diagonal(G, s, i, A, K, at):
    """Add G_s' A_i G_s to a diagonal piece."""
    g0, g1, g2 = G[0], G[1], G[2]
    h0, h1, h2 = read(g0, s), read(g1, s), read(g2, s)
    y0 = fused(A[0, i], h0, fused(A[1, i], h1, A[2, i] * h2))
    y1 = fused(A[3, i], h0, fused(A[4, i], h1, A[5, i] * h2))
    y2 = fused(A[6, i], h0, fused(A[7, i], h1, A[8, i] * h2))
    for k in range(BODY):
        row = fused(g0[s + k], y0, fused(g1[s + k], y1, fused(g2[s + k], y2, read(K, at + ROW * k))))
        write(row, K, at + ROW * k)


@inner
def _add_pair(G, s, t, i, A, K, at):
    """Add G_s' A_i G_t to the right piece of a pair, and G_s' A_i' G_t to its transposed piece below the diagonal."""
    g0, g1, g2 = G[0], G[1], G[2]
    h0, h1, h2 = read(g0, t), read(g1, t), read(g2, t)
    y0 = fused(A[0, i], h0, fused(A[1, i], h1, A[2, i] * h2))
    y1 = fused(A[3, i], h0, fused(A[4, i], h1, A[5, i] * h2))
    y2 = fused(A[6, i], h0, fused(A[7, i], h1, A[8, i] * h2))
    z0 = fused(A[0, i], h0, fused(A[3, i], h1, A[6, i] * h2))
    z1 = fused(A[1, i], h0, fused(A[4, i], h1, A[7, i] * h2))
    z2 = fused(A[2, i], h0, fused(A[5, i], h1, A[8, i] * h2))
    for k in range(BODY):
        f0, f1, f2, right, below = g0[s + k], g1[s + k], g2[s + k], at + ROW * k, at + PIECE + ROW * k
        write(fused(f0, y0, fused(f1, y1, fused(f2, y2, read(K, right)))), K, right)
        write(fused(f0, z0, fused(f1, z1, fused(f2, z2, read(K, below)))), K, below)


@inner
def factorise(system, K, F):
    """Replace K by its factors.

    Diagonal piece k becomes L_k U_k: U_k in place, the multipliers of L_k and the inverse diagonal of U_k in ``F``,
    transposed. K_kb becomes L_k^-1 K_kb and K_bk' becomes U_k'^-1 K_bk', so that K_bc is reduced by K_bk K_kc.
    """
    for k in range(system.begin.shape[0]):
        eliminate_node(system, K, F, k)


@inner
def eliminate_node(system, K, F, k):
    """Eliminate node k, the next one of `factorise`."""
    at, target = PIECE * k, system.begin[k]
    _factorise_diagonal(K, F, at)
    for e in range(system.first[k], system.first[k + 1]):
        _eliminate_pair(K, F, at, PIECE * system.pair[e])
    for e in range(system.first[k], system.first[k + 1]):
        right = PIECE * system.pair[e]
        below = right + PIECE
        _subtract_product(K, PIECE * system.later[e], below, right)
        for f in range(e + 1, system.first[k + 1]):
            pair, other = PIECE * system.target[target], PIECE * system.pair[f]
            target += 1
            _subtract_product(K, pair, below, other)
            _subtract_product(K, pair + PIECE, right, other + PIECE)


@inner
def _factorise_diagonal(K, F, at):
    """Eliminate the unknowns of one node within its diagonal piece; the remaining diagonal is not used afterwards."""
    for k in range(BODY):
        pivot, inverse = read(K, at + ROW * k), 1 / K[at + (ROW + 1) * k]
        F[at + (ROW + 1) * k] = inverse
        for i in range(k + 1, BODY):
            f = K[at + ROW * i + k] * inverse
            F[at + ROW * k + i] = f
            write(fused(-f, pivot, read(K, at + ROW * i)), K, at + ROW * i)


@inner
def _eliminate_pair(K, F, at, pair):
    """Apply the node's factors to the pieces of a pair: L^-1 to the right one, U'^-1 to the transposed one below."""
    # written out: entry (r, c) of a piece is at 8 r + c, and F holds L transposed, so L_10 is F[at + 1]
    y0 = read(K, pair)
    y1 = read(K, pair + 8) - F[at + 1] * y0
    y2 = read(K, pair + 16) - F[at + 2] * y0 - F[at + 10] * y1
    y3 = read(K, pair + 24) - F[at + 3] * y0 - F[at + 11] * y1 - F[at + 19] * y2
    y4 = read(K, pair + 32) - F[at + 4] * y0 - F[at + 12] * y1 - F[at + 20] * y2 - F[at + 28] * y3
    y5 = read(K, pair + 40) - F[at + 5] * y0 - F[at + 13] * y1 - F[at + 21] * y2 - F[at + 29] * y3 - F[at + 37] * y4
    write(y1, K, pair + 8)
    write(y2, K, pair + 16)
    write(y3, K, pair + 24)
    write(y4, K, pair + 32)
    write(y5, K, pair + 40)
    below = pair + PIECE
    x0 = read(K, below) * F[at]
    x1 = (read(K, below + 8) - K[at + 1] * x0) * F[at + 9]
    x2 = (read(K, below + 16) - K[at + 2] * x0 - K[at + 10] * x1) * F[at + 18]
    x3 = (read(K, below + 24) - K[at + 3] * x0 - K[at + 11] * x1 - K[at + 19] * x2) * F[at + 27]
    x4 = read(K, below + 32) - K[at + 4] * x0 - K[at + 12] * x1 - K[at + 20] * x2 - K[at + 28] * x3
    x4 = x4 * F[at + 36]
    x5 = read(K, below + 40) - K[at + 5] * x0 - K[at + 13] * x1 - K[at + 21] * x2 - K[at + 29] * x3 - K[at + 37] * x4
    x5 = x5 * F[at + 45]
    write(x0, K, below)
    write(x1, K, below + 8)
    write(x2, K, below + 16)
    write(x3, K, below + 24)
    write(x4, K, below + 32)
    write(x5, K, below + 40)


@inner
def _subtract_product(K, target, left, right):
    """Subtract left' right from a piece."""
    r0, r1, r2 = read(K, right), read(K, right + 8), read(K, right + 16)
    r3, r4, r5 = read(K, right + 24), read(K, right + 32), read(K, right + 40)
    for k in range(BODY):
        a = left + k
        even = fused(K[a], r0, fused(K[a + 16], r2, K[a + 32] * r4))
        odd = fused(K[a + 8], r1, fused(K[a + 24], r3, K[a + 40] * r5))
        write(read(K, target + ROW * k) - (even + odd), K, target + ROW * k)


@inner
def substitute(system, K, F, x):
    """Solve K x = x in place, with the factors from `factorise`."""
    nodes = system.begin.shape[0]
    for node in range(nodes):
        k, at = ROW * node, PIECE * node
        z0 = x[k]
        z1 = x[k + 1] - F[at + 1] * z0
        z2 = x[k + 2] - F[at + 2] * z0 - F[at + 10] * z1
        z3 = x[k + 3] - F[at + 3] * z0 - F[at + 11] * z1 - F[at + 19] * z2
        z4 = x[k + 4] - F[at + 4] * z0 - F[at + 12] * z1 - F[at + 20] * z2 - F[at + 28] * z3
        z5 = x[k + 5] - F[at + 5] * z0 - F[at + 13] * z1 - F[at + 21] * z2 - F[at + 29] * z3 - F[at + 37] * z4
        x[k + 1], x[k + 2], x[k + 3], x[k + 4], x[k + 5] = z1, z2, z3, z4, z5
        for e in range(system.first[node], system.first[node + 1]):
            below, j = PIECE * (system.pair[e] + 1), ROW * system.later[e]
            even = fused(z0, read(K, below), fused(z2, read(K, below + 16), z4 * read(K, below + 32)))
            odd = fused(z1, read(K, below + 8), fused(z3, read(K, below + 24), z5 * read(K, below + 40)))
            write(read(x, j) - (even + odd), x, j)
    for node in range(nodes - 1, -1, -1):
        k, at = ROW * node, PIECE * node
        s0, s1, s2, s3, s4, s5 = spread(0.0), spread(0.0), spread(0.0), spread(0.0), spread(0.0), spread(0.0)
        for e in range(system.first[node], system.first[node + 1]):
            right, y = PIECE * system.pair[e], read(x, ROW * system.later[e])
            s0 = fused(read(K, right), y, s0)
            s1 = fused(read(K, right + 8), y, s1)
            s2 = fused(read(K, right + 16), y, s2)
            s3 = fused(read(K, right + 24), y, s3)
            s4 = fused(read(K, right + 32), y, s4)
            s5 = fused(read(K, right + 40), y, s5)
        x5 = (x[k + 5] - total(s5)) * F[at + 45]
        x4 = (x[k + 4] - total(s4) - K[at + 37] * x5) * F[at + 36]
        x3 = (x[k + 3] - total(s3) - K[at + 28] * x4 - K[at + 29] * x5) * F[at + 27]
        x2 = (x[k + 2] - total(s2) - K[at + 19] * x3 - K[at + 20] * x4 - K[at + 21] * x5) * F[at + 18]
        x1 = x[k + 1] - total(s1) - K[at + 10] * x2 - K[at + 11] * x3 - K[at + 12] * x4 - K[at + 13] * x5
        x1 *= F[at + 9]
        x0 = x[k] - total(s0) - K[at + 1] * x1 - K[at + 2] * x2 - K[at + 3] * x3 - K[at + 4] * x4 - K[at + 5] * x5
        x[k], x[k + 1], x[k + 2], x[k + 3], x[k + 4], x[k + 5] = x0 * F[at], x1, x2, x3, x4, x5

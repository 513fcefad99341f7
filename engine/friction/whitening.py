"""Convert mass matrix and contact rows to whitened rows stored node by node: G = H L^-T with M = L L'.

Row i of L is stored and used from its first nonzero entry on, which is that of M. Where M is block diagonal by bodies,
so is L, and G has entries only where H has.
"""

import numpy as np

from engine.friction.blocks import BODY, ROW
from engine.jit import kernel


@kernel
def factorise_mass(M, L, first):
    """Write the Cholesky factor of M with its diagonal inverted; return False if M is not positive definite.

    Only the lower halves of M and L, (n, n), are used. ``first``, (n,) int64, receives the column of each row's first
    entry, from which on the row of L is written.
    """
    for i in range(M.shape[0]):
        begin = 0
        while begin < i and M[i, begin] == 0.0:
            begin += 1
        first[i] = begin
        for j in range(begin, i):
            s = M[i, j]
            for k in range(max(begin, first[j]), j):
                s -= L[i, k] * L[j, k]
            L[i, j] = s * L[j, j]
        s = M[i, i]
        for k in range(begin, i):
            s -= L[i, k] * L[i, k]
        if not s > 0.0:
            return False
        L[i, i] = 1 / np.sqrt(s)
    return True


@kernel
def whiten_rows(H, L, first, G, touched, neighbours):
    """Write G = H L^-T, the nodes of each contact and the nodes that share contacts; return the most nodes of one.

    H and G have shape (3 nc, n); ``touched``, (nc, nodes), and ``neighbours``, (nodes, nodes), must be False on entry.
    For ``L`` and ``first`` see `factorise_mass`.
    """
    most = 0
    for i in range(touched.shape[0]):
        for row in range(3 * i, 3 * i + 3):
            for j in range(H.shape[1]):
                s = H[row, j]
                for k in range(first[j], j):
                    s -= L[j, k] * G[row, k]
                G[row, j] = s * L[j, j]
                if s != 0.0:
                    touched[i, j // BODY] = True
        count = 0
        for a in range(touched.shape[1]):
            if touched[i, a]:
                count += 1
                for b in range(a):
                    if touched[i, b]:
                        neighbours[a, b] = neighbours[b, a] = True
        most = max(most, count)
    return most


@kernel
def place_rows(G, touched, number, piece, rows):
    """Write the whitened rows G, (3 nc, n), node by node.

    ``number``, (nodes,), and ``piece``, (nodes, nodes), are those of `elimination.eliminate_nodes`; ``rows`` must
    contain no nodes (-1) and zeros on entry.
    """
    for i in range(touched.shape[0]):
        run = 0
        for a in range(touched.shape[1]):
            if touched[i, a]:
                rows.node[i, run] = number[a]
                for other in range(run):
                    pair = piece[number[a], rows.node[i, other]]
                    rows.pair[i, run, other] = rows.pair[i, other, run] = pair
                for k in range(3):
                    for j in range(min(BODY, G.shape[1] - BODY * a)):
                        rows.G[i, k, ROW * run + j] = G[3 * i + k, BODY * a + j]
                run += 1


@kernel
def unwhiten(w, number, L, first, v):
    """Write the velocities v = L^-T w; ``w`` is stored node by node in the order of elimination."""
    n = v.shape[0]
    for j in range(n):
        v[j] = w[ROW * number[j // BODY] + j % BODY]
    for j in range(n - 1, -1, -1):
        v[j] *= L[j, j]
        for k in range(first[j], j):
            v[k] -= L[j, k] * v[j]

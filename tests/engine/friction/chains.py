"""Bodies tied to each other by ideal joints, as arrays of the solver and as dense matrices."""

import numpy as np

from engine.friction import arrays
from engine.friction.arrays import FrictionArrays, friction_arrays
from engine.friction.blocks import BODY, ROW
from engine.friction.elimination import eliminate_nodes


def tied_bodies(
    seed: int, links: int, joint: int = 5, contacts: int = 0, tree: bool = False, redundant: bool = False
) -> tuple[FrictionArrays, int]:
    """Tie each body to the one before by ``joint`` rows, the first to the ground; in a ``tree`` to one of three.

    ``redundant``: every joint's first row comes twice, at another length. Returns the arrays, with no load yet, and the
    number of unknowns.
    """
    rng = np.random.default_rng(seed)
    rows, reach = joint + redundant, 3 if tree else 1
    rows_of, ends = [], []
    for body in range(links):
        before = body - int(rng.integers(1, reach + 1))
        J = rng.standard_normal((rows, 12)) * np.exp(rng.uniform(-2, 2, (rows, 1)))
        if redundant:
            J[-1] = -3 * J[0]
        rows_of.append((body, before, J))
    for _ in range(contacts):
        a = int(rng.integers(0, links))
        ends.append((a, a - int(rng.integers(1, reach + 1))))
    neighbours = np.zeros((2 * links, 2 * links), bool)  # the bodies, then the multipliers of their ties
    for a, b in [*ends, *((links + a, a) for a in range(links)), *((links + a, b) for a, b, _ in rows_of)]:
        if b >= 0:
            neighbours[a, b] = neighbours[b, a] = True
    system, number, piece = eliminate_nodes(neighbours, np.arange(2 * links) >= links)
    p = friction_arrays(system, contacts, bilateral=links * rows)
    for body, before, J in rows_of:
        for k in range(rows):
            i, node = body * rows + k, number[links + body]
            p.bilateral.at[i] = ROW * node + k
            p.bilateral.owner[ROW * node + k] = i
            for side, other in enumerate((body, before)):
                if other >= 0:
                    p.bilateral.node[i, side], p.bilateral.pair[i, side] = number[other], piece[number[other], node]
                    p.bilateral.J[i, ROW * side : ROW * side + BODY] = J[k, BODY * side : BODY * side + BODY]
    for c, (a, b) in enumerate(ends):
        p.rows.node[c, 0] = number[a]
        if b >= 0:
            p.rows.node[c, 1] = number[b]
            p.rows.pair[c, 0, 1] = p.rows.pair[c, 1, 0] = piece[number[a], number[b]]
        G = rng.standard_normal((3, 12))
        p.rows.G[c].reshape(3, 2, ROW)[:, : 1 + (b >= 0), :BODY] = G.reshape(3, 2, BODY)[:, : 1 + (b >= 0)]
    p.mu[:] = rng.uniform(0.1, 0.8, contacts)
    return p, p.w.size


def dense_rows(p: FrictionArrays, n: int) -> np.ndarray:
    """Return the contacts' rows G as a dense matrix of shape (3 nc, n)."""
    return arrays.dense_rows(p.rows.node, p.rows.G, n).reshape(-1, n)


def dense_bilateral(p: FrictionArrays, n: int) -> np.ndarray:
    """Return the bilateral rows J as a dense matrix of shape (nt, n)."""
    return arrays.dense_rows(p.bilateral.node, p.bilateral.J[:, None], n)[:, 0]

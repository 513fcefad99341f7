"""Bodies tied to each other by ideal joints, as arrays of the solver and as dense matrices."""

import numpy as np

from engine.friction.arrays import FrictionArrays, friction_arrays


def tied_bodies(
    seed: int, links: int, joint: int = 5, contacts: int = 0, tree: bool = False, redundant: bool = False
) -> tuple[FrictionArrays, int]:
    """Tie each body to the one before by ``joint`` rows, the first to the ground; in a ``tree`` to one of three.

    Each body's 6 velocities are followed by the multipliers of its rows. ``redundant``: every joint's first row comes
    twice, at another length. Returns the arrays, with no load yet, and the number of unknowns.
    """
    rng = np.random.default_rng(seed)
    rows = joint + redundant
    stride, reach = 6 + rows, 3 if tree else 1
    n = links * stride
    p = friction_arrays(n, contacts, 2, 12, band=(reach + 1) * stride, bilateral=links * rows)
    for body in range(links):
        before = body - int(rng.integers(1, reach + 1))
        J = rng.standard_normal((rows, 12)) * np.exp(rng.uniform(-2, 2, (rows, 1)))
        if redundant:
            J[-1] = -3 * J[0]
        for k in range(rows):
            i = body * rows + k
            p.bilateral.at[i] = body * stride + 6 + k
            p.bilateral.start[i, 0], p.bilateral.width[i, 0] = body * stride, 6
            if before >= 0:
                p.bilateral.start[i, 1], p.bilateral.width[i, 1] = before * stride, 6
            p.bilateral.J[i] = J[k]
    for c in range(contacts):
        a = int(rng.integers(0, links))
        b = a - int(rng.integers(1, reach + 1))
        p.rows.start[c, 0], p.rows.width[c, 0] = a * stride, 6
        if b >= 0:
            p.rows.start[c, 1], p.rows.width[c, 1] = b * stride, 6
        p.rows.G[c] = rng.standard_normal((3, 12))
    p.mu[:] = rng.uniform(0.1, 0.8, contacts)
    return p, n


def dense(start: np.ndarray, width: np.ndarray, values: np.ndarray, n: int) -> np.ndarray:
    """Return rows stored by runs as a dense matrix."""
    out = np.zeros((len(values), n))
    for i, row in enumerate(values):
        a = 0
        for s, w in zip(start[i], width[i], strict=True):
            out[i, s : s + w] = row[a : a + w]
            a += w
    return out


def dense_rows(p: FrictionArrays, n: int) -> np.ndarray:
    """Return the contacts' rows G as a dense matrix of shape (3 nc, n)."""
    three = [dense(p.rows.start, p.rows.width, p.rows.G[:, k], n) for k in range(3)]
    return np.stack(three, axis=1).reshape(-1, n)


def dense_bilateral(p: FrictionArrays, n: int) -> np.ndarray:
    """Return the bilateral rows J as a dense matrix of shape (nt, n)."""
    return dense(p.bilateral.start, p.bilateral.width, p.bilateral.J, n)

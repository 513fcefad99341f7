"""A friction problem as arrays, with the operations every solver shares.

The problem, whitened (M = I), with bilateral rows J (ideal joints, drives):  w' = (v, l), B w = G' r,  u = G w + q,
Coulomb's law between each r_i and u_i. B is the identity without such rows, see `engine.friction.bilateral`.
"""

from typing import NamedTuple

import numpy as np

from engine.friction.banded import PAIR, ROWS_AT_ONCE
from engine.friction.bilateral import BilateralSystem, solve_bilateral
from engine.jit import inner

CONVERGED = 0
NOT_CONVERGED = 1


class ContactRows(NamedTuple):
    """The rows of G. Contact i touches runs of velocities, one for each body: ``start[i, s]`` ... + ``width[i, s]``.

    ``G[i]`` holds the columns of its runs one after the other.
    """

    start: np.ndarray  # (nc, ns) int64
    width: np.ndarray  # (nc, ns) int64, 0: no such run
    G: np.ndarray  # (nc, 3, k) rows (N, T1, T2)


class FrictionArrays(NamedTuple):
    """A whitened friction problem of at most ``nc`` contacts and ``n`` unknowns, and work space.

    The unknowns w are velocities and, among them, the multipliers of the bilateral rows.
    """

    rows: ContactRows
    bilateral: BilateralSystem
    q: np.ndarray  # (nc, 3) relative velocity without impulses, plus the law's shift
    mu: np.ndarray  # (nc,)
    r: np.ndarray  # (nc, 3) impulses: start on entry, solution on return
    u: np.ndarray  # (nc, 3) relative velocities of the solution
    w: np.ndarray  # (n,) velocity change of the solution
    scale: np.ndarray  # (nc,) mean diagonal of the contact's own Delassus block
    x: np.ndarray  # (nc, 3) scaled impulses
    y: np.ndarray  # (nc, 3) scaled shifted velocities
    miss: np.ndarray  # (nc, 3) residual of the definition of y
    dr: np.ndarray  # (nc, 3)
    du: np.ndarray  # (nc, 3)
    A: np.ndarray  # (nc, 3, 3) eliminated block: dr = -b - A du
    Q: np.ndarray  # (nc, 3, 3) derivative of the contact's equation with respect to u
    b: np.ndarray  # (nc, 3)
    block: np.ndarray  # (PAIR (PAIR + 3),) see `banded.add_blocks`
    K: np.ndarray  # (n, 2 (band + 2) + 1) system, see `banded`
    dw: np.ndarray  # (n,)
    best: np.ndarray  # (nc, 3) impulses of the smallest residual within an attempt
    base: np.ndarray  # (nc, 3) impulses from which to continue when the natural map fails
    kept: np.ndarray  # (nc, 3) impulses of the best attempt


def friction_arrays(n: int, nc: int, runs: int, k: int, band: int, bilateral: int = 0) -> FrictionArrays:
    """Allocate a problem.

    Parameters
    ----------
    n : int
        Number of unknowns.
    nc : int
        Number of contacts.
    runs, k : int
        A contact touches at most ``k`` velocities in at most ``runs`` runs.
    band : int
        Largest distance between two unknowns of one contact, or of one bilateral row with its multiplier.
    bilateral : int
        Number of bilateral rows.
    """
    columns = 2 * (min(band, max(n - 1, 0)) + ROWS_AT_ONCE - 1) + 1
    shapes = {"mu": (nc,), "scale": (nc,), "A": (nc, 3, 3), "Q": (nc, 3, 3), "w": (n,), "dw": (n,), "K": (n, columns)}
    shapes["block"] = (PAIR * (PAIR + 3),)
    start, width = np.zeros((2, nc, runs), np.int64)
    first, count = np.zeros((2, bilateral, 2), np.int64)
    system = BilateralSystem(
        at=np.zeros(bilateral, np.int64),
        start=first,
        width=count,
        J=np.zeros((bilateral, 12)),
        length=np.zeros(bilateral),
        factors=np.zeros((n if bilateral else 0, columns)),
        right=np.zeros(n if bilateral else 0),
        miss=np.zeros(n if bilateral else 0),
    )
    rows = ContactRows(start, width, np.zeros((nc, 3, k)))
    return FrictionArrays(rows, system, *(np.zeros(shapes.get(name, (nc, 3))) for name in FrictionArrays._fields[2:]))


class Goal(NamedTuple):
    """The condition under which a problem counts as solved."""

    tolerance: float  # relative residual to reach
    scale: float  # mean diagonal of the Delassus operator, in which impulses are velocities


class Effort(NamedTuple):
    """The number of steps that a method may take."""

    least: int
    most: int
    patience: int  # poor steps in a row after which the method is given up


@inner
def copy(nc, source, target):
    """Copy the first ``nc`` rows of three."""
    for i in range(nc):
        target[i, 0], target[i, 1], target[i, 2] = source[i, 0], source[i, 1], source[i, 2]


@inner
def measure_scales(nc, rows, scale):
    """Write each contact's mean Delassus diagonal, as if there were no bilateral rows; return their mean."""
    mean = 0.0
    for i in range(nc):
        s, width = 0.0, 0
        for run in range(rows.width.shape[1]):
            width += rows.width[i, run]
        for k in range(3):
            for a in range(width):
                s += rows.G[i, k, a] * rows.G[i, k, a]
        mean += s
        scale[i] = s / 3 if s > 0.0 else 1.0
    mean /= max(3 * nc, 1)
    return mean if mean > 0.0 else 1.0


@inner
def add_impulse(rows, i, r0, r1, r2, w):
    """Add G_i' r to a vector of velocities."""
    g0, g1, g2, a = rows.G[i, 0], rows.G[i, 1], rows.G[i, 2], 0
    for run in range(rows.width.shape[1]):
        part, e0, e1, e2 = w[rows.start[i, run] :], g0[a:], g1[a:], g2[a:]
        for k in range(rows.width[i, run]):
            part[k] += e0[k] * r0 + e1[k] * r1 + e2[k] * r2
        a += rows.width[i, run]


@inner
def relative(rows, i, w):
    """Return the three components of G_i w."""
    u0, u1, u2, a = 0.0, 0.0, 0.0, 0
    for run in range(rows.width.shape[1]):
        first, width = rows.start[i, run], rows.width[i, run]
        for k in range(width):
            y = w[first + k]
            u0 += rows.G[i, 0, a + k] * y
            u1 += rows.G[i, 1, a + k] * y
            u2 += rows.G[i, 2, a + k] * y
        a += width
    return u0, u1, u2


@inner
def finish(n, nc, p):
    """Write the velocities w and u that belong to the impulses r."""
    for k in range(n):
        p.w[k] = 0.0
    for i in range(nc):
        add_impulse(p.rows, i, p.r[i, 0], p.r[i, 1], p.r[i, 2], p.w)
    solve_bilateral(n, p.bilateral, p.w)
    for i in range(nc):
        u0, u1, u2 = relative(p.rows, i, p.w)
        p.u[i, 0], p.u[i, 1], p.u[i, 2] = p.q[i, 0] + u0, p.q[i, 1] + u1, p.q[i, 2] + u2

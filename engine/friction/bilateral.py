"""Tied rows J w = 0 (ideal joints, drives) among the unknowns of a friction problem, exact and without projection.

Each row has a multiplier among the unknowns, behind and near the velocities that it touches, so that the system

    B = [[I, J'], [-J, eps I]],    rows of J of length one,

is banded. Its symmetric part is positive definite: no pivoting, and redundant rows (a planar four-bar linkage in space)
do no harm. What eps leaves, J w = eps l, is taken out by one more solve.
"""

from typing import NamedTuple

import numpy as np

from engine.friction.banded import factorise, start_system, substitute
from engine.jit import inner, kernel

EPS = 1e-12
REFINEMENTS = 1
TINY = 1e-300


class Ties(NamedTuple):
    """The tied rows, whitened, and what the solvers keep of them."""

    at: np.ndarray  # (nt,) int64, where the row's multiplier is among the unknowns
    start: np.ndarray  # (nt, 2) int64, runs of velocities that the row touches, as in `Rows`
    width: np.ndarray  # (nt, 2) int64
    J: np.ndarray  # (nt, 12) columns of the runs, one after the other; any length
    length: np.ndarray  # (nt,) of the row; written by `tie_down`
    factors: np.ndarray  # (n, ...) of B; written by `tie_down`
    asked: np.ndarray  # (n,) work space
    miss: np.ndarray  # (n,) work space


@kernel
def tie_down(n, ties):
    """Measure the rows and factorise B; to be called whenever J has changed, before anything is solved."""
    for i in range(ties.at.shape[0]):
        s = 0.0
        for a in range(ties.width[i, 0] + ties.width[i, 1]):
            s += ties.J[i, a] * ties.J[i, a]
        ties.length[i] = np.sqrt(s)
    if ties.at.shape[0] > 0:
        start_system(n, ties.factors)
        add_ties(ties, ties.factors)
        factorise(n, ties.factors)


@inner
def add_ties(ties, K):
    """Write the tied rows and columns into the identity: B."""
    middle = (K.shape[1] - 1) // 2
    for i in range(ties.at.shape[0]):
        if ties.length[i] > 0.0:  # a row of zeros ties nothing: its multiplier stays 0
            row, f, a = ties.at[i], 1 / ties.length[i], 0
            K[row, middle] = EPS
            for run in range(2):
                first = ties.start[i, run]
                for k in range(ties.width[i, run]):
                    y = f * ties.J[i, a + k]
                    K[row, middle + first + k - row] = -y
                    K[first + k, middle + row - first - k] = y
                a += ties.width[i, run]


@inner
def release(n, ties, w):
    """Solve B w = w in place, for eps -> 0; without ties there is nothing to do."""
    if ties.at.shape[0] > 0:
        for k in range(n):
            ties.asked[k] = w[k]
        substitute(n, ties.factors, w)
        for _ in range(REFINEMENTS):
            _miss(n, ties, w)
            substitute(n, ties.factors, ties.miss)
            for k in range(n):
                w[k] += ties.miss[k]


@inner
def _miss(n, ties, w):
    """Write what is left of the right-hand side, without eps: asked - B w."""
    for k in range(n):
        ties.miss[k] = ties.asked[k] - w[k]
    for i in range(ties.at.shape[0]):
        row, f, a, rate = ties.at[i], 1 / max(ties.length[i], TINY), 0, 0.0
        for run in range(2):
            first = ties.start[i, run]
            for k in range(ties.width[i, run]):
                y = f * ties.J[i, a + k]
                rate += y * w[first + k]
                ties.miss[first + k] -= y * w[row]
            a += ties.width[i, run]
        ties.miss[row] = ties.asked[row] + rate


@kernel
def hold_ties(n, ties, c, w):
    """Write the least change w of the velocities with J w + c = 0, c of shape (nt,) in the caller's scaling."""
    for k in range(n):
        w[k] = 0.0
    for i in range(ties.at.shape[0]):
        if ties.length[i] > 0.0:
            w[ties.at[i]] = c[i] / ties.length[i]
    release(n, ties, w)


@kernel
def tie_impulse(ties, w, i):
    """Return the impulse of row i, in the caller's scaling: J' times it is what the tie adds to the velocities."""
    if ties.length[i] > 0.0:
        return -w[ties.at[i]] / ties.length[i]
    return 0.0

"""Bilateral rows J w = 0 (ideal joints, drives) among the unknowns of a friction problem, exact, without projection.

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


class BilateralSystem(NamedTuple):
    """The bilateral rows of a friction problem, whitened, and their factorised system."""

    at: np.ndarray  # (nt,) int64, where the row's multiplier is among the unknowns
    start: np.ndarray  # (nt, 2) int64, runs of velocities that the row touches, as in `ContactRows`
    width: np.ndarray  # (nt, 2) int64
    J: np.ndarray  # (nt, 12) columns of the runs, one after the other; any length
    length: np.ndarray  # (nt,) lengths of the rows; written by `factorise_bilateral`
    factors: np.ndarray  # (n, ...) of B; written by `factorise_bilateral`
    right: np.ndarray  # (n,) right-hand side, work space
    miss: np.ndarray  # (n,) work space


@kernel
def factorise_bilateral(n, rows):
    """Write the lengths of the rows and the factors of B; to be called after every change of J.

    Parameters
    ----------
    n : int
        Number of unknowns.
    rows : BilateralSystem
    """
    for i in range(rows.at.shape[0]):
        s = 0.0
        for a in range(rows.width[i, 0] + rows.width[i, 1]):
            s += rows.J[i, a] * rows.J[i, a]
        rows.length[i] = np.sqrt(s)
    if rows.at.shape[0] > 0:
        start_system(n, rows.factors)
        add_bilateral(rows, rows.factors)
        factorise(n, rows.factors)


@inner
def add_bilateral(rows, K):
    """Write the bilateral rows and columns into the identity: B."""
    middle = (K.shape[1] - 1) // 2
    for i in range(rows.at.shape[0]):
        if rows.length[i] > 0.0:  # a row of zeros constrains nothing: its multiplier stays 0
            row, f, a = rows.at[i], 1 / rows.length[i], 0
            K[row, middle] = EPS
            for run in range(2):
                first = rows.start[i, run]
                for k in range(rows.width[i, run]):
                    y = f * rows.J[i, a + k]
                    K[row, middle + first + k - row] = -y
                    K[first + k, middle + row - first - k] = y
                a += rows.width[i, run]


@inner
def solve_bilateral(n, rows, w):
    """Solve B w = w in place, for eps -> 0; without bilateral rows there is nothing to do."""
    if rows.at.shape[0] > 0:
        for k in range(n):
            rows.right[k] = w[k]
        substitute(n, rows.factors, w)
        for _ in range(REFINEMENTS):
            _miss(n, rows, w)
            substitute(n, rows.factors, rows.miss)
            for k in range(n):
                w[k] += rows.miss[k]


@inner
def _miss(n, rows, w):
    """Write what is left of the right-hand side, without eps: right - B w."""
    for k in range(n):
        rows.miss[k] = rows.right[k] - w[k]
    for i in range(rows.at.shape[0]):
        row, f, a, rate = rows.at[i], 1 / max(rows.length[i], TINY), 0, 0.0
        for run in range(2):
            first = rows.start[i, run]
            for k in range(rows.width[i, run]):
                y = f * rows.J[i, a + k]
                rate += y * w[first + k]
                rows.miss[first + k] -= y * w[row]
            a += rows.width[i, run]
        rows.miss[row] = rows.right[row] + rate


@kernel
def hold_bilateral(n, rows, c, w):
    """Write the least change w of the velocities with J w + c = 0.

    Parameters
    ----------
    n : int
        Number of unknowns.
    rows : BilateralSystem
        With the factors of the present J.
    c : (nt,) array
        In the scaling of the rows J.
    w : (n,) array
        Written.
    """
    for k in range(n):
        w[k] = 0.0
    for i in range(rows.at.shape[0]):
        if rows.length[i] > 0.0:
            w[rows.at[i]] = c[i] / rows.length[i]
    solve_bilateral(n, rows, w)

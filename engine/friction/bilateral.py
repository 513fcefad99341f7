"""Bilateral rows J w = 0 (ideal joints, drives) in a friction problem, satisfied exactly and without projection.

Each row has a multiplier among the unknowns, in a node that is eliminated after the velocities that the row acts on, so
that the system

    B = [[I, J'], [-J, eps I]],    rows of J scaled to length one,

has few blocks. Its symmetric part is positive definite, so no pivoting is needed. The remainder due to eps,
J w = eps l, is removed by one more solve. Rows that repeat others exactly do no harm; those that do so only nearly must
be left out (`engine.friction.redundancy`). A row with an ease yields to its impulse r by ease r.
"""

from typing import NamedTuple

import numpy as np

from engine.friction.blocks import BODY, PIECE, ROW, clear, factorise, start_system, substitute
from engine.jit import by_address, inner, kernel

EPS = 1e-12
REFINEMENTS = 1  # leaves 1e-11 in a chain of 400 links
TINY = 1e-300


@by_address
class BilateralSystem(NamedTuple):
    """The whitened bilateral rows of a friction problem, and their factorised system."""

    at: np.ndarray  # (nt,) int64, index of the row's multiplier among the unknowns
    node: np.ndarray  # (nt, 2) int64, nodes of the bodies that the row acts on; -1: none
    pair: np.ndarray  # (nt, 2) int64, first piece of the system for the body and the multiplier's node
    J: np.ndarray  # (nt, 16) six columns and two zeros per body; of any length
    length: np.ndarray  # (nt,) lengths of the rows; written by `factorise_bilateral`
    ease: np.ndarray  # (nt,) velocity with which a row yields to an impulse of 1; 0: it holds
    K: np.ndarray  # (48 pieces,) factors of B; written by `factorise_bilateral`
    F: np.ndarray  # (48 nodes,)
    right: np.ndarray  # (n,) right-hand side, workspace
    miss: np.ndarray  # (n,) workspace
    owner: np.ndarray  # (n,) int64, the row of each multiplier among the unknowns; -1: another unknown
    left: np.ndarray  # (6, 6) products of a node's rows, workspace of `redundancy`


@kernel
def factorise_bilateral(system, rows):
    """Write the lengths of the rows and the factors of B; call it after each change of J."""
    measure_rows(rows)
    if rows.at.shape[0] > 0:
        start_system(system, rows.K)
        add_bilateral(rows, rows.K)
        factorise(system, rows.K, rows.F)


@inner
def measure_rows(rows):
    """Write the lengths of the rows."""
    for i in range(rows.at.shape[0]):
        s = 0.0
        for a in range(2 * ROW):
            s += rows.J[i, a] * rows.J[i, a]
        rows.length[i] = np.sqrt(s)


@inner
def add_bilateral(rows, K):
    """Add the bilateral rows and columns to the identity, which gives B."""
    for i in range(rows.at.shape[0]):
        if rows.length[i] > 0.0:  # a zero row constrains nothing, and its multiplier stays 0
            node, across, f = rows.at[i] // ROW, rows.at[i] % ROW, 1 / rows.length[i]
            K[PIECE * node + (ROW + 1) * across] = EPS
            if rows.ease[i] > 0.0:
                K[PIECE * node + (ROW + 1) * across] = EPS + rows.ease[i] * f * f
            for s in range(2):
                if rows.node[i, s] >= 0:
                    right = PIECE * rows.pair[i, s] + across
                    for k in range(BODY):
                        y = f * rows.J[i, ROW * s + k]
                        K[right + ROW * k] = y
                        K[right + PIECE + ROW * k] = -y


@inner
def solve_bilateral(system, rows, w):
    """Solve B w = w in place for eps -> 0; without bilateral rows nothing is done."""
    if rows.at.shape[0] > 0:
        for k in range(w.shape[0]):
            rows.right[k] = w[k]
        substitute(system, rows.K, rows.F, w)
        for _ in range(REFINEMENTS):
            _miss(rows, w)
            substitute(system, rows.K, rows.F, rows.miss)
            for k in range(w.shape[0]):
                w[k] += rows.miss[k]


@inner
def _miss(rows, w):
    """Write the residual without eps: right - B w."""
    for k in range(w.shape[0]):
        rows.miss[k] = rows.right[k] - w[k]
    for i in range(rows.at.shape[0]):
        row, f, rate = rows.at[i], 1 / max(rows.length[i], TINY), 0.0
        for s in range(2):
            first = ROW * rows.node[i, s]
            if first >= 0:
                for k in range(BODY):
                    y = f * rows.J[i, ROW * s + k]
                    rate += y * w[first + k]
                    rows.miss[first + k] -= y * w[row]
        rows.miss[row] = rows.right[row] + rate
        if rows.ease[i] > 0.0 and rows.length[i] > 0.0:
            rows.miss[row] -= rows.ease[i] * f * f * w[row]


@kernel
def hold_bilateral(system, rows, c, w):
    """Write the smallest change w of the velocities, shape (n,), with J w + c = 0.

    The velocities c, shape (nt,), are in the scaling of the rows J; the factors must be those of the current J.
    """
    clear(w)
    for i in range(rows.at.shape[0]):
        if rows.length[i] > 0.0:
            w[rows.at[i]] = c[i] / rows.length[i]
    solve_bilateral(system, rows, w)

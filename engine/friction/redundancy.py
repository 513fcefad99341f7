"""Which bilateral rows repeat what others hold already, as those of a closed linkage do.

The rows of a Bennett linkage, or of a planar four-bar linkage in space, hold some motions twice. Where they are exactly
dependent it does not matter which of them are used. Elsewhere they differ from dependent ones by little: by the square
of a step within it, or by the last digit of an axis in a file. Used together they would then hold the linkage's own
motion as well. So a row counts as redundant if what the rows before it leave of it is a small share of its length.

This is decided in the course of a factorisation of the rows' system, node by node. Among the up to six rows of a node,
which belong to one joint, those of which most is left come first.
"""

from engine.friction.bilateral import add_bilateral, measure_rows
from engine.friction.blocks import BODY, PIECE, ROW, eliminate_node, start_system
from engine.jit import inner, kernel

LOYALTY = 4.0  # factor of the square of a row that was used before: near a tie, the choice does not alternate


@kernel
def mark_redundant(system, rows, tolerance, redundant):
    """Mark each row of J of which the others leave less than a share ``tolerance``; rows of length 0 are not marked.

    ``redundant``, (nt,) bool, must hold the last marks, or False. The factors of the rows' system are overwritten.
    """
    measure_rows(rows)
    start_system(system, rows.K)
    add_bilateral(rows, rows.K)
    for node in range(system.begin.shape[0]):
        _mark_node(system, rows, tolerance * tolerance, redundant, node)
        eliminate_node(system, rows.K, rows.F, node)


@inner
def _mark_node(system, rows, least, redundant, node):
    """Mark the redundant rows among the multipliers of a node, by pivots, and take them out of the system."""
    K, left, at, first = rows.K, rows.left, PIECE * node, ROW * node
    waiting = 0
    for i in range(BODY):
        row = rows.owner[first + i]
        if row >= 0 and rows.length[row] > 0.0:
            waiting += 1
        for j in range(BODY):
            left[i, j] = K[at + ROW * i + j]
    if waiting == 0:
        return
    used = 0  # bits: rows that came before
    while waiting > 0:
        best, most = -1, -1.0
        for i in range(BODY):
            row = rows.owner[first + i]
            if row >= 0 and rows.length[row] > 0.0 and not (used >> i) & 1:
                size = left[i, i] if redundant[row] else LOYALTY * left[i, i]
                if best < 0 or size > most:
                    best, most = i, size
        used |= 1 << best
        waiting -= 1
        row, pivot = rows.owner[first + best], left[best, best]
        redundant[row] = not pivot > least
        if redundant[row]:
            _take_out(system, K, node, best)
            continue
        for i in range(BODY):
            share = left[i, best] / pivot
            for j in range(BODY):
                if not (used >> i) & 1 and not (used >> j) & 1:
                    left[i, j] -= share * left[best, j]


@inner
def _take_out(system, K, node, i):
    """Take the i-th unknown of a node out of its pieces."""
    at = PIECE * node
    for j in range(BODY):
        K[at + ROW * i + j] = K[at + ROW * j + i] = 0.0
    K[at + (ROW + 1) * i] = 1.0
    for e in range(system.first[node], system.first[node + 1]):
        for piece in range(2):
            for j in range(BODY):
                K[PIECE * (system.pair[e] + piece) + ROW * i + j] = 0.0

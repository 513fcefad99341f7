"""The order in which the nodes of a block system are eliminated, and the fill-in that results.

At each step the node with the fewest neighbours is eliminated first (minimum degree): a chain remains a chain, a tree
remains a tree, and a heap gets as little fill-in as a greedy choice allows. Multipliers come after the bodies that
their rows act on, because only these give them a pivot. In a small system they also come after the bodies that fill-in
has made their neighbours; in a long chain of joints and contacts all of them would then wait for its last body.
"""

import numpy as np

from engine.arrays import Integers
from engine.friction.blocks import Elimination
from engine.jit import inner, kernel

SMALL = 24  # nodes of a system in which the additional fill-in costs little


@kernel
def order_nodes(neighbours, held, after, order, degree):
    """Write the order of elimination, and mark the pairs of the fill-in in ``neighbours``.

    ``neighbours``, (nodes, nodes), is symmetric and true for the pairs with a block; nodes marked in ``after`` come
    after all their unmarked neighbours in ``held``, which may be the same array; ``degree`` is workspace. Return the
    number of pairs, and the number of pairs among the later neighbours of each node, summed over all nodes.
    """
    nodes, pairs, targets = order.shape[0], 0, 0
    for a in range(nodes):
        degree[a] = 0
        for b in range(nodes):
            degree[a] += neighbours[a, b]
    for step in range(nodes):
        best = -1
        for a in range(nodes):
            fewer = degree[a] >= 0 and (best < 0 or degree[a] < degree[best])
            if fewer and not (after[a] and _waits(a, held, after, degree)):
                best = a
        order[step], m = best, degree[best]
        degree[best] = -1  # eliminated
        pairs, targets = pairs + m, targets + m * (m - 1) // 2
        for a in range(nodes):
            if neighbours[best, a] and degree[a] >= 0:
                degree[a] -= 1
                for b in range(a + 1, nodes):
                    if neighbours[best, b] and degree[b] >= 0 and not neighbours[a, b]:
                        neighbours[a, b] = neighbours[b, a] = True
                        degree[a] += 1
                        degree[b] += 1
    return pairs, targets


@inner
def _waits(a, held, after, degree):
    """Return whether an unmarked neighbour of node ``a`` in ``held`` is not eliminated yet."""
    b = 0
    while b < degree.shape[0] and not (held[a, b] and not after[b] and degree[b] >= 0):
        b += 1
    return b < degree.shape[0]


@kernel
def list_blocks(neighbours, order, piece, system):
    """Write the blocks of a system with nodes numbered in the order of elimination.

    ``neighbours`` includes the fill-in, with nodes numbered as before the elimination. ``piece``, (nodes, nodes),
    receives the first piece of each pair of nodes, numbered by elimination; 0 if the pair has none.
    """
    nodes, e, at = order.shape[0], 0, 0
    for a in range(nodes):
        system.first[a] = e
        for b in range(a + 1, nodes):
            piece[a, b] = piece[b, a] = 0
            if neighbours[order[a], order[b]]:
                system.pair[e], system.later[e] = nodes + 2 * e, b
                piece[a, b] = piece[b, a] = nodes + 2 * e
                e += 1
    system.first[nodes] = e
    for a in range(nodes):
        system.begin[a] = at
        for e in range(system.first[a], system.first[a + 1]):
            for f in range(e + 1, system.first[a + 1]):
                system.target[at] = piece[system.later[e], system.later[f]]
                at += 1


def eliminate_nodes(neighbours: np.ndarray, after: np.ndarray | None = None) -> tuple[Elimination, Integers, Integers]:
    """Return the blocks of a system, the place of each node in the elimination, and the first pieces of all pairs.

    ``neighbours``, (nodes, nodes), is symmetric and true for the pairs with a block; the fill-in is added to it.
    ``after`` marks the nodes of multipliers, which come after the bodies that their rows act on. The pieces, (nodes,
    nodes), are by the new numbers.
    """
    nodes = len(neighbours)
    order, degree, number = np.zeros((3, nodes), np.int64)
    after = np.zeros(nodes, bool) if after is None else after
    held = neighbours if nodes <= SMALL else neighbours.copy()
    pairs, targets = order_nodes(neighbours, held, after, order, degree)
    piece = np.zeros((nodes, nodes), np.int64)
    pair, later = np.zeros((2, pairs), np.int64)
    system = Elimination(np.zeros(nodes + 1, np.int64), pair, later, degree, np.zeros(targets, np.int64))
    list_blocks(neighbours, order, piece, system)
    number[order] = np.arange(nodes)
    return system, number, piece

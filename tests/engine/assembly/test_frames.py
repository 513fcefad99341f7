"""The order of bodies among the unknowns: as narrow a band as scipy's ordering has."""

from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from engine.assembly.frames import cuthill_mckee
from tests.each import each


def band(graph: np.ndarray, order: list[int]) -> int:
    """Return how far apart two neighbours are at most, in an order."""
    place = np.argsort(order)
    return max((int(abs(place[i] - place[j])) for i, j in zip(*np.nonzero(graph), strict=True)), default=0)


@each("seed", range(20))
def test_the_band_is_no_wider_than_scipy_s(seed):
    """Sparse random graphs of up to 40 nodes, in several pieces or one; every node once. Ties may fall otherwise."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 40))
    graph = np.triu(rng.random((n, n)) < 1.5 / n, 1)
    graph = graph | graph.T
    order = cuthill_mckee([set(np.flatnonzero(row).tolist()) for row in graph])
    assert sorted(order) == list(range(n))
    theirs = reverse_cuthill_mckee(csr_array(graph.astype(float)), symmetric_mode=True)
    assert band(graph, order) <= band(graph, theirs.tolist()) + 2


def test_a_shuffled_chain_gets_the_band_one():
    """Each link next to its neighbours."""
    shuffled = np.random.default_rng(1).permutation(50)
    near: list[set[int]] = [set() for _ in shuffled]
    for a, b in pairwise(shuffled):
        near[a].add(int(b))
        near[b].add(int(a))
    order = cuthill_mckee(near)
    place = np.argsort(order)
    assert {abs(int(place[a] - place[b])) for a in range(50) for b in near[a]} == {1}

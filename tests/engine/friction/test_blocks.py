"""Block systems against LAPACK, and the order of elimination against brute force and known graphs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.chain import chain
from engine.assembly import assemble
from engine.friction.arrays import dense_rows, friction_arrays
from engine.friction.blocks import BODY, PIECE, ROW, add_contact, factorise, start_system, substitute
from engine.friction.elimination import eliminate_nodes
from engine.jit import kernel
from engine.mechanism import mechanism_from
from tests.counts import many

pytestmark = pytest.mark.bits


@kernel
def solve_system(system, rows, A, smooth, K, F, x):
    """Assemble I + sum G' A G and solve it."""
    start_system(system, K)
    for i in range(smooth.shape[0]):
        add_contact(rows, i, A, smooth[i], K)
    factorise(system, K, F)
    substitute(system, K, F, x)


def random_graph(rng, nodes, edges):
    """Return a symmetric matrix of neighbours, and its edges."""
    neighbours = np.zeros((nodes, nodes), bool)
    ends = [tuple(rng.choice(nodes, 2, replace=False)) for _ in range(edges)] if nodes > 1 else []
    for a, b in ends:
        neighbours[a, b] = neighbours[b, a] = True
    return neighbours, ends


def filled(neighbours, order):
    """Return the pairs with a block after elimination in an order, as the definition has it."""
    graph = neighbours.copy()
    for step, node in enumerate(order):
        later = [b for b in order[step + 1 :] if graph[node, b]]
        for a in later:
            for b in later:
                if a != b:
                    graph[a, b] = True
    return graph


@given(st.integers(0, 10**6), st.integers(1, 9), st.integers(0, 20), st.integers(2, 4))
@settings(max_examples=many(60), deadline=None)
def test_a_system_of_contacts_is_solved_as_lapack_solves_it(seed, nodes, edges, runs):
    """Contacts of one to four nodes each, blocks A with a positive symmetric part, some without friction."""
    rng = np.random.default_rng(seed)
    touched = [rng.choice(nodes, rng.integers(1, min(runs, nodes) + 1), replace=False) for _ in range(edges)]
    neighbours = np.zeros((nodes, nodes), bool)
    for there in touched:
        for a in there:
            neighbours[a, there] = True
    np.fill_diagonal(neighbours, False)
    system, number, piece = eliminate_nodes(neighbours)
    p = friction_arrays(system, len(touched), runs)
    for i, there in enumerate(touched):
        node = number[there]
        p.rows.node[i, : node.size], p.rows.pair[i, : node.size, : node.size] = node, piece[node[:, None], node]
        p.rows.G[i].reshape(3, runs, ROW)[:, : node.size, :BODY] = rng.standard_normal((3, node.size, BODY))
    roots = rng.standard_normal((edges, 3, 3))
    A = roots @ roots.transpose(0, 2, 1) + 0.5 * (roots - roots.transpose(0, 2, 1))
    A *= 10 ** rng.uniform(-2, 3, (edges, 1, 1))
    smooth = rng.random(edges) < 0.3
    n, G = p.w.size, dense_rows(p.rows.node, p.rows.G, p.w.size)
    used = A.copy()
    used[smooth] *= np.eye(3)[:1].T @ np.eye(3)[:1]
    K = np.eye(n) + np.einsum("iak,iab,ibl->kl", G, used, G)
    right = rng.standard_normal((nodes, ROW))
    right[:, BODY:] = 0.0
    x = right.ravel().copy()
    solve_system(system, p.rows, np.ascontiguousarray(A.reshape(edges, 9).T), smooth, p.K, p.F, x)
    expected = np.linalg.solve(K, right.ravel())
    np.testing.assert_allclose(x, expected, atol=1e-10 * np.linalg.cond(K) * 1e-2 * np.abs(expected).max() + 1e-14)
    assert not x.reshape(nodes, ROW)[:, BODY:].any()


@given(st.integers(0, 10**6), st.integers(1, 12), st.integers(0, 25))
def test_the_pairs_are_those_that_elimination_fills(seed, nodes, edges):
    """Every pair has its piece, no other has one, and each node's later ones ascend."""
    rng = np.random.default_rng(seed)
    neighbours, _ = random_graph(rng, nodes, edges)
    given_pairs = neighbours.copy()
    system, number, piece = eliminate_nodes(neighbours)
    order = np.argsort(number)
    expected = filled(given_pairs, order)
    np.testing.assert_array_equal(neighbours, expected)
    np.testing.assert_array_equal(piece[np.ix_(number, number)] > 0, expected)
    assert sorted(piece[piece > 0]) == sorted(2 * list(range(nodes, nodes + 2 * system.pair.size, 2)))
    for a in range(nodes):
        later = system.later[system.first[a] : system.first[a + 1]]
        assert (np.diff(later) > 0).all()
        assert (later > a).all()


def test_chains_and_trees_fill_nothing():
    """Minimum degree finds the elimination from the ends."""
    for ends in ([(i, i + 1) for i in range(30)], [((i - 1) // 3, i) for i in range(1, 31)]):
        neighbours = np.zeros((31, 31), bool)
        for a, b in np.random.default_rng(0).permutation(31)[np.array(ends)]:
            neighbours[a, b] = neighbours[b, a] = True
        system, _, _ = eliminate_nodes(neighbours)
        assert system.pair.size == 30
        assert system.target.size == 0 or (system.target > 0).all()


@pytest.mark.parametrize("seed", range(5))
def test_multipliers_come_after_the_bodies_that_they_touch(seed):
    """A multiplier has no pivot of its own."""
    rng = np.random.default_rng(seed)
    bodies, ties = 10, 14
    neighbours = np.zeros((bodies + ties, bodies + ties), bool)
    ends = [rng.choice(bodies, 2, replace=False) for _ in range(ties)]
    for tie, touched in enumerate(ends, bodies):
        neighbours[tie, touched] = neighbours[touched, tie] = True
    _, number, _ = eliminate_nodes(neighbours, np.arange(bodies + ties) >= bodies)
    for tie, touched in enumerate(ends, bodies):
        assert number[tie] > max(number[touched])


def test_a_long_chain_of_joints_with_friction_stays_a_chain():
    """A multiplier waits for its own two bodies, not for those that elimination has made its neighbours."""
    for links in (30, 100):
        mechanism = mechanism_from(chain(links, clearance=0.0, torque=1e-4), "chain")
        system = assemble(mechanism).problem.system
        assert system.begin.size == 3 * links  # bodies, multipliers, and weights on which the friction acts
        assert system.pair.size == 7 * links - 6
        assert system.target.size == 5 * links - 7


def test_a_small_system_keeps_its_order():
    """The multipliers of up to 24 nodes come after all bodies that they are connected with."""
    for bodies in (12, 13):
        neighbours = np.zeros((2 * bodies, 2 * bodies), bool)
        for k in range(bodies):
            for a, b in ((k, k - 1), (bodies + k, k), (bodies + k, k - 1)):
                if b >= 0:
                    neighbours[a, b] = neighbours[b, a] = True
        _, number, _ = eliminate_nodes(neighbours, np.arange(2 * bodies) >= bodies)
        assert (number[bodies:].min() > number[:bodies].max()) == (bodies == 12)


def test_pieces_are_rows_of_eight():
    """The sizes that kernels rely on."""
    assert (BODY, ROW, PIECE) == (6, 8, 48)

"""Bodies linked to one another: connected components of the graph of links, by SciPy."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from engine import load_mechanism
from engine.assembly import assemble
from engine.kernels.links import link_bodies

SPEED = 0.1


@pytest.mark.parametrize("name", ["c60", "door_latch", "planetary_gear", "slider_crank"])
def test_links(name):
    """Loaded contacts, joints between bodies, motions and springs that pull link; joints to the ground do not."""
    assembly, rng = assemble(load_mechanism(name)), np.random.default_rng(5)
    model, state = assembly.model, assembly.state
    rows, contacts, loads, ground = model.bilateral, model.contacts, model.loads, len(model.bodies.mass)
    found = set()
    for share in np.linspace(0.0, 0.6, 25):
        state.r[:, 0] = rng.random(len(state.r)) < share
        state.slip[:] = 2 * SPEED * rng.random(len(state.slip))
        rows.acts[:] = rng.random(len(rows.acts)) < 0.5
        links = [(a, b) for a, b, acts in zip(rows.a, rows.b, rows.acts, strict=True) if acts and ground not in (a, b)]
        links += [
            (body, ground) for i in np.flatnonzero(rows.acts & (rows.law >= 0)) for body in (rows.a[i], rows.b[i])
        ]
        links += [tuple(pair) for pair, law in zip(loads.spring_body, loads.spring_law, strict=True) if law[4] <= 0]
        sticks = (contacts.bound == 0) | (state.slip <= SPEED)
        links += [(contacts.a[i], contacts.b[i]) for i in np.flatnonzero((state.r[:, 0] > 0) & sticks)]
        ends = np.array(links, int).reshape(-1, 2) % (ground + 1)
        graph = coo_array((np.ones(len(ends)), ends.T), shape=(ground + 1, ground + 1))
        count, expected = connected_components(graph, directed=False)
        root = np.empty(ground + 1, np.int64)
        link_bodies(model, state, SPEED, root)
        assert ((root[:, None] == root) == (expected[:, None] == expected)).all()
        found.add(count)
    assert len(found) > 1


def test_a_copy_of_an_assembly_is_its_own():
    """What is written into it does not change the run, and the next copy has the numbers of the run again."""
    assembly = assemble(load_mechanism("lever"))
    assembly.state.x[0, 0] = 2.0
    copy = assembly.copied()
    assert copy.state.x[0, 0] == 2.0
    copy.state.x[0, 0], assembly.work.q[:] = 3.0, 5.0
    assert assembly.state.x[0, 0] == 2.0
    assert copy.problem is assembly.problem
    again = assembly.copied()
    assert again.state.x is copy.state.x
    assert again.state.x[0, 0] == 2.0
    assert (again.work.q == 5.0).all()

"""The unknowns of a step: nodes of bodies and of multipliers, and the pieces of every pair."""

import numpy as np

from engine.assembly.bilateral import BilateralRow, layout
from engine.kernels.model import SLIDE


def row(a, b):
    """Return a row between two bodies."""
    return BilateralRow("row", SLIDE, a, b, np.zeros(9))


def test_each_body_has_a_node_and_each_pair_of_a_contact_a_piece():
    """Three bodies, ground 3: contacts of the same two bodies share a piece, those with the ground have none."""
    unknowns = layout(3, [], [(0, 1), (1, 0), (2, 3), (1, 2), (3, 0)])
    assert sorted(unknowns.body) == [0, 1, 2]
    first, same, ground, other, above = unknowns.contact_pair
    assert first == same > 0
    assert other not in (0, first)
    assert ground == above == 0
    assert unknowns.system.pair.size == 2


def test_up_to_six_rows_of_a_pair_share_a_node_behind_their_bodies():
    """Eight rows between two bodies make two nodes; the next pair begins another."""
    rows = [row(0, 1)] * 8 + [row(1, 2)] * 2
    unknowns = layout(2, rows, [])
    nodes = unknowns.at // 8
    assert (unknowns.at % 8).tolist() == [0, 1, 2, 3, 4, 5, 0, 1, 0, 1]
    assert len(set(nodes[:6])) == len(set(nodes[6:8])) == len(set(nodes[8:])) == 1
    assert len(set(nodes)) == 3
    for i, node in enumerate(nodes):
        there = unknowns.row_body[i][unknowns.row_body[i] >= 0]
        assert (node > there).all()
    assert unknowns.row_body[8].tolist() == [unknowns.body[1], -1]
    assert unknowns.row_pair[0, 0] == unknowns.row_pair[5, 0] != unknowns.row_pair[6, 0]

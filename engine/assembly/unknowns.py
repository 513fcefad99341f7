"""The unknowns of a step in nodes of six: the velocities of the bodies, and the multipliers of bilateral rows."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from engine.arrays import Integers
from engine.assembly.bilateral import BilateralRow
from engine.friction.blocks import BODY, ROW, Elimination
from engine.friction.elimination import eliminate_nodes


@dataclass(frozen=True)
class Unknowns:
    """The numbering of the unknowns, and the blocks of a step's system (`engine.friction.blocks`)."""

    system: Elimination
    body: Integers  # (nb,) node of each body's velocities
    at: Integers  # (nt,) index of each row's multiplier among the unknowns
    row_body: Integers  # (nt, 2) nodes of the two bodies that each row acts on; -1: the ground
    row_pair: Integers  # (nt, 2) first piece of each of these nodes with the row's node
    contact_pair: Integers  # (nc,) first piece of the two bodies of each contact; 0 if one of them is the ground


def layout(bodies: int, rows: list[BilateralRow], contacts: Sequence[tuple[int, int]]) -> Unknowns:
    """Return the numbering of the unknowns; up to six successive rows between the same two bodies share a node.

    In ``contacts``, the two bodies of each contact, a number of ``bodies`` or more is the ground.
    """
    groups: list[list[int]] = []
    for i, row in enumerate(rows):
        last = rows[groups[-1][0]] if groups else None
        if last is None or len(groups[-1]) == BODY or (row.a, row.b) != (last.a, last.b):
            groups.append([])
        groups[-1].append(i)
    nodes = bodies + len(groups)
    neighbours = np.zeros((nodes, nodes), bool)
    for a, b in contacts:
        if a < bodies and b < bodies:
            neighbours[a, b] = neighbours[b, a] = True
    for node, group in enumerate(groups, bodies):
        for body in (rows[group[0]].a, rows[group[0]].b):
            if body < bodies:
                neighbours[node, body] = neighbours[body, node] = True
    # multipliers come after their bodies, which alone give them a pivot
    system, number, piece = eliminate_nodes(neighbours, np.arange(nodes) >= bodies)

    at, row_body, row_pair = (
        np.zeros(len(rows), np.int64),
        np.full((len(rows), 2), -1),
        np.zeros((len(rows), 2), np.int64),
    )
    for node, group in enumerate(groups, bodies):
        for k, i in enumerate(group):
            at[i] = ROW * number[node] + k
            for side, body in enumerate((rows[i].a, rows[i].b)):
                if body < bodies:
                    row_body[i, side], row_pair[i, side] = number[body], piece[number[body], number[node]]
    inside = [a < bodies and b < bodies for a, b in contacts]
    pairs = [piece[number[a], number[b]] if there else 0 for (a, b), there in zip(contacts, inside, strict=True)]
    return Unknowns(system, number[:bodies], at, row_body, row_pair, np.array(pairs, np.int64))

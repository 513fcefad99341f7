"""Bilateral rows of joints and prescribed motions as arrays, and the unknowns of a step that follow from them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from engine.arrays import Array, Integers
from engine.assembly.frames import BodyFrame, tangent
from engine.assembly.loads import active_phases
from engine.friction.blocks import BODY, ROW, Elimination
from engine.friction.elimination import eliminate_nodes
from engine.kernels.model import SLIDE, TURN, BilateralRows, Bodies, State
from engine.mechanism.loads import Translation
from engine.mechanism.models import Mechanism


@dataclass(frozen=True)
class BilateralRow:
    """One bilateral row between two bodies (`kernels.bilateral`)."""

    name: str  # JOINT.ROW or the name of the motion, for messages
    kind: int  # SLIDE or TURN
    a: int  # index of a body, as is b
    b: int
    geometry: Array  # (9,) row of `kernels.bilateral`
    arm: float = 1.0  # length that multiplies a TURN's angle; 1 for a SLIDE
    law: int = -1  # number of the time law of its target; -1: none
    phases: Array | None = None  # (n_phase,) bool, the phases in which it acts; None: all
    coordinate: int = -1  # number of the coordinate of a bushing, six per bushing; -1: it holds


def turning_arm(mechanism: Mechanism, bodies: list[str]) -> float:
    """Return the length that multiplies an angle between bodies: the smallest radius of gyration of the moving ones.

    The radius is sqrt(trace(I) / 2m), the root of the mean squared distance of the body's mass from its centre.
    """
    moving = [body for body in (mechanism.bodies[name] for name in bodies) if not body.fixed]
    return float(min(np.sqrt(np.trace(np.array(b.inertia, float)) / (2 * (b.mass or 0.0))) for b in moving))


def bilateral_arrays(rows: list[BilateralRow], phases: int = 1, read: bool = False) -> BilateralRows:
    """Return the rows as arrays, for a run of ``phases`` phases; ``read``: forces or work of motions are read."""
    acts = np.array([np.full(phases, True) if row.phases is None else row.phases for row in rows], bool)
    acts = acts.reshape(-1, phases)
    return BilateralRows(
        kind=np.array([row.kind for row in rows], np.int64),
        a=np.array([row.a for row in rows], np.int64),
        b=np.array([row.b for row in rows], np.int64),
        geometry=np.array([row.geometry for row in rows]).reshape(-1, 9),
        arm=np.array([row.arm for row in rows], float),
        law=np.array([row.law for row in rows], np.int64),
        phase=acts,
        offset=np.zeros(len(rows)),
        acts=acts[:, 0].copy(),
        closed=np.array([_close_loops(rows)]),
        read=np.array([read]),
        yielding=np.array([i for i, row in enumerate(rows) if row.coordinate >= 0], np.int64),
        coordinate=np.array([row.coordinate for row in rows if row.coordinate >= 0], np.int64),
    )


def _close_loops(rows: list[BilateralRow]) -> bool:
    """Return whether the joints and motions that the rows belong to connect some bodies in more than one way."""
    root: dict[int, int] = {}

    def group(body: int) -> int:
        return group(root[body]) if root.setdefault(body, body) != body else body

    holding = [row for row in rows if row.coordinate < 0]
    for a, b in {(row.name.partition(".")[0], row.law >= 0): (row.a, row.b) for row in holding}.values():
        first, second = group(a), group(b)
        if first == second:
            return True
        root[second] = first
    return False


def rank_metric(bodies: Bodies, rows: list[BilateralRow]) -> Bodies:
    """Return bodies of mass 1 with a radius of gyration of their farthest joint, or their own if it is larger.

    What joints hold does not depend on masses; in this metric no row is long because it acts far from a body's centre.
    """
    size = np.sqrt(np.trace(bodies.inertia, axis1=1, axis2=2) / (2.0 * bodies.mass))
    for row in rows:
        if row.kind == SLIDE and row.coordinate < 0:
            for body, first in ((row.a, 0), (row.b, 6)):
                if body < size.size:
                    size[body] = max(size[body], np.linalg.norm(row.geometry[first : first + 3]))
    inertia = size[:, None, None] ** 2 * np.eye(3)
    return Bodies(np.ones_like(size), inertia, np.eye(3) / size[:, None, None], bodies.node)


# Prescribed motions as bilateral rows with a time law as their target.


def motion_rows(
    mechanism: Mechanism, frames: dict[str, BodyFrame], state: State, laws: dict[str, int]
) -> list[BilateralRow]:
    """Return a row per motion, with violation 0 at the pose of ``state``; ``laws``: number of each law by its owner."""
    rows = []
    for key, motion in mechanism.motions.items():
        against, moved = frames[motion.relative_to or "world"], frames[motion.body]
        a, b = against.index, moved.index
        if isinstance(motion, Translation):
            along, led = against.direction(motion.along.direction), moved.point(motion.along.point)
            start = state.R[a].T @ (state.x[b] + state.R[b] @ led - state.x[a])  # position of the point seen from a
            geometry, kind, arm = [*start, *along, *led], SLIDE, 1.0
        else:
            axis = against.direction(motion.about.axis)
            mark = tangent(axis)
            geometry, kind = [*mark, *axis, *(state.R[b].T @ state.R[a] @ mark)], TURN
            arm = turning_arm(mechanism, [name for name in (motion.relative_to, motion.body) if name])
        acts = active_phases(mechanism, motion.phases)
        rows.append(BilateralRow(key, kind, a, b, np.array(geometry), arm, laws[f"motions.{key}"], acts))
    return rows


# The unknowns of a step in nodes of six: the velocities of the bodies, and the multipliers of bilateral rows.


@dataclass(frozen=True)
class Unknowns:
    """The numbering of the unknowns, and the blocks of a step's system (`engine.friction.blocks`)."""

    system: Elimination
    body: Integers  # (nb,) node of each body's velocities
    at: Integers  # (nt,) index of each row's multiplier among the unknowns
    row_body: Integers  # (nt, 2) nodes of the two bodies that each row acts on; -1: the ground
    row_pair: Integers  # (nt, 2) first piece of each of these nodes with the row's node
    contact_pair: Integers  # (nc,) first piece of the two bodies of each contact; 0 if one of them is the ground
    weight: Integers  # (nc, 3) node of the weight of each contact, -1: none; first pieces with the two bodies, or 0
    coupled: Integers  # (couplings, n, n) first piece of each two members of a coupling


def layout(
    bodies: int,
    rows: list[BilateralRow],
    contacts: Sequence[tuple[int, int]],
    pressed: Sequence[int] = (),
    coupled: Sequence[Sequence[int]] = (),
) -> Unknowns:
    """Return the numbering of the unknowns; up to six successive rows between the same two bodies share a node.

    In ``contacts``, the two bodies of each contact, a number of ``bodies`` or more is the ground. The contacts whose
    numbers are ``pressed`` have a weight or a spring, which is a node of its own. ``coupled`` are the moving bodies of
    each coupling.
    """
    groups: list[list[int]] = []
    for i, row in enumerate(rows):
        last = rows[groups[-1][0]] if groups else None
        if last is None or len(groups[-1]) == BODY or (row.a, row.b) != (last.a, last.b):
            groups.append([])
        groups[-1].append(i)
    first_weight = bodies + len(groups)
    nodes = first_weight + len(pressed)
    neighbours = np.zeros((nodes, nodes), bool)
    for a, b in contacts:
        if a < bodies and b < bodies:
            neighbours[a, b] = neighbours[b, a] = True
    for node, group in enumerate(groups, bodies):
        for body in (rows[group[0]].a, rows[group[0]].b):
            if body < bodies:
                neighbours[node, body] = neighbours[body, node] = True
    for node, i in enumerate(pressed, first_weight):
        for body in contacts[i]:
            if body < bodies:
                neighbours[node, body] = neighbours[body, node] = True
    for members in coupled:
        for a in members:
            for b in members:
                neighbours[a, b] = neighbours[a, b] or a != b
    # multipliers come after their bodies, which alone give them a pivot
    of_rows = (np.arange(nodes) >= bodies) & (np.arange(nodes) < first_weight)
    system, number, piece = eliminate_nodes(neighbours, of_rows)

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
    weight = np.zeros((len(contacts), 3), np.int64)
    weight[:, 0] = -1
    for node, i in enumerate(pressed, first_weight):
        own = [piece[number[body], number[node]] if body < bodies else 0 for body in contacts[i]]
        weight[i] = number[node], *own
    most = max(map(len, coupled), default=0)
    blocks = np.zeros((len(coupled), most, most), np.int64)
    for c, members in enumerate(coupled):
        for s, a in enumerate(members):
            for t, b in enumerate(members):
                blocks[c, s, t] = piece[number[a], number[b]] if s != t else 0
    return Unknowns(system, number[:bodies], at, row_body, row_pair, np.array(pairs, np.int64), weight, blocks)

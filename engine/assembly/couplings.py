"""Couplings of joint coordinates as arrays: two contacts each, NAME.forward and NAME.backward, and their terms."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine.arrays import Array, Integers
from engine.assembly.contacts import NO_TERMS, Pair
from engine.assembly.frames import BodyFrame
from engine.assembly.joints import directions, mate
from engine.kernels.model import COUPLED, GEOMETRY, SLIDE, TURN, State, Terms
from engine.mechanism.couplings import Coupling
from engine.mechanism.joints import Cylindrical, Revolute
from engine.mechanism.models import Mechanism


@dataclass(frozen=True)
class CouplingTerm:
    """One coordinate of a coupling."""

    kind: int  # SLIDE or TURN
    body: tuple[int, int]  # of the first and the second side
    geometry: Array  # (9,) row of `kernels.bilateral`
    factor: float  # that of the first term is 1
    start: float  # displacement at the start


@dataclass(frozen=True)
class JointCoupling:
    """A coupling: its terms, and the moving bodies that it acts on."""

    name: str
    terms: tuple[CouplingTerm, ...]
    members: tuple[int, ...]
    backlash: float
    restitution: float


def joint_couplings(mechanism: Mechanism, frames: dict[str, BodyFrame], state: State) -> list[JointCoupling]:
    """Return the couplings at the start pose."""
    ground = len(state.x) - 1
    found = []
    for name, coupling in mechanism.couplings.items():
        terms = tuple(_terms(mechanism, coupling, frames, state))
        members = dict.fromkeys(body for term in terms for body in term.body if body != ground)
        found.append(JointCoupling(name, terms, tuple(members), coupling.backlash, coupling.restitution))
    return found


def _terms(
    mechanism: Mechanism, coupling: Coupling, frames: dict[str, BodyFrame], state: State
) -> Iterator[CouplingTerm]:
    """Yield the terms of a coupling."""
    for term in coupling.terms:
        joint: Any = mechanism.joints[term.joint]
        place = mate(joint, frames, state.R)
        way, other = directions(joint, place)
        a, b, factor = place.a.index, place.b.index, term.factor / coupling.terms[0].factor
        if isinstance(joint, Revolute) or (isinstance(joint, Cylindrical) and term.of == "angle"):
            yield CouplingTerm(TURN, (a, b), np.concatenate([way["e"], way["n"], other["e"]]), factor, 0.0)
            continue
        p, q = state.x[a] + state.R[a] @ place.point_a, state.x[b] + state.R[b] @ place.point_b
        start = float((state.R[a] @ way["n"]) @ (q - p))
        yield CouplingTerm(SLIDE, (a, b), np.concatenate([place.point_a, way["n"], place.point_b]), factor, start)


def coupling_pairs(couplings: Sequence[JointCoupling]) -> Iterator[Pair]:
    """Yield the two flanks of each coupling."""
    for number, coupling in enumerate(couplings):
        first, second = coupling.members[0], coupling.members[-1]
        for face, flank in (("forward", 1.0), ("backward", -1.0)):
            yield Pair(
                name=f"{coupling.name}.{face}",
                kind=COUPLED,
                a=first,
                b=second,
                geometry_a=np.zeros(GEOMETRY),
                geometry_b=np.zeros(GEOMETRY),
                clearance=0.5 * coupling.backlash,
                law=(0.0, coupling.restitution),
                coupling=number,
                flank=flank,
            )


def term_arrays(couplings: Sequence[JointCoupling], blocks: Integers, runs: int) -> Terms:
    """Return the terms as arrays; ``blocks``, (couplings, n, n), are the first pieces of each two members."""
    if not couplings:
        return NO_TERMS
    terms = [(coupling, term) for coupling in couplings for term in coupling.terms]
    member = np.full((len(couplings), runs), -1, np.int64)
    pair = np.zeros((len(couplings), runs, runs), np.int64)
    for c, coupling in enumerate(couplings):
        n = len(coupling.members)
        member[c, :n] = coupling.members
        pair[c, :n, :n] = blocks[c, :n, :n]
    places = [[c.members.index(body) if body in c.members else -1 for body in term.body] for c, term in terms]
    return Terms(
        first=np.cumsum([0, *(len(coupling.terms) for coupling in couplings)], dtype=np.int64),
        kind=np.array([term.kind for _, term in terms], np.int64),
        body=np.array([term.body for _, term in terms], np.int64),
        geometry=np.array([term.geometry for _, term in terms]),
        factor=np.array([term.factor for _, term in terms]),
        start=np.array([term.start for _, term in terms]),
        angle=np.zeros(len(terms)),
        place=np.array(places, np.int64),
        member=member,
        pair=pair,
    )

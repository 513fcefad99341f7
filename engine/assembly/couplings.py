"""Couplings as contacts, one for each flank: NAME.forward and NAME.backward.

Those of joint coordinates act on all bodies of their joints and have terms; two gears are a pair like any other.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine.arrays import Array, Integers
from engine.assembly.contacts import NO_TERMS, Pair, geometry_row
from engine.assembly.frames import BodyFrame
from engine.assembly.joints import directions, mate
from engine.errors import Fault, MechanismError
from engine.kernels.model import COUPLED, GEARS, SLIDE, TURN, State, Terms
from engine.mechanism.couplings import GearPair, JointCoupling
from engine.mechanism.journals import Cylindrical, Revolute
from engine.mechanism.models import Mechanism

FLANKS = (("forward", 1.0), ("backward", -1.0))
APART = 0.05  # share of the nominal centre distance by which gears may be off it at the start
INCLINED = 0.05  # rad between their axes


@dataclass(frozen=True)
class CouplingTerm:
    """One coordinate of a coupling."""

    kind: int  # SLIDE or TURN
    body: tuple[int, int]  # of the first and the second side
    geometry: Array  # (9,) row of `kernels.bilateral`
    factor: float  # that of the first term is 1
    start: float  # displacement at the start


@dataclass(frozen=True)
class CoupledJoints:
    """A coupling: its terms, and the moving bodies that it acts on."""

    name: str
    terms: tuple[CouplingTerm, ...]
    members: tuple[int, ...]
    backlash: float
    restitution: float


def joint_couplings(mechanism: Mechanism, frames: dict[str, BodyFrame], state: State) -> list[CoupledJoints]:
    """Return the couplings at the start pose."""
    ground = len(state.x) - 1
    found = []
    for name, coupling in mechanism.couplings.items():
        if isinstance(coupling, GearPair):
            continue
        terms = tuple(_terms(mechanism, coupling, frames, state))
        members = dict.fromkeys(body for term in terms for body in term.body if body != ground)
        found.append(CoupledJoints(name, terms, tuple(members), coupling.backlash, coupling.restitution))
    return found


def _terms(
    mechanism: Mechanism, coupling: JointCoupling, frames: dict[str, BodyFrame], state: State
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


def coupling_pairs(couplings: Sequence[CoupledJoints]) -> Iterator[Pair]:
    """Yield the two flanks of each coupling."""
    for number, coupling in enumerate(couplings):
        first, second = coupling.members[0], coupling.members[-1]
        for face, flank in FLANKS:
            yield Pair(
                name=f"{coupling.name}.{face}",
                kind=COUPLED,
                a=first,
                b=second,
                geometry_a=geometry_row(),
                geometry_b=geometry_row(),
                clearance=0.5 * coupling.backlash,
                law=(0.0, coupling.restitution),
                coupling=number,
                flank=flank,
            )


# Gears.


def gear_pairs(mechanism: Mechanism, frames: dict[str, BodyFrame], state: State) -> Iterator[Pair]:
    """Yield the two flanks of each pair of gears, a ring as side b; at the start both have the same gap.

    Raise MechanismError if gears are too far apart or too near each other to mesh, or if their axes are not parallel.
    """
    for name, coupling in mechanism.couplings.items():
        if not isinstance(coupling, GearPair):
            continue
        swapped = coupling.gears[0].internal
        a, b = reversed(coupling.gears) if swapped else coupling.gears
        of_a, of_b = frames[a.body], frames[b.body]
        axis, other = (state.R[frame.index] @ frame.direction(g.direction) for g, frame in ((b, of_b), (a, of_a)))
        if not swapped and axis @ other < 0.0:  # forward is about the axis of the first gear
            axis = -axis
        p, q = (state.x[f.index] + state.R[f.index] @ f.point(g.place) for g, f in ((a, of_a), (b, of_b)))
        across = (q - p) - ((q - p) @ axis) * axis
        apart = float(np.linalg.norm(across))
        _refuse_gears_apart(mechanism, name, coupling, apart, float(np.linalg.norm(np.cross(axis, other))))
        mark, cosine = across / apart, np.cos(coupling.pressure_angle)
        pitch_radii = [0.5 * coupling.module * g.sign * g.teeth for g in (a, b)]
        # of two bodies that grow unlike, teeth of one size that fill as much of the distance: the ratio stays
        grown = (pitch_radii[0] * of_a.scale + pitch_radii[1] * of_b.scale) / sum(pitch_radii)
        base = [radius * grown * cosine for radius in pitch_radii]
        pitch = np.pi * coupling.module * grown * cosine
        involute = np.tan(coupling.pressure_angle) - coupling.pressure_angle
        row_a = geometry_row(of_a.point(a.place), state.R[of_a.index].T @ mark, np.zeros(3), base[0], float(pitch))
        back = state.R[of_b.index].T
        row_b = geometry_row(of_b.point(b.place), back @ axis, back @ mark, base[1])
        for face, flank in FLANKS:
            yield Pair(
                name=f"{name}.{face}",
                kind=GEARS,
                a=of_a.index,
                b=of_b.index,
                geometry_a=row_a,
                geometry_b=row_b,
                clearance=0.5 * coupling.backlash * cosine - sum(base) * involute,
                law=(0.0, coupling.restitution),
                flank=-flank if swapped else flank,
                spring=coupling.spring,
            )


def _refuse_gears_apart(mechanism: Mechanism, name: str, pair: GearPair, apart: float, inclined: float) -> None:
    """Raise an error if gears are off their centre distance, or their axes inclined, by more than teeth allow."""
    unit, nominal, fault = mechanism.unit("length"), pair.centre_distance, None
    if not abs(apart - nominal) <= APART * nominal:
        text = (
            f"the axes are {apart:.6g} {unit} apart at the start; allowed: {nominal:.6g} {unit}, which the numbers of "
        )
        text += f"teeth and the module give, to within {APART:.0%}; move a body, or correct teeth or module"
        fault = Fault(("couplings", name, "gears"), text)
    elif not inclined <= INCLINED:
        text = f"the axes are inclined to each other by a sine of {inclined:.3g}; allowed: parallel axes, to within "
        fault = Fault(("couplings", name, "gears"), f"{text}{INCLINED:g} rad; turn a body, or correct an axis")
    if fault:
        raise MechanismError(f"{mechanism.name}: gears that cannot mesh\n  {fault}", [fault])


# The terms of all couplings as arrays.


def term_arrays(couplings: Sequence[CoupledJoints], blocks: Integers, runs: int) -> Terms:
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

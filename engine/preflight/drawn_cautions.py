"""Cautions about what is drawn and set: springs pressed far at the start, rounds in hollow corners, too little time."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from engine.arrays import Array
from engine.mechanism import Mechanism
from engine.mechanism.closed_profiles import Piece
from engine.mechanism.contacts import OUTLINES, Contact, Side
from engine.preflight.plausibility import Caution

if TYPE_CHECKING:  # slow to import
    from engine.assembly import Assembly

PRESSED = 0.01  # share of the mechanism's extent by which a contact with a stiffness may overlap as drawn
NEAR = 0.5  # share of its radius by which a round may be off a face at the start
SHARP = 0.05  # angle [rad] by which two faces must meet hollow to hold a round on both sides


def time_cautions(mechanism: Mechanism) -> Iterator[Caution]:
    """Yield cautions if the phases last longer than a run may, or the longest step is shorter than the shortest."""
    sim, unit = mechanism.simulation, mechanism.unit("time")
    lasts = sum(phase.duration or 0.0 for phase in mechanism.phases if phase.until is None)
    if lasts > sim.horizon * (1.0 + 1e-9):
        text = f"the phases of a given duration last {lasts:g} {unit} together, so that no run comes to its end"
        yield Caution("simulation.horizon", sim.horizon, unit, text, f"more than {lasts:g} {unit}", "raise it")
    if sim.adaptive and sim.adaptive.longest < sim.step:
        text = f"shorter than simulation.step = {sim.step:g}, which is the shortest step, so that no step grows"
        customary = f"more than {sim.step:g} {unit}"
        yield Caution("simulation.adaptive.longest", sim.adaptive.longest, unit, text, customary, "exchange the two")


def pressed_starts(mechanism: Mechanism, assembly: "Assembly") -> Iterator[Caution]:
    """Yield a caution for each contact with a stiffness whose parts overlap far as drawn, as beyond a turned plane."""
    places = np.concatenate([assembly.state.x[:-1], assembly.work.sites.point])
    extent = 2.0 * float(np.linalg.norm(places - places.mean(axis=0), axis=1).max(initial=0.0))
    force, length = mechanism.unit("force"), mechanism.unit("length")
    for name, contact in mechanism.contacts.items():
        stiffness = contact.spring[0]
        if not stiffness:
            continue
        overlap = max(-float(assembly.state.gap[i]) for i in assembly.numbers(name))
        if overlap > PRESSED * extent and overlap > contact.offset:
            presses = stiffness * overlap ** (1.5 if contact.hertz_stiffness else 1.0)
            text = f"its parts overlap by {overlap:.4g} {length} as drawn, where it presses with {presses:.4g} {force}"
            remedy = "move a part, turn a normal that points into the material, or let it be if that is the preload"
            yield Caution(f"contacts.{name}", text=text, remedy=remedy)


def hollow_corners(mechanism: Mechanism, assembly: "Assembly") -> Iterator[Caution]:
    """Yield a caution for each contact whose round side is at the start in a hollow corner, near both of its faces."""
    from engine.assembly.contacts import row_b
    from engine.assembly.frames import order_bodies, place_bodies

    rounds = [(name, *each) for name, contact in mechanism.contacts.items() for each in _rounds_on_profiles(contact)]
    frames = place_bodies(mechanism, order_bodies(mechanism))[0] if rounds else {}
    x, R, told = assembly.state.x, assembly.state.R, set()
    for name, round_, key, one, other in rounds:
        a, b = frames[one.body], frames[other.body]
        row = row_b(other, b)
        at = x[a.index] + R[a.index] @ a.point(_place(one, round_)) - x[b.index] - R[b.index] @ row[:3]
        u, v = R[b.index] @ row[6:9], R[b.index] @ np.cross(row[3:6], row[6:9])
        centre, radius = complex(at @ u, at @ v) / b.scale, round_.radius * a.scale / b.scale
        corner = next(
            (p for p, q in _corners(other.primitive.curve) if _lies(centre, radius, round_.reach, p, q)), None
        )
        if corner is None or name in told:
            continue
        told.add(name)
        text = f"a round of radius {round_.radius:g} lies at the start in the hollow corner of the profile at "
        text += f"[{corner.end.real:.6g}, {corner.end.imag:.6g}], where it touches two faces, but this contact presses "
        text += "at one point of a round, and jumps from face to face"
        remedy = "divide the profile at this corner into two that share it, and write a contact for each"
        yield Caution(f"contacts.{name}.{key}", text=text, remedy=remedy)


@dataclass(frozen=True)
class _Round:
    """What may lie in corners: a sphere, or an arc of a profile."""

    radius: float
    reach: float  # angle that it spans
    centre: complex | None = None  # in the plane of its profile; None: that of a sphere


def _place(side: Side, round_: _Round) -> Array:
    """Return the centre of a round in the frame of its body."""
    shape = side.primitive
    if round_.centre is None:
        return np.array(shape.centre, float)
    n, e = (np.array(v, float) / np.linalg.norm(v) for v in (shape.axis, shape.along))
    e = (e - (e @ n) * n) / np.linalg.norm(e - (e @ n) * n)
    return np.asarray(shape.point + round_.centre.real * e + round_.centre.imag * np.cross(n, e))


def _rounds_on_profiles(contact: Contact) -> Iterator[tuple[_Round, str, Side, Side]]:
    """Yield what may lie in corners of a profile, the key of this profile, and the sides of the two."""
    first, second = contact.sides
    keys = ("b", "a") if first is contact.a else ("a", "b")  # of what the first and the second side lie on
    if contact.kind == "sphere-extruded":
        yield _Round(first.primitive.radius, math.tau), f"{keys[0]}.extruded", first, second
    elif contact.kind == OUTLINES:
        for one, other, key in ((first, second, keys[0]), (second, first, keys[1])):
            for piece in one.primitive.curve:
                if piece.centre is not None and piece.left:
                    yield _Round(piece.radius, piece.sweep, piece.centre), f"{key}.extruded", one, other


def _corners(curve: tuple[Piece, ...]) -> Iterator[tuple[Piece, Piece]]:
    """Yield the straight pieces of a curve with those that follow them, where these meet hollow."""
    for piece, after in zip(curve, (*curve[1:], curve[0]), strict=True):
        bend = (piece.direction(1.0).conjugate() * after.direction(0.0)).imag
        if piece.centre is None and after.centre is None and bend < -math.sin(SHARP):
            yield piece, after


def _lies(centre: complex, radius: float, reach: float, piece: Piece, after: Piece) -> bool:
    """Return whether a round is near both of two faces that meet hollow, and can touch both within their lengths."""
    turn = abs(float(np.angle(piece.direction(1.0).conjugate() * after.direction(0.0))))  # between their normals
    along = radius * math.tan(0.5 * turn)
    fits = reach >= turn and along < min(abs(piece.end - piece.start), abs(after.end - after.start))
    heights = [((-1j * face.direction(0.0)).conjugate() * (centre - piece.end)).real for face in (piece, after)]
    return fits and all(0.0 < height < (1.0 + NEAR) * radius for height in heights)

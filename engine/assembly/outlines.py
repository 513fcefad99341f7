"""Contacts of two extruded profiles: every corner and round of one against the solid of the other, both ways.

Two outlines that do not overlap are nearest to each other at a convex corner or a convex arc of one of them. Each of
these is a contact of its own. So edges that lie on each other touch at both ends, a tooth touches both sides of its
gap, and no contact jumps from one corner to the next. The middle of each edge is one more: where two edges of the same
length lie on each other, their corners meet and have no normal. All are in one plane: in the middle of the depth that
both solids have in common as drawn.
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from engine.arrays import Array
from engine.assembly.contacts import Pair, curve_pieces, geometry_row, profile_pieces, row_b
from engine.assembly.frames import BodyFrame
from engine.assembly.grain import grain_of
from engine.assembly.table_cache import cached
from engine.errors import Fault, MechanismError
from engine.kernels.model import ON_EXTRUDED, State
from engine.mechanism.contacts import OUTLINES, Side
from engine.mechanism.divided_profiles import divided
from engine.mechanism.models import Mechanism

TILT = 1e-3  # largest angle between the axes as drawn [rad]
OPEN = 1e-3  # angle by which a face may miss being opposite to a corner, edge or arc [rad]
SHALLOW = 1e-5  # share of the outline's size; a corner that is deeper in the other solid is pushed out of any face
FEATURES = ("a", "b"), ("b", "a")


def outline_pairs(mechanism: Mechanism, frames: dict[str, BodyFrame], state: State) -> Iterator[Pair]:
    """Yield the contacts of all pairs of extruded profiles in [contacts], named CONTACT.corner_a0, CONTACT.arc_b3, ...

    Raise MechanismError if the axes of two profiles are not parallel, or their solids pass beside each other.
    """
    for name, features in _outlines(mechanism, frames, state).items():
        contact = mechanism.contacts[name]
        sides, law = {"a": contact.a, "b": contact.b}, mechanism.contact_law(contact)
        offset = contact.offset * frames[contact.a.body].scale
        for feature, (one, other), row, pieces in features:
            yield Pair(
                name=f"{name}.{feature}",
                kind=ON_EXTRUDED,
                a=frames[sides[one].body].index,
                b=frames[sides[other].body].index,
                geometry_a=row,
                geometry_b=row_b(sides[other], frames[sides[other].body]),
                clearance=-offset,
                law=law,
                pieces=pieces,
                sticking=mechanism.static_friction(contact),
                grain=grain_of(mechanism, contact, frames),
                table=f"contacts.{name}",
            )


@cached
def _outlines(
    mechanism: Mechanism, frames: dict[str, BodyFrame], state: State
) -> dict[str, list[tuple[str, tuple[str, str], Array, Array]]]:
    """Return, by contact, name, sides and geometry row of each of their points, and the pieces that it touches."""
    found = {}
    for name, contact in mechanism.contacts.items():
        if contact.kind != OUTLINES:
            continue
        sides = {"a": contact.a, "b": contact.b}
        scales = {key: frames[side.body].scale for key, side in sides.items()}
        pieces = {key: profile_pieces(side, scales[key]) for key, side in sides.items()}
        solids = {key: row_b(side, frames[side.body]) for key, side in sides.items()}
        heights = _heights(mechanism, name, frames, state, solids)
        found[name] = [
            (f"{feature}{part}", (one, other), row, touched)
            for one, other in FEATURES
            for feature, row in _features(one, pieces[one], solids[one], heights[one])
            for part, touched in _touched(sides[other], feature, pieces[other], scales[other])
        ]
    return found


def _touched(other: Side, feature: str, pieces: Array, scale: float) -> Iterator[tuple[str, Array]]:
    """Yield the pieces that a feature touches: an arc those of each part of a profile with notches, others all."""
    parts = divided(other.primitive.curve) if feature.startswith("arc") else []
    if len(parts) < 2:
        yield "", pieces
        return
    for i, part in enumerate(parts):
        yield f".part{i}", curve_pieces(part, scale)


def _features(side: str, pieces: Array, solid: Array, height: float) -> Iterator[tuple[str, Array]]:
    """Yield name and geometry row of every convex corner and arc of a profile, and of its edges' middles."""
    n, u = solid[3:6], solid[6:9]
    v, foot = np.cross(n, u), solid[:3] + height * n
    size = SHALLOW * float(np.hypot(*(pieces[:, :2] - pieces[0, 4:6]).T).max())

    def row(*numbers: Any, half: float = 0.0) -> Array:
        found = geometry_row(*numbers)
        found[11:] = size, math.cos(min(half + OPEN, math.pi))
        return found

    for i, piece in enumerate(pieces):
        line, before = piece[7] == 0.0, pieces[i - 1]
        if piece[17] > 0.0:  # between the directions out of the two pieces that meet there
            half = 0.5 * math.acos(max(-1.0, min(float(_out(before, 1.0) @ _out(piece, 0.0)), 1.0)))
            yield f"corner_{side}{i}", row(foot + piece[:2] @ (u, v), piece[13:15] @ (u, v), half=half)
        if line:
            yield f"edge_{side}{i}", row(foot + piece[4:6] @ (u, v), _out(piece, 0.0) @ (u, v))
        elif piece[7] > 0.0:
            half = 2.0 * math.atan(piece[12])
            yield f"arc_{side}{i}", row(foot + piece[8:10] @ (u, v), n, piece[10:12] @ (u, v), piece[7], half)


def _out(piece: Array, share: float) -> Array:
    """Return the unit normal out of the material at the start (0) or at the end (1) of a piece."""
    if piece[7] == 0.0:
        return np.array([piece[9], -piece[8]])
    away = (piece[2:4] if share else piece[:2]) - piece[8:10]
    return np.asarray(away / piece[7])


def _heights(
    mechanism: Mechanism, name: str, frames: dict[str, BodyFrame], state: State, solids: dict[str, Array]
) -> dict[str, float]:
    """Return the height of the common plane along the axis of each solid, from its origin."""
    contact = mechanism.contacts[name]
    at = {"a": frames[contact.a.body].index, "b": frames[contact.b.body].index}
    place = {key: state.x[at[key]] + state.R[at[key]] @ row[:3] for key, row in solids.items()}
    axis = {key: state.R[at[key]] @ row[3:6] for key, row in solids.items()}
    half = {key: float(row[9]) for key, row in solids.items()}
    tilt = float(np.linalg.norm(np.cross(axis["a"], axis["b"])))
    if not tilt <= TILT:
        text = f"its axis is inclined by {math.asin(min(tilt, 1.0)):.6g} rad to that of side a at the start; allowed: "
        text += f"up to {TILT:g}, as two profiles touch in one plane; correct an axis, or turn a body"
        raise _fault(mechanism, name, "axis", text)
    apart = float(axis["a"] @ (place["b"] - place["a"]))
    low, high = max(-half["a"], apart - half["b"]), min(half["a"], apart + half["b"])
    if not low < high:
        beside = f"{low - high:.6g} {mechanism.unit('length')}"
        text = f"passes beside the solid of side a, {beside} along its axis; allowed: solids with a depth in common; "
        text += "move one of the two, or make it longer"
        raise _fault(mechanism, name, "half_length", text)
    middle = 0.5 * (low + high) if high < math.inf else 0.0
    return {"a": middle, "b": math.copysign(1.0, float(axis["a"] @ axis["b"])) * (middle - apart)}


def _fault(mechanism: Mechanism, name: str, key: str, text: str) -> MechanismError:
    value = getattr(mechanism.contacts[name].b.primitive, key)
    fault = Fault(("contacts", name, "b", "extruded", key), text, value)
    return MechanismError(f"{mechanism.name}: two profiles that cannot touch\n  {fault}", [fault])

"""Contact pairs as arrays: first those of joints with clearance, then those in the file's [contacts].

Their primitives become geometry rows from the centre of mass (table in `kernels.contact_geometry.gaps`), their profiles
rows of `kernels.contact_geometry.solids`, one per line or arc.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from engine.arrays import Array, Integers
from engine.assembly.frames import BodyFrame, tangent
from engine.assembly.grain import grain_arrays, grain_of
from engine.assembly.hulls import hull_arrays
from engine.assembly.surface_trees import joined_surfaces, surface_tree
from engine.assembly.table_cache import cached
from engine.kernels.model import (
    ARC_PLANE,
    BOXES,
    CYLINDER_PLANE,
    GEOMETRY,
    ON_BALL,
    ON_DISC,
    ON_EXTRUDED,
    ON_RECTANGLE,
    ON_ROUND,
    ON_SURFACE,
    ON_TURNED,
    PIECE,
    POINT_PLANE,
    RING_BORE,
    ROUNDS,
    Contacts,
    Laws,
    Surfaces,
    Terms,
)
from engine.mechanism.closed_profiles import Piece, off_axis
from engine.mechanism.contacts import PAIRS, SEVERAL, Contact, Side
from engine.mechanism.divided_profiles import divided
from engine.mechanism.meshes.polyhedra import Polyhedron
from engine.mechanism.models import Mechanism
from engine.mechanism.surfaces.patches import mean_direction

NO_PIECES = np.zeros((0, PIECE))
SMOOTH = 1e-9  # sine of the angle at a joint; a smaller one is no corner

ENDLESS = math.inf

_SOLIDS = {
    "cylinder": ON_ROUND,
    "bore": ON_ROUND,
    "disc": ON_DISC,
    "rectangle": ON_RECTANGLE,
    "sphere": ON_BALL,
    "socket": ON_BALL,
    "turned": ON_TURNED,
    "extruded": ON_EXTRUDED,
    "surface": ON_SURFACE,
    "capsule": ON_TURNED,
    "box": ON_RECTANGLE,
}
_PLANES = {"point": POINT_PLANE, "sphere": POINT_PLANE, "arc": ARC_PLANE, "cylinder": CYLINDER_PLANE}

KINDS = {
    pair: RING_BORE if pair == "ring-cylinder" else _PLANES[first] if second == "plane" else _SOLIDS[second]
    for pair in PAIRS
    for first, second in [pair.split("-")]
}
"""The number of every supported pair of primitives."""


def profile_pieces(side: Side, scale: float = 1.0) -> Array:
    """Return the pieces of a side's profile, (np, PIECE), with its lengths times ``scale``; empty if it has none."""
    return curve_pieces(side.primitive.curve, scale) if side.kind in ("turned", "extruded", "capsule") else NO_PIECES


def curve_pieces(curve: Sequence[Piece], scale: float) -> Array:
    """Return the rows of the pieces of a closed curve, (np, PIECE), with their lengths times ``scale``."""
    rows = np.array([_piece_row(piece, curve[i - 1], curve[(i + 1) % len(curve)]) for i, piece in enumerate(curve)])
    rows[:, :8] *= scale
    rows[rows[:, 7] != 0.0, 8:10] *= scale  # the centres of arcs; a line has its direction there
    return rows


def _piece_row(piece: Piece, before: Piece, after: Piece) -> list[float]:
    """Return the row of a piece; where it ends on the axis of a turned solid, its mirror image is its neighbour."""
    middle, reach, place, way = 0.5 * (piece.start + piece.end), 0.5 * abs(piece.end - piece.start), 0j, 0j
    radius = piece.radius if piece.left else -piece.radius
    if piece.centre is None:
        place = piece.direction(0.0)
    else:
        place, way = piece.centre, complex(piece.point(0.5) - piece.centre) / piece.radius
        if piece.sweep > math.pi:
            middle, reach = piece.centre, piece.radius
    one, other = piece.direction(0.0), piece.direction(1.0)
    start, bend = _corner(before.direction(1.0) if before.end == piece.start else one.conjugate(), one)
    end, bow = _corner(other, after.direction(0.0) if after.start == piece.end else other.conjugate())
    numbers = (piece.start, piece.end, middle, reach, radius, place, way, math.tan(piece.sweep / 4), start, end)
    flat = [x for number in numbers for x in ((number.real, number.imag) if isinstance(number, complex) else (number,))]
    return [*flat, bend, bow]


def _corner(before: complex, after: complex) -> tuple[complex, float]:
    """Return the direction bisecting the normals of two pieces, and 1 for a convex corner, -1, or 0 if smooth."""
    halfway, bend = -1j * (before + after), (before.conjugate() * after).imag
    return halfway / abs(halfway), 0.0 if abs(bend) <= SMOOTH else math.copysign(1.0, bend)


NO_TABLES: Mapping[str, int] = MappingProxyType({})
NO_TERMS = Terms(
    first=np.zeros(1, np.int64),
    kind=np.zeros(0, np.int64),
    body=np.zeros((0, 2), np.int64),
    geometry=np.zeros((0, 9)),
    factor=np.zeros(0),
    start=np.zeros(0),
    angle=np.zeros(0),
    place=np.zeros((0, 2), np.int64),
    member=np.zeros((0, 0), np.int64),
    pair=np.zeros((0, 0, 0), np.int64),
)


@dataclass(frozen=True)
class Pair:
    """A potential contact: two primitives on two bodies."""

    name: str  # unique, for messages and trajectories
    kind: int  # number of the pair of primitives, see `kernels.model`
    a: int  # index of a body, as is b
    b: int
    geometry_a: Array  # (GEOMETRY,) row of `kernels.contact_geometry.gaps`, as is geometry_b
    geometry_b: Array
    clearance: float  # added to the distance to give the gap; for a contact of a joint, without the joint's play
    law: tuple[float, float]  # friction and restitution
    pieces: Array = field(default_factory=NO_PIECES.copy)  # (np, PIECE) of side b's profile; empty: it has none
    play: tuple[str, str] | None = None  # the joint and its face, for `joints.add_play`
    surface: Surfaces | None = None  # the tree of side b, if that is a surface
    hulls: tuple[Polyhedron, Polyhedron] | None = None  # the convex polyhedra of both sides, of the kind HULLS
    bound: float = 0.0  # the largest force or torque of friction in an ideal joint; 0: friction follows from the law
    breakaway: float = 0.0  # the same of a joint that sticks
    partner: int = -1  # number of the contact whose rolling or spinning it resists; -1: none
    arm: float = 0.0  # its largest moment per normal force of that contact
    coupling: int = -1  # the number of the coupling of which it is a flank; -1: none
    flank: float = 0.0  # 1 or -1, the side of the coordinate that it limits
    spring: tuple[float, float] = (0.0, 0.0)  # stiffness and damping; 0: rigid
    hertz: bool = False  # whether the stiffness is that of Hertz
    sticking: float = 0.0  # coefficient of friction of a contact that sticks; below that of the law: the same
    grain: tuple[float, ...] | None = None  # direction, body and ratio of friction, see `grain.grain_of`
    table: str = ""  # the key of what may have a table of its friction over the sliding speed


@cached
def contact_geometry(mechanism: Mechanism, frames: dict[str, BodyFrame]) -> list[tuple[Array, Array, float]]:
    """Return the rows of the two sides of each contact in [contacts], and the length added to their distance."""
    sides = [(contact, *contact.sides) for _, contact in single_contacts(mechanism)]
    return [rows(contact, frames[a.body], frames[b.body]) for contact, a, b in sides]


@cached
def contact_profiles(mechanism: Mechanism, frames: dict[str, BodyFrame]) -> list[list[Array]]:
    """Return the pieces of side b's profile for each contact in [contacts], (np, PIECE), or of each of its parts."""
    sides = [contact.sides for _, contact in single_contacts(mechanism)]
    return [_parts(one, other, frames[other.body].scale) for one, other in sides]


def _parts(one: Side, other: Side, scale: float) -> list[Array]:
    """Return the pieces of a profile, part by part where side ``one`` is a ball or an arc, which fits into notches."""
    if one.kind not in ("sphere", "arc") or other.kind not in ("turned", "extruded"):
        return [profile_pieces(other, scale)]
    if other.kind == "extruded":
        return [curve_pieces(part, scale) for part in divided(other.primitive.curve)]
    return [curve_pieces(off_axis(part), scale) for part in divided(other.primitive.closed)]


@cached
def surface_trees(mechanism: Mechanism, frames: dict[str, BodyFrame]) -> dict[str, Surfaces]:
    """Return the trees of the surfaces in [contacts], by contact; equal surfaces of a body share one tree."""
    sides = {name: contact.sides[1] for name, contact in mechanism.contacts.items()}
    found = {name: (side.body, side.primitive) for name, side in sides.items() if side.kind == "surface"}
    trees = {key: surface_tree(key[1], frames[key[0]]) for key in dict.fromkeys(found.values())}
    return {name: trees[key] for name, key in found.items()}


def single_contacts(mechanism: Mechanism) -> list[tuple[str, Contact]]:
    """Return the contacts in [contacts] that touch at one point, with their names; not those that touch at several."""
    return [(name, contact) for name, contact in mechanism.contacts.items() if contact.kind not in SEVERAL]


def contact_pairs(mechanism: Mechanism, frames: dict[str, BodyFrame]) -> Iterator[Pair]:
    """Yield the contacts in [contacts] that touch at one point, or of a profile with notches at one of each part.

    The latter are named CONTACT.part0, CONTACT.part1, ...
    """
    geometry, profiles = contact_geometry(mechanism, frames), contact_profiles(mechanism, frames)
    trees = surface_trees(mechanism, frames)
    for (name, contact), (geometry_a, geometry_b, clearance), parts in zip(
        single_contacts(mechanism), geometry, profiles, strict=True
    ):
        a, b = contact.sides
        for number, pieces in enumerate(parts):
            yield Pair(
                name=name if len(parts) == 1 else f"{name}.part{number}",
                kind=KINDS[contact.kind],
                a=frames[a.body].index,
                b=frames[b.body].index,
                geometry_a=geometry_a,
                geometry_b=geometry_b,
                clearance=clearance,
                law=mechanism.contact_law(contact),
                sticking=mechanism.static_friction(contact),
                grain=grain_of(mechanism, contact, frames),
                table=f"contacts.{name}",
                pieces=pieces,
                surface=trees.get(name),
                spring=contact.spring,
                hertz=contact.hertz_stiffness is not None,
            )


def contact_arrays(
    pairs: list[Pair],
    block: Integers,
    weight: Integers | None = None,
    terms: Terms = NO_TERMS,
    tables: Mapping[str, int] = NO_TABLES,
) -> tuple[Contacts, Laws]:
    """Return the pairs as arrays; ``block``: the place of each pair of bodies in the system of a step.

    ``weight``, (nc, 3), is the node of each contact's weight or spring, and its places in the system; None: none.
    ``terms`` are those of all couplings, and ``tables`` the numbers of the tables of friction by key.
    """
    laws = np.array([pair.law for pair in pairs], float).reshape(-1, 2)
    blocks = {id(pair.pieces): pair.pieces for pair in pairs if len(pair.pieces)}  # some share one profile
    ends = dict(zip(blocks, np.cumsum([len(each) for each in blocks.values()]).tolist(), strict=True))
    profile = [(ends[id(p)] - len(p), ends[id(p)]) if len(p) else (0, 0) for p in (pair.pieces for pair in pairs)]
    root, surfaces = joined_surfaces([pair.surface for pair in pairs])
    resisted = any(pair.arm for pair in pairs)
    grain, larger = grain_arrays([pair.grain for pair in pairs])
    contacts = Contacts(
        kind=np.array([pair.kind for pair in pairs], np.int64),
        a=np.array([pair.a for pair in pairs], np.int64),
        b=np.array([pair.b for pair in pairs], np.int64),
        geometry_a=np.array([pair.geometry_a for pair in pairs]).reshape(-1, GEOMETRY),
        geometry_b=np.array([pair.geometry_b for pair in pairs]).reshape(-1, GEOMETRY),
        clearance=np.array([pair.clearance for pair in pairs], float),
        reach=np.array([reach(pair.geometry_a) + _half_length(pair) for pair in pairs], float),
        pair=block,
        profile=np.array(profile, np.int64).reshape(-1, 2),
        piece=np.concatenate([NO_PIECES, *blocks.values()]),
        surface=root,
        surfaces=surfaces,
        hulls=hull_arrays([pair.hulls for pair in pairs]),
        coupling=np.array([pair.coupling for pair in pairs], np.int64),
        flank=np.array([pair.flank for pair in pairs], float),
        terms=terms,
        bound=np.array([pair.bound for pair in pairs], float),
        breakaway=np.array([pair.breakaway for pair in pairs], float),
        partner=np.array([pair.partner for pair in pairs] if resisted else [], np.int64),
        arm=np.array([pair.arm for pair in pairs] if resisted else [], float),
        stiffness=np.array([pair.spring[0] for pair in pairs], float),
        damping=np.array([pair.spring[1] for pair in pairs], float),
        hertz=np.array([pair.hertz for pair in pairs], bool),
        grain=grain,
        weight=np.tile([-1, 0, 0], (len(pairs), 1)) if weight is None else weight,
    )
    mu = larger * laws[:, 0]
    table = np.array([tables.get(pair.table, -1) for pair in pairs], np.int64)
    resting = larger * np.array([pair.sticking for pair in pairs], float)
    sticking = np.where(table >= 0, resting, np.maximum(mu, resting))
    has_tables = bool((table >= 0).any())
    return contacts, Laws(
        mu,
        np.ascontiguousarray(laws[:, 1]),
        sticking if has_tables or (sticking > mu).any() else np.zeros(0),
        table if has_tables else np.zeros(0, np.int64),
    )


def reach(geometry: Array) -> float:
    """Return the largest distance of side a's point, arc or axis from its body's centre of mass, without skins."""
    with np.errstate(over="ignore"):  # an infinite reach is a valid bound: that contact is always near
        return float(np.linalg.norm(geometry[:3]) + geometry[9])


def _half_length(pair: Pair) -> float:
    """Return how much farther side a reaches than its radius: the row of a line or a box has its middle."""
    row = pair.geometry_a
    return float(row[10] if pair.kind == ROUNDS else np.linalg.norm(row[9:12]) if pair.kind == BOXES else 0.0)


def rows(contact: Contact, frame_a: BodyFrame, frame_b: BodyFrame) -> tuple[Array, Array, float]:
    """Return the rows of a contact's two sides, shape (GEOMETRY,) each, and the length added to their distance.

    This length is minus the contact's offset and minus the skin of side a, i.e. the radius of a sphere or of a rounded
    edge; for a ring around a cylinder it is the radial clearance between them.
    """
    a, b = contact.sides
    row, skin = _row_a(a, frame_a)
    offset = contact.offset * (frame_a if contact.a is a else frame_b).scale
    if contact.kind == "ring-cylinder":
        pin = b.primitive
        n = frame_b.direction(pin.axis)
        radius = frame_b.scale * pin.radius
        return row, geometry_row(frame_b.point(pin.point), n, tangent(n), radius), skin - radius - offset
    return row, row_b(b, frame_b), -skin - offset


def _row_a(side: Side, frame: BodyFrame) -> tuple[Array, float]:
    """Return the row of side a, and its skin."""
    shape, scale = side.primitive, frame.scale
    if side.kind == "point":
        return geometry_row(frame.point(shape)), 0.0
    if side.kind in ("sphere", "ring"):
        return geometry_row(frame.point(shape.centre)), scale * shape.radius
    if side.kind == "arc":
        n = frame.direction(shape.normal)
        e = tangent(n) if shape.middle is None else _across(n, frame.direction(shape.middle))
        row = geometry_row(frame.point(shape.centre), n, e, scale * shape.radius, shape.half_angle)
        return row, scale * shape.edge_radius
    n = frame.direction(shape.axis)  # a cylinder, represented by its circle at mid-height
    return geometry_row(frame.point(shape.point), n, tangent(n), scale * shape.radius, math.pi), 0.0


def row_b(side: Side, frame: BodyFrame) -> Array:
    """Return the row of side b: place, axis, tangent and bounds."""
    shape, scale = side.primitive, frame.scale
    if side.kind == "surface":
        middle, pole = mean_direction(shape.top)
        return plane_row(frame.point(middle), frame.direction(pole))
    if side.kind in ("sphere", "socket"):
        pole = np.array([0.0, 0.0, 1.0])
        bounds = _walls(scale * shape.radius, side.kind == "socket")
        return geometry_row(frame.point(shape.centre), pole, tangent(pole), *bounds, -ENDLESS, ENDLESS)
    if side.kind in ("cylinder", "bore"):
        n, half = frame.direction(shape.axis), ENDLESS if shape.half_length is None else scale * shape.half_length
        walls = _walls(scale * shape.radius, side.kind == "bore")
        return geometry_row(frame.point(shape.point), n, tangent(n), *walls, -half, half)
    if side.kind in ("turned", "capsule"):
        return plane_row(frame.point(shape.point), frame.direction(shape.axis))
    if side.kind == "extruded":
        n, half = frame.direction(shape.axis), ENDLESS if shape.half_length is None else scale * shape.half_length
        return geometry_row(frame.point(shape.point), n, _across(n, frame.direction(shape.along)), half)
    n = frame.direction(shape.normal)
    if side.kind == "box":
        x, y, z = (scale * half for half in shape.half_lengths)
        return geometry_row(frame.point(shape.centre), n, _across(n, frame.direction(shape.along)), x, y, -z, z)
    if side.kind == "plane":
        return plane_row(frame.point(shape.point), n)
    if side.kind == "disc":
        depth = scale * (shape.radius if shape.depth is None else shape.depth)
        return geometry_row(frame.point(shape.centre), n, tangent(n), -ENDLESS, scale * shape.radius, -depth, 0.0)
    depth = scale * (min(shape.half_lengths) if shape.depth is None else shape.depth)
    e = _across(n, frame.direction(shape.along))
    return geometry_row(frame.point(shape.centre), n, e, *(scale * half for half in shape.half_lengths), -depth, 0.0)


def geometry_row(*numbers: Any) -> Array:
    """Return numbers and vectors as a row, padded with zeros."""
    row, at = np.zeros(GEOMETRY), 0
    for part in numbers:
        size = 1 if isinstance(part, float | int) else len(part)
        row[at : at + size] = part
        at += size
    return row


def plane_row(point: Array, normal: Array) -> Array:
    """Return the row of a plane, or of what has an axis and no bounds."""
    return geometry_row(point, normal, tangent(normal))


def _walls(radius: float, hollow: bool) -> tuple[float, float]:
    """Return the smallest and largest distance of a round solid's material from its axis."""
    return (radius, ENDLESS) if hollow else (-ENDLESS, radius)


def _across(n: Array, direction: Array) -> Array:
    """Return the unit vector perpendicular to n that is nearest to a direction."""
    e = direction - (direction @ n) * n
    return np.asarray(e / np.linalg.norm(e))

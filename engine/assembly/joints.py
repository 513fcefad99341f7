"""Joints with play as contact pairs, named JOINT.FACE (paper, section 3.1); ideal ones as rows, stops and friction."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from engine.arrays import Array
from engine.assembly.bilateral import BilateralRow, turning_arm
from engine.assembly.contacts import KINDS, Pair, geometry_row, plane_row, row_b
from engine.assembly.frames import BodyFrame, tangent
from engine.kernels.model import JOINT_FRICTION, ONE_WAY, POINT_PLANE, RING_BORE, SLIDE, TURN
from engine.mechanism.base import TableModel
from engine.mechanism.contacts import Side, Socket
from engine.mechanism.joints import Joint, Prismatic, Spherical
from engine.mechanism.journals import Revolute, ring_of
from engine.mechanism.models import Mechanism

# The directions along which the points are held, and those about which the bodies are held. n is the joint's axis or
# normal in the first body; e and f are perpendicular to it.
HELD = {
    "revolute": ("nef", "ef"),
    "cylindrical": ("ef", "ef"),
    "prismatic": ("ef", "efn"),
    "spherical": ("nef", ""),
    "planar": ("n", "ef"),
    "fixed": ("nef", "efn"),
    "bushing": ("", ""),  # see bushings.py, as for a beam
    "beam": ("", ""),
}

# A pin in an elastic ring is pressed by so many springs around it. From three on their stiffness is the same in all
# directions, and the sum of their forces that of the pressure all round; more limit a pin with play more like a circle.
PADS = 8

MOST_SHAPES = 1000  # kept in memory
FaceWithPlay = tuple[int, str, str, float]  # number of a contact, its joint, the joint's face, stretch of its body
_shapes: dict[Any, Any] = {}
_same_objects: dict[Any, tuple[Any, Joint]] = {}  # shapes by the identity of what a joint consists of


@dataclass(frozen=True)
class Mate:
    """The two sides of a joint, and their relative rotation."""

    a: BodyFrame
    b: BodyFrame
    point_a: Array  # (3,) from the origin of the state's frame of a, as is point_b for b
    point_b: Array
    relative: Array  # (3, 3) from a's axes to b's at the start

    def align(self, along_a: Array, along_b: Array) -> Array:
        """Return the direction of b or its opposite, whichever agrees with a's direction at the start."""
        return along_b if (self.relative @ along_a) @ along_b >= 0 else -along_b


def mate(joint: Any, frames: dict[str, BodyFrame], R: Array) -> Mate:
    """Return the two sides of a joint; ``R``, shape (nb + 1, 3, 3), holds the rotations at the start."""
    first, second = joint.sides
    a, b = frames[first.body], frames[second.body]
    return Mate(a, b, a.point(first.place), b.point(second.place), R[b.index].T @ R[a.index])


def joint_pairs(mechanism: Mechanism, frames: dict[str, BodyFrame], R: Array) -> Iterator[Pair]:
    """Yield the contacts of joints with play, and the stops and the friction of ideal ones; ``R`` as of `mate`."""
    for name, joint in mechanism.joints.items():
        if joint.ideal:
            place = mate(joint, frames, R)
            yield from _stops(name, joint, place)
            yield from _directed(name, joint, place)
            continue
        place, law = mate(joint, frames, R), mechanism.contact_law(joint)
        for face, kind, sides, geometry_a, geometry_b in _faces(joint, place):
            yield Pair(
                name=f"{name}.{face}",
                kind=kind,
                a=sides[0].index,
                b=sides[1].index,
                geometry_a=geometry_a,
                geometry_b=geometry_b,
                clearance=_drawn_gap(joint, place, face),
                law=(law[0], 0.0) if _ring_spring(joint, face)[0] else law,
                play=(name, face),
                spring=_ring_spring(joint, face),
                sticking=mechanism.static_friction(joint),
                table=f"joints.{name}",
            )


def _ring_spring(joint: Any, face: str) -> tuple[float, float]:
    """Return stiffness and damping of one of the springs around the pin in an elastic ring; 0: a rigid face."""
    stiffness = getattr(joint, "ring_stiffness", None)
    if stiffness is None or not face.startswith("ring"):
        return 0.0, 0.0
    return 2.0 * stiffness / PADS, 2.0 * (joint.ring_damping or 0.0) / PADS


def _drawn_gap(joint: Any, place: Mate, face: str) -> float:
    """Return what is added to the distance of two faces for their gap, without the joint's play.

    It is minus the radius of a ball; at a ring it is what bore and pin, alike in the file, differ by in their stretch.
    """
    if isinstance(joint, Spherical):
        return -place.b.scale * (joint.ball.radius or 0.0)
    if not face.startswith("ring"):
        return 0.0
    shaft = getattr(joint, "shaft", None)
    radius = joint.radii[ring_of(face)] if shaft is None else shaft.radius
    added = [place.a.scale * lobes.offset for lobes in _lobes(joint)[:1] if lobes is not None]
    added += [place.b.scale * lobes.offset for lobes in _lobes(joint)[1:] if lobes is not None]
    if getattr(joint, "ring_stiffness", None) is not None:
        added.append(place.a.scale * min(joint.radii))
    return float(radius * (place.a.scale - place.b.scale) + sum(added))


def _lobes(joint: Any) -> list[Any]:
    """Return the lobes of bore and pin, None for a round one."""
    return [getattr(side, "lobes", None) for side in joint.sides]


def _stops(name: str, joint: Any, place: Mate) -> Iterator[Pair]:
    """Yield the stops of an ideal joint: a point of the second side against a plane of the first.

    For a rotation the point lies at a radius of 1 from the axis, so that the number of its force is that of the torque.
    The gap is then the sine of the angle to the stop, which is why the stops are less than half a turn apart.
    """
    limits = getattr(joint, "limits", None)
    if limits is None:
        return
    way, other = directions(joint, place)
    for face, side, limit in (("lower", 1.0, limits.lower), ("upper", -1.0, limits.upper)):
        if limit is None:
            continue
        point, plane = place.point_b, plane_row(place.point_a + place.a.scale * limit * way["n"], side * way["n"])
        if isinstance(joint, Revolute):
            point = point + other["e"]
            plane = plane_row(place.point_a, side * (np.cos(limit) * way["f"] - np.sin(limit) * way["e"]))
        law = 0.0, limits.restitution
        spring = limits.stiffness or 0.0, limits.damping or 0.0
        bodies = place.b.index, place.a.index
        yield Pair(f"{name}.{face}", POINT_PLANE, *bodies, geometry_row(point), plane, 0.0, law, spring=spring)


def _directed(name: str, joint: Any, place: Mate) -> Iterator[Pair]:
    """Yield what the direction of an ideal joint's motion meets: its friction, and the one way it may go.

    For a rotation the point lies at a radius of 1 from the axis, like that of a stop.
    """
    bounds = {key: getattr(joint, key, None) for key in ("friction_force", "friction_torque")}
    ways = {"one_way": getattr(joint, "one_way", None)}
    for face, value in (*bounds.items(), *ways.items()):
        if value is None:
            continue
        turns = face == "friction_torque" or (face == "one_way" and isinstance(joint, Revolute))
        way, other = directions(joint, place)
        point = place.point_b + (other["e"] if turns else 0.0)
        sign = -1.0 if value == "backward" else 1.0
        axis = geometry_row(place.point_a, way["n"], np.zeros(3), float(turns), sign)
        kind, law = (ONE_WAY, (0.0, 0.0)) if face == "one_way" else (JOINT_FRICTION, (1.0, 0.0))
        bound = 0.0 if face == "one_way" else value
        breakaway = getattr(joint, face.replace("friction", "breakaway"), None) or bound
        bodies = place.b.index, place.a.index
        at, row = f"{name}.{face}", geometry_row(point)
        yield Pair(at, kind, *bodies, row, axis, 0.0, law, bound=bound, breakaway=breakaway if bound else 0.0)


FaceRow = tuple[str, int, tuple[BodyFrame, BodyFrame], Array, Array]


def _faces(joint: Any, place: Mate) -> Iterator[FaceRow]:
    """Yield the faces of a joint: name, kind of pair, the two bodies, and their geometry rows."""
    if isinstance(joint, Prismatic):
        if joint.block is not None:
            yield from _block_in_slot(joint, place)
        elif joint.shaft is not None:
            radii = (joint.shaft.radius,) * len(joint.shaft.rings)
            yield from _rings(joint, place, joint.shaft.rings, radii)
        return
    if isinstance(joint, Spherical):
        yield _ball_in_socket(joint, place)
        return
    yield from _rings(joint, place, joint.rings or (), joint.radii)
    if isinstance(joint, Revolute) and joint.flanges is not None:
        yield from _flanges(joint, place)


def _rings(joint: Any, place: Mate, stations: tuple[float, ...], radii: tuple[float, ...]) -> Iterator[FaceRow]:
    """Yield the rings of the first side around the cylinder on the axis of the second.

    The arcs of a bore with lobes are rings about their own centres, and so are the lobes of a pin cylinders: a pin that
    is the convex hull of discs lies in a bore that is the intersection of discs if each lies in each.
    """
    along, axis = place.a.direction(joint.axes[0]), place.b.direction(joint.axes[1])
    off = getattr(joint, "ring_offsets", None)
    bore, pin = _centres(joint, 0, place.a), _centres(joint, 1, place.b)
    many, small = len(bore) * len(pin) > 1, _lobes(joint)[1]
    for i, (station, radius) in enumerate(zip(stations, radii, strict=True)):
        for n, (of_bore, of_pin) in enumerate(product(bore, pin)):
            a, b = place.point_a + place.a.scale * station * along, place.point_b
            if of_bore is not None:
                a = a - of_bore
            if off is not None:
                a = a + place.a.scale * place.a.rotation @ np.array(off[i])
            if of_pin is not None:
                b = b + of_pin
            name = f"ring{i + 1}_{n + 1}" if many else f"ring{i + 1}"
            pin_radius = place.b.scale * (radius - small.offset if small is not None else radius)
            row_of_pin = geometry_row(b, axis, tangent(axis), float(pin_radius))
            yield name, RING_BORE, (place.a, place.b), geometry_row(a), row_of_pin


def _centres(joint: Any, side: int, frame: BodyFrame) -> list[Array | None]:
    """Return the vectors from the axis to the narrowest places of a bore or the tips of a pin; None: a round one.

    An elastic bore has one for each of its springs.
    """
    lobes, line = _lobes(joint)[side], joint.sides[side]
    if side == 0 and getattr(joint, "ring_stiffness", None) is not None:
        # each spring is a ring about a centre far off the axis, on which the direction of its force is certain
        angles = 2.0 * np.pi * np.arange(PADS) / PADS
        return [frame.scale * min(joint.radii) * frame.rotation @ np.array(line.across(angle)) for angle in angles]
    if lobes is None:
        return [None]
    return [frame.scale * lobes.offset * frame.rotation @ np.array(line.across(angle)) for angle in lobes.angles]


def _flanges(joint: Any, place: Mate) -> Iterator[FaceRow]:
    """Yield three points of each end face of the bearing against the journal's adjacent flange (paper, figure 8).

    Each flange touches its end face when the journal is centred; the clearance is a number added to the gap.
    """
    along = place.a.direction(joint.axes[0])
    axis, size = place.align(along, place.b.direction(joint.axes[1])), place.a.scale
    zero = place.a.direction(_across(joint.axes[0]))
    for side, station in joint.flange_stations.items():
        toward = axis if side == "start" else -axis
        for i in range(3):
            angle = joint.flanges.phase + i * 2 * np.pi / 3
            way = np.cos(angle) * zero + np.sin(angle) * np.cross(along, zero)
            point = place.point_a + size * station * along + size * joint.flanges.radius * way
            plane = plane_row(place.point_b + place.b.scale * station * axis, toward)
            yield f"flange_{side}{i + 1}", POINT_PLANE, (place.a, place.b), geometry_row(point), plane


def _block_in_slot(joint: Any, place: Mate) -> Iterator[FaceRow]:
    """Yield the corners of the block against the faces of the slot, four per face.

    They touch when the block is centred; the clearances are numbers added to the gaps.
    """
    half = joint.block.half_length, joint.block.half_height, joint.block.half_width
    guide, slider = _edges(place.a, joint.guide), _edges(place.b, joint.slider)
    slider = [place.align(g, s) for g, s in zip(guide, slider, strict=True)]
    for k, clearance, faces in ((1, joint.clearance, ("bottom", "top")), (2, joint.width_clearance, ("left", "right"))):
        m = 3 - k
        for face, side in zip(faces, (-1, 1), strict=True) if clearance is not None else ():
            plane = plane_row(place.point_a + place.a.scale * side * half[k] * guide[k], -side * guide[k])
            for i, (p, q) in enumerate(((-1, -1), (1, -1), (1, 1), (-1, 1))):
                corner = side * half[k] * slider[k] + p * half[0] * slider[0] + q * half[m] * slider[m]
                at = place.point_b + place.b.scale * corner
                yield f"{face}{i + 1}", POINT_PLANE, (place.b, place.a), geometry_row(at), plane


def _edges(frame: BodyFrame, side: Any) -> list[Array]:
    """Return the directions of the length, height and width of a block or slot."""
    along, up = frame.direction(side.direction), frame.direction(side.normal)
    up = up - (up @ along) * along
    up = up / np.linalg.norm(up)
    return [along, up, np.cross(along, up)]


def _ball_in_socket(joint: Spherical, place: Mate) -> FaceRow:
    """Return the only face: the ball's centre in a socket with the ball's radius, which acts as a skin."""
    socket = Side(body=joint.socket.body, socket=Socket(centre=joint.socket.point, radius=joint.ball.radius or 0.0))
    return "ball", KINDS["point-socket"], (place.b, place.a), geometry_row(place.point_b), row_b(socket, place.a)


def _across(axis: Any) -> Array:
    """Return the direction perpendicular to ``axis`` nearest to the first of x, y, z with the largest angle to it."""
    n = np.asarray(axis, float)
    e = np.eye(3)[np.argmin(np.abs(n))]
    return np.asarray(e - (e @ n) * n)


# Ideal joints as bilateral rows, named JOINT.slide1, ..., JOINT.turn1, ... (paper, eqs. 14-16).


def joint_rows(mechanism: Mechanism, frames: dict[str, BodyFrame], R: Array) -> Iterator[BilateralRow]:
    """Yield the rows of all joints: for an ideal joint, 6 minus the number of its degrees of freedom.

    A joint with play has no rows, except a shaft in a sleeve whose rotation is held. R, (nb + 1, 3, 3), holds the
    rotations at the start.
    """
    for name, joint in mechanism.joints.items():
        slides, turns = _held(joint)
        if not slides and not turns:
            continue
        place = mate(joint, frames, R)
        bodies = place.a.index, place.b.index
        way, other = directions(joint, place)
        arm = turning_arm(mechanism, [side.body for side in joint.sides])
        for i, k in enumerate(slides):
            row = np.concatenate([place.point_a, way[k], place.point_b])
            yield BilateralRow(f"{name}.slide{i + 1}", SLIDE, *bodies, row)
        for i, k in enumerate(turns):
            d = "e" if k == "n" else "n"  # a direction perpendicular to k, which shows the rotation about k
            row = np.concatenate([way[d], way[k], other[d]])
            yield BilateralRow(f"{name}.turn{i + 1}", TURN, *bodies, row, arm=arm)


def _held(joint: Any) -> tuple[str, str]:
    """Return the directions along which and about which a joint holds."""
    if joint.ideal:
        return HELD[joint.type]
    held = isinstance(joint, Prismatic) and joint.shaft is not None and joint.shaft.turning == "held"
    return "", "n" if held else ""


def directions(joint: Any, place: Mate) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return n, e, f in a's axes; and in b's axes, n as given in the file and e, f as they are at the start."""
    n = place.a.direction(joint.axes[0]) if joint.axes else np.array([0.0, 0.0, 1.0])
    e = tangent(n)
    way = {"n": n, "e": e, "f": np.cross(n, e)}
    other = {k: place.relative @ d for k, d in way.items()}
    if joint.axes:
        other["n"] = place.align(n, place.b.direction(joint.axes[1]))
    return way, other


# The play of the joints, kept apart from everything else of a mechanism.
#
# Play is what campaigns vary most, and it is only a number added to gaps: all other arrays are those of the mechanism
# without play and do not change with it.


def without_play(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism with clearance 0 in every joint; the joints are the same objects whatever their play."""
    return mechanism.model_copy(update={"joints": {name: _shape(joint) for name, joint in mechanism.joints.items()}})


def add_play(mechanism: Mechanism, faces: Iterable[FaceWithPlay], clearance: Array) -> None:
    """Add the play of the joints to ``clearance``, (nc,), in place."""
    joints = mechanism.joints
    for i, joint, face, stretch in faces:
        clearance[i] += joints[joint].play(face) * stretch


def faces_with_play(mechanism: Mechanism, pairs: Iterable[Pair]) -> tuple[FaceWithPlay, ...]:
    """Return the contacts at which joints have play."""

    def stretch(joint: Joint, face: str) -> float:
        return mechanism.stretch(joint.sides[joint.carries(face)].body)

    plays = [(i, *pair.play) for i, pair in enumerate(pairs) if pair.play is not None]
    return tuple((i, joint, face, stretch(mechanism.joints[joint], face)) for i, joint, face in plays)


def _shape(joint: Joint) -> Any:
    """Return a joint with clearance 0: the same object for all joints that differ in nothing else."""
    entries, others = joint.__dict__, joint.CLEARANCES
    # from sample to sample only a clearance is another object
    parts = type(joint), *[value is None if key in others else id(value) for key, value in entries.items()]
    known = _same_objects.get(parts)
    if known is None:
        if len(_same_objects) >= MOST_SHAPES:
            _same_objects.clear()
        # the joint keeps its numbers and tables alive, so that no other object can get their ids
        known = _same_objects.setdefault(parts, (_equal_shape(joint), joint))
    return known[0]


def _equal_shape(joint: Joint) -> Any:
    """Return a joint with clearance 0: the same object for all joints with equal numbers and the same tables."""
    entries = joint.__dict__
    closed = {key: 0.0 for key in joint.CLEARANCES if entries[key] is not None}
    content = type(joint), *closed, *[_exact(value) for key, value in entries.items() if key not in joint.CLEARANCES]
    shape = _shapes.get(content)
    if shape is None:
        if len(_shapes) >= MOST_SHAPES:
            _shapes.clear()
        # the shape keeps the tables of the joint alive, so that no other object can get their ids
        shape = _shapes.setdefault(content, joint.model_copy(update=closed))
    return shape


def _exact(value: Any) -> Any:
    """Return a key that only the same value has: unlike the float itself, it distinguishes -0.0 from 0.0."""
    if isinstance(value, TableModel):
        return id(value)
    if isinstance(value, tuple):
        return tuple(map(_exact, value))
    return value.hex() if isinstance(value, float) else value

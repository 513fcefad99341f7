"""The features of a mechanism in a CAD file, arranged: joints with their flanges, candidates for stops, names."""

import re
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from engine.arrays import Array
from engine.cad import CadAssembly, CadFace
from engine.cad.cad_model import with_joined_parts
from engine.cad.findings.facing_planes import FacingPlanes, ThrustFaces, facing_planes, thrust_faces, triangles_by_face
from engine.cad.findings.facing_rounds import FacingRound, facing_rounds
from engine.cad.findings.joints import (
    MOST_EXCESS,
    BallInSocket,
    NearMiss,
    PinInHole,
    UndrawnPin,
    balls_in_sockets,
    coaxial_fits,
    pins_in_holes,
    pins_in_slots,
    undrawn_pins,
)
from engine.cad.findings.standard_parts import Coil, StandardPart, standard_parts
from engine.cad.geometry import distance_to_triangles, perpendicular
from engine.cad_import.proposed_groups import PartGroup, proposed_groups, usable

_NOTHING = 1e-9  # mm, of rounding
_LONGEST = 40  # letters in a body's name
_SOUND = re.compile(
    r"(?:HIRAGANA LETTER|KATAKANA LETTER|HANGUL SYLLABLE|GREEK (?:SMALL|CAPITAL) LETTER) (?:SMALL )?([A-Z]+)"
)
_LONG_VOWEL = "KATAKANA-HIRAGANA PROLONGED SOUND MARK"
_LETTERS = str.maketrans(
    {
        "\N{LATIN SMALL LETTER SHARP S}": "ss",
        "\N{LATIN SMALL LETTER O WITH STROKE}": "o",
        "\N{LATIN CAPITAL LETTER O WITH STROKE}": "O",
        "\N{LATIN SMALL LETTER AE}": "ae",
        "\N{LATIN CAPITAL LETTER AE}": "Ae",
        "\N{LATIN SMALL LETTER L WITH STROKE}": "l",
        "\N{LATIN CAPITAL LETTER L WITH STROKE}": "L",
    }
)  # letters that Unicode does not decompose


@dataclass(frozen=True, eq=False)
class FoundJoint:
    """A pin in a hole, with a unique name."""

    name: str
    pin: PinInHole
    flanges: tuple[ThrustFaces, ...]


@dataclass(frozen=True, eq=False)
class FoundBall:
    """A ball in a socket, with a unique name."""

    name: str
    ball: BallInSocket


@dataclass(frozen=True, eq=False)
class FoundStop:
    """Two faces that face each other, with a unique name."""

    name: str
    pair: FacingPlanes | FacingRound

    @property
    def sizes(self) -> str:
        """A description of their distance, and of the size of what they share."""
        gap, about = self.pair.gap, "about " if isinstance(self.pair, FacingRound) and self.pair.is_estimate else ""
        apart = (
            f"{about}{gap if gap > _NOTHING else 0.0:.4g} mm apart"
            if gap > -_NOTHING
            else f"overlapping by {about}{-gap:.4g} mm"
        )
        if isinstance(self.pair, FacingPlanes):
            return f"{apart}, {self.pair.area:.4g} mm2 face each other"
        return f"{apart}, along {self.pair.length:.4g} mm" if self.pair.length else apart


@dataclass(frozen=True, eq=False)
class FoundSpring:
    """A spring between two parts, with a unique name."""

    name: str
    part: str
    coil: Coil | None  # none if it is a spring by its name only
    ends: tuple[str, str]  # the part that is nearest to each end of a coil, or that the spring touches; may be empty
    points: Array  # its ends, shape (2, 3)
    axis: Array | None = None  # that of its turns, if it is no coil


@dataclass(frozen=True, eq=False)
class FoundPivot:
    """A joint that may be there, with a unique name: a pin that is not drawn, or one that snaps into its bearing."""

    name: str
    pin: UndrawnPin | NearMiss


@dataclass(frozen=True, eq=False)
class FoundGeometry:
    """The features found in an assembly; lengths in mm."""

    assembly: CadAssembly  # in which each group of parts is one part
    bodies: dict[str, str]  # part name -> name of the body that it becomes
    joints: tuple[FoundJoint, ...]
    balls: tuple[FoundBall, ...]
    refused: tuple[NearMiss, ...]  # pins and holes, balls and sockets that are not joints
    stops: tuple[FoundStop, ...]  # faces that face each other and are not flanges: first planes, then round ones
    drawn: CadAssembly  # with each part by itself
    groups: tuple[PartGroup, ...] = ()  # each is a part of `assembly` with the name of the group
    standard: tuple[StandardPart, ...] = ()  # the parts as drawn that are bought
    springs: tuple[FoundSpring, ...] = ()  # which are no parts of `assembly`
    pivots: tuple[FoundPivot, ...] = ()  # joints that may be there

    def whole(self, part: str) -> str:
        """Return the name of the part of `assembly` that a part as drawn belongs to."""
        return next((group.name for group in self.groups if part in group.parts), part)

    def face(self, number: int) -> CadFace:
        """Return a face by its number."""
        return next(face for face in self.assembly.faces if face.number == number)

    def to_body(self, part: str, point: Array) -> Array:
        """Return a point in the frame of the body that a part becomes, given in the assembly's frame."""
        placement = self.assembly.part(part).placement
        return np.asarray(placement.rotation.T @ (point - placement.translation))


def find_geometry(drawn: CadAssembly, groups: Sequence[PartGroup] | None = None) -> FoundGeometry:
    """Find joints and candidates for stops in an assembly in mm, and name them.

    The parts of each group are one part; without `groups`, those that are proposed.
    """
    triangles = triangles_by_face(drawn)
    planes = facing_planes(drawn, triangles)
    standard = standard_parts(drawn)
    elastic = {each.part for each in standard if each.kind == "spring"}
    rigid = _without(drawn, elastic) if 0 < len(elastic) < len(drawn.parts) else drawn
    touching, planes = planes, [pair for pair in planes if not elastic & set(pair.parts)]
    if groups is None:
        proposed = proposed_groups(rigid, _jointed(rigid, triangles), planes, standard, undrawn_pins(rigid))
        names = _names([group.name for group in proposed], "group", _LONGEST)
        groups = [replace(group, name=name) for group, name in zip(proposed, names, strict=True)]
    groups = _named_apart(usable(groups, [part.name for part in rigid.parts]), drawn)
    assembly = with_joined_parts(rigid, {group.name: group.parts for group in groups}) if groups else rigid
    parts = [part.name for part in assembly.parts]
    bodies = dict(zip(parts, _names(parts, "part", _LONGEST), strict=True))
    pins, refused = pins_in_holes(assembly)
    balls, balls_refused = balls_in_sockets(assembly, triangles)
    pairs = [(pin.journal, pin.bearing) for pin in pins] + [(ball.ball_part, ball.socket_part) for ball in balls]
    names = _names([f"{bodies[inner]}-{bodies[outer]}" for inner, outer in pairs], "joint")
    flanges = [tuple(thrust_faces(assembly, pin, triangles)) for pin in pins]
    joints = tuple(FoundJoint(*each) for each in zip(names[: len(pins)], pins, flanges, strict=True))
    found_balls = tuple(FoundBall(*each) for each in zip(names[len(pins) :], balls, strict=True))
    refused += [*pins_in_slots(assembly), *balls_refused]
    taken = {frozenset((flange.bearing_face, flange.journal_face)) for joint in joints for flange in joint.flanges}
    facing: list[FacingPlanes | FacingRound] = [
        pair for pair in _between(planes, groups) if frozenset(pair.faces) not in taken
    ]
    held = [frozenset((seat.hole, seat.pin)) for pin in pins for seat in pin.seats]
    held += [frozenset((ball.socket, ball.ball)) for ball in balls]
    facing += facing_rounds(assembly, triangles, held)
    stops = tuple(FoundStop(f"stop-{number}", pair) for number, pair in enumerate(facing, 1))
    pivots = _pivots(assembly, refused, bodies, names)
    likely = tuple(sorted((miss for miss in refused if not miss.snaps), key=lambda miss: miss.unlikely))
    found = FoundGeometry(
        assembly, bodies, joints, found_balls, likely, stops, drawn, tuple(groups), tuple(standard), pivots=pivots
    )
    return found if rigid is drawn else replace(found, springs=tuple(_springs(found, triangles, touching)))


def _without(assembly: CadAssembly, names: set[str]) -> CadAssembly:
    """Return an assembly without some of its parts."""
    return replace(
        assembly,
        parts=tuple(part for part in assembly.parts if part.name not in names),
        faces=tuple(face for face in assembly.faces if face.part not in names),
        edges=tuple(edge for edge in assembly.edges if edge.part not in names),
        meshes=tuple(mesh for mesh in assembly.meshes if mesh.part not in names),
    )


def _pivots(
    assembly: CadAssembly, refused: Sequence[NearMiss], bodies: dict[str, str], taken: list[str]
) -> tuple[FoundPivot, ...]:
    """Return the joints that may be there, one for each two parts and axis."""
    part = {face.number: face for face in assembly.faces}
    snaps: list[NearMiss] = []
    for miss in filter(lambda miss: miss.snaps, refused):
        if not any(_is_same_pair(part, miss, other) for other in snaps):
            snaps.append(miss)
    pins: list[UndrawnPin | NearMiss] = [*undrawn_pins(assembly), *snaps]
    pairs = [pin.parts if isinstance(pin, UndrawnPin) else (part[pin.pin].part, part[pin.hole].part) for pin in pins]
    names = _names([*taken, *(f"{bodies[inner]}-{bodies[outer]}" for inner, outer in pairs)], "joint")
    return tuple(FoundPivot(*each) for each in zip(names[len(taken) :], pins, strict=True))


def _is_same_pair(faces: dict[int, CadFace], one: NearMiss, other: NearMiss) -> bool:
    """Return whether two holes with their pins are of the same parts and about the same axis."""
    hole, known = faces[one.hole], faces[other.hole]
    alike = (hole.part, faces[one.pin].part) == (known.part, faces[other.pin].part)
    return alike and bool(np.linalg.norm(np.cross(hole.point - known.point, hole.axis)) <= MOST_EXCESS)


def _springs(
    found: FoundGeometry, triangles: dict[int, Array], touching: Sequence[FacingPlanes]
) -> Iterator[FoundSpring]:
    """Yield the springs, each with the parts at its ends; `touching` are the flat faces of all parts as drawn."""
    springs = [each for each in found.standard if each.kind == "spring"]
    parts = found.assembly.parts if any(each.coil for each in springs) else ()
    corners = {
        part.name: np.concatenate([np.zeros((0, 3, 3)), *(triangles[f.number] for f in faces if f.number in triangles)])
        for part in parts
        if (faces := found.assembly.faces_of(part.name))
    }
    for name, each in zip(_names([each.part for each in springs], "spring", _LONGEST), springs, strict=True):
        if each.coil is None:
            yield _spring_by_name(found, name, each.part, touching)
            continue
        coil, near = each.coil, []
        around = perpendicular((coil.ends[1] - coil.ends[0]) / coil.length) * coil.diameter / 2
        for end in coil.ends:
            ring = end + np.concatenate([around, -around])
            far = {other: sum(distance_to_triangles(p, of) for p in ring) for other, of in corners.items() if len(of)}
            near.append(min(far, key=lambda other: far[other], default=""))
        yield FoundSpring(name, each.part, coil, (near[0], near[1]), coil.ends)


def _spring_by_name(found: FoundGeometry, name: str, part: str, touching: Sequence[FacingPlanes]) -> FoundSpring:
    """Return a spring that is no coil, between the first two parts whose holes, pins or flat faces it fits best."""
    fits = sorted((fit for fit in coaxial_fits(found.drawn) if part in {f.part for f in fit}), key=_difference)
    met = [(pin.part if hole.part == part else hole.part, pin.point) for hole, pin in fits]
    met += [(pair.parts[pair.parts[0] == part], pair.middle) for pair in touching if part in pair.parts]
    known = {each.name for each in found.assembly.parts}
    ends: dict[str, Array] = {}
    for other, point in met:
        if (whole := found.whole(other)) in known:
            ends.setdefault(whole, point)
    (first, start), (second, end) = [*ends.items(), ("", np.zeros(3)), ("", np.zeros(3))][:2]
    turns = [face for face in found.drawn.faces_of(part) if face.kind == "torus"]
    axis = max(turns, key=lambda face: face.area).axis if turns else None
    return FoundSpring(name, part, None, (first, second), np.array([start, end]), axis)


def _difference(fit: tuple[CadFace, CadFace]) -> float:
    return abs(fit[0].radius - fit[1].radius)


def _jointed(assembly: CadAssembly, triangles: dict[int, Array]) -> list[frozenset[str]]:
    """Return the pairs of parts with a joint between them, or with what may be one."""
    pins, refused = pins_in_holes(assembly)
    balls, balls_refused = balls_in_sockets(assembly, triangles)
    loose = [miss for miss in (*refused, *balls_refused) if miss.may_be_one or miss.snaps]
    part = {face.number: face.part for face in assembly.faces}
    return [
        *(frozenset((pin.bearing, pin.journal)) for pin in pins),
        *(frozenset((ball.socket_part, ball.ball_part)) for ball in balls),
        *(frozenset((part[miss.hole], part[miss.pin])) for miss in (*loose, *pins_in_slots(assembly))),
    ]


def _named_apart(groups: Sequence[PartGroup], assembly: CadAssembly) -> list[PartGroup]:
    """Return groups with names that no part outside them has."""
    alone = {part.name for part in assembly.parts} - {part for group in groups for part in group.parts}
    return [replace(each, name=f"{each.name}-group") if each.name in alone else each for each in groups]


def _between(planes: Sequence[FacingPlanes], groups: Sequence[PartGroup]) -> list[FacingPlanes]:
    """Return the planes of different groups that face each other, with the groups in place of the parts."""
    whole = {part: group.name for group in groups for part in group.parts}
    found = []
    for pair in planes:
        first, second = (whole.get(part, part) for part in pair.parts)
        if first != second:
            found.append(replace(pair, parts=(first, second)))
    return found


def _names(texts: list[str], otherwise: str, longest: int | None = None) -> list[str]:
    """Return a unique name for the mechanism file for each text, truncated after some letters."""
    names: list[str] = []
    for text in texts:
        plain = "".join(map(_latin, unicodedata.normalize("NFKC", text.translate(_LETTERS))))
        stem = re.sub(r"[^A-Za-z0-9_]+", "-", plain).strip("-_")[:longest].strip("-_") or otherwise
        stem = stem if stem[0].isalpha() else f"{otherwise}-{stem}"
        numbered = (f"{stem}-{number}" if number > 1 else stem for number in range(1, len(texts) + 1))
        names.append(next(name for name in numbered if name not in names))
    return names


def _latin(character: str) -> str:
    """Return a character in letters of ASCII if it is an accented one, or one of Japanese, Korean or Greek sound."""
    plain = "".join(c for c in unicodedata.normalize("NFKD", character) if not unicodedata.combining(c))
    if plain.isascii():  # an umlaut is its letter and two dots
        return plain
    name = unicodedata.name(character, "")  # such as KATAKANA LETTER BA, HANGUL SYLLABLE BANG
    sound = _SOUND.fullmatch(name)
    return sound[1].lower() if sound else "" if name == _LONG_VOWEL else character

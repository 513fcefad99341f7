"""The features of a mechanism in a CAD file, arranged: joints with their flanges, candidates for stops, names."""

import re
import unicodedata
from dataclasses import dataclass

import numpy as np

from engine.arrays import Array
from engine.cad import CadAssembly, CadFace
from engine.cad.findings import (
    BallInSocket,
    FacingPlanes,
    FacingRound,
    NearMiss,
    PinInHole,
    ThrustFaces,
    balls_in_sockets,
    facing_planes,
    facing_rounds,
    pins_in_holes,
    pins_in_slots,
    thrust_faces,
)
from engine.cad.findings.facing_planes import triangles_by_face

_LONGEST = 40  # letters in a body's name
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
        apart = f"{about}{gap:.4g} mm apart" if gap >= 0 else f"overlapping by {about}{-gap:.4g} mm"
        if isinstance(self.pair, FacingPlanes):
            return f"{apart}, {self.pair.area:.4g} mm2 face each other"
        return f"{apart}, along {self.pair.length:.4g} mm" if self.pair.length else apart


@dataclass(frozen=True, eq=False)
class FoundGeometry:
    """The features found in an assembly; lengths in mm."""

    assembly: CadAssembly
    bodies: dict[str, str]  # part name -> name of the body that it becomes
    joints: tuple[FoundJoint, ...]
    balls: tuple[FoundBall, ...]
    refused: tuple[NearMiss, ...]  # pins and holes, balls and sockets that are not joints
    stops: tuple[FoundStop, ...]  # faces that face each other and are not flanges: first planes, then round ones

    def face(self, number: int) -> CadFace:
        """Return a face by its number."""
        return next(face for face in self.assembly.faces if face.number == number)

    def to_body(self, part: str, point: Array) -> Array:
        """Return a point in the frame of the body that a part becomes, given in the assembly's frame."""
        placement = self.assembly.part(part).placement
        return np.asarray(placement.rotation.T @ (point - placement.translation))


def find_geometry(assembly: CadAssembly) -> FoundGeometry:
    """Find joints and candidates for stops in an assembly in mm, and name them."""
    triangles = triangles_by_face(assembly)
    parts = [part.name for part in assembly.parts]
    bodies = dict(zip(parts, _names(parts, "part", _LONGEST), strict=True))
    pins, refused = pins_in_holes(assembly)
    balls, balls_refused = balls_in_sockets(assembly, triangles)
    pairs = [(pin.journal, pin.bearing) for pin in pins] + [(ball.ball_part, ball.socket_part) for ball in balls]
    names = _names([f"{bodies[inner]}-{bodies[outer]}" for inner, outer in pairs], "joint")
    flanges = [tuple(thrust_faces(assembly, pin, triangles)) for pin in pins]
    joints = [FoundJoint(*each) for each in zip(names[: len(pins)], pins, flanges, strict=True)]
    found_balls = tuple(FoundBall(*each) for each in zip(names[len(pins) :], balls, strict=True))
    refused += [*pins_in_slots(assembly), *balls_refused]
    taken = {frozenset((flange.bearing_face, flange.journal_face)) for joint in joints for flange in joint.flanges}
    facing: list[FacingPlanes | FacingRound] = [
        pair for pair in facing_planes(assembly, triangles) if frozenset(pair.faces) not in taken
    ]
    held = [frozenset((seat.hole, seat.pin)) for pin in pins for seat in pin.seats]
    facing += facing_rounds(assembly, triangles, held + [frozenset((ball.socket, ball.ball)) for ball in balls])
    stops = tuple(FoundStop(f"stop-{number}", pair) for number, pair in enumerate(facing, 1))
    return FoundGeometry(assembly, bodies, tuple(joints), found_balls, tuple(refused), stops)


def _names(texts: list[str], otherwise: str, longest: int | None = None) -> list[str]:
    """Return a unique name for the mechanism file for each text, truncated after some letters."""
    names: list[str] = []
    for text in texts:
        plain = text.translate(_LETTERS)
        plain = unicodedata.normalize("NFKD", plain)  # decomposes an umlaut into its letter and two dots
        plain = "".join(c for c in plain if not unicodedata.combining(c))
        stem = re.sub(r"[^A-Za-z0-9_-]+", "-", plain).strip("-_")[:longest].strip("-_") or otherwise
        stem = stem if stem[0].isalpha() else f"{otherwise}-{stem}"
        number = next(n for n in range(1, len(texts) + 1) if _numbered(stem, n) not in names)
        names.append(_numbered(stem, number))
    return names


def _numbered(stem: str, number: int) -> str:
    return stem if number == 1 else f"{stem}-{number}"

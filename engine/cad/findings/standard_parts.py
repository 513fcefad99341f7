"""Bought parts among those of an assembly: fasteners, bearings, springs, boards, by name, standard size or shape.

Sizes in mm: hexagons ISO 272 and ISO 4032; socket heads ISO 4762; washers ISO 7089; rolling bearings ISO 15 and the
common miniature series. A coil is recognised by its triangles: a wire of constant thickness about an axis, with a
volume that needs more than two turns of it.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import pi, radians
from typing import Literal

import numpy as np

from engine.arrays import Array
from engine.cad.cad_model import CadAssembly, CadFace, CadPart, Coordinates, Millimetres, TriangleMesh
from engine.cad.geometry import perpendicular

StandardKind = Literal["fastener", "bearing", "spring", "board"]

_SIZE = 0.02  # relative difference of a standard size, as parts are drawn without their tolerances
_PARALLEL = radians(1.0)
_ON_AXIS = 0.05  # mm
_ROUGHLY = 0.1  # of its size, by which the points of a coil are not equally far from its axis
_ROUND = 0.15  # relative difference of the thickness of a coil from that of a round wire with its surface and volume
_FEWEST_TURNS = 1.5
_SAMPLE = 1000  # points of a mesh from which the axis of a coil is fitted

_HEXAGONS = {3.2: 1.6, 4.0: 2.0, 5.0: 2.5, 5.5: 3.0, 7.0: 4.0, 8.0: 5.0, 10.0: 6.0, 13.0: 8.0, 16.0: 10.0, 17.0: 10.0}
_HEXAGONS |= {18.0: 12.0, 19.0: 12.0, 21.0: 14.0, 24.0: 16.0, 30.0: 20.0}  # thread by the width across flats
_SOCKET_HEADS = {3.0: 1.6, 3.8: 2.0, 4.5: 2.5, 5.5: 3.0, 7.0: 4.0, 8.5: 5.0, 10.0: 6.0, 13.0: 8.0, 16.0: 10.0}
_SOCKET_HEADS |= {18.0: 12.0, 24.0: 16.0, 30.0: 20.0}  # thread by the diameter of the head
_KEYS = {1.6: 1.5, 2.0: 1.5, 2.5: 2.0, 3.0: 2.5, 4.0: 3.0, 5.0: 4.0, 6.0: 5.0, 8.0: 6.0, 10.0: 8.0, 12.0: 10.0}
_KEYS |= {16.0: 14.0, 20.0: 17.0}  # width across flats of the socket, by the thread
_WASHERS = {
    *((1.7, 4.0, 0.3), (2.2, 5.0, 0.3), (2.7, 6.0, 0.5), (3.2, 7.0, 0.5), (4.3, 9.0, 0.8), (5.3, 10.0, 1.0)),
    *((6.4, 12.0, 1.6), (8.4, 16.0, 1.6), (10.5, 20.0, 2.0), (13.0, 24.0, 2.5), (17.0, 30.0, 3.0)),
    (21.0, 37.0, 3.0),
}
_BEARINGS = {
    **{"681": (1, 3, 1), "682": (2, 5, 1.5), "683": (3, 7, 2), "693": (3, 8, 3), "623": (3, 10, 4)},
    **{"684": (4, 9, 2.5), "624": (4, 13, 5), "MR105": (5, 10, 4), "685": (5, 11, 3), "625": (5, 16, 5)},
    **{"MR106": (6, 10, 3), "686": (6, 13, 5), "626": (6, 19, 6), "688": (8, 16, 5), "608": (8, 22, 7)},
    **{"6800": (10, 19, 5), "6000": (10, 26, 8), "6200": (10, 30, 9), "6001": (12, 28, 8)},
    **{"6002": (15, 32, 9), "6003": (17, 35, 10), "6004": (20, 42, 12), "6005": (25, 47, 12)},
    **{"6204": (20, 47, 14), "6205": (25, 52, 15)},
}

_HOLDERS = (
    "(?:cap|housing|block|holder|seat|cover|mount|plate|carrier|bracket|retainer|support|flange|rod|guide|pin|arm|lever"
    "|box|case|body|shaft|driver|head)"
)
_NAMES: dict[StandardKind, re.Pattern[str]] = {
    "fastener": re.compile(
        rf"\b(?:(?:cap|set|grub|wood|machine|socket)?screw|bolt|(?:lock|hex|wing)?nut|washer|rivet|dowel|circlip"
        rf"|snap ring|retaining ring|e ?clip|threaded insert|(?:zylinder|senk|linsen|sechskant)?schraube"
        rf"|(?:sechskant)?mutter|(?:unterleg)?scheibe|niet|zylinderstift|passstift|sicherungsring"
        rf"|(?:din|iso|en) \d{{2,5}}|m\d{{1,2}} ?x ?\d+)s?\b(?! {_HOLDERS}\b)"
    ),
    "bearing": re.compile(
        rf"\b(?:bearing|kugellager|rillenkugellager|w.lzlager|bushing|gleitlager|(?:6[02]\d|68\d|69\d|6[0-3]\d\d|mr\d+)"
        rf" ?(?:zz|2rs|2z|rs|vv))s?\b(?! {_HOLDERS}\b)"
    ),
    "spring": re.compile(
        rf"\b(?:(?:compression|tension|torsion|druck|zug|schenkel)? ?(?:spring|feder))s?\b(?! (?:washer|{_HOLDERS})\b)"
    ),
    "board": re.compile(
        r"\b(?:pcba?|circuit board|leiterplatte|platine|[rcld] \d{4} \d{4}metric|led \d{4} \d{4}metric|sot \d+|soic \d+"
        r"|tssop \d+|qfn \d+|pinheader)\b"
    ),
}
_GEAR = re.compile(
    rf"\b(?:(?:spur|ring|sun|planet|internal) ?)?(?:gear ?wheel|gear|pinion|zahnrad|ritzel|stirnrad|hohlrad)s?\b"
    rf"(?! {_HOLDERS}\b)"
)
_TEETH = re.compile(r"\b(?:z ?)?(\d{1,3}) ?(?:teeth|tooth|t|zaehne|z)\b|\bz ?(\d{1,3})\b")
_NO_FASTENER = re.compile(r"\b(?:lead|ball|feed|drive|power|worm|spindle|trapez\w*) ?(?:screw|nut|spindle)")


@dataclass(frozen=True, eq=False, kw_only=True)
class Coil:
    """A coil spring, by its drawn shape."""

    ends: Coordinates  # shape (2, 3), on its axis [mm]
    wire: Millimetres  # thickness of the wire
    diameter: Millimetres  # mean diameter of the turns
    turns: float

    @property
    def length(self) -> float:
        """Distance of the ends [mm]."""
        return float(np.linalg.norm(self.ends[1] - self.ends[0]))


@dataclass(frozen=True, eq=False, kw_only=True)
class StandardPart:
    """A part that is bought, not designed."""

    part: str
    kind: StandardKind
    said: str  # by what it was recognised: ``by its name``, ``M6 by its hexagon``
    coil: Coil | None = None


def standard_parts(assembly: CadAssembly) -> list[StandardPart]:
    """Return the fasteners, bearings, springs and boards among the parts of an assembly in mm, in their order."""
    meshes = {mesh.part: mesh for mesh in assembly.meshes}
    faces: dict[str, list[CadFace]] = {part.name: [] for part in assembly.parts}
    for face in assembly.faces:
        faces[face.part].append(face)
    found = [_standard(part, faces[part.name], meshes[part.name]) for part in assembly.parts]
    return [each for each in found if each is not None]


def gear_teeth(name: str) -> int | None:
    """Return the number of teeth of a gear by the name of its product, 0 if it has none in it; None for other parts."""
    plain = _plain(name)
    if not _GEAR.search(plain):
        return None
    teeth = _TEETH.search(plain)
    return int(teeth[1] or teeth[2]) if teeth else 0


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", " ", name.casefold()).strip()


def _standard(part: CadPart, faces: list[CadFace], mesh: TriangleMesh) -> StandardPart | None:
    """Return what a part is; None if it is no part that is recognised."""
    name = _plain(part.product or part.name)
    kind = next((kind for kind, pattern in _NAMES.items() if pattern.search(name)), None)
    if kind == "fastener" and _NO_FASTENER.search(name):
        return None
    coil = _coil(part, faces, mesh)
    if coil is not None and kind in (None, "spring"):
        turns = f"{coil.turns:.3g} turns of {coil.wire:.3g} mm wire, mean diameter {coil.diameter:.4g}"
        return StandardPart(part=part.name, kind="spring", said=f"{turns}, {coil.length:.4g} mm long", coil=coil)
    if kind is not None:
        return StandardPart(part=part.name, kind=kind, said="by its name")
    if size := _fastener(faces):
        return StandardPart(part=part.name, kind="fastener", said=size)
    if size := _bearing(faces):
        return StandardPart(part=part.name, kind="bearing", said=size)
    return None


def _near(size: float, standard: float) -> bool:
    return abs(size - standard) <= _SIZE * standard


def _fastener(faces: list[CadFace]) -> str:
    """Return the thread of a nut, a bolt, a screw or a washer of standard size; empty if it is none."""
    cylinders = [face for face in faces if face.kind == "cylinder"]
    holes = [face for face in cylinders if face.hollow]
    pins = [face for face in cylinders if not face.hollow]
    if len(faces) > 60:
        return ""
    for axis_face in cylinders[:8]:
        width, inward = _hexagon(faces, axis_face)
        thread = next((d for s, d in _HEXAGONS.items() if not inward and _near(width, s)), 0.0) if width else 0.0
        own = [2 * face.radius for face in (pins if not axis_face.hollow else holes)]
        if thread and any(0.78 * thread <= d <= 1.1 * thread for d in own):
            return f"M{thread:g} by its hexagon"
        heads = [_SOCKET_HEADS[s] for s in _SOCKET_HEADS for pin in pins if _near(2 * pin.radius, s)]
        for thread in heads:
            shank = any(0.78 * thread <= 2 * pin.radius <= 1.03 * thread for pin in pins)
            if inward and shank and abs(width - _KEYS[thread]) <= 0.06 * _KEYS[thread]:
                return f"M{thread:g} by its socket head"
    if len(holes) == 1 and len(pins) == 1 and len([f for f in faces if f.kind == "plane"]) == 2 and len(faces) <= 6:
        inner, outer, height = 2 * holes[0].radius, 2 * pins[0].radius, float(np.ptp(holes[0].extent))
        for hole, rim, thick in _WASHERS:
            if _near(inner, hole) and _near(outer, rim) and abs(height - thick) <= 0.1 * thick:
                return f"washer {hole:g} by its size"
    return ""


def _hexagon(faces: Sequence[CadFace], about: CadFace) -> tuple[float, bool]:
    """Return the width across flats of six planes around the axis of a cylinder, and whether they look inwards."""
    flats = []
    for face in faces:
        if face.kind == "plane" and abs(face.axis @ about.axis) < np.sin(_PARALLEL):
            flats.append((float((face.point - about.point) @ face.axis), face.axis))
    if len(flats) != 6:
        return 0.0, False
    distances = np.array([distance for distance, _ in flats])
    if np.ptp(distances) > _ON_AXIS + _SIZE * abs(distances[0]):
        return 0.0, False
    turned = np.array([[one @ other for _, other in flats] for _, one in flats])
    regular = np.sort(turned, axis=1) - np.array([-1.0, -0.5, -0.5, 0.5, 0.5, 1.0])
    if np.abs(regular).max() > 0.02:
        return 0.0, False
    return 2 * abs(float(distances.mean())), bool(distances.mean() < 0)


def _bearing(faces: list[CadFace]) -> str:
    """Return the number of a rolling bearing with the bore, rim and width of a part; empty if it is none."""
    cylinders = [face for face in faces if face.kind == "cylinder"]
    holes = [face for face in cylinders if face.hollow]
    pins = [face for face in cylinders if not face.hollow]
    if not holes or not pins or len(faces) > 60:
        return ""
    bore, rim = min(holes, key=lambda f: f.radius), max(pins, key=lambda f: f.radius)
    away = bore.point - rim.point
    if abs(bore.axis @ rim.axis) < np.cos(_PARALLEL) or np.linalg.norm(np.cross(away, rim.axis)) > _ON_AXIS:
        return ""
    ends = [float((face.point - rim.point) @ rim.axis) for face in faces if face.kind == "plane"]
    width = float(np.ptp(ends)) if ends else 0.0
    for number, (d, outer, b) in _BEARINGS.items():
        if (
            abs(2 * bore.radius - d) < 0.01 * d
            and abs(2 * rim.radius - outer) < 0.01 * outer
            and abs(width - b) < 0.1 * b
        ):
            return f"{number} by its size"
    return ""


def _coil(part: CadPart, faces: list[CadFace], mesh: TriangleMesh) -> Coil | None:
    """Return a part as a coil; None if it is none."""
    if len(part.solids) != 1 or len(mesh.vertices) < 50:
        return None
    [solid] = part.solids
    area = sum(face.area for face in faces)
    if (
        not faces
        or sum(face.area for face in faces if face.kind in ("surface", "torus")) < 0.8 * area
        or solid.volume <= 0
    ):
        return None
    point, axis = _axis(mesh.vertices, solid.inertia)
    away = mesh.vertices - point
    along = away @ axis
    far = np.linalg.norm(away - np.outer(along, axis), axis=1)
    wire = 4 * solid.volume / area
    for _ in range(3):  # less the discs at both ends
        wire = 4 * solid.volume / (area - pi / 2 * wire**2)
    middle = float(far.max() + far.min()) / 2
    if abs(float(far.max() - far.min()) / wire - 1) > _ROUND or middle < 0.75 * wire:
        return None  # a tube, a cup or a bellows is not as thick as its surface and its volume say
    wound = solid.volume / (pi / 4 * wire**2)  # the length of the wire
    rise = float(np.ptp(along)) - wire
    turns = np.sqrt(max(wound**2 - rise**2, 0.0)) / (2 * pi * middle)
    if turns < _FEWEST_TURNS or rise <= 0:
        return None
    ends = point + np.outer((along.min(), along.max()), axis)
    return Coil(ends=ends, wire=wire, diameter=2 * middle, turns=float(turns))


def _axis(points: Array, inertia: Array) -> tuple[Array, Array]:
    """Return a point and the direction of the axis from which points, shape (n, 3), are most equally far."""
    from scipy.optimize import least_squares, minimize

    some = points[:: max(1, len(points) // _SAMPLE)]
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    size = float(np.ptp(points, axis=0).max())
    best: tuple[float, Array, Array] = (np.inf, middle, np.eye(3)[2])
    for start in (*np.eye(3), *np.linalg.eigh(inertia)[1].T):
        across = perpendicular(start)

        def line(x: Array, start: Array = start, across: Array = across) -> tuple[Array, Array]:
            axis = start + x[:2] @ across
            return middle + size * (x[2:] @ across), axis / np.linalg.norm(axis)

        def width(x: Array, line: Callable[[Array], tuple[Array, Array]] = line) -> float:
            point, axis = line(x)
            return float(np.ptp(np.linalg.norm(np.cross(some - point, axis), axis=1)))

        def spread(x: Array, line: Callable[[Array], tuple[Array, Array]] = line) -> Array:
            point, axis = line(x)
            far = np.linalg.norm(np.cross(some - point, axis), axis=1)
            return np.asarray(far - far.mean())

        fitted = least_squares(spread, np.zeros(4), max_nfev=30)
        if 2 * fitted.cost < len(some) * (_ROUGHLY * size) ** 2:
            closest = minimize(width, fitted.x, method="Nelder-Mead", options={"maxfev": 600})
            if closest.fun < (1 - 1e-6) * best[0]:
                best = (float(closest.fun), *line(closest.x))
    _, point, axis = best
    return point, np.asarray(axis * np.sign(axis[int(np.abs(axis).argmax())]))

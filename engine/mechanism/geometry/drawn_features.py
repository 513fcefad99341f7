"""Find a face or edge of a CAD part by its position, and what the part gives a mechanism, as plain numbers.

Exactly one must fit, otherwise the candidates are listed. Numbers are rounded so that differences in the arithmetic of
machines do not show.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import log10
from typing import Any, TypeVar

import numpy as np
from pydantic import ValidationError

from engine.arrays import Array
from engine.cad import CadAssembly, CadEdge, CadFace, SplineSurface
from engine.cad.geometry import distance_to_triangles
from engine.mechanism.base import TableModel
from engine.mechanism.geometry.cad_table import (
    AS_DRAWN,
    DrawnFace,
    DrawnJoint,
    FacesNear,
    FeatureKind,
    NearEdge,
    NearPlace,
    RoundFace,
)
from engine.mechanism.surfaces.surface import FreeFormSurface

DECIMALS = 12  # decimals of a length in mm and of a component of a direction; significant digits of masses and inertias
WITHIN = 0.5  # largest distance of a point from its face [mm], unless the file sets another
SAME_RADIUS = 1e-3  # largest difference between a face's radius and the one given [mm]
COPLANAR = 1e-6  # largest distance [mm] and angle [rad] between faces that count as one plane
_LISTED = 6  # largest number of candidates in a message
_T = TypeVar("_T", CadFace, CadEdge)

ENDLESS_AGAINST = {"hole": ("ring",), "pin": ("ring", "plane", "disc", "rectangle")}
"""For each kind of side, the primitives opposite to it for which the ends of a bore or a cylinder do not count."""


def length(value: float, millimetre: float) -> float:
    """Return a length rounded to 1e-12 mm; ``millimetre`` is the length of a millimetre in its unit."""
    return round(float(value), DECIMALS - round(log10(millimetre))) + 0.0


def lengths(values: Array, millimetre: float) -> list[float]:
    """Return lengths, shape (n,), rounded to 1e-12 mm, without negative zeros."""
    return [length(value, millimetre) for value in values]


def direction(values: Array) -> list[float]:
    """Return the rounded components of a unit vector."""
    return [round(float(value), DECIMALS) + 0.0 for value in values]


def significant(values: Array) -> Array:
    """Return numbers of one quantity, of any shape, rounded to the decimals that the largest of them needs."""
    largest = float(np.abs(values).max())
    decimals = DECIMALS - 1 - int(np.floor(log10(largest))) if largest > 0 else 0
    return np.round(values, decimals) + 0.0


class NotOneFace(Exception):
    """None or several faces fit; the message lists the candidates."""


@dataclass(frozen=True)
class PartSearch:
    """Searches the faces and edges of one part."""

    assembly: CadAssembly  # in the unit of length of the mechanism
    part: str
    millimetre: float  # its length in that unit

    def to_assembly(self, point: Sequence[float]) -> Array:
        """Return a point in the assembly's frame, given in the body's frame."""
        placement = self.assembly.part(self.part).placement
        return np.asarray(placement.rotation @ np.asarray(point, float) + placement.translation)

    def to_body(self, point: Array) -> list[float]:
        """Return a point in the body's frame, given in the assembly's frame."""
        placement = self.assembly.part(self.part).placement
        return lengths(placement.rotation.T @ (point - placement.translation), self.millimetre)

    def turned_to_body(self, vector: Array) -> list[float]:
        """Return a direction in the body's frame, given in the assembly's frame."""
        return direction(self.assembly.part(self.part).placement.rotation.T @ vector)

    def round_face(self, wanted: RoundFace, *, hollow: bool) -> CadFace:
        """Return the hole or pin of a given radius near a point; raise NotOneFace if there is not exactly one."""
        near, faces = self.to_assembly(wanted.near), self.assembly.faces_of(self.part)
        far = [(_to_axis(f, near), f) for f in faces if f.kind == "cylinder" and f.hollow == hollow]
        same = [each for each in far if abs(each[1].radius - wanted.radius) <= SAME_RADIUS * self.millimetre]
        return self._only(wanted, same, far, "hole" if hollow else "pin")

    def plane(self, wanted: NearPlace) -> CadFace:
        """Return the flat face near a point; coplanar faces count as one. Raise NotOneFace unless there is just one."""
        faces = [face for face in self.assembly.faces_of(self.part) if face.kind == "plane"]
        near = self.to_assembly(wanted.near)
        far = [(distance_to_triangles(near, self._triangles(face)), face) for face in faces]
        far.sort(key=lambda each: each[0])
        pieces: list[tuple[float, CadFace]] = []
        for distance, face in far:
            if not any(self._is_same_plane(face, other) for _, other in pieces):
                pieces.append((distance, face))
        return self._only(wanted, pieces, pieces, "flat face")

    def pieces(self, face: CadFace) -> list[CadFace]:
        """Return the faces of the part coplanar with a flat face, itself included; of another face, only itself."""
        if face.kind != "plane":
            return [face]
        flat = (each for each in self.assembly.faces_of(self.part) if each.kind == "plane")
        return [each for each in flat if self._is_same_plane(each, face)]

    def face(self, wanted: NearPlace) -> CadFace:
        """Return the face of any kind near a point; raise NotOneFace if there is not exactly one."""
        near = self.to_assembly(wanted.near)
        far = [(distance_to_triangles(near, self._triangles(face)), face) for face in self.assembly.faces_of(self.part)]
        return self._only(wanted, far, far, "face")

    def edge(self, wanted: NearPlace) -> CadEdge:
        """Return the circular edge near a point; raise NotOneFace if there is not exactly one."""
        near = self.to_assembly(wanted.near)
        far = [(_to_arc(edge, near), edge) for edge in self.assembly.edges if edge.part == self.part]
        return self._only(wanted, far, far, "circular edge")

    def _only(
        self, wanted: NearPlace, fitting: Iterable[tuple[float, _T]], all_of_kind: Iterable[tuple[float, _T]], what: str
    ) -> _T:
        """Return the only candidate that is near enough."""
        within = WITHIN * self.millimetre if wanted.within is None else wanted.within
        fits = [found for distance, found in fitting if distance <= within]
        if len(fits) == 1:
            return fits[0]
        candidates = sorted(all_of_kind, key=lambda each: each[0])
        described = self.described if what == "face" else self._described
        listed = "; ".join(f"{described(found)}, {distance:.3g} away" for distance, found in candidates[:_LISTED])
        others = f"; and {len(candidates) - _LISTED} more" if len(candidates) > _LISTED else ""
        count = f"{len(fits)} fit" if fits else "none fits"
        found = f"these, nearest first: {listed}{others}" if candidates else f"no {what}"
        keys = "radius and near" if isinstance(wanted, RoundFace) else "near"
        raise NotOneFace(
            f"{count} within {within:g}; {self.part} has {found}; allowed: exactly one {what}; correct {keys}, or give"
            " within"
        )

    def described(self, found: CadFace | CadEdge) -> str:
        """Return a description of a face: its kind and a point on it."""
        kind = found.kind if isinstance(found, CadFace) and found.kind != "surface" else "free-form face"
        at = found.on if isinstance(found, CadFace) else found.centre
        return f"the {kind} at near = {_short(self.to_body(at))}"

    def _described(self, found: CadFace | CadEdge) -> str:
        """Return a face or edge in the form in which a file would name it."""
        if isinstance(found, CadFace) and found.kind == "plane":
            return f"near = {_short(self.to_body(found.on))} with normal {_short(self.turned_to_body(found.normal))}"
        if isinstance(found, CadFace):
            return f"radius = {found.radius:.7g}, near = {_short(self.to_body(found.point))}"
        at = found.centre + found.radius * (found.middle if found.middle.any() else _across(found.axis))
        return f"near = {_short(self.to_body(at))} of radius {found.radius:.7g}"

    def _triangles(self, face: CadFace) -> Array:
        """Return the corners of a face's triangles, shape (n, 3, 3)."""
        mesh = next(mesh for mesh in self.assembly.meshes if mesh.part == self.part)
        return np.asarray(mesh.vertices[mesh.triangles[mesh.faces == face.number]])

    def _is_same_plane(self, face: CadFace, other: CadFace) -> bool:
        apart = abs(float(other.normal @ (face.on - other.on)))
        turned = float(np.linalg.norm(face.normal - other.normal))
        return apart <= COPLANAR * self.millimetre and turned <= COPLANAR


def _to_axis(face: CadFace, point: Array) -> float:
    """Return the distance of a point from the segment of the axis that a face spans."""
    along = float(face.axis @ (point - face.point))
    nearest = face.point + np.clip(along, *face.extent) * face.axis
    return float(np.linalg.norm(point - nearest))


def _to_arc(edge: CadEdge, point: Array) -> float:
    """Return the distance of a point from a circular edge."""
    offset = point - edge.centre
    across = offset - (offset @ edge.axis) * edge.axis
    length = float(np.linalg.norm(across))
    outward = across / length if length > 0 else _across(edge.axis)
    if edge.middle.any() and float(outward @ edge.middle) < np.cos(edge.span / 2):
        side = np.sign(float(np.cross(edge.axis, edge.middle) @ outward)) or 1.0
        turned = side * np.cross(edge.axis, edge.middle)
        outward = np.cos(edge.span / 2) * edge.middle + np.sin(edge.span / 2) * turned
    return float(np.linalg.norm(offset - edge.radius * outward))


def _across(axis: Array) -> Array:
    """Return a unit vector perpendicular to another vector."""
    across = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    return np.asarray(across / np.linalg.norm(across))


def _short(values: Sequence[float]) -> str:
    return f"[{', '.join(f'{round(value, 6) + 0.0:g}' for value in values)}]"


def feature_of(search: PartSearch, kind: FeatureKind, wanted: TableModel) -> CadFace | CadEdge:
    """Return the face or edge that a selector names; raise NotOneFace if there is not exactly one."""
    match wanted:
        case RoundFace():
            return search.round_face(wanted, hollow=kind == "hole")
        case NearEdge():
            return search.edge(wanted.edge)
        case NearPlace():
            return search.plane(wanted)
    raise TypeError(f"{type(wanted).__name__} selects no face")


def axis_of(face: CadFace) -> Array:
    """Return the direction of a face's axis in the assembly, signed so that its largest component is positive."""
    largest = face.axis[int(np.abs(face.axis).argmax())]
    return face.axis if largest > 0 else -face.axis


def contact_side(search: PartSearch, kind: FeatureKind, feature: CadFace | CadEdge, other: str) -> dict[str, Any]:
    """Return the primitive, under its key, for the feature that a side of a contact selects; ``other`` is opposite."""
    if isinstance(feature, CadEdge):
        arc = {
            "centre": search.to_body(feature.centre),
            "normal": search.turned_to_body(feature.axis),
            "radius": length(feature.radius, search.millimetre),
        }
        part = {"middle": search.turned_to_body(feature.middle), "half_angle": feature.span / 2}
        return {"arc": arc | (part if feature.middle.any() else {})}
    if kind == "plane":
        return {"plane": {"point": search.to_body(feature.on), "normal": search.turned_to_body(feature.normal)}}
    cylinder = {
        "point": search.to_body(feature.point),
        "axis": search.turned_to_body(axis_of(feature)),
        "radius": length(feature.radius, search.millimetre),
    }
    if other not in ENDLESS_AGAINST[kind]:
        cylinder["half_length"] = length(np.ptp(feature.extent) / 2, search.millimetre)
    return {"bore" if kind == "hole" else "cylinder": cylinder}


def line_side(search: PartSearch, side: Mapping[str, Any], at: Array, axis: Array) -> dict[str, Any]:
    """Return the side of a joint, completed with point and axis, given in the assembly's frame, where it has none."""
    return {"point": search.to_body(at), "axis": search.turned_to_body(axis), **side}


# What the features give a mechanism as drawn: an outline for pictures, a `surface`, a pin in its hole.

PARALLEL = 1e-3  # largest angle [rad] between axes that count as parallel
_STEP = 1e-3  # mm: pictures need no more digits

_NO_PARAMETER_LINES = (
    "cannot be a surface: something has cut across it, so that its edges do not all run along parameter lines, or it "
    "is the offset of a spline; allowed: lofted, swept, turned or flat faces that nothing has cut across; {instead}"
    "name another face, or split this one in the CAD system along its parameter lines around the place of the "
    "contact, and name the piece"
)
_INSTEAD = {
    "plane": "name its plane with plane = { near }, ",
    "cylinder": "name it with hole or pin, of which only the ends count as edges, ",
    "sphere": "write it as a sphere or a socket, ",
    "cone": "write it as a turned profile, ",
    "torus": "write it as a turned profile, ",
}
# clearance [mm] below which a pin and its hole count as drawn with equal radii, beyond the recognition gap of both
NO_PLAY = 1e-9


def viewing_direction(assembly: CadAssembly) -> Array:
    """Return the axis direction with the largest total area of holes; z if there are no holes."""
    holes = [face for face in assembly.faces if face.kind == "cylinder" and face.hollow]
    if not holes:
        return np.array([0.0, 0.0, 1.0])
    axes, areas = np.array([hole.axis for hole in holes]), np.array([hole.area for hole in holes])
    shared = (np.abs(axes @ axes.T) > np.cos(PARALLEL)) @ areas
    axis = axes[int(shared.argmax())]
    return np.asarray(axis * np.sign(axis[int(np.abs(axis).argmax())]))


def drawn_outline(assembly: CadAssembly, part: str, direction: Array, millimetre: float) -> list[list[float]] | None:
    """Return the corners of a part's silhouette in the body's frame, shape (n, 3); None if it has no triangles."""
    from engine.cad.silhouette import silhouette

    mesh = next(mesh for mesh in assembly.meshes if mesh.part == part)
    outlines = silhouette(mesh, direction)
    if not outlines or len(outlines[0]) < 3:
        return None
    placement = assembly.part(part).placement
    corners = (outlines[0] - placement.translation) @ placement.rotation
    step = _STEP * millimetre
    return [[length(round(x / step) * step, millimetre) for x in corner] for corner in corners]


class NotASurface(Exception):
    """A face cannot be used as a contact surface; the message says why."""


def spline_faces(search: PartSearch, face: CadFace) -> list[dict[str, Any]]:
    """Return the B-splines of a face in the frame of the body, for a surface's table; NotASurface if it has none."""
    if not face.splines:
        text = _NO_PARAMETER_LINES.format(instead=_INSTEAD.get(face.kind, ""))
        raise NotASurface(f"{search.described(face)} {text}")
    return [_table(search, spline) for spline in face.splines]


def surface_table(wanted: FacesNear, splines: Sequence[Sequence[dict[str, Any]]]) -> dict[str, Any]:
    """Return the table of a surface from its selector and the B-splines of each of its faces."""
    own = wanted.model_dump(exclude={"faces"}, exclude_none=True)
    return {"faces": [table for each in splines for table in each], **own}


def drawn_faces(surface: dict[str, Any], faces: Sequence[CadFace]) -> list[DrawnFace]:
    """Return how exactly patches match the faces, in the order of their B-splines; empty if the surface is refused."""
    try:
        errors = iter(FreeFormSurface.model_validate(surface).conversion_errors)
    except ValidationError:
        return []  # the fault is reported where all tables are checked
    return [DrawnFace(kind="surface", conversion_error=max(next(errors) for _ in face.splines)) for face in faces]


def _table(search: PartSearch, spline: SplineSurface) -> dict[str, Any]:
    """Return the table of a B-spline in the frame of the body."""
    rational = not np.all(spline.weights == spline.weights[0, 0])
    placement = search.assembly.part(search.part).placement
    control = (spline.points - placement.translation) @ placement.rotation
    table = {
        "degree": list(spline.degrees),
        "knots_u": significant(spline.knots[0]).tolist(),
        "knots_v": significant(spline.knots[1]).tolist(),
        "control": [[lengths(point, search.millimetre) for point in row] for row in control],
    }
    return table | ({"weights": significant(spline.weights).tolist()} if rational else {})


# A pin in a hole as drawn: the position, length and play of the joint.


class NotAsDrawn(Exception):
    """The CAD file does not provide what a joint requires; the message says why, ``key`` for which key."""

    def __init__(self, key: str, text: str) -> None:
        super().__init__(text)
        self.key = key


@dataclass(frozen=True, eq=False)
class DrawnPin:
    """A pin in a hole at the start pose of the CAD file, in the mechanism's unit of length and the assembly's frame."""

    hole: CadFace
    pin: CadFace

    @cached_property
    def axis(self) -> Array:
        """The direction of the hole's axis."""
        return axis_of(self.hole)

    @cached_property
    def common(self) -> tuple[float, float]:
        """Start and end of the overlap of hole and pin along the hole's axis, measured from the hole's middle."""
        own = sorted(self.hole.extent * float(self.hole.axis @ self.axis))
        ends = [float((self.pin.point + end * self.pin.axis - self.hole.point) @ self.axis) for end in self.pin.extent]
        return max(own[0], min(ends)), min(own[1], max(ends))

    @property
    def middle(self) -> Array:
        """The point of the hole's axis in the middle of the overlap."""
        return np.asarray(self.hole.point + sum(self.common) / 2 * self.axis)

    @property
    def pin_axis(self) -> Array:
        """The direction of the pin's axis, with the sign that agrees with the hole's axis."""
        return self.pin.axis if self.pin.axis @ self.axis > 0 else -self.pin.axis

    @property
    def pin_middle(self) -> Array:
        """The point of the pin's axis at the middle of the overlap."""
        along = float((self.middle - self.pin.point) @ self.axis) / float(self.pin_axis @ self.axis)
        return np.asarray(self.pin.point + along * self.pin_axis)

    def certificate(self) -> DrawnJoint:
        """Return the clearance, and the distance and the angle between the axes."""
        tilt = float(np.arctan2(np.linalg.norm(np.cross(self.axis, self.pin_axis)), self.axis @ self.pin_axis))
        offset = float(np.linalg.norm(self.pin_middle - self.middle))
        return DrawnJoint(
            clearance=round(self.hole.radius - self.pin.radius, 15),
            axis_offset=offset,
            tilt=tilt,
            length=self.common[1] - self.common[0],
        )


def joint_of_pin(drawn: DrawnPin, joint: Mapping[str, Any], searches: tuple[PartSearch, PartSearch]) -> dict[str, Any]:
    """Return the table of a joint with a hole as its bearing and a pin as its journal, from that without selectors.

    The rings are at both ends of the overlap unless the table gives others; `AS_DRAWN` is replaced by a number. Raise
    NotAsDrawn if pin and hole do not overlap along the axis, or have no play although it is requested as drawn.
    """
    begin, end = drawn.common
    if end <= begin:
        text = f"pin and hole lie {begin - end:.4g} apart along the axis of the hole; allowed: a pin in its hole; name "
        raise NotAsDrawn("journal.pin", f"{text}other faces, or correct the assembly in the CAD file")
    if abs(float(drawn.pin_axis @ drawn.axis)) < 0.5:
        raise NotAsDrawn(
            "journal.pin", "the axes of pin and hole cross; allowed: nearly parallel axes; name other faces"
        )
    millimetre = searches[0].millimetre
    offset = drawn.certificate().axis_offset
    if offset >= drawn.hole.radius:
        raise NotAsDrawn(
            "journal.pin",
            f"its axis is {offset:.4g} from that of the hole; allowed: less than the hole's radius "
            f"{drawn.hole.radius:.4g}; name other faces, or correct the assembly in the CAD file",
        )
    half = length((end - begin) / 2, millimetre)
    result = {"rings": [-half, half], **joint}
    if joint.get("rings") == AS_DRAWN:
        result["rings"] = [-half, half]
    if joint.get("radial_clearance") == AS_DRAWN:
        result["radial_clearance"] = _clearance(drawn, millimetre)
    result["bearing"] = line_side(searches[0], joint["bearing"], drawn.middle, drawn.axis)
    radius = {} if "diameter" in joint["journal"] else {"radius": length(drawn.pin.radius, millimetre)}
    journal = {**radius, **joint["journal"]}
    result["journal"] = line_side(searches[1], journal, drawn.pin_middle, drawn.pin_axis)
    return result


def _clearance(drawn: DrawnPin, millimetre: float) -> float:
    """Return the difference between the radii; refuse a pair that has none."""
    clearance = drawn.hole.radius - drawn.pin.radius
    unsure = NO_PLAY * millimetre + drawn.hole.recognition_gap + drawn.pin.recognition_gap
    if clearance > unsure:
        return length(clearance, millimetre)
    what = "no play" if abs(clearance) <= unsure else "a pin that is larger than its hole"
    raise NotAsDrawn(
        "radial_clearance",
        f"drawn with {what}: the hole has radius {drawn.hole.radius:.9g}, the pin {drawn.pin.radius:.9g}; "
        "allowed: a number > 0; write the clearance, as the tolerances of the two give it",
    )

"""What a CAD part gives a mechanism as drawn: an outline for pictures, faces as a `surface`, a pin in its hole."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from pydantic import ValidationError

from engine.arrays import Array
from engine.cad import CadAssembly, CadFace, SplineSurface
from engine.mechanism.geometry.cad_table import AS_DRAWN, DrawnFace, DrawnJoint, FacesNear
from engine.mechanism.geometry.face_search import PartSearch, axis_of, length, lengths, line_side, significant
from engine.mechanism.surfaces.surface import FreeFormSurface

PARALLEL = 1e-3
"""Largest angle [rad] between axes that count as parallel."""

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
"""What to write instead for a face that is not free-form, by its kind."""

NO_PLAY = 1e-9
"""Clearance [mm] below which a pin and its hole count as drawn with equal radii, beyond the recognition gap of their
faces.
"""


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
    """Return the corners of a part's silhouette in the body's frame, shape (n, 3); None for a part without triangles.

    ``direction``, a unit vector in the assembly's frame, is that of the view, and ``millimetre`` the length of one in
    the mechanism's unit of length.
    """
    from engine.cad.silhouette import silhouette

    mesh = next(mesh for mesh in assembly.meshes if mesh.part == part)
    outlines = silhouette(mesh, direction)
    if not outlines or len(outlines[0]) < 3:
        return None
    placement = assembly.part(part).placement
    corners = (outlines[0] - placement.translation) @ placement.rotation
    step = _STEP * millimetre
    return [[length(round(x / step) * step, millimetre) for x in corner] for corner in corners]


# Faces of a CAD part as the primitive `surface`: B-splines that represent them, with normals out of the part.


class NotASurface(Exception):
    """A face cannot be used as a contact surface; the message says why."""


def spline_faces(search: PartSearch, face: CadFace) -> list[dict[str, Any]]:
    """Return the B-splines of a face in the frame of the body, as entries for the table of a surface.

    Raise NotASurface if the face has none.
    """
    if not face.splines:
        instead = _INSTEAD.get(face.kind, "")
        raise NotASurface(f"{search.described(face)} {_NO_PARAMETER_LINES.format(instead=instead)}")
    return [_table(search, spline) for spline in face.splines]


def surface_table(wanted: FacesNear, splines: Sequence[Sequence[dict[str, Any]]]) -> dict[str, Any]:
    """Return the table of a surface from its selector and the B-splines of each of its faces."""
    own = wanted.model_dump(exclude={"faces"}, exclude_none=True)
    return {"faces": [table for each in splines for table in each], **own}


def drawn_faces(surface: dict[str, Any], faces: Sequence[CadFace]) -> list[DrawnFace]:
    """Return how exactly the patches of a surface match the faces of the CAD file; empty if the surface is refused.

    The B-splines of ``surface`` are those of ``faces``, in the same order.
    """
    try:
        errors = iter(FreeFormSurface.model_validate(surface).conversion_errors)
    except ValidationError:
        return []  # the fault is reported where all tables are checked
    return [DrawnFace(kind="surface", conversion_error=max(next(errors) for _ in face.splines)) for face in faces]


def _table(search: PartSearch, spline: SplineSurface) -> dict[str, Any]:
    """Return the table of a B-spline in the frame of the body."""
    rational = not np.all(spline.weights == spline.weights[0, 0])
    control = search.placed_in_body(spline.points)
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
        raise NotAsDrawn(
            "journal.pin",
            f"pin and hole lie {begin - end:.4g} apart along the axis of the hole; allowed: a pin in its hole; "
            "name other faces, or correct the assembly in the CAD file",
        )
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

"""The keys with which a mechanism file names geometry of a CAD file: the file, its parts, and faces by position."""

from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from engine.mechanism.base import Number, Point, PositiveLength, TableModel

AS_DRAWN = "as drawn"
DENSITY = "the density of the part, or a list with that of each of its solids; default: as the CAD file has it"
PART = "the part of the CAD file that the body is: pose, mass, centre, inertia and outline come from it"


class CadTable(TableModel):
    """The CAD file whose geometry a mechanism names."""

    file: Annotated[str, StringConstraints(min_length=1)] = Field(
        description="the STEP file, by its path from the mechanism file"
    )
    sha256: Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")] = Field(
        description="the SHA-256 of that file's content, 64 hexadecimal digits; another content is refused"
    )
    recognition: Annotated[Number, Field(ge=0)] = Field(
        default=1e-4, description="the largest gap between a spline and what it is taken for, in mm, a number >= 0"
    )
    accept_damage: bool = Field(
        default=False, strict=True, description="true if what can be read of a damaged file is enough"
    )


class NearPlace(TableModel):
    """A face or an edge, selected by a point near it."""

    near: Point = Field(description="a point on the face or edge, or near it, in the frame of the body")
    within: PositiveLength | None = Field(
        default=None, description="how far away it may be, a number > 0; default: half a millimetre"
    )


class RoundFace(NearPlace):
    """A cylindrical face, selected by its radius and a point near its axis."""

    near: Point = Field(description="a point of its axis inside the face, or near it, in the frame of the body")
    radius: PositiveLength = Field(description="the radius of the face, a number > 0")


class NearEdge(TableModel):
    """A circular edge."""

    edge: NearPlace = Field(description="a point near the edge: { near, within }")


class FacesNear(TableModel):
    """Faces of any shape that together form one surface."""

    faces: Annotated[tuple[NearPlace, ...], Field(json_schema_extra={"minItems": 1})] = Field(
        description="faces of the CAD part, each { near, within }"
    )
    conversion: PositiveLength | None = Field(
        default=None, description="largest error of the patches in their place, a number > 0; default: 1e-5 of its size"
    )
    depth: PositiveLength | None = Field(
        default=None, description="the thickness of the plate behind a surface with open edges, a number > 0"
    )


class SideHole(TableModel):
    """A side given by the inside of a cylinder."""

    hole: RoundFace = Field(description="a hole of the CAD part: { radius, near, within }")


class SidePin(TableModel):
    """A side given by the outside of a cylinder."""

    pin: RoundFace = Field(description="a pin of the CAD part: { radius, near, within }")


class SidePlane(TableModel):
    """A side given by a flat face."""

    plane: NearPlace = Field(description="a flat face of the CAD part: { near, within }")


class SideArc(TableModel):
    """A side given by a circular edge."""

    arc: NearEdge = Field(description="a circular edge of the CAD part: { edge = { near, within } }")


class SideSurface(TableModel):
    """A side given by one or several faces of any shape."""

    surface: FacesNear = Field(description="faces of the CAD part: { faces = [{ near, within }, ...] }")


FeatureKind = Literal["hole", "pin", "plane", "arc", "surface"]

SELECTORS: dict[FeatureKind, type[TableModel]] = {
    "hole": SideHole,
    "pin": SidePin,
    "plane": SidePlane,
    "arc": SideArc,
    "surface": SideSurface,
}
"""The model of a table that holds nothing but a selector, by the selector's key."""

GEOMETRY_OF: dict[FeatureKind, tuple[str, ...]] = {
    "hole": ("Line", "Side"),
    "pin": ("Journal", "Side"),
    "plane": ("Face", "Side"),
    "arc": ("Side",),
    "surface": ("Side",),
}
"""The tables of sides in which a selector may stand, by their models."""


def selector_of(side: object) -> FeatureKind | None:
    """Return the key of a side that selects geometry of the CAD file; None if it selects none."""
    if not isinstance(side, dict):
        return None
    given: dict[FeatureKind, bool] = {
        "hole": "hole" in side,
        "pin": "pin" in side,
        "plane": isinstance(side.get("plane"), dict) and "near" in side["plane"],
        "arc": isinstance(side.get("arc"), dict) and "edge" in side["arc"],
        "surface": _names_faces(side.get("surface")),
    }
    return next((kind for kind, is_given in given.items() if is_given), None)


def _names_faces(surface: object) -> bool:
    """Return whether a surface names faces by position rather than giving control points."""
    faces = surface.get("faces") if isinstance(surface, dict) else None
    return isinstance(faces, list) and any(isinstance(face, dict) and "near" in face for face in faces)

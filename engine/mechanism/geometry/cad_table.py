"""The keys with which a mechanism file names geometry of a CAD file, and the certificate of how well it agrees.

The keys name the file, its parts, and faces by position. The certificate says how well the numbers of a mechanism agree
with the CAD file they were taken from.
"""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, StringConstraints, WithJsonSchema, create_model

from engine.mechanism.base import NonNegative, Number, Point, PositiveLength, TableModel, is_number, optional, refuse
from engine.mechanism.materials import density_of, unknown_material

AS_DRAWN = "as drawn"
DENSITY = (
    "the density of the body, as a number or by the name of its material; or a list with that of each solid, or a table"
    " with that of some of its parts; default: as the CAD file has it, or density in [cad]"
)
ONE_DENSITY: dict[str, Any] = {"anyOf": [{"type": "number", "exclusiveMinimum": 0}, {"type": "string"}]}
PARTS = "parts of the CAD file that are one rigid body; its frame is that of the first"
GROUPS = "which parts mechanism import makes one body; each list must be the parts of a body"
PART = "the part of the CAD file that the body is: pose, mass, centre, inertia and outline come from it"


def _density(value: Any) -> Any:
    """Read a density: a number, or the name of a material."""
    if isinstance(value, str) and density_of(value) is None:
        raise refuse(unknown_material(value))
    if not isinstance(value, str) and not (is_number(value) and value > 0):
        raise refuse("no density; allowed: a number > 0, or the name of a material; correct it")
    return value


class CadTable(TableModel):
    """The CAD file whose geometry a mechanism names."""

    file: Annotated[str, StringConstraints(min_length=1)] = Field(
        description="the STEP file, by its path from the mechanism file"
    )
    sha256: Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")] = Field(
        description="the SHA-256 of that file's content, 64 hexadecimal digits; another content is refused"
    )
    recognition: NonNegative = Field(
        default=1e-4, description="the largest gap between a spline and what it is taken for, in mm, a number >= 0"
    )
    density: Annotated[Any, BeforeValidator(_density), WithJsonSchema(ONE_DENSITY)] = optional(
        "the density of all solids of which the CAD file has none: a number > 0, or the name of a material"
    )
    accept_damage: bool = Field(
        default=False, strict=True, description="true if what can be read of a damaged file is enough"
    )


class NearPlace(TableModel):
    """A face or an edge, selected by a point near it."""

    near: Point = Field(description="a point on the face or edge, or near it, in the frame of the body")
    within: PositiveLength | None = optional("how far away it may be, a number > 0; default: half a millimetre")


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
    conversion: PositiveLength | None = optional(
        "largest error of the patches in their place, a number > 0; default: 1e-5 of its size"
    )
    depth: PositiveLength | None = optional("the thickness of the plate behind a surface with open edges, a number > 0")


FeatureKind = Literal["hole", "pin", "plane", "arc", "surface"]

# what selects geometry of a side, in words, and the tables of sides in which it may stand, by their models
_SELECTORS: dict[FeatureKind, tuple[type[TableModel], str, tuple[str, ...]]] = {
    "hole": (RoundFace, "a hole of the CAD part: { radius, near, within }", ("Bearing", "Side")),
    "pin": (RoundFace, "a pin of the CAD part: { radius, near, within }", ("Journal", "Side")),
    "plane": (NearPlace, "a flat face of the CAD part: { near, within }", ("Face", "Side")),
    "arc": (NearEdge, "a circular edge of the CAD part: { edge = { near, within } }", ("Side",)),
    "surface": (FacesNear, "faces of the CAD part: { faces = [{ near, within }, ...] }", ("Side",)),
}
GEOMETRY_OF = {kind: sides for kind, (_, _, sides) in _SELECTORS.items()}


def _of_a_side(kind: str, model: type[TableModel], words: str) -> type[TableModel]:
    """Return the model of a table that holds nothing but a selector."""
    keys: dict[str, Any] = {kind: (model, Field(description=words))}
    return create_model(f"Side{kind.title()}", __base__=TableModel, **keys)


SELECTORS = {kind: _of_a_side(kind, model, words) for kind, (model, words, _) in _SELECTORS.items()}


def selector_of(side: object) -> FeatureKind | None:
    """Return the key of a side that selects geometry of the CAD file; None if it selects none."""
    if not isinstance(side, dict):
        return None
    given: dict[FeatureKind, bool] = {
        "hole": "hole" in side,
        "pin": "pin" in side,
        "plane": isinstance(side.get("plane"), dict) and "near" in side["plane"],
        "arc": isinstance(side.get("arc"), dict) and "edge" in side["arc"],
        "surface": isinstance(side.get("surface"), dict) and _any_near(side["surface"].get("faces")),
    }
    return next((kind for kind, is_given in given.items() if is_given), None)


def _any_near(faces: object) -> bool:
    """Return whether faces are named by position rather than given by control points."""
    return isinstance(faces, list) and any(isinstance(face, dict) and "near" in face for face in faces)


# The certificate of geometry: how well the numbers of a mechanism agree with the CAD file they were taken from.


class DrawnBody(TableModel):
    """A body that is a part of the CAD file."""

    part: str = Field(description="the part")
    volume: Number = Field(description="the volume of its solids")
    drawn_mass: Number | None = optional("its volume times its density; none of a fixed body")
    mass: Number | None = optional("the mass that the mechanism file gives instead")
    density_from: str = Field(default="", description="where its density is from")


class DrawnFace(TableModel):
    """A face or edge used as a side."""

    kind: str = Field(description="hole, pin, plane, arc or surface")
    radius: Number | None = optional("its radius; none of a plane or a surface")
    recognition_gap: Number = Field(
        default=0.0, description="the largest distance between the surface in the file and what it was taken for"
    )
    conversion_error: Number | None = optional(
        "of a surface: the largest distance between its patches and the surface in the file"
    )


class DrawnJoint(TableModel):
    """A pin in a hole, as drawn."""

    clearance: Number = Field(description="radius of the hole minus that of the pin")
    axis_offset: Number = Field(description="the distance of the two axes at the middle of the joint")
    tilt: Number = Field(description="the angle between the two axes, in rad")
    length: Number | None = optional("the piece of the axis along which both go")


class DrawnGap(TableModel):
    """A gap at the start, computed in two ways."""

    drawn: Number = Field(description="the distance of the two in the CAD file, computed by OCCT; greater than 0")
    gap: Number | None = optional("by the functions that a run uses; none of a mechanism that has not been assembled")
    added: Number = Field(
        default=0.0,
        description="what the mechanism file adds to the drawing: clearance minus that as drawn, or minus the offset",
    )

    @property
    def difference(self) -> float | None:
        """Excess of the gap over the sum of drawn distance and addition in the mechanism file; None if not known."""
        return None if self.gap is None else self.gap - self.added - self.drawn


class GeometryCertificate(TableModel):
    """What was taken from a CAD file, and how accurately; lengths in the mechanism's unit."""

    file: str = Field(description="the CAD file")
    sha256: str = Field(description="of its content")
    recognition: Number = Field(description="the largest recognition gap that was allowed, in mm")
    unreadable: int | None = optional("how many entities of the damaged file were left out; none of a sound file")
    damaged: list[str] = Field(default=[], description="the bodies' parts of which they are")
    bodies: dict[str, DrawnBody] = Field(default={}, description="the bodies that are parts")
    faces: dict[str, DrawnFace] = Field(default={}, description="the sides that are faces or edges, by their keys")
    joints: dict[str, DrawnJoint] = Field(default={}, description="the joints whose two sides are faces")
    gaps: dict[str, DrawnGap] = Field(
        default={},
        description="joints and contacts both of whose sides are drawn, apart from each other, by their keys",
    )
    not_measured: str = Field(default="", description="why OCCT has measured no gaps; empty if it has")

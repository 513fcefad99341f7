"""The certificate of geometry: how well the numbers of a mechanism agree with the CAD file they were taken from."""

from pydantic import Field

from engine.mechanism.base import Number, TableModel


class DrawnBody(TableModel):
    """A body that is a part of the CAD file."""

    part: str = Field(description="the part")
    volume: Number = Field(description="the volume of its solids")
    drawn_mass: Number | None = Field(default=None, description="its volume times its density; none of a fixed body")
    mass: Number | None = Field(default=None, description="the mass that the mechanism file gives instead")
    density_from: str = Field(default="", description="where its density is from")


class DrawnFace(TableModel):
    """A face or edge used as a side."""

    kind: str = Field(description="hole, pin, plane, arc or surface")
    radius: Number | None = Field(default=None, description="its radius; none of a plane or a surface")
    recognition_gap: Number = Field(
        default=0.0, description="the largest distance between the surface in the file and what it was taken for"
    )
    conversion_error: Number | None = Field(
        default=None, description="of a surface: the largest distance between its patches and the surface in the file"
    )


class DrawnJoint(TableModel):
    """A pin in a hole, as drawn."""

    clearance: Number = Field(description="radius of the hole minus that of the pin")
    axis_offset: Number = Field(description="the distance of the two axes at the middle of the joint")
    tilt: Number = Field(description="the angle between the two axes, in rad")
    length: Number | None = Field(default=None, description="the piece of the axis along which both go")


class DrawnGap(TableModel):
    """A gap at the start, computed in two ways."""

    drawn: Number = Field(description="the distance of the two in the CAD file, computed by OCCT; greater than 0")
    gap: Number | None = Field(
        default=None, description="by the functions that a run uses; none of a mechanism that has not been assembled"
    )
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
    unreadable: int | None = Field(
        default=None, description="how many entities of the damaged file were left out; none of a sound file"
    )
    bodies: dict[str, DrawnBody] = Field(default={}, description="the bodies that are parts")
    faces: dict[str, DrawnFace] = Field(default={}, description="the sides that are faces or edges, by their keys")
    joints: dict[str, DrawnJoint] = Field(default={}, description="the joints whose two sides are faces")
    gaps: dict[str, DrawnGap] = Field(
        default={},
        description="joints and contacts both of whose sides are drawn, apart from each other, by their keys",
    )
    not_measured: str = Field(default="", description="why OCCT has measured no gaps; empty if it has")

"""The certificate of geometry: how well the numbers of a mechanism agree with the CAD file they come from."""

from pydantic import Field

from engine.mechanism.base import Number, TableModel


class DrawnBody(TableModel):
    """A body that is a part."""

    part: str = Field(description="the part")
    volume: Number = Field(description="the volume of its solids")
    drawn_mass: Number | None = Field(default=None, description="its volume times its density; none of a fixed body")
    mass: Number | None = Field(default=None, description="the mass that the mechanism file gives instead")
    density_from: str = Field(default="", description="where its density is from")


class DrawnFace(TableModel):
    """A face or edge that a side is."""

    kind: str = Field(description="hole, pin, plane or arc")
    radius: Number | None = Field(default=None, description="its radius; none of a plane")
    recognition_gap: Number = Field(
        default=0.0, description="the largest distance between the surface in the file and what it was taken for"
    )


class DrawnJoint(TableModel):
    """A pin in a hole, as drawn."""

    clearance: Number = Field(description="radius of the hole minus that of the pin")
    axis_offset: Number = Field(description="the distance of the two axes at the middle of the joint")
    tilt: Number = Field(description="the angle between the two axes, in rad")


class DrawnGap(TableModel):
    """A gap at the start, computed twice."""

    gap: Number = Field(description="by the functions that a run uses")
    drawn: Number = Field(description="the distance of the faces in the CAD file, computed by OCCT")


class GeometryCertificate(TableModel):
    """What was taken from a CAD file, and how exactly; lengths in the mechanism's unit."""

    file: str = Field(description="the CAD file")
    sha256: str = Field(description="of its content")
    recognition: Number = Field(description="the largest recognition gap that was allowed, in mm")
    bodies: dict[str, DrawnBody] = Field(default={}, description="the bodies that are parts")
    faces: dict[str, DrawnFace] = Field(default={}, description="the sides that are faces or edges, by their keys")
    joints: dict[str, DrawnJoint] = Field(default={}, description="the joints whose two sides are faces")
    gaps: dict[str, DrawnGap] = Field(default={}, description="the contacts both of whose sides are faces or edges")

"""The contact primitive `mesh`: a mesh file, which becomes convex pieces when the mechanism is loaded."""

from functools import cached_property
from typing import Annotated, Self

from pydantic import Field, StringConstraints, model_validator

from engine.mechanism.base import PositiveNumber, TableModel, added, optional, refuse
from engine.mechanism.meshes.polyhedra import NotSolid, Polyhedron, hull_of
from engine.mechanism.quantities import Quantity
from engine.mechanism.surfaces.surface import ArrayOf, FixedArray

MOST_PIECES = 64
MOST_CORNERS = 128  # of a piece; the time of a contact grows with the product of those of both sides

OF_A_BODY = "the mesh file whose solid, with density, gives the body its mass, center_of_mass and inertia"
_CORNERS = f"the corners of a convex piece, 4 to {MOST_CORNERS} points [x, y, z] of finite numbers"
Piece = Annotated[FixedArray, ArrayOf((0, 3), _CORNERS, MOST_CORNERS), Quantity("length")]


class MeshFile(TableModel):
    """A mesh in a file: closed surfaces of triangles, whose normals point outwards."""

    file: Annotated[str, StringConstraints(min_length=1, max_length=1000)] = Field(
        description="the STL file, binary or ASCII, by its path from the mechanism file, in the frame of the body"
    )
    scale: PositiveNumber = Field(
        default=1.0, description="the length of one unit of the file in the mechanism's unit, a number > 0"
    )
    deviation: Annotated[PositiveNumber | None, Quantity("length")] = optional(
        "how far the surface of the pieces may be from the mesh, a number > 0; default: 1e-3 of its size"
    )


class Mesh(TableModel):
    """A solid of convex pieces: from a mesh file, or each given by its corners."""

    file: str | None = added("the STL file, binary or ASCII, by its path from the mechanism file, in the body frame")
    scale: PositiveNumber | None = added(
        "the length of one unit of the file in the mechanism's unit, a number > 0; default: 1"
    )
    deviation: Annotated[PositiveNumber | None, Quantity("length")] = added(
        "how far the surface of the pieces may be from the mesh, a number > 0; default: 1e-3 of its size"
    )
    pieces: Annotated[tuple[Piece, ...] | None, Field(json_schema_extra={"minItems": 1, "maxItems": MOST_PIECES})] = (
        added("in place of a file: convex pieces, each the list of its corners [x, y, z]")
    )

    @cached_property
    def polyhedra(self) -> tuple[Polyhedron, ...]:
        """The pieces in the frame of the body."""
        return tuple(hull_of(piece.numbers) for piece in self.pieces or ())

    @model_validator(mode="after")
    def _has_pieces(self) -> Self:
        if self.file is not None:
            text = "names a mesh file, and none is opened for a mechanism that comes as text; allowed: pieces; write"
            raise refuse(f"{text} them with clearcap mechanism plain FILE -o PLAIN.toml", key="file", value=self.file)
        if not self.pieces:
            raise refuse("has neither a file nor pieces; allowed: exactly one of both; add it")
        for key in ("scale", "deviation"):
            if getattr(self, key) is not None:
                text = "belongs to a file; allowed: none beside pieces; remove it"
                raise refuse(text, key=key, value=getattr(self, key))
        if len(self.pieces) > MOST_PIECES:
            text = f"has {len(self.pieces)} pieces; allowed: 1 to {MOST_PIECES}; join some, or use several contacts"
            raise refuse(text, key="pieces")
        for number, piece in enumerate(self.pieces):
            try:
                hull_of(piece.numbers)
            except NotSolid:
                text = "has no volume; allowed: four or more points that are not in one plane; correct them"
                raise refuse(text, key=f"pieces.{number}") from None
        return self

"""The certificate of a mesh: how far its convex pieces are from it."""

from pydantic import Field

from engine.mechanism.base import Number, TableModel


class MeshCertificate(TableModel):
    """A mesh as convex pieces; lengths in the mechanism's unit."""

    file: str = Field(description="the mesh file")
    sha256: str = Field(description="of its content")
    triangles: int = Field(description="how many triangles it has")
    pieces: int = Field(description="how many convex pieces")
    corners: int = Field(description="how many corners all pieces have")
    mesh_to_pieces: Number = Field(description="no point of the mesh is farther from the surface of the pieces")
    pieces_to_mesh: Number = Field(description="no point of the surface of the pieces is farther from the mesh")
    allowed: Number = Field(description="the limit of both")

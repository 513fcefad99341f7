"""The outline with which pictures show a body that is a part: its silhouette along the axis of most holes."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from pydantic import ValidationError

from engine.arrays import Array
from engine.cad import CadAssembly, CadFace, SplineSurface
from engine.mechanism.geometry.cad_table import FacesNear
from engine.mechanism.geometry.face_search import PartSearch, length, lengths, significant
from engine.mechanism.geometry.geometry_certificate import DrawnFace
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

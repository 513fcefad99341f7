"""The outline with which pictures show a body that is a part: its silhouette along the axis of most holes."""

import numpy as np

from engine.arrays import Array
from engine.cad import CadAssembly
from engine.mechanism.geometry.plain_numbers import length

PARALLEL = 1e-3
"""Largest angle [rad] between axes that count as parallel."""

_STEP = 1e-3  # mm: pictures need no more digits


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

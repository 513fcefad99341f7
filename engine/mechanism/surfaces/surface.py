"""The contact primitive `surface`: faces of any shape, given as bicubic patches or as one or several B-splines."""

from functools import cached_property
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, model_validator

from engine.arrays import Array
from engine.mechanism.base import PositiveLength, TableModel, refuse
from engine.mechanism.quantities import Quantity
from engine.mechanism.surfaces.patches import (
    MOST_OF_RADIUS,
    THIRDS,
    MeetingEdges,
    default_depth,
    extent,
    joined_faces,
    largest_depth,
    meeting_edges,
    normals,
    plate,
    sharp_gap,
)
from engine.mechanism.surfaces.splines import (
    MOST_PATCHES,
    MOST_WRITTEN,
    ArrayOf,
    BSplineSurface,
    FixedArray,
    Knots,
    Net,
    SplineFace,
    Weights,
    bicubic_patches,
    check_spline,
    spline_of,
)

CONVERSION = 1e-5  # default conversion error as a share of the surface's size
ROUNDING = 1e-13  # smallest conversion error that can be requested, as a share of the size

_PATCH = "a list of patches, each 4 rows of 4 control points [x, y, z] of finite numbers, rows along u"
Points = Annotated[FixedArray, ArrayOf((0, 4, 4, 3), _PATCH, MOST_WRITTEN), Quantity("length")]

_OF_A_SPLINE = ("degree", "knots_u", "knots_v", "control")
_FORMS = "patches, or degree, knots_u, knots_v and control, or faces; write one of them"


def _is_none(value: Any) -> bool:
    """Return whether an entry is absent; it is then excluded from digests, so that earlier digests do not change."""
    return value is None


class _Faces:
    """The faces of a surface and how they meet; never compared for equality."""

    def __init__(self, patches: Array, errors: tuple[float, ...], complete: bool) -> None:
        self.patches = patches
        self.errors = errors
        self.complete = len(patches) <= MOST_PATCHES and complete

    @cached_property
    def meeting(self) -> MeetingEdges:
        return meeting_edges(self.patches)


class FreeFormSurface(TableModel):
    """A solid with faces of any shape: bicubic Bezier patches or B-spline surfaces; S_u x S_v points outwards."""

    patches: Points | None = Field(
        default=None, description="bicubic Bezier patches: of each 4 rows along u of 4 control points along v"
    )
    degree: tuple[int, int] | None = Field(
        default=None, description="the degrees of a B-spline surface along u and along v, 1 to 15 each"
    )
    knots_u: Knots | None = Field(
        default=None, description="its knots along u: as many as control points, + degree + 1"
    )
    knots_v: Knots | None = Field(default=None, description="its knots along v")
    control: Net | None = Field(default=None, description="its control points: rows along u of points along v")
    weights: Weights | None = Field(default=None, description="the weights of its control points; default: all 1")
    conversion: Annotated[PositiveLength | None, Quantity("length")] = Field(
        default=None,
        description="largest error of bicubic patches in place of B-splines, a number > 0; default: 1e-5 of their size",
    )
    depth: Annotated[PositiveLength | None, Quantity("length")] = Field(
        default=None,
        description="the thickness of the plate behind a surface with open edges, a number > 0; default: a quarter of "
        "its size, or half its least convex radius of curvature if that is less",
    )
    faces: Annotated[tuple[SplineFace, ...], Field(json_schema_extra={"minItems": 1})] | None = Field(
        default=None, exclude_if=_is_none, description="several B-spline surfaces, each with degree, knots and control"
    )

    @property
    def conversion_error(self) -> float:
        """Largest distance between the patches and the B-splines they replace [length]; 0 if patches are given."""
        return max(self.conversion_errors, default=0.0)

    @property
    def conversion_errors(self) -> tuple[float, ...]:
        """The same for each B-spline; empty if patches are given."""
        return self._faces.errors

    @property
    def allowed_error(self) -> float:
        """The largest conversion error allowed [length]."""
        size = extent(np.concatenate([spline.control.reshape(-1, 3) for spline in self._splines]))
        return max(CONVERSION * size if self.conversion is None else self.conversion, ROUNDING * size)

    @property
    def top(self) -> Array:
        """The bicubic patches of the faces only, shape (n, 4, 4, 3)."""
        return self._faces.patches

    @property
    def boundary(self) -> Array:
        """All patches that bound the solid: the top and, if it has open edges, the sides and the back of a plate."""
        meeting = self._faces.meeting
        if not meeting.is_open.any():
            return self.top
        return plate(self.top, meeting, default_depth(self.top) if self.depth is None else self.depth)

    @property
    def outline(self) -> tuple[Array, Array]:
        """Control points of the open edges of the faces, and of each other edge once, shapes (n, 4, 3)."""
        edges, is_open = self._faces.meeting.edges, self._faces.meeting.is_open
        inner = ~is_open
        inner[:, :2] = False  # these are edges of the neighbour, too
        return edges[is_open], edges[inner]

    @cached_property
    def _faces(self) -> "_Faces":
        if self.patches is not None:
            return _Faces(self.patches.numbers, (), True)
        allowed = self.allowed_error
        converted = [bicubic_patches(spline, allowed) for spline in self._splines]
        complete = all(each.complete for each in converted)
        if self.faces is None:
            return _Faces(converted[0].patches, (converted[0].error,), complete)
        patches, moved = joined_faces([each.patches for each in converted])
        return _Faces(patches, tuple(each.error + far for each, far in zip(converted, moved, strict=True)), complete)

    @property
    def _splines(self) -> list[BSplineSurface]:
        if self.faces is not None:
            return [face.spline for face in self.faces]
        given: dict[str, Any] = {key: getattr(self, key) for key in _OF_A_SPLINE}
        return [spline_of(given["degree"], (given["knots_u"], given["knots_v"]), given["control"], self.weights)]

    @model_validator(mode="after")
    def _is_a_surface(self) -> Self:
        given = [key for key in _OF_A_SPLINE if getattr(self, key) is not None]
        if (self.patches is not None) + bool(given) + (self.faces is not None) != 1:
            raise refuse(f"which form? allowed: {_FORMS}")
        if self.faces is not None and not 1 <= len(self.faces) <= MOST_WRITTEN:
            text = f"{len(self.faces)} faces; allowed: 1 to {MOST_WRITTEN}; name the faces of the contact"
            raise refuse(text, key="faces")
        if not given and self.weights is not None:
            raise refuse("belongs to a B-spline surface; remove it, or write the surface as one", key="weights")
        if self.patches is not None and self.conversion is not None:
            raise refuse("belongs to a B-spline surface; remove it, or write the surface as one", key="conversion")
        missing = [key for key in _OF_A_SPLINE if key not in given]
        if given and missing:
            raise refuse("missing; a B-spline surface has degree, knots_u, knots_v and control; add it", key=missing[0])
        if given:
            check_spline(self._splines[0])
        if self.patches is None and not self._faces.complete:
            raise refuse(
                f"needs more than {MOST_PATCHES} bicubic patches; an error of {self.conversion_error:.2g} takes"
                " fewer; write a larger one, or a smaller part of the surface",
                key="conversion",
                value=self.conversion,
            )
        self._check_shape()
        return self

    def _check_shape(self) -> None:
        """Refuse patches without extent or normals, with normals on opposite sides, or with an unsuitable depth."""
        key = "patches" if self.patches is not None else "faces" if self.faces is not None else "control"
        top = self.top
        if extent(top) == 0.0 or np.linalg.norm(normals(top, THIRDS), axis=-1).max(axis=(1, 2)).min() == 0.0:
            raise refuse("has a patch that is a line or a point; allowed: patches with an area; remove it", key=key)
        if self._faces.meeting.opposed:
            one, other = self._faces.meeting.opposed[0]
            raise refuse(
                f"patches {one} and {other} share an edge, with their normals on different sides; allowed: all normals "
                "S_u x S_v outside; write the rows of one of them as columns",
                key=key,
            )
        if self.faces is not None and (gap := sharp_gap(top, self._faces.meeting)):
            raise refuse(
                f"patches {gap[0]} and {gap[1]} meet at a sharp edge, and do not have it in common exactly; allowed: "
                "faces that share an edge to the last digits, or whose normals there are less than 90 degrees apart; "
                "write a contact of its own for each face",
                key=key,
            )
        if self.depth is None:
            return
        if not self._faces.meeting.is_open.any():
            raise refuse("a closed surface has no plate behind it; remove it", key="depth", value=self.depth)
        most = largest_depth(top)
        if self.depth > most:
            raise refuse(
                f"the back of the plate would fold; allowed: up to {most:.4g}, {MOST_OF_RADIUS:g} of the least radius "
                "with which the surface turns away from its normals; make it smaller",
                key="depth",
                value=self.depth,
            )

"""The contact primitive `surface`: faces of any shape, as bicubic patches or as a B-spline."""

from functools import cached_property
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, model_validator

from engine.arrays import Array
from engine.mechanism.base import PositiveLength, TableModel, refuse
from engine.mechanism.quantities import Quantity
from engine.mechanism.surfaces.bezier import THIRDS, normals
from engine.mechanism.surfaces.edges import MeetingEdges, extent, meeting_edges
from engine.mechanism.surfaces.fixed_array import ArrayOf, FixedArray
from engine.mechanism.surfaces.plates import default_depth, largest_depth, plate
from engine.mechanism.surfaces.splines import MOST_PATCHES, BSplineSurface, ConvertedSpline, bicubic_patches

MOST_WRITTEN = 1000  # patches, or control points in a row, of a file
MOST_DEGREE = 15
CONVERSION = 1e-5  # share of the surface's size: default of the conversion error
ROUNDING = 1e-13  # of it: less cannot be asked for

_PATCH = "a list of patches, each 4 rows of 4 control points [x, y, z] of finite numbers, rows along u"
_NET = "rows of control points [x, y, z] of finite numbers, one row for each step along u, all equally long"
_WEIGHTS = "rows of positive weights, one for each control point"
_KNOTS = "a list of increasing finite numbers"
Points = Annotated[FixedArray, ArrayOf((0, 4, 4, 3), _PATCH, MOST_WRITTEN), Quantity("length")]
Net = Annotated[FixedArray, ArrayOf((0, 0, 3), _NET, MOST_WRITTEN), Quantity("length")]
Weights = Annotated[FixedArray, ArrayOf((0, 0), _WEIGHTS, MOST_WRITTEN), Quantity("number")]
Knots = Annotated[FixedArray, ArrayOf((0,), _KNOTS, MOST_WRITTEN + MOST_DEGREE + 1), Quantity("number")]

_OF_A_SPLINE = ("degree", "knots_u", "knots_v", "control")


class _Faces:
    """The faces of a surface, and how they meet: of two of them it is not asked whether they are equal."""

    def __init__(self, converted: ConvertedSpline) -> None:
        self.converted = converted

    @cached_property
    def meeting(self) -> MeetingEdges:
        return meeting_edges(self.converted.patches)


class FreeFormSurface(TableModel):
    """A solid with faces of any shape: bicubic Bezier patches, or one B-spline surface; S_u x S_v points outside."""

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
        description="largest error of bicubic patches in place of a B-spline, a number > 0; default: 1e-5 of its size",
    )
    depth: Annotated[PositiveLength | None, Quantity("length")] = Field(
        default=None,
        description="the thickness of the plate behind a surface with open edges, a number > 0; default: a quarter of "
        "its size, or half its least convex radius of curvature if that is less",
    )

    @property
    def conversion_error(self) -> float:
        """The largest distance of the patches from the B-spline that they replace [length]; 0 for patches."""
        return self._faces.converted.error

    @property
    def top(self) -> Array:
        """The bicubic patches of the faces themselves, shape (n, 4, 4, 3)."""
        return self._faces.converted.patches

    @property
    def boundary(self) -> Array:
        """All patches that bound the solid: the top and, where that has open edges, sides and back of a plate."""
        meeting = self._faces.meeting
        if not meeting.is_open.any():
            return self.top
        return plate(self.top, meeting, default_depth(self.top) if self.depth is None else self.depth)

    @property
    def outline(self) -> tuple[Array, Array]:
        """Control points of the open edges of the faces, and of all other edges once, shapes (n, 4, 3)."""
        edges, is_open = self._faces.meeting.edges, self._faces.meeting.is_open
        inner = ~is_open
        inner[:, :2] = False  # the neighbour has these
        return edges[is_open], edges[inner]

    @cached_property
    def _faces(self) -> "_Faces":
        if self.patches is not None:
            return _Faces(ConvertedSpline(self.patches.numbers, 0.0, True))
        spline = self._spline
        size = extent(spline.control)
        asked = CONVERSION * size if self.conversion is None else self.conversion
        return _Faces(bicubic_patches(spline, max(asked, ROUNDING * size)))

    @property
    def _spline(self) -> BSplineSurface:
        given: dict[str, Any] = {key: getattr(self, key) for key in _OF_A_SPLINE}
        control, knots = given["control"].numbers, (given["knots_u"].numbers, given["knots_v"].numbers)
        weights = np.ones(control.shape[:2]) if self.weights is None else self.weights.numbers
        return BSplineSurface(given["degree"], knots, control, weights)

    @model_validator(mode="after")
    def _is_a_surface(self) -> Self:
        given = [key for key in _OF_A_SPLINE if getattr(self, key) is not None]
        if (self.patches is None) == (not given):
            raise refuse("which form? allowed: patches, or degree, knots_u, knots_v and control; write one of the two")
        if self.patches is not None:
            for key in ("weights", "conversion"):
                if getattr(self, key) is not None:
                    raise refuse("belongs to a B-spline surface; remove it, or write the surface as one", key=key)
        else:
            self._check_spline()
            if not self._faces.converted.complete:
                raise refuse(
                    f"needs more than {MOST_PATCHES} bicubic patches; an error of {self.conversion_error:.2g} takes"
                    " fewer; write a larger one, or a smaller part of the surface",
                    key="conversion",
                    value=self.conversion,
                )
        self._check_shape()
        return self

    def _check_spline(self) -> None:
        """Refuse a B-spline whose degrees, knots, control points and weights do not fit each other."""
        missing = [key for key in _OF_A_SPLINE if getattr(self, key) is None]
        if missing:
            raise refuse("missing; a B-spline surface has degree, knots_u, knots_v and control; add it", key=missing[0])
        spline = self._spline
        if not all(1 <= p <= MOST_DEGREE for p in spline.degree):
            raise refuse(f"allowed: 1 to {MOST_DEGREE} each; correct it", key="degree", value=list(spline.degree))
        for axis, (key, p, knots) in enumerate(zip(("knots_u", "knots_v"), spline.degree, spline.knots, strict=True)):
            _check_knots(key, knots, p, spline.control.shape[axis])
        if spline.weights.shape != spline.control.shape[:2] or not np.all(spline.weights > 0.0):
            raise refuse("does not fit; allowed: a weight > 0 for each control point, in the same rows", key="weights")

    def _check_shape(self) -> None:
        """Refuse patches without extent or normal, with normals on different sides, and a depth that does not fit."""
        key, top = ("control" if self.patches is None else "patches"), self.top
        if extent(top) == 0.0 or np.linalg.norm(normals(top, THIRDS), axis=-1).max(axis=(1, 2)).min() == 0.0:
            raise refuse("has a patch that is a line or a point; allowed: patches with an area; remove it", key=key)
        if self._faces.meeting.opposed:
            one, other = self._faces.meeting.opposed[0]
            raise refuse(
                f"patches {one} and {other} share an edge, with their normals on different sides; allowed: all normals "
                "S_u x S_v outside; write the rows of one of them as columns",
                key=key,
            )
        if self.depth is None:
            return
        if not self._faces.meeting.is_open.any():
            raise refuse("a closed surface has no plate behind it; remove it", key="depth", value=self.depth)
        most = largest_depth(top)
        if self.depth > most:
            raise refuse(
                f"the back of the plate would fold; allowed: up to {most:.4g}, {0.9:g} of the least radius with which "
                "the surface turns away from its normals; make it smaller",
                key="depth",
                value=self.depth,
            )


def _check_knots(key: str, knots: Array, degree: int, count: int) -> None:
    """Refuse a knot vector that does not fit the degree and the number of control points, or does not increase."""
    where: dict[str, Any] = {"key": key}
    if count <= degree:
        raise refuse(f"{count} control points for degree {degree}; allowed: more than the degree", key="control")
    if len(knots) != count + degree + 1:
        raise refuse(
            f"{len(knots)} knots; allowed: {count + degree + 1}, for {count} control points of degree {degree}; "
            "write each knot as often as its multiplicity",
            **where,
        )
    if np.any(np.diff(knots) < 0.0) or knots[degree] == knots[count]:
        raise refuse("does not increase; allowed: knots in increasing order, not all equal; sort them", **where)
    inner = knots[degree + 1 : count]
    if any(np.count_nonzero(inner == knot) > degree for knot in np.unique(inner)):
        raise refuse(f"has a knot more than {degree} times; the surface would be torn there; write it as two", **where)

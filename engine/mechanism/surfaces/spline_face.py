"""B-spline surfaces as written in a file: control points, knots and weights that are consistent."""

from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, model_validator

from engine.arrays import Array
from engine.mechanism.base import TableModel, refuse
from engine.mechanism.quantities import Quantity
from engine.mechanism.surfaces.fixed_array import ArrayOf, FixedArray
from engine.mechanism.surfaces.splines import BSplineSurface

MOST_WRITTEN = 1000  # largest number of patches, or of control points in a row, in a file
MOST_DEGREE = 15

_NET = "rows of control points [x, y, z] of finite numbers, one row for each step along u, all equally long"
_WEIGHTS = "rows of positive weights, one for each control point"
_KNOTS = "a list of increasing finite numbers"
Net = Annotated[FixedArray, ArrayOf((0, 0, 3), _NET, MOST_WRITTEN), Quantity("length")]
Weights = Annotated[FixedArray, ArrayOf((0, 0), _WEIGHTS, MOST_WRITTEN), Quantity("number")]
Knots = Annotated[FixedArray, ArrayOf((0,), _KNOTS, MOST_WRITTEN + MOST_DEGREE + 1), Quantity("number")]


class SplineFace(TableModel):
    """One B-spline of a surface that consists of several."""

    degree: tuple[int, int] = Field(description="its degrees along u and along v, 1 to 15 each")
    knots_u: Knots = Field(description="its knots along u: as many as control points, + degree + 1")
    knots_v: Knots = Field(description="its knots along v")
    control: Net = Field(description="its control points: rows along u of points along v")
    weights: Weights | None = Field(default=None, description="the weights of its control points; default: all 1")

    @property
    def spline(self) -> BSplineSurface:
        """The surface as arrays."""
        return spline_of(self.degree, (self.knots_u, self.knots_v), self.control, self.weights)

    @model_validator(mode="after")
    def _fits(self) -> Self:
        check_spline(self.spline)
        return self


def spline_of(
    degree: tuple[int, int], knots: tuple[FixedArray, FixedArray], control: FixedArray, weights: FixedArray | None
) -> BSplineSurface:
    """Return a B-spline surface from the entries of a table; the weights are 1 by default."""
    net = control.numbers
    own = np.ones(net.shape[:2]) if weights is None else weights.numbers
    return BSplineSurface(degree, (knots[0].numbers, knots[1].numbers), net, own)


def check_spline(spline: BSplineSurface) -> None:
    """Refuse a B-spline whose degrees, knots, control points and weights are inconsistent, with the key at fault."""
    if not all(1 <= p <= MOST_DEGREE for p in spline.degree):
        raise refuse(f"allowed: 1 to {MOST_DEGREE} each; correct it", key="degree", value=list(spline.degree))
    for axis, (key, p, knots) in enumerate(zip(("knots_u", "knots_v"), spline.degree, spline.knots, strict=True)):
        _check_knots(key, knots, p, spline.control.shape[axis])
    if spline.weights.shape != spline.control.shape[:2] or not np.all(spline.weights > 0.0):
        raise refuse("does not fit; allowed: a weight > 0 for each control point, in the same rows", key="weights")


def _check_knots(key: str, knots: Array, degree: int, count: int) -> None:
    """Refuse a knot vector that does not match the degree and the number of control points, or does not increase."""
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

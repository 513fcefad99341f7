"""B-spline surfaces as written in a file, and their conversion to bicubic patches.

Arrays of numbers, such as a mesh of points or a knot vector, form one value of a file, without keys inside.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from math import comb
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, GetCoreSchemaHandler, GetJsonSchemaHandler, model_validator
from pydantic_core import core_schema

from engine.arrays import Array
from engine.mechanism.base import LARGEST_NUMBER, TableModel, is_number, refuse
from engine.mechanism.quantities import Quantity


class FixedArray:
    """An immutable array; two are equal if all their numbers are."""

    __slots__ = ("numbers",)

    def __init__(self, numbers: Array) -> None:
        numbers = np.array(numbers, float)
        numbers.setflags(write=False)
        self.numbers = numbers

    def __eq__(self, other: object) -> bool:
        return isinstance(other, FixedArray) and np.array_equal(self.numbers, other.numbers)

    def __hash__(self) -> int:
        return hash(self.numbers.tobytes())

    def __repr__(self) -> str:
        return f"FixedArray{self.numbers.shape}"


class ArrayOf:
    """The requirements for an array in a file, as the annotation of a field with the type `FixedArray`.

    A length 0 in ``shape`` stands for any length from 1 to ``most``; ``words`` describes the array and its notation,
    for messages.
    """

    def __init__(self, shape: tuple[int, ...], words: str, most: int) -> None:
        self.shape, self.words, self.most = shape, words, most

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        """Read the array from lists, and write it as lists."""
        to_lists: Callable[[Any], Any] = lambda value: value.numbers.tolist()  # noqa: E731
        return core_schema.no_info_plain_validator_function(
            self.read, serialization=core_schema.plain_serializer_function_ser_schema(to_lists)
        )

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Describe the nested lists."""
        described: dict[str, Any] = {"type": ["number"]}  # a list of types, so that no expression is allowed here
        for length in reversed(self.shape):
            bounds = {"minItems": length or 1, "maxItems": length or self.most}
            described = {"type": "array", "items": described, **bounds}
        return described

    def read(self, value: Any) -> FixedArray:
        """Return the array of nested lists of numbers.

        Raise the error of `refuse` if the lists have other lengths, or contain anything but finite numbers.
        """
        if isinstance(value, FixedArray):
            value = value.numbers.tolist()
        fault = self._fault(value, self.shape)
        if fault:
            raise refuse(f"{fault}; allowed: {self.words}")
        numbers = np.array(value, float)
        if not np.all(np.abs(numbers) <= LARGEST_NUMBER):
            raise refuse(f"has a number beyond any real quantity; allowed: sizes up to {LARGEST_NUMBER:g}")
        return FixedArray(numbers)

    def _fault(self, value: Any, shape: tuple[int, ...], at: str = "") -> str:
        """Return the first fault of nested lists; empty if there is none."""
        if not shape:
            return "" if is_number(value) and math.isfinite(value) else f"{at or 'it'} is not a finite number"
        if not isinstance(value, list | tuple):
            return f"{at or 'it'} is not a list"
        if shape[0] and len(value) != shape[0]:
            return f"{at or 'it'} has {len(value)} entries and not {shape[0]}"
        if not 1 <= len(value) <= (shape[0] or self.most):
            return f"{at or 'it'} has {len(value)} entries and not 1 to {self.most}"
        lengths = {len(item) for item in value if isinstance(item, list | tuple)}
        if len(shape) > 1 and len(lengths) > 1:
            return f"{at or 'it'} has rows of different lengths"
        return next((text for i, item in enumerate(value) if (text := self._fault(item, shape[1:], f"{at}[{i}]"))), "")


# Convert B-spline surfaces to bicubic patches: exactly, or within a proven error bound.
#
# On each knot interval a rational B-spline is a quotient A / w of polynomials. The bicubic patch with the same corners,
# first derivatives and mixed second derivatives equals the surface if that is a polynomial of degree three or less.
# Otherwise it differs by |A - w B| / w, which is bounded by Bernstein coefficients, and intervals are halved until the
# bound is small enough. Adjacent patches share their common edge and its tangent planes, because these depend only on
# the corners of the edge.


MOST_PATCHES = 10000

MOST_WRITTEN = 1000  # largest number of patches, or of control points in a row, in a file
MOST_DEGREE = 15

_NET = "rows of control points [x, y, z] of finite numbers, one row for each step along u, all equally long"
_WEIGHTS = "rows of positive weights, one for each control point"
_KNOTS = "a list of increasing finite numbers"
Net = Annotated[FixedArray, ArrayOf((0, 0, 3), _NET, MOST_WRITTEN), Quantity("length")]
Weights = Annotated[FixedArray, ArrayOf((0, 0), _WEIGHTS, MOST_WRITTEN), Quantity("number")]
Knots = Annotated[FixedArray, ArrayOf((0,), _KNOTS, MOST_WRITTEN + MOST_DEGREE + 1), Quantity("number")]


@dataclass(frozen=True)
class BSplineSurface:
    """A B-spline surface."""

    degree: tuple[int, int]  # along u and along v
    knots: tuple[Array, Array]  # increasing; degree + 1 more than control points
    control: Array  # (nu, nv, 3)
    weights: Array  # (nu, nv), all positive


@dataclass(frozen=True)
class ConvertedSpline:
    """Bicubic patches, shape (n, 4, 4, 3), the bound of their distance from the surface, and whether it is met."""

    patches: Array
    error: float
    complete: bool


def bicubic_patches(surface: BSplineSurface, tolerance: float) -> ConvertedSpline:
    """Return a B-spline surface as bicubic patches; incomplete if that requires more than MOST_PATCHES.

    The tolerance is the largest allowed distance between points with the same parameters [length].
    """
    cuts = [np.unique(_domain(k, p)) for k, p in zip(surface.knots, surface.degree, strict=True)]
    patches, error = _converted(surface, cuts)
    while error.max() > tolerance:
        choices = [_halved(cuts, axis, error.max(axis=1 - axis) > tolerance) for axis in (0, 1)]
        choices = [cut for cut in choices if (len(cut[0]) - 1) * (len(cut[1]) - 1) <= MOST_PATCHES]
        if not choices:
            return ConvertedSpline(patches.reshape(-1, 4, 4, 3), float(error.max()), False)
        tried = [(cut, *_converted(surface, cut)) for cut in choices]
        cuts, patches, error = min(tried, key=lambda one: float(one[2].mean()))
    return ConvertedSpline(patches.reshape(-1, 4, 4, 3), float(error.max()), True)


def _domain(knots: Array, degree: int) -> Array:
    """Return the knots that span the domain of the surface."""
    return knots[degree : len(knots) - degree]


def _halved(cuts: list[Array], axis: int, which: Array) -> list[Array]:
    """Return cuts with the chosen intervals of an axis halved."""
    own = cuts[axis]
    middles = 0.5 * (own[:-1] + own[1:])[which]
    return [np.sort(np.concatenate([own, middles])) if k == axis else cut for k, cut in enumerate(cuts)]


def _converted(surface: BSplineSurface, cuts: list[Array]) -> tuple[Array, Array]:
    """Return the bicubic patches between cuts, shape (nu, nv, 4, 4, 3), and the error bound of each."""
    w = surface.weights[..., None]
    homogeneous = np.concatenate([surface.control * w, w], axis=-1)
    to_u, to_v = (_to_bezier(k, p, c) for k, p, c in zip(surface.knots, surface.degree, cuts, strict=True))
    pieces = np.einsum("iak,jbl,kld->ijabd", to_u, to_v, homogeneous)
    patches = _hermite(pieces)
    return patches, _error_bound(pieces, patches)


def _to_bezier(knots: Array, degree: int, cuts: Array) -> Array:
    """Return the matrices from control points to Bezier points between cuts: (intervals, degree + 1, count)."""
    return np.array(
        [
            [_blossom(knots, degree, [low] * (degree - k) + [high] * k, 0.5 * (low + high)) for k in range(degree + 1)]
            for low, high in pairwise(cuts.tolist())
        ]
    )


def _blossom(knots: Array, degree: int, arguments: list[float], inside: float) -> Array:
    """Return the weights of the control points in the polar form of the polynomial segment that contains ``inside``."""
    count = len(knots) - degree - 1
    span = int(np.clip(np.searchsorted(knots, inside, side="right") - 1, degree, count - 1))
    rows = np.eye(count)[span - degree : span + 1]
    for r, t in enumerate(arguments, 1):
        for j in range(degree, r - 1, -1):
            low, high = knots[span - degree + j], knots[span + 1 + j - r]
            share = (t - low) / (high - low)
            rows[j] = (1 - share) * rows[j - 1] + share * rows[j]
    return np.asarray(rows[degree])


def _hermite(pieces: Array) -> Array:
    """Return the bicubic patches with the corners, slopes and twists of rational pieces (nu, nv, p + 1, q + 1, 4)."""
    patches = np.empty((*pieces.shape[:2], 4, 4, 3))
    p, q = pieces.shape[2] - 1, pieces.shape[3] - 1
    for end_u in (0, 1):
        for end_v in (0, 1):
            i, j = (p if end_u else 0), (q if end_v else 0)
            k, m = (p - 1 if end_u else 1), (q - 1 if end_v else 1)
            c, by_u, by_v = pieces[:, :, i, j], pieces[:, :, k, j], pieces[:, :, i, m]
            A, A_u, A_v = c, p * (by_u - c), q * (by_v - c)  # slopes pointing inwards
            A_uv = p * q * (pieces[:, :, k, m] - by_u - by_v + c)
            w = A[..., 3:]
            S = A[..., :3] / w
            S_u = (A_u[..., :3] - S * A_u[..., 3:]) / w
            S_v = (A_v[..., :3] - S * A_v[..., 3:]) / w
            S_uv = (A_uv[..., :3] - S_u * A_v[..., 3:] - S_v * A_u[..., 3:] - S * A_uv[..., 3:]) / w
            a, b = (3 if end_u else 0), (3 if end_v else 0)
            e, f = (2 if end_u else 1), (2 if end_v else 1)
            patches[:, :, a, b] = S
            patches[:, :, e, b] = S + S_u / 3
            patches[:, :, a, f] = S + S_v / 3
            patches[:, :, e, f] = S + S_u / 3 + S_v / 3 + S_uv / 9
    return patches


def _error_bound(pieces: Array, patches: Array) -> Array:
    """Return a bound of |A / w - B| on each piece: the largest Bernstein coefficient of A - w B over the least of w."""
    p, q = pieces.shape[2] - 1, pieces.shape[3] - 1
    scaled = pieces * np.multiply.outer(_binomials(p), _binomials(q))[..., None]
    rest = np.zeros((*pieces.shape[:2], p + 4, q + 4, 3))
    for i, ci in enumerate(_binomials(3)):
        for j, cj in enumerate(_binomials(3)):
            difference = scaled[..., :3] - scaled[..., 3:] * patches[:, :, i, j][:, :, None, None]
            rest[:, :, i : i + p + 1, j : j + q + 1] += ci * cj * difference
    rest /= np.multiply.outer(_binomials(p + 3), _binomials(q + 3))[..., None]
    return np.asarray(np.linalg.norm(rest, axis=-1).max(axis=(2, 3)) / pieces[..., 3].min(axis=(2, 3)))


def _binomials(n: int) -> Array:
    return np.array([comb(n, k) for k in range(n + 1)], float)


# B-spline surfaces as written in a file: control points, knots and weights that are consistent.


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

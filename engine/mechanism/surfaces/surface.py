"""The contact primitive `surface`: faces of any shape, given as bicubic patches or as one or several B-splines.

Arrays of numbers, such as a mesh of points or a knot vector, form one value of a file, without keys inside.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import comb
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, GetCoreSchemaHandler, GetJsonSchemaHandler, model_validator
from pydantic_core import core_schema

from engine.arrays import Array
from engine.mechanism.base import LARGEST_NUMBER, OptionalLength, TableModel, added, is_number, optional, refuse
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
    """What a field of the type `FixedArray` accepts: a length 0 in ``shape`` is any from 1 to ``most``."""

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
        """Return the array of nested lists; refuse other lengths, and anything but finite numbers."""
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
    cuts = [np.unique(k[p : len(k) - p]) for k, p in zip(surface.knots, surface.degree, strict=True)]
    patches, error = _converted(surface, cuts)
    while error.max() > tolerance:
        choices = [_halved(cuts, axis, error.max(axis=1 - axis) > tolerance) for axis in (0, 1)]
        choices = [cut for cut in choices if (len(cut[0]) - 1) * (len(cut[1]) - 1) <= MOST_PATCHES]
        if not choices:
            return ConvertedSpline(patches.reshape(-1, 4, 4, 3), float(error.max()), False)
        tried = [(cut, *_converted(surface, cut)) for cut in choices]
        cuts, patches, error = min(tried, key=lambda one: float(one[2].mean()))
    return ConvertedSpline(patches.reshape(-1, 4, 4, 3), float(error.max()), True)


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


class SplineFace(TableModel):
    """One B-spline of a surface that consists of several."""

    degree: tuple[int, int] = Field(description="its degrees along u and along v, 1 to 15 each")
    knots_u: Knots = Field(description="its knots along u: as many as control points, + degree + 1")
    knots_v: Knots = Field(description="its knots along v")
    control: Net = Field(description="its control points: rows along u of points along v")
    weights: Weights | None = optional("the weights of its control points; default: all 1")

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
    if count <= degree:
        raise refuse(f"{count} control points for degree {degree}; allowed: more than the degree", key="control")
    if len(knots) != count + degree + 1:
        text = f"{len(knots)} knots; allowed: {count + degree + 1}, for {count} control points of degree {degree}; "
        raise refuse(f"{text}write each knot as often as its multiplicity", key=key)
    if np.any(np.diff(knots) < 0.0) or knots[degree] == knots[count]:
        raise refuse("does not increase; allowed: knots in increasing order, not all equal; sort them", key=key)
    inner = knots[degree + 1 : count]
    if any(np.count_nonzero(inner == knot) > degree for knot in np.unique(inner)):
        raise refuse(f"has a knot more than {degree} times; the surface would be torn there; write it as two", key=key)


# The primitive.


CONVERSION = 1e-5  # default conversion error as a share of the surface's size
ROUNDING = 1e-13  # smallest conversion error that can be requested, as a share of the size

_PATCH = "a list of patches, each 4 rows of 4 control points [x, y, z] of finite numbers, rows along u"
Points = Annotated[FixedArray, ArrayOf((0, 4, 4, 3), _PATCH, MOST_WRITTEN), Quantity("length")]

_OF_A_SPLINE = ("degree", "knots_u", "knots_v", "control")
_FORMS = "patches, or degree, knots_u, knots_v and control, or faces; write one of them"


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

    patches: Points | None = optional("bicubic Bezier patches: of each 4 rows along u of 4 control points along v")
    degree: tuple[int, int] | None = optional("the degrees of a B-spline surface along u and along v, 1 to 15 each")
    knots_u: Knots | None = optional("its knots along u: as many as control points, + degree + 1")
    knots_v: Knots | None = optional("its knots along v")
    control: Net | None = optional("its control points: rows along u of points along v")
    weights: Weights | None = optional("the weights of its control points; default: all 1")
    conversion: OptionalLength = optional(
        "largest error of bicubic patches in place of B-splines, a number > 0; default: 1e-5 of their size"
    )
    depth: OptionalLength = optional(
        "the thickness of the plate behind a surface with open edges, a number > 0; default: a quarter of "
        "its size, or half its least convex radius of curvature if that is less"
    )
    faces: Annotated[tuple[SplineFace, ...], Field(json_schema_extra={"minItems": 1})] | None = added(
        "several B-spline surfaces, each with degree, knots and control"
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
            raise refuse(f"has no form, or more than one; allowed: {_FORMS}")
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
            text = f"patches {one} and {other} share an edge, with their normals on different sides; allowed: all "
            raise refuse(f"{text}normals S_u x S_v outside; write the rows of one of them as columns", key=key)
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

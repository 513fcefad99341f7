"""The surfaces of contacts as trees of pieces of patches (`kernels.model.Surfaces`)."""

from collections.abc import Sequence
from functools import cache
from math import comb

import numpy as np

from engine.arrays import Array, Integers
from engine.assembly.frames import BodyFrame
from engine.kernels.model import Surfaces
from engine.mechanism.surfaces.surface import FreeFormSurface

SPARE = 1.0  # safety factor on third derivatives in the test that cuts patches, so that few pieces are quartered
ELONGATED = 1.5  # ratio of a piece's sides above which only the longer one is halved
MOST_HALVINGS = 8  # per patch
ROUNDING = 1e-14  # share of the largest coordinate that is added to the half sides of boxes
NO_DIRECTION = 1e-6  # sine of the angle between the slopes in a piece's middle, below which it has no normal

# powers of x, -1 to 1, in the cubic Bernstein polynomials of (1 + x) / 2
_POWERS = np.array([[1, -3, 3, -1], [3, -3, -3, 3], [3, 3, -3, -3], [1, 3, 3, 1]], float).T / 8
_LEFT = np.array([[8, 0, 0, 0], [4, 4, 0, 0], [2, 4, 2, 0], [1, 3, 3, 1]], float) / 8
_HALVES = np.array([_LEFT, _LEFT[::-1, ::-1]])

NO_SURFACES = Surfaces(
    np.zeros((0, 6)),
    np.zeros(0),
    np.zeros(0, np.int64),
    np.zeros(0, np.int64),
    np.zeros(0, np.int64),
    np.zeros((0, 3, 5)),
    np.zeros((0, 3, 4, 4)),
    np.zeros((0, 9)),
)


def surface_tree(surface: FreeFormSurface, frame: BodyFrame) -> Surfaces:
    """Return the tree of one surface, from its body's centre of mass in body axes; the root is node 0."""
    control = frame.origin + (frame.scale * surface.boundary) @ frame.rotation.T
    pieces = _pieces(control)
    coefficient = np.einsum("ai,bj,nijk->nkab", _POWERS, _POWERS, pieces)
    centre = 0.5 * (pieces.min(axis=(1, 2)) + pieces.max(axis=(1, 2)))
    boxes: list[Array] = []
    after: list[int] = []
    parents: list[int] = []
    piece: list[int] = []
    points = pieces.reshape(-1, 16, 3)
    slack = ROUNDING * np.abs(points).max()

    def grow(which: Integers, parent: int) -> None:
        """Add the node of some pieces and all nodes below it."""
        node, inside = len(boxes), points[which].reshape(-1, 3)
        low, high = inside.min(axis=0), inside.max(axis=0)
        boxes.append(np.concatenate([0.5 * (low + high), 0.5 * (high - low) + slack]))
        after.append(0)
        parents.append(parent)
        piece.append(int(which[0]) if len(which) == 1 else -1)
        if len(which) > 1:
            widest = np.ptp(centre[which], axis=0).argmax()
            order = which[np.argsort(centre[which, widest], kind="stable")]
            grow(order[: len(order) // 2], node)
            grow(order[len(order) // 2 :], node)
        after[node] = len(boxes)

    grow(np.arange(len(pieces)), -1)
    box = np.array(boxes)
    return Surfaces(
        box,
        np.linalg.norm(box[:, 3:], axis=1),
        np.array(after, np.int64),
        np.array(parents, np.int64),
        np.array(piece, np.int64),
        _slabs(points, coefficient, slack),
        coefficient,
        _bounds(coefficient),
    )


def joined_surfaces(trees: Sequence[Surfaces | None]) -> tuple[Array, Surfaces]:
    """Return all trees as one, and the root of each, -1 for none; a tree given twice is included once."""
    own = list({id(tree): tree for tree in trees if tree is not None}.values())
    nodes = np.cumsum([0, *(len(tree.after) for tree in own)])
    pieces = np.cumsum([0, *(len(tree.bound) for tree in own)])
    after = [tree.after + first for tree, first in zip(own, nodes[:-1], strict=True)]
    parent = [np.where(t.parent < 0, -1, t.parent + first) for t, first in zip(own, nodes[:-1], strict=True)]
    piece = [np.where(t.piece < 0, -1, t.piece + first) for t, first in zip(own, pieces[:-1], strict=True)]
    joined = Surfaces(
        np.concatenate([NO_SURFACES.box, *(tree.box for tree in own)]),
        np.concatenate([NO_SURFACES.size, *(tree.size for tree in own)]),
        np.concatenate([NO_SURFACES.after, *after]),
        np.concatenate([NO_SURFACES.parent, *parent]),
        np.concatenate([NO_SURFACES.piece, *piece]),
        np.concatenate([NO_SURFACES.slab, *(tree.slab for tree in own)]),
        np.concatenate([NO_SURFACES.coefficient, *(tree.coefficient for tree in own)]),
        np.concatenate([NO_SURFACES.bound, *(tree.bound for tree in own)]),
    )
    root = {id(tree): int(first) for tree, first in zip(own, nodes[:-1], strict=True)}
    return np.array([root.get(id(tree), -1) for tree in trees], np.int64), joined


def _pieces(patches: Array) -> Array:
    """Return the patches cut into pieces on which the slopes change little."""
    done, rest = [], patches
    for _ in range(MOST_HALVINGS):
        coefficient = np.einsum("ai,bj,nijk->nkab", _POWERS, _POWERS, rest)
        S_x, S_y = coefficient[:, :, 1, 0], coefficient[:, :, 0, 1]
        E, F, G = np.sum(S_x * S_x, 1), np.sum(S_x * S_y, 1), np.sum(S_y * S_y, 1)
        bounds = _bounds(coefficient)
        t = SPARE * (bounds[:, :4] + bounds[:, 4:8] * bounds[:, 8:])
        xx, yy, xy = E - t[:, 0] - t[:, 1], G - t[:, 2] - t[:, 3], np.abs(F) + t[:, 1] + t[:, 2]
        wild = ~((xx > 0.0) & (yy > 0.0) & (xx * yy > xy * xy))
        done.append(rest[~wild])
        along_x, along_y = wild & (E * ELONGATED**2 >= G), wild & (G * ELONGATED**2 >= E)
        both = along_x & along_y
        x, y = rest[along_x & ~both], rest[along_y & ~both]
        xy = _halved(_halved(rest[both], 0), 1)
        rest = np.concatenate([_halved(x, 0), _halved(y, 1), xy])
        if not len(rest):
            break
    return np.concatenate([*done, rest])


def _slabs(points: Array, coefficient: Array, slack: float) -> Array:
    """Return a box around the control points of each piece, aligned with the middle of the piece: (n, 3, 5)."""
    S_x, S_y = coefficient[:, :, 1, 0], coefficient[:, :, 0, 1]
    normal = np.cross(S_x, S_y)
    flat = np.linalg.norm(normal, axis=1) > NO_DIRECTION * np.linalg.norm(S_x, axis=1) * np.linalg.norm(S_y, axis=1)
    S_x, normal = np.where(flat[:, None], S_x, [1.0, 0.0, 0.0]), np.where(flat[:, None], normal, [0.0, 0.0, 1.0])
    x, z = (v / np.linalg.norm(v, axis=1)[:, None] for v in (S_x, normal))
    axes = np.stack([x, np.cross(z, x), z], axis=1)
    along = np.einsum("nak,nck->nac", axes, points)
    low, high = along.min(axis=2), along.max(axis=2)
    return np.concatenate([axes, 0.5 * (low + high)[..., None], 0.5 * (high - low)[..., None] + slack], axis=2)


def _halved(patches: Array, axis: int) -> Array:
    """Return both halves of each patch, along u (axis 0) or along v (axis 1)."""
    form = "hai,nijk->hnajk" if axis == 0 else "haj,nijk->hniak"
    return np.asarray(np.einsum(form, _HALVES, patches).reshape(-1, 4, 4, 3))


def _bounds(coefficient: Array) -> Array:
    """Return the bounds of the derivatives of pieces, shape (n, 9).

    The third derivatives of |S - q|^2 / 2 by xxx, xxy, xyy, yyy are products of those of S with S - q, plus a part
    without q from derivatives of the first fundamental form E, F, G. The columns bound these parts (0:4), the lengths
    of S's third derivatives (4:8), and the sum of the lengths of S_x and S_y (8).
    """
    S_x, S_y = _derived(coefficient, 1, 0), _derived(coefficient, 0, 1)
    E, F, G = _product(S_x, S_x), _product(S_x, S_y), _product(S_y, S_y)
    E_x, E_y, F_x, F_y, G_x, G_y = (_derived(form, *by) for form in (E, F, G) for by in ((1, 0), (0, 1)))
    own = [1.5 * _most(E_x), 0.5 * _most(E_y) + _most(F_x), 0.5 * _most(G_x) + _most(F_y), 1.5 * _most(G_y)]
    third = [_most(_derived(coefficient, *by)) for by in ((3, 0), (2, 1), (1, 2), (0, 3))]
    return np.stack([*own, *third, _most(S_x) + _most(S_y)], axis=1)


def _derived(a: Array, by_x: int, by_y: int) -> Array:
    """Return the coefficients of a derivative of polynomials; the last two axes are the powers of x and y."""
    for axis, times in ((-2, by_x), (-1, by_y)):
        for _ in range(times):
            powers = np.arange(1, a.shape[axis])
            shape = [1] * a.ndim
            shape[axis] = len(powers)
            a = np.take(a, powers, axis) * powers.reshape(shape)
    return a


def _product(a: Array, b: Array) -> Array:
    """Return the scalar products of vector polynomials, (n, 3, i, j) each, as polynomials (n, 1, i, j)."""
    size = [a.shape[k] + b.shape[k] - 1 for k in (2, 3)]
    product = np.zeros((len(a), 1, *size))
    for i in range(a.shape[2]):
        for j in range(a.shape[3]):
            part = np.sum(a[:, :, i, j][:, :, None, None] * b, axis=1, keepdims=True)
            product[:, :, i : i + b.shape[2], j : j + b.shape[3]] += part
    return product


def _most(a: Array) -> Array:
    """Return a bound of the length of polynomials, (n, components, i, j): the longest Bernstein coefficient."""
    coefficients = np.einsum("ai,bj,ncij->ncab", _to_bernstein(a.shape[2]), _to_bernstein(a.shape[3]), a)
    return np.asarray(np.linalg.norm(coefficients, axis=1).max(axis=(1, 2)))


@cache
def _to_bernstein(count: int) -> Array:
    """Return the matrix from coefficients of powers of x, -1 to 1, to Bernstein coefficients."""
    half, rest, degree = np.poly1d([0.5, 0.5]), np.poly1d([-0.5, 0.5]), count - 1
    columns = [(comb(degree, k) * half**k * rest ** (degree - k)).coeffs[::-1] for k in range(count)]
    return np.linalg.inv(np.array([np.pad(c, (0, count - len(c))) for c in columns]).T)

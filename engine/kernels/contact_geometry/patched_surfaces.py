"""Signed distances of solids bounded by bicubic patches.

The pieces of the patches are the leaves of a tree, whose nodes have bounding boxes of everything below them. At each
fork the search first follows the node whose box's middle is nearer, and skips each box that is farther away than the
nearest point found so far. Each piece has a second, thin box along its own normal. In this way the nearest of all
points is found, wherever it is.
"""

import numpy as np

from engine.jit import inner, not_inlined
from engine.kernels.contact_geometry.patches import TIE, search_piece
from engine.kernels.vectors import dot

SMOOTH = 1e-9  # sine of the angle to the surface's normal up to which a point is above a face, not beside an edge
ROUNDED = 1e-12  # share of a surface's size by which rounding may move a point along it


@not_inlined
def surface_distance(solid, x, y, z):
    """Return the signed distance of a point from the surface of a solid, negative inside, and its gradient.

    The point is in the axes of the body, from its centre of mass; ``solid`` holds the surfaces and the first node of
    the solid's surface. Above a face the gradient is the normal; at an edge it points away from it, from inside towards
    it.
    """
    surfaces, root = solid
    r, n, side = nearest_point(surfaces, root, (x, y, z))
    height, distance = -dot(r, n), np.sqrt(dot(r, r))
    along = (r[0] + height * n[0], r[1] + height * n[1], r[2] + height * n[2])
    if np.sqrt(dot(along, along)) <= SMOOTH * distance + ROUNDED * surfaces.size[root]:
        return height, n
    signed = side * distance
    return signed, (-r[0] / signed, -r[1] / signed, -r[2] / signed)


@inner
def nearest_point(surfaces, root, q):
    """Return the vector from q to the nearest point of a surface, the normal there, and on which side of it q lies."""
    none = (0.0, 0.0, 0.0)
    best = (np.inf, none, none, 0.0, 1.0)
    node, depth, pending, squares = root, 0, 0, 0  # pending: bit mask of the levels whose other node is not visited yet
    while True:
        reach = 2 * best[0] * (1 + TIE)
        if squared_distance_of_box(surfaces, node, q) <= reach:
            k = surfaces.piece[node]
            if k < 0:
                node, depth = nearer_below(surfaces, node, q), depth + 1
                pending |= 1 << depth
                continue
            if squared_distance_of_slab(surfaces, k, q) <= reach:
                squares, best = search_piece(surfaces.coefficient[k], surfaces.bound[k], q, squares, best)
        while depth > 0 and not pending >> depth & 1:
            node, depth = surfaces.parent[node], depth - 1
        if depth == 0:
            return best[1], best[2], best[4]
        pending ^= 1 << depth
        first = surfaces.parent[node] + 1
        node = surfaces.after[first] if node == first else first


@inner
def nearer_below(surfaces, node, q):
    """Return the one of the two nodes below a fork whose box's middle is nearer to q."""
    first, second = node + 1, surfaces.after[node + 1]
    nearer = squared_distance_of_middle(surfaces, first, q) <= squared_distance_of_middle(surfaces, second, q)
    return first if nearer else second


@inner
def squared_distance_of_middle(surfaces, node, q):
    """Return the squared distance of q from the middle of a node's box."""
    box = surfaces.box[node]
    w = (q[0] - box[0], q[1] - box[1], q[2] - box[2])
    return dot(w, w)


@inner
def squared_distance_of_box(surfaces, node, q):
    """Return the squared distance of q from a node's box; 0 inside it."""
    box = surfaces.box[node]
    x, y, z = abs(q[0] - box[0]) - box[3], abs(q[1] - box[1]) - box[4], abs(q[2] - box[2]) - box[5]
    x, y, z = max(x, 0.0), max(y, 0.0), max(z, 0.0)
    return x * x + y * y + z * z


@inner
def squared_distance_of_slab(surfaces, k, q):
    """Return the squared distance of q from a piece's slab; 0 inside it."""
    total = 0.0
    for axis in range(3):
        side = surfaces.slab[k, axis]
        beyond = max(abs(side[0] * q[0] + side[1] * q[1] + side[2] * q[2] - side[3]) - side[4], 0.0)
        total += beyond * beyond
    return total

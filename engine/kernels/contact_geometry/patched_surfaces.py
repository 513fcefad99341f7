"""Signed distances of solids that are bounded by bicubic patches.

The pieces of the patches are the leaves of a tree whose nodes have spheres around all that is below them. The search
goes down to the leaf that is nearest at every fork; then it passes through the tree from its root and leaves out what
lies in a sphere farther away than what has been found. The nearest of all points is so found, wherever it is.
"""

import numpy as np

from engine.jit import inner, not_inlined
from engine.kernels.contact_geometry.patches import TIE, search_piece
from engine.kernels.vectors import dot

SMOOTH = 1e-9  # sine of the angle to the surface's normal up to which a point is over a face, not beside an edge
ROUNDED = 1e-12  # share of a surface's size that rounding may move a point along it


@not_inlined
def surface_distance(solid, x, y, z):
    """Return the signed distance of a point from the surface of a solid, and its gradient.

    Parameters
    ----------
    solid : (Surfaces, int)
        The surfaces, and the first node of this one.
    x, y, z : float
        In the axes of the body, from its centre of mass.

    Returns
    -------
    distance : float
        Negative in the material.
    gradient : (3,) tuple
        Over a face its normal; at an edge the direction from there, or to there from inside.
    """
    surfaces, root = solid
    r, n, side = nearest_point(surfaces, root, (x, y, z))
    height, distance = -dot(r, n), np.sqrt(dot(r, r))
    along = (r[0] + height * n[0], r[1] + height * n[1], r[2] + height * n[2])
    if np.sqrt(dot(along, along)) <= SMOOTH * distance + ROUNDED * surfaces.sphere[root, 3]:
        return height, n
    signed = side * distance
    return signed, (-r[0] / signed, -r[1] / signed, -r[2] / signed)


@inner
def nearest_point(surfaces, root, q):
    """Return the way from q to the nearest point of a surface, the normal there, and on which side of it q is."""
    none = (0.0, 0.0, 0.0)
    first = nearest_leaf(surfaces, root, q)
    k = surfaces.piece[first]
    best = (np.inf, none, none, 0.0, 1.0)
    squares, best = search_piece(surfaces.coefficient[k], surfaces.bound[k], q, 0, best)
    reach = np.sqrt(2 * best[0]) * (1 + TIE)
    node, end = root, surfaces.after[root]
    while node < end:
        if squared_distance(surfaces, node, q) > (surfaces.sphere[node, 3] + reach) ** 2:
            node = surfaces.after[node]
            continue
        k = surfaces.piece[node]
        if k >= 0 and node != first:
            squares, best = search_piece(surfaces.coefficient[k], surfaces.bound[k], q, squares, best)
            reach = np.sqrt(2 * best[0]) * (1 + TIE)
        node += 1
    return best[1], best[2], best[4]


@inner
def nearest_leaf(surfaces, root, q):
    """Return the leaf to which the nearer of two spheres' centres leads at every fork."""
    node = root
    while surfaces.piece[node] < 0:
        other = surfaces.after[node + 1]
        node = node + 1 if squared_distance(surfaces, node + 1, q) <= squared_distance(surfaces, other, q) else other
    return node


@inner
def squared_distance(surfaces, node, q):
    """Return the square of the distance of q from the centre of a node's sphere."""
    sphere = surfaces.sphere[node]
    w = (q[0] - sphere[0], q[1] - sphere[1], q[2] - sphere[2])
    return dot(w, w)

"""Signed distances of solids bounded by bicubic patches: their pieces, the nearest point of one, and of all.

A piece is a polynomial S(x, y), |x| and |y| <= 1, with coefficients for powers of x and y; phi = |S - q|^2 / 2.
"""

import numpy as np

from engine.jit import inner, not_inlined
from engine.kernels.vectors import dot, vector_product

INWARD = 1e-6  # step towards the middle of a piece whose edge is collapsed to a point and has no normal
COLLAPSED = 1e-8  # share of a piece's squared size; if the normal's length is below it, that step is taken

DEEPEST = 5  # levels of quartering; reached at poles, and for points equally far from a whole region
MOST_SQUARES = 3000  # per query; beyond it, which only such points reach, pieces are not quartered
NEWTON_STEPS = 60
LAST = 1e-7  # change of x and y at which Newton's method ends: both are then accurate to rounding
CLOSE = 1e-6  # change of x and y below which phi falls by less than its rounding; Newton steps are then always accepted
SINGULAR = 1e-12  # smallest determinant of a matrix to invert, as a share of the product of its diagonal
TIE = 1e-12  # share by which the squared distances of one point, found twice, may differ

SMOOTH = 1e-9  # sine of the angle to the surface's normal up to which a point is above a face, not beside an edge
ROUNDED = 1e-12  # share of a surface's size by which rounding may move a point along it


@inner
def cubic(a, y):
    """Return the value of a cubic with coefficients a, and its first and second derivatives."""
    return (a[0] + y * (a[1] + y * (a[2] + y * a[3])), a[1] + y * (2 * a[2] + 3 * y * a[3]), 2 * a[2] + 6 * y * a[3])


@inner
def component(a, x, y):
    """Return value and derivatives by x, y, xx, xy and yy of a bicubic polynomial; a: (4, 4), powers of x and of y."""
    a0, b0, c0 = cubic(a[0], y)
    a1, b1, c1 = cubic(a[1], y)
    a2, b2, c2 = cubic(a[2], y)
    a3, b3, c3 = cubic(a[3], y)
    v, v_x, v_xx = cubic((a0, a1, a2, a3), x)
    v_y, v_xy, _ = cubic((b0, b1, b2, b3), x)
    return v, v_x, v_y, v_xx, v_xy, c0 + x * (c1 + x * (c2 + x * c3))


@not_inlined
def expand(piece, q, x, y):
    """Return S - q, the derivatives of S, and the gradient and second derivatives of phi.

    The derivatives of S are by x, y, xx, xy and yy, those of phi by xx, xy and yy; ``piece`` has shape (3, 4, 4).
    """
    r0, x0, y0, xx0, xy0, yy0 = component(piece[0], x, y)
    r1, x1, y1, xx1, xy1, yy1 = component(piece[1], x, y)
    r2, x2, y2, xx2, xy2, yy2 = component(piece[2], x, y)
    r = (r0 - q[0], r1 - q[1], r2 - q[2])
    return of_phi(r, ((x0, x1, x2), (y0, y1, y2), (xx0, xx1, xx2), (xy0, xy1, xy2), (yy0, yy1, yy2)))


@inner
def expand_in_the_middle(piece, q):
    """Return the result of `expand` at x = y = 0, where the derivatives are coefficients times factors."""
    a, b, c = piece[0], piece[1], piece[2]
    r = (a[0, 0] - q[0], b[0, 0] - q[1], c[0, 0] - q[2])
    S_x, S_y, S_xy = (a[1, 0], b[1, 0], c[1, 0]), (a[0, 1], b[0, 1], c[0, 1]), (a[1, 1], b[1, 1], c[1, 1])
    S_xx, S_yy = (2 * a[2, 0], 2 * b[2, 0], 2 * c[2, 0]), (2 * a[0, 2], 2 * b[0, 2], 2 * c[0, 2])
    return of_phi(r, (S_x, S_y, S_xx, S_xy, S_yy))


@inner
def of_phi(r, slopes):
    """Return S - q and the derivatives of S unchanged, with the gradient and second derivatives of phi."""
    S_x, S_y, S_xx, S_xy, S_yy = slopes
    hessian = (dot(S_x, S_x) + dot(r, S_xx), dot(S_x, S_y) + dot(r, S_xy), dot(S_y, S_y) + dot(r, S_yy))
    return r, slopes, (dot(r, S_x), dot(r, S_y)), hessian


@inner
def last_step(r, slopes, x, y):
    """Return S - q and the derivatives of S after a step (x, y) so short that higher terms are rounded away."""
    S_x, S_y, S_xx, S_xy, S_yy = slopes
    u, v = add(S_x, S_xx, x, S_xy, y), add(S_y, S_xy, x, S_yy, y)
    half = add(S_x, S_xx, 0.5 * x, S_xy, 0.5 * y), add(S_y, S_xy, 0.5 * x, S_yy, 0.5 * y)
    return add(r, half[0], x, half[1], y), (u, v, S_xx, S_xy, S_yy)


@inner
def add(v, a, x, b, y):
    """Return v + x a + y b."""
    return (v[0] + x * a[0] + y * b[0], v[1] + x * a[1] + y * b[1], v[2] + x * a[2] + y * b[2])


@not_inlined
def normal_of(slopes, size, x, y):
    """Return the unit normal; at an edge collapsed to a point, its limit."""
    S_x, S_y, S_xx, S_xy, S_yy = slopes
    n = vector_product(S_x, S_y)
    if dot(n, n) <= (COLLAPSED * size * size) ** 2:
        a, b = np.copysign(INWARD, -x), np.copysign(INWARD, -y)
        n = vector_product(add(S_x, S_xx, a, S_xy, b), add(S_y, S_xy, a, S_yy, b))
    length = np.sqrt(dot(n, n))
    return (n[0] / length, n[1] / length, n[2] / length)


# The point of a piece of a bicubic patch nearest to a given point, found by branch and bound without omissions.
#
# A piece is a polynomial S(x, y), |x| and |y| <= 1, with coefficients for powers of x and y. Half the squared distance,
# phi = |S - q|^2 / 2, has a third derivative with a known bound, so on a square of (x, y) it is a quadratic function
# plus a bounded remainder. A square is skipped if its quadratic function, less the remainder, does not fall below the
# value found so far. Where the second derivative stays positive, phi has one minimum in the square, which Newton's
# method finds. Other squares are quartered.


@not_inlined
def search_piece(piece, bounds, q, squares, best):
    """Search a piece of a patch for a point nearer than ``best``, see `nearer`; return ``squares`` and ``best``.

    ``squares`` counts the squares examined in this query, and ``bounds``, (9,), are those of
    `engine.kernels.model.Surfaces.bound`.
    """
    deepest = DEEPEST if squares < MOST_SQUARES else 0
    i, j, level, half = 0, 0, 0, 1.0
    while True:
        x, y = (2 * i + 1) * half - 1, (2 * j + 1) * half - 1
        squares += 1
        middle = expand(piece, q, x, y) if level > 0 else expand_in_the_middle(piece, q)
        least, convex = lower_bound(bounds, middle, half)
        if least <= best[0] * (1 + TIE):
            if not convex and level < deepest:
                i, j, level, half = 2 * i, 2 * j, level + 1, 0.5 * half
                continue
            best = descend(piece, bounds, q, (x, y, half, convex), middle, best)
        while level > 0 and i & 1 and j & 1:  # the last quarter of its parent
            i, j, level, half = i >> 1, j >> 1, level - 1, 2 * half
        if level == 0:
            return squares, best
        if i & 1:
            i, j = i - 1, j + 1
        else:
            i += 1


@not_inlined
def lower_bound(bounds, middle, half):
    """Return a lower bound of phi over a square, and whether phi has at most one minimum there.

    ``middle`` is the result of `expand` in the middle of the square, and ``half`` half its side.
    """
    r, _, (g_x, g_y), (h_xx, h_xy, h_yy) = middle
    phi = 0.5 * dot(r, r)
    square, cube = half * half, half * half * half
    farthest = np.sqrt(2 * phi) + half * bounds[8]
    t_xxx, t_xxy = cube * (bounds[0] + bounds[4] * farthest), cube * (bounds[1] + bounds[5] * farthest)
    t_xyy, t_yyy = cube * (bounds[2] + bounds[6] * farthest), cube * (bounds[3] + bounds[7] * farthest)
    rest = (t_xxx + 3 * t_xxy + 3 * t_xyy + t_yyy) / 6
    g_x, g_y, h_xx, h_xy, h_yy = half * g_x, half * g_y, square * h_xx, square * h_xy, square * h_yy
    if not (h_xx > 0.0 and h_yy > 0.0 and h_xx * h_yy > h_xy * h_xy):
        lowest = 0.5 * (h_xx + h_yy) - np.sqrt(0.25 * (h_xx - h_yy) ** 2 + h_xy * h_xy)  # smallest eigenvalue
        return phi - abs(g_x) - abs(g_y) + min(lowest, 0.0) - rest, False
    least_xx, least_yy, most_xy = h_xx - t_xxx - t_xxy, h_yy - t_xyy - t_yyy, abs(h_xy) + t_xxy + t_xyy
    convex = least_xx > 0.0 and least_yy > 0.0 and least_xx * least_yy > most_xy * most_xy
    return phi - fall(g_x, g_y, h_xx, h_xy, h_yy) - rest, convex


@inner
def fall(g_x, g_y, h_xx, h_xy, h_yy):
    """Return by how much a convex quadratic function on |x|, |y| <= 1 falls below its value at (0, 0)."""
    determinant = h_xx * h_yy - h_xy * h_xy
    x, y = (h_xy * g_y - h_yy * g_x) / determinant, (h_xy * g_x - h_xx * g_y) / determinant
    if abs(x) <= 1.0 and abs(y) <= 1.0:
        return -0.5 * (g_x * x + g_y * y)
    lowest = 0.0
    if abs(x) > 1.0:
        x0 = np.copysign(1.0, x)
        y0 = min(max(-(g_y + h_xy * x0) / h_yy, -1.0), 1.0)
        lowest = x0 * g_x + y0 * g_y + 0.5 * h_xx + h_xy * x0 * y0 + 0.5 * h_yy * y0 * y0
    if abs(y) > 1.0:
        y0 = np.copysign(1.0, y)
        x0 = min(max(-(g_x + h_xy * y0) / h_xx, -1.0), 1.0)
        lowest = min(lowest, x0 * g_x + y0 * g_y + 0.5 * h_xx * x0 * x0 + h_xy * x0 * y0 + 0.5 * h_yy)
    return -lowest


@not_inlined
def descend(piece, bounds, q, square, middle, best):
    """Descend from the middle of a square to the minimum of phi in it; return the nearer of this point and ``best``.

    ``square`` holds its middle x, y, half its side, and whether the second derivative of phi is positive on all of it;
    ``middle`` is the result of `expand` in the middle.
    """
    x, y, half, convex = square
    r, slopes, gradient, hessian = middle
    phi = 0.5 * dot(r, r)
    along_x, along_y = (x - half, x + half), (y - half, y + half)
    to_x, to_y, change = newton_step(slopes, gradient, hessian, (x, *along_x), (y, *along_y))
    for _ in range(NEWTON_STEPS):
        if change <= LAST:
            r, slopes = last_step(r, slopes, to_x - x, to_y - y)
            x, y, phi = to_x, to_y, 0.5 * dot(r, r)
            break
        there, slopes_there, gradient, hessian = expand(piece, q, to_x, to_y)
        phi_there = 0.5 * dot(there, there)
        if phi_there > phi and change > CLOSE:
            to_x, to_y, change = x + 0.25 * (to_x - x), y + 0.25 * (to_y - y), 0.25 * change
            continue
        x, y, phi, r, slopes = to_x, to_y, phi_there, there, slopes_there
        if convex and phi + slopes_down(gradient, (x, *along_x), (y, *along_y)) > best[0] * (1 + TIE):
            return best
        to_x, to_y, change = newton_step(slopes, gradient, hessian, (x, *along_x), (y, *along_y))
    return nearer(phi, r, normal_of(slopes, bounds[8], x, y), best)


@inner
def slopes_down(gradient, along_x, along_y):
    """Return the largest decrease of a plane with a gradient within a square; a convex function stays above this plane.

    ``along_x``, ``along_y``: current coordinate, lower end, upper end.
    """
    (g_x, g_y), (x, low_x, high_x), (y, low_y, high_y) = gradient, along_x, along_y
    return min(g_x * (low_x - x), g_x * (high_x - x)) + min(g_y * (low_y - y), g_y * (high_y - y))


@inner
def newton_step(slopes, gradient, hessian, along_x, along_y):
    """Return the end of a Newton step within a square, and the larger change of a coordinate.

    A coordinate stays at an end of its interval if phi falls outwards there. Where the second derivative is not
    positive, that of the tangent plane is used instead. ``along_x``, ``along_y``: current coordinate, lower end, upper
    end.
    """
    (g_x, g_y), (h_xx, h_xy, h_yy) = gradient, hessian
    (x, low_x, high_x), (y, low_y, high_y) = along_x, along_y
    S_x, S_y = slopes[0], slopes[1]
    held_x = (x <= low_x and g_x >= 0.0) or (x >= high_x and g_x <= 0.0)
    held_y = (y <= low_y and g_y >= 0.0) or (y >= high_y and g_y <= 0.0)
    if not (h_xx > 0.0 and h_yy > 0.0 and h_xx * h_yy - h_xy * h_xy > SINGULAR * h_xx * h_yy):
        h_xx, h_xy, h_yy = dot(S_x, S_x), dot(S_x, S_y), dot(S_y, S_y)
    determinant = h_xx * h_yy - h_xy * h_xy
    if held_x or held_y or determinant <= SINGULAR * h_xx * h_yy:
        d_x = 0.0 if held_x or h_xx <= 0.0 else -g_x / h_xx
        d_y = 0.0 if held_y or h_yy <= 0.0 else -g_y / h_yy
    else:
        d_x, d_y = (h_xy * g_y - h_yy * g_x) / determinant, (h_xy * g_x - h_xx * g_y) / determinant
    to_x, to_y = min(max(x + d_x, low_x), high_x), min(max(y + d_y, low_y), high_y)
    return to_x, to_y, max(abs(to_x - x), abs(to_y - y))


@inner
def nearer(phi, r, n, best):
    """Return the nearer of two points: phi, S - q, the normal there, how well q aligns with it, and the side of q.

    Where two pieces meet at an edge, the nearest point is found on both. The piece whose normal aligns better with q
    then determines the side of q.
    """
    height, distance = -dot(r, n), np.sqrt(2 * phi)
    aligned, side = abs(height) / distance if distance > 0.0 else 1.0, 1.0 if height >= 0.0 else -1.0
    if phi > best[0] * (1 + TIE):
        return best
    if phi >= best[0] * (1 - TIE) and best[3] > aligned:
        aligned, side = best[3], best[4]
    if phi < best[0]:
        return phi, r, n, aligned, side
    return best[0], best[1], best[2], aligned, side


# Signed distances of solids bounded by bicubic patches.
#
# The pieces of the patches are the leaves of a tree, whose nodes have bounding boxes of everything below them. At each
# fork the search first follows the node whose box's middle is nearer, and skips each box that is farther away than the
# nearest point found so far. Each piece has a second, thin box along its own normal. In this way the nearest of all
# points is found, wherever it is.


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

"""The point of a piece of a bicubic patch that is nearest to a point, by bounds that leave nothing out.

A piece is a polynomial S(x, y), |x| and |y| <= 1, with coefficients for powers of x and y. Half the square of the
distance, phi = |S - q|^2 / 2, has a third derivative with a known bound, so over a square of (x, y) it is a quadratic
function and a known rest. A square whose quadratic function, less the rest, does not fall below what has been found is
left out. Where the second derivative stays positive, phi has one minimum in the square, which Newton's method finds.
Other squares are quartered.
"""

import numpy as np

from engine.jit import inner, not_inlined
from engine.kernels.vectors import dot, vector_product

DEEPEST = 5  # times that a piece is quartered; reached at poles, and by points as far from a whole region
MOST_SQUARES = 3000  # of one query; beyond, which only such points come to, pieces are not quartered
NEWTON_STEPS = 60
STOP = 1e-12  # last change of x and y
CLOSE = 1e-6  # change of x and y below which phi falls by less than it is rounded, and Newton's steps are taken anyhow
SINGULAR = 1e-12  # smallest determinant of a matrix that is inverted, as a share of the product of its diagonal
INWARD = 1e-6  # step towards the middle of a piece, where its edge is one point and has no normal
COLLAPSED = 1e-8  # share of the squared size of a piece; below it the normal is taken that step away
TIE = 1e-12  # share by which squares of distances of one point, found twice, may differ


@inner
def cubic(a, y):
    """Return the value of a cubic with coefficients a and its first and second derivative."""
    return (
        a[0] + y * (a[1] + y * (a[2] + y * a[3])),
        a[1] + y * (2 * a[2] + 3 * y * a[3]),
        2 * a[2] + 6 * y * a[3],
    )


@inner
def component(a, x, y):
    """Return value, derivatives by x, y, xx, xy and yy of a bicubic polynomial; a: (4, 4), powers of x, of y."""
    a0, b0, c0 = cubic(a[0], y)
    a1, b1, c1 = cubic(a[1], y)
    a2, b2, c2 = cubic(a[2], y)
    a3, b3, c3 = cubic(a[3], y)
    v, v_x, v_xx = cubic((a0, a1, a2, a3), x)
    v_y, v_xy, _ = cubic((b0, b1, b2, b3), x)
    return v, v_x, v_y, v_xx, v_xy, c0 + x * (c1 + x * (c2 + x * c3))


@not_inlined
def expand(piece, q, x, y):
    """Return S - q, the derivatives of S, and gradient and second derivative of phi.

    Parameters
    ----------
    piece : (3, 4, 4) array
    q : (3,) tuple
    x, y : float

    Returns
    -------
    r : (3,) tuple
    slopes : five (3,) tuples
        Derivatives of S by x, y, xx, xy, yy.
    gradient : (2,) tuple
    hessian : (3,) tuple
        By xx, xy, yy.
    """
    r0, x0, y0, xx0, xy0, yy0 = component(piece[0], x, y)
    r1, x1, y1, xx1, xy1, yy1 = component(piece[1], x, y)
    r2, x2, y2, xx2, xy2, yy2 = component(piece[2], x, y)
    r = (r0 - q[0], r1 - q[1], r2 - q[2])
    S_x, S_y, S_xx, S_xy, S_yy = (x0, x1, x2), (y0, y1, y2), (xx0, xx1, xx2), (xy0, xy1, xy2), (yy0, yy1, yy2)
    hessian = (dot(S_x, S_x) + dot(r, S_xx), dot(S_x, S_y) + dot(r, S_xy), dot(S_y, S_y) + dot(r, S_yy))
    return r, (S_x, S_y, S_xx, S_xy, S_yy), (dot(r, S_x), dot(r, S_y)), hessian


@not_inlined
def search_piece(piece, bounds, q, squares, best):
    """Search a piece of a patch for a point nearer than what has been found.

    Parameters
    ----------
    piece : (3, 4, 4) array
    bounds : (9,) array
        See `engine.kernels.model.Surfaces.bound`.
    q : (3,) tuple
    squares : int
        How many squares of pieces have been looked at.
    best : tuple
        See `nearer`.

    Returns
    -------
    squares : int
    best : tuple
    """
    deepest = DEEPEST if squares < MOST_SQUARES else 0
    i, j, level, half = 0, 0, 0, 1.0
    while True:
        x, y = (2 * i + 1) * half - 1, (2 * j + 1) * half - 1
        squares += 1
        least, convex = lower_bound(piece, bounds, q, x, y, half)
        if least <= best[0] * (1 + TIE):
            if not convex and level < deepest:
                i, j, level, half = 2 * i, 2 * j, level + 1, 0.5 * half
                continue
            best = descend(piece, bounds, q, x, y, half, best)
        while level > 0 and i & 1 and j & 1:  # the last quarter of its square
            i, j, level, half = i >> 1, j >> 1, level - 1, 2 * half
        if level == 0:
            return squares, best
        if i & 1:
            i, j = i - 1, j + 1
        else:
            i += 1


@not_inlined
def lower_bound(piece, bounds, q, x, y, half):
    """Return a lower bound of phi over a square about (x, y), and whether phi has no more than one minimum there."""
    r, _, (g_x, g_y), (h_xx, h_xy, h_yy) = expand(piece, q, x, y)
    phi = 0.5 * dot(r, r)
    square, cube = half * half, half * half * half
    farthest = np.sqrt(2 * phi) + half * bounds[8]
    t_xxx, t_xxy = cube * (bounds[0] + bounds[4] * farthest), cube * (bounds[1] + bounds[5] * farthest)
    t_xyy, t_yyy = cube * (bounds[2] + bounds[6] * farthest), cube * (bounds[3] + bounds[7] * farthest)
    rest = (t_xxx + 3 * t_xxy + 3 * t_xyy + t_yyy) / 6
    g_x, g_y, h_xx, h_xy, h_yy = half * g_x, half * g_y, square * h_xx, square * h_xy, square * h_yy
    if not (h_xx > 0.0 and h_yy > 0.0 and h_xx * h_yy > h_xy * h_xy):
        lowest = 0.5 * (h_xx + h_yy) - np.sqrt(0.25 * (h_xx - h_yy) ** 2 + h_xy * h_xy)  # least eigenvalue
        return phi - abs(g_x) - abs(g_y) + min(lowest, 0.0) - rest, False
    least_xx, least_yy, most_xy = h_xx - t_xxx - t_xxy, h_yy - t_xyy - t_yyy, abs(h_xy) + t_xxy + t_xyy
    convex = least_xx > 0.0 and least_yy > 0.0 and least_xx * least_yy > most_xy * most_xy
    return phi - fall(g_x, g_y, h_xx, h_xy, h_yy) - rest, convex


@inner
def fall(g_x, g_y, h_xx, h_xy, h_yy):
    """Return how far a convex quadratic function over |x|, |y| <= 1 falls below its value at (0, 0)."""
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
def descend(piece, bounds, q, x, y, half, best):
    """Go down from the middle (x, y) of a square to the minimum of phi in it; return the nearer of it and ``best``."""
    low_x, high_x, low_y, high_y = x - half, x + half, y - half, y + half
    to_x, to_y, change, phi, r = x, y, 0.0, np.inf, (0.0, 0.0, 0.0)
    slopes = (r, r, r, r, r)
    for _ in range(NEWTON_STEPS):
        there, slopes_there, gradient, hessian = expand(piece, q, to_x, to_y)
        phi_there = 0.5 * dot(there, there)
        if phi_there > phi and change > CLOSE:
            to_x, to_y, change = x + 0.25 * (to_x - x), y + 0.25 * (to_y - y), 0.25 * change
            continue
        x, y, phi, r, slopes = to_x, to_y, phi_there, there, slopes_there
        d_x, d_y = newton_step(slopes, gradient, hessian, (x, low_x, high_x), (y, low_y, high_y))
        to_x, to_y = min(max(x + d_x, low_x), high_x), min(max(y + d_y, low_y), high_y)
        change = max(abs(to_x - x), abs(to_y - y))
        if change <= STOP:
            break
    return nearer(phi, r, normal_of(slopes, bounds[8], x, y), best)


@inner
def newton_step(slopes, gradient, hessian, along_x, along_y):
    """Return the step to the minimum; a coordinate stays at an end of its interval from where phi falls outwards.

    ``along_x``, ``along_y``: where it is, low and high end. Where the second derivative is not positive, that of the
    tangent plane takes its place.
    """
    (g_x, g_y), (h_xx, h_xy, h_yy) = gradient, hessian
    S_x, S_y = slopes[0], slopes[1]
    held_x = (along_x[0] <= along_x[1] and g_x >= 0.0) or (along_x[0] >= along_x[2] and g_x <= 0.0)
    held_y = (along_y[0] <= along_y[1] and g_y >= 0.0) or (along_y[0] >= along_y[2] and g_y <= 0.0)
    if not (h_xx > 0.0 and h_yy > 0.0 and h_xx * h_yy - h_xy * h_xy > SINGULAR * h_xx * h_yy):
        h_xx, h_xy, h_yy = dot(S_x, S_x), dot(S_x, S_y), dot(S_y, S_y)
    if held_x or held_y or h_xx * h_yy - h_xy * h_xy <= SINGULAR * h_xx * h_yy:
        d_x = 0.0 if held_x or h_xx <= 0.0 else -g_x / h_xx
        d_y = 0.0 if held_y or h_yy <= 0.0 else -g_y / h_yy
        return d_x, d_y
    determinant = h_xx * h_yy - h_xy * h_xy
    return (h_xy * g_y - h_yy * g_x) / determinant, (h_xy * g_x - h_xx * g_y) / determinant


@not_inlined
def normal_of(slopes, size, x, y):
    """Return the unit normal; at an edge that is one point, its limit."""
    S_x, S_y, S_xx, S_xy, S_yy = slopes
    n = vector_product(S_x, S_y)
    if dot(n, n) <= (COLLAPSED * size * size) ** 2:
        a, b = np.copysign(INWARD, -x), np.copysign(INWARD, -y)
        n = vector_product(
            (
                S_x[0] + a * S_xx[0] + b * S_xy[0],
                S_x[1] + a * S_xx[1] + b * S_xy[1],
                S_x[2] + a * S_xx[2] + b * S_xy[2],
            ),
            (
                S_y[0] + a * S_xy[0] + b * S_yy[0],
                S_y[1] + a * S_xy[1] + b * S_yy[1],
                S_y[2] + a * S_xy[2] + b * S_yy[2],
            ),
        )
    length = np.sqrt(dot(n, n))
    return (n[0] / length, n[1] / length, n[2] / length)


@inner
def nearer(phi, r, n, best):
    """Return the nearer of two points: phi, S - q, the normal there, how well q is along it, on which side.

    Where two pieces meet at an edge, the nearest point is found on both. Then the piece along whose normal q is better
    tells the side of q.
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

"""The point of a piece of a bicubic patch nearest to a given point, found by branch and bound without omissions.

A piece is a polynomial S(x, y), |x| and |y| <= 1, with coefficients for powers of x and y. Half the squared distance,
phi = |S - q|^2 / 2, has a third derivative with a known bound, so on a square of (x, y) it is a quadratic function plus
a bounded remainder. A square is skipped if its quadratic function, less the remainder, does not fall below the value
found so far. Where the second derivative stays positive, phi has one minimum in the square, which Newton's method
finds. Other squares are quartered.
"""

import numpy as np

from engine.jit import inner, not_inlined
from engine.kernels.contact_geometry.patch_values import expand, expand_in_the_middle, last_step, normal_of
from engine.kernels.vectors import dot

DEEPEST = 5  # levels of quartering; reached at poles, and for points equally far from a whole region
MOST_SQUARES = 3000  # per query; beyond it, which only such points reach, pieces are not quartered
NEWTON_STEPS = 60
LAST = 1e-7  # change of x and y at which Newton's method ends: both are then accurate to rounding
CLOSE = 1e-6  # change of x and y below which phi falls by less than its rounding; Newton steps are then always accepted
SINGULAR = 1e-12  # smallest determinant of a matrix to invert, as a share of the product of its diagonal
TIE = 1e-12  # share by which the squared distances of one point, found twice, may differ


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

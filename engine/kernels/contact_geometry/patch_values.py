"""Values, derivatives and normals of pieces of bicubic patches, and derivatives of half the squared distance from them.

A piece is a polynomial S(x, y), |x| and |y| <= 1, with coefficients for powers of x and y; phi = |S - q|^2 / 2.
"""

import numpy as np

from engine.jit import inner, not_inlined
from engine.kernels.vectors import dot, vector_product

INWARD = 1e-6  # step towards the middle of a piece whose edge is collapsed to a point and has no normal
COLLAPSED = 1e-8  # share of a piece's squared size; if the normal's length is below it, that step is taken


@inner
def cubic(a, y):
    """Return the value of a cubic with coefficients a, and its first and second derivatives."""
    return (
        a[0] + y * (a[1] + y * (a[2] + y * a[3])),
        a[1] + y * (2 * a[2] + 3 * y * a[3]),
        2 * a[2] + 6 * y * a[3],
    )


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

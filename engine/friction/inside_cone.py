"""Points inside second-order cones: the Nesterov-Todd scaling, and the distance to the boundary."""

from engine.jit import inner
from engine.jit.lanes import choose, larger, root

TINY = 1e-300
FAR = 1e3  # upper limit of the step, as a multiple of the direction


@inner
def scaling(x0, x1, x2, y0, y1, y2):
    """Return the upper half of the Nesterov-Todd scaling W, W y = W^-1 x."""
    ax, ay = _root_determinant(x0, x1, x2), _root_determinant(y0, y1, y2)
    g = root(0.5 * (1 + (x0 * y0 + x1 * y1 + x2 * y2) / (ax * ay)))
    w0, w1, w2 = (x0 / ax + y0 / ay) / (2 * g), (x1 / ax - y1 / ay) / (2 * g), (x2 / ax - y2 / ay) / (2 * g)
    eta, k = root(ax / ay), 1 / (1 + w0)
    return eta * w0, eta * w1, eta * w2, eta * (1 + k * w1 * w1), eta * k * w1 * w2, eta * (1 + k * w2 * w2)


@inner
def _root_determinant(x0, x1, x2):
    """Return the square root of x_0^2 - |x_T|^2, kept above zero."""
    t = root(x1 * x1 + x2 * x2)
    return root(larger((x0 - t) * (x0 + t), TINY))


@inner
def to_boundary(x0, x1, x2, d0, d1, d2):
    """Return the largest steps along d that remain in the second-order cones."""
    a, b, c = d0 * d0 - d1 * d1 - d2 * d2, x0 * d0 - x1 * d1 - x2 * d2, x0 * x0 - x1 * x1 - x2 * x2
    square = b * b - a * c
    way = root(larger(square, 0.0))
    ahead = choose((square > 0.0) & (b < 0.0), c / (way - b), FAR)
    step = choose(a < 0.0, (-b - way) / a, ahead)
    edge = -x0 / d0
    step = choose((d0 < 0.0) & (edge < step), edge, step)
    return larger(step, 0.0)

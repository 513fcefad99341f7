"""Where an arc is nearest to a solid, as the angle from its middle.

First the minimum over a larger set, in closed form or by Newton's method: over the whole circle and an unbounded
cylinder, or over the plane of a plate's face. Where that minimum lies on the arc and on the solid, it is the minimum.
Where it does not, the arc is searched: samples, and the stationary point between any two whose slopes say it is lower.
"""

import numpy as np

from engine.kernels.jit import kernel
from engine.kernels.model import ON_BALL, ON_DISC, ON_RECTANGLE
from engine.kernels.solids import signed_distance
from engine.kernels.vectors import dot

NEWTON_STEPS = 8
BISECTIONS = 60
CELLS = 64  # of a full circle


@kernel
def angle_on_arc(kind, b, r, half, W, E, F, ew, ee, fe, x, y):
    """Return the angle [rad], -half to half, at which an arc is nearest to the solid ``b`` of that kind.

    The arc is W + r (cos E + sin F) across the solid's axis, vectors of the world, and ew + r (cos ee + sin fe) along
    it; x and y are the solid's own directions across.
    """
    flat = kind in (ON_DISC, ON_RECTANGLE)
    if flat:
        angle = np.arctan2(-fe, -ee)
    elif b[9] > 0.0:  # hollow: farthest from the axis
        angle = angle_on_circle(-dot(W, E), -dot(W, F), -dot(E, E), -dot(F, F), -dot(E, F), r)
    else:
        angle = angle_on_circle(dot(W, E), dot(W, F), dot(E, E), dot(F, F), dot(E, F), r)
    within = flat or abs(angle) <= half
    angle = min(max(angle, -half), half)
    if kind == ON_BALL:
        return angle
    curve = (
        (dot(W, x), dot(W, y), ew),
        (r * dot(E, x), r * dot(E, y), r * ee),
        (r * dot(F, x), r * dot(F, y), r * fe),
    )
    _, _, n_z = distance_along(kind, b, curve, angle)
    if within and n_z == (1.0 if flat else 0.0):
        return angle
    return search(kind, b, half, curve)


@kernel
def angle_on_circle(WE, WF, EE, FF, EF, r):
    """Return the angle [rad] at which |W + r (cos E + sin F)| is least, from the vectors' products.

    Seen along the cylinder's axis the circle is an ellipse. The point of an ellipse nearest to the origin lies in the
    quarter, between two of its axes, that faces the origin from the ellipse's centre, and no other stationary point
    does: Newton's method, kept inside this quarter, finds it.
    """
    angle = np.arctan2(-WF, -WE)
    axis, quarter = 0.5 * np.arctan2(2 * EF, EE - FF), 0.5 * np.pi
    low = axis + quarter * np.floor((angle - axis) / quarter)
    high = low + quarter
    rounding = 1e-14 * (abs(WE) + abs(WF) + r * (abs(EE) + abs(FF)))
    for k in range(BISECTIONS):
        c, s = np.cos(angle), np.sin(angle)
        slope = -s * WE + c * WF + r * (s * c * (FF - EE) + (c * c - s * s) * EF)
        curve = -c * WE - s * WF + r * ((c * c - s * s) * (FF - EE) - 4 * s * c * EF)
        if (curve > 0.0 and abs(slope) <= 1e-15 * curve) or (k >= NEWTON_STEPS and abs(slope) <= rounding):
            break
        if slope > 0.0:
            high = angle
        else:
            low = angle
        angle -= slope / curve
        if not (curve > 0.0 and low <= angle <= high):
            angle = 0.5 * (low + high)
    return angle if abs(angle) <= np.pi else angle - np.copysign(2 * np.pi, angle)


@kernel
def search(kind, b, half, curve):
    """Return the angle of the arc's point nearest to the solid, wherever it is."""
    cells = 8 + int(CELLS * half / np.pi)
    width = 2 * half / cells
    best, angle, d0, slope0 = np.inf, 0.0, np.inf, 0.0
    for k in range(cells + 1):
        t = k * width - half
        d, slope, _ = distance_along(kind, b, curve, t)
        # a valley between two samples, and not flat: its tangents meet below what is known
        if slope0 < 0.0 <= slope and max(d0 + slope0 * width, d - slope * width) < best:
            valley = stationary(kind, b, curve, t - width, t, slope0, slope)
            depth, _, _ = distance_along(kind, b, curve, valley)
            if depth < best:
                best, angle = depth, valley
        if d < best:
            best, angle = d, t
        d0, slope0 = d, slope
    return angle


@kernel
def stationary(kind, b, curve, low, high, below, above):
    """Return an angle at which the slope, ``below`` < 0 at ``low`` and ``above`` >= 0 at ``high``, changes sign.

    By the secant, and by halves when that does not halve the interval.
    """
    angle = high
    for k in range(BISECTIONS):
        width = high - low
        angle = low + width * (0.5 if k % 3 == 2 else below / (below - above))
        _, slope, _ = distance_along(kind, b, curve, angle)
        if slope < 0.0:
            low, below = angle, slope
        else:
            high, above = angle, slope
        if slope == 0.0 or high - low <= 1e-15:
            break
    return angle


@kernel
def distance_along(kind, b, curve, angle):
    """Return the signed distance of the arc's point at an angle, its slope, and the normal's part along the axis."""
    c, s = np.cos(angle), np.sin(angle)
    centre, e, f = curve
    d, n_x, n_y, n_z = signed_distance(
        kind,
        b,
        centre[0] + c * e[0] + s * f[0],
        centre[1] + c * e[1] + s * f[1],
        centre[2] + c * e[2] + s * f[2],
    )
    slope = n_x * (c * f[0] - s * e[0]) + n_y * (c * f[1] - s * e[1]) + n_z * (c * f[2] - s * e[2])
    return d, slope, n_z

"""Find the point of an arc that is nearest to a solid, as an angle from the middle of the arc.

First the minimum over a larger set is computed, in closed form or by Newton's method: over the whole circle and an
unbounded cylinder, or over the plane of a plate's face. If that minimum lies on the arc and on the solid, it is the
result. Otherwise the arc is searched: it is sampled, and a stationary point is found between any two samples whose
slopes bracket one.

Where an arc has entered a solid across an edge, its deepest point is between two faces, where the signed distance has a
kink. The normal there is the combination of the faces' normals that is perpendicular to the arc: the same as just
before, outside.
"""

import numpy as np

from engine.jit import inner, not_inlined
from engine.kernels.contact_geometry.solids import signed_distance
from engine.kernels.model import ON_BALL, ON_DISC, ON_RECTANGLE
from engine.kernels.vectors import CENTRED, dot

NEWTON_STEPS = 8
BISECTIONS = 150
CELL = np.pi / 32  # angle between two samples [rad]
SMALLEST = 1 / 32  # smallest spacing of samples, as a share of CELL
UNEVEN = 3e-5  # share of the radius by which two distances may differ from the prediction of their slopes
BESIDE = 1e-8  # angle from the nearest point at which the faces on both sides of an edge are evaluated [rad]
OPPOSED = 0.5  # if a combined normal is shorter, the faces point away from each other: the arc passes through
FLAT = 1e-12  # change of slope between samples, as a share of the radius, below which it is a rounding error


@inner
def nearest_on_arc(solid, r, half, across, along, axes):
    """Find the point of an arc that is nearest to a solid; the middle of the arc if all points are equally near.

    With the world vectors W, E, F in ``across``, the arc is W + r (cos E + sin F) perpendicular to the solid's axis,
    and with the numbers in ``along``, ew + r (cos ee + sin fe) along it; ``axes`` are the solid's directions
    perpendicular to its axis. Return the angle from the middle of the arc, -half to half [rad], whether the arc was
    searched, and the normal in the solid's axes.
    """
    kind, b = solid[0], solid[1]
    W, E, F = across
    ew, ee, fe = along
    x, y = axes
    flat = kind in (ON_DISC, ON_RECTANGLE)
    if flat:
        angle = np.arctan2(-fe, -ee) if ee * ee + fe * fe > CENTRED * CENTRED else 0.0
    elif _concentric(dot(W, E), dot(W, F), dot(E, E), dot(F, F), dot(E, F), r):
        angle = 0.0
    elif b[9] > 0.0:  # hollow: the point farthest from the axis
        angle = angle_on_circle(-dot(W, E), -dot(W, F), -dot(E, E), -dot(F, F), -dot(E, F), r)
    else:
        angle = angle_on_circle(dot(W, E), dot(W, F), dot(E, E), dot(F, F), dot(E, F), r)
    within = flat or abs(angle) <= half
    angle = min(max(angle, -half), half)
    curve = ((dot(W, x), dot(W, y), ew), (r * dot(E, x), r * dot(E, y), r * ee), (r * dot(F, x), r * dot(F, y), r * fe))
    _, _, normal = distance_along(solid, curve, angle)
    if kind == ON_BALL or (within and normal[2] == (1.0 if flat else 0.0)):
        return angle, False, normal
    angle = search(solid, r, half, curve)
    return angle, True, normal_at(solid, half, curve, angle)


@not_inlined
def normal_at(solid, half, curve, angle):
    """Return the normal at the angle [rad] of the arc's nearest point, in the solid's axes; see `distance_along`."""
    _, _, normal = distance_along(solid, curve, angle)
    if abs(angle) < half or half >= np.pi:
        _, slope0, n0 = distance_along(solid, curve, angle - BESIDE)
        _, slope1, n1 = distance_along(solid, curve, angle + BESIDE)
        if slope0 < 0.0 < slope1:
            k0, k1 = slope1 / (slope1 - slope0), slope0 / (slope0 - slope1)
            n = (k0 * n0[0] + k1 * n1[0], k0 * n0[1] + k1 * n1[1], k0 * n0[2] + k1 * n1[2])
            length = np.sqrt(dot(n, n))
            if length > OPPOSED:
                normal = (n[0] / length, n[1] / length, n[2] / length)
    return normal


@inner
def _concentric(WE, WF, EE, FF, EF, r):
    """Return whether all points of the circle are equally near to the axis, up to rounding; see `angle_on_circle`."""
    return abs(WE) + abs(WF) <= CENTRED * r and abs(EE - FF) + abs(EF) <= CENTRED


@inner
def angle_on_circle(WE, WF, EE, FF, EF, r):
    """Return the angle [rad] that minimises |W + r (cos E + sin F)|, from the scalar products of the vectors.

    Seen along the cylinder's axis the circle is an ellipse. The point of an ellipse nearest to the origin lies in the
    quarter, between two of its axes, that faces the origin as seen from the ellipse's centre, and no other stationary
    point lies there. Newton's method, confined to this quarter, finds it.
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
        if curve > 0.0 or k > 0:  # the start may be a maximum on the quarter's edge, where slopes are rounding errors
            low, high = (low, angle) if slope > 0.0 else (angle, high)
        angle -= slope / curve
        if not (curve > 0.0 and low <= angle <= high):
            angle = 0.5 * (low + high)
    return angle if abs(angle) <= np.pi else angle - np.copysign(2 * np.pi, angle)


@inner
def search(solid, r, half, curve):
    """Return the angle of the arc's point nearest to the solid, wherever it is.

    Samples are closer together where distances and slopes are inconsistent: there is an edge between them, or two
    valleys.
    """
    step = CELL
    low, angle = -half, -half
    best, slope0, _ = distance_along(solid, curve, low)
    d0 = best
    while low < half:
        high = min(low + step, half)
        d, slope, _ = distance_along(solid, curve, high)
        width = high - low
        if abs(d - d0 - 0.5 * width * (slope0 + slope)) > UNEVEN * r and width > SMALLEST * CELL:
            step = 0.5 * width
            continue
        if d < best:
            best, angle = d, high
        if slope0 < 0.0 <= slope and slope - slope0 > FLAT * r:
            valley = stationary(solid, curve, (low, slope0), (high, slope))
            depth, _, _ = distance_along(solid, curve, valley)
            if depth < best:
                best, angle = depth, valley
        low, d0, slope0, step = high, d, slope, min(2 * step, CELL)
    return angle


@not_inlined
def stationary(solid, curve, lower, upper):
    """Return an angle where the slope changes sign, between two angles with slopes < 0 and >= 0.

    It uses the secant method, and bisection where the secant leaves the interval and at every third step.
    """
    low, slope0 = lower
    high, slope = upper
    last, angle = low, high
    for k in range(BISECTIONS):
        new = angle - slope * (angle - last) / (slope - slope0)
        if k % 3 == 2 or not low < new < high:
            new = 0.5 * (low + high)
        last, slope0 = angle, slope
        angle = new
        _, slope, _ = distance_along(solid, curve, angle)
        if slope < 0.0:
            low = angle
        else:
            high = angle
        if slope == 0.0 or abs(angle - last) <= 1e-15 or high - low <= 1e-15:
            break
    return angle


@inner
def distance_along(solid, curve, angle):
    """Return the signed distance of the arc's point at an angle [rad], its slope, and the normal there.

    The arc is centre + cos e + sin f with the vectors of ``curve`` in the solid's axes; for ``solid`` see
    `solids.signed_distance`.
    """
    c, s = np.cos(angle), np.sin(angle)
    centre, e, f = curve
    x = centre[0] + c * e[0] + s * f[0]
    y = centre[1] + c * e[1] + s * f[1]
    z = centre[2] + c * e[2] + s * f[2]
    d, n = signed_distance(solid, x, y, z)
    return d, n[0] * (c * f[0] - s * e[0]) + n[1] * (c * f[1] - s * e[1]) + n[2] * (c * f[2] - s * e[2]), n

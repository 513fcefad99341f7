"""Contacts of points, spheres and arcs with turned and extruded solids, and with surfaces of bicubic patches.

The nearest point of the arc is found, wherever it is, first on a profile.

The angle of the arc is divided into cells. Within a cell the distance changes by no more than a known slope allows, so
a cell that cannot contain a smaller distance than the least one found is skipped. A cell is halved until only one piece
of the profile, with its smooth neighbours, can be nearest in it, and a cubic through the ends fits the middle: a
minimum in such a cell lies where the slope changes sign.
"""

import numpy as np

from engine.jit import inner, not_inlined
from engine.kernels.contact_geometry.arcs import CELL, FLAT, SMALLEST, UNEVEN, distance_along, normal_at, stationary
from engine.kernels.contact_geometry.patches import surface_distance
from engine.kernels.contact_geometry.solids import is_alone
from engine.kernels.model import ON_SURFACE, ON_TURNED
from engine.kernels.vectors import (
    CENTRED,
    NOWHERE,
    body_components,
    cross,
    dot,
    transport,
    vector_product,
    world_direction,
    world_point,
)

COARSE = np.pi / 8  # width of the widest cell [rad]
NARROWEST = 1 / 65536  # share of the widest cell; within such a cell, distances cannot be told apart
EVEN = 1e-9  # share of the radius by which a cubic may deviate in the middle of a cell
MOST_CELLS = 4000  # reached where many pieces are equally near all along the arc

SAMPLES = 9  # number of samples of an arc before the search


@inner
def on_profile(contacts, x, R, i, kind, point, frame):
    """Find the point of an arc that is nearest to a turned or an extruded solid."""
    a, b = contacts.a[i], contacts.b[i]
    ga, gb = contacts.geometry_a[i], contacts.geometry_b[i]
    first, after = contacts.profile[i]
    solid = (kind, gb, contacts.piece[first:after], (contacts.surfaces, contacts.surface[i]))
    z, t = world_direction(R, b, gb, 3), world_direction(R, b, gb, 6)
    y = vector_product(z, t)
    centre, foot, r = world_point(x, R, a, ga), world_point(x, R, b, gb), ga[9]
    w = (centre[0] - foot[0], centre[1] - foot[1], centre[2] - foot[2])
    e = world_direction(R, a, ga, 6)
    f = vector_product(world_direction(R, a, ga, 3), e)
    curve = (seen(w, t, y, z, 1.0), seen(e, t, y, z, r), seen(f, t, y, z, r))
    angle = nearest_angle(solid, r, ga[10], curve) if r > 0.0 else 0.0
    gap, _, n = distance_along(solid, curve, angle)
    n = normal_at(solid, ga[10], curve, angle) if r > 0.0 else n
    c, s = np.cos(angle), np.sin(angle)
    if ga[11] > 0.0 and gap > -ga[11]:
        opposite = -dot(n, seen(world_direction(R, a, ga, 3), t, y, z, 1.0))
        if r > 0.0:
            opposite = -(c * dot(n, curve[1]) + s * dot(n, curve[2])) / r
        if opposite < ga[12]:
            return pass_by(centre, point, frame, abs(gap) + ga[11] + contacts.clearance[i])
    tangent = (0.0, 0.0, 0.0)
    if kind == ON_TURNED:  # N and T1 lie in the plane through the axis
        u, v = curve[0][0] + c * curve[1][0] + s * curve[2][0], curve[0][1] + c * curve[1][1] + s * curve[2][1]
        rho = np.hypot(u, v)
        u, v = (1.0, 0.0) if rho <= max(CENTRED * abs(gap), NOWHERE) else (u / rho, v / rho)
        n_rho = n[0] * u + n[1] * v
        length = np.hypot(n_rho, n[2])
        n_rho, n_z = n_rho / length, n[2] / length
        n, tangent = (n_rho * u, n_rho * v, n_z), (-n_z * u, -n_z * v, n_rho)
    N, T1 = frame[0], frame[1]
    for k in range(3):
        N[k] = n[0] * t[k] + n[1] * y[k] + n[2] * z[k]
        T1[k] = tangent[0] * t[k] + tangent[1] * y[k] + tangent[2] * z[k]
        point[k] = centre[k] + r * (c * e[k] + s * f[k]) - gap * N[k]
    if kind != ON_TURNED:
        transport(z, t, N, T1)
    cross(N, T1, frame[2])
    return gap + contacts.clearance[i]


@not_inlined
def pass_by(centre, point, frame, gap):
    """Write a contact that cannot press in this pose: a corner that passes beside a face, see `gaps.passes_by`."""
    for k in range(3):
        point[k] = centre[k]
        frame[0, k], frame[1, k], frame[2, k] = 0.0, 0.0, 0.0
    return gap


@inner
def seen(v, t, y, z, size):
    """Return ``size`` times a world vector in the axes of a solid."""
    return (size * dot(v, t), size * dot(v, y), size * dot(v, z))


@not_inlined
def nearest_angle(solid, r, half, curve):
    """Return the angle [rad] of the arc's point nearest to a solid, from the middle of the arc.

    For ``solid`` and ``curve`` see `arcs.distance_along`; ``half`` is the half angle of the arc [rad].
    """
    slope_limit, widest = steepest(solid, r, curve), 2 * half / np.ceil(2 * half / COARSE)
    best, angle = least_sample(solid, half, curve, widest)
    low, width, cells = -half, widest, 0
    d0, s0, _ = distance_along(solid, curve, low)
    while low < half:
        high = min(low + width, half)
        d1, s1, _ = distance_along(solid, curve, high)
        while 0.5 * (d0 + d1 - slope_limit * (high - low)) < best:
            middle, cells = 0.5 * (low + high), cells + 1
            d, s, _ = distance_along(solid, curve, middle)
            known = high - low <= NARROWEST * COARSE or cells > MOST_CELLS
            if known or is_even(solid, r, curve, slope_limit, (low, d0, s0), (middle, d, s), (high, d1, s1)):
                best, angle = lower_of(solid, r, curve, (best, angle), (low, d0, s0), (middle, d, s))
                best, angle = lower_of(solid, r, curve, (best, angle), (middle, d, s), (high, d1, s1))
                break
            high, d1, s1 = middle, d, s
        if d1 < best:
            best, angle = d1, high
        width = min(2 * (high - low), widest)
        low, d0, s0 = high, d1, s1
    return angle


@inner
def steepest(solid, r, curve):
    """Return a bound of the distance's derivative by the angle: the radius, or less around a turned solid's axis."""
    if solid[0] != ON_TURNED:
        return r
    (x, y, _), (ex, ey, ez), (fx, fy, fz) = curve
    ee, ff, ef = ex * ex + ey * ey, fx * fx + fy * fy, ex * fx + ey * fy
    across, aside = np.hypot(x, y), 0.5 * np.hypot(ff - ee, 2 * ef)
    nearest = np.sqrt(max(0.5 * (ee + ff) - aside, 0.0)) - across  # lower bound of the arc's distance from the axis
    if nearest <= 0.0:
        return r
    outward = (np.hypot(x * ex + y * ey, x * fx + y * fy) + aside) / nearest
    return min(r, np.hypot(outward, np.hypot(ez, fz)))


@inner
def least_sample(solid, half, curve, width):
    """Return the least distance, and its angle, among the ends of the widest cells and in the valley next to it."""
    best, angle, at, slope = np.inf, 0.0, 0.0, 0.0
    for k in range(round(2 * half / width) + 1):
        at = min(-half + k * width, half)
        d, s, _ = distance_along(solid, curve, at)
        if d < best:
            best, angle, slope = d, at, s
    if slope != 0.0:
        beside = min(max(angle - np.copysign(width, slope), -half), half)
        _, s, _ = distance_along(solid, curve, beside)
        if slope * s < 0.0:
            below, above = ((angle, slope), (beside, s)) if slope < 0.0 else ((beside, s), (angle, slope))
            valley = stationary(solid, curve, below, above)
            d, _, _ = distance_along(solid, curve, valley)
            if d < best:
                best, angle = d, valley
    return best, angle


@not_inlined
def is_even(solid, r, curve, slope_limit, lower, middle, upper):
    """Return whether the distance over a cell is one smooth curve, from angle, distance and slope at three points."""
    width = upper[0] - lower[0]
    cubic = 0.5 * (lower[1] + upper[1]) + 0.125 * width * (lower[2] - upper[2])
    if abs(middle[1] - cubic) > EVEN * r:
        return False
    centre, e, f = curve
    c, s = np.cos(middle[0]), np.sin(middle[0])
    x, y, z = centre[0] + c * e[0] + s * f[0], centre[1] + c * e[1] + s * f[1], centre[2] + c * e[2] + s * f[2]
    u, v = (np.hypot(x, y), z) if solid[0] == ON_TURNED else (x, y)
    return is_alone(solid[2], u, v, slope_limit * width)


@not_inlined
def lower_of(solid, r, curve, least, lower, upper):
    """Return the smaller of the least distance so far and that in an interval, with its angle; see `is_even`."""
    if upper[1] < least[0]:
        least = (upper[1], upper[0])
    if lower[2] < 0.0 <= upper[2] and upper[2] - lower[2] > FLAT * r:
        valley = stationary(solid, curve, (lower[0], lower[2]), (upper[0], upper[2]))
        depth, _, _ = distance_along(solid, curve, valley)
        if depth < least[0]:
            least = (depth, valley)
    return least


# Contacts of points, spheres and arcs with surfaces of bicubic patches.
#
# Along an arc the distance changes by no more than its radius times the angle. A search from one end to the other skips
# intervals that cannot contain a smaller distance than the least one found so far. Elsewhere it proceeds in cells,
# which are narrower where distances and slopes are inconsistent, and finds the minimum in each cell whose slopes
# bracket one.


@inner
def on_surface(contacts, x, R, i, point, frame):
    """Find the point of an arc that is nearest to a surface; the gap is its signed distance there."""
    a, b = contacts.a[i], contacts.b[i]
    ga, gb = contacts.geometry_a[i], contacts.geometry_b[i]
    solid, r = (ON_SURFACE, gb, contacts.piece, (contacts.surfaces, contacts.surface[i])), ga[9]
    centre, e = world_point(x, R, a, ga), world_direction(R, a, ga, 6)
    f = vector_product(world_direction(R, a, ga, 3), e)
    q = body_components(R, b, (centre[0] - x[b, 0], centre[1] - x[b, 1], centre[2] - x[b, 2]))
    c, s = 0.0, 0.0
    if r > 0.0:
        e_b, f_b = body_components(R, b, e), body_components(R, b, f)
        curve = (q, (r * e_b[0], r * e_b[1], r * e_b[2]), (r * f_b[0], r * f_b[1], r * f_b[2]))
        angle = nearest_angle_over_surface(solid, r, ga[10], curve)
        gap, _, _ = distance_along(solid, curve, angle)
        n = normal_at(solid, ga[10], curve, angle)
        c, s = r * np.cos(angle), r * np.sin(angle)
    else:
        gap, n = surface_distance(solid[3], q[0], q[1], q[2])
    N, T1 = frame[0], frame[1]
    for k in range(3):
        N[k] = R[b, k, 0] * n[0] + R[b, k, 1] * n[1] + R[b, k, 2] * n[2]
        point[k] = centre[k] + (c * e[k] + s * f[k] - gap * N[k])
    transport(world_direction(R, b, gb, 3), world_direction(R, b, gb, 6), N, T1)
    cross(N, T1, frame[2])
    return gap + contacts.clearance[i]


@not_inlined
def nearest_angle_over_surface(solid, r, half, curve):
    """Return the angle [rad], from the middle of the arc, of its point nearest to a surface.

    For ``solid`` and ``curve``, here in the surface's body axes, see `arcs.distance_along`; ``half`` is the half angle
    of the arc [rad].
    """
    best, angle, low, width, d0, slope0 = np.inf, 0.0, -half, CELL, 0.0, 0.0
    for k in range(SAMPLES):  # the last sample is the end where the search begins
        sample = half * (1.0 - 2.0 * k / (SAMPLES - 1))
        d0, slope0, _ = distance_along(solid, curve, sample)
        if d0 < best:
            best, angle = d0, sample
    while low < half:
        # no smaller distance within (d0 - best) / r: the slope is at most r
        high = min(low + max(width, (d0 - best) / r), half)
        d, slope, _ = distance_along(solid, curve, high)
        if 0.5 * (d0 + d - r * (high - low)) < best:
            width = high - low
            if abs(d - d0 - 0.5 * width * (slope0 + slope)) > UNEVEN * r and width > SMALLEST * CELL:
                width *= 0.5
                continue
            if slope0 < 0.0 <= slope and slope - slope0 > FLAT * r:
                valley = stationary(solid, curve, (low, slope0), (high, slope))
                depth, _, _ = distance_along(solid, curve, valley)
                if depth < best:
                    best, angle = depth, valley
        if d < best:
            best, angle = d, high
        low, d0, slope0, width = high, d, slope, min(2 * width, CELL)
    return angle

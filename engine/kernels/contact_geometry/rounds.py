"""Contacts of cylinders, capsules and straight edges with each other, apart from those of their ends and rims.

Side a and side b are straight lines with a middle, a half length and a radius, 0 for an edge. A contact is one feature:

=============  =====================================================================================================
feature        where it presses
=============  =====================================================================================================
CROSSING       where the common perpendicular of the two lines meets both
EDGE           the same of an edge of a box, side a
LOWER, UPPER   almost parallel: the lower and the upper end, along a, of the length in which both are beside each other
LOWEST         an end on an end: the point of side a's face that is deepest in, or nearest to, that of side b
5 to 8         an end on an end: the farthest point of both faces along side b's tangent, across it, and opposite
=============  =====================================================================================================

Rims meet other solids by the kernel of arcs. They alone do not see rollers or discs whose ends are in one plane, or
whose rims coincide: a point in an edge is on the surface, whatever overlaps beside it. Whether bodies are beside each
other or on each other is decided by what they have in common. A side presses if that is longer, along the line of side
a through the point, than the point is deep; an end, if what both ends cover is wider than it is deep. Then no smaller
motion parts the bodies, but for the cosine of the angle between the axes.

An edge presses only along the directions between those of its two faces: a cylinder that stands on a ridge meets it
with its rim, and is not pushed aside. What overlaps can be parted along any direction in which it overlaps, so an edge
in a cylinder is as deep as it is below the nearer of its side and its flat end.
"""

import numpy as np

from engine.jit import inner, not_inlined
from engine.kernels.vectors import NOWHERE, cross, dot, split, vector_product, world_direction, world_point

EDGE, CROSSING, LOWER, UPPER, LOWEST = range(5)
LAST = 9  # the number after the last one
ALIGNED = 0.95  # cosine of the largest angle between almost parallel axes
PARALLEL = 1e-14  # squared sine, below which two lines have no common perpendicular
OUTSIDE = 1e-12  # share of a radius by which rounding may put a point of a face beyond its rim
BEYOND = 1e-3  # sine of the angle by which a rim or an edge may press beside its faces
MIDDLE = np.sqrt(0.5)  # cosine of the angle between a face of a box and the direction out of its edge, between both


@inner
def _lines(contacts, x, R, i):
    """Return middle and direction of both lines."""
    a, b, ga, gb = contacts.a[i], contacts.b[i], contacts.geometry_a[i], contacts.geometry_b[i]
    return (
        world_point(x, R, a, ga),
        world_direction(R, a, ga, 3),
        world_point(x, R, b, gb),
        world_direction(R, b, gb, 3),
    )


@inner
def _along(p, u, s):
    """Return the point p + s u."""
    return (p[0] + s * u[0], p[1] + s * u[1], p[2] + s * u[2])


@inner
def _between(p, q):
    """Return p - q."""
    return (p[0] - q[0], p[1] - q[1], p[2] - q[2])


@inner
def _clamped(s, half):
    """Return s, or the end of the line nearest to it."""
    return min(max(s, -half), half)


@not_inlined
def axes_apart(contacts, x, R, i):
    """Return the distance of the two lines with their ends, less their radii; no gap of their features is smaller."""
    p, u, q, v = _lines(contacts, x, R, i)
    half_a, half_b = contacts.geometry_a[i, 10], contacts.geometry_b[i, 10]
    w = _between(p, q)
    k, wu, wv = dot(u, v), dot(w, u), dot(w, v)
    sine = 1.0 - k * k
    s = _clamped((k * wv - wu) / sine, half_a) if sine > PARALLEL else _clamped(-wu, half_a)
    t = _clamped(wv + k * s, half_b)
    s = _clamped(k * t - wu, half_a)
    d = _between(_along(p, u, s), _along(q, v, t))
    return np.sqrt(dot(d, d)) + contacts.clearance[i]


@not_inlined
def beside(contacts, x, R, i, point, frame):
    """Find the point of a feature, see the table above; a feature that does not press in this pose passes by."""
    p, u, q, v = _lines(contacts, x, R, i)
    feature = contacts.geometry_a[i, 12]
    w = _between(p, q)
    k, wv = dot(u, v), dot(w, v)
    low, high = _common(k, wv, contacts.geometry_a[i, 10], contacts.geometry_b[i, 10])
    if feature >= LOWEST:
        gap = _on_face(contacts, R, i, (p, u, q, v), high - low, point, frame)
    else:
        place, found = 0.5 * (low + high), abs(k) >= ALIGNED and low <= high
        if feature <= CROSSING:
            place, found = _crossing(w, u, v, contacts.geometry_a[i, 10], contacts.geometry_b[i, 10])
        elif found:
            place = low if feature == LOWER else high
        gap = np.inf
        if found and abs(place) < np.inf:
            gap = _on_side(contacts, R, i, (p, u, q, v), place, point, frame)
            if feature == EDGE:
                gap = _of_edge(contacts, R, i, (p, u, q, v), place, gap, frame)
            if abs(k) >= ALIGNED and gap < np.inf:  # as long as side a's line through the point is beside b
                height = dot(_between((point[0], point[1], point[2]), q), v)
                low, high = _common(k, height - k * place, contacts.geometry_a[i, 10], contacts.geometry_b[i, 10])
                if gap < low - high:
                    gap = np.inf  # on each other: what they have in common along them is less than across
    if gap < np.inf:
        return gap
    for j in range(3):
        point[j] = p[j]
        frame[0, j], frame[1, j], frame[2, j] = 0.0, 0.0, 0.0
    return axes_apart(contacts, x, R, i) + contacts.geometry_a[i, 11]


@inner
def _common(k, wv, half_a, half_b):
    """Return where along a the length begins and ends in which both lines are beside each other, seen across b."""
    if abs(k) < ALIGNED:
        return 0.0, 0.0
    one, other = (-half_b - wv) / k, (half_b - wv) / k
    return max(min(one, other), -half_a), min(max(one, other), half_a)


@inner
def _crossing(w, u, v, half_a, half_b):
    """Return where along a the common perpendicular is, and whether it meets both lines between their ends."""
    k = dot(u, v)
    c = vector_product(u, v)
    sine = dot(c, c)
    if sine <= PARALLEL:
        return 0.0, False
    t = (dot(w, v) - k * dot(w, u)) / sine
    s = k * t - dot(w, u)
    return s, abs(s) <= half_a and abs(t) <= half_b


@inner
def _on_side(contacts, R, i, lines, s, point, frame):
    """Find the point of side a's circle at s that is nearest to side b's axis; inf if that is beyond an end of b."""
    p, u, q, v = lines
    at = _along(p, u, s)
    _, d = split(_between(at, q), v)
    lean, distance = dot(d, u), np.sqrt(dot(d, d))
    rest = distance * distance - lean * lean
    own = contacts.geometry_a[i, 9] / np.sqrt(rest) if rest > NOWHERE else 0.0
    across = (d[0] - lean * u[0], d[1] - lean * u[1], d[2] - lean * u[2])
    height, d = split(_between(_along(at, across, -own), q), v)
    if abs(height) > contacts.geometry_b[i, 10] * (1.0 + OUTSIDE):
        return np.inf
    foot, N, radius = _along(q, v, height), frame[0], contacts.geometry_b[i, 9]
    signed = np.copysign(np.sqrt(dot(d, d)), dot(d, across))
    if abs(signed) > NOWHERE:
        N[0], N[1], N[2] = d[0] / signed, d[1] / signed, d[2] / signed
    elif distance > NOWHERE:
        N[0], N[1], N[2] = across[0] / distance, across[1] / distance, across[2] / distance
    else:  # every direction is a nearest one; take that of the body
        N[0], N[1], N[2] = world_direction(R, contacts.b[i], contacts.geometry_b[i], 6)
    for j in range(3):
        point[j] = foot[j] + radius * N[j]
        frame[1, j] = v[j]
    cross(N, frame[1], frame[2])
    return signed + contacts.clearance[i] + contacts.geometry_a[i, 9]


@inner
def _of_edge(contacts, R, i, lines, s, gap, frame):
    """Return the gap of a box's edge from a cylinder, given that from its side; inf if it cannot press along N."""
    p, u, q, v = lines
    if dot(frame[0], world_direction(R, contacts.a[i], contacts.geometry_a[i], 6)) > BEYOND - MIDDLE:
        return np.inf
    gb = contacts.geometry_b[i]
    return max(gap, abs(dot(_between(_along(p, u, s), q), v)) - gb[11] + gb[9] + contacts.clearance[i])


@inner
def _on_face(contacts, R, i, lines, common, point, frame):
    """Find a point in which the end of a cylinder lies on that of another; inf if they are not on each other."""
    p, u, q, v = lines
    ga, gb = contacts.geometry_a[i], contacts.geometry_b[i]
    w = _between(p, q)
    up, down = np.copysign(1.0, dot(w, v)), -np.copysign(1.0, dot(w, u))
    n, m = (up * v[0], up * v[1], up * v[2]), (down * u[0], down * u[1], down * u[2])
    facing = -dot(n, m)
    if facing < ALIGNED:
        return np.inf
    t = world_direction(R, contacts.b[i], gb, 6)
    y = vector_product(v, t)
    middle = _along(q, v, up * gb[10])
    e = _between(_along(p, u, down * ga[10]), middle)
    centre = complex(dot(e, t), dot(e, y))
    slope, height = complex(dot(m, t), dot(m, y)) / facing, dot(e, n)
    way, quarter = complex(1.0, 0.0), ga[12] - LOWEST - 1
    if quarter < 0:
        if abs(slope) > OUTSIDE:
            way = -slope / abs(slope)
    else:
        way = complex(1.0 - quarter, 0.0) if quarter % 2 == 0 else complex(0.0, 2.0 - quarter)
    found, place = _lens(centre, facing * ga[9], gb[9], way)
    gap = height + slope.real * (place.real - centre.real) + slope.imag * (place.imag - centre.imag)
    if not found or abs(centre) - facing * ga[9] - gb[9] > -max(common, -gap):
        return np.inf  # beside each other: what both ends have in common is less wide than they are deep, or long
    for j in range(3):
        point[j] = middle[j] + place.real * t[j] + place.imag * y[j]
        frame[0, j], frame[1, j] = n[j], t[j]
    cross(frame[0], frame[1], frame[2])
    return gap + contacts.clearance[i] + ga[9] + gb[9]


@inner
def _lens(centre, own, radius, way):
    """Return whether two discs have points in common, and the farthest of these along a direction.

    They have the radii ``own``, about ``centre``, and ``radius``, about 0, in a plane of complex numbers.
    """
    apart = abs(centre)
    first, second = centre + own * way, radius * way
    if abs(first) <= radius * (1.0 + OUTSIDE):
        return True, first
    if abs(second - centre) <= own * (1.0 + OUTSIDE):
        return True, second
    if apart > own + radius:
        return False, first
    along = 0.5 * (apart + (radius * radius - own * own) / apart)
    corner = complex(along, np.sqrt(max(radius * radius - along * along, 0.0)))
    ahead = way * centre.conjugate()
    corner = corner if ahead.imag >= 0.0 else corner.conjugate()
    return True, corner * centre / apart


@not_inlined
def rim_passes_by(contacts, x, R, i, gap, point, frame):
    """Return whether a rim, no deeper than its depth, would be pressed from where its own body is.

    Side a's axis is its normal, out of the body. What presses a rim comes from between this and the radius.
    """
    a, ga = contacts.a[i], contacts.geometry_a[i]
    if gap <= -ga[11]:
        return False
    n, centre = world_direction(R, a, ga, 3), world_point(x, R, a, ga)
    N = (frame[0, 0], frame[0, 1], frame[0, 2])
    distance = gap - contacts.clearance[i]
    d = _between(_along((point[0], point[1], point[2]), N, distance), centre)
    return dot(N, n) > BEYOND or dot(N, d) > BEYOND * ga[9]

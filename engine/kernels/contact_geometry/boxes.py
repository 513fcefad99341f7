"""Contacts of two boxes: their nearest points, and the corners of what two faces that lie on each other have in common.

The separation of two boxes along the normals of their faces and across any two of their edges (Gottschalk, Lin and
Manocha, 1996) is the largest where they overlap: the depth, and a lower bound of their distance elsewhere. Nothing else
tells apart a box that lies on another, with all sides in one plane, from one that lies beside it. Where they are apart,
the distance is the least of those of corners from the other box, and between edges.

Feature 0 is the nearest pair of points. Features 1 to 8 are the points of the common part of two faces that are
farthest in eight directions. Whatever is the same point as an earlier one passes by.
"""

import numpy as np

from engine.jit import inner, not_inlined
from engine.kernels.contact_geometry.rounds import ALIGNED
from engine.kernels.vectors import cross, dot, split, vector_product, world_direction, world_point

CORNERS = 8  # the most that two rectangles have in common, and as many directions
TURNED = 0.2  # rad, of the first direction from an edge of the face: no two corners of aligned boxes are equally far
ACROSS = 1e-12  # squared sine, below which two edges are parallel; share of a size, below which a length is rounding
SAME = 1e-9  # share of the size of a box: points closer together than this are one
STEEP = 0.9  # cosine of the angle between the normal and b's first axis beyond which T1 is its second one


@inner
def _boxes(contacts, x, R, i):
    """Return middle, axes and half sides of both boxes."""
    a, b, ga, gb = contacts.a[i], contacts.b[i], contacts.geometry_a[i], contacts.geometry_b[i]
    return _box(x, R, a, ga), _box(x, R, b, gb)


@inner
def _box(x, R, body, row):
    X, Z = world_direction(R, body, row, 6), world_direction(R, body, row, 3)
    return world_point(x, R, body, row), (X, vector_product(Z, X), Z), (row[9], row[10], row[11])


@inner
def _sum(p, s, u, t, v):
    """Return p + s u + t v."""
    return (p[0] + s * u[0] + t * v[0], p[1] + s * u[1] + t * v[1], p[2] + s * u[2] + t * v[2])


@inner
def _between(p, q):
    return (p[0] - q[0], p[1] - q[1], p[2] - q[2])


@inner
def _extent(box, n):
    """Return how far a box reaches from its middle along a vector, times its length."""
    _, axes, half = box
    return half[0] * abs(dot(axes[0], n)) + half[1] * abs(dot(axes[1], n)) + half[2] * abs(dot(axes[2], n))


@inner
def _corner(box, number):
    """Return one of the eight corners of a box."""
    p, axes, half = box
    for k in range(3):
        p = _sum(p, half[k] if number >> k & 1 else -half[k], axes[k], 0.0, axes[k])
    return p


@inner
def _farthest(box, n):
    """Return the corner of a box that is farthest along a direction."""
    p, axes, half = box
    for k in range(3):
        p = _sum(p, np.copysign(half[k], dot(axes[k], n)), axes[k], 0.0, axes[k])
    return p


@not_inlined
def _separation(one, other):
    """Return the largest separation, whose it is, and the same of faces alone.

    0 to 2 is a face of the first box, 3 to 5 one of the other, 6 + 3 i + j is across the edges i and j.
    """
    w = _between(one[0], other[0])
    face, best = 0, -np.inf
    for k in range(6):
        n = one[1][k] if k < 3 else other[1][k - 3]
        s = abs(dot(w, n)) - _extent(one, n) - _extent(other, n)
        if s > best:
            face, best = k, s
    code, most = face, best
    for k in range(9):
        c = vector_product(one[1][k // 3], other[1][k % 3])
        square = dot(c, c)
        if square > ACROSS:
            s = (abs(dot(w, c)) - _extent(one, c) - _extent(other, c)) / np.sqrt(square)
            if s > most + ACROSS * (_extent(one, c) + _extent(other, c)):
                code, most = 6 + k, s
    return most, code, best, face


@not_inlined
def boxes_apart(contacts, x, R, i):
    """Return a lower bound of the distance of two boxes; where they overlap, it is this distance."""
    one, other = _boxes(contacts, x, R, i)
    return _separation(one, other)[0] + contacts.clearance[i]


@not_inlined
def of_boxes(contacts, x, R, i, point, frame):
    """Find the point of a feature, see above; a feature that does not press in this pose passes by."""
    one, other = _boxes(contacts, x, R, i)
    most, code, _, face = _separation(one, other)
    feature = int(contacts.geometry_a[i, 12])
    lies, n, faces = _faces(one, other, face)
    size = SAME * (contacts.geometry_b[i, 9] + contacts.geometry_b[i, 10] + contacts.geometry_b[i, 11])
    found, gap, at = False, 0.0, other[0]
    if feature == 0:
        found = True
        gap, at, n = _nearest(one, other, most) if most > 0.0 else _deepest(one, other, most, code)
        if most <= 0.0 and code == face and lies:  # of all points of a face that are equally deep, one that both have
            found, gap, at = _common_corner(faces, 0)
    elif lies:
        found, gap, at = _common_corner(faces, feature)
    for j in range(1, CORNERS + 1 if feature == 0 else feature):
        if found and lies:
            same, height, earlier = _common_corner(faces, j)
            d = _between(at, earlier)
            if same and dot(d, d) <= size * size and height <= gap + size:
                found = False
    if not found:
        for k in range(3):
            point[k] = other[0][k]
            frame[0, k], frame[1, k], frame[2, k] = 0.0, 0.0, 0.0
        sides = one[2][0] + one[2][1] + one[2][2] + other[2][0] + other[2][1] + other[2][2]
        return 2.0 * (abs(most) + sides)  # more than the distance
    _, t = split(other[1][0] if abs(dot(other[1][0], n)) < STEEP else other[1][1], n)
    length = np.sqrt(dot(t, t))
    for k in range(3):
        point[k] = at[k]
        frame[0, k], frame[1, k] = n[k], t[k] / length
    cross(frame[0], frame[1], frame[2])
    return max(gap, most) + contacts.clearance[i]  # a face may be deeper along its normal than the boxes overlap


@inner
def _towards(one, other, n):
    """Return a direction, or its opposite, so that it points from the other box to the first."""
    return n if dot(_between(one[0], other[0]), n) >= 0.0 else (-n[0], -n[1], -n[2])


@inner
def _deepest(one, other, depth, code):
    """Return gap, point on the other box, and normal of two boxes that overlap."""
    if code < 3:
        n = _towards(one, other, one[1][code])
        return depth, _farthest(other, n), n
    if code < 6:
        n = _towards(one, other, other[1][code - 3])
        return depth, _sum(_farthest(one, (-n[0], -n[1], -n[2])), -depth, n, 0.0, n), n
    i, j = (code - 6) // 3, (code - 6) % 3
    c = vector_product(one[1][i], other[1][j])
    n = _towards(one, other, _sum((0.0, 0.0, 0.0), 1.0 / np.sqrt(dot(c, c)), c, 0.0, c))
    p, q = _farthest(one, (-n[0], -n[1], -n[2])), _farthest(other, n)
    u, v = one[1][i], other[1][j]
    w, k = _between(p, q), dot(u, v)
    return depth, _sum(q, (dot(w, v) - k * dot(w, u)) / (1.0 - k * k), v, 0.0, v), n


@inner
def _nearest(one, other, bound):
    """Return gap, point on the other box, and normal of two boxes that are apart, by at least ``bound``."""
    best, at, n = np.inf, other[0], other[1][0]
    for number in range(8):
        p = _corner(one, number)
        d, way = _distance(other, p)
        if d < best:
            best, at, n = d, _sum(p, -d, way, 0.0, way), way
    for number in range(8):
        p = _corner(other, number)
        d, way = _distance(one, p)
        if d < best:
            best, at, n = d, p, (-way[0], -way[1], -way[2])
    if best > bound * (1.0 + ACROSS):
        for k in range(9):
            best, at, n = _nearest_edges(one, other, k // 3, k % 3, (best, at, n))
    return best, at, n


@inner
def _distance(box, p):
    """Return the distance of a point outside a box, and the direction to it."""
    middle, axes, half = box
    d = _between(p, middle)
    square, way = 0.0, (0.0, 0.0, 0.0)
    for k in range(3):
        along = dot(d, axes[k])
        over = max(abs(along) - half[k], 0.0)
        square += over * over
        way = _sum(way, np.copysign(over, along), axes[k], 0.0, axes[k])
    length = np.sqrt(square)
    if length == 0.0:
        return 0.0, axes[0]
    return length, (way[0] / length, way[1] / length, way[2] / length)


@not_inlined
def _nearest_edges(one, other, i, j, best):
    """Return the nearer of ``best`` and the common perpendiculars of the edges along axes i and j."""
    u, v = one[1][i], other[1][j]
    c, k = vector_product(u, v), dot(u, v)
    sine = dot(c, c)
    if sine <= ACROSS:
        return best
    length = np.sqrt(sine)
    for number in range(16):
        p, q = _edge(one, i, number & 3), _edge(other, j, number >> 2)
        w = _between(p, q)
        t = (dot(w, v) - k * dot(w, u)) / sine
        s = k * t - dot(w, u)
        height = dot(w, c) / length
        if abs(s) <= one[2][i] and abs(t) <= other[2][j] and abs(height) < best[0]:
            size = np.copysign(1.0 / length, height)
            best = (abs(height), _sum(q, t, v, 0.0, v), (size * c[0], size * c[1], size * c[2]))
    return best


@inner
def _edge(box, axis, number):
    """Return the middle of one of the four edges along an axis."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    along = box[2][j] if number & 1 else -box[2][j]
    return _sum(box[0], along, box[1][j], box[2][k] if number & 2 else -box[2][k], box[1][k])


@inner
def _faces(one, other, face):
    """Return whether a face lies almost flat on one of the other box, the normal towards the first box, and the pair.

    The pair are the first face: middle, normal out of it, two axes, half sides; the second one in the plane of the
    first: middle and half sides as complex numbers, height and slope; and whether the first one is of the other box.
    """
    own = face >= 3
    flat, lying = (other, one) if own else (one, other)
    i = face - 3 if own else face
    n = _towards(lying, flat, flat[1][i])
    X, Y, a, b = flat[1][(i + 1) % 3], flat[1][(i + 2) % 3], flat[2][(i + 1) % 3], flat[2][(i + 2) % 3]
    middle = _sum(flat[0], flat[2][i], n, 0.0, n)
    j, facing = 0, 0.0
    for k in range(3):
        if abs(dot(lying[1][k], n)) > abs(facing):
            j, facing = k, dot(lying[1][k], n)
    down = -np.copysign(1.0, facing)
    m = (down * lying[1][j][0], down * lying[1][j][1], down * lying[1][j][2])
    e = _between(_sum(lying[0], lying[2][j], m, 0.0, m), middle)
    E, F = lying[1][(j + 1) % 3], lying[1][(j + 2) % 3]
    e_half, f_half = lying[2][(j + 1) % 3], lying[2][(j + 2) % 3]
    centre = complex(dot(e, X), dot(e, Y))
    first = complex(e_half * dot(E, X), e_half * dot(E, Y))
    second = complex(f_half * dot(F, X), f_half * dot(F, Y))
    slope = complex(dot(m, X), dot(m, Y)) / abs(facing)
    towards = n if own else (-n[0], -n[1], -n[2])
    return abs(facing) >= ALIGNED, towards, ((middle, n, X, Y, a, b), (centre, first, second, dot(e, n), slope), own)


@not_inlined
def _common_corner(faces, number):
    """Return whether two faces have anything in common, and gap and point of its farthest corner in a direction.

    The direction is one of eight, or for 0 that in which the gap falls. The point is on the other box.
    """
    (middle, n, X, Y, a, b), (centre, first, second, height, slope), own = faces
    angle = TURNED + 0.25 * np.pi * (number - 1)
    way = complex(np.cos(angle), np.sin(angle))
    if number == 0 and abs(slope) > ACROSS:
        way = -slope / abs(slope)
    found, best, farthest = False, 0.0 + 0.0j, -np.inf
    area = first.real * second.imag - first.imag * second.real
    slack = ACROSS * (a + b)
    for k in range(4):
        sign, other = 1.0 - 2.0 * (k & 1), 1.0 - (k & 2)
        z = complex(sign * a, other * b)  # a corner of the first face that is in the second
        d = z - centre
        s, t = d.real * second.imag - d.imag * second.real, first.real * d.imag - first.imag * d.real
        if max(abs(s), abs(t)) <= abs(area) * (1.0 + ACROSS):
            found, best, farthest = _farther(z, way, (found, best, farthest))
        start = centre + sign * first + other * second  # a corner of the second face that is in the first
        if abs(start.real) <= a + slack and abs(start.imag) <= b + slack:
            found, best, farthest = _farther(start, way, (found, best, farthest))
        # where the edge that begins there crosses those of the first face
        edge = -2.0 * sign * first if sign == other else -2.0 * other * second
        for side in range(2):
            at = (1.0 - 2.0 * side) * a - start.real
            if 0.0 <= at * edge.real <= edge.real * edge.real and edge.real != 0.0:
                z = complex(start.real + at, start.imag + at / edge.real * edge.imag)
                if abs(z.imag) <= b + slack:
                    found, best, farthest = _farther(z, way, (found, best, farthest))
            at = (1.0 - 2.0 * side) * b - start.imag
            if 0.0 <= at * edge.imag <= edge.imag * edge.imag and edge.imag != 0.0:
                z = complex(start.real + at / edge.imag * edge.real, start.imag + at)
                if abs(z.real) <= a + slack:
                    found, best, farthest = _farther(z, way, (found, best, farthest))
    d = best - centre
    gap = height + slope.real * d.real + slope.imag * d.imag
    at = _sum(middle, best.real, X, best.imag, Y)
    return found, gap, (at if own else _sum(at, gap, n, 0.0, n))


@inner
def _farther(z, way, best):
    """Return the one of two points that is farther along a direction."""
    far = z.real * way.real + z.imag * way.imag
    return (True, z, far) if far > best[2] else best

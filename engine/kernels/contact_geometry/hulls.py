"""Contacts of two convex polyhedra, of which one may be a point or a line with a skin, or a half-space.

Their separation is the largest along the normals of faces, and across those two edges that bound the difference of both
bodies (Gregorius, 2013): where they overlap, the depth, elsewhere a lower bound of the distance, which is then the
least of those between corners and faces and between edges. All of it is in the axes of side b, from its centre of mass.

A half-space is a face without a boundary, and has no corners. Feature 0 is the nearest pair of points. Features 1 to 8
are the points farthest in eight directions of what a face has in common with a face or an edge that lies almost flat on
it. Whatever is the same point as an earlier one passes by. What was found at a pose is kept for all features.
"""

import numpy as np

from engine.jit import inner, not_inlined
from engine.kernels.contact_geometry.boxes import ACROSS, CORNERS, SAME, STEEP, TURNED
from engine.kernels.contact_geometry.rounds import ALIGNED
from engine.kernels.vectors import cross, dot, split, vector_product

POSE = 24  # numbers of the pose of two bodies, with which a row of ``found`` begins
FEATURE = 8  # numbers of a feature: whether it presses, gap, point, normal
FOUND = POSE + 1 + FEATURE * (CORNERS + 1)  # the number between is the separation
SLANT = np.sqrt(1.0 - ALIGNED**2)  # sine of the angle between a face and an edge that lies almost flat on it
NO_FACE = -1


@inner
def _vector(row):
    return (row[0], row[1], row[2])


@inner
def _less(p, q):
    """Return p - q."""
    return (p[0] - q[0], p[1] - q[1], p[2] - q[2])


@inner
def _along(p, u, s):
    """Return p + s u."""
    return (p[0] + s * u[0], p[1] + s * u[1], p[2] + s * u[2])


@inner
def _opposite(n):
    return (-n[0], -n[1], -n[2])


@not_inlined
def hulls_apart(contacts, x, R, i):
    """Return a lower bound of the distance of two convex solids; where they overlap, it is this distance."""
    _look(contacts, x, R, i)
    return contacts.hulls.found[contacts.hulls.pair[i], POSE] + contacts.clearance[i]


@not_inlined
def of_hulls(contacts, x, R, i, point, frame):
    """Find the point of a feature, see above; a feature that does not press in this pose passes by."""
    _look(contacts, x, R, i)
    row, b = contacts.hulls.found[contacts.hulls.pair[i]], contacts.b[i]
    first = POSE + 1 + FEATURE * int(contacts.geometry_a[i, 12])
    M, o = R[b], x[b]
    if row[first] == 0.0:
        for k in range(3):
            point[k] = o[k]
            frame[0, k], frame[1, k], frame[2, k] = 0.0, 0.0, 0.0
        return 2.0 * (abs(row[POSE]) + contacts.geometry_a[i, 11])  # more than the distance
    for k in range(3):
        at, n = 0.0, 0.0
        for j in range(3):
            at += M[k, j] * row[first + 2 + j]
            n += M[k, j] * row[first + 5 + j]
        point[k], frame[0, k] = o[k] + at, n
    n = _vector(frame[0])
    axis = 0 if abs(row[first + 5]) < STEEP else 1
    _, t = split((M[0, axis], M[1, axis], M[2, axis]), n)
    length = np.sqrt(dot(t, t))
    for k in range(3):
        frame[1, k] = t[k] / length
    cross(frame[0], frame[1], frame[2])
    return row[first + 1] + contacts.clearance[i]


@not_inlined
def _look(contacts, x, R, i):
    """Compute the row of ``found`` for two hulls anew if their pose has changed."""
    hulls, a, b = contacts.hulls, contacts.a[i], contacts.b[i]
    row, same = hulls.found[hulls.pair[i]], True
    for k in range(3):
        same = same and row[k] == x[a, k] and row[12 + k] == x[b, k]
        row[k], row[12 + k] = x[a, k], x[b, k]
        for j in range(3):
            at = 3 + 3 * k + j
            same = same and row[at] == R[a, k, j] and row[12 + at] == R[b, k, j]
            row[at], row[12 + at] = R[a, k, j], R[b, k, j]
    if not same:
        span_a, span_b = hulls.span[hulls.of[i, 0]], hulls.span[hulls.of[i, 1]]
        _place(hulls, span_a, x, R, a, b)
        one = (
            hulls.placed[: span_a[1] - span_a[0]],
            hulls.placed_face[: span_a[3] - span_a[2]],
            hulls.edge[span_a[4] : span_a[5]],
            hulls.ring[span_a[2] : span_a[3]],
        )
        other = (
            hulls.vertex[span_b[0] : span_b[1]],
            hulls.face[span_b[2] : span_b[3]],
            hulls.edge[span_b[4] : span_b[5]],
            hulls.ring[span_b[2] : span_b[3]],
        )
        _find(hulls, one, other, SAME * contacts.geometry_a[i, 11], row)


@inner
def _place(hulls, span, x, R, a, b):
    """Write corners and faces of side a in the axes of side b, from its centre of mass."""
    A, B = R[a], R[b]
    d0, d1, d2 = x[a, 0] - x[b, 0], x[a, 1] - x[b, 1], x[a, 2] - x[b, 2]
    for j in range(span[1] - span[0]):
        p = hulls.vertex[span[0] + j]
        w0 = d0 + A[0, 0] * p[0] + A[0, 1] * p[1] + A[0, 2] * p[2]
        w1 = d1 + A[1, 0] * p[0] + A[1, 1] * p[1] + A[1, 2] * p[2]
        w2 = d2 + A[2, 0] * p[0] + A[2, 1] * p[1] + A[2, 2] * p[2]
        for k in range(3):
            hulls.placed[j, k] = B[0, k] * w0 + B[1, k] * w1 + B[2, k] * w2
    for j in range(span[3] - span[2]):
        n = hulls.face[span[2] + j]
        w0 = A[0, 0] * n[0] + A[0, 1] * n[1] + A[0, 2] * n[2]
        w1 = A[1, 0] * n[0] + A[1, 1] * n[1] + A[1, 2] * n[2]
        w2 = A[2, 0] * n[0] + A[2, 1] * n[1] + A[2, 2] * n[2]
        for k in range(3):
            hulls.placed_face[j, k] = B[0, k] * w0 + B[1, k] * w1 + B[2, k] * w2
        hulls.placed_face[j, 3] = n[3] + d0 * w0 + d1 * w1 + d2 * w2


@not_inlined
def _find(hulls, one, other, size, row):
    """Write the separation of two solids and all their features."""
    face, own, best, corner = _apart_by_faces(one, other)
    most, i, j, normal = _apart_by_edges(one, other, best)
    flat, fixed, moving = i < 0, other if own else one, one if own else other
    row[POSE] = most
    n = _face_normal(one, other, face, own)
    lies, count, buffer = _common(hulls, fixed, moving, face)
    for feature in range(1, CORNERS + 1):
        found, height, at = False, 0.0, (0.0, 0.0, 0.0)
        if lies and count > 0:
            height, at = _farthest(hulls, fixed, (face, own), (count, buffer), feature)
            found = not _again(row, range(1, feature), at, height, size)
        _write(row, feature, found, max(height, most), at, n)  # it may be deeper along n than the solids overlap
    gap, at, way = most, (0.0, 0.0, 0.0), n
    if flat:
        at = _vector(moving[0][corner])
        at = _along(at, n, -best) if own else at
    else:
        at, way = _on_edges(one, other, i, j)[1], normal
    if most > 0.0 and len(other[0]) > 0:
        if flat:
            clear = _inside(hulls, fixed, face, at)
        else:
            _, _, s, t = _on_edges(one, other, i, j)
            clear = 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0
        if not clear:
            gap, at, way = _nearest(hulls, one, other, (most, at, way))
    elif most <= 0.0 and flat and lies and count > 0:  # of all points that are equally deep, one that both have
        gap, at = _lowest(hulls, fixed, (face, own), (count, buffer))
        gap = max(gap, most)
    _write(row, 0, not _again(row, range(1, CORNERS + 1), at, gap, size), gap, at, way)


@inner
def _again(row, features, at, gap, size):
    """Return whether one of some features is the same point, and no higher."""
    for k in features:
        first = POSE + 1 + FEATURE * k
        d = _less(at, (row[first + 2], row[first + 3], row[first + 4]))
        if row[first] == 1.0 and dot(d, d) <= size * size and row[first + 1] <= gap + size:
            return True
    return False


@inner
def _write(row, feature, found, gap, at, n):
    first = POSE + 1 + FEATURE * feature
    row[first], row[first + 1] = 1.0 if found else 0.0, gap
    for k in range(3):
        row[first + 2 + k], row[first + 5 + k] = at[k], n[k]


@inner
def _face_normal(one, other, face, own):
    """Return the normal of a face, towards side a."""
    return _vector(other[1][face]) if own else _opposite(_vector(one[1][face]))


# The separation.


@inner
def _over(face, corners):
    """Return the lowest height of corners over a face, and the number of that corner."""
    n, lowest, at = _vector(face), np.inf, 0
    for k in range(len(corners)):
        height = dot(n, _vector(corners[k]))
        if height < lowest:
            lowest, at = height, k
    return lowest - face[3], at


@not_inlined
def _apart_by_faces(one, other):
    """Return the face with the largest separation, whether it is of side b, the separation, and the other's corner."""
    face, own, best, corner = 0, True, -np.inf, 0
    for k in range(len(other[1])):
        s, at = _over(other[1][k], one[0])
        if s > best:
            face, own, best, corner = k, True, s, at
    if len(other[0]) > 0:
        for k in range(len(one[1])):
            s, at = _over(one[1][k], other[0])
            if s > best + ACROSS * abs(best):  # of two equal ones that of side b
                face, own, best, corner = k, False, s, at
    return face, own, best, corner


@not_inlined
def _apart_by_edges(one, other, best):
    """Return the separation across two edges, both and its direction, if it is larger than ``best``; else -1, -1."""
    V, F, E = one[0], one[1], one[2]
    W, G, D = other[0], other[1], other[2]
    most, first, second, normal = best, -1, -1, (0.0, 0.0, 0.0)
    for i in range(len(E)):
        p = _vector(V[E[i, 0]])
        u = _less(_vector(V[E[i, 1]]), p)
        bounded, uu = E[i, 2] != NO_FACE, dot(u, u)
        for j in range(len(D)):
            c, d = _vector(G[D[j, 2]]), _vector(G[D[j, 3]])
            if dot(c, u) * dot(d, u) >= 0.0:
                continue
            q = _vector(W[D[j, 0]])
            v = _less(_vector(W[D[j, 1]]), q)
            if bounded:
                a, b = _vector(F[E[i, 2]]), _vector(F[E[i, 3]])
                if dot(a, v) * dot(b, v) >= 0.0:
                    continue
            n = vector_product(u, v)
            square = dot(n, n)
            if square <= ACROSS * uu * dot(v, v):
                continue
            size = np.copysign(1.0 / np.sqrt(square), dot(n, c) + dot(n, d))
            n = (size * n[0], size * n[1], size * n[2])
            if bounded and dot(n, a) + dot(n, b) >= 0.0:
                continue
            s = dot(n, _less(p, q))
            if s > most + ACROSS * (abs(dot(n, p)) + abs(dot(n, q))):
                most, first, second, normal = s, i, j, n
    return most, first, second, normal


# The distance of solids that are apart.


@inner
def _on_edges(one, other, i, j):
    """Return the nearest points of the lines through two edges, and where on each, 0 to 1 between its corners."""
    p, q = _vector(one[0][one[2][i, 0]]), _vector(other[0][other[2][j, 0]])
    u, v = _less(_vector(one[0][one[2][i, 1]]), p), _less(_vector(other[0][other[2][j, 1]]), q)
    w = _less(p, q)
    vv, uv, uw, vw = dot(v, v), dot(u, v), dot(u, w), dot(v, w)
    c = vector_product(u, v)
    s = (uv * vw - vv * uw) / dot(c, c)
    t = (uv * s + vw) / vv
    return _along(p, u, s), _along(q, v, t), s, t


@inner
def _inside(hulls, flat, face, p):
    """Return whether a point, seen along the normal of a face, is inside its boundary; true if it has none."""
    n, ring = _vector(flat[1][face]), flat[3][face]
    before = ring[1] - 1
    for k in range(ring[0], ring[1]):
        start = _vector(flat[0][hulls.corner[before]])
        edge = _less(_vector(flat[0][hulls.corner[k]]), start)
        if dot(vector_product(edge, _less(p, start)), n) < 0.0:
            return False
        before = k
    return True


@not_inlined
def _over_faces(hulls, flat, corners, own, best):
    """Return gap, point on side b and normal of the corner that is nearest to a face and over it, if it is nearer."""
    for f in range(len(flat[1])):
        n = _vector(flat[1][f])
        for k in range(len(corners)):
            p = _vector(corners[k])
            height = dot(n, p) - flat[1][f, 3]
            if 0.0 < height < best[0] and _inside(hulls, flat, f, p):
                best = (height, _along(p, n, -height), n) if own else (height, p, _opposite(n))
    return best


@not_inlined
def _nearest(hulls, one, other, bound):
    """Return gap, point on side b and normal of two solids that are apart; ``bound`` has those of the separation."""
    best = _over_faces(hulls, other, one[0], True, (np.inf, bound[1], bound[2]))
    best = _over_faces(hulls, one, other[0], False, best)
    for i in range(max(len(one[2]), 1)):
        p, u = _edge(one, i)
        for j in range(len(other[2])):
            q, v = _edge(other, j)
            s, t = _nearest_on(p, u, q, v)
            foot = _along(q, v, t)
            d = _less(_along(p, u, s), foot)
            square = dot(d, d)
            if square < best[0] * best[0]:
                distance = np.sqrt(square)
                best = (distance, foot, (d[0] / distance, d[1] / distance, d[2] / distance))
    if best[0] <= bound[0] * (1.0 + ACROSS):  # as exact, and with the normal of a face or of two edges
        return bound[0], best[1], bound[2]
    return best


@inner
def _edge(solid, i):
    """Return where an edge begins, and the vector to its end; a point has an edge of no length."""
    if len(solid[2]) == 0:
        return _vector(solid[0][0]), (0.0, 0.0, 0.0)
    p = _vector(solid[0][solid[2][i, 0]])
    return p, _less(_vector(solid[0][solid[2][i, 1]]), p)


@inner
def _nearest_on(p, u, q, v):
    """Return where on two edges their nearest points are, 0 to 1; the second one has a length."""
    w, uu, vv, uv = _less(p, q), dot(u, u), dot(v, v), dot(u, v)
    uw, vw = dot(u, w), dot(v, w)
    c = vector_product(u, v)
    sine, s = dot(c, c), 0.0
    if sine > ACROSS * uu * vv:
        s = min(max((uv * vw - vv * uw) / sine, 0.0), 1.0)
    t = min(max((uv * s + vw) / vv, 0.0), 1.0)
    if uu > 0.0:
        s = min(max((uv * t - uw) / uu, 0.0), 1.0)
        t = min(max((uv * s + vw) / vv, 0.0), 1.0)
    return s, t


# What a face has in common with what lies on it.


@not_inlined
def _common(hulls, flat, lying, face):
    """Return whether a face or an edge lies almost flat on a face, and how many corners both have in common.

    The corners are in the last result, one of two buffers.
    """
    n, polygon = _vector(flat[1][face]), hulls.polygon
    best, facing = -1, ALIGNED
    for k in range(len(lying[1])):
        if -dot(n, _vector(lying[1][k])) >= facing:
            best, facing = k, -dot(n, _vector(lying[1][k]))
    count = 0
    if best >= 0:
        ring = lying[3][best]
        for k in range(ring[0], ring[1]):
            for m in range(3):
                polygon[0, count, m] = lying[0][hulls.corner[k], m]
            count += 1
    else:
        _, lowest = _over(flat[1][face], lying[0])
        slant = SLANT
        for k in range(len(lying[2])):
            if lowest in (lying[2][k, 0], lying[2][k, 1]):
                p, u = _edge(lying, k)
                rise = abs(dot(n, u)) / np.sqrt(dot(u, u))
                if rise <= slant:
                    slant, count = rise, 2
                    for m in range(3):
                        polygon[0, 0, m], polygon[0, 1, m] = p[m], p[m] + u[m]
    if count == 0:
        return False, 0, 0
    ring, buffer = flat[3][face], 0
    before = ring[1] - 1
    for k in range(ring[0], ring[1]):
        start = _vector(flat[0][hulls.corner[before]])
        inwards = vector_product(n, _less(_vector(flat[0][hulls.corner[k]]), start))
        count = _clipped(polygon[buffer], count, start, inwards, polygon[1 - buffer])
        buffer, before = 1 - buffer, k
    return True, count, buffer


@inner
def _clipped(corners, count, start, inwards, out):
    """Write the part of a polygon on the inner side of a plane; return the number of its corners."""
    kept = 0
    for k in range(count):
        p, q = _vector(corners[k]), _vector(corners[(k + 1) % count])
        here, there = dot(inwards, _less(p, start)), dot(inwards, _less(q, start))
        if here >= 0.0:
            for m in range(3):
                out[kept, m] = p[m]
            kept += 1
        if (here < 0.0 < there) or (there < 0.0 < here):
            share = here / (here - there)
            for m in range(3):
                out[kept, m] = p[m] + share * (q[m] - p[m])
            kept += 1
    return kept


@inner
def _on_other(p, height, n, own):
    """Return the point of side b below a point of what lies on a face."""
    return _along(p, n, -height) if own else p


@inner
def _lowest(hulls, flat, of_face, corners):
    """Return gap and point on side b of the deepest corner that a face and what lies on it have in common."""
    (face, own), (count, buffer) = of_face, corners
    n, lowest, at = _vector(flat[1][face]), np.inf, (0.0, 0.0, 0.0)
    for k in range(count):
        p = _vector(hulls.polygon[buffer, k])
        height = dot(n, p) - flat[1][face, 3]
        if height < lowest:
            lowest, at = height, _on_other(p, height, n, own)
    return lowest, at


@not_inlined
def _farthest(hulls, flat, of_face, corners, number):
    """Return height and point on side b of the corner that is farthest in one of eight directions."""
    (face, own), (count, buffer) = of_face, corners
    n, ring = _vector(flat[1][face]), flat[3][face]
    X = (0.0, n[2], -n[1]) if abs(n[0]) < STEEP else (-n[2], 0.0, n[0])
    if ring[1] > ring[0]:
        X = _less(_vector(flat[0][hulls.corner[ring[0] + 1]]), _vector(flat[0][hulls.corner[ring[0]]]))
    Y = vector_product(n, X)
    angle = TURNED + 0.25 * np.pi * (number - 1)
    c, s = np.cos(angle), np.sin(angle)
    way = (c * X[0] + s * Y[0], c * X[1] + s * Y[1], c * X[2] + s * Y[2])
    far, at = -np.inf, (0.0, 0.0, 0.0)
    for k in range(count):
        p = _vector(hulls.polygon[buffer, k])
        if dot(way, p) > far:
            far, at = dot(way, p), p
    height = dot(n, at) - flat[1][face, 3]
    return height, _on_other(at, height, n, own)

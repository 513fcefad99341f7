"""Signed distances of solids: made from a profile, turned about an axis or extruded along it, and simple ones.

A profile is a closed curve of lines and arcs in a plane (u, v). For a turned solid u is the distance from the axis and
v the height along it; pieces of the profile on the axis are omitted, because they are not surfaces. For an extruded
solid u and v are the two directions perpendicular to its axis. Each piece is a row, with the material on its left:

=======  ===========================================================================================
columns  meaning
=======  ===========================================================================================
0:4      start (0:2) and end (2:4)
4:7      a circle around the piece: centre (4:6), radius (6); for a line its middle and half its length
7        0 for a line; radius of an arc, negative if the arc turns right (hollow)
8:10     a line's direction; an arc's centre
10:12    direction from an arc's centre to its middle
12       tangent of a quarter of the angle that an arc spans
13:17    outward directions bisecting the normals that meet at the start (13:15) and at the end (15:17)
17:19    at the start and at the end: 1 a convex corner, -1 a hollow one, 0 a smooth joint
=======  ===========================================================================================

The distance is that of the nearest piece. Its sign is that of the nearest point: the side of the line or arc on which
the point lies, or at a corner, the side of the line perpendicular to the bisecting direction. Distances are exact
inside and outside, so they change by no more than a point moves; at a convex corner the gradient points away from it.

Other solids are given in their own axes (the first and second are perpendicular to the axis z).

A cylinder, a bore and a round plate are a *section* turned about the axis: a rectangle in the half plane of distance
rho from the axis and height z, ``b[9] <= rho <= b[10]``, ``b[11] <= z <= b[12]``, with infinite bounds where there is
no edge. A ball is a section of the distance from its centre. A rectangular plate is a box: ``|x| <= b[9]``, ``|y| <=
b[10]``, ``b[11] <= z <= b[12]``. All distances are exact, inside and outside: their gradient has length 1, so no gap
changes faster than the features move, and a point that leaves a face moves around its edge to the side.
"""

import math

import numpy as np

from engine.jit import inner, not_inlined
from engine.kernels.contact_geometry.patches import surface_distance
from engine.kernels.model import ON_EXTRUDED, ON_RECTANGLE, ON_SURFACE, ON_TURNED
from engine.kernels.vectors import CENTRED, NOWHERE


@inner
def piece_distance(piece, u, v):
    """Return the distance of (u, v) from a piece, and its nearest end: -1.0 the start, 1.0 the end, 0.0 neither."""
    if piece[7] == 0.0:
        u0, v0 = u - piece[4], v - piece[5]
        along = u0 * piece[8] + v0 * piece[9]
        if abs(along) <= piece[6]:
            return abs(u0 * piece[9] - v0 * piece[8]), 0.0
        end = math.copysign(1.0, along)
    else:
        u0, v0 = u - piece[8], v - piece[9]
        rho = math.hypot(u0, v0)
        along, across = u0 * piece[10] + v0 * piece[11], piece[10] * v0 - piece[11] * u0
        if abs(across) <= piece[12] * (rho + along):
            return abs(rho - abs(piece[7])), 0.0
        end = math.copysign(1.0, across * piece[7])
    if end < 0.0:
        return math.hypot(u - piece[0], v - piece[1]), end
    return math.hypot(u - piece[2], v - piece[3]), end


@not_inlined
def nearest_piece(pieces, u, v):
    """Return the number of the piece nearest to (u, v), its distance, and which end is nearest."""
    nearest, best, end = 0, np.inf, 0.0
    for j in range(pieces.shape[0]):
        piece = pieces[j]
        u0, v0, reach = u - piece[4], v - piece[5], best + piece[6]
        if u0 * u0 + v0 * v0 < reach * reach:
            distance, at = piece_distance(piece, u, v)
            if distance < best:
                nearest, best, end = j, distance, at
    return nearest, best, end


@not_inlined
def profile_distance(pieces, u, v):
    """Return the signed distance of (u, v) from a profile, and its derivatives with respect to u and v."""
    nearest, distance, end = nearest_piece(pieces, u, v)
    piece = pieces[nearest]
    if end != 0.0:
        u0, v0, n_u, n_v = u - piece[2], v - piece[3], piece[15], piece[16]
        if end < 0.0:
            u0, v0, n_u, n_v = u - piece[0], v - piece[1], piece[13], piece[14]
        if distance <= NOWHERE:
            return 0.0, n_u, n_v
        side = math.copysign(1.0, u0 * n_u + v0 * n_v)
        return side * distance, side * u0 / distance, side * v0 / distance
    if piece[7] == 0.0:
        n_u, n_v = piece[9], -piece[8]
        return (u - piece[4]) * n_u + (v - piece[5]) * n_v, n_u, n_v
    u0, v0, outward = u - piece[8], v - piece[9], math.copysign(1.0, piece[7])
    rho = math.hypot(u0, v0)
    if rho <= NOWHERE:
        return -outward * abs(piece[7]), outward * piece[10], outward * piece[11]
    return outward * (rho - abs(piece[7])), outward * u0 / rho, outward * v0 / rho


@not_inlined
def is_alone(pieces, u, v, margin):
    """Return whether no other piece becomes relevant within half the margin of (u, v).

    A neighbour of the nearest piece does not count as another piece if the distance has no kink between the two:
    outside a convex or smooth joint, and inside a hollow or smooth one.
    """
    nearest, distance, _ = nearest_piece(pieces, u, v)
    signed, _, _ = profile_distance(pieces, u, v)
    piece, side = pieces[nearest], math.copysign(1.0, signed)
    for j in range(pieces.shape[0]):
        other, reach = pieces[j], distance + margin + pieces[j, 6]
        u0, v0 = u - other[4], v - other[5]
        if j == nearest or u0 * u0 + v0 * v0 >= reach * reach:
            continue
        follows = other[0] == piece[2] and other[1] == piece[3] and side * piece[18] >= 0.0
        precedes = other[2] == piece[0] and other[3] == piece[1] and side * piece[17] >= 0.0
        if not (follows or precedes) and piece_distance(other, u, v)[0] < distance + margin:
            return False
    return True


@not_inlined
def turned(pieces, x, y, z):
    """Return the signed distance of a point from a turned solid, given in the solid's axes, and the gradient."""
    rho = math.hypot(x, y)
    d, n_rho, n_z = profile_distance(pieces, rho, z)
    if rho <= max(CENTRED * abs(d), NOWHERE):  # on the axis every direction is a nearest one
        return d, (n_rho, 0.0, n_z)
    return d, (n_rho * x / rho, n_rho * y / rho, n_z)


@not_inlined
def extruded(b, pieces, x, y, z):
    """Return the signed distance of a point from an extruded solid of half length ``b[9]``, and the gradient."""
    d, n_x, n_y = profile_distance(pieces, x, y)
    over, side = abs(z) - b[9], math.copysign(1.0, z)
    if d > 0.0 and over > 0.0:
        distance = math.hypot(d, over)
        return distance, (n_x * d / distance, n_y * d / distance, side * over / distance)
    if d >= over:
        return d, (n_x, n_y, 0.0)
    return over, (0.0, 0.0, side)


@inner
def section(b, rho, z):
    """Return the signed distance of (rho, z) from the section, and its derivatives with respect to rho and z."""
    u, u_rho = rho - b[10], 1.0
    if b[9] - rho > u:
        u, u_rho = b[9] - rho, -1.0
    w, w_z = z - b[12], 1.0
    if b[11] - z > w:
        w, w_z = b[11] - z, -1.0
    if u > 0.0 and w > 0.0:
        d = math.hypot(u, w)
        return d, u_rho * u / d, w_z * w / d
    if u >= w:
        return u, u_rho, 0.0
    return w, 0.0, w_z


@inner
def box(b, x, y, z):
    """Return the signed distance of (x, y, z) from the box, and its gradient."""
    u, v = abs(x) - b[9], abs(y) - b[10]
    w, w_z = z - b[12], 1.0
    if b[11] - z > w:
        w, w_z = b[11] - z, -1.0
    u_x, v_y = math.copysign(1.0, x), math.copysign(1.0, y)
    if max(u, v, w) <= 0.0:
        if w >= u and w >= v:
            return w, (0.0, 0.0, w_z)
        if u >= v:
            return u, (u_x, 0.0, 0.0)
        return v, (0.0, v_y, 0.0)
    u, v, w = max(u, 0.0), max(v, 0.0), max(w, 0.0)
    d = math.hypot(math.hypot(u, v), w)
    return d, (u_x * u / d, v_y * v / d, w_z * w / d)


@inner
def signed_distance(solid, x, y, z):
    """Return the signed distance of a point from a solid, and its gradient, in the solid's own axes.

    ``solid`` holds the kind of the pair, the geometry row of side b, the pieces of its profile, if any, and its surface
    as in `patches.surface_distance`.
    """
    kind, b, pieces, surface = solid
    if kind == ON_RECTANGLE:
        return box(b, x, y, z)
    if kind == ON_TURNED:
        return turned(pieces, x, y, z)
    if kind == ON_EXTRUDED:
        return extruded(b, pieces, x, y, z)
    if kind == ON_SURFACE:
        return surface_distance(surface, x, y, z)
    rho = math.hypot(x, y)
    d, d_rho, d_z = section(b, rho, z)
    if rho == 0.0:
        return d, (d_rho, 0.0, d_z)
    return d, (d_rho * x / rho, d_rho * y / rho, d_z)

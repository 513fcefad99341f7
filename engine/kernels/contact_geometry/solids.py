"""Signed distances of solids in their own axes (the first and second are perpendicular to the axis z).

A cylinder, a bore and a round plate are a *section* turned about the axis: a rectangle in the half plane of distance
rho from the axis and height z, ``b[9] <= rho <= b[10]``, ``b[11] <= z <= b[12]``, with infinite bounds where there is
no edge. A ball is a section of the distance from its centre. A rectangular plate is a box: ``|x| <= b[9]``, ``|y| <=
b[10]``, ``b[11] <= z <= b[12]``. All distances are exact, inside and outside: their gradient has length 1, so no gap
changes faster than the features move, and a point that leaves a face moves around its edge to the side.
"""

import math

from engine.jit import inner
from engine.kernels.contact_geometry.patches import surface_distance
from engine.kernels.contact_geometry.profiles import extruded, turned
from engine.kernels.model import ON_EXTRUDED, ON_RECTANGLE, ON_SURFACE, ON_TURNED


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
    as in `patched_surfaces.surface_distance`.
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

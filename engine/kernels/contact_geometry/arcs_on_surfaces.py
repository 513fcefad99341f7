"""Contacts of points, spheres and arcs with surfaces of bicubic patches.

Along an arc the distance changes by no more than its radius times the angle. A search from one end to the other skips
intervals that cannot contain a smaller distance than the least one found so far. Elsewhere it proceeds in cells, which
are narrower where distances and slopes are inconsistent, and finds the minimum in each cell whose slopes bracket one.
"""

import numpy as np

from engine.jit import inner, not_inlined
from engine.kernels.contact_geometry.arcs import CELL, FLAT, SMALLEST, UNEVEN, distance_along, normal_at, stationary
from engine.kernels.contact_geometry.patched_surfaces import surface_distance
from engine.kernels.contact_geometry.tangents import cross, transport
from engine.kernels.model import ON_SURFACE
from engine.kernels.vectors import body_components, vector_product, world_direction, world_point

SAMPLES = 9  # number of samples of an arc before the search


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

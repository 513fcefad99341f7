"""Signed gaps and local frames of contact pairs (paper, sections 2.1 and 3.1).

The kind of a pair and its geometry rows, given from the centre of mass in body axes:

==============  ===================================================================================
kind            side b
==============  ===================================================================================
RING_BORE       journal: axis point (0:3), axis (3:6), tangent (6:9), radius (9); a is a ring's centre
POINT_PLANE     plane: point (0:3), normal to the free side (3:6), tangent (6:9)
ARC_PLANE       the same; a is an arc
CYLINDER_PLANE  the same; a is a cylinder, represented by its circle at mid-height
ON_ROUND        cylinder or bore: axis point (0:3), axis (3:6), tangent (6:9), section (9:13)
ON_DISC         plate: centre of its face (0:3), normal (3:6), tangent (6:9), section (9:13)
ON_RECTANGLE    plate: the same; half sides along tangent and normal x tangent (9:11), bottom and top (11:13)
ON_BALL         sphere or socket: centre (0:3), two directions that fix T1 (3:6, 6:9), section (9:13)
ON_TURNED       a profile turned about an axis: axis point (0:3), axis (3:6), tangent (6:9)
ON_EXTRUDED     a profile extruded along an axis: its origin (0:3), axis (3:6), u (6:9), half length (9)
ROUNDS          a straight line: middle (0:3), direction (3:6), tangent (6:9), radius (9), half length (10)
BOXES           a box: middle (0:3), third axis (3:6), first axis (6:9), half sides (9:12)
HULLS           nothing: its convex polyhedron is in ``contacts.hulls``
GEARS           gear or ring: point of its axis (0:3), axis (3:6), mark (6:9), base radius, < 0 for a ring (9)
COUPLED         nothing: its terms are in ``contacts.terms``, see `kernels.couplings`
ON_SURFACE      bicubic patches, in ``surfaces``: a place (0:3), two directions that fix T1 (3:6, 6:9)
JOINT_FRICTION  axis of an ideal joint: point (0:3), direction (3:6), a rotation (1) or displacement (0) (9)
ONE_WAY         the same; the direction in which the joint may move, 1 or -1 (10)
ROLLING         nothing: it has the axes of its contact's tangents, see `kernels.rolling`
SPINNING        the same of its contact's normal
==============  ===================================================================================

Side a: point, centre of an arc, or axis point of a cylinder (0:3); then normal or axis (3:6), middle or tangent
(6:9), radius (9), half angle (10); of GEARS, mark (3:6), base radius (9), base pitch (10); of ROUNDS and BOXES, as side
b, with the number of a feature (12), and of ROUNDS a depth (11); of HULLS a middle,
radius (9), both sizes (11) and feature (12). For the solids (seven kinds) a point is an arc of
radius 0. One of the outline of a profile has the direction out of its material (3:6), a depth (11), > 0, and the cosine
of an angle (12): on the other profile, or no deeper in it, it presses only against a face that is opposite to such a
direction to within this angle. Otherwise it would catch where a corner slides past another. Then the frame is zero, and
the gap larger by this depth. The same holds for the rim of a cylinder that has a depth, see `rounds.rim_passes_by`.

The gap g_N is the signed distance plus ``clearance`` (for a ring: the radial clearance minus its eccentricity; the
radii of spheres and rounded edges are skins and are subtracted there). It changes by no more than the features move
relative to each other. N points from b to a: a positive impulse r_N pushes a along +N. T1 is tied to body b (its axis,
or a tangent of its plane), so a frame never flips. The force acts on both bodies at one common point on b's surface,
which keeps the balance of moments exact.
"""

import numpy as np

from engine.jit import inner, kernel, not_inlined
from engine.kernels.contact_geometry.arcs import nearest_on_arc
from engine.kernels.contact_geometry.arcs_on_solids import on_profile, on_surface, pass_by
from engine.kernels.contact_geometry.boxes import of_boxes
from engine.kernels.contact_geometry.gears import on_flank
from engine.kernels.contact_geometry.hulls import hulls_apart, of_hulls
from engine.kernels.contact_geometry.rounds import beside, rim_passes_by
from engine.kernels.contact_geometry.solids import box, section
from engine.kernels.couplings import coupled_gap
from engine.kernels.grain import lay_along_grain, lengths
from engine.kernels.model import (
    ARC_PLANE,
    BOXES,
    COUPLED,
    CYLINDER_PLANE,
    GEARS,
    HULLS,
    ON_BALL,
    ON_EXTRUDED,
    ON_RECTANGLE,
    ON_ROUND,
    ON_SURFACE,
    ON_TURNED,
    ONE_WAY,
    RING_BORE,
    ROLLING,
    ROUNDS,
)
from engine.kernels.vectors import (
    CENTRED,
    NOWHERE,
    cross,
    dot,
    split,
    to_world,
    transport,
    turn_to_world,
    vector_product,
    world_direction,
    world_point,
)

NEARLY = 1e-4  # if less than this share of a vector is perpendicular to an axis, rounding is removed once more


@kernel
def find_contacts(contacts, x, R, gap, point, frame):
    """Write the gap, point and local frame of each contact at the pose (x, R).

    Gaps are negative where bodies penetrate each other; points and the rows N, T1, T2 of frames are in world axes.
    """
    for i in range(gap.shape[0]):
        gap[i] = find_contact(contacts, x, R, i, point, frame)


@inner
def find_contact(contacts, x, R, i, point, frame):
    """Write contact i's point and frame at the pose (x, R); return its gap."""
    gap = _touching(contacts, x, R, i, point, frame)
    if contacts.grain.shape[0] > 0:
        lay_along_grain(contacts, R, i, frame[i])
    return gap


@inner
def _touching(contacts, x, R, i, point, frame):
    """Write contact i's point, and its frame without a grain; return its gap."""
    kind = contacts.kind[i]
    if kind == RING_BORE:
        return ring_in_bore(contacts, x, R, i, point[i], frame[i])
    if kind <= CYLINDER_PLANE:
        return on_plane(contacts, x, R, i, kind, point[i], frame[i])
    if kind in (ON_TURNED, ON_EXTRUDED):
        return on_profile(contacts, x, R, i, kind, point[i], frame[i])
    if kind == ON_SURFACE:
        return on_surface(contacts, x, R, i, point[i], frame[i])
    if kind == GEARS:
        return on_flank(contacts, x, R, i, point[i], frame[i])
    if kind == ROUNDS:
        return beside(contacts, x, R, i, point[i], frame[i])
    if kind == BOXES:
        return of_boxes(contacts, x, R, i, point[i], frame[i])
    if kind == HULLS:
        return on_hull(contacts.hulls, contacts, x, R, i, point[i], frame[i])
    if kind >= ROLLING:
        return about_contact(contacts, i, kind, point, frame)
    if kind >= COUPLED:
        return of_joints(contacts, x, R, i, kind, point[i], frame[i])
    gap = on_solid(contacts, x, R, i, kind, point[i], frame[i])
    depth = contacts.geometry_a[i, 11]
    if depth > 0.0 and rim_passes_by(contacts, x, R, i, gap, point[i], frame[i]):
        return pass_by(world_point(x, R, contacts.a[i], contacts.geometry_a[i]), point[i], frame[i], abs(gap) + depth)
    return gap


@inner
def on_hull(hulls, contacts, x, R, i, point, frame):
    """Find the contact of two convex polyhedra; without any, none of it is compiled."""
    if hulls is None:
        return np.inf
    return of_hulls(contacts, x, R, i, point, frame)


@inner
def hull_budget(hulls, contacts, x, R, i):
    """Return a lower bound of the distance of two convex polyhedra; without any, none of it is compiled."""
    if hulls is None:
        return np.inf
    return hulls_apart(contacts, x, R, i)


@not_inlined
def about_contact(contacts, i, kind, point, frame):
    """Write point and axes of what resists rolling or spinning: those of its contact, which comes before it."""
    p = contacts.partner[i]
    first, second = lengths(contacts, p)
    for k in range(3):
        point[i, k] = point[p, k]
        frame[i, 0, k] = frame[i, 2, k] = 0.0
        frame[i, 1, k] = frame[p, 0, k]
        if kind == ROLLING:
            frame[i, 1, k], frame[i, 2, k] = frame[p, 1, k] / first, frame[p, 2, k] / second
    return 0.0


@inner
def passes_by(contacts, frame, i):
    """Return whether contact i is one of an outline that cannot press in this pose, see the table above."""
    if not contacts.geometry_a[i, 11] > 0.0:
        return False
    N = frame[i, 0]
    return N[0] == 0.0 and N[1] == 0.0 and N[2] == 0.0


@inner
def ring_in_bore(contacts, x, R, i, point, frame):
    """Find a ring of the bearing around the journal's cylinder: g = c - e; the force acts on the journal's surface."""
    a, b = contacts.a[i], contacts.b[i]
    ga, gb = contacts.geometry_a[i], contacts.geometry_b[i]
    axis = frame[1]
    to_world(x, R, a, ga, 0, point)
    to_world(x, R, b, gb, 0, frame[0])
    turn_to_world(R, b, gb, 3, axis)
    w0, w1, w2 = point[0] - frame[0, 0], point[1] - frame[0, 1], point[2] - frame[0, 2]
    along = w0 * axis[0] + w1 * axis[1] + w2 * axis[2]
    w0, w1, w2 = w0 - along * axis[0], w1 - along * axis[1], w2 - along * axis[2]
    eccentricity = np.sqrt(w0 * w0 + w1 * w1 + w2 * w2)
    if eccentricity < NEARLY * abs(along):  # a rounding error along the axis would tilt the frame
        rest = w0 * axis[0] + w1 * axis[1] + w2 * axis[2]
        w0, w1, w2 = w0 - rest * axis[0], w1 - rest * axis[1], w2 - rest * axis[2]
        eccentricity = np.sqrt(w0 * w0 + w1 * w1 + w2 * w2)
    for k in range(3):
        point[k] = frame[0, k] + along * axis[k]
    if eccentricity > CENTRED * gb[9]:
        frame[0, 0], frame[0, 1], frame[0, 2] = -w0 / eccentricity, -w1 / eccentricity, -w2 / eccentricity
    else:  # concentric: every direction is a nearest one; take one tied to the journal
        turn_to_world(R, b, gb, 6, frame[0])
    for k in range(3):
        point[k] += gb[9] * frame[0, k]
    cross(frame[0], axis, frame[2])
    return contacts.clearance[i] - eccentricity


@inner
def on_plane(contacts, x, R, i, kind, point, frame):
    """Find the lowest point of a point, an arc or a cylinder over a plane: g = (point - plane) . n."""
    a, b = contacts.a[i], contacts.b[i]
    ga, gb = contacts.geometry_a[i], contacts.geometry_b[i]
    n = frame[0]
    turn_to_world(R, b, gb, 3, n)
    to_world(x, R, a, ga, 0, point)
    if kind == ARC_PLANE:
        e, f = frame[1], frame[2]
        turn_to_world(R, a, ga, 3, f)
        turn_to_world(R, a, ga, 6, e)
        f0, f1, f2 = f[1] * e[2] - f[2] * e[1], f[2] * e[0] - f[0] * e[2], f[0] * e[1] - f[1] * e[0]
        down_e = -(n[0] * e[0] + n[1] * e[1] + n[2] * e[2])
        down_f = -(n[0] * f0 + n[1] * f1 + n[2] * f2)
        lies = down_e * down_e + down_f * down_f <= CENTRED * CENTRED  # all of it at the same height: take its middle
        angle = 0.0 if lies else min(max(np.arctan2(down_f, down_e), -ga[10]), ga[10])
        ce, sf = ga[9] * np.cos(angle), ga[9] * np.sin(angle)
        point[0] += ce * e[0] + sf * f0
        point[1] += ce * e[1] + sf * f1
        point[2] += ce * e[2] + sf * f2
    elif kind == CYLINDER_PLANE:
        axis = frame[1]
        turn_to_world(R, a, ga, 3, axis)
        along = n[0] * axis[0] + n[1] * axis[1] + n[2] * axis[2]
        k0, k1, k2 = n[0] - along * axis[0], n[1] - along * axis[1], n[2] - along * axis[2]
        across = np.sqrt(k0 * k0 + k1 * k1 + k2 * k2)
        if across < NEARLY:  # a rounding error along the axis would be scaled by the radius
            rest = k0 * axis[0] + k1 * axis[1] + k2 * axis[2]
            k0, k1, k2 = k0 - rest * axis[0], k1 - rest * axis[1], k2 - rest * axis[2]
            across = np.sqrt(k0 * k0 + k1 * k1 + k2 * k2)
        if across <= CENTRED:  # upright: the whole circle is at the same height; take the point at its tangent
            turn_to_world(R, a, ga, 6, axis)
            k0, k1, k2, across = axis[0], axis[1], axis[2], 1.0
        down = ga[9] / across
        point[0] -= down * k0
        point[1] -= down * k1
        point[2] -= down * k2
    plane = frame[1]
    to_world(x, R, b, gb, 0, plane)
    distance = (point[0] - plane[0]) * n[0] + (point[1] - plane[1]) * n[1] + (point[2] - plane[2]) * n[2]
    for k in range(3):
        point[k] -= distance * n[k]
    turn_to_world(R, b, gb, 6, frame[1])
    cross(n, frame[1], frame[2])
    return distance + contacts.clearance[i]


@not_inlined
def of_joints(contacts, x, R, i, kind, point, frame):
    """Write the direction in which an ideal joint moves into T1, or for a ONE_WAY into N; the other two are zero.

    For a rotation the point lies at a radius of 1 from the axis, so that the number of the force is that of the torque.
    The gap is always 0: what the direction of a joint meets does not depend on where it is. That of a coupling does; it
    acts on its bodies in directions of their own.
    """
    b, gb = contacts.b[i], contacts.geometry_b[i]
    turns, way = gb[9] > 0.0, frame[1]
    to_world(x, R, contacts.a[i], contacts.geometry_a[i], 0, point)
    if kind == COUPLED:
        for k in range(3):
            frame[0, k], frame[1, k], frame[2, k] = 0.0, 0.0, 0.0
        return coupled_gap(contacts, x, R, i)
    turn_to_world(R, b, gb, 3, way)
    if turns:
        to_world(x, R, b, gb, 0, frame[0])
        n, d = (way[0], way[1], way[2]), (point[0] - frame[0, 0], point[1] - frame[0, 1], point[2] - frame[0, 2])
        f = vector_product(n, d)
        length = np.sqrt(dot(f, f))
        way[0], way[1], way[2] = f[0] / length, f[1] / length, f[2] / length
    for k in range(3):
        frame[0, k], frame[2, k] = 0.0, 0.0
        if kind == ONE_WAY:
            frame[0, k], way[k] = gb[10] * way[k], 0.0
    return 0.0


@inner
def on_solid(contacts, x, R, i, kind, point, frame):
    """Find the point of an arc that is nearest to a solid; the gap is the solid's signed distance at this point."""
    a, b = contacts.a[i], contacts.b[i]
    ga, gb = contacts.geometry_a[i], contacts.geometry_b[i]
    r, e, z, t = ga[9], world_direction(R, a, ga, 6), world_direction(R, b, gb, 3), world_direction(R, b, gb, 6)
    f = vector_product(world_direction(R, a, ga, 3), e)
    centre, foot = world_point(x, R, a, ga), world_point(x, R, b, gb)
    w = (centre[0] - foot[0], centre[1] - foot[1], centre[2] - foot[2])
    # the arc is w + r (cos e + sin f), split into parts along and across the solid's axis; all across if it has none
    axis = (0.0, 0.0, 0.0) if kind == ON_BALL else z
    ew, W = split(w, axis)
    ee, E = split(e, axis)
    fe, F = split(f, axis)
    y = vector_product(z, t)
    c, s, searched, normal = 0.0, 0.0, False, z
    if r > 0.0:
        solid = (kind, gb, contacts.piece, (contacts.surfaces, contacts.surface[i]))
        angle, searched, normal = nearest_on_arc(solid, r, ga[10], (W, E, F), (ew, ee, fe), (t, y))
        c, s = r * np.cos(angle), r * np.sin(angle)
    D = (W[0] + c * E[0] + s * F[0], W[1] + c * E[1] + s * F[1], W[2] + c * E[2] + s * F[2])
    height, outward = ew + c * ee + s * fe, -1.0 if gb[9] > 0.0 else 1.0
    if kind == ON_RECTANGLE:
        gap, n = box(gb, dot(D, t), dot(D, y), height)
        n = normal if searched else n
        D = (n[0] * t[0] + n[1] * y[0], n[0] * t[1] + n[1] * y[1], n[0] * t[2] + n[1] * y[2])
        rho, n_rho, n_z = 1.0, 1.0, n[2]
    else:
        if dot(D, D) < NEARLY**2 * (dot(w, w) + r * r):  # a rounding error along the axis would tilt the frame
            D = split(D, axis)[1]
        rho = np.sqrt(dot(D, D))
        gap, n_rho, n_z = section(gb, rho, height)
        if searched:
            n_rho, n_z = outward * np.sqrt(max(1.0 - normal[2] ** 2, 0.0)), normal[2]
        if rho <= max(CENTRED * abs(gap), NOWHERE):  # on the axis every direction is a nearest one: take the solid's
            D, rho = t, 1.0
    N, T1 = frame[0], frame[1]
    for k in range(3):
        N[k] = n_rho * D[k] / rho + n_z * z[k]
        point[k] = centre[k] + (c * e[k] + s * f[k] - gap * n_rho * D[k] / rho - gap * n_z * z[k])
    if kind == ON_ROUND:  # T1 along the axis; on the ends, along a radius
        for k in range(3):
            T1[k] = outward * (n_rho * z[k] - n_z * D[k] / rho)
    else:
        transport(z, t, N, T1)
    cross(N, T1, frame[2])
    return gap + contacts.clearance[i]

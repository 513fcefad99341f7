"""Signed gaps and local frames of contact pairs, in closed form (paper, sections 2.1 and 3.1).

Geometry rows, from the centre of mass in body axes:

====  ================  =================================================================================
kind  side a            side b
====  ================  =================================================================================
0     ring centre       journal: axis point (0:3), axis (3:6), radius (9)
1     point             plane: point (0:3), normal to the free side (3:6), tangent (6:9)
2     arc: centre (0:3), normal (3:6), middle (6:9), radius (9), half angle (10);  plane as above
3     cylinder: axis point (0:3), axis (3:6), radius (9);  plane as above
4     arc as above      cylinder: axis point (0:3), axis (3:6), radius (9)
====  ================  =================================================================================

The gap g_N is the signed distance plus ``clearance`` (for a ring: the radial clearance minus its eccentricity). N
points from b to a: a positive impulse r_N pushes a along +N. T1 is tied to body b (its axis, or a tangent of its
plane), so a frame never flips. Both bodies feel the force at one common point, which keeps the moment balance exact.
"""

import numpy as np

from engine.kernels.jit import kernel
from engine.kernels.model import ARC_CYLINDER, ARC_PLANE, CYLINDER_PLANE, RING_BORE
from engine.kernels.rotations import to_world, turn_to_world

NEWTON_STEPS = 8


@kernel
def find_contacts(contacts, x, R, gap, point, frame):
    """Write every contact's gap (nc,), point (nc, 3) and frame (nc, 3, 3) at the pose (x, R)."""
    for i in range(gap.shape[0]):
        gap[i] = find_contact(contacts, x, R, i, point, frame)


@kernel
def find_contact(contacts, x, R, i, point, frame):
    """Write contact i's point and frame at the pose (x, R); return its gap."""
    kind = contacts.kind[i]
    if kind == RING_BORE:
        return ring_in_bore(contacts, x, R, i, point[i], frame[i])
    if kind == ARC_CYLINDER:
        return arc_cylinder(contacts, x, R, i, point[i], frame[i])
    return on_plane(contacts, x, R, i, kind, point[i], frame[i])


@kernel
def ring_in_bore(contacts, x, R, i, point, frame):
    """Ring of the bearing around the journal's cylinder: g = c - e, the force acts on the journal's surface."""
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
    for k in range(3):
        point[k] = frame[0, k] + along * axis[k]
    if eccentricity > 0.0:
        frame[0, 0], frame[0, 1], frame[0, 2] = -w0 / eccentricity, -w1 / eccentricity, -w2 / eccentricity
    else:  # concentric: any direction is the nearest one; take one tied to the journal
        turn_to_world(R, b, gb, 6, frame[0])
    for k in range(3):
        point[k] += gb[9] * frame[0, k]
    cross(frame[0], axis, frame[2])
    return contacts.clearance[i] - eccentricity


@kernel
def on_plane(contacts, x, R, i, kind, point, frame):
    """Lowest point of a point, an arc or a cylinder over a plane: g = (point - plane) . n."""
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
        angle = min(max(np.arctan2(down_f, down_e), -ga[10]), ga[10])
        ce, sf = ga[9] * np.cos(angle), ga[9] * np.sin(angle)
        point[0] += ce * e[0] + sf * f0
        point[1] += ce * e[1] + sf * f1
        point[2] += ce * e[2] + sf * f2
    elif kind == CYLINDER_PLANE:
        axis = frame[1]
        turn_to_world(R, a, ga, 3, axis)
        along = n[0] * axis[0] + n[1] * axis[1] + n[2] * axis[2]
        k0, k1, k2 = n[0] - along * axis[0], n[1] - along * axis[1], n[2] - along * axis[2]
        down = ga[9] / np.sqrt(k0 * k0 + k1 * k1 + k2 * k2)
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


@kernel
def arc_cylinder(contacts, x, R, i, point, frame):
    """Arc outside a cylinder: the arc's point nearest to the cylinder's axis, by Newton's method on its angle."""
    a, b = contacts.a[i], contacts.b[i]
    ga, gb = contacts.geometry_a[i], contacts.geometry_b[i]
    axis, e, f = frame[1], frame[0], frame[2]
    to_world(x, R, a, ga, 0, point)
    turn_to_world(R, b, gb, 3, axis)
    turn_to_world(R, a, ga, 3, f)
    turn_to_world(R, a, ga, 6, e)
    f0, f1, f2 = f[1] * e[2] - f[2] * e[1], f[2] * e[0] - f[0] * e[2], f[0] * e[1] - f[1] * e[0]
    e0, e1, e2 = e[0], e[1], e[2]
    to_world(x, R, b, gb, 0, frame[0])
    w0, w1, w2 = point[0] - frame[0, 0], point[1] - frame[0, 1], point[2] - frame[0, 2]
    # all three vectors across the cylinder's axis: the distance is |w + r (cos E + sin F)|
    ew, ee = w0 * axis[0] + w1 * axis[1] + w2 * axis[2], e0 * axis[0] + e1 * axis[1] + e2 * axis[2]
    fe = f0 * axis[0] + f1 * axis[1] + f2 * axis[2]
    W0, W1, W2 = w0 - ew * axis[0], w1 - ew * axis[1], w2 - ew * axis[2]
    E0, E1, E2 = e0 - ee * axis[0], e1 - ee * axis[1], e2 - ee * axis[2]
    F0, F1, F2 = f0 - fe * axis[0], f1 - fe * axis[1], f2 - fe * axis[2]
    WE, WF = W0 * E0 + W1 * E1 + W2 * E2, W0 * F0 + W1 * F1 + W2 * F2
    EE, FF, EF = E0 * E0 + E1 * E1 + E2 * E2, F0 * F0 + F1 * F1 + F2 * F2, E0 * F0 + E1 * F1 + E2 * F2
    r = ga[9]
    angle = np.arctan2(-WF, -WE)
    for _ in range(NEWTON_STEPS):
        c, s = np.cos(angle), np.sin(angle)
        slope = -s * WE + c * WF + r * (s * c * (FF - EE) + (c * c - s * s) * EF)
        curve = -c * WE - s * WF + r * ((c * c - s * s) * (FF - EE) - 4 * s * c * EF)
        if curve <= 0.0 or abs(slope) <= 1e-15 * curve:
            break
        angle -= slope / curve
    angle = min(max(angle, -ga[10]), ga[10])
    c, s = r * np.cos(angle), r * np.sin(angle)
    D0, D1, D2 = W0 + c * E0 + s * F0, W1 + c * E1 + s * F1, W2 + c * E2 + s * F2
    distance = np.sqrt(D0 * D0 + D1 * D1 + D2 * D2)
    gap = distance - gb[9]
    point[0] += c * e0 + s * f0 - gap * D0 / distance
    point[1] += c * e1 + s * f1 - gap * D1 / distance
    point[2] += c * e2 + s * f2 - gap * D2 / distance
    frame[0, 0], frame[0, 1], frame[0, 2] = D0 / distance, D1 / distance, D2 / distance
    cross(frame[0], axis, frame[2])
    return gap + contacts.clearance[i]


@kernel
def cross(a, b, out):
    """Write the vector product of a and b."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]

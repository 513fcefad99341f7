"""Two spur gears with involute teeth, or a gear in a ring: the gap between flanks, and the line along which they press.

Involutes of the base radii a and b touch along the common tangent of the base circles, whatever the distance d of the
axes, which is inclined to their tangent by the pressure angle p, cos p = |a + b| / d; b is < 0 for a ring. With the
angles A, B of the gears from the line between the axes and inv p = tan p - p, the gap along that line is

    g = +-(a A + b B) + (a + b) inv p + constant

for the two flanks. Its gradient with respect to the poses is exactly the row of a contact at the pitch point along the
line of action. As teeth repeat, a A + b B counts modulo the base pitch: nothing is remembered between steps.
"""

import numpy as np

from engine.jit import not_inlined
from engine.kernels.vectors import cross, dot, split, vector_product, world_direction, world_point


@not_inlined
def on_flank(contacts, x, R, i, point, frame):
    """Write the pitch point of two gears, and a frame whose N is the line of action and T1 the axis; return the gap."""
    a, b = contacts.a[i], contacts.b[i]
    ga, gb = contacts.geometry_a[i], contacts.geometry_b[i]
    axis, first, second = world_direction(R, b, gb, 3), world_direction(R, a, ga, 3), world_direction(R, b, gb, 6)
    p, q = world_point(x, R, a, ga), world_point(x, R, b, gb)
    _, D = split((q[0] - p[0], q[1] - p[1], q[2] - p[2]), axis)
    distance = np.sqrt(dot(D, D))
    e = (D[0] / distance, D[1] / distance, D[2] / distance)
    t = vector_product(axis, e)
    radius, both = ga[9], ga[9] + gb[9]
    phase = radius * np.arctan2(dot(first, t), dot(first, e)) + gb[9] * np.arctan2(dot(second, t), dot(second, e))
    phase -= ga[10] * np.round(phase / ga[10])
    cosine = min(max(both / distance, -1.0), 1.0)  # of bodies nearer than their base circles: that these touch
    sine = np.sqrt(1.0 - cosine * cosine)
    flank, outward = contacts.flank[i], np.copysign(1.0, both)
    for k in range(3):
        point[k] = p[k] + distance * radius / both * e[k]
        frame[0, k] = flank * cosine * t[k] - outward * sine * e[k]
        frame[1, k] = axis[k]
    cross(frame[0], frame[1], frame[2])
    angle = np.arctan2(sine, abs(cosine))
    return contacts.clearance[i] + flank * phase + both * (sine / abs(cosine) - angle)

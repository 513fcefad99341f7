"""Pairs of parts that could be stops or latches: hooks, cams, rollers and balls before planes, grooves and cones."""

from math import cos, pi, sin

import numpy as np
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakeWire
from OCP.BRepPrimAPI import BRepPrimAPI_MakePrism, BRepPrimAPI_MakeSphere
from OCP.GC import GC_MakeArcOfCircle
from OCP.gp import gp_Pnt, gp_Vec

from tests.engine.cad.spline_shapes import elliptic_cam
from tests.engine.cad.step_files import Drawing, box, cone, cut, cylinder, fused, moved, place

BASE, NOSE, LIFT = 6.0, 3.0, 2.0  # radii of a cam's base circle and nose, and how far the nose is beyond the base
NOSE_AT = BASE + LIFT - NOSE  # centre of the nose
FLANK = np.array([BASE - NOSE, (NOSE_AT**2 - (BASE - NOSE) ** 2) ** 0.5]) / NOSE_AT  # normal of the upper tangent
THICK = 4.0
STEEL = ("steel", 7.85)


def prism(start, segments, height=THICK, z=0.0):
    """Return what is extruded from z on from a closed curve of ends, with the point in the middle of each arc."""
    wire, at = BRepBuilderAPI_MakeWire(), np.array(start, float)
    for end, *through in segments:
        points = [gp_Pnt(*point, z) for point in (at, *through, end)]
        curve = GC_MakeArcOfCircle(*points).Value() if through else None
        edge = BRepBuilderAPI_MakeEdge(curve) if through else BRepBuilderAPI_MakeEdge(*points)
        wire.Add(edge.Edge())
        at = np.array(end, float)
    return BRepPrimAPI_MakePrism(BRepBuilderAPI_MakeFace(wire.Wire(), True).Face(), gp_Vec(0, 0, height)).Shape()


def cam():
    """Return a disc cam about the z axis: base circle, nose towards x, and the two tangents between them."""
    upper, lower = BASE * FLANK, BASE * FLANK * [1, -1]
    nose = [np.array([NOSE_AT, 0.0]) + NOSE * FLANK * [1, way] for way in (1, -1)]
    return prism(lower, [(nose[1],), (nose[0], [NOSE_AT + NOSE, 0.0]), (upper,), (lower, [-BASE, 0.0])])


def finger(radius=0.5):
    """Return a hook: a finger along -y with a round tip, which ends at the origin."""
    top = 10.0
    return prism(
        [-radius, radius], [([radius, radius], [0.0, 0.0]), ([radius, top],), ([-radius, top],), ([-radius, radius],)]
    )


def ball(radius, x=0.0, y=0.0, z=0.0):
    """Return a ball on a stem that goes up."""
    whole = BRepPrimAPI_MakeSphere(gp_Pnt(x, y, z), radius).Shape()
    return fused(whole, cylinder((x, y, z), radius / 2, 4 * radius))


def drawing(pairs):
    """Return a drawing of pairs of parts, a frame and a mover each, so far apart that they do not see each other."""
    made = Drawing()
    top = made.assembly("stops")
    for i, (name, shapes) in enumerate(pairs.items()):
        for part, shape in zip(("frame", "mover"), shapes, strict=True):
            made.add(top, made.product(f"{name}-{part}", shape, STEEL), place(x=60.0 * i))
    return made


def hook_on_catch(gap):
    """Return a hook before the flat of a block."""
    return (box((-5.0, -3.0 - gap, -1.0), (10.0, 3.0, 8.0)), finger())


def hook_in_notch(gap):
    """Return a hook before a round notch, half as wide as it is long, in a block."""
    block = box((-8.0, -6.0, 0.0), (16.0, 6.0, THICK))
    return (cut(block, cylinder((0.0, 1.0, -1.0), 3.0, 8.0)), moved(finger(), y=-2.0 + gap))


def roller_on_cam(gap, angle=0.0):
    """Return a roller of radius 2 before a cam, in a direction from its centre at which the nose or the base lies."""
    reach = NOSE_AT * cos(angle) + NOSE if abs(angle) < 0.1 else BASE
    far = reach + gap + 2.0
    return (cam(), cylinder((far * cos(angle), far * sin(angle), -1.0), 2.0, 6.0))


def roller_on_flank(gap):
    """Return a roller before the straight flank of a cam, in the middle of it."""
    middle = (BASE * FLANK + [NOSE_AT, 0.0] + NOSE * FLANK) / 2
    x, y = middle + (gap + 2.0) * FLANK
    return (cam(), cylinder((x, y, -1.0), 2.0, 6.0))


def flat_on_cam(gap):
    """Return a flat follower above the base circle of a cam."""
    return (cam(), box((-4.0, BASE + gap, 0.0), (8.0, 5.0, THICK)))


def roller_on_ellipse(gap):
    """Return a roller before the longer end of an elliptic cam, which is a spline."""
    return (elliptic_cam(8.0, 5.0, THICK), cylinder((8.0 + gap + 2.0, 0.0, 0.0), 2.0, THICK))


def roller_on_plane(gap):
    """Return a roller above a block that is as wide."""
    return (box((-5.0, -4.0, 0.0), (10.0, 4.0, THICK)), cylinder((0.0, 3.0 + gap, 0.0), 3.0, THICK))


def ball_on_plane(gap):
    """Return a ball above a block."""
    return (box((-5.0, -5.0, -5.0), (10.0, 10.0, 5.0)), ball(2.0, z=2.0 + gap))


def ball_in_groove(gap):
    """Return a ball in a round groove along x of a block."""
    block = box((-5.0, -5.0, -6.0), (10.0, 10.0, 6.0))
    return (cut(block, cylinder((-6.0, 0.0, 1.0), 3.0, 12.0, (1.0, 0.0, 0.0))), ball(2.0, z=gap))


def ball_in_cone(gap):
    """Return a ball in the countersink of a block, 45 degrees wide to each side."""
    block = cut(box((-5.0, -5.0, -6.0), (10.0, 10.0, 6.0)), cone((0.0, 0.0, -2.5), (0.5, 3.0), 2.5))
    return (block, ball(2.0, z=-3.0 + 2**0.5 * (2.0 + gap)))


def ball_on_pin(gap):
    """Return a ball above a round pin along x."""
    return (cylinder((-5.0, 0.0, -3.0), 3.0, 10.0, (1.0, 0.0, 0.0)), ball(2.0, z=2.0 + gap))


def ball_in_dish(gap):
    """Return a ball in a hollow ball that is a third as deep as a half one."""
    block = box((-5.0, -5.0, -6.0), (10.0, 10.0, 6.0))
    return (cut(block, BRepPrimAPI_MakeSphere(gp_Pnt(0.0, 0.0, 3.0), 5.0).Shape()), ball(2.0, z=gap))


def rounded_block():
    """Return a block with rounded upright edges before a wall: only their flats face each other."""
    r, s = 1.0, 1.0 - cos(pi / 4)
    block = prism(
        [-4.0, 0.0],
        [([4.0, 0.0],), ([4.0 + r, r], [4.0 + r - r * s, r * s]), ([4.0 + r, 6.0],), ([-4.0, 6.0],), ([-4.0, 0.0],)],
    )
    return (box((-20.0, -5.5, 0.0), (40.0, 5.0, THICK)), block)


def pin_in_loose_hole():
    """Return a pin in a hole that is 0.5 mm larger in radius, off its axis."""
    plate = cut(box((-10.0, -10.0, 0.0), (20.0, 20.0, 5.0)), cylinder((0.0, 0.0, -1.0), 3.5, 7.0))
    return (plate, cylinder((0.2, 0.0, -1.0), 3.0, 7.0))


def crossed_pins():
    """Return two round pins across each other."""
    return (
        cylinder((-5.0, 0.0, -3.5), 3.0, 10.0, (1.0, 0.0, 0.0)),
        cylinder((0.0, -5.0, 2.0), 2.0, 10.0, (0.0, 1.0, 0.0)),
    )


def overlapping_corners():
    """Return two blocks whose faces share a strip of 0.02 mm by 4 mm."""
    return (box((0.0, 0.0, 0.0), (10.0, 10.0, 4.0)), box((10.4, 9.98, 0.0), (5.0, 10.0, 4.0)))


TRUE = {
    "hook": (hook_on_catch(0.3), "arc-plane", 0.3),
    "notch": (hook_in_notch(0.25), "arc-extruded", 0.25),
    "nose": (roller_on_cam(0.2), "arc-extruded", 0.2),
    "base": (roller_on_cam(0.7, 2.5), "arc-extruded", 0.7),
    "flank": (roller_on_flank(0.15), "arc-extruded", 0.15),
    "follower": (flat_on_cam(0.4), "arc-plane", 0.4),
    "ellipse": (roller_on_ellipse(0.2), "arc-surface", 0.2),
    "roller": (roller_on_plane(0.35), "cylinder-plane", 0.35),
    "floor": (ball_on_plane(0.1), "sphere-plane", 0.1),
    "groove": (ball_in_groove(0.3), "sphere-extruded", 0.3),
    "detent": (ball_in_cone(0.2), "sphere-turned", 0.2),
    "bar": (ball_on_pin(0.5), "sphere-cylinder", 0.5),
    "dish": (ball_in_dish(0.3), "sphere-surface", 0.3),
    "touching": (flat_on_cam(0.0), "arc-plane", 0.0),
}
"""Pairs by a name: their shapes, the contact that they could be, and the gap as drawn [mm]."""

FALSE = {
    "far": hook_on_catch(1.1),
    "loose": pin_in_loose_hole(),
    "crossed": crossed_pins(),
    "corners": overlapping_corners(),
}
"""Pairs that are no candidates: too far apart, a pin in a hole, no line in which to touch, a sliver."""

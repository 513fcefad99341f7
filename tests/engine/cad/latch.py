"""The four-bar latch of the docs, drawn with OCP: ``python -m tests.engine.cad.latch docs/examples/latch.step``.

A base carries two pins, a crank and a rocker turn on them, and a coupler joins these two by the pins that they carry.
Every bar has 0.05 mm of axial play at each end of its bore, between the face below and the cap of the pin. A block of
the base stops the crank, 0.8 mm from where it is drawn.
"""

import sys
from math import atan2, hypot

from tests.engine.cad.step_files import Drawing, box, cone, cut, cylinder, cylindrical, fused, one_face_a_plane, place

THICKNESS, AXIAL_PLAY, WIDTH = 5.0, 0.05, 14.0
CRANK, ROCKER = (0.0, 24.0), (44.0, 30.0)  # where the coupler's two ends are
ROCKER_FOOT = (50.0, 0.0)
# joint: radius of the pin, radius of the bore
RADII = {
    "base-crank": (3.0, 3.05),
    "crank-coupler": (2.5, 2.54),
    "rocker-coupler": (2.5, 2.55),
    "base-rocker": (3.0, 3.06),
}
STOP_GAP = 0.8
COUNTERSINK = 0.4  # depth, on the crank's side of the cap
STEEL, ALUMINIUM = ("steel", 7.85), ("aluminium", 2.7)
BORE_LIMITS, PIN_LIMITS = (-0.01, 0.02), (-0.008, 0.0)  # of the diameters at base-crank


def pin(at, radius):
    """Return a pin with its cap, from the face that it stands on."""
    x, y, z = at
    length = THICKNESS + 2 * AXIAL_PLAY
    return fused(cylinder(at, radius, length), cylinder((x, y, z + length), radius + 2, 1.5))


def bar(length, bores):
    """Return a bar along x with round ends, its bores at the start and, where there is one, at the end."""
    ends = [(0.0, 0.0, 0.0), (length, 0.0, 0.0)]
    whole = fused(
        box((0.0, -WIDTH / 2, 0.0), (length, WIDTH, THICKNESS)), *(cylinder(end, WIDTH / 2, THICKNESS) for end in ends)
    )
    return cut(whole, *(cylinder(end, radius, THICKNESS) for end, radius in zip(ends, bores, strict=False)))


def parts():
    """Return the shapes of the four parts, each in its own frame."""
    foot = (*ROCKER_FOOT, 0.0)
    stop = box((WIDTH / 2 + STOP_GAP, 8.0, 0.0), (6.0, 7.0, THICKNESS))
    plate = box((-12.0, -12.0, -4.0), (76.0, 34.0, 4.0))
    base = fused(plate, stop, pin((0.0, 0.0, 0.0), RADII["base-crank"][0]), pin(foot, RADII["base-rocker"][0]))
    bore = RADII["base-crank"][1]
    countersink = cone((0.0, 0.0, THICKNESS - COUNTERSINK), (bore, bore + COUNTERSINK), COUNTERSINK)
    length = hypot(*CRANK)
    crank = fused(cut(bar(length, [bore]), countersink), pin((length, 0.0, THICKNESS), RADII["crank-coupler"][0]))
    rocker_length = hypot(ROCKER[0] - ROCKER_FOOT[0], ROCKER[1] - ROCKER_FOOT[1])
    rocker = fused(
        bar(rocker_length, [RADII["base-rocker"][1]]), pin((rocker_length, 0.0, THICKNESS), RADII["rocker-coupler"][0])
    )
    coupler_length = hypot(ROCKER[0] - CRANK[0], ROCKER[1] - CRANK[1])
    coupler = bar(coupler_length, [RADII["crank-coupler"][1], RADII["rocker-coupler"][1]])
    shapes = {"base": base, "crank": crank, "rocker": rocker, "coupler": coupler}
    return {name: one_face_a_plane(shape) for name, shape in shapes.items()}


def places():
    """Return where the parts are."""
    rocker = atan2(ROCKER[1] - ROCKER_FOOT[1], ROCKER[0] - ROCKER_FOOT[0])
    coupler = atan2(ROCKER[1] - CRANK[1], ROCKER[0] - CRANK[0])
    return {
        "base": place(),
        "crank": place(z=AXIAL_PLAY, angle=atan2(CRANK[1], CRANK[0])),
        "rocker": place(*ROCKER_FOOT, AXIAL_PLAY, rocker),
        "coupler": place(*CRANK, THICKNESS + 2 * AXIAL_PLAY, coupler),
    }


def drawing():
    """Return the assembly."""
    made = Drawing()
    latch = made.assembly("latch")
    shapes, where = parts(), places()
    products = {
        name: made.product(name, shape, ALUMINIUM if name == "coupler" else STEEL) for name, shape in shapes.items()
    }
    for name, product in products.items():
        made.add(latch, product, where[name], name)
    pin_radius, bore_radius = RADII["base-crank"]
    made.diameter(products["crank"], cylindrical(shapes["crank"], bore_radius)[0], 2 * bore_radius, BORE_LIMITS)
    made.diameter(products["base"], cylindrical(shapes["base"], pin_radius)[0], 2 * pin_radius, PIN_LIMITS)
    return made


if __name__ == "__main__":
    drawing().write(sys.argv[1])

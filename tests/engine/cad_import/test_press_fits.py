"""Pins that are drawn larger than their holes are pressed in: one body with that part, a joint in the other."""

import pytest

from engine.cad.occt.step_assembly import read_assembly
from engine.cad_import.found_geometry import find_geometry
from engine.cad_import.proposed_groups import PartGroup
from tests.engine.cad.step_files import Drawing, box, cut, cylinder, fused, place

RADIUS, PLAY = 2.5, 0.06
Y = (0.0, 1.0, 0.0)


def leaf(starts, radius, length=20.0):
    """Return a leaf of a hinge whose knuckles begin at some places along y."""
    shape = box((3.0, -50.0, -1.0), (30.0, 100.0, 2.0))
    for start in starts:
        shape = fused(shape, cylinder((0, start, 0), 5.0, length, Y), box((0, start, -1), (8, length, 2)))
    return cut(shape, *(cylinder((0, start - 1, 0), radius, length + 2, Y) for start in starts))


def hinge(larger):
    """Return a hinge of two leaves with two pins of one product, which are larger than the holes of the first leaf."""
    made = Drawing()
    top = made.assembly("hinge")
    made.add(top, made.product("frame leaf", leaf((-45.0, 25.0), RADIUS - larger)))
    turned = place()
    turned.SetValues(-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0)
    made.add(top, made.product("door leaf", leaf((-24.9, 5.1), RADIUS + PLAY, 19.8)), turned)
    pin = made.product("pin", cylinder((0, 0, 0), RADIUS, 40.0, Y))
    for y in (-45.0, 5.0):
        made.add(top, pin, place(y=y))
    return made


@pytest.mark.parametrize(("larger", "is_pressed"), [(0.01, True), (0.0, False), (0.1, False)])
def test_pressed_pins(tmp_path, larger, is_pressed):
    """The usual interference is one; equal radii are asked about, and a tenth of a millimetre is an error."""
    found = find_geometry(read_assembly(hinge(larger).write(tmp_path / "hinge.step"), "0" * 64, 1e-4))
    pressed = (PartGroup("frame-leaf", ("frame leaf", "pin-1", "pin-2"), "by press fit"),)
    assert found.groups == (pressed if is_pressed else ())
    if is_pressed:
        [joint] = found.joints
        assert (joint.pin.journal, joint.pin.bearing, len(joint.pin.seats)) == ("frame-leaf", "door leaf", 2)
        assert joint.pin.radial_clearance == pytest.approx(PLAY, abs=1e-9)
        assert [flange.play for flange in joint.flanges] == pytest.approx([0.1, 0.1], abs=1e-9)

"""A pin in a slot is no joint, wherever in the slot it is."""

import pytest

from engine.cad.findings.joints import pins_in_holes, pins_in_slots
from tests.engine.cad.hinges import BORE, PIN, THICKNESS, cut_in_two, hinge, plate, stud
from tests.engine.cad.step_files import box, cut, cylinder

LENGTH = 8.0


def slotted(x=0.0):
    """Return a plate with a slot along x; x is where its left end has its axis."""
    ends = [cylinder((x + step, 0.0, -1.0), BORE, THICKNESS + 2) for step in (0.0, LENGTH)]
    between = box((x, -BORE, -1.0), (LENGTH, 2 * BORE, THICKNESS + 2))
    return cut(box((-25.0, -10.0, 0.0), (50.0, 20.0, THICKNESS)), *ends, between)


@pytest.mark.parametrize("x", [0.0, -LENGTH, -LENGTH / 2, -0.05, 0.04])
def test_a_pin_in_a_slot(read, x):
    """At either end, in the middle or near an end: no joint, and one thing to say."""
    assembly = read(hinge(slotted(x)))
    assert pins_in_holes(assembly) == ([], [])
    [miss] = pins_in_slots(assembly)
    assert miss.reason.startswith("the hole is a slot, in which the pin slides 8 mm; write contacts")
    faces = {face.number: face for face in assembly.faces}
    assert (faces[miss.hole].part, faces[miss.pin].part) == ("plate", "stud")


@pytest.mark.parametrize(
    "drawing",
    [
        lambda: hinge(slotted(4.0)),  # beyond its end
        lambda: hinge(slotted(), y=2.0),
        lambda: hinge(slotted(), z=20.0),
        lambda: hinge(slotted(), stud(PIN - 0.5)),
    ],
)
def test_a_pin_beside_a_slot_is_nothing(read, drawing):
    """Where it does not slide in it, nothing is said."""
    assert pins_in_slots(read(drawing())) == []


def test_a_hole_in_halves_is_no_slot(read):
    """Its halves have one axis."""
    assembly = read(hinge(cut_in_two(plate()), cut_in_two(stud())))
    assert pins_in_slots(assembly) == []
    assert len(pins_in_holes(assembly)[0]) == 1

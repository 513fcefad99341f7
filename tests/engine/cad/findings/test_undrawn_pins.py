"""Joints that may be there: equal holes with nothing in them, and holes that do not close around their pins."""

import tomllib
from math import asin, degrees, pi, radians, sin

import numpy as np
import pytest

from engine.cad.findings.joints import pins_in_holes, undrawn_pins
from engine.cad_import.found_features import folded_features, found_features, pivot_text
from engine.cad_import.found_geometry import find_geometry
from engine.cad_import.proposed_mechanism import proposed_mechanism
from engine.mechanism import mechanism_from
from engine.mechanism.geometry.resolved_geometry import without_selectors
from tests.engine.cad.step_files import Drawing, box, cut, cylinder, fused, moved

LEVER, FRAME = 4.0, 6.0  # thickness


def plate(thickness, *holes, size=40.0):
    """Return a plate on z = 0 with holes: x, y and radius of each."""
    whole = box((-size / 2, -10.0, 0.0), (size, 20.0, thickness))
    return cut(whole, *(cylinder((x, y, -1.0), radius, thickness + 2) for x, y, radius in holes))


def pair(read, lever, frame=None, more=()):
    """Return a lever above a frame, 0.1 mm apart, and other parts."""
    made = Drawing()
    top = made.assembly("pair")
    parts = {"frame": frame or plate(FRAME, (0, 0, 2.0), size=60.0), "lever": moved(lever, z=FRAME + 0.1), **dict(more)}
    for name, shape in parts.items():
        made.add(top, made.product(name, shape), name=name)
    return read(made)


def test_two_equal_holes(read):
    """They are found once, with their axis; not if they differ, lie far apart, or hold something."""
    [found] = undrawn_pins(pair(read, plate(LEVER, (0, 0, 2.0))))
    assert found.parts == ("frame", "lever")
    np.testing.assert_allclose(found.point, (0, 0, FRAME / 2), atol=1e-9)
    assert (abs(found.axis[2]), found.half_length) == pytest.approx((1.0, FRAME / 2))
    assert undrawn_pins(pair(read, plate(LEVER, (0, 0, 2.5)))) == []
    assert undrawn_pins(pair(read, plate(LEVER, (0.5, 0, 2.0)))) == []
    assert undrawn_pins(pair(read, moved(plate(LEVER, (0, 0, 2.0)), z=3.0))) == []
    pin = [("pin", cylinder((0, 0, 0), 1.9, FRAME + LEVER))]
    assert undrawn_pins(pair(read, plate(LEVER, (0, 0, 2.0)), more=pin)) == []


def test_the_joint_of_a_pin_that_is_not_drawn(read):
    """Its marked table, without the marks, is a joint in the middle of the hole."""
    found = find_geometry(pair(read, plate(LEVER, (0, 0, 2.0))))
    assert [pivot_text(found, each) for each in found.pivots] == [
        "undrawn pin frame-lever: coaxial holes of frame and lever, radii 2 and 2, and nothing in them"
    ]
    text = proposed_mechanism(found, "x.step", "pair").replace('# density = "steel"', 'density = "steel"')
    assert text.count("#? joints: which of these equal holes") == 1
    table = text.partition("# [joints.frame-lever]")[2].partition("\n\n")[0]
    joint = "[joints.frame-lever]" + table.replace("\n# ", "\n")
    plain, _ = without_selectors(tomllib.loads(f"{text}\n{joint}"), found.drawn)
    made = mechanism_from(plain, "pair").joints["frame-lever"]
    assert (made.journal.radius, made.radial_clearance) == pytest.approx((1.98, 0.02))
    np.testing.assert_allclose(made.bearing.point, (0, 0, FRAME / 2), atol=1e-9)
    np.testing.assert_allclose(np.add(made.journal.point, (0, 0, 0)), (0, 0, FRAME / 2), atol=1e-9)
    assert made.rings == pytest.approx((-FRAME / 2, FRAME / 2))


def test_holes_for_screws(read):
    """Equal holes on two axes of parts that touch make one body of them; on two axes apart they do not."""
    two = (-10, 0, 2.0), (10, 0, 2.0)
    third = [("cap", moved(plate(2.0), z=50.0))]
    frame = plate(FRAME, *two, size=60.0)
    touching = find_geometry(pair(read, moved(plate(LEVER, *two), z=-0.1), frame, third))
    assert [(group.parts, group.why) for group in touching.groups] == [(("frame", "lever"), "by holes for screws")]
    assert touching.pivots == ()
    assert len(find_geometry(pair(read, plate(LEVER, *two), frame, third)).pivots) == 2


@pytest.mark.parametrize(("span", "radius", "snaps"), [(120.0, 4.3, True), (89.0, 4.0, True), (50.0, 4.0, False)])
def test_a_bearing_that_does_not_close(read, span, radius, snaps):
    """A hole of less than half a turn around a pin that fits is one into which it may snap."""
    low = radius * sin(radians(span) / 2 - pi / 2) if span > 180 else -radius * sin(pi / 2 - radians(span) / 2)
    clip = cut(box((-10.0, -9.0, 0.0), (20.0, 9.0 + low, 6.0)), cylinder((0, 0, -1), radius, 8))
    stud = fused(cylinder((0, 0, -5.0), 3.95, 20.0), box((-10.0, -10.0, -9.0), (20.0, 20.0, 4.0)))
    made = Drawing()
    top = made.assembly("clip")
    for name, shape in {"clip": clip, "stud": stud}.items():
        made.add(top, made.product(name, shape), name=name)
    assembly = read(made)
    [miss] = pins_in_holes(assembly)[1]
    assert miss.snaps == snaps
    assert degrees(pi + 2 * asin(low / radius)) == pytest.approx(span)
    found = find_geometry(assembly)
    assert [each.name for each in found.pivots] == (["stud-clip"] if snaps else [])
    text = proposed_mechanism(found, "x.step", "clip")
    assert ("#? joints: does the pin snap into" in text) == snaps
    lines = folded_features(found, found_features(found))
    assert any(line.startswith("no joint") for line in lines) != snaps


def test_what_is_alike_is_one_line(read):
    """Pairs that form no joint for the same reason are counted; the least plausible ones are only counted."""
    sizes = [0.8 + 0.02 * number for number in range(14)]
    studs = [cylinder((6.0 * number - 40, 0, 0), 0.5, 5.0) for number in range(14)]
    frame = fused(plate(3.0, size=100.0), *studs)
    lever = plate(LEVER, *((6.0 * number - 40, 0, radius + 0.1) for number, radius in enumerate(sizes)), size=100.0)
    found = find_geometry(pair(read, moved(lever, z=-FRAME - 0.1 + 3.0), frame))
    lines = [line for line in folded_features(found, found_features(found)) if line.startswith("no joint")]
    assert len(lines) == 11
    assert lines[-1] == "no joint: 4 more pins and holes, less likely ones; --json lists all"

"""Bought parts: by name, by standard size, by shape; what they hold together is one body."""

from math import hypot, pi

import numpy as np
import pytest

from engine.cad.findings.standard_parts import standard_parts
from engine.cad_import.found_geometry import find_geometry
from tests.engine.cad.bought import COIL, bearing, bolt, coil, gearbox, hexagon, nut
from tests.engine.cad.step_files import Drawing, box, cut, cylinder, place


def recognised(read, **shapes):
    """Return kind and description of each part, by name."""
    made = Drawing()
    top = made.assembly("all")
    for number, (name, shape) in enumerate(shapes.items()):
        made.add(top, made.product(name.replace("_", " "), shape), place(100.0 * number), name)
    return {each.part: (each.kind, each.said) for each in standard_parts(read(made))}


def test_by_size(read):
    """Hexagons, a washer and a bearing of standard size, whatever they are called; others of about the size are not."""
    washer = cut(cylinder((0, 0, 0), 4.5, 0.8), cylinder((0, 0, -1), 2.15, 3))
    bush = cut(cylinder((0, 0, 0), 11.0, 12.0), cylinder((0, 0, -1), 4.0, 14))
    odd = cut(hexagon(9.0, 3.2), cylinder((0, 0, -1), 2.0, 5))
    found = recognised(read, a=bolt(20.0), b=nut(), c=washer, d=bearing(), e=bush, f=odd, g=hexagon(7.0, 3.0))
    assert found == {
        "a": ("fastener", "M4 by its hexagon"),
        "b": ("fastener", "M4 by its hexagon"),
        "c": ("fastener", "washer 4.3 by its size"),
        "d": ("bearing", "608 by its size"),
    }


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("fastener", ["Nut M4", "DIN 912 M3", "M3x10", "Sechskantmutter", "cap screw 2", "washers", "circlip"]),
        ("bearing", ["10x6x2.5 Bearing", "608ZZ", "Rillenkugellager"]),
        ("spring", ["return spring", "Druckfeder"]),
        ("board", ["PCB", "R 0805 2012Metric", "SOT-23"]),
        (None, ["Spring Rod", "bearing cap bottom", "lead screw", "Donut", "Riemenscheibe", "pin", "nut holder"]),
    ],
)
def test_by_name(read, kind, names):
    """Words of a name count, not letters within one; a holder of something is none of it."""
    found = recognised(read, **{name: box((0, 0, 0), (9, 8, 7)) for name in names})
    assert {name: found.get(name, (None, ""))[0] for name in names} == dict.fromkeys(names, kind)


def test_a_coil(read):
    """Wire, diameter and turns of a helix are those that it was drawn with, wherever its axis is."""
    made = Drawing()
    made.add(made.assembly("all"), made.product("a", coil()), place(7.0, 3.0, angle=0.3))
    [found] = [each.coil for each in standard_parts(read(made))]
    long = COIL["turns"] * hypot(2 * pi * COIL["radius"], COIL["pitch"])
    assert found.wire == pytest.approx(COIL["wire"], rel=1e-3)
    assert found.diameter == pytest.approx(2 * COIL["radius"], rel=2e-3)
    assert found.turns == pytest.approx(long / hypot(2 * pi * COIL["radius"], COIL["pitch"]), rel=0.01)
    np.testing.assert_allclose(found.ends[:, :2], [[7.0, 3.0]] * 2, atol=0.04)
    assert found.length == pytest.approx(COIL["pitch"] * COIL["turns"] + COIL["wire"], abs=0.02)


def test_no_coil(read):
    """Neither a tube nor a ring is one."""
    tube = cut(cylinder((0, 0, 0), 5.5, 13.0), cylinder((0, 0, -1), 4.5, 15))
    assert recognised(read, tube=tube) == {}


def test_what_screws_hold_is_one_body(read):
    """Two bolts make one body of what they hold; a bearing joins its seat; the shaft turns in that body."""
    found = find_geometry(read(gearbox()))
    [group] = found.groups
    assert set(group.parts) == {"base", "block", "BOLT-1", "BOLT-2", "NUT-1", "NUT-2", "608"}
    assert group.why == "by bearing and by fastener"
    assert [(joint.pin.journal, joint.pin.bearing) for joint in found.joints] == [("shaft", "block")]
    [spring] = found.springs
    assert spring.ends == ("shelf", "lid")
    assert "coil" not in found.bodies


def test_one_screw_may_be_a_pivot(read):
    """A single bolt joins one of two parts, and the other may turn on it."""
    found = find_geometry(read(gearbox(bolts=1, spring=False)))
    group = next(each for each in found.groups if "BOLT" in each.parts)
    assert {"BOLT", "NUT", "block"} <= set(group.parts)
    assert "base" not in group.parts
    assert ("block", "base") in [(joint.pin.journal, joint.pin.bearing) for joint in found.joints]

"""True joints are found, however a CAD system draws them, and no false one."""

from math import pi

import numpy as np
import pytest
from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform
from OCP.gp import gp_Pnt, gp_Trsf

from engine.cad.findings.joints import pins_in_holes
from tests.engine.cad import latch
from tests.engine.cad.hinges import BORE, PIN, PLAY, THICKNESS, as_splines, cut_in_two, hinge, plate, stud
from tests.engine.cad.step_files import Drawing, box, cone, cut, cylinder, fused, moved, place


def only_joint(assembly):
    """Return the joint of an assembly that has one, and none that is nearly one."""
    [joint], refused = pins_in_holes(assembly)
    assert refused == []
    return joint


def reasons(assembly):
    """Return why pairs are refused, of an assembly without a joint."""
    joints, refused = pins_in_holes(assembly)
    assert joints == []
    return [each.reason for each in refused]


def test_the_latch(read):
    """Four joints, with the radii, clearances and stations of the drawing."""
    joints, refused = pins_in_holes(read(latch.drawing()))
    assert refused == []
    found = {f"{joint.journal}-{joint.bearing}": joint for joint in joints}
    assert found.keys() == latch.RADII.keys()
    for name, (pin, bore) in latch.RADII.items():
        joint = found[name]
        [seat] = joint.seats
        assert (seat.pin_radius, seat.hole_radius) == pytest.approx((pin, bore), abs=1e-9)
        assert joint.radial_clearance == pytest.approx(bore - pin, abs=1e-9)
        assert (joint.offset, joint.tilt, joint.overlap) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
        length = latch.THICKNESS - (latch.COUNTERSINK if name == "base-crank" else 0.0)
        assert [station for station, _ in joint.rings] == pytest.approx([-length / 2, length / 2], abs=1e-9)
    np.testing.assert_allclose(found["crank-coupler"].point, [0.0, 24.0, 7.6], atol=1e-9)


@pytest.mark.parametrize("unit", ["MM", "INCH", "M"])
@pytest.mark.parametrize("drawn", [lambda shape: shape, cut_in_two], ids=["whole", "halves"])
def test_units_and_halves(read, unit, drawn):
    """A bore in two halves is one hole; inches and metres are read as millimetres."""
    assembly = read(hinge(drawn(plate()), drawn(stud())), unit=unit)
    assert assembly.unit == {"MM": "mm", "INCH": "inch", "M": "m"}[unit]
    joint = only_joint(assembly)
    [seat] = joint.seats
    assert (seat.pin_radius, seat.hole_radius) == pytest.approx((PIN, BORE), abs=1e-9)
    np.testing.assert_allclose(joint.point, [0.0, 0.0, PLAY + THICKNESS / 2], atol=1e-9)
    assert [station for station, _ in joint.rings] == pytest.approx([-THICKNESS / 2, THICKNESS / 2], abs=1e-9)


def test_cylinders_exported_as_splines(read):
    """They are recognised, with a gap; without recognition there is nothing to find."""
    drawing = hinge(as_splines(plate()), as_splines(stud()))
    assembly = read(drawing)
    joint = only_joint(assembly)
    assert joint.radial_clearance == pytest.approx(BORE - PIN, abs=1e-4)
    hole = assembly.faces[joint.seats[0].hole]
    assert 0 < hole.recognition_gap < 1e-4
    assert (hole.span, len(hole.places)) == (pytest.approx(2 * pi), 1)
    assert [station for station, _ in joint.rings] == pytest.approx([-THICKNESS / 2, THICKNESS / 2], abs=1e-4)
    unrecognised = read(drawing, recognition=0.0)
    assert {face.kind for face in unrecognised.faces} == {"surface"}
    assert pins_in_holes(unrecognised) == ([], [])


def test_a_countersink_shortens_the_hole(read):
    """The cone at its end carries nothing."""
    sunk = cut(plate(), cone((0.0, 0.0, THICKNESS - 0.5), (BORE, BORE + 0.5), 0.5))
    [seat] = only_joint(read(hinge(sunk))).seats
    assert seat.end - seat.start == pytest.approx(THICKNESS - 0.5, abs=1e-9)


def test_two_lugs_are_one_joint(read):
    """The holes of a clevis lie on one axis: rings at its two ends, a seat in each lug."""
    clevis = cut(plate(), cylinder((0.0, 0.0, 2.0), 5.0, 1.0))  # a groove in the middle of the hole
    joint = only_joint(read(hinge(clevis)))
    lengths = [(seat.start, seat.end) for seat in joint.seats]
    np.testing.assert_allclose(lengths, [[-2.5, -0.5], [0.5, 2.5]], atol=1e-9)
    assert [station for station, _ in joint.rings] == pytest.approx([-2.5, 2.5], abs=1e-9)


def test_a_stepped_pin_has_rings_of_its_own_radii(read):
    """Each step carries at both its ends."""
    stepped = fused(stud(), cylinder((0.0, 0.0, 0.0), PIN + 0.5, 3.0))
    hole = cut(plate(), cylinder((0.0, 0.0, -1.0), BORE + 0.5, 4.0))
    joint = only_joint(read(hinge(hole, stepped)))
    stations, radii = zip(*((station, seat.pin_radius) for station, seat in joint.rings), strict=True)
    assert radii == pytest.approx((3.5, 3.5, 3.0, 3.0), abs=1e-9)
    heights = np.array([PLAY, 3.0, PLAY + 3.0, PLAY + THICKNESS])  # the step of the pin ends below that of the hole
    assert np.add(stations, joint.point[2]) == pytest.approx(heights, abs=1e-9)


def test_equal_radii_have_no_clearance(read):
    """It is 0, for a person to say, never the last digit of a subtraction."""
    joint = only_joint(read(hinge(plate(PIN), stud(PIN)), unit="INCH"))
    assert joint.radial_clearance == 0.0


def test_a_pose_with_an_overlap(read):
    """The pin may lie a little outside its clearance: a joint, with what it overlaps."""
    joint = only_joint(read(hinge(x=0.13)))
    assert joint.offset == pytest.approx(0.13, abs=1e-9)
    assert joint.overlap == pytest.approx(0.13 - (BORE - PIN), abs=1e-9)


@pytest.mark.parametrize(
    ("drawing", "said"),
    [
        (lambda: hinge(x=0.3), "the axes are 0.3 mm apart; allowed: the clearance + 0.12, so 0.17"),
        (lambda: hinge(plate(3.5)), "the radii differ by 0.5 mm; allowed: up to 0.3"),
        (lambda: hinge(plate(2.95)), "the pin is 0.05 mm larger in radius than the hole"),
        (lambda: hinge(z=20.0), "they lie 12 mm apart along the axis"),
        (
            lambda: hinge(cut(plate(), box((-20.0, -1.0, -1.0), (40.0, 20.0, 10.0)))),
            "only 142 degrees of the hole are there; allowed: more than 160",
        ),
    ],
)
def test_decoys(read, drawing, said):
    """What only looks like a joint is refused with the reason."""
    [reason] = reasons(read(drawing()))
    assert reason.startswith(said)


def test_a_pin_with_more_clearance_may_be_a_joint(read):
    """Only its clearance speaks against it; that cannot be said of a pin that is not in the hole, or larger."""
    for drawing, is_loose in (
        (hinge(plate(3.5)), True),
        (hinge(plate(3.5), z=20.0), False),
        (hinge(plate(3.5), x=0.6), False),
        (hinge(plate(2.95)), False),
    ):
        _, [miss] = pins_in_holes(read(drawing))
        assert miss.may_be_one is is_loose


def scaled(factor, bore=BORE):
    """Return a hinge drawn larger or smaller, with a bore of its own."""
    scale = gp_Trsf()
    scale.SetScale(gp_Pnt(), factor)
    made = Drawing()
    top = made.assembly("hinge")
    for name, shape in (("plate", moved(plate(bore), z=PLAY)), ("stud", stud())):
        made.add(top, made.product(name, BRepBuilderAPI_Transform(shape, scale, True).Shape()), name=name)
    return made


@pytest.mark.parametrize(
    ("factor", "bore", "most"),
    [
        (40.0 / PIN, PIN * 1.0099, None),
        (40.0 / PIN, PIN * 1.0126, 0.4),
        (1.0, PIN + 0.3, None),
        (0.1 / PIN, 4.0, None),
        (0.1 / PIN, 4.8, 0.05),
    ],
    ids=["a loose pin of 80 mm", "one that is too loose", "exactly at the limit", "of 0.2 mm", "a hole for another"],
)
def test_limits_follow_the_size(read, factor, bore, most):
    """A pin of a crane may be looser than one of a lock, and in a watch 0.1 mm of clearance is a hole for another."""
    joints, refused = pins_in_holes(read(scaled(factor, bore)))
    if most is None:
        [joint] = joints
        assert joint.radial_clearance == pytest.approx(factor * (bore - PIN), rel=1e-6)
    else:
        assert joints == []
        said = f"the radii differ by {factor * (bore - PIN):.3g} mm; allowed: up to {most:g}"
        assert [each.reason for each in refused] == [said]


def test_coaxial_holes_without_a_pin_are_nothing(read):
    """Nor are two parts of which one has pin and hole."""
    assert reasons(read(hinge(plate(), moved(plate(), z=-5.0)))) == []
    alone = Drawing()
    alone.product("lock", fused(moved(plate(), z=PLAY), moved(stud(), x=40.0)))
    assert reasons(read(alone)) == []


def test_repeated_and_mirrored_instances(read):
    """One stud and one plate, twice each, the second time turned over: two joints, the right ones."""
    made = Drawing()
    top = made.assembly("pair")
    below, above = made.product("", stud()), made.product("plate", moved(plate(centre=(2.0, 1.0)), x=-2.0, y=-1.0))
    mirror = place(x=50.0)
    mirror.SetMirror(made.plane((50.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
    for product in (below, above):
        made.add(top, product, place(z=PLAY) if product is above else None)
        made.add(top, product, mirror if product is below else mirror.Multiplied(place(z=PLAY)))
    assembly = read(made)
    assert [part.name for part in assembly.parts] == ["part-1", "part-2", "plate-1", "plate-2"]
    assert [part.placement.mirrored for part in assembly.parts] == [False, True, False, True]
    joints, refused = pins_in_holes(assembly)
    assert refused == []
    assert [(joint.bearing, joint.journal) for joint in joints] == [("plate-1", "part-1"), ("plate-2", "part-2")]
    np.testing.assert_allclose([joint.point[0] for joint in joints], [0.0, 100.0], atol=1e-9)

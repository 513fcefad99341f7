"""Parts, their solids and what the file says of them: volumes, materials, names, limits."""

import re
from math import pi
from pathlib import Path

import numpy as np
import pytest
from OCP.BRep import BRep_Builder
from OCP.BRepAlgoAPI import BRepAlgoAPI_Common, BRepAlgoAPI_Cut
from OCP.BRepPrimAPI import BRepPrimAPI_MakeSphere
from OCP.gp import gp_Pnt
from OCP.TopoDS import TopoDS_Compound

from engine.cad.occt import product_geometry, product_tree
from engine.cad.occt.step_assembly import read_assembly
from engine.cad.occt.step_document import UnreadableStep
from tests.engine.cad import latch
from tests.engine.cad.hinges import as_splines
from tests.engine.cad.spline_shapes import elliptic_cam
from tests.engine.cad.step_files import Drawing, box, cylinder, cylindrical, fused, place


def compound(*shapes):
    """Return shapes as one product of several solids."""
    together, builder = TopoDS_Compound(), BRep_Builder()
    builder.MakeCompound(together)
    for shape in shapes:
        builder.Add(together, shape)
    return together


def edited(drawing, path, *changes):
    """Write a drawing, replace text of the file, read it."""
    text = drawing.write(path).read_text("latin-1")
    for pattern, new in changes:
        assert re.search(pattern, text), pattern
        text = re.sub(pattern, new, text)
    Path(path).write_text(text, "latin-1")
    return read_assembly(path, "0" * 64, 1e-4)


# -- solids ----------------------------------------------------------------------------------------------------------


def test_solids_in_closed_form(read):
    """Volume, centre and inertia of a ball, a cylinder and a box, each in its place, to 1e-8."""
    made = Drawing()
    top = made.assembly("top")
    radius, height = 2.0, 6.0
    shapes = {
        "ball": BRepPrimAPI_MakeSphere(gp_Pnt(), 3.0).Shape(),
        "rod": cylinder((0.0, 0.0, 0.0), radius, height),
        "brick": box((0.0, 0.0, 0.0), (1.0, 2.0, 3.0)),
    }
    where = place(10.0, -5.0, 2.0, 0.3)
    for name, shape in shapes.items():
        made.add(top, made.product(name, shape), where)
    assembly = read(made)
    ball, rod, brick = (part.solids[0] for part in assembly.parts)
    volumes = [36 * pi, pi * radius**2 * height, 6.0]
    assert [solid.volume for solid in (ball, rod, brick)] == pytest.approx(volumes, rel=1e-8)
    np.testing.assert_allclose(ball.centre, [10.0, -5.0, 2.0], atol=1e-8)
    np.testing.assert_allclose(rod.centre, [10.0, -5.0, 5.0], atol=1e-8)
    np.testing.assert_allclose(ball.inertia, 0.4 * 9 * volumes[0] * np.eye(3), rtol=1e-8, atol=1e-6)
    across = volumes[1] * (3 * radius**2 + height**2) / 12
    np.testing.assert_allclose(rod.inertia, np.diag([across, across, volumes[1] * radius**2 / 2]), rtol=1e-8, atol=1e-6)
    turn = assembly.part("brick").placement.rotation
    np.testing.assert_allclose(brick.inertia, turn @ np.diag([6.5, 5.0, 2.5]) @ turn.T, atol=1e-8)
    assert all(solid.relative_error < 1e-8 for solid in (ball, rod, brick))


def test_solids_with_knots_inside_their_faces(read):
    """A cam with a bore, its outline a rational B-spline: one of OCCT's integrations is 0.5 % off."""
    made = Drawing()
    (a, b, width), radius, at = (20.0, 12.0, 8.0), 3.0, np.array([1.0, 2.0])
    bore = cylinder((*at, -1.0), radius, 10.0)
    made.add(made.assembly("top"), made.product("cam", BRepAlgoAPI_Cut(elliptic_cam(a, b, width), bore).Shape()))
    (solid,) = read(made).parts[0].solids
    whole, cut = pi * a * b * width, pi * radius**2 * width
    volume = whole - cut
    centre = np.array([*(-cut / volume * at), width / 2])
    polar = whole * (a**2 + b**2) / 4 - cut * (radius**2 / 2 + at @ at) - volume * (centre[:2] @ centre[:2])
    assert solid.volume == pytest.approx(volume, rel=1e-8)
    np.testing.assert_allclose(solid.centre, centre, rtol=1e-8)
    assert solid.inertia[2, 2] == pytest.approx(polar, rel=1e-8)
    assert solid.relative_error < 1e-8


def test_the_integration_that_takes_minutes_is_left_to_what_cannot_be_cut(read, monkeypatch):
    """A ball and a rod, approximated by splines to 1e-6: Kronrod's inertia takes 90 s and 10 s for them."""
    by_kronrod = product_geometry._by_kronrod

    def without_inertia(solid, inertia):
        assert not inertia
        return by_kronrod(solid, inertia)

    monkeypatch.setattr(product_geometry, "_by_kronrod", without_inertia)
    made = Drawing()
    top = made.assembly("top")
    made.add(top, made.product("ball", as_splines(BRepPrimAPI_MakeSphere(10.0).Shape())))
    made.add(top, made.product("rod", as_splines(cylinder((0.0, 0.0, 0.0), 3.0, 8.0))))
    ball, rod = (part.solids[0] for part in read(made).parts)
    assert ball.volume == pytest.approx(4 / 3 * pi * 10**3, rel=1e-5)
    assert ball.inertia[0, 0] == pytest.approx(0.4 * ball.volume * 10**2, rel=1e-5)
    assert rod.volume == pytest.approx(pi * 3**2 * 8, rel=1e-5)
    assert rod.inertia[2, 2] == pytest.approx(0.5 * rod.volume * 3**2, rel=1e-5)


def test_a_product_of_two_solids(read):
    """In an assembly they stay apart, and so do their faces; the part has both. Alone, each is a part."""
    made = Drawing()
    contact = compound(box((0, 0, 0), (1, 1, 1)), box((5, 0, 0), (2, 2, 2)))
    alone = made.product("contact", contact)
    each = read(made)
    assert [part.name for part in each.parts] == ["contact-1", "contact-2"]
    assert [part.solids[0].volume for part in each.parts] == pytest.approx([1.0, 8.0], rel=1e-12)
    assert [len(each.faces_of(part.name)) for part in each.parts] == [6, 6]
    top = made.assembly("top")
    made.add(top, alone)
    made.add(top, made.product("base", box((0, 0, -2), (9, 9, 1))))
    assembly = read(made)
    part = assembly.part("contact")
    assert [solid.volume for solid in part.solids] == pytest.approx([1.0, 8.0], rel=1e-12)
    np.testing.assert_allclose([solid.centre[0] for solid in part.solids], [0.5, 6.0], atol=1e-12)
    assert [sum(face.solid == i for face in assembly.faces_of("contact")) for i in (0, 1)] == [6, 6]


def test_the_material_of_a_product_of_two_solids(read):
    """It is that of all its solids, though OCCT gives it to the first."""
    made = Drawing()
    top = made.assembly("top")
    both = compound(box((0, 0, 0), (1, 1, 1)), box((5, 0, 0), (2, 2, 2)))
    made.add(top, made.product("frame", both, ("steel", 7.85)))
    made.add(top, made.product("cover", box((0, 0, 9), (1, 1, 1))))
    frame, cover = read(made).parts
    assert [(each.material or frame.material).density for each in frame.solids] == pytest.approx([7.85e-3] * 2)
    assert (cover.material, cover.solids[0].material) == (None, None)
    alone = Drawing()
    alone.product("frame", both, ("steel", 7.85))
    assert [part.material.name for part in read(alone).parts] == ["steel", "steel"]


# -- the tree --------------------------------------------------------------------------------------------------------


def test_assemblies_in_assemblies(read):
    """Places multiply, paths name every instance on the way."""
    made = Drawing()
    top, arm = made.assembly("machine"), made.assembly("arm")
    made.add(arm, made.product("pin", cylinder((0.0, 0.0, 0.0), 1.0, 2.0)), place(x=3.0), "pin of the arm")
    made.add(top, arm, place(y=10.0, angle=pi / 2), "left")
    made.add(top, arm, place(y=-10.0), "right")
    assembly = read(made)
    assert [part.name for part in assembly.parts] == ["pin-1", "pin-2"]
    assert [part.path for part in assembly.parts] == [
        ("machine", "left", "pin of the arm"),
        ("machine", "right", "pin of the arm"),
    ]
    left, right = assembly.parts
    np.testing.assert_allclose(left.solids[0].centre, [0.0, 13.0, 1.0], atol=1e-9)
    np.testing.assert_allclose(right.solids[0].centre, [3.0, -10.0, 1.0], atol=1e-9)
    assert {face.part for face in assembly.faces} == {"pin-1", "pin-2"}
    assert [face.number for face in assembly.faces] == list(range(len(assembly.faces)))
    assert [mesh.part for mesh in assembly.meshes] == ["pin-1", "pin-2"]
    for mesh in assembly.meshes:
        assert {assembly.faces[number].part for number in mesh.faces.tolist()} == {mesh.part}


def test_the_most_parts(read, monkeypatch):
    """So many are read, and one more is refused: instances count, not products."""
    made = Drawing()
    top, brick = made.assembly("top"), made.product("brick", box((0.0, 0.0, 0.0), (1.0, 2.0, 3.0)))
    for number in range(3):
        made.add(top, brick, place(10.0 * number))
    monkeypatch.setattr(product_tree, "MOST_INSTANCES", 3)
    assert len(read(made).parts) == 3
    monkeypatch.setattr(product_tree, "MOST_INSTANCES", 2)
    with pytest.raises(UnreadableStep, match="more than 2 parts"):
        read(made)


def test_an_instance_without_a_name_has_that_of_its_product(read):
    """Not what OCCT calls it, which is the place of the product in its document."""
    made = Drawing()
    top = made.assembly("")
    made.add(top, made.product("pin", box((0, 0, 0), (1, 1, 1))))
    [part] = read(made).parts
    assert part.path == ("", "pin")


def test_a_single_part_without_a_name(read, tmp_path):
    """It is called part, whether its name is empty, or OCCT has made one up."""
    made = Drawing()
    made.product("", box((0, 0, 0), (1, 1, 1)))
    assert [part.name for part in read(made).parts] == ["part"]
    nameless = edited(made, tmp_path / "empty.step", (r"PRODUCT\(\s*'[^']*'\s*,\s*'[^']*'", "PRODUCT('',''"))
    assert [(part.name, part.product) for part in nameless.parts] == [("part", "")]


def test_names_that_a_terminal_would_act_on(tmp_path):
    """They are shown as what they are."""
    made = Drawing()
    made.product("pin", box((0, 0, 0), (1, 1, 1)))
    hostile = edited(made, tmp_path / "hostile.step", (r"PRODUCT\('pin','pin'", r"PRODUCT('pin','a\\X\\1B[2Jb'"))
    [part] = hostile.parts
    assert part.name.isprintable()
    assert "[2J" in part.name


DATUM_CURVES = r"""#\g<1> = SHAPE_REPRESENTATION('',(\g<2>),\g<4>);
#9000001 = ADVANCED_BREP_SHAPE_REPRESENTATION('',(\g<2>,\g<3>),\g<4>);
#9000002 = SHAPE_REPRESENTATION_RELATIONSHIP('','',#\g<1>,#9000001);
#9000003 = SHAPE_REPRESENTATION_RELATIONSHIP('','',#\g<1>,#9000004);
#9000004 = GEOMETRICALLY_BOUNDED_SURFACE_SHAPE_REPRESENTATION('',(#9000005),\g<4>);
#9000005 = GEOMETRIC_SET('',(#9000006));
#9000006 = CIRCLE('',\g<2>,5.);"""


def test_datum_curves_are_no_parts(tmp_path):
    """A product that has them as a second shape, as Pro/E writes it, is one part of its name."""
    made = Drawing()
    top = made.assembly("top")
    nut = made.product("NUT", cylinder((0, 0, 0), 1.0, 2.0))
    for x in (0.0, 9.0):
        made.add(top, nut, place(x), "NUT")
    change = (r"#(\d+) = ADVANCED_BREP_SHAPE_REPRESENTATION\('',\((#\d+),(#\d+)\),(#\d+)\);", DATUM_CURVES)
    found = edited(made, tmp_path / "curves.step", change)
    assert [(part.name, part.path) for part in found.parts] == [("NUT-1", ("top", "NUT")), ("NUT-2", ("top", "NUT"))]
    assert [len(part.solids) for part in found.parts] == [1, 1]
    assert found.cautions == ()


# -- materials -------------------------------------------------------------------------------------------------------


MASS = r"(\( MASS_UNIT\(\) NAMED_UNIT\(\*\) SI_UNIT\()\$"
LENGTH = r"SI_UNIT\(\.CENTI\.,\.METRE\.\)"
EXPONENTS = (r"(DERIVED_UNIT_ELEMENT\(#\d+,)3\.\)", r"\g<1>1.)"), (r"(DERIVED_UNIT_ELEMENT\(#\d+,)2\.\)", r"\g<1>-3.)")


@pytest.mark.parametrize(
    ("written", "mass", "length"),
    [
        ("7.85", "$", ".CENTI."),
        ("7850.", ".KILO.", "$"),
        ("7.85E-06", ".KILO.", ".MILLI."),
        ("7.85E-03", "$", ".MILLI."),
    ],
    ids=["g/cm3", "kg/m3", "kg/mm3", "g/mm3"],
)
def test_densities_in_any_unit(tmp_path, written, mass, length):
    """All are steel."""
    made = Drawing()
    made.product("block", box((0, 0, 0), (1, 1, 1)), ("steel", 7.85))
    changes = (
        (r"POSITIVE_RATIO_MEASURE\(7\.85\)", f"POSITIVE_RATIO_MEASURE({written})"),
        (MASS, rf"\g<1>{mass}"),
        (LENGTH, f"SI_UNIT({length},.METRE.)"),
        *EXPONENTS,
    )
    [part] = edited(made, tmp_path / "steel.step", *changes).parts
    assert part.material.name == "steel"
    assert part.material.density == pytest.approx(7.85e-3, rel=1e-12)


def test_densities_in_units_that_differ(tmp_path):
    """OCCT does not say which density has which unit: none is taken, and it is said."""
    made = Drawing()
    top = made.assembly("top")
    for name, density in (("a", 7.85), ("b", 2.7)):
        made.add(top, made.product(name, box((0, 0, 0), (1, 1, 1)), (name, density)))
    text = made.write(tmp_path / "two.step").read_text("latin-1")
    (tmp_path / "two.step").write_text(re.sub(MASS, r"\g<1>.KILO.", text, count=1), "latin-1")
    assembly = read_assembly(tmp_path / "two.step", "0" * 64, 1e-4)
    assert [part.material.density for part in assembly.parts] == [None, None]
    assert assembly.cautions[0].startswith("densities are left out")


# -- limits of size --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lower", "upper", "limits"),
    [("-1.E-02", "2.E-02", (6.09, 6.12)), ("-3.E-02", "-1.E-02", (6.07, 6.09)), ("0.", "5.E-03", (6.1, 6.105))],
)
def test_signs_of_deviations(tmp_path, lower, upper, limits):
    """Both below, both above, one of them the size itself: OCCT hands on no signs, the file has them."""
    assembly = edited(
        latch.drawing(),
        tmp_path / "latch.step",
        (r"(MEASURE_WITH_UNIT\()-1\.E-02", rf"\g<1>{lower}"),
        (r"(MEASURE_WITH_UNIT\()2\.E-02", rf"\g<1>{upper}"),
    )
    assert (assembly.limits[0].lower, assembly.limits[0].upper) == limits


def test_deviations_with_names(tmp_path):
    """Many systems write a deviation as an item of a representation."""
    item = (
        r"= ( LENGTH_MEASURE_WITH_UNIT() MEASURE_REPRESENTATION_ITEM() "
        r"MEASURE_WITH_UNIT(LENGTH_MEASURE(-3.E-02),\g<1>) REPRESENTATION_ITEM('lower bound') )"
    )
    change = (r"= MEASURE_WITH_UNIT\(-1\.E-02,(#\d+)\)", item)
    assembly = edited(latch.drawing(), tmp_path / "latch.step", change)
    assert (assembly.limits[0].lower, assembly.limits[0].upper) == (6.07, 6.12)


def test_a_lower_deviation_that_occt_has_written(tmp_path):
    """OCCT leaves the sign of the lower deviation out when it writes a file."""
    assembly = edited(latch.drawing(), tmp_path / "latch.step", (r"(MEASURE_WITH_UNIT\()-1\.E-02", r"\g<1>1.E-02"))
    assert (assembly.limits[0].lower, assembly.limits[0].upper) == (6.09, 6.12)
    other = edited(
        latch.drawing(),
        tmp_path / "other.step",
        (r"(MEASURE_WITH_UNIT\()-1\.E-02", r"\g<1>1.E-02"),
        ("'Open CASCADE STEP processor 8.0'", "'another system'"),
    )
    assert (other.limits[0].lower, other.limits[0].upper) == (6.11, 6.12)


def test_inches_that_occt_has_written(read):
    """OCCT writes the numbers of dimensions in mm also where it says that they are inches."""
    assembly = read(latch.drawing(), unit="INCH")
    assert assembly.cautions == ()
    found = sorted((limit.nominal, limit.lower, limit.upper) for limit in assembly.limits)
    np.testing.assert_allclose(found, [(6.0, 5.992, 6.0), (6.1, 6.09, 6.12)], atol=1e-9)


def test_a_dimension_that_is_not_that_of_its_face(tmp_path):
    """It is left out, and said to be: limits of 155 mm must not become those of a hole of 6 mm."""
    drawing = latch.drawing().write(tmp_path / "inch.step", unit="INCH")
    text = drawing.read_text("latin-1").replace("'Open CASCADE STEP processor 8.0'", "'another system'")
    assert "'another system'" in text
    drawing.write_text(text, "latin-1")
    assembly = read_assembly(drawing, "0" * 64, 1e-4)
    assert assembly.limits == ()
    assert len(assembly.cautions) == 2
    said = "a diameter of 154.94 mm: the face that it stands on, of crank, is drawn with 6.1 mm"
    assert assembly.cautions[0].startswith(said)


def test_limits_of_every_instance(read):
    """A dimension of a product is one of each part that it is."""
    made = Drawing()
    top = made.assembly("top")
    shape = cylinder((0.0, 0.0, 0.0), 1.0, 2.0)
    product = made.product("pin", shape)
    made.add(top, product)
    made.add(top, product, place(x=5.0))
    made.diameter(product, cylindrical(shape, 1.0)[0], 2.0, (-0.01, 0.0))
    assembly = read(made)
    assert [assembly.faces[limit.faces[0]].part for limit in assembly.limits] == ["pin-1", "pin-2"]


# -- edges -----------------------------------------------------------------------------------------------------------


def test_circles_and_arcs(read):
    """Both ends of a pin, and the quarter of a rounded corner."""
    made = Drawing()
    made.product("pin", fused(box((0, 0, 0), (9, 9, 1)), cylinder((4.0, 5.0, 1.0), 2.0, 3.0)))
    edges = sorted(read(made).edges, key=lambda edge: edge.centre[2])
    assert [edge.radius for edge in edges] == pytest.approx([2.0, 2.0], abs=1e-9)
    np.testing.assert_allclose([edge.centre for edge in edges], [[4, 5, 1], [4, 5, 4]], atol=1e-9)
    assert all(edge.span == pytest.approx(2 * pi) and len(edge.faces) == 2 for edge in edges)
    quarter = Drawing()
    quarter.product("q", BRepAlgoAPI_Common(cylinder((0, 0, 0), 3.0, 1.0), box((0, 0, -1), (5, 5, 5))).Shape())
    arcs = read(quarter).edges
    assert [edge.span for edge in arcs] == pytest.approx([pi / 2] * 2, abs=1e-9)
    np.testing.assert_allclose([edge.middle for edge in arcs], [[0.5**0.5, 0.5**0.5, 0.0]] * 2, atol=1e-9)

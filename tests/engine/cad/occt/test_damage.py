"""Entities that OCCT cannot read, by what depends on them."""

import re

import pytest

from engine.cad.occt.step_assembly import read_assembly
from tests.engine.cad.step_files import Drawing, cylinder, place

ODD = {
    "a name left out": (r"ADVANCED_FACE\(''", "ADVANCED_FACE($"),
    "the name of a place left out": (r"ITEM_DEFINED_TRANSFORMATION\(''", "ITEM_DEFINED_TRANSFORMATION($"),
    "a category of nothing": (r"(PRODUCT_RELATED_PRODUCT_CATEGORY\('part',\$,\()#\d+", r"\g<1>#9999999"),
    "degrees as they were written once": (
        r"\( NAMED_UNIT\(\*\) PLANE_ANGLE_UNIT\(\) SI_UNIT\(\$,\.RADIAN\.\) \)",
        "( CONVERSION_BASED_UNIT('RADIAN',#9000001) NAMED_UNIT(*) PLANE_ANGLE_UNIT() )",
    ),
    "a point's style": (
        "ENDSEC;\nEND-ISO",
        "#9000003=POINT_STYLE('',#9000002,POSITIVE_LENGTH_MEASURE(1.),$);\nENDSEC;\nEND-ISO",
    ),
    "a text in an unknown font": (r"(= SHAPE_REPRESENTATION\('',\()(?=#)", r"\g<1>#9000004,"),
}
NEEDED = {
    "a face": (r"(CLOSED_SHELL\('',\()#\d+", r"\g<1>#9999999"),
    "a surface": (r"(ADVANCED_FACE\('',\([^)]*\),)#\d+", r"\g<1>$"),
    "a surface that nobody knows": (r"= PLANE\(", "= PLAIN_THING("),
    "a number": (r"(CYLINDRICAL_SURFACE\('',#\d+,)[\d.E+-]+\)", r"\g<1>$)"),
    "a parameter": (r"(CYLINDRICAL_SURFACE\('',#\d+),[\d.E+-]+\)", r"\g<1>)"),
}
OTHERS = """#9000001=PLANE_ANGLE_MEASURE_WITH_UNIT(PLANE_ANGLE_MEASURE(1.),#9000005);
#9000002=PRE_DEFINED_MARKER('plus');
#9000004=TEXT_LITERAL('','a note',#9000002,'left',.RIGHT.,#9000002);
#9000005=( NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.) );
ENDSEC;
END-ISO"""


@pytest.fixture(scope="module")
def text(tmp_path_factory):
    """Return a file of a pin and a plate."""
    made = Drawing()
    top = made.assembly("top")
    for name, x in (("pin", 0.0), ("plate", 9.0)):
        made.add(top, made.product(name, cylinder((0, 0, 0), 1.0 + x, 2.0)), place(x))
    path = made.write(tmp_path_factory.mktemp("damage") / "whole.step")
    return path.read_text("latin-1").replace("ENDSEC;\nEND-ISO", OTHERS)


def changed(text, path, change):
    """Return what is read after a first match was replaced."""
    new, count = re.subn(*change, text, count=1)
    assert count
    path.write_text(new, "latin-1")
    return read_assembly(path, "0" * 64, 1e-4)


def test_what_is_odd_is_a_note(text, tmp_path):
    """Names, styles, texts and old units: all is read, and it is said how many entities are not as they should be."""
    for what, change in ODD.items():
        read = changed(text, tmp_path / "odd.step", change)
        assert (read.unreadable, read.damage, read.damaged) == (0, "", ()), what
        assert [part.solids[0].volume for part in read.parts] == pytest.approx([6.2831853, 628.31853]), what
        assert [part.placement.translation[0] for part in read.parts] == [0.0, 9.0]
        assert any("names, styles, texts, units or tolerances" in said for said in read.cautions), what


def test_a_missing_number_or_reference_is_damage(text, tmp_path):
    """Of a face; it is said of which part, and only of that one."""
    for what, change in NEEDED.items():
        read = changed(text, tmp_path / "damaged.step", change)
        assert (read.unreadable, read.damaged) == (1, ("pin",)), what
        assert "faces or placements of pin may be missing" in read.damage
        assert any("entities describe, in full or in part, of pin:" in said for said in read.cautions), what


def test_it_is_not_known_of_which_part(text, tmp_path):
    """A place or the product itself cannot be read, or a record has no end: then it may be any part."""
    for change in (
        (r"(ITEM_DEFINED_TRANSFORMATION\('','',#\d+,)#\d+", r"\g<1>#9999999"),
        (r"(PRODUCT_DEFINITION_FORMATION\('','',)#\d+", r"\g<1>$"),
        (r"= PLANE\('',#(\d+)\)", r"= PLANE('',#\1"),
    ):
        read = changed(text, tmp_path / "damaged.step", change)
        assert read.unreadable
        assert len(read.damaged) == len(read.parts)

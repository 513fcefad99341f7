"""Classes and zones that a STEP file attaches to faces, and those that break the standard."""

import re

import pytest

from engine.cad.occt import step_assembly
from engine.cad.occt.step_assembly import read_assembly
from tests.engine.cad.fits import lever

BY_OCCT = "'Open CASCADE STEP processor 8.0'"
FIT = r"LIMITS_AND_FITS\('H','hole','\d+',''\)"


def written(path, drawing, *changes, unit="MM"):
    """Return what is read of a drawing of which a program other than OCCT has written some words."""
    text = drawing.write(path, unit=unit).read_text("latin-1")
    for pattern, new in changes:
        text, count = re.subn(pattern, new, text)
        assert count, pattern
    path.write_text(text, "latin-1")
    return read_assembly(path, "0" * 64, 1e-4)


def sizes(assembly):
    return {limit.words: (limit.lower, limit.upper) for limit in assembly.limits}


def test_classes_of_iso_286(tmp_path):
    """As other programs write them, and as OCCT does, with grades two too coarse; limits by the tables."""
    assert sizes(written(tmp_path / "occt.step", lever("H7", "g6"))) == {
        "12 H7": (12.0, 12.018),
        "12 g6": (11.983, 11.994),
    }
    for fit, words, limits in (
        ("'H','hole','7',''", "12 H7", (12.0, 12.018)),
        ("'H','','7','ISO 286'", "12 H7", (12.0, 12.018)),
        ("'H','hole','IT7',''", "12 H7", (12.0, 12.018)),
        ("'JS','hole','6',''", "12 JS6", (11.9945, 12.0055)),
        ("'f','shaft','7',''", "12 f7", (11.966, 11.984)),
    ):
        read = written(tmp_path / "a.step", lever("H7", ""), (BY_OCCT, "'another'"), (FIT, f"LIMITS_AND_FITS({fit})"))
        assert sizes(read) == {words: pytest.approx(limits, abs=1e-12)}, fit
        assert read.cautions == (), fit


def test_classes_that_cannot_be_used_are_said(tmp_path):
    """One that ISO 286 does not define, one that OCCT cannot read: neither is passed over without a word."""
    for fit, said in (
        ("'H','hole','25',''", "diameter 12 H25: ISO 286 has no such class"),
        ("'H7','hole','','ISO 286-2'", "classes of tolerance that OCCT cannot read, among H7 :"),
        ("'q','shaft','7',''", "classes of tolerance that OCCT cannot read, among q 7:"),
    ):
        read = written(tmp_path / "a.step", lever("H7", ""), (BY_OCCT, "'another'"), (FIT, f"LIMITS_AND_FITS({fit})"))
        assert read.limits == (), fit
        assert [text.startswith(said) for text in read.cautions] == [True], (fit, read.cautions)
        assert len(read.parts) == 2


def test_zones(tmp_path):
    """Kind, width, (M) and datums; also in inches, which OCCT writes as if they were mm."""
    for unit in ("MM", "INCH"):
        read = written(tmp_path / "a.step", lever(width=0.1, maximum_material=True), unit=unit)
        bore = next(face.number for face in read.faces if face.hollow)
        found = {zone.words: bore in zone.faces for zone in read.zones}
        assert found == {
            "position, a cylinder of 0.1 mm (M), to A, B": True,
            "perpendicularity, a cylinder of 0.02 mm, to A": True,
            "flatness, 0.03 mm": False,
            "roundness, 0.01 mm": True,
        }, unit
    changed = r"(= DATUM\('','',#\d+,\.F\.,)'A'", r"\g<1>'A" + 90 * "x" + "'"
    read = written(tmp_path / "a.step", lever(width=0.1), changed)
    assert {len(datum) for zone in read.zones for datum in zone.datums} == {1, 20}  # a long name is cut off


def test_no_file_is_lost_because_of_its_tolerances(tmp_path, monkeypatch):
    """References that lead nowhere, and errors that nobody foresaw: the shapes are read, and it is said what is not."""
    whole = lever(width=0.1)
    for broken in (r"(PLUS_MINUS_TOLERANCE\()#\d+", r"(DIMENSIONAL_CHARACTERISTIC_REPRESENTATION\()#\d+"):
        read = written(tmp_path / "a.step", whole, (broken, r"\g<1>#9999999"))
        assert (read.damage, len(read.parts)) == ("", 2), broken
        assert any("of dimensions and tolerances: they cannot be read" in text for text in read.cautions), broken
    for what in ("size_limits", "geometric_tolerances"):
        with monkeypatch.context() as patched:
            patched.setattr(step_assembly, what, lambda *_: [][0])
            read = written(tmp_path / "a.step", whole)
        assert (read.damage, len(read.parts)) == ("", 2)
        assert any("OCCT failed to read what the file says of them (IndexError)" in text for text in read.cautions)
    read = read_assembly(tmp_path / "a.step", "0" * 64, 1e-4, tolerances=False)
    assert (read.limits, read.zones) == ((), ())
    assert any(text.startswith("all dimensions and tolerances are left out") for text in read.cautions)

"""Gaps at the start beside OCCT's distances: hinges drawn with known gaps, and files that say something else."""

import hashlib
import json

import pytest
import tomli_w

from engine import CadError, load_mechanism
from engine.cad.archive import packed
from engine.cad.occt.answers import measure_distances
from engine.cad.occt.step_assembly import read_assembly
from engine.preflight import cautions
from engine.preflight.cautions import AGREE, start_gap_cautions, with_start_gaps
from tests.engine.cad.hinges import BORE, PIN, PLAY, as_splines, cut_in_two, hinge, plate, stud
from tests.engine.cad.spline_shapes import elliptic_cam
from tests.engine.cad.step_files import Drawing, box, moved, place

OFF = 0.02  # of the axis of the hole from that of the pin


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    """Keep nothing in the user's cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture(autouse=True)
def in_this_process(tmp_path, monkeypatch):
    """Let OCCT answer here: to start a process for each question takes longer than the answer."""

    def answer(path, content, question, limits):
        if "distances" in question:
            return json.dumps(measure_distances(path, question["distances"])).encode()
        return packed(read_assembly(path, **question["assembly"]))

    monkeypatch.setattr("engine.cad.step_reader.ask_occt", answer)


@pytest.fixture
def loaded(tmp_path):
    """Return a function that draws an assembly and loads a mechanism file which names its faces."""

    def load(drawing, change=lambda tables: None, unit="MM"):
        path = tmp_path / "hinge.step"
        drawing.write(path, unit=unit)
        tables = hinge_file(path)
        change(tables)
        file = tmp_path / "hinge.toml"
        file.write_text(tomli_w.dumps(tables))
        return with_start_gaps(load_mechanism(file))

    return load


def hinge_file(path):
    """Return a file with the joint of a hinge, and the rim of its hole above the other plate."""
    return {
        "format": 1,
        "name": "hinge",
        "units": "mm-g-ms",
        "cad": {"file": path.name, "sha256": hashlib.sha256(path.read_bytes()).hexdigest()},
        "simulation": {"step": 0.1, "horizon": 20.0, "penetration": 1e-6, "rest": {"window": 1.0, "drift": 1e-5}},
        "bodies": {"plate": {"part": "plate", "density": 1e-2}, "stud": {"part": "stud", "fixed": True}},
        "joints": {
            "pin": {
                "type": "clearance_cylindrical",
                "bearing": {"body": "plate", "hole": {"radius": BORE, "near": [0.0, 0.0, 2.5]}},
                "journal": {"body": "stud", "pin": {"radius": PIN, "near": [0.0, 0.0, 4.0]}},
                "radial_clearance": "as drawn",
                "friction": 0.1,
            }
        },
        "contacts": {
            "rim": {
                "a": {"body": "plate", "arc": {"edge": {"near": [BORE, 0.0, PLAY]}}},
                "b": {"body": "stud", "plane": {"near": [10.0, 0.0, 0.0]}},
                "friction": 0.1,
            }
        },
    }


def agrees(mechanism, key, gap, within=1e-9):
    """Check both values of a gap."""
    found = mechanism.geometry.gaps[key]
    assert found.drawn == pytest.approx(gap, abs=within)
    assert found.gap - found.added == pytest.approx(gap, abs=within)
    assert abs(found.difference) <= within
    assert not [*start_gap_cautions(mechanism)]


@pytest.mark.parametrize("drawn", [lambda shape: shape, cut_in_two], ids=["whole", "cut in two"])
@pytest.mark.parametrize("unit", ["MM", "INCH"])
def test_a_hinge(loaded, drawn, unit):
    """Clearance less the offset of the axes, also where bore and pin are two halves, or the file is in inches."""
    mechanism = loaded(hinge(drawn(plate()), drawn(stud()), x=OFF), unit=unit)
    agrees(mechanism, "joints.pin", BORE - PIN - OFF)
    agrees(mechanism, "contacts.rim", PLAY)


def test_splines(loaded):
    """Where faces are recognised, the two agree to within what that has cost."""
    mechanism = loaded(hinge(as_splines(plate()), as_splines(stud()), x=OFF))
    agrees(mechanism, "joints.pin", BORE - PIN - OFF, 1e-4)


def test_a_mirrored_instance(loaded):
    """A part that stands mirrored in the assembly is measured where it stands."""
    made = Drawing()
    top = made.assembly("hinge")
    mirror = place()
    mirror.SetMirror(made.plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
    made.add(top, made.product("plate", moved(plate(), x=OFF, z=PLAY)), mirror)
    made.add(top, made.product("stud", stud()), mirror)

    def seen_from_the_part(tables):  # its frame is a proper one: z points the other way
        joint, rim = tables["joints"]["pin"], tables["contacts"]["rim"]
        joint["bearing"]["hole"]["near"][2] *= -1
        joint["journal"]["pin"]["near"][2] *= -1
        rim["a"]["arc"]["edge"]["near"][2] *= -1

    mechanism = loaded(made, seen_from_the_part)
    agrees(mechanism, "joints.pin", BORE - PIN - OFF)
    agrees(mechanism, "contacts.rim", PLAY)


def test_overlap_has_no_row(loaded):
    """Where shapes touch or overlap OCCT knows no distance: nothing is compared."""

    def sunk(tables):
        tables["contacts"]["rim"]["a"]["arc"]["edge"]["near"][2] = 0.0

    mechanism = loaded(hinge(z=0.0, x=BORE - PIN + 0.01), sunk)
    assert mechanism.geometry.gaps == {}
    assert mechanism.geometry.not_measured == ""


def test_what_the_file_adds(loaded):
    """A clearance of the file's own, and an offset, are no difference."""

    def own(tables):
        tables["joints"]["pin"]["radial_clearance"] = 0.07
        tables["contacts"]["rim"]["offset"] = 0.004

    mechanism = loaded(hinge(x=OFF), own)
    agrees(mechanism, "joints.pin", BORE - PIN - OFF)
    agrees(mechanism, "contacts.rim", PLAY)
    assert mechanism.geometry.gaps["joints.pin"].gap == pytest.approx(0.05, abs=1e-9)
    assert mechanism.geometry.gaps["contacts.rim"].gap == pytest.approx(PLAY - 0.004, abs=1e-9)


def test_a_point_that_the_file_gives(loaded):
    """Somebody has moved the pin's axis by hand: a warning with both numbers."""

    def shifted(tables):
        tables["joints"]["pin"]["journal"]["point"] = [0.0, 2 * AGREE, 2.6]

    mechanism = loaded(hinge(), shifted)
    [caution] = [caution for caution in cautions(mechanism) if caution.key == "joints.pin"]
    assert caution.value == pytest.approx(BORE - PIN - 2 * AGREE, abs=1e-9)
    assert "draws the faces 0.05 mm apart" in caution.text
    assert "rings that this file gives" in caution.remedy


def test_a_face_that_ends(loaded):
    """A point beyond the edge of a face is nearer to its plane than to the face."""

    def beyond(tables):
        tables["contacts"]["rim"]["a"] = {"body": "plate", "point": [18.0, 0.0, PLAY]}

    mechanism = loaded(hinge(), beyond)
    [caution] = start_gap_cautions(mechanism)
    assert (caution.key, caution.value) == ("contacts.rim", pytest.approx(PLAY, abs=1e-9))
    assert mechanism.geometry.gaps["contacts.rim"].drawn == pytest.approx((3.0**2 + PLAY**2) ** 0.5, abs=1e-9)
    assert "a plane is endless" in caution.remedy


def test_a_body_that_is_posed_otherwise(loaded):
    """What stands elsewhere than in the drawing is not compared with it."""

    def posed(tables):
        tables["bodies"]["plate"]["origin"] = [0.01, 0.0, 0.0]

    assert loaded(hinge(), posed).geometry.gaps == {}


def test_on_a_bench(loaded):
    """A contact of a bench starts where the bench does."""

    def with_bench(tables):
        tables["benches"] = {"press": {"contacts": {"edge": tables["contacts"].pop("rim")}}}

    mechanism = loaded(hinge(), with_bench)
    agrees(mechanism, "benches.press.contacts.edge", PLAY)
    agrees(mechanism, "joints.pin", BORE - PIN)


def test_a_reader_that_fails(loaded, monkeypatch):
    """OCCT can read the file and not measure it: the mechanism is sound, and a warning says why."""

    def fails(*_):
        raise CadError("hinge.step: OCCT crashed while it read it (SIGSEGV); export it again")

    monkeypatch.setattr("engine.mechanism.geometry.resolved_geometry.drawn_distances", fails)
    mechanism = loaded(hinge())
    assert mechanism.geometry.gaps == {}
    [caution] = start_gap_cautions(mechanism)
    assert "OCCT crashed" in str(caution)


def test_a_surface(loaded):
    """A point before the vertex of an elliptic cam, whose patches are its B-spline within what they say."""

    def cam_and_finger(tables):
        tables["bodies"] = {"cam": {"part": "cam", "fixed": True}, "finger": {"part": "finger", "density": 1e-2}}
        tables["joints"] = {}
        cam = {"faces": [{"near": [8.0, 0.0, 3.0]}], "conversion": 1e-6}
        tables["contacts"] = {
            "lift": {
                "a": {"body": "finger", "point": [8.5, 0.0, 3.0]},
                "b": {"body": "cam", "surface": cam},
                "friction": 0.1,
            }
        }

    drawing = Drawing()
    whole = drawing.assembly("whole")
    drawing.add(whole, drawing.product("cam", elliptic_cam(8.0, 5.0, 6.0)))
    drawing.add(whole, drawing.product("finger", box((8.5, -1.0, 2.0), (2.0, 2.0, 2.0))))
    mechanism = loaded(drawing, cam_and_finger)
    agrees(mechanism, "contacts.lift", 0.5, within=1e-6)
    [face] = mechanism.geometry.faces.values()
    assert abs(mechanism.geometry.gaps["contacts.lift"].difference) <= face.conversion_error

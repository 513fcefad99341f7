"""Joints beside the latch's: balls in sockets, forks, names in other alphabets, as the proposed file has them."""

import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from engine import load_mechanism
from engine.cad import read_step
from engine.cad_import.found_features import found_features
from engine.cad_import.found_geometry import find_geometry
from engine.cad_import.proposed_mechanism import proposed_mechanism, unloaded_directions
from engine.cad_import.proposed_text import questions_of_file
from tests.engine.cad.ball_joints import BALL, SOCKET, ball_joint, cup, stem
from tests.engine.cad.hinges import BORE, PIN, hinge, plate, stud
from tests.engine.cad.step_files import box, cut, cylinder, fused

pytestmark = pytest.mark.processes


def proposal(drawing, folder, **how):
    """Write and read a drawing; return what is found in it, and the path of its mechanism file."""
    step = drawing.write(folder / "drawn.step", **how)
    found = find_geometry(read_step(step))
    path = folder / "drawn.toml"
    path.write_text(proposed_mechanism(found, "drawn.step", "drawn"), "utf-8")
    return found, path


def asked(path):
    """Return what the questions of a file are about."""
    return [question.text.partition(":")[0] for question in questions_of_file(path)]


@pytest.mark.slow
@pytest.mark.parametrize("unit", ["MM", "M"])
def test_a_ball_joint(tmp_path, unit):
    """Its centre is in the frames of both parts; radius and clearance are those of the drawing."""
    found, path = proposal(ball_joint(cup(2.0), stem(), x=0.01), tmp_path, unit=unit)
    text = path.read_text("utf-8")
    path.write_text(text.replace("# fixed = true", "fixed = true").replace("# density", "density"), "utf-8")
    joint = load_mechanism(path).joints["stem-cup"]
    assert joint.type == "clearance_spherical"
    assert (joint.socket.body, joint.ball.body) == ("cup", "stem")
    assert (joint.ball.radius, joint.radial_clearance) == pytest.approx((BALL, SOCKET - BALL), abs=1e-9)
    np.testing.assert_allclose([joint.socket.point, joint.ball.point], [[0, 0, 0], [0.01, 0, 0]], atol=1e-9)
    assert not any(each.startswith("joints") for each in asked(path))
    assert (
        len(unloaded_directions(found, text).motions) == 3
    )  # a ball in its play turns about three axes, and slides in it
    [place] = found_features(found)
    assert place.text == "joint stem-cup: ball of stem in cup, radii 5.03 and 5, clearance 0.03 mm"


@pytest.mark.slow
def test_a_ball_as_large_as_its_socket(tmp_path):
    """Its clearance is a question, and so is an overlap."""
    _, path = proposal(ball_joint(cup(2.0, BALL), stem(), x=0.05), tmp_path)
    assert asked(path)[-4:] == ["joints.stem-cup.radial_clearance", "joints.stem-cup", "loads", "responses"]
    assert "ball and socket overlap by 0.05 mm as posed" in path.read_text("utf-8")


def test_a_fork(tmp_path):
    """A pin can leave a hole that is open to one side: a question, where half of the hole is there."""
    fork = cut(plate(), box((0.0, -BORE, -1.0), (20.0, 2 * BORE, 10.0)))
    _, path = proposal(hinge(fork), tmp_path)
    assert "only 180 degrees of the hole are there; a joint holds its pin all round" in path.read_text("utf-8")
    _, whole = proposal(hinge(), tmp_path)
    assert "degrees of the hole" not in whole.read_text("utf-8")


def test_a_pin_that_is_pressed_in(tmp_path):
    """The question about its clearance says what to write in its place, and that loads."""
    _, path = proposal(hinge(plate(PIN, (2.0, 1.0)), stud(PIN), x=-2.0, y=-1.0), tmp_path)
    [said] = [each.text for each in questions_of_file(path) if "radial_clearance" in each.text]
    kind, a, b = re.search(r'(type = "fixed"), (a = .*) and (b = .*), and nothing else', said).groups()
    text = path.read_text("utf-8")
    text = text.replace("# fixed = true", "fixed = true").replace("# density", "density").partition("[joints")[0]
    path.write_text("\n".join([text, "[joints.press]", kind, a, b]), "utf-8")
    joint = load_mechanism(path).joints["press"]
    assert (joint.type, joint.a.body, joint.b.body) == ("fixed", "plate", "stud")
    assert not questions_of_file(path)[-1].text.startswith("joints")


@pytest.mark.slow
@pytest.mark.parametrize("unit", ["INCH", "M"])
def test_equal_radii_do_not_overlap_by_a_last_digit(tmp_path, unit):
    """Neither clearance nor overlap is made of what the unit of the file rounds; numbers are written without it."""
    _, path = proposal(hinge(plate(PIN), stud(PIN)), tmp_path, unit=unit)
    text = path.read_text("utf-8")
    assert "overlap" not in text
    flanges = tomllib.loads(text)["joints"]["stud-plate"]["flanges"]
    assert flanges["ends"] == [-2.5, 2.5]
    assert flanges["radius"] == round(flanges["radius"], 9)


@pytest.mark.slow
def test_names_in_other_alphabets(tmp_path):
    """Letters with marks become letters; what has no letter of its own is a part with a number."""
    names = ("Fl\N{LATIN SMALL LETTER U WITH DIAERESIS}gel", "\N{CJK UNIFIED IDEOGRAPH-8EF8}")
    found, path = proposal(hinge(names=names), tmp_path)
    assert found.bodies == {names[0]: "Flugel", names[1]: "part"}
    assert list(tomllib.loads(path.read_text("utf-8"))["joints"]) == ["part-Flugel"]


def test_letters_that_have_no_marks_of_their_own(tmp_path):
    """A sharp s and letters with a stroke or in one are written with plain letters."""
    sharp, stroke = "\N{LATIN SMALL LETTER SHARP S}", "\N{LATIN SMALL LETTER O WITH STROKE}"
    names = (f"gro{sharp}er Hebel", f"k{stroke}l \N{LATIN CAPITAL LETTER AE}")
    found, _ = proposal(hinge(names=names), tmp_path)
    assert list(found.bodies.values()) == ["grosser-Hebel", "kol-Ae"]


@pytest.mark.slow
def test_long_names_are_cut_off(tmp_path):
    """Two parts whose long names begin alike have different names, and a joint that names both."""
    found, path = proposal(hinge(names=("x" * 300 + "a", "x" * 300 + "b")), tmp_path)
    first, second = found.bodies.values()
    assert (first, second) == ("x" * 40, "x" * 40 + "-2")
    assert list(tomllib.loads(path.read_text("utf-8"))["joints"]) == [f"{second}-{first}"]


def test_a_stepped_pin_says_which_clearance_its_joint_has(tmp_path):
    """Its joint has one clearance, the least that is drawn: both radii are printed, and what the other would be."""
    lever = cut(
        box((-15.0, -10.0, 0.0), (30.0, 20.0, 9.0)), cylinder((0, 0, -1), 3.04, 6), cylinder((0, 0, 4), 2.03, 9)
    )
    pin = fused(stud(3.0, 4.9), cylinder((0.0, 0.0, 4.9), 2.0, 5.0))
    found, path = proposal(hinge(lever, pin), tmp_path)
    place = found_features(found)[0]
    assert place.radii == "radii 3.04 and 3, 2.03 and 2"
    assert place.sizes.startswith("clearance 0.03 (the least of 0.04 and 0.03, for all rings), axial play")
    lines = path.read_text("utf-8").splitlines()
    assert any(each.startswith("radial_clearance = 0.03 ") and "the least of 0.04 and 0.03" in each for each in lines)


@pytest.mark.slow
def test_a_loose_pin_says_what_to_write(tmp_path):
    """Hole and pin of a joint that is not proposed, as a person can write them."""
    found, path = proposal(hinge(plate(3.5)), tmp_path)
    [said] = [place.sizes for place in found_features(found) if place.kind == "no joint"]
    bearing, journal = re.search("write one with (bearing = .*), (journal = .*)", said).groups()
    text = path.read_text("utf-8").replace("# fixed = true", "fixed = true").replace("# density", "density")
    joint = ["[joints.loose]", 'type = "clearance_cylindrical"', bearing, journal, 'radial_clearance = "as drawn"']
    path.write_text("\n".join([text, *joint, 'material = "contact"']), "utf-8")
    assert load_mechanism(path).joints["loose"].radial_clearance == pytest.approx(0.5, abs=1e-9)


def test_a_file_without_stops_names_none(tmp_path):
    """The example of a response says that a name is missing."""
    found, _ = proposal(hinge(), tmp_path)
    assert '# contact = "NAME"' in proposed_mechanism(replace(found, stops=()), "drawn.step", "drawn")

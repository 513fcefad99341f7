"""What was found, each with its place: names and radii are those of the proposed file, places those of the faces."""

import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from engine.cad_import.found_features import found_features, part_text
from engine.cad_import.found_geometry import find_geometry
from engine.cad_import.proposed_mechanism import proposed_mechanism

pytestmark = pytest.mark.processes


@pytest.fixture
def places(latch):
    return found_features(latch)


def test_names_are_those_of_the_file(latch, places):
    """Joints and candidates are called and numbered as in the mechanism file, marked tables too."""
    text = proposed_mechanism(latch, "latch.step", "latch")
    tables = re.findall(r"^(?:# )?\[(joints|contacts)\.([\w-]+)\]", text, re.M)
    kinds = {"joint": "joints", "facing": "contacts"}
    assert [(kinds[place.kind], place.name) for place in places] == tables
    assert len(tables) == 5


def test_joints_are_where_the_file_says(latch, places):
    """Radii and the middle of the hole are those of its table."""
    joints = tomllib.loads(proposed_mechanism(latch, "latch.step", "latch"))["joints"]
    for place in places[:4]:
        hole, pin = joints[place.name]["bearing"]["hole"], joints[place.name]["journal"]["pin"]
        assert place.radius == pytest.approx(hole["radius"], abs=1e-9)
        assert place.radii == f"radii {hole['radius']:g} and {pin['radius']:g}"
        np.testing.assert_allclose(latch.to_body(place.parts[1], place.middle), hole["near"], atol=0.06)
        kinds = [(latch.face(number).kind, latch.face(number).hollow) for number in place.faces]
        assert kinds == [("cylinder", True), ("cylinder", False)]


def test_a_stop_is_between_its_faces(latch, places):
    """Its ends lie on the two planes, and are the gap apart."""
    [stop] = places[4:]
    first, second = (latch.face(number) for number in stop.faces)
    for face, end in zip((first, second), stop.ends, strict=True):
        assert (end - face.point) @ face.axis == pytest.approx(0.0, abs=1e-9)
    assert np.linalg.norm(stop.ends[1] - stop.ends[0]) == pytest.approx(0.8, abs=1e-9)
    assert stop.text == "facing stop-1: base and crank, 0.8 mm apart, 34.65 mm2 face each other"
    assert (first.part, second.part) == stop.parts


def test_what_is_no_joint_is_numbered(latch):
    """A pin that is too large for its hole, with the reason."""
    faces = [
        replace(face, radius=3.2) if face.radius == pytest.approx(3.0) and not face.hollow else face
        for face in latch.assembly.faces
    ]
    places = found_features(find_geometry(replace(latch.assembly, faces=tuple(faces))))
    refused = [place for place in places if place.kind == "no joint"]
    assert [place.name for place in refused] == ["1", "2"]
    assert refused[0].text.startswith("no joint 1: pin of base in crank, the pin is 0.15 mm larger in radius")
    assert {place.name for place in places if place.kind == "joint"} == {"crank-coupler", "rocker-coupler"}


def test_parts(latch):
    """Volume and material, or that there is none."""
    base = latch.assembly.parts[0]
    assert part_text(base) == "part base: 11070 mm3, steel"
    assert part_text(replace(base, material=None)).endswith(", no material")


def test_no_play_has_no_sign(latch):
    """A difference of two equal numbers is 0, not a little less."""
    joint = latch.joints[0]
    flanges = tuple(replace(flange, play=-1e-15) for flange in joint.flanges)
    place = found_features(replace(latch, joints=(replace(joint, flanges=flanges),)))[0]
    assert place.sizes.endswith("axial play 0, 0 mm")

"""The latch of the docs, from its STEP file to a mechanism: what is found, what is asked, what loads."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from engine import MechanismError, check, load_mechanism
from engine.cad_import.found_geometry import find_geometry
from engine.cad_import.proposed_mechanism import UnloadedMotions, proposed_mechanism, unloaded_directions
from engine.cad_import.proposed_text import open_questions, questions_of_file
from tests.engine.mechanism.geometry.latch_file import LATCH

pytestmark = pytest.mark.processes


def written(folder, found):
    """Return the path of the proposed file."""
    path = folder / "latch.toml"
    path.write_text(proposed_mechanism(found, str(LATCH), "latch"))
    return path


def answered(text):
    """Return the file of somebody who removes all marks, and questions."""
    lines = (line for line in text.splitlines() if not line.startswith("#?"))
    bare = [line.removeprefix("# ") if " = " in line or line.startswith("# [") else line for line in lines]
    return "\n".join(bare).replace('"NAME"', '"crank"').replace("[0.0, 0.0, 10.0]", "[0.0, 0.0, -10.0]")


def all_but(found, **changes):
    """Return the latch found again, with another material or other parts."""
    return find_geometry(replace(found.assembly, **changes))


def test_the_proposal_loads(latch, tmp_path):
    """It is sound as it stands, with the joints of the drawing."""
    path = written(tmp_path, latch)
    mechanism = load_mechanism(path)
    clearances = {name: joint.radial_clearance for name, joint in mechanism.joints.items()}
    assert clearances == pytest.approx(
        {"base-crank": 0.05, "base-rocker": 0.06, "crank-coupler": 0.04, "rocker-coupler": 0.05}, abs=1e-9
    )
    for joint in mechanism.joints.values():
        assert joint.axial_clearance == pytest.approx(0.05, abs=1e-9)
        assert joint.flanges.ends[1] - joint.flanges.ends[0] == pytest.approx(5.0, abs=1e-9)
    assert mechanism.parameters == {"base_crank_hole": 6.1, "base_crank_pin": 6.0}
    assert not any(body.fixed for body in mechanism.bodies.values())
    asked = [question.text.partition(":")[0] for question in questions_of_file(path)]
    assert asked == ["gravity", "materials.contact.friction", "bodies", "contacts", "loads", "responses"]
    assert "axial play along [0, 0, 1]" in path.read_text()


@pytest.mark.slow
def test_all_answered(latch, tmp_path):
    """Whoever removes the marks has a mechanism that can start, with the stop 0.8 mm away."""
    path = written(tmp_path, latch)
    path.write_text(answered(path.read_text()))
    mechanism = load_mechanism(path)
    check(mechanism)
    assert questions_of_file(path) == []
    assert mechanism.bodies["base"].fixed
    stop = mechanism.contacts["stop-1"]
    crank = stop.a.point
    assert -crank[1] + 0.8 == pytest.approx(stop.b.plane.point[0], abs=1e-9)
    assert mechanism.gravity[2] < 0


def test_what_nothing_acts_on(latch):
    """A four-bar with play has as many free motions as bars that float along their pins, and its swing."""
    motions = unloaded_directions(latch, proposed_mechanism(latch, "latch.step", "latch"))
    assert sorted(motion.partition(", ")[0] for motion in motions.motions) == [
        "coupler along x",
        "coupler along z",
        "crank along z",
        "rocker along z",
    ]
    question = proposed_mechanism(latch, "latch.step", "latch", motions).partition("#? loads: ")[2].splitlines()[0]
    assert "; crank along z, the axis of base-crank and crank-coupler;" in question


def test_many_motions_are_folded(latch):
    """The question names a body that nothing holds once, and of many motions the first eight."""
    ways = [f"{way} {axis}" for way in ("along", "about") for axis in "xyz"]
    motions = (*(f"crank {way}" for way in ways), *(f"rocker about ({i}, 0, 1)" for i in range(20)))
    text = proposed_mechanism(latch, "latch.step", "latch", UnloadedMotions(motions))
    [line] = [line for line in text.splitlines() if line.startswith("#? loads")]
    said = line.partition("acts yet on ")[2].partition(": what is")[0].split("; ")
    assert said == ["crank in all directions", *motions[6:13], "and 13 more"]


def test_what_cannot_start_as_drawn(latch):
    """Parts of which nobody knows how they move: no motion is named."""
    text = proposed_mechanism(latch, "latch.step", "latch").replace("radius = 3.05", "radius = 3.5")
    assert unloaded_directions(latch, text).motions == ()
    assert "cannot start" in unloaded_directions(latch, text).unseen


def test_a_search_that_is_ended(latch):
    """What was found is asked about, and it is said that there may be more; so it is where nothing was sought."""
    text = proposed_mechanism(latch, "latch.step", "latch")
    some = unloaded_directions(latch, text, seconds=-1.0)
    assert len(some.motions) == 1
    assert "the search for others was ended" in proposed_mechanism(latch, "latch.step", "latch", some)
    none = unloaded_directions(all_but(latch, parts=11 * latch.assembly.parts), text)
    assert none.motions == ()
    assert "not looked for among 44 parts" in proposed_mechanism(latch, "latch.step", "latch", none)


def test_missing_densities(latch, tmp_path):
    """Parts without a density are asked for in one question; without an answer nothing loads."""
    parts = tuple(replace(part, material=None) for part in latch.assembly.parts)
    path = written(tmp_path, all_but(latch, parts=parts))
    [asked] = [question.text for question in questions_of_file(path) if ".density" in question.text]
    assert asked.startswith("cad.density: the CAD file has no density of base, crank, rocker, coupler")
    assert len(unloaded_directions(all_but(latch, parts=parts), path.read_text()).motions) == 4


def test_equal_radii(latch, tmp_path):
    """Pins as large as their holes: a question for each, and no clearance until it is answered."""
    holes = {6: 3.05, 7: 3.06}
    faces = tuple(
        replace(face, radius=holes.get(face.number, face.radius) if face.part == "base" else face.radius)
        for face in latch.assembly.faces
    )
    found = all_but(latch, faces=faces, limits=())
    path = written(tmp_path, found)
    asked = [question.text for question in questions_of_file(path) if "radial_clearance" in question.text]
    assert len(asked) == 2
    assert len(unloaded_directions(found, path.read_text()).motions) == 4
    assert "both drawn with radius 3.05 mm" in asked[0]
    assert "# radial_clearance" in path.read_text()
    with pytest.raises(MechanismError, match=r"joints\.base-crank\.radial_clearance"):
        load_without_cad(found)


def test_many_equal_radii(latch):
    """What three or more joints lack is asked once, as a parameter of all; its answer is that of each."""
    pins = {joint.pin.seats[0].pin: joint.pin.seats[0].hole_radius for joint in latch.joints}
    faces = tuple(replace(face, radius=pins.get(face.number, face.radius)) for face in latch.assembly.faces)
    found = all_but(latch, faces=faces, limits=())
    text = proposed_mechanism(found, "x.step", "latch")
    [asked] = [question.text for question in open_questions(text) if "clearance" in question.text]
    assert asked.startswith("parameters: which radial clearance of base-crank, base-rocker, crank-coupler")
    assert len(unloaded_directions(found, text).motions) == 4
    tables = tomllib.loads(text.replace("# radial_play = 0.02", "radial_play = 0.03"))
    assert tables["parameters"] == {"radial_play": 0.03}
    assert [joint["radial_clearance"] for joint in tables["joints"].values()] == ["radial_play"] * 4


def load_without_cad(found):
    """Check the joints of a proposal; its faces are not in the CAD file."""
    from engine.mechanism import mechanism_from

    tables = tomllib.loads(proposed_mechanism(found, "x.step", "latch"))
    del tables["cad"]
    tables["bodies"] = {name: {"fixed": True} for name in tables["bodies"]}
    tables["bodies"]["base"] = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}
    for joint in tables["joints"].values():
        for side, kind in (("bearing", "hole"), ("journal", "pin")):
            selector = joint[side].pop(kind)
            joint[side] |= {"point": selector["near"], "axis": [0, 0, 1]}
            joint[side] |= {"radius": selector["radius"]} if kind == "pin" else {}
        joint["rings"] = [-2.0, 2.0]
        if joint.get("radial_clearance") == "as drawn":
            joint["radial_clearance"] = 0.05
    return mechanism_from(tables, "latch")


@pytest.mark.parametrize(("shift", "end"), [(0.02, 0.05), (-0.05, 0.05)])
def test_unequal_play(latch, tmp_path, shift, end):
    """A crank that is drawn nearer to one flange: the mean play, and a pin that starts off the middle."""
    assembly = latch.assembly
    move = np.array([0.0, 0.0, shift])
    faces = tuple(
        replace(face, point=face.point + move, on=face.on + move) if face.part == "coupler" else face
        for face in assembly.faces
    )
    meshes = tuple(
        replace(mesh, vertices=mesh.vertices + move) if mesh.part == "coupler" else mesh for mesh in assembly.meshes
    )
    found = all_but(latch, faces=faces, meshes=meshes)
    tables = tomllib.loads(proposed_mechanism(found, str(LATCH), "latch"))
    joint = tables["joints"]["crank-coupler"]
    assert joint["axial_clearance"] == pytest.approx(end, abs=1e-9)
    bearing = 7.6 + shift  # the middle of the coupler's hole, in the assembly
    assert joint["journal"]["point"][2] + 0.05 == pytest.approx(bearing - shift, abs=1e-6)


def test_hostile_names(latch, tmp_path):
    """Names of a CAD file are quoted, and become names that a mechanism file can have."""
    odd = 'cr"ank\n[bodies.x]\n\\ \x07'
    parts = tuple(replace(p, name=odd, path=(odd,)) if p.name == "crank" else p for p in latch.assembly.parts)
    faces = tuple(replace(face, part=odd) if face.part == "crank" else face for face in latch.assembly.faces)
    meshes = tuple(replace(mesh, part=odd) if mesh.part == "crank" else mesh for mesh in latch.assembly.meshes)
    tables = tomllib.loads(proposed_mechanism(all_but(latch, parts=parts, faces=faces, meshes=meshes), odd, "latch"))
    assert tables["cad"]["file"] == odd
    assert tables["bodies"]["cr-ank-bodies-x"]["part"] == odd
    assert len(tables["joints"]) == 4


def test_questions_are_lines():
    """A question is a line that begins with its mark; others are comments."""
    found = open_questions("a = 1  #? b\n  #? c: why?\n# d\n")
    assert [(each.line, each.text) for each in found] == [(2, "c: why?")]
    assert questions_of_file("c60") == []
    assert questions_of_file("none.toml") == []
    assert questions_of_file("\0") == []


def test_names_in_other_letters(latch):
    """Body names are ASCII: letters of kana, Hangul and Greek become their sounds; what has none is numbered."""
    texts = {
        "\u30ec\u30d0\u30fc": "reba",  # katakana, with a long vowel
        "\uff8c\uff9a\uff70\uff91": "huremu",  # the same of half width
        "\u304c\u30fc\u3069 2": "gado-2",  # hiragana with voiced marks
        "\uae30\uc5b4": "gieo",
        "\u03b1-Blech": "alpha-Blech",
        "Geh\u00e4use (24)-2": "Gehause-24-2",
        "\u722a": "part",
        "\u53f0\u5ea7": "part-2",
    }
    parts = tuple(replace(latch.assembly.parts[0], name=text) for text in texts)
    meshes = tuple(replace(latch.assembly.meshes[0], part=text) for text in texts)
    assert all_but(latch, parts=parts, meshes=meshes, faces=(), edges=(), limits=(), zones=()).bodies == texts

"""Answers that the page writes into the text of a mechanism file, run by node, and read as TOML."""

import json
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

from engine.cad_import.proposed_groups import listed_groups
from engine.cad_import.proposed_mechanism import proposed_mechanism
from engine.cad_import.proposed_text import open_questions

NODE = shutil.which("node")
pytestmark = [pytest.mark.processes, pytest.mark.skipif(NODE is None, reason="no node on this machine")]
SCRIPT = Path(__file__).parents[3] / "clearcap/import_page/static/mechanism_text.js"
GROUPED = """\
format = 1
# a comment of its owner
gravity = [0.0, 0.0, -1.0]           # mm/ms2

[groups]
foot = ["foot", "co\\"ver"]           # by touching faces
"left arm" = ['x', "arm"]
[bodies.foot]
parts = ["foot", "co\\"ver"]
[bodies.weight]
part = "weight" # alone
[bodies.pin-1]
part = "pin 1"
density = 2.0
"""


@pytest.fixture(scope="module")
def proposed(latch):
    return proposed_mechanism(latch, "latch.step", "latch")


def made(text, expression):
    """Return what an expression of JavaScript makes of a text."""
    code = f"{SCRIPT.read_text()}; const t = {json.dumps(text)}, m = mechanismText;"
    code += f"process.stdout.write(JSON.stringify({expression}))"
    ran = subprocess.run([NODE, "-e", code], capture_output=True, text=True, timeout=600)
    assert ran.returncode == 0, ran.stderr
    return json.loads(ran.stdout)


def abouts(text):
    """Return what the open questions of a text are about."""
    return [question.text.partition(":")[0] for question in open_questions(text)]


def test_answers_are_in_the_file_and_their_questions_are_not(proposed):
    """All else is as proposed, line by line."""
    text = made(
        proposed,
        "m.answered(m.withFixed(m.withGravity(t, [0, -1, 0]), 'rocker', true), 'materials.contact', 'friction', '0.12',"
        " 'materials.contact.friction')",
    )
    before, after = tomllib.loads(proposed), tomllib.loads(text)
    assert after["gravity"] == [0.0, -9.81e-3, 0.0]
    assert after["bodies"]["rocker"] == before["bodies"]["rocker"] | {"fixed": True}
    assert after["materials"]["contact"] == {"friction": 0.12}
    assert [name for name, body in after["bodies"].items() if "fixed" in body] == ["rocker"]
    rest = {"gravity", "bodies", "materials"}
    assert {k: v for k, v in after.items() if k not in rest} == {k: v for k, v in before.items() if k not in rest}
    gone = ["gravity", "materials.contact.friction", "bodies"]
    assert abouts(text) == [each for each in abouts(proposed) if each not in gone]
    assert "# fixed = true" not in text
    assert [line for line in text.splitlines() if "mm/ms2" in line] == ["gravity = [0.0, -0.00981, 0.0]       # mm/ms2"]


def test_an_answer_is_changed_and_withdrawn(proposed):
    """The last one counts; a body may move again."""
    text = made(proposed, "m.withGravity(m.withGravity(t, [0, 0, -1]), [0.6, 0.8, 0])")
    assert tomllib.loads(text)["gravity"] == pytest.approx([0.6 * 9.81e-3, 0.8 * 9.81e-3, 0.0], rel=1e-8)
    text = made(proposed, "m.withFixed(m.withFixed(t, 'base', true), 'base', false)")
    assert not any("fixed" in body for body in tomllib.loads(text)["bodies"].values())
    assert made('units = "SI"\n[cad]\n', "m.withGravity(t, [0, 0, -1])").startswith("gravity = [0.0, 0.0, -9.81]\n")


@pytest.mark.parametrize(("word", "value"), [("POM", "POM"), ("1.2e-3", 1.2e-3), ('a "b', 'a "b')])
def test_a_density_is_a_number_or_a_material(proposed, word, value):
    """In the table of the CAD file, and of a body."""
    text = made(proposed, f"m.answered(t, 'bodies.crank', 'density', m.numberOrText({json.dumps(word)}), '')")
    assert tomllib.loads(text)["bodies"]["crank"]["density"] == value
    text = made("[cad]\n#? cad.density: which?\n# density = \"steel\"\n\n[x]\n",
                f"m.answered(t, 'cad', 'density', m.numberOrText({json.dumps(word)}), 'cad.density')")  # fmt: skip
    assert tomllib.loads(text) == {"cad": {"density": value}, "x": {}}
    assert open_questions(text) == []


def test_a_question_about_two_lines_stays_until_both_are_answered():
    """As that about radial and axial play."""
    text = "[parameters]\n#? parameters: which?\n# radial_play = 0.02   # mm\n# axial_play = 0.05   # mm\n\n[cad]\n"
    once = made(text, "m.answered(t, 'parameters', 'radial_play', '0.03', 'parameters')")
    assert (tomllib.loads(once)["parameters"], abouts(once)) == ({"radial_play": 0.03}, ["parameters"])
    twice = made(once, "m.answered(t, 'parameters', 'axial_play', '0.04', 'parameters')")
    assert (tomllib.loads(twice)["parameters"], abouts(twice)) == ({"radial_play": 0.03, "axial_play": 0.04}, [])


def test_bodies_are_joined_and_taken_apart():
    """Groups are those that an update reads; texts with quotes and spaces stay what they are."""
    assert made(GROUPED, "m.bodies(t)") == ["foot", "weight", "pin-1"]
    text = made(GROUPED, "m.regrouped(t, 'weight', 'pin-1')")
    assert {group.name: group.parts for group in listed_groups(text)} == {
        "foot": ("foot", 'co"ver'),
        "left arm": ("x", "arm"),
        "weight": ("weight", "pin 1"),
    }
    text = made(GROUPED, "m.regrouped(t, 'pin-1', 'foot')")
    assert [set(group.parts) for group in listed_groups(text)] == [{"foot", 'co"ver', "pin 1"}, {"x", "arm"}]
    text = made(GROUPED, "m.regrouped(t, 'foot')")
    assert [group.name for group in listed_groups(text)] == ["left arm"]
    alone = made(GROUPED.replace("[groups]", "[responses]"), "m.regrouped(t, 'pin-1', 'weight')")
    assert [(group.name, group.parts) for group in listed_groups(alone)] == [("pin 1", ("pin 1", "weight"))]


def test_comments_of_the_owner_stay():
    """Also behind the value that is replaced."""
    text = made(GROUPED, "m.answered(m.withGravity(t, [1, 0, 0]), 'bodies.pin-1', 'density', '3.0', '')")
    assert "# a comment of its owner\ngravity = [0.00981, 0.0, 0.0]        # mm/ms2\n" in text
    assert text.replace("density = 3.0", "density = 2.0").splitlines()[3:] == GROUPED.splitlines()[3:]
    assert made(GROUPED, "m.read(t, 'bodies.weight', 'part')") == '"weight"'

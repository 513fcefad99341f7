"""A new revision of the CAD file: what moved follows, what a person wrote stays."""

from dataclasses import replace

import numpy as np
import pytest

from engine import CadError, MechanismError
from engine.cad_import.found_geometry import find_geometry
from engine.cad_import.proposed_mechanism import proposed_mechanism
from engine.cad_import.updated_proposal import earlier_revision, updated_proposal
from tests.engine.mechanism.geometry.latch_file import LATCH

pytestmark = pytest.mark.processes


def proposed(assembly):
    return proposed_mechanism(find_geometry(assembly), "latch.step", "latch")


def revised(assembly):
    """Return the latch with a larger bore in the rocker, and with the block of the stop 0.1 mm nearer."""
    move = np.array([-0.1, 0.0, 0.0])
    changed = []
    for face in assembly.faces:
        if face.part == "rocker" and face.hollow and face.kind == "cylinder":
            face = replace(face, radius=3.07)
        if face.part == "base" and face.kind == "plane" and abs(face.point[0] - 7.8) < 1e-6 and face.axis[0] < -0.5:
            face = replace(face, point=face.point + move, on=face.on + move)
        changed.append(face)
    moved = [f.number for f, old in zip(changed, assembly.faces, strict=True) if f.kind == "plane" and f is not old]
    meshes = tuple(_moved(mesh, moved, move) for mesh in assembly.meshes)
    return replace(assembly, sha256="f" * 64, faces=tuple(changed), meshes=meshes)


def _moved(mesh, numbers, move):
    rows = np.unique(mesh.triangles[np.isin(mesh.faces, numbers)])
    vertices = mesh.vertices.copy()
    vertices[rows] += move
    return replace(mesh, vertices=vertices)


def test_what_moved_follows(latch):
    """Radius, place and SHA-256 follow, with and without a mark; answers stay."""
    before, after = proposed(latch.assembly), proposed(revised(latch.assembly))
    text = before.replace("# fixed = true", "fixed = true").replace("friction = 0.0", "friction = 0.17")
    updated = updated_proposal(text, before, after)
    assert (updated.kept, updated.gone, updated.added) == ([], [], [])
    assert "radius = 3.07, near" in updated.text
    assert "near = [7.7, " in updated.text
    assert f'sha256 = "{"f" * 64}"' in updated.text
    assert "friction = 0.17" in updated.text
    assert "\nfixed = true\n" in updated.text
    assert len(updated.text.splitlines()) == len(text.splitlines())


def test_a_clearance_as_drawn(latch):
    """Its key stays, and the number beside it follows; a number of the person's own stays with what is beside it."""
    before, after = proposed(latch.assembly), proposed(revised(latch.assembly))
    line = 'radial_clearance = "as drawn"        # 0.05\n'
    assert line in before
    updated = updated_proposal(before, before, after)
    assert line.replace("0.05", "0.07") in updated.text
    own = before.replace(line, "radial_clearance = 0.08  # measured\n")
    kept = updated_proposal(own, before, after)
    assert "radial_clearance = 0.08  # measured\n" in kept.text
    assert kept.kept == []


@pytest.mark.slow
def test_without_its_mark(latch):
    """A stop that the person has taken over follows too, and keeps having no mark."""
    before, after = proposed(latch.assembly), proposed(revised(latch.assembly))
    text = before.replace("# [contacts", "[contacts").replace("# a = ", "a = ").replace("# b = ", "b = ")
    updated = updated_proposal(text, before, after).text
    assert 'b = { body = "base", plane = { near = [7.7, ' in updated
    assert "\n# b = " not in updated


def test_own_values_stay(latch):
    """Where a person wrote something else, it stays and is named."""
    before, after = proposed(latch.assembly), proposed(revised(latch.assembly))
    line = next(line for line in before.splitlines() if "radius = 3.06" in line)
    own = line.replace("near = ", "within = 0.2, near = ")
    updated = updated_proposal(before.replace(line, own), before, after)
    assert own in updated.text
    assert [text.partition(":")[0] for text in updated.kept] == ["joints.base-rocker.bearing"]


def test_parts_come_and_go(latch):
    """A joint that is new is added, one that is gone is named and stays."""
    less = proposed(replace(latch.assembly, faces=tuple(f for f in latch.assembly.faces if f.part != "coupler")))
    more = proposed(latch.assembly)
    added = updated_proposal(less, less, more)
    assert {"[joints.crank-coupler]", "[joints.rocker-coupler]"} <= set(added.added)
    assert "[joints.rocker-coupler]\ntype" in added.text
    gone = updated_proposal(more, more, less)
    assert "[joints.crank-coupler]" in gone.gone
    assert "[joints.crank-coupler]" in gone.text


def with_bore(assembly, radius):
    """Return the latch with another bore of the rocker on the base."""
    bores = [f for f in assembly.faces if f.part == "rocker" and f.hollow and f.kind == "cylinder"]
    faces = tuple(replace(face, radius=radius) if face in bores else face for face in assembly.faces)
    return replace(assembly, faces=faces)


def test_a_clearance_that_is_drawn_no_more(latch):
    """It becomes a question, never a number; and none again where it is drawn, unless it has been answered."""
    drawn, equal = proposed(latch.assembly), proposed(with_bore(latch.assembly, 3.0))
    text = updated_proposal(drawn, drawn, equal).text
    asked = "#? joints.base-rocker.radial_clearance: pin and hole are both drawn"
    assert text.count(asked) == 1
    assert "\n# radial_clearance = 0.02\n" in text
    assert "\nradial_clearance = 0.02" not in text
    assert updated_proposal(text, equal, drawn).text == drawn
    answered = "".join(line for line in text.splitlines(True) if not line.startswith(asked))
    answered = answered.replace("# radial_clearance = 0.02", "radial_clearance = 0.02")
    back = updated_proposal(answered, equal, drawn)
    assert "\nradial_clearance = 0.02\n" in back.text
    assert [each.partition(":")[0] for each in back.kept] == ["joints.base-rocker.radial_clearance"]


HELD = """\
[joints.J]
type = "clearance_revolute"
flanges = { radius = 5.0 }
#? joints.J.axial_clearance: drawn without axial play; which play do the tolerances leave at each end?
# axial_clearance = 0.05
material = "contact"
"""
FREE = """\
[joints.J]
type = "clearance_cylindrical"
#? joints.J: nothing was found that holds it along its axis; if something does, say so
material = "contact"
"""


def test_keys_and_questions_come_and_go():
    """All that one revision proposes more, or less, in a table that both have."""
    assert updated_proposal(HELD, HELD, FREE).text == FREE
    assert updated_proposal(FREE, FREE, HELD).text == HELD
    answered = HELD.replace("#? joints.J.axial_clearance: drawn without axial play; which play do the tolerances ", "")
    answered = answered.replace("leave at each end?\n# axial", "axial").replace("0.05", "0.07")
    updated = updated_proposal(answered, HELD, FREE)
    assert "axial_clearance = 0.07\n" in updated.text
    assert updated.kept == ["joints.J.axial_clearance: no longer proposed, and was 0.05"]
    own = FREE.replace("#? joints.J: nothing was found that holds it along its axis; if something does, say so\n", "")
    assert "#?" not in updated_proposal(own, FREE, FREE.replace("contact", "other")).text  # answered once


def test_examples_that_were_taken_over_are_answers():
    """A response to a stop stays one to this stop, also where the example is about another by now."""
    before = '# [responses.force]\n# contact = "stop-1"\n'
    updated = updated_proposal(before.replace("# ", ""), before, before.replace("stop-1", "stop-2"))
    assert updated.text == '[responses.force]\ncontact = "stop-1"\n'


def test_parameters_come_and_go():
    """Of diameters with limits; one that the person uses elsewhere stays, and so does a table with others."""
    none, one = "a = 1\n\n[cad]\nb = 2\n", "a = 1\n\n[parameters]\nJ_hole = 6.1\n\n[cad]\nb = 2\n"
    two = one.replace("\n\n[cad]", "\nJ_pin = 6.0\n\n[cad]")
    assert updated_proposal(one, one, two).text == two
    assert updated_proposal(two, two, one).text == one
    assert updated_proposal(one, one, none).text == none
    used = one.replace("b = 2", 'b = "J_hole / 2"')
    assert updated_proposal(used, one, none).text == used
    assert "J_hole" not in updated_proposal(one + '# "J_hole / 2"\n', one, none).text.partition("# ")[0]
    assert "[parameters]\nown = 3\n" in updated_proposal(one.replace("]\nJ", "]\nown = 3\nJ"), one, none).text


@pytest.mark.slow
def test_candidates_that_are_gone(latch):
    """What still has its mark goes; what the person has taken over stays, and is named."""
    text = proposed(latch.assembly)
    none = proposed_mechanism(replace(find_geometry(latch.assembly), stops=()), "latch.step", "latch")
    left = updated_proposal(text, text, none)
    assert ("stop-1]" in left.text, left.gone) == (False, [])
    assert "#? contacts" not in left.text
    taken = text.replace("# [contacts", "[contacts").replace("# a = ", "a = ").replace("# b = ", "b = ")
    stays = updated_proposal(taken, text, none)
    assert ("[contacts.stop-1]" in stays.text, stays.gone) == (True, ["[contacts.stop-1]"])


def test_the_same_revision(latch):
    """Nothing changes."""
    text = proposed(latch.assembly)
    assert updated_proposal(text, text, text).text == text


def test_the_earlier_revision(latch, tmp_path):
    """It comes from the cache where another file has taken its place; otherwise one message says what to do."""
    path = tmp_path / "latch.toml"
    path.write_text(proposed(latch.assembly))
    (tmp_path / "latch.step").write_text("ISO-10303-21;\nanother\nEND-ISO-10303-21;")
    assert earlier_revision(path).assembly.sha256 == latch.assembly.sha256
    other = tmp_path / "other.toml"
    other.write_text(path.read_text().replace(latch.assembly.sha256, "0" * 64))
    (tmp_path / "latch.step").write_bytes(LATCH.read_bytes())
    with pytest.raises(CadError, match="has another content by now"):
        earlier_revision(other)
    other.write_text("format = 1\n")
    with pytest.raises(MechanismError, match="names no CAD file"):
        earlier_revision(other)
    other.write_text("[")
    with pytest.raises(MechanismError, match=r"other\.toml"):
        earlier_revision(other)
    with pytest.raises(MechanismError, match="cannot be read"):
        earlier_revision(tmp_path / "none.toml")

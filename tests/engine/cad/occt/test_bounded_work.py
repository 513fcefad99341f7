"""Work that takes too long, or crashes, is given up, and simpler work is done in its place."""

import os
import signal

import pytest
from OCP.Standard import Standard_OutOfRange

from engine.cad.occt import face_pieces, product_geometry, spline_surfaces
from engine.cad.occt.bounded_work import Budget, Work, done_in_time
from tests.engine.cad.step_files import Drawing, cylinder, place


def endless():
    while True:
        pass


def crash():
    os.kill(os.getpid(), signal.SIGKILL)


def out_of_range():
    raise Standard_OutOfRange


def test_each_piece_has_an_answer_if_one_attempt_succeeds():
    """In order, whatever happens to those between."""
    ways = [[lambda: "a"], [endless, lambda: "b"], [crash, out_of_range, lambda: "c"], [endless, crash], [lambda: None]]
    done = done_in_time([Work(way, 0.2) for way in ways], Budget(5.0))
    assert done == [(0, "a"), (1, "b"), (2, "c"), None, (0, None)]


def test_when_the_budget_is_spent_only_the_last_attempt_is_made():
    """What is quick is still done."""
    works = [Work([endless, endless, lambda: "coarse"], 0.2), Work([lambda: "fine"], 0.2)]
    assert done_in_time(works, Budget(0.1)) == [(2, "coarse"), (0, "fine")]


def test_faults_of_the_code_are_raised():
    """Only OCCT may fail."""
    with pytest.raises(ZeroDivisionError):
        done_in_time([Work([lambda: 1 / 0, lambda: 1], 1.0)], Budget(1.0))


# -- what takes too long of a drawing -------------------------------------------------------------------------------


@pytest.fixture
def drawing():
    made = Drawing()
    made.add(made.assembly("top"), made.product("pin", cylinder((0, 0, 0), 3.0, 4.0)), place())
    return made


def only_at(level, function, otherwise):
    """Return a function that is another one up to a level of fineness."""
    return lambda face, sag, at: otherwise() if at <= level else function(face, sag, at)


def test_a_face_that_cannot_be_converted_loses_its_spline(drawing, read, monkeypatch):
    """It is named, and all else is there."""
    monkeypatch.setattr(spline_surfaces, "_spline", lambda *_: out_of_range())
    assembly = read(drawing)
    assert [face.kind for face in assembly.faces] == ["cylinder", "plane", "plane"]
    assert assembly.faces[0].splines == ()
    [said] = [text for text in assembly.cautions if "the splines of" in text]
    assert "of pin, around (0, 0, 2)" in said


@pytest.mark.slow
def test_a_face_that_is_not_meshed_in_time_is_meshed_coarser(drawing, read, monkeypatch):
    """Or not at all; both are said, and kind and size of what is there are as drawn."""
    monkeypatch.setattr("engine.cad.occt.product_geometry._FACE_SECONDS", 0.3)
    mesh_face = face_pieces.mesh_face
    for level, faces, said in ((0, 3, "fine pictures of 3 faces of pin"), (2, 0, "all of 3 faces of pin")):
        monkeypatch.setattr(face_pieces, "mesh_face", only_at(level, mesh_face, endless))
        assembly = read(drawing)
        assert len(assembly.faces) == faces
        assert assembly.parts[0].solids[0].volume == pytest.approx(113.09733)
        assert any(said in text for text in assembly.cautions)


def test_a_solid_that_cannot_be_integrated_is_estimated(drawing, read, monkeypatch):
    """From its triangles; the error is not known, and that is said."""
    monkeypatch.setattr(product_geometry, "_integrals", lambda *_, **__: out_of_range())
    assembly = read(drawing)
    [solid] = assembly.parts[0].solids
    exact = 113.09733552923255
    assert solid.volume == pytest.approx(exact, rel=0.02)
    assert solid.centre == pytest.approx([0.0, 0.0, 2.0], abs=1e-3)
    across, along = exact * (3 * 9 + 16) / 12, exact * 9 / 2
    assert solid.inertia.diagonal() == pytest.approx([across, across, along], rel=0.03)
    assert any("exact volume of a solid of pin" in text for text in assembly.cautions)

"""Distances that OCCT measures in its own process: once for each question, and within its limits."""

import hashlib

import pytest

from engine import CadError
from engine.cad import ReadingLimits
from engine.cad.occt.step_assembly import read_assembly
from engine.cad.step_reader import MeasuredShape, drawn_distances
from tests.engine.cad.hinges import BORE, PIN, PLAY, hinge

pytestmark = pytest.mark.processes

OFF = 0.02


@pytest.fixture
def drawn(tmp_path):
    """Return the path of a hinge, its SHA-256, and the pairs bore and pin, bore and a point of its axis."""
    path = tmp_path / "hinge.step"
    hinge(x=OFF).write(path)
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    faces = [face for face in read_assembly(path, sha256, 1e-4).faces if face.kind == "cylinder"]
    shapes = {face.hollow: MeasuredShape(["plate", "stud"].index(face.part), faces=face.places) for face in faces}
    axis = MeasuredShape(point=(OFF, 0.0, PLAY + 1.0))
    return path, sha256, [(shapes[True], shapes[False]), (shapes[True], axis)]


def no_process(*_, **__):
    raise AssertionError("a process was started")


def test_measured_once(drawn, own_cache, monkeypatch):
    """The distances of the drawing; the second time from the cache, for no other question and no damaged answer."""
    expected = pytest.approx([BORE - PIN - OFF, BORE], abs=1e-9)
    assert drawn_distances(*drawn) == expected
    [kept] = own_cache.iterdir()
    monkeypatch.setattr("engine.cad.step_reader.Child", no_process)
    assert drawn_distances(*drawn) == expected
    path, sha256, pairs = drawn
    with pytest.raises(AssertionError, match="was started"):
        drawn_distances(path, sha256, pairs[:1])
    kept.write_bytes(kept.read_bytes()[:-5])
    with pytest.raises(AssertionError, match="was started"):
        drawn_distances(*drawn)


def test_within_limits(drawn, tmp_path, monkeypatch):
    """A pair that would keep OCCT busy for ever ends as reading does."""
    package = tmp_path / "OCP"
    package.mkdir()
    (package / "__init__.py").write_text("while True: pass")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(CadError, match=r"hinge\.step.*\b1 s\b"):
        drawn_distances(*drawn, ReadingLimits(seconds=1))

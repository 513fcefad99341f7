"""What is read from CAD files is kept in a folder of the test's own."""

from pathlib import Path

import pytest

from engine.cad.occt.step_assembly import read_assembly


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory, monkeypatch):
    """Keep nothing in the user's cache."""
    folder = tmp_path_factory.mktemp("cache")
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    return folder / "clearcap" / "cad"


@pytest.fixture
def read(tmp_path):
    """Return a function that writes a drawing and reads it here, without a process of its own."""

    def written_and_read(drawing, recognition=1e-4, **how):
        path = drawing.write(tmp_path / "drawing.step", **how)
        return read_assembly(Path(path), "0" * 64, recognition)

    return written_and_read

"""What is read from CAD files is kept for the tests of this folder, and only for them."""

import pytest

from engine.cad import read_step
from engine.cad_import.found_geometry import find_geometry
from tests.engine.mechanism.geometry.latch_file import LATCH


@pytest.fixture(scope="session")
def proposal_cache(tmp_path_factory):
    """Return a folder that all tests share: the latch is read once."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def own_cache(proposal_cache, monkeypatch):
    """Keep nothing in the user's cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(proposal_cache))


@pytest.fixture
def latch(own_cache):
    """Return what is found in the latch of the docs."""
    return find_geometry(read_step(LATCH))

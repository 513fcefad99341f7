"""What is read from CAD files is kept for the tests of this folder, and only for them."""

import pytest


@pytest.fixture(scope="session")
def cad_cache(tmp_path_factory):
    """Return a folder that all tests share: the latch is read once."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def own_cache(cad_cache, monkeypatch):
    """Keep nothing in the user's cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(cad_cache))

"""Kernels of these tests compile each time: what an earlier run of the tests left on disk shows nothing."""

import pytest

from engine.jit import decorators


@pytest.fixture(autouse=True)
def nothing_on_disk(monkeypatch):
    """Keep no machine code, and read none."""
    monkeypatch.setattr(decorators, "keep_on_disk", lambda compiled: None)

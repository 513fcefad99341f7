"""Which process is which, with and without /proc."""

import os
import subprocess
import sys

import pytest

from campaign import processes
from campaign.processes import cores, process_space, started
from campaign.store import open_store


@pytest.mark.processes
def test_a_process_and_one_that_ended():
    """The child has another start than this process; once it is waited for, it has none."""
    child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    assert started(child.pid) not in (None, started(os.getpid()))
    child.communicate(b"\n")
    assert started(child.pid) is None
    assert [started(odd) for odd in (None, "x", "1/../1", -1)] == [None] * 4


@pytest.mark.processes
def test_without_proc(tmp_path, monkeypatch, plan):
    """As on macOS: a process is alive or not, and a store can be written."""
    monkeypatch.setattr(processes, "PROC", tmp_path / "none")
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    process_space.cache_clear()
    try:
        child = subprocess.Popen([sys.executable, "-c", "pass"])
        child.wait()
        assert (started(os.getpid()), started(child.pid)) == ("alive", None)
        assert process_space()
        assert cores() >= 1
        store = open_store(str(tmp_path / "runs"))
        store.create_plan(plan)
        assert store.campaigns() == [plan.campaign_id]
    finally:
        process_space.cache_clear()

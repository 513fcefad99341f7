"""The stubs of `python -m benchmarks scheduler`: a real scheduler takes them for workers, a client their answers."""

import pytest

from benchmarks.scheduler import schedule

pytestmark = pytest.mark.processes


def test_a_scheduler_takes_stubs_for_workers():
    """A few join, are counted, and answer each call once."""
    found = schedule(3, 20, idle_s=0.1)
    assert (found["workers"], found["calls"]) == (3, 20)
    assert min(found["memory_MiB"], found["client_call_ms"], found["wall_s"]) > 0.0

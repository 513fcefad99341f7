"""Which workers count as silent: by heartbeats that stay the same, and by time in which someone looked."""

import pytest

from campaign.cluster.silence import LOOK_INTERVAL, Silence


@pytest.fixture
def silence():
    return Silence(60.0)


def look(silence, times, heartbeat=lambda now: 0.0):
    """Look at one worker at the times given; return when it was silent."""
    return [now for now in times if silence.look({"a": heartbeat(now)}, now)]


def every_two_seconds(start, end):
    return [start + LOOK_INTERVAL * i for i in range(int((end - start) / LOOK_INTERVAL) + 1)]


def test_a_worker_without_heartbeats_is_silent(silence):
    """After the time allowed, and again after as long, until it is gone."""
    assert look(silence, every_two_seconds(0.0, 130.0)) == [60.0, 120.0]
    assert silence.look({}, 300.0) == []


def test_a_worker_that_sends_heartbeats_is_not(silence):
    """Rare ones are enough; clocks may jump."""
    assert look(silence, every_two_seconds(0.0, 600.0), lambda now: now // 50.0) == []
    assert look(silence, every_two_seconds(602.0, 900.0), lambda now: -(now // 50.0)) == []


def test_time_in_which_nobody_looked_does_not_count(silence):
    """A laptop slept, or all processes were stopped: neither is a worker's fault."""
    assert look(silence, [0.0, 8.0 * 3600.0, 16.0 * 3600.0]) == []
    assert look(silence, every_two_seconds(16.0 * 3600.0, 16.0 * 3600.0 + 40.0)) == []


def test_one_of_several(silence):
    """The others are left alone."""
    silent = [silence.look({"a": 0.0, "b": now, "c": now}, now) for now in every_two_seconds(0.0, 70.0)]
    assert [worker for workers in silent for worker in workers] == ["a"]

"""The simulated campaign of `python -m benchmarks coordinator`, tiny: every batch is counted, and the clock adds up."""

from benchmarks.coordinator import SECONDS, coordinate


def test_a_tiny_campaign_by_the_clock(tmp_path):
    """Thirty batches on ten workers take three rounds; a coordinator that begins again finds the parts."""
    found = coordinate(30, 10, str(tmp_path), resumed=2, answer=0.0)
    assert found["simulated_s"] == 3 * SECONDS
    assert (found["batches"], found["workers"], found["resumed"]) == (30, 10, 2)
    assert found["requests_a_look"] >= 3  # cancellation, lease, heartbeat
    # while batches are dispatched, nothing is asked of the store for each of them
    assert found["requests"] < 30
    assert found["requests_a_part"] >= 1
    assert min(found["batch_us"], found["part_ms"], found["record_s"], found["memory_MiB"]) > 0

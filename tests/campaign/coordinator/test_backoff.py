"""Pauses between attempts at what fails."""

from campaign.coordinator import backoff
from campaign.coordinator.backoff import PAUSES, Backoff


def test_pauses_double_up_to_the_longest(monkeypatch):
    """From the first one on, and from the first one again after a success."""
    slept = []
    monkeypatch.setattr(backoff.time, "sleep", slept.append)
    pauses = Backoff()
    for _ in range(40):
        pauses.fail()
        pauses.wait()
    first, longest = PAUSES
    assert slept[:4] == [first, 2 * first, 4 * first, 8 * first]
    assert slept[-1] == longest == max(slept)
    pauses.reset()
    pauses.fail()
    pauses.wait()
    assert slept[-1] == first

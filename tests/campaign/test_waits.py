"""What a campaign waits for: facts, and the same words from them everywhere."""

import time

from campaign.waits import SENTENCES, Wait, Waits, counted, duration, in_words, is_wait


def test_words():
    """What keeps the rest from going on comes first; nothing is nothing."""
    facts = [Wait("jobs", 60.0, "job 7: Resources"), Wait("workers", 10.0)]
    words = in_words([fact.to_json() for fact in facts], 100.0)
    assert words == "no workers for 90 s; jobs have been waiting in the queue for 40 s (job 7: Resources)"
    assert in_words([], 100.0) == ""
    for what in SENTENCES.keys() - {"coordinator"}:  # its time is of another clock
        assert "40 s" in in_words([Wait(what, 60.0).to_json()], 100.0), what


def test_what_began_keeps_its_beginning(monkeypatch):
    """Also when it is told again with another reason, or without one."""
    waits = Waits()
    monkeypatch.setattr(time, "time", lambda: 1e9)
    waits.begin("scheduler", "client closed", for_s=30.0)
    [first] = waits
    assert first.since == 1e9 - 30.0
    waits.begin("scheduler", "does not answer")
    with waits.during("scheduler"):
        [second] = waits
        assert (second.since, second.detail) == (first.since, "does not answer")
    assert list(waits) == []


def test_data_of_unknown_origin():
    """A heartbeat that somebody else has written breaks nothing."""
    sound = Wait("store", 5.0, "full").to_json()
    assert is_wait(sound)
    for odd in (
        None,
        {},
        sound | {"more": 1},
        sound | {"what": "tea"},
        sound | {"since": "now"},
        sound | {"detail": 3},
    ):
        assert not is_wait(odd), odd


def test_durations_and_numbers():
    """Rounded; one of a thing is one."""
    assert [duration(s) for s in (-3.0, 0.4, 119.0, 120.0, 7000.0, 7200.0)] == [
        "0 s", "0 s", "119 s", "2 min", "117 min", "2 h",
    ]  # fmt: skip
    assert [counted(n, "worker") for n in (0, 1, 2)] == ["0 workers", "1 worker", "2 workers"]

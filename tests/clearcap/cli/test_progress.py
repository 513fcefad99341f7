"""How far a campaign is, in words."""

import io

from rich.console import Console

from campaign.coordinator.heartbeat import Heartbeat
from clearcap.cli.output import Lines, display, eta, line, view


def heartbeat(**changes):
    """Return a campaign's heartbeat in the middle."""
    responses = {
        "FC-1": {"n": 40, "mean": 12.5, "std": 0.2, "cpk": 5.8333},
        "FC-2": {"n": 40, "mean": 1.0, "std": 0.1, "cpk": None},
    }
    known = {"campaign": "demo-0", "state": "running", "samples": 100, "done": 42, "ok": 40, "failed": 2, "left": 58}
    more = {"statuses": {"ok": 40, "crashed": 2}, "rate": 2.0, "eta_s": 29.0, "workers": 2, "responses": responses}
    return Heartbeat(**(known | more | changes))


def test_a_line():
    """Done, failed, rate, time to go, workers; at the end the state."""
    assert line(heartbeat()) == "42/100 runs, 2 failed, 2.0 runs/s, ETA 0:00:29, 2 workers"
    assert line(heartbeat(workers=1, eta_s=None, rate=0.0)).endswith("0.0 runs/s, ETA -, 1 worker")
    assert line(heartbeat(state="cancelled")) == "42/100 runs, 2 failed, cancelled"
    assert eta(3723.4) == "1:02:03"


def test_a_line_says_when_nothing_comes():
    """A time to go that stands still has its reason; a batch may take a while."""
    assert line(heartbeat(idle_s=12.0)).endswith("2 workers")
    waiting = [{"what": "idle", "since": 24.6, "detail": ""}]
    assert line(heartbeat(waiting=waiting, time=100.0)).endswith("2 workers; nothing finished for 75 s")


def test_live_view_has_the_running_capability():
    """Of the responses that have limits."""
    console = Console(file=io.StringIO(), width=120)
    console.print(view(heartbeat()))
    text = console.file.getvalue()
    assert "42/100 runs" in text
    assert "FC-1" in text
    assert "5.833" in text
    assert "FC-2" not in text


def test_lines_are_few(monkeypatch):
    """Without a terminal: one every ten seconds, and one when the state changes."""
    now = [0.0]
    monkeypatch.setattr("clearcap.cli.output.monotonic", lambda: now[0])
    console = Console(file=io.StringIO(), width=200)
    show = Lines(console)
    for second in range(25):
        now[0] = float(second)
        show(heartbeat(done=second))
    show(heartbeat(state="completed", done=100))
    said = console.file.getvalue().splitlines()
    assert [text.split()[0] for text in said] == ["10/100", "20/100", "100/100"]


def test_on_a_terminal_it_is_drawn_in_place():
    """And elsewhere as lines."""
    for terminal, kind in ((True, "function"), (False, "Lines")):
        console = Console(file=io.StringIO(), force_terminal=terminal)
        with display(console) as show:
            assert type(show).__name__ == kind
            show(heartbeat())


def test_another_format_is_no_heartbeat():
    """What a later version wrote is passed over, not guessed at."""
    assert Heartbeat.from_json(heartbeat().to_json()) == heartbeat()
    assert Heartbeat.from_json({"campaign": "demo-0", "colour": "red"}) is None

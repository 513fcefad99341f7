"""Of many who must not wait for a store that does not answer, one asks it; the others fail at once."""

import threading

import pytest

from campaign.errors import StoreError
from campaign.store.files import known_outage
from campaign.store.files.files import Files
from campaign.store.files.known_outage import ASK_EVERY, LONG, KnownOutage
from campaign.store.files.patience import HASTY


@pytest.fixture
def clock(monkeypatch):
    """Return a clock that the test turns."""

    class Clock:
        now = 1000.0

        def monotonic(self):
            return self.now

    turned = Clock()
    monkeypatch.setattr(known_outage, "time", turned)
    return turned


def ask(outage, clock, takes=0.0, fault=None):
    """Ask; say what came of it."""
    try:
        with outage.asking():
            clock.now += takes
            if fault is not None:
                raise fault
    except StoreError as error:
        return str(error)
    return "answered"


def test_after_a_long_fault_one_asks_now_and_then(clock):
    outage = KnownOutage()
    assert ask(outage, clock, 8.0, StoreError("silent")) == "silent"
    assert outage.fault == "silent"
    assert ask(outage, clock) == "silent", "the question was not asked: it would have been answered"
    clock.now += ASK_EVERY
    assert ask(outage, clock, 8.0, StoreError("still silent")) == "still silent"
    clock.now += ASK_EVERY
    assert ask(outage, clock) == "answered"
    assert outage.fault == ""
    assert ask(outage, clock) == "answered"


def test_a_short_fault_is_not_remembered(clock):
    """A file that may not be read is no reason to read no other."""
    outage = KnownOutage()
    assert ask(outage, clock, LONG / 2, StoreError("no permission")) == "no permission"
    assert (outage.fault, ask(outage, clock)) == ("", "answered")


def test_a_file_that_does_not_exist_is_an_answer(clock):
    outage = KnownOutage()
    ask(outage, clock, 8.0, StoreError("silent"))
    clock.now += ASK_EVERY
    with pytest.raises(FileNotFoundError), outage.asking():
        raise FileNotFoundError("x")
    assert ask(outage, clock) == "answered"


def test_while_one_asks_nobody_else_does(clock):
    outage, asks, over = KnownOutage(), threading.Event(), threading.Event()
    ask(outage, clock, 8.0, StoreError("silent"))
    clock.now += 10.0 * ASK_EVERY

    def wait():
        with outage.asking():
            asks.set()
            over.wait(600.0)

    thread = threading.Thread(target=wait)
    thread.start()
    asks.wait(600.0)
    assert ask(outage, clock) == "silent"
    over.set()
    thread.join()
    assert ask(outage, clock) == "answered"


class Silent:
    """A backend that takes its time and then fails."""

    faults = OSError

    def __init__(self, backend, clock):
        self.is_final, self.reopen, self.path = backend.is_final, backend.reopen, backend.path
        self._clock, self.asked = clock, 0

    def within(self, answer_s):
        """Return itself."""
        return self

    def names(self, path):
        """Fail after eight seconds."""
        self.asked += 1
        self._clock.now += 8.0
        raise TimeoutError(110, "no answer within 8 s")

    sizes = stamps = names


def test_files_share_what_they_know(tmp_path, clock):
    """Also those of whom somebody asks another operation, or asks for hasty ones; the fault is that of the first."""
    files = Files(str(tmp_path), HASTY, KnownOutage())
    files._backend = silent = Silent(files._backend, clock)
    for operation in (files.names, files.hasty.names, files.sizes, files.hasty.stamps):
        with pytest.raises(StoreError, match=r"a cannot be listed \(no answer within 8 s\)"):
            operation("a")
    assert silent.asked == 1
    assert "no answer within 8 s" in files.fault

"""One policy for every operation: what may pass is tried again for a while, and nothing is done twice.

Of many who must not wait for a store that does not answer, one asks it; the others fail at once.
"""

import errno
import itertools
import logging
import signal
import threading

import pytest

from campaign.errors import StoreError
from campaign.store.files import retry_policy
from campaign.store.files.files import Files, OddFile
from campaign.store.files.retry_policy import ASK_EVERY, HASTY, LONG, PATIENT, CircuitBreaker, Outage, RetryPolicy
from tests.each import each
from tests.until import until

SOON = RetryPolicy(600.0, 0.001, 0.01)
NAMES = ("EIO", "EROFS", "ESTALE", "ENOSPC", "EDQUOT", "ETIMEDOUT", "ECONNRESET", "EACCES", "EAGAIN")
PASSING = [getattr(errno, name) for name in NAMES]


class Faulty:
    """A backend whose operations fail a number of times, before or after they are done."""

    def __init__(self, backend, fails, after=False, number=errno.EIO):
        self._backend, self._left, self._after, self._number = backend, fails, after, number
        self.faults, self.is_final, self.reopen, self.path = OSError, backend.is_final, backend.reopen, backend.path

    def within(self, answer_s):
        """Return itself: it fails at once."""
        return self

    def __getattr__(self, name):
        def operation(*arguments):
            fails, self._left = self._left > 0, self._left - 1
            if fails and not self._after:
                raise OSError(self._number, "it is away")
            result = getattr(self._backend, name)(*arguments)
            if fails:
                raise OSError(self._number, "the answer is lost")
            return result

        return operation


OPERATIONS = {
    "read": (lambda files: files.read("a/x"), b"before"),
    "size": (lambda files: files.size("a/x"), 6),
    "exists": (lambda files: files.exists("a/x"), True),
    "exists not": (lambda files: files.exists("a/y"), False),
    "sizes": (lambda files: files.sizes("a"), {"x": 6}),
    "names": (lambda files: files.names("a"), ["x"]),
    "write": (lambda files: (files.write("a/x", b"after"), files.hasty.read("a/x"))[1], b"after"),
    "create": (lambda files: files.create("a/y", b"mine"), True),
    "create not": (lambda files: files.create("a/x", b"mine"), False),
    "move": (lambda files: (files.move("a/x", "a/y"), files.hasty.names("a"))[1], ["y"]),
    "remove": (lambda files: (files.remove("a/x"), files.hasty.names("a"))[1], []),
    "sweep": (lambda files: files.sweep("a"), None),
}


@pytest.mark.parametrize("place", ["{}", "memory://patience{}"], ids=["folder", "memory"])
@each("after", [False, True])
@each("name", OPERATIONS)
def test_every_operation_outlives_an_outage(place, name, after, tmp_path, caplog):
    """It is tried until it succeeds, also if it was done and only the answer was lost; two messages say so."""
    files = Files(place.format(tmp_path / f"{name} {after}"), SOON)
    files.write("a/x", b"before")
    caplog.set_level(logging.INFO)
    caplog.clear()
    operation, expected = OPERATIONS[name]
    files._backend = Faulty(files._backend, 4, after)
    assert operation(files) == expected
    said = [record.getMessage() for record in caplog.records]
    twice = [] if after and name == "exists not" else [(True, False), (False, True)]  # nothing done, no answer to lose
    assert [("trying again" in text, "answers again" in text) for text in said] == twice


@pytest.mark.parametrize("number", PASSING)
def test_faults_that_may_pass(tmp_path, number):
    """A disk that is full, read-only, stale or forbidden may be fixed: it is waited for."""
    files = Files(str(tmp_path), SOON)
    files._backend = Faulty(files._backend, 3, number=number)
    files.write("a", b"x")
    assert files.read("a") == b"x"


def test_patience_ends():
    """Pauses grow to some ten seconds, for minutes; without patience there is one attempt."""
    assert list(HASTY.pauses()) == []
    pauses = list(itertools.islice(PATIENT.pauses(), 20))
    assert 0.3 < pauses[0] < 0.7
    assert all(pause <= 12.5 for pause in pauses)
    assert pauses[-1] > 7.0
    assert PATIENT.seconds >= 120.0


def test_what_remains_is_one_error(tmp_path, caplog):
    """Then it is a StoreError that says what to do; nothing of the file is there."""
    files = Files(str(tmp_path), RetryPolicy(0.05, 0.001))
    files._backend = Faulty(files._backend, 10**9)
    for operation in (lambda: files.write("a", b"x"), lambda: files.read("a"), lambda: files.names("")):
        with pytest.raises(StoreError, match="it is away"):
            operation()
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_pass_is_not_waited_for(tmp_path):
    """A folder in a file's place, or a file in a folder's: at once."""
    files = Files(str(tmp_path), RetryPolicy(3600.0))
    files.write("a", b"")
    files.write("b/c", b"")
    for operation in (lambda: files.write("a/x", b""), lambda: files.write("b", b"")):
        with pytest.raises(StoreError):
            operation()
    with pytest.raises(OddFile):
        files.read("b")


def test_what_must_exist_is_waited_for(tmp_path):
    """A plan that is not there for a moment has not vanished: the store is away."""
    files = Files(str(tmp_path), SOON)
    files.write("plan", b"plan")
    files._backend = Faulty(files._backend, 2, number=errno.ENOENT)
    assert files.read("plan", must_exist=True) == b"plan"
    with pytest.raises(FileNotFoundError):
        Files(str(tmp_path), HASTY).read("other", must_exist=True)


def test_interrupt_ends_the_wait(tmp_path, caplog):
    """Ctrl-C in an outage is not answered after it."""
    files = Files(str(tmp_path), RetryPolicy(3600.0))
    files._backend = Faulty(files._backend, 10**9)
    caplog.set_level(logging.INFO)

    def interrupt():
        until(lambda: "trying again" in caplog.text, "nobody waits")
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        files.write("a", b"x")
    thread.join()


@pytest.fixture
def clock(monkeypatch):
    """Return a clock that the test turns."""

    class Clock:
        now = 1000.0

        def monotonic(self):
            return self.now

    turned = Clock()
    monkeypatch.setattr(retry_policy, "time", turned)
    return turned


def test_an_outage_is_too_long_after_the_time_of_the_policy(clock):
    """From its first fault on; one that has not begun, or is over, is not."""
    outage = Outage("s", RetryPolicy(60.0))
    for _ in range(2):
        assert not outage.too_long
        for passed in (0.0, 30.0, 30.0):
            clock.now += passed
            outage.begin("away")
            assert not outage.too_long
        clock.now += 1.0
        assert outage.too_long
        outage.end()


def ask(outage, clock, takes=0.0, fault=None):
    """Ask; say what came of it."""
    try:
        with outage.guarding():
            clock.now += takes
            if fault is not None:
                raise fault
    except StoreError as error:
        return str(error)
    return "answered"


def test_after_a_long_fault_one_asks_now_and_then(clock):
    outage = CircuitBreaker()
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
    outage = CircuitBreaker()
    assert ask(outage, clock, LONG / 2, StoreError("no permission")) == "no permission"
    assert (outage.fault, ask(outage, clock)) == ("", "answered")


def test_a_file_that_does_not_exist_is_an_answer(clock):
    outage = CircuitBreaker()
    ask(outage, clock, 8.0, StoreError("silent"))
    clock.now += ASK_EVERY
    with pytest.raises(FileNotFoundError), outage.guarding():
        raise FileNotFoundError("x")
    assert ask(outage, clock) == "answered"


def test_while_one_asks_nobody_else_does(clock):
    outage, asks, over = CircuitBreaker(), threading.Event(), threading.Event()
    ask(outage, clock, 8.0, StoreError("silent"))
    clock.now += 10.0 * ASK_EVERY

    def wait():
        with outage.guarding():
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
    files = Files(str(tmp_path), HASTY, CircuitBreaker())
    files._backend = silent = Silent(files._backend, clock)
    for operation in (files.names, files.hasty.names, files.sizes, files.hasty.stamps):
        with pytest.raises(StoreError, match=r"\ba .*no answer within 8 s"):
            operation("a")
    assert silent.asked == 1
    assert "no answer within 8 s" in files.fault

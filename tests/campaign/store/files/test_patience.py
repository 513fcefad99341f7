"""One policy for every operation: what may pass is tried again for a while, and nothing is done twice."""

import errno
import itertools
import logging
import signal
import threading

import pytest

from campaign.errors import StoreError
from campaign.store.files.files import Files
from campaign.store.files.odd_file import OddFile
from campaign.store.files.patience import HASTY, PATIENT, Patience
from tests.until import until

SOON = Patience(600.0, 0.001, 0.01)
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


@pytest.fixture(params=["folder", "memory"])
def files(request, tmp_path):
    """Return files with one in them, in a folder and behind a URL."""
    url = str(tmp_path) if request.param == "folder" else f"memory://patience-{tmp_path.name}"
    files = Files(url, SOON)
    files.write("a/x", b"before")
    return files


@pytest.mark.parametrize("after", [False, True])
@pytest.mark.parametrize("name", OPERATIONS)
def test_every_operation_outlives_an_outage(files, name, after, caplog):
    """It is tried until it succeeds, also if it was done and only the answer was lost; two messages say so."""
    caplog.set_level(logging.INFO)
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
    files = Files(str(tmp_path), Patience(0.05, 0.001))
    files._backend = Faulty(files._backend, 10**9)
    for operation in (lambda: files.write("a", b"x"), lambda: files.read("a"), lambda: files.names("")):
        with pytest.raises(StoreError, match=r"\(it is away\); free or repair the disk, then run the same command"):
            operation()
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_pass_is_not_waited_for(tmp_path):
    """A folder in a file's place, or a file in a folder's: at once."""
    files = Files(str(tmp_path), Patience(3600.0))
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
    files = Files(str(tmp_path), Patience(3600.0))
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

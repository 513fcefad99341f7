"""Children: what they answer, and their end if they hang or leave something behind."""

import os
import select
import signal
import sys
import threading
import time
from contextlib import suppress
from functools import partial

import psutil
import pytest

from campaign.errors import SpecError
from campaign.worker import batch as computing
from campaign.worker.batch import rows_in_subprocess
from campaign.worker.messages import CampaignAddress, ChildFailed
from campaign.worker.row import rows_in_process
from engine import Fault
from engine.platform import child
from engine.platform.child import Child, ChildEnded, ChildRaised, Limits, head_of
from tests.campaign import fake_engine
from tests.each import each

WITHIN = 600.0  # s, after which a child that nobody killed is killed here, and the test fails


def silence_while(status):
    """Return a stand-in of `child.silence` for which time passes only while a child has this status.

    A child that is slow is thus not silent for any time.
    """

    def silence(pipe, event=select.POLLIN):
        poller = select.poll()
        poller.register(pipe, event)
        if poller.poll(50.0):
            return None
        with suppress(psutil.NoSuchProcess):
            if any(other.status() == status for other in psutil.Process().children()):
                return 60.0
        return 0.0

    return silence


@pytest.fixture
def _soon(monkeypatch):
    """Have no patience with a child that is stopped, and fail the test if one has to be killed from here."""
    monkeypatch.setattr(child, "silence", silence_while(psutil.STATUS_STOPPED))
    monkeypatch.setattr(computing, "longest_sample", lambda _: 0.0)
    monkeypatch.setattr(computing, "BUSY", 0.0)
    monkeypatch.setattr(computing, "PAUSES", (0.01, 0.1))
    over, rescued = threading.Event(), []

    def rescue():
        while not over.wait(WITHIN):
            for other in psutil.Process().children():
                rescued.append(other.pid)
                other.kill()

    rescuer = threading.Thread(target=rescue)
    rescuer.start()
    yield
    over.set()
    rescuer.join()
    assert rescued == []


@pytest.mark.processes
@pytest.mark.slow
@pytest.mark.usefixtures("_soon")
def test_stopped_from_outside_blames_nobody(store, plan, tmp_path, caplog):
    """A run whose process is stopped for good, twice, is computed in the end."""
    stopped = partial(fake_engine.stops_at_first, 2, str(tmp_path / "stops"))
    rows = list(rows_in_subprocess(CampaignAddress.of(store, plan, stopped), range(3), 1))
    reference = list(rows_in_process(CampaignAddress.of(store, plan, fake_engine.simulate), range(3)))
    varies = {"attempts": 1, "wall_s": 0.0}
    assert [row | varies for row in rows] == [row | varies for row in reference]
    assert caplog.text.count("it hangs or was stopped") == 2


@pytest.mark.processes
@pytest.mark.slow
@pytest.mark.usefixtures("_soon")
def test_a_run_that_always_stops_is_a_row(store, plan, tmp_path, monkeypatch):
    """Time after time, alone in a process of its own: the others go on."""
    monkeypatch.setattr(computing, "TRIES", 2)
    stopped = partial(fake_engine.stops_at_first, 2, str(tmp_path / "stops"))
    first, second = rows_in_subprocess(CampaignAddress.of(store, plan, stopped), range(2), 1)
    assert (first["status"], second["status"]) == ("crashed", "ok")
    assert "ignored its time limit 2 times in a row; perhaps someone stopped" in first["message"]


@pytest.mark.processes
@pytest.mark.usefixtures("_soon")
def test_stopped_while_it_starts(store, plan, monkeypatch):
    """It is no fault of a run, and does not last for ever."""
    code = "import os, signal; os.kill(os.getpid(), signal.SIGSTOP)"
    monkeypatch.setattr(child, "command", lambda _: [sys.executable, "-c", code])
    monkeypatch.setattr(computing, "READY_WITHIN", -CampaignAddress.of(store, plan).retry_policy.seconds)
    monkeypatch.setattr(computing, "STARTS", 2)
    with pytest.raises(ChildFailed, match="SIGKILL"):
        list(rows_in_subprocess(CampaignAddress.of(store, plan, fake_engine.simulate), range(3), 1))


def leaves_a_process(request, send):
    """End while a process that was started here holds the pipe of the answers open."""
    if os.fork():
        os._exit(0)
    time.sleep(600)


@pytest.mark.processes
def test_what_a_child_has_started_is_killed_with_it(monkeypatch):
    """It would hold the pipe open, for which the parent waits."""
    monkeypatch.setattr(child, "silence", silence_while(psutil.STATUS_ZOMBIE))
    with Child(f"{__name__}:{leaves_a_process.__name__}") as started, pytest.raises(ChildEnded) as ended:
        started.answer(b"", Limits(), 0.0)
    assert (ended.value.was_silent, ended.value.status) == (True, 0)


def answers(request, send):
    """Say what was asked, or raise it."""
    if request == b"raise":
        raise SpecError("no such thing", [Fault(("a", "b"), "x", "says it")])
    send("ahead", request)
    return request * 2


@pytest.mark.processes
def test_messages_and_errors():
    """One child answers request after request; an error comes with its classes, and the child goes on."""
    with Child(f"{__name__}:{answers.__name__}") as started:
        assert list(started.messages(b"ab", Limits(), lambda _: 600.0)) == [("ahead", b"ab"), ("done", b"abab")]
        with pytest.raises(ChildRaised, match="no such thing") as raised:
            started.answer(b"raise", Limits(), 600.0)
        assert raised.value.kinds[:2] == ["SpecError", "CampaignError"]
        assert raised.value.faults[0]["keys"] == ["a", "b"]
        large = bytes(10_000_000)
        assert started.answer(large, Limits(), 600.0) == large * 2


@pytest.mark.processes
@pytest.mark.usefixtures("_soon")
def test_stopped_while_it_is_asked():
    """A request that does not fit into the pipe is not waited for without end either."""
    before = psutil.Process().children()  # of other tests
    with Child(f"{__name__}:{answers.__name__}") as started:
        started.answer(b"ab", Limits(), WITHIN)
        (other,) = set(psutil.Process().children()) - set(before)
        other.suspend()
        with pytest.raises(ChildEnded) as ended:
            started.answer(bytes(10_000_000), Limits(), 0.0)
    assert (ended.value.was_silent, ended.value.status) == (True, -signal.SIGKILL)


@each(
    "line", [b"", b"{}", b"[]", b'{"kind": 1, "size": 1}', b'{"kind": "a", "size": -1}', b'{"kind": "a", "size": 1e3}']
)
def test_head_that_no_child_sends(line):
    """Whatever runs in a child can write to its pipe."""
    with pytest.raises(ValueError, match=r"message|Expecting"):
        head_of(line)

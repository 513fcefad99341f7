"""Children that hang: killed when they are silent for too long, by time in which someone looked."""

import itertools
import os
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from functools import partial

import psutil
import pytest

from campaign.worker import subprocess_runs
from campaign.worker.messages import CampaignAddress, ChildFailed
from campaign.worker.row import rows_in_process
from campaign.worker.subprocess_runs import LOOK_INTERVAL, Watchdog, rows_in_subprocess
from tests.campaign import fake_engine

WITHIN = 600.0  # s, after which a child that nobody killed is killed here, and the test fails


@pytest.fixture
def watch():
    """Return a watch over nothing, whose child may be silent for a minute."""
    return Watchdog(None, 60.0)


def test_a_child_that_sends_nothing_is_silent(watch):
    """When more time has passed than it may be silent; each message says anew how long that is."""
    assert [watch.is_silent(2.0) for _ in range(31)] == [False] * 30 + [True]
    watch.heard(3.0)
    assert [watch.is_silent(2.0) for _ in range(3)] == [False, False, True]


def test_a_child_that_sends_messages_is_not(watch):
    """Rare ones are enough."""
    for _ in range(10):
        assert not any(watch.is_silent(2.0) for _ in range(30))
        watch.heard(60.0)


def test_time_in_which_nobody_looked_does_not_count(watch):
    """A laptop slept, or parent and child were stopped: that is no child's fault."""
    assert not any(watch.is_silent(8.0 * 3600.0) for _ in range(int(60.0 / (2.0 * LOOK_INTERVAL))))


@pytest.fixture
def _soon(monkeypatch):
    """Have no patience with a child that is stopped, and fail the test if one has to be killed from here.

    Time passes only while a child is stopped: one that is slow is not silent for any time.
    """
    moments = [1000.0]

    def clock():
        with suppress(psutil.NoSuchProcess):
            if any(child.status() == psutil.STATUS_STOPPED for child in psutil.Process().children()):
                moments.append(moments[-1] + 60.0)
        return moments[-1]

    monkeypatch.setattr(subprocess_runs, "LOOK_INTERVAL", 0.05)
    monkeypatch.setattr(subprocess_runs, "Watchdog", partial(Watchdog, clock=clock))
    monkeypatch.setattr(subprocess_runs, "longest_sample", lambda _: 0.0)
    monkeypatch.setattr(subprocess_runs, "BUSY", 0.0)
    monkeypatch.setattr(subprocess_runs, "PAUSES", (0.01, 0.1))
    over, rescued = threading.Event(), []

    def rescue():
        while not over.wait(WITHIN):
            for child in psutil.Process().children():
                rescued.append(child.pid)
                child.kill()

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
    monkeypatch.setattr(subprocess_runs, "TRIES", 2)
    stopped = partial(fake_engine.stops_at_first, 2, str(tmp_path / "stops"))
    first, second = rows_in_subprocess(CampaignAddress.of(store, plan, stopped), range(2), 1)
    assert (first["status"], second["status"]) == ("crashed", "ok")
    assert "took no notice of its time limit 2 times in a row; perhaps someone stopped" in first["message"]


@pytest.mark.processes
@pytest.mark.usefixtures("_soon")
def test_stopped_while_it_starts(store, plan, monkeypatch):
    """It is no fault of a run, and does not last for ever."""
    code = "import os, signal; os.kill(os.getpid(), signal.SIGSTOP)"
    monkeypatch.setattr(subprocess_runs, "COMMAND", [sys.executable, "-c", code])
    monkeypatch.setattr(subprocess_runs, "READY_WITHIN", -CampaignAddress.of(store, plan).retry_policy.seconds)
    monkeypatch.setattr(subprocess_runs, "STARTS", 2)
    with pytest.raises(ChildFailed, match="SIGKILL"):
        list(rows_in_subprocess(CampaignAddress.of(store, plan, fake_engine.simulate), range(3), 1))


@pytest.mark.processes
@pytest.mark.usefixtures("_soon")
def test_what_a_child_has_started_is_killed_with_it():
    """It would hold the pipe open, for which the parent waits."""
    code = "import os, time\nif os.fork(): os._exit(0)\ntime.sleep(600)"
    child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, start_new_session=True)
    time = itertools.count(1000.0)
    with child, Watchdog(child, 0.0, lambda: next(time) if child.poll() is not None else 1000.0) as watch:
        guard = threading.Timer(WITHIN, lambda: os.killpg(child.pid, signal.SIGKILL))
        guard.start()
        assert child.stdout.read() == b""
        guard.cancel()
    assert (watch.hung, child.returncode) == (True, 0)

"""SIGTERM and the hangup of a terminal end the command in order, with a status of their own."""

import os
import re
import signal
import subprocess
import sys
import time

import psutil
import pytest

from campaign.store import open_store
from campaign.store.layout import LEASE
from clearcap.cli.termination import terminated_in_order
from tests.campaign.commands import ROOT, clearcap
from tests.until import until


@pytest.fixture(autouse=True)
def not_under_nohup():
    """Have a hangup end processes here and below, also where the tests themselves are to outlive one."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_unwinds_with_the_status_of_the_signal(number, status):
    """What the block has to give back it gives back, and a second signal does not disturb it."""
    given_back = []

    def work():
        try:
            signal.raise_signal(number)
            pytest.fail("it goes on as if nothing had come")
        finally:
            signal.raise_signal(number)
            given_back.append(True)

    before = [signal.getsignal(n) for n in (signal.SIGTERM, signal.SIGHUP)]
    with pytest.raises(SystemExit) as ending, terminated_in_order():
        work()
    assert (ending.value.code, given_back) == (status, [True])
    assert [signal.getsignal(n) for n in (signal.SIGTERM, signal.SIGHUP)] == before


class Swallowing:
    """What meets a signal where no exception can pass, as in a callback of compiled code."""

    def __del__(self):
        signal.raise_signal(signal.SIGTERM)


def test_swallowed_signal_is_raised_again():
    """It ended nothing, and the signals after it were ignored: only SIGKILL could end the process."""

    def work():
        thing = Swallowing()
        del thing
        time.sleep(600.0)
        pytest.fail("it goes on as if nothing had come")

    with pytest.raises(SystemExit) as ending, terminated_in_order():
        work()
    assert ending.value.code == 143


class Fails:
    """What raises an error where no exception can pass."""

    def __del__(self):
        raise ValueError("in a destructor")


@pytest.fixture
def hook(monkeypatch):
    """Return what sets the hook for swallowed exceptions; it is as before after the test."""
    return lambda report: monkeypatch.setattr(sys, "unraisablehook", report)


def test_signal_while_another_error_is_reported(hook, monkeypatch):
    """An exception in the hook for swallowed ones would be lost, and a traceback printed: it is sent again after it."""

    def work():
        thing = Fails()
        del thing
        happened.append("end of the hook")
        signal.raise_signal(*sent)
        pytest.fail("it goes on as if nothing had come")

    def report(swallowed):
        signal.raise_signal(signal.SIGTERM)
        happened.append(swallowed.exc_type)

    happened, sent = [], []
    monkeypatch.setattr("clearcap.cli.termination.send_again", sent.append)
    hook(report)
    with pytest.raises(SystemExit) as ending, terminated_in_order():
        work()
    assert ending.value.code == 143
    assert happened == [ValueError, "end of the hook"]


def test_signal_that_becomes_an_error_of_others():
    """A module whose initialisation is interrupted says AttributeError: the status is still that of the signal."""

    def work():
        try:
            signal.raise_signal(signal.SIGHUP)
        except SystemExit as swallowed:
            raise AttributeError("partially initialized module") from swallowed

    with pytest.raises(SystemExit) as ending, terminated_in_order():
        work()
    assert ending.value.code == 129


def test_other_errors_pass(hook):
    """Without a signal an error is an error, and an unraisable one is reported as usual."""

    def work():
        thing = Fails()
        del thing
        raise ZeroDivisionError

    reported = []
    hook(lambda swallowed: reported.append(swallowed.exc_type))
    with pytest.raises(ZeroDivisionError), terminated_in_order():
        work()
    assert reported == [ValueError]


def test_an_ignored_hangup_stays_ignored():
    """So that ``nohup clearcap run`` outlives its terminal."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with terminated_in_order():
            signal.raise_signal(signal.SIGHUP)
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.processes
@pytest.mark.slow
@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_run_ends_in_order_and_goes_on(tmp_path, campaign_file, number, status):
    """No lease, no process and no temporary file stays; the message says how to continue, and that completes it."""
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    words = ["run", str(campaign_file), "--store", "runs", "--workers", "1", "--batch-size", "1", "--no-report"]
    running = subprocess.Popen(
        [sys.executable, "-m", "clearcap", *words],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(temporary)},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        until(lambda: list(tmp_path.glob("runs/*/parts/*.parquet")) or running.poll() is not None)
        others = psutil.Process(running.pid).children(recursive=True)
        assert others
        os.killpg(running.pid, number) if number == signal.SIGHUP else running.send_signal(number)
        _, said = running.communicate()
    finally:
        running.kill()
        running.wait()
    assert running.returncode == status
    assert "Traceback" not in said
    assert re.search(r"Continue with:\n +clearcap resume \S+ .*--store \S+", said)
    assert psutil.wait_procs(others, timeout=600.0)[1] == []
    assert list(temporary.iterdir()) == []
    store = open_store(str(tmp_path / "runs"))
    (campaign_id,) = store.campaigns()
    assert store.read_json(campaign_id, LEASE) is None
    assert store.read_json(campaign_id, "state.json")["state"] == "interrupted"
    assert store.survey(store.plan(campaign_id)).missing
    again = clearcap("resume", "--store", "runs", "--no-report", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert store.survey(store.plan(campaign_id), verify=True).missing == []


def test_the_end_searches_nothing():
    """When a command ends, all that it has imported is out of the garbage collector's sight."""
    code = (
        "import atexit, gc, sys; atexit.register(lambda: print(len(gc.get_objects()), gc.get_freeze_count()));"
        " sys.argv = ['clearcap', '--version']; from clearcap.__main__ import main; main()"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True)
    seen, frozen = map(int, done.stdout.splitlines()[-1].split())
    assert seen < 100 < frozen

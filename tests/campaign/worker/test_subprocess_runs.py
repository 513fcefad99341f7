"""Runs in an isolated subprocess: whatever a run does to it, it becomes a row, and no process stays."""

import os
import signal
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import FunctionType, ModuleType

import psutil
import pytest

from campaign.errors import StoreError
from campaign.store.files.retry_policy import HASTY
from campaign.store.layout import CANCEL
from campaign.worker import batch as computing
from campaign.worker.batch import rows_in_subprocess
from campaign.worker.messages import CampaignAddress, Cancelled, ChildFailed, WrongBuild
from campaign.worker.row import rows_in_process, time_limit
from engine import simulate
from engine.platform import child
from engine.platform.child import Limits, limited
from tests.campaign import fake_engine
from tests.until import until

pytestmark = pytest.mark.processes


@pytest.fixture(autouse=True)
def _short_pauses(monkeypatch):
    """Do not wait long between two processes."""
    monkeypatch.setattr(computing, "PAUSES", (0.01, 0.1))


@pytest.mark.bits
def test_rows_are_the_same_as_in_process(store, plan):
    """Another process, the same bits."""
    address = CampaignAddress.of(store, plan, fake_engine.simulate)
    assert list(rows_in_subprocess(address, range(3, 8), 1)) == list(rows_in_process(address, range(3, 8)))
    assert [row["sample"] for row in rows_in_subprocess(address, [2, 9, 4], 1)] == [2, 9, 4]


def test_only_the_child_loads_the_engine(store, plan, monkeypatch):
    """The process that waits for rows neither compiles the engine nor loads it: it would do so before the child."""

    def load_engine():
        pytest.fail("the engine was loaded here")

    monkeypatch.setattr("campaign.worker.row.load_engine", load_engine)
    address = CampaignAddress.of(store, plan, simulate)
    assert [row["sample"] for row in rows_in_subprocess(address, [3], 1)] == [3]


def same(rows, store, plan):
    """Return whether rows are those of samples 0, 1, ... computed in this process without any fault."""
    reference = list(rows_in_process(CampaignAddress.of(store, plan, fake_engine.simulate), range(len(rows))))
    varies = {"attempts": 1, "wall_s": 0.0}
    return [row | varies for row in rows] == [row | varies for row in reference]


@pytest.mark.slow
def test_a_store_that_fails_the_child_is_no_fault_of_a_run(store, plan):
    """The child's error is the store's, so that the batch is tried again; then all rows are as ever."""
    address = replace(CampaignAddress.of(store, plan, fake_engine.simulate), retry_policy=HASTY)
    rows_before = rows_in_subprocess(address, range(3), 1)
    first = next(rows_before)  # this process has read the plan
    rows_before.close()
    there, away = (Path(store.files.path(f"{plan.campaign_id}/{name}")) for name in ("plan.json", "away.json"))
    there.rename(away)
    with pytest.raises(StoreError, match=r"plan\.json"):
        list(rows_in_subprocess(address, range(3), 1))
    away.rename(there)
    rows = list(rows_in_subprocess(address, range(3), 1))
    assert rows[0] == first
    assert same(rows, store, plan)


def test_another_build_is_no_fault_of_a_run(store, plan, monkeypatch):
    """The child says which build it runs."""
    address = replace(CampaignAddress.of(store, plan, fake_engine.simulate), row_build="engine another")
    monkeypatch.setattr(computing, "read_campaign", lambda _: (store, plan))
    with pytest.raises(WrongBuild, match="planned for another build"):
        list(rows_in_subprocess(address, range(3), 1))


@pytest.mark.slow
def test_a_child_that_cannot_import_is_no_fault_of_a_run(store, plan, monkeypatch, caplog):
    """A function that no other process finds: children fail one after the other, and the last one's error is told."""
    nowhere = ModuleType("nowhere")
    nowhere.simulate = FunctionType(fake_engine.simulate.__code__, {"__name__": "nowhere"}, "simulate")
    monkeypatch.setitem(sys.modules, "nowhere", nowhere)
    monkeypatch.setattr(computing, "STARTS", 2)
    with pytest.raises(ChildFailed, match=r"ModuleNotFoundError: .*nowhere"):
        list(rows_in_subprocess(CampaignAddress.of(store, plan, nowhere.simulate), range(3), 1))
    assert "starting another" in caplog.text


@pytest.mark.parametrize("command", [["/no/such/python"], [sys.executable, "-c", "import os; os.kill(os.getpid(), 9)"]])
def test_a_child_that_does_not_start_is_no_fault_of_a_run(store, plan, monkeypatch, command):
    """A program that is gone, a process that is killed as it starts: no row."""
    monkeypatch.setattr(child, "command", lambda _: command)
    monkeypatch.setattr(computing, "STARTS", 2)
    with pytest.raises(ChildFailed, match=r"FileNotFoundError|SIGKILL"):
        list(rows_in_subprocess(CampaignAddress.of(store, plan, fake_engine.simulate), range(3), 1))


@pytest.mark.slow
def test_kills_from_outside_blame_nobody(store, plan, tmp_path):
    """A run that is killed three times for no fault of its own is computed in the end."""
    killed = partial(fake_engine.kills_at_first, 3, str(tmp_path / "kills"))
    assert same(list(rows_in_subprocess(CampaignAddress.of(store, plan, killed), range(3), 1)), store, plan)


@pytest.mark.slow
def test_killed_while_it_sends_a_row(store, plan, tmp_path):
    """The run was over: it is repeated, and its row is as ever."""
    killed = partial(fake_engine.kills_the_answer, str(tmp_path / "kills"))
    rows = list(rows_in_subprocess(CampaignAddress.of(store, plan, killed), range(3), 1))
    assert (tmp_path / "kills").stat().st_size > len(rows)
    assert same(rows, store, plan)


@pytest.mark.slow
def test_what_an_earlier_run_left_behind_blames_nobody(store, plan):
    """A thread of one run ends the process in the next one, which is innocent and is computed alone."""
    address = CampaignAddress.of(store, plan, fake_engine.leaves_a_thread)
    assert same(list(rows_in_subprocess(address, range(2), 1)), store, plan)


@pytest.mark.slow
def test_a_run_that_spoils_the_answers_is_a_row(store, plan, monkeypatch):
    """What it wrote into the pipe is no message, time after time."""
    monkeypatch.setattr(computing, "TRIES", 2)
    (row,) = rows_in_subprocess(CampaignAddress.of(store, plan, fake_engine.writes_everywhere), [4], 1)
    assert (row["sample"], row["status"]) == (4, "crashed")


def test_a_run_that_exits_is_a_row(store, plan):
    """With status 0 too; and ``sys.exit`` does not even end the process."""
    everywhere = (0.0, 1.0)
    for way, message in (("exits in peace", "ended its process (exit status 0)"), ("leaves", "SystemExit: enough")):
        address = CampaignAddress.of(store, plan, partial(fake_engine.goes_wrong, {way: everywhere}))
        (row,) = rows_in_subprocess(address, [2], 1)
        assert row["status"] == "crashed"
        assert message in row["message"]


def test_a_run_that_kills_is_a_row(store, plan, monkeypatch):
    """It is tried again, as others send that signal too; the runs before and after it are untouched."""
    here = list(rows_in_process(CampaignAddress.of(store, plan, fake_engine.simulate), range(6)))
    deadly = sorted(row["J1"] for row in here)[4]
    monkeypatch.setattr(computing, "TRIES", 2)
    address = CampaignAddress.of(store, plan, partial(fake_engine.kills_above, deadly))
    rows = list(rows_in_subprocess(address, range(6), 2))
    for row, before in zip(rows, here, strict=True):
        if row["J1"] > deadly:
            assert row["status"] == "crashed"
            assert "killed by SIGKILL 2 times in a row; perhaps it needs more memory" in row["message"]
            assert "perhaps the signal came from outside; repeat it with clearcap replay" in row["message"]
            assert row["J1"] == before["J1"]
            assert row["attempts"] >= 2 + 2 - 1  # one more where other runs came before it in its process
        else:
            assert row == before | {"attempts": 2}


def test_child_ends_with_its_parent(store, plan, tmp_path):
    """Kill -9 of the process that started it: the child does not stay."""
    code = (
        "import sys\nfrom functools import partial\nfrom campaign.worker.messages import CampaignAddress\n"
        "from campaign.worker.batch import rows_in_subprocess\nfrom tests.campaign import fake_engine\n"
        f"slow = partial(fake_engine.lasts, 0, {str(tmp_path / 'begun')!r})\n"
        f"address = CampaignAddress({store.url!r}, {plan.campaign_id!r}, {plan.row_build!r}, slow)\n"
        "next(rows_in_subprocess(address, range(3), 1))\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", code])
    try:
        until((tmp_path / "begun").exists, "no run begins")
        (isolated,) = psutil.Process(parent.pid).children()
    finally:
        os.kill(parent.pid, signal.SIGKILL)
        parent.wait()
    isolated.wait(timeout=600)


def test_cancelled_in_the_middle(store, plan, tmp_path):
    """The marker ends a run that lasts until then, in a subprocess as in this process."""
    store.files.write(f"{plan.campaign_id}/{CANCEL}", b"")
    address = CampaignAddress.of(store, plan, partial(fake_engine.lasts, 0, str(tmp_path / "lasting")))
    for compute in (rows_in_process, rows_in_subprocess):
        with pytest.raises(Cancelled):
            list(compute(address, range(25), 1))


def test_time_limit_ends_the_process():
    """By the kernel's clock, with nothing the process could do about it."""
    code = "from campaign.worker.row import time_limit\nwith time_limit(0.2):\n    while True: pass\n"
    done = subprocess.run([sys.executable, "-c", code], check=False)
    assert done.returncode == -signal.SIGALRM
    with time_limit(3600.0):
        assert signal.getitimer(signal.ITIMER_REAL)[0] > 0.0
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)  # disarmed


def test_memory_limit_is_lifted_again():
    """Inside the block an allocation beyond it fails, after it it does not."""
    with limited(Limits(memory=1 << 29)), pytest.raises(MemoryError):
        bytearray(1 << 30)
    assert len(bytearray(1 << 30)) == 1 << 30

"""Runs in an isolated subprocess: whatever a run does to it, it becomes a row, and no process stays."""

import os
import signal
import subprocess
import sys
import time
from functools import partial

import psutil
import pytest

from campaign.store.layout import CANCEL
from campaign.worker.limits import memory_limit, time_limit
from campaign.worker.messages import CampaignAddress, Cancelled
from campaign.worker.runs import rows_in_process
from campaign.worker.subprocess_runs import TRIES, rows_in_subprocess
from tests.campaign import fake_engine


def test_rows_are_the_same_as_in_process(store, plan):
    """Another process, the same bits."""
    address = CampaignAddress.of(store, plan, fake_engine.simulate)
    assert list(rows_in_subprocess(address, range(3, 8), 1)) == list(rows_in_process(address, range(3, 8)))
    assert [row["sample"] for row in rows_in_subprocess(address, [2, 9, 4], 1)] == [2, 9, 4]


def test_a_run_that_kills_is_a_row(store, plan):
    """It is tried three times, as others send that signal too; the runs before and after it are untouched."""
    here = list(rows_in_process(CampaignAddress.of(store, plan, fake_engine.simulate), range(6)))
    deadly = sorted(row["J1"] for row in here)[3]
    address = CampaignAddress.of(store, plan, partial(fake_engine.kills_above, deadly))
    rows = list(rows_in_subprocess(address, range(6), 2))
    for row, before in zip(rows, here, strict=True):
        if row["J1"] > deadly:
            assert row["status"] == "crashed"
            assert "killed its process (SIGKILL); repeat it with clearcap replay" in row["message"]
            assert (row["J1"], row["attempts"]) == (before["J1"], 2 + TRIES - 1)
        else:
            assert row == before | {"attempts": 2}


def test_child_ends_with_its_parent(store, plan, tmp_path):
    """Kill -9 of the process that started it: the child does not stay."""
    code = (
        "import sys\nfrom functools import partial\nfrom campaign.worker.messages import CampaignAddress\n"
        "from campaign.worker.subprocess_runs import rows_in_subprocess\nfrom tests.campaign import fake_engine\n"
        "slow = partial(fake_engine.takes, 60.0)\n"
        f"address = CampaignAddress({store.url!r}, {plan.campaign_id!r}, {plan.row_build!r}, slow)\n"
        "next(rows_in_subprocess(address, range(3), 1))\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", code])
    try:
        until = time.monotonic() + 60.0
        while not (children := psutil.Process(parent.pid).children()) and time.monotonic() < until:
            time.sleep(0.05)
        (child,) = children
        time.sleep(1.0)
    finally:
        os.kill(parent.pid, signal.SIGKILL)
        parent.wait()
    child.wait(timeout=30)


def test_cancelled_in_the_middle(store, plan):
    """The marker ends it in a subprocess as in this process."""
    store.files.write(f"{plan.campaign_id}/{CANCEL}", b"")
    address = CampaignAddress.of(store, plan, partial(fake_engine.takes, 0.5))
    for compute in (rows_in_process, rows_in_subprocess):
        with pytest.raises(Cancelled):
            list(compute(address, range(25), 1))


def test_time_limit_ends_the_process():
    """By the kernel's clock, with nothing the process could do about it."""
    code = "from campaign.worker.limits import time_limit\nwith time_limit(0.2):\n    while True: pass\n"
    done = subprocess.run([sys.executable, "-c", code], timeout=60, check=False)
    assert done.returncode == -signal.SIGALRM
    with time_limit(0.2):
        pass
    time.sleep(0.4)  # disarmed: this process is still here


def test_memory_limit_is_lifted_again():
    """Inside the block an allocation beyond it fails, after it it does not."""
    with memory_limit(0.5), pytest.raises(MemoryError):
        bytearray(1 << 30)
    assert len(bytearray(1 << 30)) == 1 << 30

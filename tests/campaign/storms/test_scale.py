"""A million samples of the stand-in: memory that does not grow with the campaign.

The stand-in (``tests.campaign.fake_engine.simulate``) takes no time, so what is measured is the whole way of a row:
drawn, made a row, written, counted. ``CLEARCAP_SCALE_SAMPLES`` sets how many; the figures of a million are in
docs/speed.md. Microseconds depend on the machine and on what else it does: they are printed, and `python -m benchmarks
overhead` measures them.
"""

import json
import math
import os
import subprocess
import sys
import time
import uuid
from contextlib import suppress
from pathlib import Path

import numpy as np
import psutil
import pytest

from campaign.coordinator.submit import submit
from campaign.spec.load import load_campaign
from campaign.store import open_store
from tests.campaign.storms.cluster import DASK, drive, start_cluster
from tests.campaign.storms.supervisor import Supervisor, those_left

pytestmark = [pytest.mark.slow, pytest.mark.processes]

SAMPLES = int(os.environ.get("CLEARCAP_SCALE_SAMPLES", "100000"))
WORKERS = 2
ROOT = Path(__file__).parents[3]
PER_BATCH = 4096  # bytes: what the coordinator remembers of a batch (counts and digest), and the manifest of it
CACHES = 30 * 2**20  # bytes that either process may take once, however long it runs
REPORT = 2**30  # bytes


class Course:
    """What a campaign's processes took while it went on: memory [bytes], processor time and time [s], runs done."""

    def __init__(self):
        self.memory = {"coordinator": [], "scheduler": []}
        self.done, self.spent, self.at = [], [], []

    def watch(self, supervisor, store, plan):
        """Look four times a second until the coordinator is finished: a quick machine is done within seconds."""
        last = {}
        while not supervisor.finished("coordinator"):
            time.sleep(0.25)
            with suppress(psutil.NoSuchProcess):
                for process in _of(supervisor):
                    last[process.pid] = sum(process.cpu_times()[:2])
                sizes = {name: psutil.Process(supervisor.pid(name)).memory_info().rss for name in self.memory}
                written = [name for name in store.files.names(f"{plan.campaign_id}/parts") if name.endswith(".parquet")]
                done = len(written) * plan.batches[0][1]
                # the merge at the end takes the memory of its 100,000 rows once, however long the campaign
                if not 0 < len(written) < len(plan.batches) or done < max(self.done, default=0):
                    continue
                for name, size in sizes.items():
                    self.memory[name].append(size)
                self.done.append(done)
                self.spent.append(sum(last.values()))
                self.at.append(time.monotonic())

    def per_run(self, what):
        """Return what a run took of something, the start and the end left out: from a fifth to the last look.

        NaN when the campaign was over before it was seen twice.
        """
        seen = [i for i, done in enumerate(self.done) if done >= self.done[-1] / 5]
        runs = self.done[seen[-1]] - self.done[seen[0]] if seen else 0
        return (what[seen[-1]] - what[seen[0]]) / runs if runs else math.nan

    def growth(self, name):
        """Return by how much a process grew after its first quarter [bytes]; NaN if it was never seen."""
        if not (seen := self.memory[name]):
            return math.nan
        return np.mean(seen[-5:]) - np.mean(seen[len(seen) // 4 :][:5])


def _of(supervisor):
    pids = [supervisor.pid(name) for name in ("coordinator", "scheduler", "worker-0", "worker-1")]
    for process in [psutil.Process(pid) for pid in pids if pid is not None]:
        yield from (process, *process.children(recursive=True))


@pytest.mark.parametrize(("size", "samples"), [(50, SAMPLES), (500, 3 * SAMPLES)])  # large batches take less time
def test_scale(size, samples, tmp_path, campaign_file, capsys):
    """Neither coordinator nor scheduler grows with the campaign by more than it remembers of a batch."""
    store = open_store(str(tmp_path / "store"))
    campaign = load_campaign(str(campaign_file), samples=samples)
    plan = submit(store, campaign, size)
    course = Course()
    with Supervisor(tmp_path, str(uuid.uuid4()), **DASK) as supervisor:
        address = start_cluster(supervisor, tmp_path)
        began = time.monotonic()
        drive(supervisor, store, plan, address, 0.0)
        course.watch(supervisor, store, plan)
        wall = time.monotonic() - began
    assert those_left(supervisor.mark) == []
    figures = {
        "samples": samples,
        "batch": size,
        "wall_s": round(wall, 1),
        "wall_us": round(1e6 * course.per_run(course.at), 1),
        "overhead_us": round(1e6 * course.per_run(course.spent) / WORKERS, 1),
        "load": round(os.getloadavg()[0], 1),
        **{f"{name}_MiB": _tenths(seen) for name, seen in course.memory.items()},
        **_status_and_report(store, plan, tmp_path),
    }
    with capsys.disabled():
        print(f"\n{json.dumps(figures)}")
    assert course.growth("coordinator") < CACHES + PER_BATCH * len(plan.batches), figures
    assert course.growth("scheduler") < CACHES, figures
    assert figures["report_MiB"] * 2**20 < REPORT, figures


def _tenths(seen):
    return [round(size / 2**20) for size in seen[:: max(len(seen) // 10, 1)]]


def _status_and_report(store, plan, folder):
    """Return what status and report take on the campaign, in processes of their own."""
    figures = {}
    for verb in ("status", "report"):
        began = time.monotonic()
        command = [sys.executable, "-m", "clearcap", verb, plan.campaign_id, "--store", store.url, "--json"]
        with (folder / f"{verb}.json").open("wb") as out, subprocess.Popen(command, stdout=out) as process:
            peak = 0
            while process.poll() is None:
                peak = max(peak, _peak(process.pid))
                time.sleep(0.05)
        assert process.returncode == 0
        figures |= {f"{verb}_s": time.monotonic() - began, f"{verb}_MiB": round(peak / 2**20)}
    return figures


def _peak(pid):
    """Return the largest resident set a process had so far [bytes]."""
    try:
        status = Path(f"/proc/{pid}/status").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return 0
    return 1024 * next((int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM")), 0)

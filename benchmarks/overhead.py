"""The overhead of a campaign: the cost per run besides the run itself, and the cost of asking for its progress.

The runs use the tests' stand-in for the engine, so everything else is measured: drawing, making rows, writing parts,
dask, counting. Two numbers of samples are used; their difference excludes the start.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any

from benchmarks.machine import processor_s
from campaign.cluster.cluster import Cluster
from campaign.coordinator.coordinate import coordinate
from campaign.coordinator.submit import submit
from campaign.processes import cores
from campaign.spec.load import load_campaign
from campaign.store import open_store

BATCH, FEW, MANY = 50, 10_000, 100_000
ROOT = Path(__file__).parents[1]


def measure() -> dict[str, Any]:
    """Return the overhead of a run at a batch size of 50, and the time of `clearcap status` on the rows [s]."""
    # The overhead [us] is the time that a run adds; and the processor time that it adds divided by the number of cores,
    # which depends less on other load on the machine.
    from tests.campaign.fake_engine import simulate

    taken, processor = {}, {}
    with tempfile.TemporaryDirectory(prefix="clearcap-bench-") as folder:
        for samples in (FEW, MANY):
            store = open_store(f"{folder}/{samples}")
            plan = submit(store, load_campaign("c60", samples=samples), BATCH, simulate)
            start, before = perf_counter(), processor_s()
            coordinate(store, plan, Cluster(), simulate=simulate)
            taken[samples], processor[samples] = perf_counter() - start, processor_s() - before
        status = min(_status(store.url) for _ in range(3))
    return {
        "workers": cores(),
        "batch": BATCH,
        "samples": MANY,
        "wall_s": taken[MANY],
        "overhead_us": 1e6 * (taken[MANY] - taken[FEW]) / (MANY - FEW),
        "processor_us": 1e6 * (processor[MANY] - processor[FEW]) / (MANY - FEW) / cores(),
        "status_s": status,
        "load": os.getloadavg()[0],
    }


def _status(store: str) -> float:
    """Return the time of `clearcap status`, including the start of its process [s]."""
    start = perf_counter()
    subprocess.run(
        [sys.executable, "-m", "clearcap", "status", "--store", store, "--json"],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=True,
        capture_output=True,
    )
    return perf_counter() - start

"""Estimate how long a run takes, before a campaign is divided into batches."""

import tempfile
import time
from dataclasses import replace

from campaign.plan import Plan
from campaign.store import open_store
from campaign.worker.compiling import announced_compilation
from campaign.worker.messages import CampaignAddress, Simulate
from campaign.worker.subprocess_runs import rows_in_subprocess
from engine import missing_kernels
from engine import simulate as engine_simulate

RUNS = 4  # that are tried
ENOUGH = 5.0  # s; after a run that takes longer no other is tried


def seconds_per_run(plan: Plan, simulate: Simulate) -> float | None:
    """Return how long a run of a plan takes on this machine [s]; None if one of its first runs kills its process.

    The runs are computed in an isolated subprocess, and their rows are thrown away.
    """
    runs = min(RUNS, plan.spec.samples)
    with tempfile.TemporaryDirectory(prefix="clearcap-probe-") as folder:
        store = open_store(folder)
        store.create_plan(replace(plan, batches=_first_batch(plan.spec.samples, runs)))
        address = CampaignAddress.of(store, plan, simulate)
        with announced_compilation(missing_kernels() if simulate is engine_simulate else ()):
            rows = rows_in_subprocess(address, range(runs), 1)
            first = next(rows)  # includes the start of the process, and perhaps compilation
        if first["wall_s"] is None or first["wall_s"] > ENOUGH or runs == 1:
            return first["wall_s"] if first["wall_s"] is None else float(first["wall_s"])
        start = time.perf_counter()
        statuses = [row["status"] for row in rows]
        return None if "crashed" in statuses else (time.perf_counter() - start) / len(statuses)


def _first_batch(samples: int, runs: int) -> tuple[tuple[int, int], ...]:
    """Return batches of a plan whose first one holds the runs that are tried; the others complete the plan."""
    return ((0, runs),) if samples == runs else ((0, runs), (runs, samples - runs))

"""How long a run takes: a few are tried before a campaign is cut into batches."""

import logging
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from campaign.plan import Plan
from campaign.store import open_store
from campaign.worker.messages import CampaignAddress, Simulate
from campaign.worker.subprocess_runs import rows_in_subprocess

logger = logging.getLogger(__name__)

RUNS = 4
ENOUGH = 5.0  # s: after a run of this length no other is tried
LOADS_WITHIN = 8.0  # s: an engine that takes longer is not in the cache


def seconds_per_run(plan: Plan, simulate: Simulate) -> float | None:
    """Return how long a run of a plan takes on this machine [s]; None if its first runs end their process.

    They are run in a process of their own and thrown away: nothing that a run does can hurt the one that asks.
    """
    runs = min(RUNS, plan.spec.samples)
    with tempfile.TemporaryDirectory(prefix="clearcap-probe-") as folder:
        store = open_store(folder)
        store.create_plan(replace(plan, batches=_tried_first(plan.spec.samples, runs)))
        task = CampaignAddress.of(store, plan, simulate)
        with _patience():
            rows = rows_in_subprocess(task, range(runs), 1)
            first = next(rows)  # with the start of the process, and compilation
        if first["wall_s"] is None or first["wall_s"] > ENOUGH or runs == 1:
            return first["wall_s"] if first["wall_s"] is None else float(first["wall_s"])
        start = time.perf_counter()
        statuses = [row["status"] for row in rows]
        return None if "crashed" in statuses else (time.perf_counter() - start) / len(statuses)


def _tried_first(samples: int, runs: int) -> tuple[tuple[int, int], ...]:
    """Return batches of a plan whose first one holds the runs that are tried; the others complete the plan."""
    return ((0, runs),) if samples == runs else ((0, runs), (runs, samples - runs))


@contextmanager
def _patience() -> Iterator[None]:
    """Say why nothing happens for a while, if it does not."""
    timer = threading.Timer(
        LOADS_WITHIN, logger.info, ["compiling the engine: once after each change of version, about a minute"]
    )
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()

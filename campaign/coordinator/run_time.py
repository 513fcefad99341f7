"""Estimate how long a run takes before a campaign is divided into batches."""

import json
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from campaign.compiling import announced_compilation
from campaign.errors import StoreError
from campaign.plan import Plan
from campaign.store import BadPart, Store, open_store
from campaign.store.files.files import LARGEST
from campaign.store.layout import PLAN
from campaign.store.parts import batches_of, folder, read_file
from campaign.worker.messages import CampaignAddress, Simulate
from campaign.worker.subprocess_runs import rows_in_subprocess
from engine import missing_kernels
from engine import simulate as engine_simulate

RUNS = 4  # number of trial runs
ENOUGH = 5.0  # s; if the first run takes longer, no other is tried


def seconds_per_run(plan: Plan, simulate: Simulate, clock: Callable[[], float] = time.perf_counter) -> float | None:
    """Return how long a run takes here [s], from a few in a subprocess; None if one of them kills its process."""
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
        start = clock()
        statuses = [row["status"] for row in rows]
        return None if "crashed" in statuses else (clock() - start) / len(statuses)


def known_seconds_per_run(store: Store, plan: Plan) -> float | None:
    """Return how long runs of the same mechanism and settings took in another campaign of a store [s]; None without."""
    wanted = _what_time_depends_on(json.loads(plan.to_json()))
    for campaign_id in store.campaigns():
        try:
            document = store.read_json(campaign_id, PLAN, LARGEST) or {}
            if campaign_id != plan.campaign_id and _what_time_depends_on(document) == wanted:
                seconds = _mean_time(store, campaign_id)
                if seconds is not None:
                    return seconds
        except StoreError:
            continue  # the plan is damaged or of another version
    return None


def _what_time_depends_on(document: dict[str, Any]) -> list[Any]:
    """Return the parts of a plan's document that have the most influence on how long a run takes."""
    spec = document.get("spec", {})
    return [document.get("mechanism_digest"), *(spec.get(key) for key in ("simulation", "bench", "preset"))]


def _mean_time(store: Store, campaign_id: str) -> float | None:
    """Return the mean time of the runs in the first sound file of rows of a campaign [s]; None without one."""
    header = store.plan_header(campaign_id)
    for name in store.files.names(folder(header)):
        if batches_of(name, header):
            try:
                times = read_file(store.files, header, name, ["wall_s"])["wall_s"].drop_null().to_pylist()
            except (BadPart, FileNotFoundError):
                continue
            if times:
                return float(sum(times) / len(times))
    return None


def _first_batch(samples: int, runs: int) -> tuple[tuple[int, int], ...]:
    """Return batches of a plan; the first holds the trial runs, a second one all other samples, if any."""
    return ((0, runs),) if samples == runs else ((0, runs), (runs, samples - runs))

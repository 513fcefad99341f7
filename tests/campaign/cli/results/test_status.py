"""``clearcap status``: counts of rows, within a second."""

import json
import subprocess
import sys
from time import perf_counter

import pyarrow as pa
import pytest

from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from tests.campaign.commands import clearcap_here
from tests.campaign.store.test_store import fill


def test_status_of_a_stopped_campaign(store, plan, capsys, monkeypatch):
    """A campaign that stopped when sure has nothing left."""
    fill(store, plan, [0, 1])
    store.write_json(plan.campaign_id, "stopped.json", {"samples": 12})
    _, output, _ = clearcap_here(capsys, monkeypatch, "status", "--store", store.url, "--json")
    document = json.loads(output)
    assert [document[key] for key in ("samples", "done", "ok", "failed", "left")] == [12, 12, 12, 0, 0]


@pytest.mark.slow
@pytest.mark.alone  # it measures a time
@pytest.mark.parametrize("known", ["with a manifest", "without one"])
def test_status_of_100000_rows(tmp_path, store, campaign_file, known):
    """The whole process is done within a second, from 1,000 parts of 100 rows; it loads no tables and no engine."""
    plan = make_plan(load_campaign(str(campaign_file), samples=100_000), 100)
    store.create_plan(plan)
    row = dict.fromkeys(plan.schema.names, 1.0) | {"status": "ok", "message": "", "settled": True}
    row |= {"steps": 1, "attempts": 1, "earlier_attempts": ""}
    table = pa.Table.from_pylist([row | {"sample": 0}] * 100, schema=plan.schema)
    parts = []
    for batch, (first, count) in enumerate(plan.batches):
        sample = pa.array(range(first, first + count))
        parts.append(store.write_part(plan, batch, table.set_column(0, plan.schema.field(0), sample)))
    if known == "with a manifest":
        store.record(plan, parts)
    command = [sys.executable, "-X", "importtime", "-m", "campaign", "status", plan.campaign_id, "--store", store.url]
    subprocess.run(command, check=True, capture_output=True)
    times = []
    for _ in range(5):
        start = perf_counter()
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        times.append(perf_counter() - start)
    assert done.stdout == f"{plan.campaign_id}: planned, 100000 of 100000 done, 0 failed, 0 left\n"
    assert not any(f" {module}\n" in done.stderr for module in ("pyarrow", "numba", "engine", "distributed"))
    assert min(times) < 1.0

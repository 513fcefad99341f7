"""``clearcap status``: counts of rows, without what would make it slow."""

import json
import subprocess
import sys
from datetime import datetime

import pyarrow as pa
import pytest

from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from campaign.store import part_name
from tests.campaign.commands import clearcap_here
from tests.campaign.store.test_store import fill


def test_status_of_a_stopped_campaign(store, plan, capsys, monkeypatch):
    """A campaign that its stopping rule ended has nothing left."""
    fill(store, plan, [0, 1])
    store.write_json(plan.campaign_id, "stopped.json", {"samples": 12})
    _, output, _ = clearcap_here(capsys, monkeypatch, "status", "--store", store.url, "--json")
    document = json.loads(output)
    assert [document[key] for key in ("samples", "done", "ok", "failed", "left")] == [12, 12, 12, 0, 0]


def test_rows_lost_after_the_end(store, plan, capsys, monkeypatch):
    """A campaign that was completed and lost rows is incomplete, with the command that computes them again."""
    fill(store, plan)
    store.write_json(plan.campaign_id, "state.json", {"state": "completed", "since": 1795305213.8})
    store.files.write(part_name(plan, 2), b"damaged")
    code, output, messages = clearcap_here(capsys, monkeypatch, "status", "--store", store.url)
    command = f"clearcap resume {plan.campaign_id} --store {store.url}"
    assert code == 0
    assert output.startswith(f"{plan.campaign_id}: incomplete, 20 of 25 done, 0 failed, 5 left")
    assert "rows lost after the campaign was completed: 5" in output
    assert command in output
    assert command in messages
    _, output, _ = clearcap_here(capsys, monkeypatch, "status", "--store", store.url, "--json")
    document = json.loads(output)
    assert (document["state"], document["left"]) == ("incomplete", 5)
    since = datetime.fromisoformat(document["since"])
    assert (since.timestamp(), since.tzinfo is not None) == (1795305213, True)


@pytest.mark.processes
@pytest.mark.slow
@pytest.mark.parametrize("known", ["with a manifest", "without one"])
def test_status_of_100000_rows(tmp_path, store, campaign_file, known):
    """It counts 1,000 parts of 100 rows without tables, kernels and dask: `benchmarks overhead` measures its time."""
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
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    assert done.stdout == f"{plan.campaign_id}: planned, 100000 of 100000 done, 0 failed, 0 left, 0 of 301 repeats\n"
    assert not any(f" {module}\n" in done.stderr for module in ("pyarrow", "numba", "distributed"))

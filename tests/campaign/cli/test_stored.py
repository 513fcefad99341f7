"""The verbs that look at a store: list, status, compact; quick, and not stopped by what is broken."""

import json
import subprocess
import sys
from datetime import datetime
from time import perf_counter

import pyarrow as pa
import pytest

from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from campaign.store import part_name
from tests.campaign.commands import clearcap_here
from tests.campaign.store.test_store import fill


def test_list(store, plan, campaign_file, capsys, monkeypatch):
    """Each campaign with its counts; a broken one is a line with its fault."""
    fill(store, plan, [0, 1])
    other = make_plan(load_campaign(str(campaign_file), seed=1), 10)
    store.create_plan(other)
    fill(store, other)
    store.write_json(other.campaign_id, "state.json", {"state": "completed", "since": 1795305213.8})
    store.files.write("broken-0123456789/plan.json", b"{}")
    store.files.write("no-campaign/x", b"")
    code, output, _ = clearcap_here(capsys, monkeypatch, "list", "--store", store.url, "--json")
    entries = {entry["campaign"]: entry for entry in json.loads(output)}
    assert code == 0
    assert set(entries) == {plan.campaign_id, other.campaign_id, "broken-0123456789"}
    running, done, broken = (entries[key] for key in (plan.campaign_id, other.campaign_id, "broken-0123456789"))
    assert [running[key] for key in ("samples", "done", "failed", "left", "state")] == [25, 20, 0, 5, "planned"]
    assert [done[key] for key in ("title", "left", "state")] == ["demo", 0, "completed"]
    assert datetime.fromisoformat(done["when"]).timestamp() == 1795305213
    assert broken["state"] == "broken"
    assert "plan.json cannot be read" in broken["fault"]
    code, output, messages = clearcap_here(capsys, monkeypatch, "list", "--store", store.url)
    assert code == 0
    assert all(campaign_id in output for campaign_id in entries)
    assert "plan.json cannot be read" in messages


def test_list_of_an_empty_store(tmp_path, capsys, monkeypatch):
    """A store without campaigns is an empty list."""
    assert clearcap_here(capsys, monkeypatch, "list", "--store", str(tmp_path / "no"), "--json")[:2] == (0, "[]\n")


def test_compact(store, plan, capsys, monkeypatch):
    """Parts are merged, bad ones are named, and what was done is said."""
    fill(store, plan)
    store.files.write(part_name(plan, 2), b"damaged")
    code, output, messages = clearcap_here(capsys, monkeypatch, "compact", "--store", store.url, "--json")
    document = json.loads(output)
    assert code == 0
    assert document["written"] == ["rows-000000-000001.parquet"]
    assert (document["removed"], document["files"], document["bad_batches"]) == (2, 1, [2])
    assert "part-000002.parquet is not whole" in messages
    code, output, _ = clearcap_here(capsys, monkeypatch, "compact", plan.campaign_id, "--store", store.url)
    assert (code, output) == (0, f"{plan.campaign_id}: 0 files written for 0; 1 files of rows\n")


def test_status_of_a_stopped_campaign(store, plan, capsys, monkeypatch):
    """A campaign that stopped when sure has nothing left."""
    fill(store, plan, [0, 1])
    store.write_json(plan.campaign_id, "stopped.json", {"samples": 12})
    _, output, _ = clearcap_here(capsys, monkeypatch, "status", "--store", store.url, "--json")
    document = json.loads(output)
    assert [document[key] for key in ("samples", "done", "ok", "failed", "left")] == [12, 12, 12, 0, 0]


@pytest.mark.slow
@pytest.mark.alone  # timed
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

"""``clearcap list`` and ``clearcap status``."""

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


def test_campaigns_of_one_title_are_told_by_what_differs(store, plan, campaign_file, capsys, monkeypatch):
    """Seed and limits of two campaigns of one title stand beside it; one that is alone has its title only."""
    campaign_file.write_text(campaign_file.read_text().replace("lsl = 9.0", "lsl = 8.5"))
    other = make_plan(load_campaign(str(campaign_file), seed=1), 10)
    store.create_plan(other)
    campaign_file.write_text(campaign_file.read_text().replace('name = "demo"', 'name = "alone"'))
    store.create_plan(make_plan(load_campaign(str(campaign_file)), 10))
    code, output, _ = clearcap_here(capsys, monkeypatch, "list", "--store", store.url, "--json")
    differs = {entry["campaign"]: entry["differs"] for entry in json.loads(output)}
    assert code == 0
    assert differs[plan.campaign_id] == {"seed": 7, "responses.FC-1.lsl": 9.0}
    assert differs[other.campaign_id] == {"seed": 1, "responses.FC-1.lsl": 8.5}
    _, output, _ = clearcap_here(capsys, monkeypatch, "list", "--store", store.url)
    assert "demo (seed = 1, responses.FC-1.lsl = 8.5)" in output
    assert output.splitlines()[1].endswith("  alone")


def test_empty_store_and_no_store(tmp_path, capsys, monkeypatch):
    """A store without campaigns is an empty list and a message; a folder that does not exist is wrong input."""
    empty, missing = tmp_path / "empty", tmp_path / "no"
    empty.mkdir()
    assert clearcap_here(capsys, monkeypatch, "list", "--store", str(empty), "--json") == (0, "[]\n", "")
    code, output, messages = clearcap_here(capsys, monkeypatch, "list", "--store", str(empty))
    assert (code, output) == (0, "")
    assert f"holds no campaign; make one: clearcap run CAMPAIGN --store {empty}" in messages
    code, output, messages = clearcap_here(capsys, monkeypatch, "list", "--store", str(missing), "--json")
    assert (code, output) == (2, "")
    assert f"store {missing}: no such folder" in messages


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
    row |= {"steps": 1, "attempts": 1, "earlier_attempts": "", "at_impact": "", "ambiguous": False}
    table = pa.Table.from_pylist([row | {"sample": 0}] * 100, schema=plan.schema)
    parts = []
    for batch, (first, count) in enumerate(plan.batches):
        sample = pa.array(range(first, first + count))
        parts.append(store.write_part(plan, batch, table.set_column(0, plan.schema.field(0), sample)))
    if known == "with a manifest":
        store.record(plan, parts)
    command = [sys.executable, "-X", "importtime", "-m", "clearcap", "status", plan.campaign_id, "--store", store.url]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    assert done.stdout == f"{plan.campaign_id}: planned, 100000 of 100000 done, 0 failed, 0 left, 0 of 301 repeats\n"
    assert not any(f" {module}\n" in done.stderr for module in ("pyarrow", "numba", "distributed"))

"""``clearcap list``: what is broken does not stop it."""

import json
from datetime import datetime

from campaign.plan import make_plan
from campaign.spec.load import load_campaign
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

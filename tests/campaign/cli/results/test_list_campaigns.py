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


def test_list_of_an_empty_store(tmp_path, capsys, monkeypatch):
    """A store without campaigns is an empty list."""
    assert clearcap_here(capsys, monkeypatch, "list", "--store", str(tmp_path / "no"), "--json")[:2] == (0, "[]\n")

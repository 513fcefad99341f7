"""Tokens of campaigns: another whenever something changed that a list shows, and otherwise the same."""

import os
from pathlib import Path

import pytest

from campaign.coordinator.requests import delete_campaign
from campaign.coordinator.state import write_state
from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from campaign.store import open_store, part_name
from campaign.store.files import local
from campaign.store.labels import LabelChange, change_labels
from campaign.store.layout import HEARTBEAT, LOG, PLAN, STOPPED
from campaign.store.store import change_token, change_tokens
from tests.campaign.store.test_store import fill

CHANGES = {
    "rows": lambda store, plan: fill(store, plan, [2]),
    "rows replaced": lambda store, plan: store.files.write(part_name(plan, 0), b"others"),
    "rows lost": lambda store, plan: store.files.remove(part_name(plan, 0)),
    "quarantine": lambda store, plan: store.files.move(part_name(plan, 0), part_name(plan, 0) + ".bad"),
    "repeats": lambda store, plan: store.files.write(f"{plan.campaign_id}/repeats-1/part-000000.parquet", b"x"),
    "manifest": lambda store, plan: store.record(plan, store.survey(plan).parts.values()),
    "compaction": lambda store, plan: store.compact(plan),
    "state": lambda store, plan: write_state(store, plan.campaign_id, "completed"),
    "stopped": lambda store, plan: store.write_json(plan.campaign_id, STOPPED, {"samples": 10}),
    "labels": lambda store, plan: change_labels(store, plan.campaign_id, LabelChange("alice")),
    "report": lambda store, plan: store.files.write(f"{plan.campaign_id}/report/report.html", b"2"),
    "comparison": lambda store, plan: store.files.write(f"{plan.campaign_id}/comparisons/a-2/report.html", b"1"),
    "comparison again": lambda store, plan: store.files.write(f"{plan.campaign_id}/comparisons/a-1/report.html", b"2"),
}


@pytest.fixture
def exact(monkeypatch):
    """Have no file count as one that changed just now, so that its own stamp must tell."""
    monkeypatch.setattr(local, "RECENT", -1e9)


@pytest.fixture
def filled(either_store, plan, campaign_file):
    """Return a store with another campaign, and one with rows, a report and a comparison."""
    either_store.create_plan(make_plan(load_campaign(str(campaign_file), seed=1), 10))
    fill(either_store, plan, [0, 1])
    for folder in ("report", "comparisons/a-1"):
        either_store.files.write(f"{plan.campaign_id}/{folder}/report.html", b"1")
    if either_store.files.local:  # what changes is dated otherwise, however coarse the clock that dates files is
        for path in Path(either_store.files.path("")).rglob("*"):
            os.utime(path, (1e9, 1e9))
    return either_store


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_is_seen(filled, plan, exact, change):
    """In the token of its campaign and of no other; one campaign alone has the token that it has among all."""
    before = change_tokens(filled)
    assert list(before) == filled.campaigns()
    assert change_tokens(open_store(filled.url)) == before
    CHANGES[change](filled, plan)
    after = change_tokens(filled)
    assert {name for name in before if before[name] != after[name]} == {plan.campaign_id}
    assert change_token(filled, plan.campaign_id) == after[plan.campaign_id]


def test_what_changes_all_the_time_is_left_out(filled, plan, exact):
    """Heartbeats, the log, files that are being written; the service, and folders that are no campaign."""
    before = change_tokens(filled)
    filled.write_json(plan.campaign_id, HEARTBEAT, {"beat": 1})
    for name in (f"{plan.campaign_id}/{LOG}", f"{plan.campaign_id}/state.json.1.tmp", "service/heartbeat.json", "x/y"):
        filled.files.write(name, b"x")
    assert change_tokens(filled) == before


def test_campaigns_that_are_gone(filled, plan, exact):
    """A deleted one has no token, nor has a folder without a plan."""
    delete_campaign(filled, plan.campaign_id)
    others = filled.campaigns()
    assert (change_token(filled, plan.campaign_id), list(change_tokens(filled))) == (None, others)
    filled.remove(others[0], PLAN)
    assert change_tokens(filled) == {}
    assert change_tokens(open_store(f"{filled.url}/never")) == {}


def test_what_changed_just_now_may_change_again(store, plan):
    """Two changes in one tick of the clock have one date: until it is over, a token never comes twice."""
    assert change_token(store, plan.campaign_id) != change_token(store, plan.campaign_id)
    for path in Path(store.files.path(plan.campaign_id)).iterdir():
        os.utime(path, (1e9, 1e9))
    assert change_token(store, plan.campaign_id) == change_token(store, plan.campaign_id)

"""Rows are counted again when files have changed, and only then."""

from dataclasses import replace

import pytest

from campaign.coordinator import lease
from campaign.coordinator.heartbeat import Heartbeat
from campaign.coordinator.lease import hold_lease
from campaign.coordinator.progress_report import progress_report
from campaign.coordinator.state import write_state
from campaign.errors import StoreError
from campaign.store.files import local
from campaign.store.layout import HEARTBEAT, LEASE
from clearcap.web import index
from clearcap.web.index import CountedStatuses
from tests.campaign.driving import computed
from tests.clearcap.web.conftest import only_in_a_folder


@pytest.fixture
def now():
    """Return the time of the statuses, which a test moves [s]."""
    return [0.0]


@pytest.fixture
def counted(campaign, storage, tmp_path, monkeypatch, now):
    """Return the store and plan of a completed campaign, statuses of it, and the ids whose rows were counted."""
    monkeypatch.setattr(local, "RECENT", -1e9)  # a file's own stamp must tell that it has changed
    store, plan = computed(storage(tmp_path), campaign, 10)
    write_state(store, plan.campaign_id, "completed")
    counts = []

    def counting(store, header, say):
        counts.append(header.campaign_id)
        return progress_report(store, header, say)

    monkeypatch.setattr(index, "progress_report", counting)
    return store, plan, CountedStatuses(store.hasty, lambda: now[0]), counts


def test_rows_are_counted_once_until_files_change(counted):
    store, plan, statuses, counts = counted
    expected = progress_report(store, store.plan_header(plan.campaign_id), pytest.fail) | {"remarks": []}
    assert [statuses.status(plan.campaign_id) for _ in range(3)] == [expected] * 3
    assert len(counts) == 1
    store.files.remove(f"{plan.campaign_id}/parts/part-000001.parquet")
    assert (statuses.status(plan.campaign_id)["state"], statuses.status(plan.campaign_id)["left"]) == ("incomplete", 10)
    assert len(counts) == 2
    write_state(store, plan.campaign_id, "cancelled")
    assert statuses.status(plan.campaign_id)["state"] == "cancelled"
    assert len(counts) == 3


@only_in_a_folder
def test_damage_that_changes_no_listing_is_found_after_a_minute(counted, now):
    store, plan, statuses, _ = counted
    assert statuses.status(plan.campaign_id)["remarks"] == []
    part = store.files.address(f"{plan.campaign_id}/parts/part-000001.parquet")
    with open(part, "r+b") as file:
        file.truncate(100)
    now[0] = 59.0
    assert statuses.status(plan.campaign_id)["remarks"] == []
    now[0] = 61.0
    found = statuses.status(plan.campaign_id)
    assert found["left"] == 10
    assert "truncated" in found["remarks"][0]


@pytest.mark.parametrize("state", ["queued", "running"])
def test_what_moves_is_counted_each_time(counted, state):
    """A coordinator's life and its heartbeat are in no token."""
    store, plan, statuses, counts = counted
    write_state(store, plan.campaign_id, state)
    for _ in range(3):
        statuses.status(plan.campaign_id)
    assert len(counts) == 3


def test_campaign_that_runs_is_as_its_coordinator_counts(counted):
    """No row is counted while it does; before its first heartbeat they are."""
    store, plan, statuses, counts = counted
    write_state(store, plan.campaign_id, "running")
    beat = Heartbeat(plan.campaign_id, "running", 25, 20, 19, 1, 5, {"ok": 19, "jammed": 1}, 3.5, None, 2, repeats=4)
    with hold_lease(store, plan.campaign_id) as token:
        assert (statuses.status(plan.campaign_id)["done"], len(counts)) == (25, 1)
        store.write_json(plan.campaign_id, HEARTBEAT, replace(beat, token=token, beat=1).to_json())
        found = statuses.status(plan.campaign_id)
        assert (found["state"], found["done"], found["statuses"]) == ("running", 20, {"ok": 19, "jammed": 1})
        assert (found["repeats"], found["heartbeat"]["rate"], len(counts)) == (4, 3.5, 1)
        assert found.keys() == progress_report(store, store.plan_header(plan.campaign_id), print).keys() | {"remarks"}
    assert (statuses.status(plan.campaign_id)["done"], len(counts)) == (25, 2)


def test_coordinator_elsewhere_is_judged_by_several_calls(counted, monkeypatch):
    """No call waits; one that comes after ten seconds of the same heartbeat says that nobody writes it."""
    store, plan, statuses, _ = counted
    write_state(store, plan.campaign_id, "running")
    store.write_json(plan.campaign_id, LEASE, {"token": "x", "host": "another machine", "name": "node7", "pid": 4711})
    beat = Heartbeat(plan.campaign_id, "running", 25, 20, 20, 0, 5, {"ok": 20}, 3.5, 9.0, 2)
    store.write_json(plan.campaign_id, HEARTBEAT, beat.to_json())
    assert statuses.status(plan.campaign_id)["waits_for"] == ""
    monkeypatch.setattr(lease, "STALE_AFTER", 0.0)
    found = statuses.status(plan.campaign_id)
    assert "process 4711 on node7" in found["waits_for"]
    assert found["heartbeat"]["eta_s"] is None


def test_kept_are_few(counted, monkeypatch):
    _, plan, statuses, counts = counted
    monkeypatch.setattr(index, "MOST_KEPT", 0)
    for _ in range(2):
        statuses.status(plan.campaign_id)
    assert len(counts) == 2


def test_deleted_campaign_is_none(counted):
    store, plan, statuses, _ = counted
    statuses.status(plan.campaign_id)
    store.files.remove_tree(plan.campaign_id)
    with pytest.raises(StoreError, match=r"plan\.json"):
        statuses.status(plan.campaign_id)

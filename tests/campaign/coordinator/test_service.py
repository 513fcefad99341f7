"""The service: a campaign is its own until the report is written, and no fault of one keeps the others waiting."""

import pytest

import campaign.reports.report
from campaign.cluster.cluster import Cluster
from campaign.coordinator import service
from campaign.coordinator.coordinate import coordinate
from campaign.coordinator.service import serve
from campaign.coordinator.state import state_of
from campaign.errors import CampaignError, StoreError
from campaign.spec.load import load_campaign
from tests.campaign.driving import computed

CLUSTER = Cluster(workers=1)


@pytest.fixture
def done(tmp_path, campaign):
    """Return a store and a queued plan whose rows are all stored."""
    return computed(tmp_path / "runs", campaign, 10)


def test_report_that_a_kill_took_is_written_by_the_next(done):
    """Killed between the last row and the report: the campaign is completed and open, and the next service ends it."""
    store, plan = done
    coordinate(store, plan, CLUSTER, report_due=True)
    state = state_of(store, plan.campaign_id)
    assert (state["state"], state["open"]) == ("completed", True)
    assert serve(store, CLUSTER, once=True) == [plan.campaign_id]
    assert store.files.exists(f"{plan.campaign_id}/report/report.html")
    state = state_of(store, plan.campaign_id)
    assert (state["state"], state["open"]) == ("completed", False)
    assert serve(store, CLUSTER, once=True) == []


def test_without_a_report_it_is_closed_at_its_end(done):
    """``--no-report``: nothing is due."""
    store, plan = done
    assert serve(store, CLUSTER, once=True, with_report=False) == [plan.campaign_id]
    assert not state_of(store, plan.campaign_id)["open"]
    assert not store.files.exists(f"{plan.campaign_id}/report/report.html")


@pytest.mark.parametrize("fault", [CampaignError("no rows"), ZeroDivisionError("no rows")])
def test_report_that_cannot_be_written_is_said_once(done, campaign_file, monkeypatch, fault):
    """The campaign is closed with the reason; another one in the queue gets its report."""
    store, plan = done
    other = load_campaign(str(campaign_file), samples=5)
    _, second = computed(store.url, other, 5)
    write = campaign.reports.report.report

    def fails_for_the_first(store, of):
        if of.campaign_id == plan.campaign_id:
            raise fault
        return write(store, of)

    monkeypatch.setattr(campaign.reports.report, "report", fails_for_the_first)
    assert sorted(serve(store, CLUSTER, once=True)) == sorted([plan.campaign_id, second.campaign_id])
    state = state_of(store, plan.campaign_id)
    assert (state["state"], state["open"]) == ("completed", False)
    assert "no rows" in state["message"]
    assert store.files.exists(f"{second.campaign_id}/report/report.html")


def test_report_is_tried_again_when_the_store_fails(done, monkeypatch):
    """A store that is out of reach while the report is written is tried again."""
    store, plan = done
    write, calls = campaign.reports.report.report, []

    def fails_once(*words):
        calls.append(words)
        if len(calls) == 1:
            raise StoreError("out of reach")
        return write(*words)

    monkeypatch.setattr(service, "HEARTBEAT_INTERVAL", 0.01)
    monkeypatch.setattr(campaign.reports.report, "report", fails_once)
    assert serve(store, CLUSTER, once=True) == [plan.campaign_id]
    assert len(calls) == 2
    assert not state_of(store, plan.campaign_id)["open"]

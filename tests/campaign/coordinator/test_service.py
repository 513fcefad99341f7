"""The service: a campaign is its own until the report is written, and no fault of one keeps the others waiting."""

import pytest

from campaign.cluster.cluster import Cluster
from campaign.coordinator import service
from campaign.coordinator.coordinate import coordinate
from campaign.coordinator.requests import delete_campaign
from campaign.coordinator.service import serve
from campaign.coordinator.state import state_of, write_state
from campaign.errors import CampaignError, StoreError
from campaign.spec.load import load_campaign
from campaign.store.layout import HEARTBEAT, STATE
from clearcap.questions.report import report
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
    assert serve(store, CLUSTER, report=report, once=True) == [plan.campaign_id]
    assert store.files.exists(f"{plan.campaign_id}/report/report.html")
    state = state_of(store, plan.campaign_id)
    assert (state["state"], state["open"]) == ("completed", False)
    assert serve(store, CLUSTER, report=report, once=True) == []


def test_without_a_report_it_is_closed_at_its_end(done):
    """``--no-report``: nothing is due."""
    store, plan = done
    assert serve(store, CLUSTER, report=None, once=True) == [plan.campaign_id]
    assert not state_of(store, plan.campaign_id)["open"]
    assert not store.files.exists(f"{plan.campaign_id}/report/report.html")


def test_it_is_decided_before_it_is_reported(done):
    """What the samples leave open is computed first; without a report nothing asks for it."""
    store, plan = done
    calls = []
    hooks = {"decide": lambda *_: calls.append("decide"), "once": True}
    assert serve(store, CLUSTER, report=lambda *_: calls.append("report"), **hooks) == [plan.campaign_id]
    write_state(store, plan.campaign_id, "queued")
    assert serve(store, CLUSTER, report=None, **hooks) == [plan.campaign_id]
    assert calls == ["decide", "report"]


@pytest.mark.parametrize("fault", [CampaignError("no rows"), ZeroDivisionError("no rows")])
def test_report_that_cannot_be_written_is_said_once(done, campaign_file, fault):
    """The campaign is closed with the reason; another one in the queue gets its report."""
    store, plan = done
    other = load_campaign(str(campaign_file), samples=5)
    _, second = computed(store.url, other, 5)

    def fails_for_the_first(store, of):
        if of.campaign_id == plan.campaign_id:
            raise fault
        return report(store, of)

    assert sorted(serve(store, CLUSTER, report=fails_for_the_first, once=True)) == sorted(
        [plan.campaign_id, second.campaign_id]
    )
    state = state_of(store, plan.campaign_id)
    assert (state["state"], state["open"]) == ("completed", False)
    assert "no rows" in state["message"]
    assert store.files.exists(f"{second.campaign_id}/report/report.html")


def test_report_is_tried_again_when_the_store_fails(done, monkeypatch):
    """A store that is out of reach while the report is written is tried again."""
    store, plan = done
    calls = []

    def fails_once(*words):
        calls.append(words)
        if len(calls) == 1:
            raise StoreError("out of reach")
        return report(*words)

    monkeypatch.setattr(service, "HEARTBEAT_INTERVAL", 0.01)
    assert serve(store, CLUSTER, report=fails_once, once=True) == [plan.campaign_id]
    assert len(calls) == 2
    assert not state_of(store, plan.campaign_id)["open"]


@pytest.mark.parametrize("reached", ["running", "completed"])
def test_campaign_whose_state_is_lost_is_continued(done, reached):
    """The heartbeat says that someone began it; nothing says that its report is written."""
    store, plan = done
    store.remove(plan.campaign_id, STATE)
    assert serve(store, CLUSTER, report=report, once=True) == []  # planned by someone, and not submitted
    store.write_json(plan.campaign_id, HEARTBEAT, {"state": reached})
    assert serve(store, CLUSTER, report=report, once=True) == [plan.campaign_id]
    state = state_of(store, plan.campaign_id)
    assert (state["state"], state["open"]) == ("completed", False)
    assert store.files.exists(f"{plan.campaign_id}/report/report.html")


def test_unreadable_campaign_keeps_no_other_waiting(done, campaign_file, caplog):
    """It is logged once, and passed over until its file is restored."""
    store, plan = done
    _, second = computed(store.url, load_campaign(str(campaign_file), samples=5), 5)
    store.files.write(f"{plan.campaign_id}/{STATE}", b"garbage")
    assert serve(store, CLUSTER, report=report, once=True) == [second.campaign_id]
    lines = [r.getMessage() for r in caplog.records if "is skipped" in r.getMessage()]
    assert len(lines) == 1
    assert "restore or remove it" in lines[0]
    store.remove(plan.campaign_id, STATE)
    store.write_json(plan.campaign_id, HEARTBEAT, {"state": "running"})
    assert serve(store, CLUSTER, report=report, once=True) == [plan.campaign_id]


def test_interrupted_service_leaves_its_campaign_to_the_next(store, plan, monkeypatch):
    """Ctrl-C ends the service; nobody has ended the campaign."""
    write_state(store, plan.campaign_id, "queued")

    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("campaign.coordinator.coordinate.Coordinator.run", interrupt)
    with pytest.raises(KeyboardInterrupt):
        serve(store, CLUSTER, report=report)
    state = state_of(store, plan.campaign_id)
    assert (state["state"], state["open"]) == ("interrupted", True)
    with pytest.raises(KeyboardInterrupt):
        coordinate(store, plan, CLUSTER)  # of this one campaign: it was ended
    assert not state_of(store, plan.campaign_id)["open"]


def test_campaign_that_is_deleted_meanwhile(done, campaign_file, monkeypatch):
    """It was queued when another one began: it is passed over, and nobody waits for its plan to come back."""
    store, _ = done
    computed(store.url, load_campaign(str(campaign_file), samples=5), 5)

    def deletes_the_other(store, plan, *words, **options):
        for other in set(store.campaigns()) - {plan.campaign_id}:
            delete_campaign(store, other)
        return coordinate(store, plan, *words, **options)

    monkeypatch.setattr(service, "coordinate", deletes_the_other)
    served = serve(store, CLUSTER, report=report, once=True)
    assert (len(served), store.campaigns()) == (1, served)


def test_failed_rows_that_somebody_asked_for_come_first(done, monkeypatch):
    """The service fulfils the request before it goes on with the campaign."""
    store, plan = done
    asked = []
    monkeypatch.setattr(service, "rerun_requested", lambda _, plan, __: asked.append(plan.campaign_id))
    assert serve(store, CLUSTER, report=None, once=True) == [plan.campaign_id] == asked

"""The page of the administration about queue, workers, jobs and store."""

import shutil
from pathlib import Path

import pytest

from campaign.coordinator.heartbeat import Heartbeat, WorkerProgress
from campaign.coordinator.lease import beating, hold_lease
from campaign.coordinator.state import write_state
from campaign.store import open_store
from campaign.store.layout import HEARTBEAT, SERVICE
from clearcap.web.jobs.pool import FairQueue
from tests.clearcap.web.conftest import only_in_a_folder
from tests.clearcap.web.pages.forms import Page


@pytest.fixture
def show(reported, client, browse):
    """Return what returns the page, as an admin's browser gets it."""

    def shown():
        answer = client.get("/admin/system", headers={**browse("admin"), "Accept": "text/html"})
        assert answer.status_code == 200, answer.text
        assert Page(answer.text).faults == []
        return " ".join(answer.text.split())

    return shown


def test_nothing_at_work(show):
    text = show()
    assert "none: what is queued waits" in text
    assert "None runs." in text
    assert "None waits." in text
    assert "0 at work, 0 waiting" in text
    assert '<dt>Readable</dt><dd><span class="good">yes</span>' in text


def test_campaign_at_work_and_one_that_waits(show, service, reported, settings):
    """Process, workers, rows left and rate of the one that runs; then it waits, because its process has ended."""
    store = open_store(settings.store)
    with hold_lease(store, SERVICE), beating(store, SERVICE), hold_lease(store, reported):
        write_state(store, reported, "running")
        beat = Heartbeat(reported, "running", 25, 10, 10, 0, 15, {"ok": 10}, 5.0, 3.0, 4)
        store.write_json(reported, HEARTBEAT, beat.to_json())
        service.watcher.hurry()
        text = show()
        running = text.partition("Running campaigns")[2].partition("Waiting campaigns")[0]
        assert f'href="/campaigns/{reported}"' in running
        for cell in (">4<", ">15<", ">5.00<", ">3 s<"):
            assert cell in running
        assert '<span class="good">alive</span>' in text
        assert "<dt>Workers that compute</dt><dd>4</dd>" in text
    service.watcher.hurry()
    text = show()
    waiting = text.partition("Waiting campaigns")[2]
    assert f'href="/campaigns/{reported}"' in waiting
    assert "interrupted" in waiting
    assert "<dt>Workers that compute</dt><dd>0</dd>" in text


def test_every_user_sees_queue_and_workers(client, browse, service, reported, settings):
    """On a page of their own, which says nothing of other users' jobs and of how the server was started."""
    store = open_store(settings.store)
    with hold_lease(store, reported):
        write_state(store, reported, "running")
        lines = [WorkerProgress("node<1>", 77, 6, 2.5, 4990.0), WorkerProgress("node2", 78, 4, 0.0, 5001.0)]
        beat = Heartbeat(reported, "running", 25, 10, 10, 0, 15, {"ok": 10}, 6.0, 3.0, 4, time=5000.0, by_worker=lines)
        store.write_json(reported, HEARTBEAT, beat.to_json())
        service.watcher.hurry()
        answer = client.get("/work", headers={**browse("viewer"), "Accept": "text/html"})
    assert answer.status_code == 200
    assert Page(answer.text).faults == []
    running = answer.text.partition("Running campaigns")[2].partition("Waiting campaigns")[0]
    assert f'href="/campaigns/{reported}"' in running
    for cell in (">4<", ">15<", ">6.00<", ">1.50<", ">3 s<"):
        assert cell in running
    assert '<tr><th scope="row">node&lt;1&gt;</th><td class="number">77</td><td class="number">6</td>' in running
    for cell in (">2.50<", ">10 s ago<", ">78<", ">0 s ago<"):
        assert cell in running
    assert "Started by this server" not in answer.text
    assert "Jobs of pages" not in answer.text


def test_jobs_by_user(show, monkeypatch):
    monkeypatch.setattr(FairQueue, "by_user", {"eva": (1, 2), "bob": (1, 0)})
    text = show()
    assert "2 at work, 2 waiting" in text
    assert '<th scope="row">eva</th><td class="number">1</td><td class="number">2</td>' in text


@only_in_a_folder
def test_a_store_that_is_away(show, settings, service):
    """The page comes all the same, and says why nothing is known."""
    shutil.rmtree(settings.store)
    Path(settings.store).symlink_to(settings.store)  # a loop
    service.watcher.hurry()
    text = show()
    assert "The store cannot be read" in text
    assert '<dt>Readable</dt><dd><span class="fault">no: ' in text


def test_campaigns_that_cannot_be_read_are_named(show, settings, service):
    store = open_store(settings.store)
    store.write_json("x-0123456789", "plan.json", {})
    service.watcher.hurry()
    assert '<a href="/campaigns/x-0123456789">x-0123456789</a>' in show().partition("Campaigns that cannot be read")[2]

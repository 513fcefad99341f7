"""Heartbeats: counts of stored rows and their rate; one look tells a follower all, and nothing in it waits."""

import json
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest

import campaign.coordinator.heartbeat as following
from campaign.coordinator.heartbeat import Heartbeat, Progress, heartbeats, observe, observe_patiently
from campaign.coordinator.lease import STALE_AFTER, hold_lease, this_process
from campaign.coordinator.state import write_state
from campaign.errors import StoreError
from campaign.store import Survey, open_store
from campaign.store.layout import HEARTBEAT, LEASE, PLAN, STATE
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress, moments
from reporting import capability
from tests.campaign import fake_engine


def test_rows_that_were_there_are_counted_and_not_computed(store, plan, monkeypatch):
    """A part that a lost worker had written is rows done, and no work of this coordinator: the rate has none of it."""
    clock = SimpleNamespace(monotonic=lambda: 1000.0, time=time.time)
    monkeypatch.setattr(following, "time", clock)
    progress = Progress(store, plan, store.survey(plan))
    address = CampaignAddress.of(store, plan, fake_engine.simulate)
    progress.add(run_batch(address, BatchRequest(0)))
    again = run_batch(address, BatchRequest(0))
    assert not again.computed
    fresh = Progress(store, plan, store.survey(plan))
    assert (fresh.done, fresh.computed) == (10, 0)
    progress = Progress(store, plan, store.survey(plan))
    progress.add(run_batch(address, BatchRequest(1)))
    run_batch(address, BatchRequest(2))
    progress.add(run_batch(address, BatchRequest(2)))
    progress.workers, clock.monotonic = 2, lambda: 1005.0
    heartbeat = progress.heartbeat("running")
    assert (heartbeat.done, heartbeat.ok, heartbeat.failed, heartbeat.left) == (25, 25, 0, 0)
    assert (progress.computed, heartbeat.workers) == (10, 2)
    assert heartbeat.responses["FC-1"]["n"] == 25
    assert heartbeat.rate == 10 / 5.0


def test_each_worker_has_a_line(store, plan, monkeypatch):
    """Rows, rate while it computes, and when its last batch came; of many, those that were seen last."""
    clock = SimpleNamespace(monotonic=lambda: 1000.0, time=lambda: 5000.0)
    monkeypatch.setattr(following, "time", clock)
    monkeypatch.setattr(following, "MOST_LISTED", 3)
    progress = Progress(store, plan, store.survey(plan))
    address = CampaignAddress.of(store, plan, fake_engine.simulate)
    first, second = (replace(run_batch(address, BatchRequest(batch)), seconds=4.0) for batch in (0, 1))
    again = replace(run_batch(address, BatchRequest(1)), seconds=2.0)  # the store had its rows
    progress.add(first, ("node2", 7))
    clock.time = lambda: 5003.0
    progress.add(second, ("node2", 7))
    progress.add(again, ("node1", 8))
    progress.add(first)  # by nobody knows whom
    beat = progress.heartbeat("running")
    assert [(w.host, w.pid, w.rows, w.rate, w.seen) for w in beat.by_worker] == [
        ("node1", 8, 0, 0.0, 5003.0),
        ("node2", 7, 20, 2.5, 5003.0),
    ]
    assert Heartbeat.from_json(json.loads(json.dumps(beat.to_json()))) == beat
    for pid in (9, 10):
        progress.add(again, ("node1", pid))
    assert [w.pid for w in progress.heartbeat("running").by_worker] == [8, 9, 10]


def test_document_of_another_version_is_no_heartbeat():
    """Fields that this version does not know: it is ignored, and nothing breaks."""
    assert Heartbeat.from_json({"campaign": "c", "speed": 3}) is None


def cpk_of(plan, values, lsl, usl):
    """Return the running Cpk of values of a response with these limits."""
    response = plan.spec.responses["FC-1"].model_copy(update={"lsl": lsl, "usl": usl})
    spec = plan.spec.model_copy(update={"responses": {"FC-1": response}})
    table = pa.table({"FC-1": pa.array(values, pa.float64())})
    progress = Progress(open_store("memory://"), replace(plan, spec=spec), Survey({}, [], {}, {}, 0))
    progress.moments = moments(table, ["FC-1"])
    return progress.heartbeat("running").responses["FC-1"]["cpk"]


@pytest.mark.parametrize(("lsl", "usl"), [(9.0, 16.0), (9.0, None), (None, 16.0), (None, None)])
def test_cpk_is_that_of_the_report(plan, lsl, usl):
    """One- and two-sided limits; none without limits."""
    x = np.random.default_rng(2).normal(12.5, 0.5, 200)
    expected = capability(x, lsl=lsl, usl=usl).cpk if lsl or usl else None
    assert cpk_of(plan, x, lsl, usl) == (None if expected is None else pytest.approx(expected, rel=1e-12))


def test_cpk_of_no_spread(plan):
    """One value, or all equal: none."""
    assert cpk_of(plan, [1.0], 0.0, 2.0) is None
    assert cpk_of(plan, [1.0, 1.0], 0.0, 2.0) is None


@pytest.fixture(autouse=True)
def nobody_sleeps(monkeypatch):
    """Refuse to wait, in whatever module."""

    def sleep(_):
        raise AssertionError("a look waits")

    monkeypatch.setattr("time.sleep", sleep)


def beat(campaign_id, number, done=5):
    """Return a heartbeat as a coordinator writes it."""
    counts = {"samples": 25, "done": done, "ok": done, "failed": 0, "left": 25 - done}
    document = {"campaign": campaign_id, "state": "running", **counts, "statuses": {"ok": done}, "rate": 1.0}
    return {**document, "eta_s": None, "workers": 2, "beat": number}


def test_a_planned_campaign(store, plan):
    """It has no heartbeat, nobody waits for it, and two looks are equal."""
    seen = observe(store, plan.campaign_id)
    assert (seen.state, seen.heartbeat, seen.odd, seen.sign, seen.is_over) == ("planned", None, None, None, True)
    assert observe(store, plan.campaign_id, seen) == seen


def test_a_running_campaign_that_goes_on(store, plan):
    """Its heartbeat has the state of the state file; only what a follower would see makes two looks differ."""
    name = plan.campaign_id
    with hold_lease(store, name):
        write_state(store, name, "running", "a word")
        store.write_json(name, HEARTBEAT, beat(name, 1))
        first = observe(store, name, now=0.0)
        assert (first.state, first.is_over, first.heartbeat.done) == ("running", False, 5)
        assert (first.heartbeat.state, first.heartbeat.message) == ("running", "a word")
        assert first.sign.is_alive
        assert observe(store, name, first, now=60.0) == first
        store.write_json(name, HEARTBEAT, beat(name, 2, done=6))
        assert observe(store, name, first, now=61.0) != first
    assert observe(store, name, first).state == "interrupted"


def test_a_coordinator_elsewhere_is_judged_by_two_looks(store, plan):
    """Unknown at first, alive with a new heartbeat, dead after enough of the same one; the state is the file's."""
    name = plan.campaign_id
    write_state(store, name, "running")
    elsewhere = {"host": "another machine", "name": "node7", "pid": 4711}
    store.write_json(name, LEASE, {"token": "x", **this_process(), **elsewhere})
    store.write_json(name, HEARTBEAT, beat(name, 1))
    seen = observe(store, name, now=100.0)
    assert (seen.state, seen.sign.is_alive) == ("running", None)
    store.write_json(name, HEARTBEAT, beat(name, 2))
    seen = observe(store, name, seen, now=102.0)
    assert (seen.sign.is_alive, seen.sign.seen_at) == (True, 102.0)
    seen = observe(store, name, seen, now=102.0 + 0.9 * STALE_AFTER)
    assert seen.sign.is_alive
    seen = observe(store, name, seen, now=102.0 + STALE_AFTER)
    assert (seen.state, seen.sign.is_alive, seen.sign.seen_at) == ("running", False, 102.0)
    assert seen.heartbeat.waits_for.startswith("its coordinator no longer writes (process 4711 on node7, last at 19")
    assert (seen.heartbeat.eta_s, observe(store, name, seen, now=200.0)) == (None, seen)
    store.write_json(name, HEARTBEAT, beat(name, 3))
    assert observe(store, name, seen, now=201.0).heartbeat.waits_for == ""


def test_a_single_look_is_patient_only_with_who_seems_silent(store, plan, monkeypatch):
    """A coordinator elsewhere: one that has just written is not waited for, nor one whose clock is wrong but beats."""
    name, looks = plan.campaign_id, []
    write_state(store, name, "running")
    store.write_json(name, LEASE, {"token": "x", **this_process(), "host": "another machine"})
    monkeypatch.setattr("time.time", lambda: 1e9)
    store.write_json(name, HEARTBEAT, beat(name, 1) | {"time": 1e9 + 1 - STALE_AFTER})
    assert observe_patiently(store, name).heartbeat.waits_for == ""
    store.write_json(name, HEARTBEAT, beat(name, 2))

    def sleep(_):
        looks.append(1)
        if writes:
            store.write_json(name, HEARTBEAT, beat(name, 3))

    monkeypatch.setattr("time.sleep", sleep)
    monkeypatch.setattr("time.monotonic", lambda: float(len(looks)))
    for writes in (True, False):
        looks.clear()
        waits_for = observe_patiently(store, name).heartbeat.waits_for
        assert (waits_for == "", len(looks)) == (writes, 1 if writes else STALE_AFTER)


@pytest.mark.parametrize("name", [HEARTBEAT, STATE])
def test_what_clearcap_never_writes_is_said(store, plan, name):
    """A document with a strange content is named; one that is no JSON is an error of this campaign only."""
    store.write_json(plan.campaign_id, name, {"state": 7})
    assert f"{name} " in observe(store, plan.campaign_id).odd
    store.files.write(f"{plan.campaign_id}/{name}", b"garbage")
    with pytest.raises(StoreError, match=f"{name} is not JSON"):
        observe(store, plan.campaign_id)


def test_a_campaign_that_is_gone(store, plan):
    """Its plan was removed: that is a state, and no error that a poller must catch."""
    store.remove(plan.campaign_id, PLAN)
    assert (observe(store, plan.campaign_id).state, observe(store, "never-was").state) == ("gone", "gone")


def test_heartbeats_are_what_looks_show(store, plan, monkeypatch):
    """Each look is yielded, the first of all from the rows, until the campaign is over; between two looks it sleeps."""
    name, slept = plan.campaign_id, []

    def sleep(seconds):
        slept.append(seconds)
        if len(slept) == 1:
            store.write_json(name, HEARTBEAT, beat(name, 1))
        else:
            write_state(store, name, "cancelled", "by somebody")

    write_state(store, name, "queued")
    monkeypatch.setattr(following.time, "sleep", sleep)
    shown = [(each.state, each.done, each.left) for each in heartbeats(store, name)]
    assert shown == [("queued", 0, 25), ("queued", 5, 20), ("cancelled", 5, 20)]

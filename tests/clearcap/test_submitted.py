"""Campaigns in the background: awaited without blocking the loop, waited for, and their rows told as they come."""

import asyncio
import tomllib
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pandas as pd
import pytest

import clearcap
from campaign.coordinator import lease
from campaign.coordinator.heartbeat import Heartbeat
from campaign.coordinator.lease import this_process
from campaign.coordinator.state import write_state
from campaign.coordinator.submit import Assignment, submit
from campaign.spec.load import load_campaign
from campaign.store import Store, open_store
from campaign.store.layout import HEARTBEAT, LEASE, SERVICE
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from clearcap.running import Follower
from clearcap.submitted import RunningCampaign, _has_ended
from tests.campaign import fake_engine
from tests.campaign.conftest import SPEC
from tests.until import until

NOBODY = 2**22 + 1  # no process has this number


@pytest.fixture
def queued(tmp_path):
    """Return a store, the plan of a campaign in it that waits for a coordinator, and what computes a batch of it."""
    store = open_store(str(tmp_path / "runs"))
    plan = submit(store, load_campaign(tomllib.loads(SPEC)), 10)
    address = CampaignAddress.of(store, plan, partial(fake_engine.raises_above, 0.07))
    return store, plan, lambda batch: run_batch(address, BatchRequest(batch))


@pytest.fixture
def awaited():
    """Return what awaits a campaign, but not for ever."""
    return lambda running: asyncio.run(asyncio.wait_for(_of(running), 60.0))


async def _of(running):
    return await running


@pytest.fixture(autouse=True)
def short_pause(monkeypatch):
    """Look again at once."""
    monkeypatch.setattr("clearcap.submitted._PAUSE", 0.001)


def test_awaited_by_the_loop_that_computes(queued):
    """If awaiting blocked the loop, the rows would never come; functions are told all rows, each once, in the loop."""
    store, plan, run = queued
    told, beats = [], []
    running = RunningCampaign(clearcap.Results(store, plan), beats.append, told.append)
    assert repr(running) == f"<RunningCampaign {plan.campaign_id}: queued, 0 of 25 runs>"
    assert plan.campaign_id in running._repr_html_()

    async def compute():
        for batch in range(len(plan.batches)):
            run(batch)
            while len(told) <= batch:
                await asyncio.sleep(0.001)
        write_state(store, plan.campaign_id, "completed")

    async def both():
        return (await asyncio.gather(running, compute()))[0]

    with pytest.warns(UserWarning, match=r"failures\.min_ok"):  # the stand-in lets some fail
        results = asyncio.run(both())
    assert [len(table) for table in told] == [10, 10, 5]
    assert told[0].attrs["units"] == results.units
    pd.testing.assert_frame_equal(pd.concat(told), results.rows)
    assert results.rows.index.tolist() == [*range(25)]
    assert beats == []  # nobody has written one


def test_bad_rows_are_told_once_they_are_computed_again(queued):
    """A damaged file is no table, and does not hide what comes later."""
    store, plan, run = queued
    told = []
    follower = Follower(store, plan, rows=told.append)
    run(0), run(2)
    part = f"{plan.campaign_id}/parts/part-000000.parquet"
    store.files.write(part, b"damaged")
    for _ in range(2):
        follower.look()
        follower.tell()
    assert [table.index.tolist() for table in told] == [[*range(20, 25)]]
    run(0), run(1)
    store.compact(plan)
    follower.look()
    follower.tell()
    assert sorted(pd.concat(told).index) == [*range(25)]


@pytest.mark.parametrize("state", ["cancelled", "failed"])
def test_a_campaign_that_ends_otherwise(queued, state):
    """The error says how, and why."""
    store, plan, _ = queued
    write_state(store, plan.campaign_id, state, "a reason")
    with pytest.raises(clearcap.CampaignError, match=f"{state}: a reason"):
        RunningCampaign(clearcap.Results(store, plan)).wait()


class Counted:
    """A lock that counts who has come to it, whether he got it or waits."""

    def __init__(self, lock):
        self._lock, self.came = lock, 0

    def __enter__(self):
        self.came += 1
        self._lock.acquire()

    def __exit__(self, *_):
        self._lock.release()


def test_rows_are_told_once_however_often_it_is_awaited(queued, awaited, monkeypatch):
    """What the function raises ends the waiting, and loses no table; two who look at once read none twice."""
    store, plan, run = queued
    told = []

    def interrupted(rows):
        told.append(rows)
        if len(told) < 3:
            raise InterruptedError

    running = RunningCampaign(clearcap.Results(store, plan), rows=interrupted)
    for batch in range(2):
        run(batch)
        running._follower.look()
    for _ in range(2):
        with pytest.raises(InterruptedError):
            awaited(running)
    run(2)
    looks = running._follower._looks = Counted(running._follower._looks)
    stream, reading = Store.stream, []

    def stream_with_another_reader(*given):
        reading.append(given)
        until(lambda: looks.came == 2 or len(reading) == 2, "the other thread looks too")
        return stream(*given)

    monkeypatch.setattr(Store, "stream", stream_with_another_reader)
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda _: running._follower.look(), range(2)))
    write_state(store, plan.campaign_id, "completed")
    with pytest.warns(UserWarning, match=r"failures\.min_ok"):  # the stand-in lets some fail
        results = running.wait()
    assert [len(table) for table in told] == [10, 10, 5]
    pd.testing.assert_frame_equal(pd.concat(told), results.rows)


def test_a_coordinator_that_ends_at_once(queued, awaited):
    """Nobody waits for it for ever."""
    store, plan, _ = queued
    running = RunningCampaign(clearcap.Results(store, plan))
    running._assignment = Assignment("coordinator", NOBODY, "its.log")
    with pytest.raises(clearcap.CampaignError, match=r"its\.log; submit it again"):
        awaited(running)


@pytest.mark.parametrize("left", [None, {**this_process(), "pid": NOBODY, "token": "x"}], ids=["ended", "killed"])
@pytest.mark.parametrize("kind", ["service", "coordinator"])
def test_another_coordinator_that_ends_before_it_begins(queued, awaited, kind, left):
    """Nobody waits for it for ever, whether it gave its lease back or not."""
    store, plan, _ = queued
    running = RunningCampaign(clearcap.Results(store, plan))
    running._assignment = Assignment(kind)
    if left:
        store.write_json(SERVICE if kind == "service" else plan.campaign_id, LEASE, left)
    with pytest.raises(clearcap.CampaignError, match="ended before it began; submit it again"):
        awaited(running)


def test_a_coordinator_elsewhere_that_is_silent(queued, awaited, monkeypatch):
    """For as long as it is silent for less than it bears an outage of its store, it is waited for."""
    store, plan, _ = queued
    write_state(store, plan.campaign_id, "running")
    there = {**this_process(), "host": "another machine", "name": "node7", "pid": 4711}
    store.write_json(plan.campaign_id, LEASE, {**there, "token": "x"})
    beat = Heartbeat(plan.campaign_id, "running", 25, 20, 20, 0, 5, {"ok": 20}, 3.5, 9.0, 2)
    store.write_json(plan.campaign_id, HEARTBEAT, beat.to_json())
    monkeypatch.setattr(lease, "STALE_AFTER", 0.0)
    running = RunningCampaign(clearcap.Results(store, plan))
    assert [running._look().is_over for _ in range(3)] == [False] * 3
    monkeypatch.setattr("clearcap.submitted._SILENCE", 0.0)
    with pytest.raises(clearcap.CampaignError, match=r"no longer writes \(process 4711 on node7"):
        awaited(running)


def test_a_completed_campaign_that_begins_again(queued, monkeypatch):
    """One submitted again is over at once; that its coordinator then looks at it is no failure."""
    store, plan, run = queued
    for batch in range(3):
        run(batch)
    write_state(store, plan.campaign_id, "completed")
    running = RunningCampaign(clearcap.Results(store, plan))
    monkeypatch.setattr(running._follower, "tell", lambda: write_state(store, plan.campaign_id, "running"))
    with pytest.warns(UserWarning, match=r"failures\.min_ok"):
        assert len(running.wait().rows) == 25


@pytest.mark.slow
@pytest.mark.processes
def test_submitted_and_awaited(tmp_path):
    """A coordinator in the background computes it, and then writes the report."""
    sticks = {"target": "materials.block_slope.friction", "distribution": "uniform", "lower": 0.65, "upper": 0.8}
    tables = {"format": 1, "name": "slope", "mechanism": "incline", "samples": 4, "simulation": {"horizon": 0.2}}
    tables |= {"variables": {"friction": sticks}}
    store, told = str(tmp_path / "runs"), []

    running = clearcap.submit_campaign(tables, store=store, workers=1, rows=told.append)

    async def awaited():
        return await running

    results = asyncio.run(awaited())
    assert results.statuses == {"ok": 4}
    until(lambda: _has_ended(running._assignment.pid), "the coordinator goes on")
    assert (tmp_path / "runs" / results.id / "report" / "report.html").exists()
    assert pd.concat(told).sort_index().equals(results.rows)

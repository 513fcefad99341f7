"""Campaigns to their end on real worker processes, with a stand-in for the physics."""

import json
import os
from dataclasses import replace
from functools import partial

import pytest

from campaign.cluster import workers as of_dask
from campaign.cluster.cluster import Cluster
from campaign.coordinator import coordinate as coordinating
from campaign.coordinator.coordinate import coordinate
from campaign.coordinator.failed_runs import TooManyFailed
from campaign.coordinator.lease import LeaseHeld, hold_lease
from campaign.coordinator.state import state_of
from campaign.coordinator.submit import submit
from campaign.errors import CampaignError, StoreError
from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from campaign.store import Store, open_store, part_name
from campaign.store.layout import CANCEL
from campaign.worker.messages import Cancelled, WrongBuild
from tests.campaign import fake_engine
from tests.campaign.driving import computed, rows, start

pytestmark = [pytest.mark.usefixtures("forked_workers"), pytest.mark.processes]


def test_rows_do_not_depend_on_workers_and_batches(tmp_path, campaign):
    """The bits of one process, for 1 and 2 workers and batches of 7 and 3; storms/test_same_bits.py goes on."""
    reference = rows(*computed(tmp_path / "a", campaign, 25))
    assert reference["sample"].to_pylist() == list(range(25))
    for name, processes, size in (("b", 1, 7), ("c", 2, 3)):
        store, outcome = start(tmp_path / name, campaign, processes, size)
        assert outcome.survey.statuses == {"ok": 25}
        assert rows(store, outcome).equals(reference)


def test_more_samples_keep_the_first(tmp_path, campaign, campaign_file, workers):
    """A longer campaign begins with the rows of the shorter one."""
    short = rows(*start(tmp_path / "a", campaign))
    long = rows(*start(tmp_path / "b", load_campaign(str(campaign_file), samples=32)))
    assert long.slice(0, 25).replace_schema_metadata(short.schema.metadata).equals(short)


def test_relative_store_is_that_of_who_names_it(tmp_path, campaign, workers, monkeypatch):
    """Workers that stand in another folder write into the store that the coordinator means."""
    monkeypatch.chdir(tmp_path)
    _, outcome = start("here", campaign)
    assert outcome.survey.statuses == {"ok": 25}
    assert len(list((tmp_path / "here" / outcome.plan.campaign_id / "parts").glob("part-*.parquet"))) == 9


def test_finished_campaign_computes_nothing(tmp_path, campaign, monkeypatch, workers):
    """The same command again starts no worker; a lost or bad part alone is computed again."""
    store, outcome = start(tmp_path / "a", campaign)
    before = rows(store, outcome)
    with monkeypatch.context() as patch:
        patch.setattr(coordinating, "connect_workers", None)
        store, outcome = start(tmp_path / "a", campaign)
    assert outcome.computed == 0
    name = part_name(outcome.plan, 2)
    store.files.write(name, store.files.read(name)[:-50])
    store.files.remove(part_name(outcome.plan, 4))
    store, outcome = start(tmp_path / "a", campaign)
    assert outcome.computed == 6
    assert rows(store, outcome).equals(before)


def test_many_small_files_are_merged_at_the_end(tmp_path, campaign, monkeypatch, workers):
    """The rows stay the same, and the same command computes nothing; a store that refuses it ends no campaign."""
    store, outcome = start(tmp_path / "a", campaign)
    before, name = rows(store, outcome), f"{outcome.plan.campaign_id}/parts"
    assert len(store.files.names(name)) == 9
    monkeypatch.setattr(coordinating, "MANY_FILES", 8)
    with monkeypatch.context() as patch:

        def refuse(store, plan):
            raise StoreError("full")

        patch.setattr(Store, "compact", refuse)
        start(tmp_path / "a", campaign)
        assert len(store.files.names(name)) == 9
    store, outcome = start(tmp_path / "a", campaign)
    assert len(store.files.names(name)) == 1
    assert (outcome.computed, rows(store, outcome).equals(before)) == (0, True)


def test_what_dead_writers_left_is_removed(tmp_path, campaign, workers):
    """Temporary files of parts, and of a heartbeat that its coordinator did not live to finish."""
    _, outcome = start(tmp_path / "a", campaign)
    folder = tmp_path / "a" / outcome.plan.campaign_id
    for name in ("heartbeat.json", "parts/part-000001.parquet"):
        left = folder / f"{name}.0123456789ab-1-01234567.tmp"
        left.touch()
        os.utime(left, (0.0, 0.0))
    start(tmp_path / "a", campaign)
    assert list(folder.rglob("*.tmp")) == []


def test_killed_worker_costs_nothing(tmp_path, campaign):
    """Kill -9 of a worker in a batch: all rows, the same bits, no leftovers."""
    reference = rows(*computed(tmp_path / "a", campaign, 25))
    killer = partial(fake_engine.kills_once, str(tmp_path / "killed"))
    store, outcome = start(tmp_path / "b", campaign, simulate=killer)
    assert (tmp_path / "killed").exists()
    assert rows(store, outcome).equals(reference)
    names = store.files.names(f"{outcome.plan.campaign_id}/parts")
    assert names == [f"part-{batch:06d}.parquet" for batch in range(9)]


@pytest.fixture
def wrong_ones(campaign, tmp_path):
    """Return the ways in which five samples of the campaign go wrong, by J1, and these samples."""
    ways = ("segfault", "never ends", "eats memory", "exits", "not a number")
    table = rows(*computed(tmp_path / "reference", campaign, 25))
    ordered = sorted(zip(table["J1"].to_pylist(), table["sample"].to_pylist(), strict=True))
    picked = [ordered[i] for i in (2, 7, 12, 17, 22)]
    limits = {way: (0.999999 * j1, j1) for way, (j1, _) in zip(ways, picked, strict=True)}
    return limits, dict(zip(ways, (sample for _, sample in picked), strict=True)), table


@pytest.mark.slow
def test_runs_that_end_their_process_are_rows(tmp_path, campaign_file, wrong_ones):
    """A segfault, a run that never ends, one that eats memory, an exit, a NaN: a row each, neighbours untouched."""
    limits, samples, reference = wrong_ones
    text = campaign_file.read_text() + "\n[execution]\ntime_limit = 1.0\nmemory_limit = 1.5\n"
    campaign_file.write_text(text)
    wrong = partial(fake_engine.goes_wrong, limits)
    store, outcome = start(tmp_path / "b", load_campaign(str(campaign_file)), simulate=wrong)
    found = {row["sample"]: row for row in rows(store, outcome).to_pylist()}
    expected = {
        "segfault": ("crashed", "SIGSEGV"),
        "never ends": ("timeout", "ignored its time limit"),
        "eats memory": ("crashed", "out of memory: the process may use 1.5 GiB"),
        "exits": ("crashed", "exit status 7"),
        "not a number": ("invalid", "no finite value of FC-1"),
    }
    for way, (status, message) in expected.items():
        row = found.pop(samples[way])
        assert row["status"] == status, way
        assert message in row["message"]
        assert row["FC-1"] is None
    before = {row["sample"]: row for row in reference.to_pylist()}
    assert found == {sample: before[sample] for sample in found}
    assert len(found) == 20


def test_batches_of_a_plan_are_kept(tmp_path, campaign, caplog):
    """Another batch size for a campaign that is planned already changes nothing, and a warning says so."""
    store = open_store(str(tmp_path / "s"))
    first = submit(store, campaign, 3)
    assert submit(store, campaign).batches == first.batches
    assert "are kept" not in caplog.text
    caplog.handler.setLevel(0)  # a local cluster of this module silences all handlers
    assert submit(store, campaign, 5).batches == first.batches == make_plan(campaign, 3).batches
    assert "batches of 3 samples are kept" in caplog.text


def test_two_coordinators(tmp_path, campaign):
    """The second one learns which process holds the lease; when that one is gone it coordinates the campaign."""
    store = open_store(str(tmp_path / "s"))
    plan = submit(store, campaign, 3)
    with hold_lease(store, plan.campaign_id), pytest.raises(LeaseHeld, match="is computed by process"):
        coordinate(store, plan, Cluster(workers=1), simulate=fake_engine.simulate)
    assert state_of(store, plan.campaign_id)["state"] == "queued"
    coordinate(store, plan, Cluster(workers=1), simulate=fake_engine.simulate)
    assert state_of(store, plan.campaign_id)["state"] == "completed"
    assert store.read_json(plan.campaign_id, "lease.json") is None


def test_cancelled_campaign_stops_and_goes_on(tmp_path, campaign):
    """The marker ends runs that would never end, with what is finished kept; without the marker it goes on."""
    store = open_store(str(tmp_path / "s"))
    plan = submit(store, campaign, 1)
    seen = []

    def cancel_after_some(heartbeat):
        seen.append(heartbeat.done)
        if heartbeat.done:
            store.files.write(f"{plan.campaign_id}/{CANCEL}", b"")

    slow = partial(fake_engine.lasts, 3, str(tmp_path / "quick"))
    with pytest.raises(Cancelled, match=f"clearcap resume {plan.campaign_id}"):
        coordinate(store, plan, Cluster(workers=2), cancel_after_some, slow)
    assert state_of(store, plan.campaign_id) | {"since": 0, "message": ""} == {
        "state": "cancelled",
        "message": "",
        "since": 0,
        "open": False,
        "fault": None,
        "options": ["--workers", "2"],
    }
    kept = store.survey(plan).rows
    assert 0 < kept <= 3
    store.remove(plan.campaign_id, CANCEL)
    outcome = coordinate(store, plan, Cluster(workers=2), simulate=fake_engine.simulate)
    assert outcome.computed == 25 - kept


def test_what_is_damaged_is_quarantined(tmp_path, campaign, workers):
    """Nothing is written over: who looks for the cause finds the file as it was."""
    store = open_store(str(tmp_path / "s"))
    name = part_name(submit(store, campaign, 3), 1)
    store.files.write(name, b"damaged")
    _, outcome = start(tmp_path / "s", campaign)
    assert (store.files.read(f"{name}.bad"), outcome.computed) == (b"damaged", 25)


def test_rows_computed_again_count_once(tmp_path, campaign, workers, monkeypatch):
    """A part that was damaged meanwhile is quarantined and computed again; heartbeats count its rows once."""
    record, damaged = Store.record, []

    def damaging(self, plan, *parts):
        record(self, plan, *parts)
        if not damaged and not self.survey(plan).missing:
            damaged.append(part_name(plan, 0))
            self.files.write(damaged[0], b"damaged")

    monkeypatch.setattr(Store, "record", damaging)
    heartbeats = []
    store, outcome = start(tmp_path / "s", campaign, show=heartbeats.append)
    assert [store.files.exists(f"{name}.bad") for name in damaged] == [True]
    assert (heartbeats[-1].done, heartbeats[-1].responses["FC-1"]["n"], rows(store, outcome).num_rows) == (25, 25, 25)


def test_too_many_failures_end_it(tmp_path, campaign_file, workers):
    """More failed rows than allowed: the campaign ends as failed, saying how many; the rows stay."""
    campaign_file.write_text(campaign_file.read_text() + "\n[failures]\nmax_failed = 4\n")
    always = partial(fake_engine.raises_above, -1.0)
    store = open_store(str(tmp_path / "s"))
    plan = submit(store, load_campaign(str(campaign_file)), 3)
    with pytest.raises(TooManyFailed, match=r"6 of 6 runs.*failures\.max_failed.*\b4\b"):
        coordinate(store, plan, Cluster(workers=1), simulate=always)
    assert state_of(store, plan.campaign_id)["state"] == "failed"
    assert store.survey(plan).statuses["crashed"] >= 6
    campaign_file.write_text(campaign_file.read_text().replace("max_failed = 4", "max_failed = 25"))
    store, outcome = start(tmp_path / "t", load_campaign(str(campaign_file)), simulate=always)
    assert outcome.survey.statuses == {"crashed": 25}


def test_store_that_fails_is_tried_again_then_reported(tmp_path, campaign):
    """A store that refuses parts for good ends the campaign with its own words, after some tries."""
    store = open_store(str(tmp_path / "s"))
    plan = submit(store, campaign, 3)
    parts = tmp_path / "s" / plan.campaign_id / "parts"
    parts.write_text("a file where the folder of parts should be")
    with pytest.raises(StoreError, match="part-0000"):
        coordinate(store, plan, Cluster(workers=1), simulate=fake_engine.simulate)
    state = state_of(store, plan.campaign_id)
    assert (state["state"], state["open"]) == ("interrupted", True)
    parts.unlink()
    assert coordinate(store, plan, Cluster(workers=1), simulate=fake_engine.simulate).survey.statuses == {"ok": 25}


def test_workers_of_another_build_are_named(tmp_path, campaign, monkeypatch):
    """No worker has the build the campaign is planned for: a message says so and nothing is computed."""
    monkeypatch.setattr(of_dask, "RETURNS_WITHIN", 1.0)
    store = open_store(str(tmp_path / "s"))
    plan = submit(store, campaign, 3)
    other = replace(plan, row_build="engine 0123456789abcdef")
    with pytest.raises(WrongBuild, match="0123456789abcdef"):
        coordinate(store, other, Cluster(workers=2), simulate=fake_engine.simulate)
    monkeypatch.setattr(coordinating, "check_build", lambda *_: None)  # as if the workers were elsewhere
    with pytest.raises(CampaignError, match="0123456789abcdef"):
        coordinate(store, other, Cluster(workers=2), simulate=fake_engine.simulate)
    assert store.survey(plan).rows == 0


def test_heartbeat_says_how_far_it_is(tmp_path, campaign, workers):
    """Counts, workers and the running capability; the last one is the whole campaign's."""
    heartbeats = []
    store, outcome = start(tmp_path / "s", campaign, show=heartbeats.append)
    last = json.loads(store.files.read(f"{outcome.plan.campaign_id}/heartbeat.json"))
    assert last == heartbeats[-1].to_json()
    assert (last["state"], last["done"], last["ok"], last["left"], last["workers"]) == ("completed", 25, 25, 0, 2)
    x = rows(store, outcome)["FC-1"].to_numpy()
    assert last["responses"]["FC-1"]["n"] == 25
    assert last["responses"]["FC-1"]["mean"] == pytest.approx(x.mean(), rel=1e-14)
    assert last["responses"]["FC-1"]["std"] == pytest.approx(x.std(ddof=1), rel=1e-12)
    cpk = min(16.0 - x.mean(), x.mean() - 9.0) / (3 * x.std(ddof=1))
    assert last["responses"]["FC-1"]["cpk"] == pytest.approx(cpk, rel=1e-12)
    assert last["responses"]["FC-2"]["cpk"] is None

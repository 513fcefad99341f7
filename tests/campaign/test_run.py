"""Campaigns to their end on real worker processes, with a stand-in for the physics."""

from functools import partial

import pytest

import campaign.run as campaign_run
from campaign.load import load_campaign
from campaign.plan import make_plan
from campaign.run import run_campaign, submit
from campaign.store import open_store, part_name
from tests.campaign import fake_engine


class Watcher:
    """Counts what it is told."""

    def __init__(self, total, done, failed):
        self.total, self.done, self.failed = total, done, failed

    def __enter__(self):
        return self

    def __exit__(self, *ending):
        pass

    def advance(self, done, failed):
        """Add up."""
        self.done += done
        self.failed += failed


@pytest.fixture(autouse=True)
def no_compilation(monkeypatch):
    """Nothing of the engine runs here."""
    monkeypatch.setattr(campaign_run, "warm_up", fake_engine.warm_up)


def start(tmp_path, name, asked, workers=2, batch_size=3, simulate=fake_engine.simulate):
    """Run a campaign in a store of its own."""
    store = open_store(str(tmp_path / name))
    plan = submit(store, asked, batch_size)
    watchers = []

    def watch(*counts):
        watchers.append(Watcher(*counts))
        return watchers[-1]

    outcome = run_campaign(store, plan, workers, watch, simulate)
    assert watchers[-1].done == watchers[-1].total == plan.spec.samples
    assert outcome.statuses.get("ok", 0) == plan.spec.samples - watchers[-1].failed
    return store, outcome


def rows(outcome):
    """Return what must not depend on how a campaign is run."""
    return outcome.scan.table.drop_columns(["wall_s", "attempts"])


def test_rows_do_not_depend_on_workers_and_batches(tmp_path, campaign):
    """The same bits for 1 and 2 workers and for batches of 3, 7 and 100."""
    _, reference = start(tmp_path, "a", campaign)
    assert reference.statuses == {"ok": 25}
    for name, workers, size in (("b", 1, 7), ("c", 2, 100)):
        assert rows(start(tmp_path, name, campaign, workers, size)[1]).equals(rows(reference))


def test_more_samples_keep_the_first(tmp_path, campaign, campaign_file):
    """A longer campaign begins with the rows of the shorter one."""
    _, short = start(tmp_path, "a", campaign)
    _, long = start(tmp_path, "b", load_campaign(str(campaign_file), samples=32))
    metadata = short.scan.table.schema.metadata
    assert rows(long).slice(0, 25).replace_schema_metadata(metadata).equals(rows(short))


def test_finished_campaign_computes_nothing(tmp_path, campaign, monkeypatch):
    """The same command again starts no worker; a lost or bad part alone is computed again."""
    store, outcome = start(tmp_path, "a", campaign)
    before = rows(outcome)
    with monkeypatch.context() as patch:
        patch.setattr(campaign_run, "local_client", None)
        store, outcome = start(tmp_path, "a", campaign)
    assert outcome.computed == 0
    name = part_name(outcome.plan, 2)
    store.files.write(name, store.files.read(name)[:-50])
    store.files.fs.rm_file(store.files.path(part_name(outcome.plan, 4)))
    _, outcome = start(tmp_path, "a", campaign)
    assert outcome.computed == 6
    assert rows(outcome).equals(before)


def test_killed_worker_costs_nothing(tmp_path, campaign):
    """Kill -9 of a worker in a batch: all rows, the same bits, no leftovers."""
    _, reference = start(tmp_path, "a", campaign)
    store, outcome = start(tmp_path, "b", campaign, simulate=partial(fake_engine.kills_once, str(tmp_path / "killed")))
    assert (tmp_path / "killed").exists()
    assert rows(outcome).equals(rows(reference))
    names = store.files.names(f"{outcome.plan.campaign_id}/parts")
    assert names == [f"part-{batch:06d}.parquet" for batch in range(9)]


def test_sample_that_kills_is_a_crashed_row(tmp_path, campaign):
    """A sample that kills every process it is given to ends as its own row; its neighbours are untouched."""
    _, reference = start(tmp_path, "a", campaign)
    deadliest = max(reference.scan.table["J1"].to_pylist())
    deadly = partial(fake_engine.kills_above, 0.999 * deadliest)
    _, outcome = start(tmp_path, "b", campaign, simulate=deadly)
    assert outcome.statuses == {"crashed": 1, "ok": 24}
    for row, before in zip(rows(outcome).to_pylist(), rows(reference).to_pylist(), strict=True):
        if row["J1"] == deadliest:
            assert row["status"] == "crashed"
            assert "killed its process" in row["message"]
            assert row["FC-1"] is None
        else:
            assert row == before


def test_batches_of_a_plan_are_kept(tmp_path, campaign, caplog):
    """Another batch size for a campaign that is planned already changes nothing, and is said."""
    store = open_store(str(tmp_path / "s"))
    first = submit(store, campaign, 3)
    assert submit(store, campaign).batches == first.batches
    assert caplog.text == ""
    assert submit(store, campaign, 5).batches == first.batches == make_plan(campaign, 3).batches
    assert "batches of 3 samples are kept" in caplog.text

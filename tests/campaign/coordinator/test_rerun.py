"""Rows computed again: those selected, in the place of the old ones, and nothing else changes."""

from contextlib import nullcontext
from functools import partial

import pytest

from campaign.cluster.cluster import Cluster
from campaign.coordinator.lease import LeaseHeld, hold_lease
from campaign.coordinator.requests import request_rerun, rerun_request
from campaign.coordinator.rerun import failed_samples, rerun, rerun_requested
from campaign.coordinator.state import state_of
from campaign.errors import SpecError, StoreError
from campaign.store.manifest import load_manifest
from campaign.worker.messages import WrongBuild
from tests.campaign import fake_engine
from tests.campaign.driving import computed

pytestmark = pytest.mark.processes


@pytest.fixture
def broken(tmp_path, campaign):
    """Return a campaign, complete but for four runs that crashed, and its table."""
    reference, _ = computed(tmp_path / "a", campaign, 10)
    limit = sorted(reference.table()["J1"].to_pylist())[-5]
    store, plan = computed(tmp_path / "b", campaign, 10, partial(fake_engine.raises_above, limit))
    return store, plan, reference.table()


def test_failed_rows_are_replaced(broken, workers):
    """Mended, the table is what it would have been; the rows remember what they were."""
    store, plan, reference = broken
    samples = failed_samples(store, plan)
    assert len(samples) == len(failed_samples(store, plan, ["crashed"])) == 4
    assert failed_samples(store, plan, ["timeout"]) == []
    again = rerun(store, plan, samples, Cluster(workers=1), fake_engine.simulate)
    assert (again.samples, again.before, again.after) == (4, {"crashed": 4}, {"ok": 4})
    kept = ["wall_s", "attempts", "earlier_attempts"]
    assert store.table().drop_columns(kept).equals(reference.drop_columns(kept))
    for row in store.table().to_pylist():
        fixed = row["sample"] in samples
        assert row["earlier_attempts"] == ("crashed (ArithmeticError: no solution)" if fixed else "")
        assert row["attempts"] == (2 if fixed else 1)
    assert store.survey(plan, verify=True).bad == {}


def test_no_manifest_vouches_for_the_rows_before(broken, monkeypatch):
    """While parts are replaced it lists the others only: a new part may have the size of the old one."""

    class Refusing:
        def submit(self, *_):
            raise StoreError("no worker")

    store, plan, _ = broken
    parts = store.survey(plan).parts
    store.record(plan, parts.values())
    monkeypatch.setattr("campaign.coordinator.rerun.connect_workers", lambda _: nullcontext(Refusing()))
    with pytest.raises(StoreError, match="no worker"):
        rerun(store, plan, [12], Cluster(workers=1), fake_engine.simulate)
    assert load_manifest(store.files, plan) == {parts[batch].file: [parts[batch]] for batch in (0, 2)}


def test_rows_remember_all_they_were(broken, workers):
    """Computed again and again, a row says what each time came of it."""
    store, plan, _ = broken
    sample = failed_samples(store, plan)[0]
    for cure in (partial(fake_engine.raises_above, -1.0), fake_engine.simulate):
        rerun(store, plan, [sample], Cluster(workers=1), cure)
    row = store.table().to_pylist()[sample]
    crashed = "crashed (ArithmeticError: no solution)"
    assert (row["status"], row["attempts"], row["earlier_attempts"]) == ("ok", 3, f"{crashed}; {crashed}")


def test_sample_without_a_row_is_refused(broken):
    """Nothing is computed then; nor while a coordinator holds the lease."""
    store, plan, _ = broken
    with pytest.raises(SpecError, match=r"sample 25\b"):
        rerun(store, plan, [3, 25], Cluster(workers=1), fake_engine.simulate)
    store.files.remove(f"{plan.campaign_id}/parts/part-000002.parquet")
    with pytest.raises(SpecError, match=r"sample 20\b"):
        rerun(store, plan, [20], Cluster(workers=1), fake_engine.simulate)
    with hold_lease(store, plan.campaign_id), pytest.raises(LeaseHeld):
        rerun(store, plan, [3], Cluster(workers=1), fake_engine.simulate)


def test_a_request_is_fulfilled_and_removed(broken, workers):
    """Only rows with the wanted status; without a request nothing is done."""
    store, plan, reference = broken
    assert rerun_requested(store, plan, Cluster(workers=1), fake_engine.simulate) is None
    request_rerun(store, plan.campaign_id, ["timeout"], "eva")
    assert rerun_requested(store, plan, Cluster(workers=1), fake_engine.simulate).samples == 0
    request_rerun(store, plan.campaign_id, [], "eva")
    assert rerun_request(store, plan.campaign_id).by == "eva"
    again = rerun_requested(store, plan, Cluster(workers=1), fake_engine.simulate)
    assert (again.samples, again.after) == (4, {"ok": 4})
    assert rerun_request(store, plan.campaign_id) is None
    assert store.table()["status"].to_pylist() == ["ok"] * reference.num_rows


def test_a_request_outlives_whoever_fulfils_it(broken, workers, monkeypatch):
    """Ended amid the work, or kept from it: the next one begins again; one that cannot succeed ends with its reason."""
    store, plan, _ = broken
    request_rerun(store, plan.campaign_id, [], "eva")
    with hold_lease(store, plan.campaign_id), pytest.raises(LeaseHeld):
        rerun_requested(store, plan, Cluster(workers=1), fake_engine.simulate)
    assert rerun_request(store, plan.campaign_id) is not None

    def fails(error):
        def stand_in(*_):
            raise error

        monkeypatch.setattr("campaign.coordinator.rerun.rerun", stand_in)

    fails(KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        rerun_requested(store, plan, Cluster(workers=1))
    assert rerun_request(store, plan.campaign_id) is not None
    fails(WrongBuild("another build"))
    with pytest.raises(WrongBuild):
        rerun_requested(store, plan, Cluster(workers=1))
    assert rerun_request(store, plan.campaign_id) is None
    assert state_of(store, plan.campaign_id)["message"] == "another build"

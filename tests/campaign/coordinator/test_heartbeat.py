"""Heartbeats: counts of stored rows, and the rate at which rows are computed."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest

from campaign.coordinator.heartbeat import Heartbeat, Progress
from campaign.store import Survey, open_store
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from campaign.worker.moments import moments
from reporting import capability
from tests.campaign import fake_engine


def test_rows_that_were_there_are_counted_and_not_computed(store, plan):
    """A part that a lost worker had written is rows done, and no work of this coordinator: the rate has none of it."""
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
    progress.workers = 2
    heartbeat = progress.heartbeat("running")
    assert (heartbeat.done, heartbeat.ok, heartbeat.failed, heartbeat.left) == (25, 25, 0, 0)
    assert (progress.computed, heartbeat.workers) == (10, 2)
    assert heartbeat.responses["FC-1"]["n"] == 25
    assert heartbeat.rate > 0.0


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

"""What a coordinator says of a campaign: counts of rows there, and the rate at which they are computed."""

from campaign.coordinator.heartbeat import Heartbeat, Progress
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from tests.campaign import fake_engine


def test_rows_that_were_there_are_counted_and_not_computed(store, plan):
    """A part that a lost worker had written is rows done, and no work of this coordinator: the rate has none of it."""
    ledger = Progress(store, plan, store.survey(plan))
    task = CampaignAddress.of(store, plan, fake_engine.simulate)
    ledger.add(run_batch(task, BatchRequest(0)))
    again = run_batch(task, BatchRequest(0))
    assert not again.computed
    fresh = Progress(store, plan, store.survey(plan))
    assert (fresh.done, fresh.computed) == (10, 0)
    ledger = Progress(store, plan, store.survey(plan))
    ledger.add(run_batch(task, BatchRequest(1)))
    run_batch(task, BatchRequest(2))
    ledger.add(run_batch(task, BatchRequest(2)))
    said = ledger.heartbeat("running", 2)
    assert (said.done, said.ok, said.failed, said.left, ledger.computed) == (25, 25, 0, 0, 10)
    assert said.responses["FC-1"]["n"] == 25
    assert said.rate > 0.0


def test_what_another_version_said_is_no_heartbeat():
    """Fields that this version does not know: nothing is said, and nothing breaks."""
    assert Heartbeat.from_json({"campaign": "c", "speed": 3}) is None

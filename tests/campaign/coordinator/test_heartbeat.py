"""What a coordinator says of a campaign: counts of rows there, and the rate at which they are computed."""

from campaign.coordinator.heartbeat import Heartbeat, Progress
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
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
    """Fields that this version does not know: nothing is said, and nothing breaks."""
    assert Heartbeat.from_json({"campaign": "c", "speed": 3}) is None

"""The window of batches in flight, with a client that stands in for dask's and answers at once."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from campaign.coordinator.coordinator import _begin
from campaign.coordinator.dispatch import BATCHES_PER_WORKER, LARGEST_TASK, compute
from campaign.coordinator.lease import hold_lease
from campaign.coordinator.results import Lost
from campaign.coordinator.submit import submit
from campaign.spec.load import load_campaign
from campaign.store import open_store
from campaign.worker.messages import CampaignAddress
from tests.campaign import fake_engine
from tests.campaign.coordinator.test_stopping_rule import RULE

WORKERS = 2
WINDOW = BATCHES_PER_WORKER * WORKERS


class Client:
    """What the coordinator asks of a dask client; a task is computed where it is submitted."""

    def __init__(self, *, answers=True):
        self.status, self.answers = "running", answers
        self.tasks, self.live, self.most, self.cancelled = [], 0, 0, 0

    def scheduler_info(self, n_workers):
        """Return workers that are there."""
        return {"workers": {f"tcp://10.0.0.{i}:1": {} for i in range(WORKERS)}, "address": "tcp://10.0.0.9:1"}

    def submit(self, function, task, requests, *, key, **options):
        """Compute, and return a future that is finished and says so to whoever asks, if it answers at all."""
        self.tasks.append([order.batch for order in requests])
        self.live += 1
        self.most = max(self.most, self.live)
        done = self.compute(function, task, requests)
        future = SimpleNamespace(key=key, status="finished", result=lambda timeout: done, release=self.release)
        future.add_done_callback = lambda put: put(future) if self.answers else None
        return future

    def compute(self, function, task, requests):
        """Return what a worker returns."""
        return function(task, requests)

    def release(self):
        """Take note that a future is let go."""
        self.live -= 1

    def cancel(self, futures, force):
        """Take note of what is taken back."""
        self.cancelled += len(futures)


@pytest.fixture
def begin(tmp_path, campaign_file):
    """Return a campaign that is about to be computed, in batches of a few samples."""

    def begin(samples, size, rule=""):
        text = campaign_file.read_text()
        campaign_file.write_text((text.replace("samples = 25\n", "") if rule else text) + rule)
        store = open_store(str(tmp_path / "runs"))
        plan = submit(store, load_campaign(str(campaign_file), samples=samples), size)
        task = CampaignAddress.of(store, plan, fake_engine.simulate)
        with hold_lease(store, plan.campaign_id) as token:
            return _begin(store, plan, task, token, lambda _: None)

    return begin


def test_every_batch_once_within_the_window(begin):
    """Short batches travel together, ever fewer towards the end, so that no worker waits for another's last task."""
    drive, client, left = begin(300, 3), Client(), 100
    compute(drive, client)
    assert [batch for task in client.tasks for batch in task] == list(range(left))
    assert (client.most, client.live) == (WINDOW, 0)
    lengths = [len(task) for task in client.tasks]
    assert 1 < max(lengths) <= LARGEST_TASK
    for length in lengths:
        assert length <= max(left // WINDOW, 1)
        left -= length


def test_long_batches_travel_alone(begin):
    """Nothing is gained by waiting for several."""
    drive, client = begin(60, 3), Client()
    client.compute = lambda function, task, requests: [replace(done, seconds=10.0) for done in function(task, requests)]
    compute(drive, client)
    assert {len(task) for task in client.tasks} == {1}


def test_no_further_than_a_window_beyond_the_next_checkpoint(begin):
    """What lies beyond the end of a campaign that stops when sure is wasted."""
    drive, client, ahead = begin(None, 2, RULE), Client(), []

    def noting(function, task, requests):
        ahead.append(requests[-1].batch - drive.queue.batches_for(drive.checkpoints[0]))
        return function(task, requests)

    client.compute = noting
    compute(drive, client)
    assert drive.verdict.sure
    assert max(ahead) == WINDOW - 1
    assert max(batch for task in client.tasks for batch in task) < len(drive.plan.batches) - 1


def test_what_is_in_flight_is_taken_back_when_it_ends(begin):
    """By a client that still has its scheduler; a lost one is found within a beat."""
    drive, client = begin(60, 3), Client(answers=False)
    drive.workers = WORKERS

    def ends(heartbeat):
        raise KeyboardInterrupt

    drive.show = ends
    with pytest.raises(KeyboardInterrupt):
        compute(drive, client)
    assert client.cancelled == WINDOW

    def loses(heartbeat):
        client.status = "closed"

    drive.show, client.cancelled = loses, 0
    with pytest.raises(Lost, match="client closed"):
        compute(drive, client)
    assert client.cancelled == 0

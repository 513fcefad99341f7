"""The window of batches in flight, the queue of those that wait, and pauses between attempts."""

from concurrent.futures import Future
from dataclasses import replace
from types import SimpleNamespace

import pytest

from campaign.cluster.workers import SchedulerLost, WorkerDied
from campaign.coordinator import dispatch
from campaign.coordinator.coordinate import Coordinator
from campaign.coordinator.dispatch import CALLS_PER_WORKER, LARGEST_CALL, PAUSES, Losses, Window, WorkQueue
from campaign.coordinator.lease import hold_lease
from campaign.coordinator.submit import submit
from campaign.spec.load import load_campaign
from campaign.store import open_store
from campaign.worker.messages import BatchRequest
from tests.campaign import fake_engine
from tests.campaign.coordinator.test_stopping_rule import RULE

WORKERS = 2
WINDOW = CALLS_PER_WORKER * WORKERS


class ImmediateWorkers:
    """Workers that compute a call when it is submitted, and perhaps never say so."""

    name = "a test"

    def __init__(self, *, answers=True):
        self.answers, self.lost, self.expected = answers, False, []
        self.batches, self.finished, self.most, self.cancelled = [], [], 0, 0

    def count(self):
        """Return the number of workers, as long as they are reached."""
        if self.lost:
            raise SchedulerLost("client closed")
        return WORKERS

    def waits(self):
        """Miss no worker."""
        return []

    def expect(self, calls):
        """Note how many calls are to come."""
        self.expected.append(calls)

    def submit(self, key, function, address, requests):
        """Compute, and note what was requested."""
        future = Future()
        self.batches.append([request.batch for request in requests])
        self.finished.append(future)
        self.most = max(self.most, len(self.finished))
        future.set_result(self.compute(function, address, requests))
        return future

    def compute(self, function, address, requests):
        """Return what a worker returns."""
        return function(address, requests)

    def next_finished(self, timeout):
        """Return the calls in the order of their submission."""
        return self.finished.pop(0) if self.answers and self.finished else None

    def cancel(self):
        """Note how many calls are taken back."""
        self.cancelled, self.finished = len(self.finished), []


class DyingWorkers(ImmediateWorkers):
    """Workers of which the first call that is given ends its worker."""

    def __init__(self):
        super().__init__()
        self.requests = []

    def submit(self, key, function, address, requests):
        """Note the requests; the first call has no result."""
        self.requests += requests
        if len(self.requests) > len(requests):
            return super().submit(key, function, address, requests)
        future = Future()
        future.set_exception(WorkerDied("killed"))
        self.finished.append(future)
        return future


@pytest.fixture
def begin(tmp_path, campaign_file):
    """Return a function that returns the coordinator of a campaign, in batches of a few samples."""

    def begin(samples, size, rule="", show=lambda _: None):
        text = campaign_file.read_text()
        campaign_file.write_text((text.replace("samples = 25\n", "") if rule else text) + rule)
        store = open_store(str(tmp_path / "runs"))
        plan = submit(store, load_campaign(str(campaign_file), samples=samples), size)
        with hold_lease(store, plan.campaign_id) as token:
            return Coordinator(store, plan, token, show, fake_engine.simulate)

    return begin


def test_every_batch_once_within_the_window(begin):
    """Short batches travel together, ever fewer towards the end, so that no worker waits for another's last call."""
    coordinator, workers, left = begin(300, 3), ImmediateWorkers(), 100
    coordinator.compute(workers)
    assert [batch for call in workers.batches for batch in call] == list(range(left))
    assert (workers.most, workers.cancelled) == (WINDOW, 0)
    lengths = [len(call) for call in workers.batches]
    assert 1 < max(lengths) <= LARGEST_CALL
    for length in lengths:
        assert length <= max(left // WINDOW, 1)
        left -= length


def test_long_batches_travel_alone(begin):
    """Nothing is gained by sending several at once."""
    coordinator, workers = begin(60, 3), ImmediateWorkers()
    workers.compute = lambda function, *call: [replace(result, seconds=10.0) for result in function(*call)]
    coordinator.compute(workers)
    assert {len(call) for call in workers.batches} == {1}


def test_thousands_of_workers_get_several_long_batches_a_call(begin):
    """Their scheduler could not serve a call for each: a hundred a second, until the last ones are few."""
    coordinator, workers = begin(3000, 1), ImmediateWorkers()
    workers.compute = lambda function, *call: [replace(result, seconds=10.0) for result in function(*call)]
    coordinator.compute(workers)
    assert {len(call) for call in workers.batches} == {1}
    window, queue = Window(workers, None), coordinator.queue
    window.worker_count, window.batch_seconds = 4000, 10.0
    queue.requeue([BatchRequest(0)] * 100_000)
    lengths = []
    while requests := window._next_requests(queue):
        lengths.append(len(requests))
    assert lengths[0] == 4  # 40 s: 4,000 workers, 100 calls a second
    assert lengths[-1] == 1
    assert lengths == sorted(lengths, reverse=True)


def test_no_further_than_a_window_beyond_the_next_checkpoint(begin):
    """Batches beyond the end of a campaign that its stopping rule ends are wasted."""
    coordinator, workers, ahead = begin(None, 2, RULE), ImmediateWorkers(), []
    checkpoints, plan = coordinator.checkpoints, coordinator.plan

    def noting(function, address, requests):
        ahead.append(requests[-1].batch - plan.batches_before(checkpoints.next))
        return function(address, requests)

    workers.compute = noting
    coordinator.compute(workers)
    assert checkpoints.verdict.sure
    assert max(ahead) == WINDOW - 1
    assert max(batch for call in workers.batches for batch in call) < len(plan.batches) - 1


def test_calls_in_flight_are_taken_back_at_the_end(begin):
    """Whatever ends the coordinator; lost workers are noticed at the next heartbeat."""
    workers = ImmediateWorkers(answers=False)

    def interrupt(heartbeat):
        raise KeyboardInterrupt

    coordinator = begin(60, 3, show=interrupt)
    with pytest.raises(KeyboardInterrupt):
        coordinator.compute(workers)
    assert workers.cancelled == WINDOW

    def lose(heartbeat):
        workers.lost = True

    coordinator.show = lose
    with pytest.raises(SchedulerLost, match="client closed"):
        coordinator.compute(workers)


def test_a_batch_that_ended_its_worker_is_isolated_next_time(begin):
    """Its second attempt is in a subprocess; the other batches have one attempt, in the worker."""
    coordinator, workers = begin(30, 10), DyingWorkers()
    coordinator.compute(workers)
    assert coordinator.queue.completed(30)
    attempts = sorted((request.batch, request.attempt, request.isolated) for request in workers.requests)
    assert attempts == [(0, 1, False), (0, 2, True), (1, 1, False), (2, 1, False)]


def part(batch):
    """Return the part of a batch."""
    return SimpleNamespace(batch=batch)


@pytest.fixture
def queue(plan):
    """Return the queue of a plan of batches of 10, 10 and 5, of which the second is completed."""
    return WorkQueue(plan, {1: part(1)}, 25)


def handed_out(queue):
    """Return all requests."""
    requests = []
    while (request := queue.next()) is not None:
        requests.append(request)
    return requests


def test_missing_batches_in_order(queue):
    """Completed batches are not handed out; batches that are put back come first, in their order."""
    assert len(queue) == 2
    assert handed_out(queue) == [BatchRequest(0), BatchRequest(2)]
    requests = [BatchRequest(0, 2, isolated=True), BatchRequest(2)]
    queue.requeue(requests)
    assert handed_out(queue) == requests
    assert not queue


def test_samples_beyond_the_end_are_not_computed(plan):
    """A campaign that stopped at sample 10 needs its first batch, one that stopped at 11 two."""
    assert handed_out(WorkQueue(plan, {}, 10)) == [BatchRequest(0)]
    assert handed_out(WorkQueue(plan, {}, 11)) == [BatchRequest(0), BatchRequest(1)]


def test_complete_from_the_beginning_on(queue):
    """The first samples are completed when no batch among them is missing."""
    assert not queue.completed(1)
    queue.complete(part(2))
    assert not queue.completed(1)
    queue.complete(part(0))
    assert queue.completed(25)


def test_limit(queue):
    """No batch from the limit on is handed out, until the limit moves."""
    queue.limit = 2
    assert handed_out(queue) == [BatchRequest(0)]
    queue.limit = 3
    assert handed_out(queue) == [BatchRequest(2)]


def test_pauses_double_up_to_the_longest(monkeypatch):
    """From the first one on, and from the first one again after something was computed."""
    now = [1000.0]
    monkeypatch.setattr(dispatch.time, "monotonic", lambda: now[0])
    losses, (first, longest) = Losses(), PAUSES
    assert not losses
    pauses = []
    for _ in range(40):
        pauses.append(losses.lose())
        now[0] += 10.0
    assert pauses[:4] == [first, 2 * first, 4 * first, 8 * first]
    assert pauses[-1] == longest == max(pauses)
    assert losses.seconds == 400.0
    losses.end()
    assert (losses.seconds, bool(losses), losses.lose()) == (0.0, False, first)


def test_that_there_are_no_workers_is_said(monkeypatch, caplog):
    """From the first look on, and every minute in the log; a worker that joins ends it."""
    clock, workers = SimpleNamespace(now=5000.0, time=lambda: clock.now), ImmediateWorkers()
    monkeypatch.setattr(dispatch, "time", clock)
    workers.count = lambda: 0
    window = Window(workers, None)
    for seconds in range(0, 130, 2):
        clock.now = 5000.0 + seconds
        assert [(wait.what, wait.since) for wait in window.look(7)] == [("workers", 5000.0)]
    assert caplog.text.count("has no workers; waiting for some to join it") == 2
    workers.count = lambda: 1
    assert window.look(7) == []

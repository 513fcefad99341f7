"""The batches to compute, in order."""

from types import SimpleNamespace

import pytest

from campaign.coordinator.work_queue import WorkQueue
from campaign.worker.messages import BatchRequest


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

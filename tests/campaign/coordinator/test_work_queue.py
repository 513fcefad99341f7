"""What is still to be computed, in order."""

import pytest

from campaign.coordinator.work_queue import WorkQueue
from campaign.worker.messages import BatchRequest


@pytest.fixture
def queue(plan):
    """Return a queue of batches of 10, 10 and 5, of which the second is there."""
    return WorkQueue(plan, [1], 25)


def handed_out(queue):
    """Return all requests."""
    requests = []
    while (request := queue.next()) is not None:
        requests.append(request)
    return requests


def test_missing_batches_in_order(queue):
    """What is there is not asked for; what is put back comes first."""
    assert len(queue) == 2
    assert handed_out(queue) == [BatchRequest(0), BatchRequest(2)]
    queue.requeue(BatchRequest(2, 2, isolated=True))
    assert handed_out(queue) == [BatchRequest(2, 2, isolated=True)]
    assert not queue


def test_samples_beyond_the_end_are_not_asked_for(plan):
    """A campaign that stopped at sample 10 needs its first batch, one that stopped at 11 two."""
    assert handed_out(WorkQueue(plan, [], 10)) == [BatchRequest(0)]
    assert handed_out(WorkQueue(plan, [], 11)) == [BatchRequest(0), BatchRequest(1)]


def test_complete_from_the_beginning_on(queue):
    """Samples are held when no batch before them is missing."""
    assert not queue.completed(1)
    queue.complete(2)
    assert not queue.completed(1)
    queue.complete(0)
    assert queue.completed(25)


def test_limit(queue):
    """No batch from the limit on is handed out, until the limit moves."""
    queue.limit = 2
    assert handed_out(queue) == [BatchRequest(0)]
    queue.limit = 3
    assert handed_out(queue) == [BatchRequest(2)]

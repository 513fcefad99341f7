"""What dask's client is asked, and what a scheduler that is lost means; `test_workers` has the rest on real workers."""

from types import SimpleNamespace

import pytest

from campaign.cluster.dask_workers import DaskWorkers
from campaign.cluster.workers import SchedulerLost


class Client:
    """What is used of a dask client; its tasks end as a test says."""

    def __init__(self):
        self.status, self.workers, self.submitted, self.cancelled, self.released = "running", 2, [], 0, 0

    def scheduler_info(self, n_workers):
        """Return the workers and the scheduler's address."""
        workers = {f"tcp://10.0.0.{i}:1": {} for i in range(self.workers)}
        return {"workers": workers, "address": "tcp://10.0.0.9:1"}

    def submit(self, *call, **options):
        """Return a task that is never finished, unless its callback is called."""
        task = SimpleNamespace(key=options["key"], status="finished", call=call, options=options)
        task.result = lambda timeout: "result"
        task.release = self.release
        task.add_done_callback = lambda put: setattr(task, "finish", lambda: put(task))
        self.submitted.append(task)
        return task

    def release(self):
        """Count the results that are let go."""
        self.released += 1

    def cancel(self, tasks, force):
        """Count the tasks that are taken back."""
        self.cancelled += len(tasks)


@pytest.fixture
def client():
    return Client()


@pytest.fixture
def workers(client):
    return DaskWorkers(client)


def test_result_is_released_on_arrival(client, workers):
    """Nothing stays on the cluster; keys are unique, whatever their calls are named."""
    futures = [workers.submit("same", len, "abc") for _ in range(2)]
    assert len({task.key for task in client.submitted}) == 2
    for task in client.submitted:
        task.finish()
    assert [workers.next_finished(1.0) for _ in range(2)] == futures
    assert [future.result() for future in futures] == ["result", "result"]
    assert client.released == 2


def test_calls_are_taken_back_as_long_as_there_is_a_scheduler(client, workers):
    """One that is lost has forgotten them; to ask it would take as long as its timeouts."""
    for status, cancelled in (("running", 3), ("closed", 3)):
        client.status = "running"
        for _ in range(3):
            workers.submit("call", len, "abc")
        client.status = status
        workers.cancel()
        assert client.cancelled == cancelled


def test_lost_scheduler(client, workers):
    """It is noticed when workers are counted, by a call that dask cancelled, and by a result that does not arrive."""

    def no_answer(timeout):
        raise TimeoutError

    for change in ({"status": "cancelled"}, {"result": no_answer}):
        workers.submit("call", len, "abc")
        task = client.submitted[-1]
        vars(task).update(change)
        task.finish()
        with pytest.raises(SchedulerLost):
            workers.next_finished(1.0)
    client.status = "closed"
    with pytest.raises(SchedulerLost, match="client closed"):
        workers.count()


def test_refused_workers_are_left_out(client, workers):
    """The others are named to the scheduler, and one that joins later may compute too."""
    failed = SimpleNamespace(exception=lambda: SimpleNamespace(worker="tcp://10.0.0.0:1"))
    workers.submit("call", len, "abc")
    assert workers.refuse(failed) == "tcp://10.0.0.0:1"
    workers.submit("call", len, "abc")
    options = [(task.options["workers"], task.options["allow_other_workers"]) for task in client.submitted]
    assert options == [(None, False), (["tcp://10.0.0.1:1"], True)]
    assert workers.count() == 2

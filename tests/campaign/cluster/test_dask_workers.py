"""What dask's client is asked, and what a scheduler that is lost means; `test_workers` has the rest on real workers."""

from contextlib import nullcontext
from queue import Empty
from types import SimpleNamespace

import pytest

from campaign.cluster.dask_workers import DaskWorkers
from campaign.cluster.workers import SchedulerLost


class Client:
    """What is used of a dask client; its tasks end as a test says."""

    def __init__(self):
        self.status, self.workers, self.submitted, self.cancelled, self.released = "running", 2, [], 0, 0
        self.answers, self.hang, self.looks, self.restarted = True, set(), 0, []
        self.scheduler = SimpleNamespace(identity=self.identity, restart_workers=self.restart_workers)
        self.loop = SimpleNamespace(add_callback=lambda function, **arguments: function(**arguments))

    def sync(self, function, callback_timeout, **arguments):
        """Ask the scheduler, which does not always answer."""
        if not self.answers:
            raise TimeoutError
        return function(**arguments)

    def identity(self, n_workers):
        """Return the workers; all but those that hang have sent a heartbeat since the last look."""
        self.looks += 1
        names = [f"tcp://10.0.0.{i}:1" for i in range(self.workers)]
        return {"workers": {name: {"last_seen": 0 if name in self.hang else self.looks} for name in names}}

    def restart_workers(self, workers, **options):
        """Keep which workers are to be restarted."""
        self.restarted += workers

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
    for change, said in (({"answers": False}, "does not answer"), ({"status": "closed"}, "client closed")):
        vars(client).update(change)
        with pytest.raises(SchedulerLost, match=said):
            workers.count()


@pytest.fixture
def clock(monkeypatch):
    """Return a clock that goes on when someone waits."""

    class Clock:
        now = 0.0

        def monotonic(self):
            return self.now

    clock = Clock()
    monkeypatch.setattr("campaign.cluster.dask_workers.time", clock)
    monkeypatch.setattr("campaign.cluster.dask_workers.SimpleQueue", lambda: Queue(clock))
    return clock


class Queue:
    """A queue into which nothing comes."""

    def __init__(self, clock):
        self._clock, self.put = clock, None

    def get(self, timeout):
        """Wait in vain."""
        self._clock.now += timeout
        raise Empty


def test_a_worker_that_hangs_is_replaced_within_the_time_that_the_docs_promise(client, clock, caplog):
    """It alone, again if it stays; the call that was given to it says so."""
    workers = DaskWorkers(client)
    workers.submit("call", len, "abc")
    client.hang = {"tcp://10.0.0.1:1"}
    assert workers.next_finished(50.0) is None
    assert client.restarted == []
    assert workers.next_finished(20.0) is None
    assert client.restarted == ["tcp://10.0.0.1:1"]
    assert "worker tcp://10.0.0.1:1 sends no heartbeat for 60 s" in caplog.text
    assert workers.next_finished(70.0) is None
    assert client.restarted == ["tcp://10.0.0.1:1"] * 2


@pytest.mark.parametrize(("here", "ends"), [(True, True), (False, False)])
def test_no_worker_left_on_this_machine(client, clock, here, ends):
    """Nobody else starts workers here, so the cluster counts as lost; elsewhere they are waited for."""
    workers = DaskWorkers(client, started_here=here)
    workers.submit("call", len, "abc")
    client.workers = 0
    with pytest.raises(SchedulerLost, match="all workers of this machine are gone") if ends else nullcontext():
        assert workers.next_finished(200.0) is None


def test_refused_workers_are_left_out(client, workers):
    """The others are named to the scheduler, and one that joins later may compute too."""
    failed = SimpleNamespace(exception=lambda: SimpleNamespace(worker="tcp://10.0.0.0:1"))
    workers.submit("call", len, "abc")
    assert workers.refuse(failed) == "tcp://10.0.0.0:1"
    workers.submit("call", len, "abc")
    options = [(task.options["workers"], task.options["allow_other_workers"]) for task in client.submitted]
    assert options == [(None, False), (["tcp://10.0.0.1:1"], True)]
    assert workers.count() == 2

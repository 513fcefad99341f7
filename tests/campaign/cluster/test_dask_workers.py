"""What dask's client is asked, and what a scheduler that is lost means; `test_workers` has the rest on real workers.

Which workers count as silent, and workers that are prestarted: for the first who connects, and ended in any case.
"""

import os
import socket
from contextlib import contextmanager, nullcontext
from queue import Empty
from types import SimpleNamespace

import pytest

from campaign.cluster import workers as of_dask
from campaign.cluster.cluster import Cluster
from campaign.cluster.workers import (
    LOOK_INTERVAL,
    DaskWorkers,
    Liveness,
    PrestartedWorkers,
    SchedulerLost,
    _call,
    worker_of,
)
from campaign.coordinator.submit import plan_campaign
from campaign.errors import SpecError, StoreError, UnreachableError
from campaign.store.files.retry_policy import PATIENT, Outage


class Client:
    """What is used of a dask client; its tasks end as a test says."""

    def __init__(self):
        self.status, self.workers, self.submitted, self.cancelled, self.released = "running", 2, [], 0, 0
        self.answers, self.hang, self.looks, self.restarted = True, set(), 0, []
        self.scheduler = SimpleNamespace(identity=self.identity, restart_workers=self.restart_workers)
        self.loop = SimpleNamespace(add_callback=lambda function, **arguments: function(**arguments))

    def subscribe_topic(self, topic, handler):
        """Keep who is told what workers say."""
        self.topic, self.told = topic, handler

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


def test_who_computed(client, workers, monkeypatch):
    """A call says in which process of which machine it ran; one of a worker of an earlier version does not."""
    monkeypatch.setattr(of_dask, "get_worker", lambda: SimpleNamespace(address="a", log_event=lambda *_: None))
    for answer, who in ((_call(len, "abc"), (socket.gethostname(), os.getpid())), (3, None)):
        future = workers.submit("call", len, "abc")
        client.submitted[-1].result = lambda timeout, answer=answer: answer
        client.submitted[-1].finish()
        assert workers.next_finished(1.0) is future
        assert (future.result(), worker_of(future)) == (3, who)


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
    monkeypatch.setattr("campaign.cluster.workers.time", clock)
    monkeypatch.setattr("campaign.cluster.workers.SimpleQueue", lambda: Queue(clock))
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


def test_the_first_refused_write_of_a_worker_is_told(client, workers, monkeypatch):
    """It tries again for minutes; the coordinator knows at once, and when it is over, or the worker is gone."""
    addresses = [f"tcp://10.0.0.{i}:1" for i in range(3)]  # of the last one the scheduler knows nothing
    seen = []

    def refused(fails):
        outage = Outage("runs", PATIENT)
        outage.begin("store runs: parts/x cannot be written (No space left on device)")
        seen.append([(wait.what, wait.detail) for wait in workers.waits()])
        if fails:
            raise StoreError("full")
        outage.end()
        seen.append(workers.waits())

    for address, fails in ((addresses[0], False), (addresses[1], True)):
        said = SimpleNamespace(address=address, log_event=lambda topic, told: client.told((0.0, told)))
        monkeypatch.setattr(of_dask, "get_worker", lambda said=said: said)
        with pytest.raises(StoreError) if fails else nullcontext():
            _call(refused, fails)
        assert workers.waits() == []
    full = [("store", "store runs: parts/x cannot be written (No space left on device)")]
    assert seen == [full, [], full]
    for address in addresses[1:]:
        client.told((0.0, (address, "full")))
    assert [wait.detail for wait in workers.waits()] == ["full"]
    workers.count()
    client.told((0.0, (addresses[1], "")))
    assert workers.waits() == []


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
    assert workers.refuse(failed) == ""  # named once, however many of its calls fail
    workers.submit("call", len, "abc")
    options = [(task.options["workers"], task.options["allow_other_workers"]) for task in client.submitted]
    assert options == [(None, False), (["tcp://10.0.0.1:1"], True)]
    assert workers.count() == 1


def test_one_look_serves_who_asks_next(client, workers, monkeypatch):
    """For a moment: it takes long with many workers. That the scheduler is lost is seen at once."""
    monkeypatch.setattr(of_dask, "SEEN_FOR", 1e9)
    assert [workers.count() for _ in range(3)] == [2, 2, 2]
    assert client.looks == 1
    monkeypatch.setattr(of_dask, "SEEN_FOR", 0.0)
    client.workers = 3
    assert (workers.count(), client.looks) == (3, 2)
    monkeypatch.setattr(of_dask, "SEEN_FOR", 1e9)
    client.status = "closed"
    with pytest.raises(SchedulerLost):
        workers.count()


@pytest.fixture
def silence():
    return Liveness(60.0)


def look(silence, times, heartbeat=lambda now: 0.0):
    """Look at one worker at the times given; return when it was silent."""
    return [now for now in times if silence.look({"a": heartbeat(now)}, now)]


def every_two_seconds(start, end):
    return [start + LOOK_INTERVAL * i for i in range(int((end - start) / LOOK_INTERVAL) + 1)]


def test_a_worker_without_heartbeats_is_silent(silence):
    """After the time allowed, and again after as long, until it is gone."""
    assert look(silence, every_two_seconds(0.0, 130.0)) == [60.0, 120.0]
    assert silence.look({}, 300.0) == []


def test_a_worker_that_sends_heartbeats_is_not(silence):
    """Rare ones are enough; clocks may jump."""
    assert look(silence, every_two_seconds(0.0, 600.0), lambda now: now // 50.0) == []
    assert look(silence, every_two_seconds(602.0, 900.0), lambda now: -(now // 50.0)) == []


def test_many_workers_send_heartbeats_rarely(silence):
    """As rarely as the scheduler asks them to: none of 10,000 is taken to hang before three are missing."""
    workers = dict.fromkeys(map(str, range(10_000)), 0.0)
    times = every_two_seconds(0.0, 160.0)
    assert [now for now in times if silence.look(workers, now)] == [154.0]
    assert (silence.longest(10_000), silence.longest(1000)) == (153.0, 60.0)


def test_time_in_which_nobody_looked_does_not_count(silence):
    """A laptop slept, or all processes were stopped: neither is a worker's fault."""
    assert look(silence, [0.0, 8.0 * 3600.0, 16.0 * 3600.0]) == []
    assert look(silence, every_two_seconds(16.0 * 3600.0, 16.0 * 3600.0 + 40.0)) == []


def test_one_of_several(silence):
    """The others are left alone."""
    silent = [silence.look({"a": 0.0, "b": now, "c": now}, now) for now in every_two_seconds(0.0, 70.0)]
    assert [worker for workers in silent for worker in workers] == ["a"]


@pytest.fixture
def events(monkeypatch):
    """Have workers start and end in a list."""
    events = []

    @contextmanager
    def connect_workers(cluster):
        number = len(events)
        events.append(f"start {number}")
        try:
            yield number
        finally:
            events.append(f"end {number}")

    monkeypatch.setattr(of_dask, "connect_workers", connect_workers)
    return events


def test_they_are_kept_until_they_are_lost(events):
    """Who connects again gets the same, but others after a loss; nothing is left at the end."""
    with PrestartedWorkers(Cluster()) as early:
        early.begin()
        early.begin()
        with early.connect(Cluster()) as workers:
            assert workers == 0
        assert events == ["start 0"]
        with pytest.raises(SchedulerLost), early.connect(Cluster()):
            raise SchedulerLost("closed")
        assert events == ["start 0", "end 0"]
        for _ in range(2):
            with early.connect(Cluster()) as workers:
                assert workers == 2
        assert events == ["start 0", "end 0", "start 2"]
    assert events == ["start 0", "end 0", "start 2", "end 2"]


def test_nobody_connects(events):
    """Workers of a campaign whose planning fails are ended."""

    def plan(early):
        early.begin()
        raise SpecError("samples: none")

    with pytest.raises(SpecError), PrestartedWorkers(Cluster()) as early:
        plan(early)
    assert events == ["start 0", "end 0"]


@pytest.mark.parametrize("cluster", [Cluster(scheduler="tcp://127.0.0.1:1"), Cluster(kind="slurm", workers=2)])
def test_only_processes_of_this_machine_start_early(events, cluster):
    """Jobs are submitted, and a scheduler is reached, when the plan is there."""
    with PrestartedWorkers(cluster) as early:
        early.begin()
        assert events == []
        with early.connect(cluster) as workers:
            assert workers == 0


def test_whoever_connects_hears_why_they_did_not_start(monkeypatch):
    """An error of the start is raised where workers are needed, once; a campaign that needs none never hears of it."""
    failing = []

    @contextmanager
    def connect_workers(_):
        failing.append(True)
        raise UnreachableError("2 workers cannot be started on this machine")
        yield

    monkeypatch.setattr(of_dask, "connect_workers", connect_workers)
    with PrestartedWorkers(Cluster()) as early:
        early.begin()
        with pytest.raises(UnreachableError, match="2 workers"), early.connect(Cluster()):
            pass
    assert failing == [True]


def test_faulty_campaign_starts_no_worker(tmp_path, campaign_file):
    """Only a campaign that is sound and new has workers start."""
    begun = []
    plan_campaign(str(campaign_file), str(tmp_path / "store"), when_new=lambda: begun.append("new"))
    plan_campaign(str(campaign_file), str(tmp_path / "store"), when_new=lambda: begun.append("again"))
    text = campaign_file.read_text(encoding="utf-8")
    campaign_file.write_text(text.replace("samples", "smaples", 1), encoding="utf-8")
    with pytest.raises(SpecError, match="smaples"):
        plan_campaign(str(campaign_file), str(tmp_path / "store"), when_new=lambda: begun.append("faulty"))
    assert begun == ["new"]

"""What workers do with a call, whether dask runs it or, in tests of what uses them, a process that was spawned here.

One worker compiles the engine before all others load it; what is compiled is not waited for.
"""

import os
import signal
from concurrent.futures import Future

import pytest

from campaign.cluster.cluster import Cluster
from campaign.cluster.workers import ATTEMPTS, NoWorkerLeft, WorkerDied, compile_first, connect_workers
from campaign.errors import UnreachableError
from tests.campaign.process_workers import process_workers
from tests.until import until

pytestmark = pytest.mark.processes

KINDS = {"dask": lambda: connect_workers(Cluster(workers=2)), "processes": lambda: process_workers(2)}


@pytest.fixture(scope="module", params=KINDS)
def workers(request):
    """Return two workers of a kind."""
    with KINDS[request.param]() as workers:
        yield workers


def finished(workers):
    """Return the futures of all calls in flight."""
    futures = []
    while (future := workers.next_finished()) is not None:
        futures.append(future)
    return futures


def waits(folder):
    """Say that the call has begun, and last until it may end; on a file system, as calls run in other processes."""
    (folder / f"begun-{os.getpid()}").touch()
    until((folder / "end").exists)


def dies():
    """End the process in which this runs."""
    os.kill(os.getpid(), signal.SIGKILL)


def is_of_another_build():
    """Refuse to compute, as a worker with another engine does."""
    raise ValueError("another build")


def test_results_and_errors_of_calls(workers):
    """Each future holds what its call returned or raised; none is left at the end."""
    calls = {workers.submit("power", pow, 2, n): 2**n for n in range(6)}
    failing = workers.submit("division", divmod, 1, 0)
    assert workers.count() == 2
    assert set(finished(workers)) == {*calls, failing}
    assert {call: call.result() for call in calls} == calls
    with pytest.raises(ZeroDivisionError):
        failing.result()
    assert workers.next_finished() is None


def test_waits_no_longer_than_asked(workers, tmp_path):
    """A call that is not finished in time is returned by a later wait."""
    call = workers.submit("wait", waits, tmp_path)
    assert workers.next_finished(0.2) is None
    (tmp_path / "end").touch()
    assert workers.next_finished(600.0) is call


def test_worker_that_dies_is_replaced(workers):
    """Its call says so; others are computed."""
    dead = workers.submit("dies", dies)
    finished(workers)
    with pytest.raises(WorkerDied):
        dead.result()
    after = workers.submit("power", pow, 2, 3)
    finished(workers)
    assert after.result() == 8


def test_calls_that_are_taken_back_are_not_returned(workers, tmp_path):
    """Later calls are computed as always."""
    for _ in range(3):
        workers.submit("wait", waits, tmp_path)
    workers.cancel()
    assert workers.next_finished() is None
    (tmp_path / "end").touch()
    later = workers.submit("power", pow, 2, 4)
    assert finished(workers) == [later]
    assert later.result() == 16


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_refused_workers_get_no_calls(kind, monkeypatch):
    """A worker of another build names itself; without the refused ones, the other computes, and none is left then."""
    monkeypatch.setattr("campaign.cluster.workers.RETURNS_WITHIN", 0.5)
    with KINDS[kind]() as workers:
        for _ in range(2):
            call = workers.submit("build", is_of_another_build)
            finished(workers)
            workers.refuse(call)
        with pytest.raises(NoWorkerLeft):
            workers.submit("power", pow, 2, 3)


def stops():
    """Stop the process in which this runs, as someone's SIGSTOP does."""
    os.kill(os.getpid(), signal.SIGSTOP)


def computed(workers):
    """Return a call that was computed, or None if its worker was taken to hang."""
    call = workers.submit("power", pow, 2, 3)
    assert workers.next_finished() is call
    return None if isinstance(call.exception(), WorkerDied) else call


@pytest.mark.slow
def test_a_worker_of_dask_that_hangs_is_replaced(monkeypatch):
    """Its call says so, and another worker takes its place."""
    monkeypatch.setattr("campaign.cluster.workers.SILENT_AFTER", 4.0)
    with connect_workers(Cluster(workers=1)) as workers:
        hung = workers.submit("stops", stops)
        assert workers.next_finished() is hung
        with pytest.raises(WorkerDied, match="a worker that hung"):
            hung.result()
        after = until(lambda: computed(workers), "no other worker computes")  # one that is merely slow may follow it
        assert after.result() == 8


class OneWorker:
    """A worker that answers as it is told, and remembers what it was asked."""

    def __init__(self, missing, deaths=0):
        self.asked = []
        self._missing, self._deaths, self._call = missing, deaths, None

    def submit(self, key, function):
        """Answer at once."""
        self.asked.append(key)
        self._call = Future()
        if key == "warm_up" and self._deaths:
            self._deaths -= 1
            self._call.set_exception(WorkerDied("worker 7, which ended"))
        else:
            self._call.set_result(self._missing if key == "missing_kernels" else 0.0)
        return self._call

    def next_finished(self):
        """Return the only call."""
        return self._call


def test_nothing_is_compiled_twice():
    """A worker is asked what is missing; nothing is, and the batches can begin."""
    workers = OneWorker(())
    compile_first(workers)
    assert workers.asked == ["missing_kernels"]


def test_one_worker_compiles(tmp_path):
    """What is missing is compiled, by another worker if the first one dies of it."""
    workers = OneWorker((str(tmp_path / "index"),), deaths=1)
    compile_first(workers)
    assert workers.asked == ["missing_kernels", "warm_up"] * 2


def test_workers_that_die_of_it(tmp_path):
    """Who loses worker after worker is told what to look at."""
    with pytest.raises(UnreachableError, match="worker 7"):
        compile_first(OneWorker((str(tmp_path / "index"),), deaths=ATTEMPTS))

"""One worker compiles the engine before all others load it; what is compiled is not waited for."""

from concurrent.futures import Future

import pytest

from campaign.cluster.workers import WorkerDied
from campaign.coordinator.compile_first import ATTEMPTS, compile_first
from campaign.errors import UnreachableError


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
